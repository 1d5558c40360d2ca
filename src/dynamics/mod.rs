//! The moving lattice: state, steps, what holds and drives it, and what can be measured of it.
//!
//! [`World`] owns the state and advances it; [`stable_dt`] says how far it may go at once near
//! rest and [`step_control`] divides the step when that is too far; [`timeline`] applies a scene's
//! operations as their time comes; [`effects`] holds what else acts, one file each (contact, contact of tissue with itself,
//! drag, fibres, pressure, relaxation, plasticity, tearing) and what lets blocks sleep; [`integrator`] the other ways to go on in time; [`measure`] judges energy,
//! momentum and volume in f64; [`reference_world`] is the
//! same world in plain f64, for judging the fast one.

mod alternation;
mod bone_pieces;
mod divergence;
mod drive;
pub mod effects;
pub mod integrator;
pub mod measure;
mod parting;
pub mod reference_world;
mod rigid;
mod slot_constants;
mod springs;
pub mod stable_dt;
mod step;
pub mod step_control;
mod step_error;
pub mod timeline;
mod volume;
mod workers;
mod world;

pub use drive::Handle;
pub use effects::pressure::{Face, boundary_faces, lip_faces};
pub use rigid::RigidBody;
pub use step_error::StepError;
pub use world::{Moment, World};
