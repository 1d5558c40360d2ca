//! The hot loops: numbers and slices only, no files, no scene, no allocation.
//!
//! One particle gathers the forces of its 26 springs in the order of [`crate::lattice::neighbours::OFFSETS`], so the
//! result depends neither on the number of threads nor on the instruction set. [`reference`] says what is computed,
//! plainly and in f64; [`halo`] copies a block and one layer around it into a small buffer; [`volume`] and [`rows`] are
//! the fast bodies over that buffer, of the cells and of the springs, and [`fibres`] adds those of the cells; [`dispatch`] compiles them for several instruction
//! sets and picks one at run time. [`linear`] and [`tangent`] are their relatives for the stable step: the stiffness
//! matrix at rest times a vector, and a bound on the tangent stiffness as the lattice stands now; [`parting`] tells
//! where that may have changed, and [`alternation`] whether motion looks like that of an unstable step.

pub mod alternation;
pub mod block;
pub mod dispatch;
pub mod fibres;
pub mod halo;
pub mod laws;
pub mod linear;
pub mod parting;
pub mod reference;
pub mod rows;
pub mod simd;
mod spring;
pub mod tangent;
pub mod volume;
