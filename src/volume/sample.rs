//! Values between voxels.
//!
//! A volume fills the boxes of its voxels, half a voxel beyond the outermost centres. Between centres a CT is trilinear; in
//! the outer half voxel it keeps the value of the border. Beyond, there is nothing, and the caller says what that is worth.

use super::{CtVolume, LabelVolume};
use crate::geometry::{GridShape, Point3};

/// True inside the boxes of the voxels: every index from -0.5 to n - 0.5. NaN is outside.
pub(super) fn is_inside(shape: GridShape, index: Point3) -> bool {
    index.iter().zip(shape.dims()).all(|(x, n)| *x >= -0.5 && *x <= n as f64 - 0.5)
}

impl CtVolume {
    /// Trilinear value at a place, RAS+ [mm]; `outside` beyond the volume.
    pub fn sample(&self, place: Point3, outside: f32) -> f32 {
        self.sample_index(self.grid().affine.index_of(place), outside)
    }

    /// Trilinear value at a fractional voxel index; `outside` beyond the volume (and at NaN).
    ///
    /// At voxel centres the value is exact; between them the arithmetic is f64, rounded once.
    pub fn sample_index(&self, index: Point3, outside: f32) -> f32 {
        let shape = self.shape();
        if !is_inside(shape, index) {
            return outside;
        }
        let dims = shape.dims();
        let (mut low, mut high, mut t) = ([0; 3], [0; 3], [0.0; 3]);
        for axis in 0..3 {
            let clamped = index[axis].clamp(0.0, (dims[axis] - 1) as f64);
            low[axis] = clamped as usize;
            high[axis] = (low[axis] + 1).min(dims[axis] - 1);
            t[axis] = clamped - low[axis] as f64;
        }
        let values = self.as_slice();
        let at = |i: usize, j: usize, k: usize| f64::from(values[shape.linear([i, j, k])]);
        let mix = |a: f64, b: f64, t: f64| a * (1.0 - t) + b * t;
        let row = |j: usize, k: usize| mix(at(low[0], j, k), at(high[0], j, k), t[0]);
        let plane = |k: usize| mix(row(low[1], k), row(high[1], k), t[1]);
        mix(plane(low[2]), plane(high[2]), t[2]) as f32
    }

    /// Value at a place, RAS+ [mm], by cubic convolution: continuous to its first derivative, so that a surface drawn from
    /// it has no facets of the voxels' size. Exact at voxel centres and for polynomials of second order, but held between the least and the
    /// greatest of the eight voxels around, so that no value appears that no voxel has. `outside` beyond the volume (and at NaN).
    ///
    /// # Source
    /// Keys, Cubic convolution interpolation for digital image processing, 1981, with a = -1/2.
    pub fn sample_cubic(&self, place: Point3, outside: f32) -> f32 {
        let shape = self.shape();
        let index = self.grid().affine.index_of(place);
        if !is_inside(shape, index) {
            return outside;
        }
        let dims = shape.dims();
        let (mut at, mut weights) = ([[0; 4]; 3], [[0.0; 4]; 3]);
        for axis in 0..3 {
            let clamped = index[axis].clamp(0.0, (dims[axis] - 1) as f64);
            let low = clamped.floor();
            weights[axis] = cubic_weights(clamped - low);
            at[axis] = [-1.0, 0.0, 1.0, 2.0].map(|step| (low + step).clamp(0.0, (dims[axis] - 1) as f64) as usize);
        }
        let values = self.as_slice();
        let value = |i: usize, j: usize, k: usize| f64::from(values[shape.linear([at[0][i], at[1][j], at[2][k]])]);
        let (mut sum, mut least, mut greatest) = (0.0, f64::MAX, f64::MIN);
        for k in 0..4 {
            for j in 0..4 {
                let row: f64 = (0..4).map(|i| weights[0][i] * value(i, j, k)).sum();
                sum += weights[1][j] * weights[2][k] * row;
                if [1, 2].contains(&j) && [1, 2].contains(&k) {
                    least = least.min(value(1, j, k)).min(value(2, j, k));
                    greatest = greatest.max(value(1, j, k)).max(value(2, j, k));
                }
            }
        }
        sum.max(least).min(greatest) as f32
    }
}

/// Weights of the four samples around a place `t` of the way from the second to the third.
fn cubic_weights(t: f64) -> [f64; 4] {
    [
        -0.5 * t + t * t - 0.5 * t * t * t,
        1.0 - 2.5 * t * t + 1.5 * t * t * t,
        0.5 * t + 2.0 * t * t - 1.5 * t * t * t,
        -0.5 * t * t + 0.5 * t * t * t,
    ]
}

impl LabelVolume {
    /// Label of the voxel that holds a place, RAS+ [mm]; `outside` beyond the volume.
    pub fn label_at(&self, place: Point3, outside: u16) -> u16 {
        self.label_at_index(self.grid().affine.index_of(place), outside)
    }

    /// Label of the voxel nearest to a fractional index (upwards on a tie); `outside` beyond the volume (and at NaN).
    pub fn label_at_index(&self, index: Point3, outside: u16) -> u16 {
        let shape = self.shape();
        if !is_inside(shape, index) {
            return outside;
        }
        let dims = shape.dims();
        let nearest = std::array::from_fn(|axis| ((index[axis] + 0.5) as usize).min(dims[axis] - 1));
        self.as_slice()[shape.linear(nearest)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Affine, Grid, Matrix3, Vector3};

    const OUTSIDE: f32 = -1024.0;

    /// A value that is linear in patient space, on an oblique left-handed grid.
    fn ramp() -> (CtVolume, impl Fn(Point3) -> f64) {
        let turn = nalgebra::Rotation3::from_euler_angles(0.3, -0.2, 0.5).into_inner();
        let linear = turn * Matrix3::from_diagonal(&Vector3::new(-1.0, 2.0, 3.0));
        let grid = Grid {
            shape: GridShape::new(4, 5, 6),
            affine: Affine::from_parts(linear, Vector3::new(5.0, 6.0, 7.0)).unwrap(),
        };
        let value = |p: Point3| 3.0 * p.x - 2.0 * p.y + 0.5 * p.z + 40.0;
        let values = (0..grid.shape.len()).map(|n| value(grid.place(n)) as f32).collect();
        (CtVolume::from_vec(grid, values), value)
    }

    #[test]
    fn cubic_convolution_is_exact_for_parabolas_and_at_centres() {
        let affine = Affine::from_spacing([2.0, 1.0, 0.5], [1.0, 2.0, 3.0]).unwrap();
        let grid = Grid { shape: GridShape::new(7, 8, 9), affine };
        let value = |p: Point3| 0.3 * p.x * p.x - p.y * p.y + 2.0 * p.z * p.x + p.z * p.z - 4.0;
        let volume = CtVolume::from_vec(grid, (0..grid.shape.len()).map(|n| value(grid.place(n)) as f32).collect());
        for index in [[2.0, 3.0, 4.0], [2.25, 3.5, 4.9], [1.01, 1.99, 6.5]] {
            let place = grid.affine.apply(Point3::from(index));
            assert!((f64::from(volume.sample_cubic(place, OUTSIDE)) - value(place)).abs() < 2e-4, "{index:?}");
        }
        assert_eq!(volume.sample_cubic(Point3::new(f64::NAN, 0.0, 0.0), OUTSIDE), OUTSIDE);
    }

    #[test]
    fn a_linear_field_is_reproduced_between_centres() {
        let (volume, value) = ramp();
        for index in [[0.0, 0.0, 0.0], [3.0, 4.0, 5.0], [1.25, 3.5, 0.1], [2.999, 0.001, 4.5]] {
            let place = volume.grid().affine.apply(Point3::from(index));
            let found = f64::from(volume.sample(place, OUTSIDE));
            assert!((found - value(place)).abs() < 1e-4, "{index:?}: {found} is not {}", value(place));
        }
    }

    #[test]
    fn the_border_voxel_reaches_half_a_voxel_out() {
        let (volume, _) = ramp();
        let corner = volume.as_slice()[0];
        assert_eq!(volume.sample_index(Point3::new(-0.5, -0.25, -0.5), OUTSIDE), corner);
        assert_eq!(volume.sample_index(Point3::new(-0.51, 0.0, 0.0), OUTSIDE), OUTSIDE);
        assert_eq!(volume.sample_index(Point3::new(0.0, 4.51, 0.0), OUTSIDE), OUTSIDE);
        assert_eq!(volume.sample_index(Point3::new(0.0, f64::NAN, 0.0), OUTSIDE), OUTSIDE);
        assert_eq!(volume.sample_index(Point3::new(3.5, 4.5, 5.5), OUTSIDE), *volume.as_slice().last().unwrap());
    }

    #[test]
    fn labels_come_from_the_nearest_voxel() {
        let shape = GridShape::new(3, 2, 1);
        let grid = Grid { shape, affine: Affine::from_spacing([2.0, 2.0, 5.0], [0.0; 3]).unwrap() };
        let labels = LabelVolume::from_vec(grid, vec![1, 2, 3, 4, 5, 6]);
        assert_eq!(labels.label_at(Point3::new(0.9, 0.0, 0.0), 0), 1);
        assert_eq!(labels.label_at(Point3::new(1.0, 0.0, 2.5), 0), 2);
        assert_eq!(labels.label_at(Point3::new(5.0, 3.0, -2.5), 0), 6);
        assert_eq!(labels.label_at(Point3::new(5.1, 3.0, 0.0), 0), 0);
        assert_eq!(labels.label_at_index(Point3::new(f64::NAN, 0.0, 0.0), 7), 7);
    }
}
