//! Boxes of voxels: where a selection lies, and the part of a volume inside a box.

use ndarray::s;
use rayon::prelude::*;

use super::Volume;
use crate::geometry::{Grid, GridShape, Vector3};

/// A box of voxels, from `min` to `max`, both included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VoxelBox {
    /// Lowest (i, j, k).
    pub min: [usize; 3],
    /// Highest (i, j, k).
    pub max: [usize; 3],
}

impl VoxelBox {
    /// Number of voxels along each axis.
    pub fn shape(&self) -> GridShape {
        let [nx, ny, nz] = std::array::from_fn(|axis| self.max[axis] - self.min[axis] + 1);
        GridShape::new(nx, ny, nz)
    }

    /// The box with `margin` more voxels on both sides of each axis, cut at the borders of a grid of this shape.
    pub fn grown(&self, margin: [usize; 3], within: GridShape) -> Self {
        let dims = within.dims();
        Self {
            min: std::array::from_fn(|axis| self.min[axis].saturating_sub(margin[axis])),
            max: std::array::from_fn(|axis| self.max[axis].saturating_add(margin[axis]).min(dims[axis] - 1)),
        }
    }

    /// For each axis, whether the box touches the low and the high border of a grid of this shape.
    pub fn touches(&self, border_of: GridShape) -> [[bool; 2]; 3] {
        let dims = border_of.dims();
        std::array::from_fn(|axis| [self.min[axis] == 0, self.max[axis] + 1 == dims[axis]])
    }

    /// The smallest box around both.
    pub fn union(&self, other: &Self) -> Self {
        Self {
            min: std::array::from_fn(|axis| self.min[axis].min(other.min[axis])),
            max: std::array::from_fn(|axis| self.max[axis].max(other.max[axis])),
        }
    }
}

/// Whole voxels that cover `margin` [mm] along each axis of a grid.
pub fn margin_in_voxels(grid: &Grid, margin: f64) -> [usize; 3] {
    // The cast saturates, and takes NaN and negative margins to 0.
    grid.affine.spacing().map(|spacing| (margin / spacing - 1e-9).ceil() as usize)
}

impl<T: Clone + Send + Sync> Volume<T> {
    /// The smallest box around the selected voxels, or `None` when none is selected.
    pub fn bounding_box(&self, selected: impl Fn(&T) -> bool + Sync) -> Option<VoxelBox> {
        let GridShape { nx, ny, .. } = self.shape();
        let slices = self.as_slice().par_chunks((nx * ny).max(1)).enumerate();
        let boxes = slices.filter_map(|(k, slice)| {
            let mut found: Option<VoxelBox> = None;
            for (j, row) in slice.chunks(nx).enumerate() {
                let Some(first) = row.iter().position(&selected) else { continue };
                let last = row.iter().rposition(&selected).unwrap_or(first);
                let run = VoxelBox { min: [first, j, k], max: [last, j, k] };
                found = Some(found.map_or(run, |found| found.union(&run)));
            }
            found
        });
        boxes.reduce_with(|a, b| a.union(&b))
    }

    /// The voxels inside a box; they keep their places in patient space.
    ///
    /// # Panics
    /// If the box reaches beyond the volume or is inside out (boxes of this volume, grown within its shape, never do).
    pub fn crop(&self, part: &VoxelBox) -> Self {
        let (VoxelBox { min, max }, dims) = (part, self.shape().dims());
        for axis in 0..3 {
            assert!(min[axis] <= max[axis] && max[axis] < dims[axis], "{part:?} is no part of {}", self.shape());
        }
        let values = self.values().slice(s![min[2]..=max[2], min[1]..=max[1], min[0]..=max[0]]);
        let affine = self.grid().affine.shifted(Vector3::from(min.map(|index| index as f64)));
        Self::from_vec(Grid { shape: part.shape(), affine }, values.iter().cloned().collect())
    }

    /// The part of the volume inside a box, with `margin` more voxels on every side; beyond the border of the volume its outermost
    /// voxels are repeated.
    pub fn crop_repeating(&self, part: &VoxelBox, margin: usize) -> Self {
        let (dims, size) = (self.shape().dims(), part.shape().dims());
        let shape = GridShape::new(size[0] + 2 * margin, size[1] + 2 * margin, size[2] + 2 * margin);
        let nearest = |point: usize| {
            let ijk = shape.ijk(point);
            let at = |axis: usize| (part.min[axis] + ijk[axis]).saturating_sub(margin).min(dims[axis] - 1);
            self.as_slice()[self.shape().linear([at(0), at(1), at(2)])].clone()
        };
        let first = Vector3::from(part.min.map(|low| low as f64 - margin as f64));
        let grid = Grid { shape, affine: self.grid().affine.shifted(first) };
        Self::from_vec(grid, (0..shape.len()).into_par_iter().map(nearest).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Affine, Point3};
    use crate::volume::LabelVolume;

    fn volume() -> LabelVolume {
        let shape = GridShape::new(5, 6, 7);
        let affine = Affine::from_spacing([-1.0, 2.0, 3.0], [10.0, 20.0, 30.0]).unwrap();
        let mut values = vec![0; shape.len()];
        for ijk in [[1, 2, 3], [3, 2, 4], [2, 5, 3]] {
            values[shape.linear(ijk)] = 9;
        }
        LabelVolume::from_vec(Grid { shape, affine }, values)
    }

    #[test]
    fn the_box_is_tight_and_grows_within_the_volume() {
        let volume = volume();
        let found = volume.bounding_box(|label| *label == 9).unwrap();
        assert_eq!(found, VoxelBox { min: [1, 2, 3], max: [3, 5, 4] });
        assert_eq!(found.shape(), GridShape::new(3, 4, 2));
        assert_eq!(found.touches(volume.shape()), [[false, false], [false, true], [false, false]]);
        let grown = found.grown([1, 2, 9], volume.shape());
        assert_eq!(grown, VoxelBox { min: [0, 0, 0], max: [4, 5, 6] });
        assert_eq!(volume.bounding_box(|label| *label == 1), None);
    }

    #[test]
    fn a_crop_keeps_values_and_places() {
        let volume = volume();
        let part = VoxelBox { min: [1, 2, 3], max: [3, 5, 4] };
        let crop = volume.crop(&part);
        for (linear, value) in crop.as_slice().iter().enumerate() {
            let [i, j, k] = crop.shape().ijk(linear);
            let before = volume.shape().linear([i + 1, j + 2, k + 3]);
            assert_eq!(*value, volume.as_slice()[before]);
            assert!((crop.grid().place(linear) - volume.grid().place(before)).norm() < 1e-12);
        }
        assert_eq!(crop.grid().affine.origin(), Point3::new(9.0, 24.0, 39.0));
    }

    #[test]
    fn margins_round_up_to_whole_voxels() {
        let grid = *volume().grid();
        assert_eq!(margin_in_voxels(&grid, 4.0), [4, 2, 2]);
        assert_eq!(margin_in_voxels(&grid, 0.0), [0, 0, 0]);
        assert_eq!(margin_in_voxels(&grid, f64::NAN), [0, 0, 0]);
    }

    #[test]
    #[should_panic(expected = "is no part of 5x6x7")]
    fn a_crop_beyond_the_border_is_a_bug() {
        volume().crop(&VoxelBox { min: [0; 3], max: [5, 5, 5] });
    }
}
