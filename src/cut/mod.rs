//! Cutting: the edge of a blade is carried along a path, and every spring it passes through is severed.
//!
//! Only the relative motion counts: a spring is severed when the edge passes through it, whether the blade moves, the
//! tissue, or both. Particles move along straight lines between two tests and the edge along straight pieces of its
//! path, so the moment at which edge and spring meet solves a quadratic equation: nothing is sampled, and neither a blade
//! that crosses many pitches at once nor tissue that is flung through a still blade slips past. The sides of a blade
//! behind its edge are not modelled: they neither cut nor push.

mod blade;
mod bounds;
mod cells;
mod crossing;
mod cube_ranges;
mod sheet;
mod tissue;
mod trilinear;

pub use blade::{Blade, Piece, Sweep};

pub(crate) use crossing::{Crossing, crossings};
pub use sheet::CutSheet;
pub(crate) use sheet::SheetRecorder;
pub(crate) use tissue::{Displaced, Tissue, displaced};
