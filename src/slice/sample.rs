//! Values of a volume between its voxels.

use crate::geometry::Point3;
use crate::volume::{CtVolume, LabelVolume};

/// The trilinear value at a place, RAS+ [mm]; `None` outside the voxels.
///
/// Between the middle of a border voxel and its border, the border's value holds.
pub(super) fn trilinear(volume: &CtVolume, place: Point3) -> Option<f32> {
    let shape = volume.shape();
    let index = volume.grid().affine.index_of(place);
    let (mut low, mut share) = ([0; 3], [0.0; 3]);
    for (axis, count) in shape.dims().into_iter().enumerate() {
        inside(index[axis], count)?;
        let at = index[axis].clamp(0.0, (count - 1) as f64);
        low[axis] = (at as usize).min(count.saturating_sub(2));
        share[axis] = at - low[axis] as f64;
    }
    let values = volume.as_slice();
    let mut sum = 0.0;
    for corner in 0..8 {
        let (mut at, mut weight) = (low, 1.0);
        for axis in 0..3 {
            if corner >> axis & 1 == 1 {
                at[axis] += 1;
                weight *= share[axis];
            } else {
                weight *= 1.0 - share[axis];
            }
        }
        // A volume one voxel thick has no second voxel, and gives it no weight.
        if weight > 0.0 {
            sum += weight * f64::from(values[shape.linear(at)]);
        }
    }
    Some(sum as f32)
}

/// The label of the voxel a place lies in, RAS+ [mm]; `None` outside the voxels.
pub(super) fn nearest(volume: &LabelVolume, place: Point3) -> Option<u16> {
    let shape = volume.shape();
    let index = volume.grid().affine.index_of(place);
    let mut at = [0; 3];
    for (axis, count) in shape.dims().into_iter().enumerate() {
        inside(index[axis], count)?;
        at[axis] = ((index[axis] + 0.5).max(0.0) as usize).min(count - 1);
    }
    Some(volume.as_slice()[shape.linear(at)])
}

fn inside(index: f64, count: usize) -> Option<()> {
    // A hair of slack: pixels on the border itself belong to the volume.
    (index >= -0.5 - 1e-9 && index <= count as f64 - 0.5 + 1e-9).then_some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Affine, Grid, GridShape, Matrix3, Vector3};

    fn oblique(shape: GridShape) -> Grid {
        let turn: Matrix3 = nalgebra::Rotation3::from_euler_angles(0.3, -0.2, 0.5).into_inner();
        let linear = turn * Matrix3::from_diagonal(&Vector3::new(-1.5, 0.7, 2.0));
        Grid { shape, affine: Affine::from_parts(linear, Vector3::new(-40.0, 7.0, 11.0)).unwrap() }
    }

    #[test]
    fn a_linear_field_is_exact_on_an_oblique_left_handed_grid() {
        let grid = oblique(GridShape::new(6, 7, 5));
        let field = |p: Point3| 3.0 * p.x - 2.0 * p.y + 0.5 * p.z + 4.0;
        let values = (0..grid.shape.len()).map(|at| field(grid.place(at)) as f32).collect();
        let volume = CtVolume::from_vec(grid, values);
        for index in [[0.0, 0.0, 0.0], [2.3, 4.9, 1.2], [5.0, 6.0, 4.0], [4.999, 0.01, 3.5]] {
            let place = grid.affine.apply(Point3::from(index));
            let found = trilinear(&volume, place).unwrap();
            assert!((f64::from(found) - field(place)).abs() < 1e-4, "{index:?}");
        }
        assert_eq!(trilinear(&volume, grid.affine.apply(Point3::new(-0.6, 0.0, 0.0))), None);
        assert_eq!(trilinear(&volume, grid.affine.apply(Point3::new(0.0, 6.51, 0.0))), None);
        assert_eq!(trilinear(&volume, Point3::new(f64::NAN, 0.0, 0.0)), None);
    }

    #[test]
    fn thin_volumes_and_labels() {
        let grid = oblique(GridShape::new(3, 1, 2));
        let volume = CtVolume::from_vec(grid, vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let middle = grid.affine.apply(Point3::new(0.5, 0.2, 0.5));
        assert!((trilinear(&volume, middle).unwrap() - 3.0).abs() < 1e-6);
        let labels = LabelVolume::from_vec(grid, vec![1, 2, 3, 4, 5, 6]);
        let at = |i, k| nearest(&labels, grid.affine.apply(Point3::new(i, 0.0, k)));
        assert_eq!([at(0.4, 0.4), at(0.6, 0.4), at(2.4, 1.4), at(2.6, 0.0)], [Some(1), Some(2), Some(6), None]);
    }
}
