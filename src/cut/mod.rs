//! Cutting: the edge of a blade is swept along a path, and every spring the swept surface crosses is severed.
//!
//! Springs are tested where they are now, not where they were at rest. The swept surface of a step is kept as flat
//! parallelograms, one for each piece of the edge and of the path, so a blade that crosses many pitches in one step misses
//! nothing; it also reaches a little behind the edge, so that tissue moving towards the blade cannot slip past it between
//! two steps.

mod blade;
mod crossing;

pub use blade::{Blade, Sweep};
pub use crossing::{Crossing, crossings};
