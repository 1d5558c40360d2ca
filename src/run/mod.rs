//! The whole way from a scene to frames, in three steps that can also be taken one by one.
//!
//! ```text
//! Scene ──► inputs::load ──► prepare::prepare ──► drive::drive ──► observer (frames, events)
//!            volumes           lattice, dt          steps
//! ```
//! [`drive`] hands every frame to an [`drive::Observer`]; [`record`] is one that keeps them in a run directory. [`meshes`]
//! goes on from there: from stored frames to surfaces.

pub mod bodies;
pub mod drive;
pub mod estimate;
pub mod inputs;
pub mod interfaces;
pub mod label_lookup;
mod materials;
pub mod meshes;
mod obstacle_forces;
pub(crate) mod organs;
pub mod paint;
pub mod prepare;
mod range;
pub mod record;
pub mod step_times;
pub mod thin_tools;
