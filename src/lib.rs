//! yawara: from a CT volume to a soft organ that can be pushed, pulled and cut, and to surfaces worth looking at.

pub mod cli;
pub mod cut;
pub mod dynamics;
pub mod geometry;
pub mod io;
pub mod kernel;
pub mod lattice;
pub mod material;
pub mod phantom;
pub mod plot;
pub mod run;
pub mod scene;
pub mod slice;
pub mod store;
pub mod surface;
pub mod volume;
