//! CT volumes and label maps: values on a grid in patient space.
//!
//! Crop, sample, resample and measure. Nothing here opens a file, and nothing changes a volume in place. Every operation is
//! one pass over the voxels, on all threads, with the same bits at any thread count.

mod bounds;
mod resample;
mod same_grid;
mod sample;
mod statistics;

pub use bounds::{VoxelBox, margin_in_voxels};
pub use resample::{ResampleError, grid_with_spacing, label_fraction, label_shares, resample_ct, resample_labels};
pub use same_grid::{GridMismatch, Overlay, SAME_GRID_TOLERANCE, check_same_grid};
pub use statistics::{LabelSummary, Statistics};

use ndarray::Array3;

use crate::geometry::{Grid, GridShape};

/// Values on a regular grid.
///
/// The array has shape `[nz, ny, nx]` in standard (C) order, so x runs fastest and `values.as_slice()` follows
/// [`GridShape::linear`].
#[derive(Debug, Clone, PartialEq)]
pub struct Volume<T> {
    grid: Grid,
    values: Array3<T>,
}

/// A CT image: HU, or whatever unit the file holds.
pub type CtVolume = Volume<f32>;
/// A label map: 0 is background, every other number one organ.
pub type LabelVolume = Volume<u16>;

impl<T: Clone> Volume<T> {
    /// A volume from values in the order of [`GridShape::linear`].
    ///
    /// # Panics
    /// If the number of values is not the number of grid points (readers check before they call).
    pub fn from_vec(grid: Grid, values: Vec<T>) -> Self {
        let GridShape { nx, ny, nz } = grid.shape;
        let values = Array3::from_shape_vec((nz, ny, nx), values).expect("one value per grid point");
        Self { grid, values }
    }

    /// The grid the values sit on.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Number of voxels along each axis.
    pub fn shape(&self) -> GridShape {
        self.grid.shape
    }

    /// The values, shape `[nz, ny, nx]`.
    pub fn values(&self) -> &Array3<T> {
        &self.values
    }

    /// The values in the order of [`GridShape::linear`], x fastest.
    ///
    /// # Panics
    /// Never: the array is kept in standard order.
    pub fn as_slice(&self) -> &[T] {
        self.values.as_slice().expect("standard order")
    }
}
