//! The hot loops: numbers and slices only, no files, no scene, no allocation.
//!
//! [`halo`] copies a block and one layer around it into a small buffer; [`block`] is the fast body over that buffer: every
//! spring of the block once, in an order that depends neither on the number of threads nor on the number of lanes. [`laws`]
//! gives it the constants of springs, `spring` the force of one, [`simd`] the registers of each instruction set, and
//! [`dispatch`] compiles all for several sets and picks one at run time. [`volume`] and [`fibres`] are the forces of the
//! cells, [`inner_length`] what springs do beyond elasticity. [`reference`] says what is computed, plainly and in f64, from
//! constants that [`reference_table`] looks up. [`linear`] and [`tangent`] are relatives for the stable step: the stiffness matrix at rest times a vector, and a bound on the tangent stiffness as the lattice stands now;
//! [`parting`] tells where that may have changed, and [`alternation`] whether motion looks like that of an unstable step.
//! [`precise`] has the springs in f64, with their tangent. [`rows`] holds what they share.

pub mod alternation;
pub mod block;
pub mod dispatch;
pub mod fibres;
pub mod halo;
pub mod inner_length;
pub mod laws;
pub mod linear;
pub mod parting;
pub mod precise;
pub mod reference;
pub mod reference_table;
pub mod rows;
pub mod simd;
mod spring;
pub mod tangent;
pub mod volume;
