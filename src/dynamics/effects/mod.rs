//! What acts on a world besides springs, cells, gravity and drives: one file per effect. What a scene does not name costs
//! nothing.

pub mod contact;
mod drag;
pub(super) mod fibres;
pub(super) mod pressure;

pub(super) use drag::Drag;
