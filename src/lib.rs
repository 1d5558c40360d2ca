//! yawara: from a CT volume to a soft organ that can be pushed, pulled and cut, and to surfaces worth looking at.

pub mod geometry;
pub mod io;
pub mod lattice;
pub mod plot;
pub mod scene;
pub mod slice;
pub mod surface;
pub mod volume;
