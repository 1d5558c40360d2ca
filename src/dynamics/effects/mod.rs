//! What acts on a world besides springs, cells, gravity and drives, and what leaves blocks at rest alone: one file per effect. What a
//! scene does not name costs nothing.

pub mod contact;
mod drag;
pub(super) mod fibres;
pub(super) mod inner_springs;
pub(super) mod plasticity;
pub(super) mod pressure;
pub(super) mod relaxation;
pub mod self_contact;
pub mod sleep;
pub(super) mod tearing;

pub(super) use drag::Drag;
