//! The whole way from a scene to frames, in three steps that can also be taken one by one.
//!
//! ```text
//! Scene ──► inputs::load ──► prepare::prepare ──► drive::drive ──► observer (frames, events)
//!            volumes           lattice, dt          steps
//! ```
//! [`drive`] hands every frame to an [`drive::Observer`]; the command line's writes them to a run directory. [`meshes`]
//! goes the other way: from stored frames back to surfaces.

pub mod drive;
pub mod inputs;
pub mod prepare;
