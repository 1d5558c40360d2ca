//! Places: points in millimetres, grids of voxels or particles, and the affine maps between the two.
//!
//! Patient space is RAS+ in millimetres, as in NIfTI: x grows to the patient's right, y to the front, z to the head.
//! Grids count voxels from 0 at the *centre* of the first voxel, x fastest.

mod affine;
mod cell_map;
mod grid;

pub use affine::{Affine, AffineError};
pub(crate) use cell_map::{CellMap, CellSet};
pub use grid::{Grid, GridShape};

/// A point in patient space, RAS+ [mm], or in a frame named by the variable that holds it.
pub type Point3 = nalgebra::Point3<f64>;
/// A direction or displacement, in the same unit as the points it goes with.
pub type Vector3 = nalgebra::Vector3<f64>;
/// A 3 x 3 matrix.
pub type Matrix3 = nalgebra::Matrix3<f64>;
/// A 4 x 4 homogeneous matrix.
pub type Matrix4 = nalgebra::Matrix4<f64>;
