//! Where the surface of an organ lies at rest, from the voxels of a label map and the CT under it.
//!
//! Plain functions over plain grids, with no lattice: [`from_mask`] draws a smooth surface from the voxels alone, and
//! [`from_grey`] draws it through the grey values wherever they tell the organ from what is around it. Both give a field,
//! above zero inside, for [`marching_cubes`](super::marching_cubes()).
//!
//! Everything is measured in voxels along each axis, since staircases are as high as the voxels they come from. So the spacing
//! does not enter, and a grid of any spacing will do.
//!
//! Smoothing is done on the field and not on the mesh, so the surface cannot pass through itself. That of a mask stays within the
//! grid edges between the organ's voxels and all others and keeps their topology; grey values may move it by one voxel more where
//! neither a part nor a gap is thin.

mod filter;
mod grey;
mod mask;
mod walls;

pub use grey::from_grey;
pub use mask::from_mask;

use crate::geometry::GridShape;

/// Voxels of an organ and of its neighbours; the voxel centres are the grid points, x fastest.
///
/// All that is beyond the grid counts as outside. Leave a margin of four voxels around the organ where the volume has it.
#[derive(Debug, Clone, Copy)]
pub struct Voxels<'a> {
    /// Voxels along each axis.
    pub shape: GridShape,
    /// Voxels of the organ.
    pub organ: &'a [bool],
    /// Voxels of other organs, which the surface never enters; empty where there are none.
    pub foreign: &'a [bool],
}

impl Voxels<'_> {
    /// # Panics
    /// If the slices do not fit the grid.
    fn check(&self) {
        assert_eq!(self.organ.len(), self.shape.len(), "one flag per voxel");
        assert!(self.foreign.is_empty() || self.foreign.len() == self.shape.len(), "one flag per voxel, or none");
    }
}

/// The six voxels that share a face with a voxel.
const AHEAD: [[i32; 3]; 6] = [[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]];

/// Smallest magnitude of a field: crossings then keep some hundredths of a voxel from the grid points. At 0.1, shallow
/// slopes bulge where they pass a grid point; at 0.005, triangles become slivers.
const FLOOR: f32 = 0.03;

/// Gives a value the sign of its side and at least the smallest magnitude; NaN becomes the smallest.
fn held(value: f32, inside: bool, floor: f32) -> f32 {
    if inside { value.max(floor) } else { value.min(-floor) }
}
