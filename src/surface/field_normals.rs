//! Normals of a surface from the gradient of the field it was drawn from.
//!
//! ```text
//! grid point   central differences (one-sided at the border of the grid and beside NaN), of the field itself or smoothed
//! vertex       linear between the grid points around it: two of them on a grid edge
//! patient      inverse transpose of the grid's axes, turned outward, unit length
//! ```
//! Mean error on a ball, a torus and a gyroid with radii of 6 to 22 spacings: at most 0.2 degrees on distance fields, either way. With noise of
//! 3 % of the contrast of a border two spacings wide: 0.9 to 1.0 degrees smoothed, 3 from the field itself.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::SurfaceError;
use crate::geometry::{Affine, GridShape, Matrix3};

/// Which field a gradient is taken of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum GradientOf {
    /// The field as it is: for distances and other clean fields.
    #[default]
    Field,
    /// The field smoothed over five points along each axis: for noisy ones, such as HU. Only the points next to a vertex are smoothed.
    Smoothed,
}

/// Smoothing across an axis: (1, 2, 1) / 4 twice.
const SMOOTH: [f32; 5] = [0.0625, 0.25, 0.375, 0.25, 0.0625];

/// Slope along an axis: the central difference smoothed by (1, 2, 1) / 4.
const SLOPE: [f32; 5] = [-0.125, -0.25, 0.0, 0.25, 0.125];

/// A vertex this close to a grid point along an axis counts as on it, so that rounding of an index does not double the work.
const ON_GRID: f64 = 1e-4;

/// Unit outward normals (towards lower values, RAS+) at places given as fractional grid indices.
///
/// - `values`: shape `[nz, ny, nx]`, x fastest; above zero inside.
/// - `indices`: shape `[vertices, 3]`; a place beyond the grid looks straight away from it.
///
/// (0, 0, 0) where the field is flat or has no finite value. A carried surface multiplies by the cofactor of its
/// deformation gradient and normalizes again.
///
/// # Errors
/// If the number of values is not the number of grid points.
pub fn field_normals(
    shape: GridShape,
    affine: &Affine,
    values: &[f32],
    of: GradientOf,
    indices: &[[f64; 3]],
) -> Result<Vec<[f32; 3]>, SurfaceError> {
    if values.len() != shape.len() {
        return Err(SurfaceError::FieldLength { found: values.len(), expected: shape.len(), shape });
    }
    let gradient = FieldGradient::new(shape, affine, values, of);
    Ok(indices.par_iter().map(|&index| gradient.normal_at(index)).collect())
}

/// The gradient of a field and the way of its directions into patient space.
pub(crate) struct FieldGradient<'a> {
    shape: GridShape,
    values: &'a [f32],
    of: GradientOf,
    /// From a gradient per index to the direction of the outward normal: columns.
    outward: [[f32; 3]; 3],
    /// Grid axes in patient space, of any length.
    axes: [[f32; 3]; 3],
}

impl<'a> FieldGradient<'a> {
    /// One value per grid point.
    pub(crate) fn new(shape: GridShape, affine: &Affine, values: &'a [f32], of: GradientOf) -> Self {
        let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| affine.index_vector_of(axis));
        let inverse = Matrix3::from_columns(&[x, y, z]);
        // Scaled to about one: a normal has no length, and spacings of 1e-3 would square to little in f32.
        let outward = inverse.transpose() * -affine.determinant().abs().cbrt();
        let outward = [0, 1, 2].map(|column| [0, 1, 2].map(|row| outward[(row, column)] as f32));
        let linear = affine.linear() / affine.determinant().abs().cbrt();
        let axes = [0, 1, 2].map(|column| [0, 1, 2].map(|row| linear[(row, column)] as f32));
        Self { shape, values, of, outward, axes }
    }

    /// Unit outward normal at a fractional index.
    fn normal_at(&self, index: [f64; 3]) -> [f32; 3] {
        let dims = self.shape.dims();
        let mut away = [0.0_f32; 3];
        let (mut low, mut share) = ([0; 3], [0.0_f32; 3]);
        for axis in 0..3 {
            let last = dims[axis] as f64 - 1.0;
            if index[axis].is_nan() {
                return [0.0; 3];
            }
            if index[axis] < -ON_GRID || index[axis] > last + ON_GRID {
                away[axis] = if index[axis] < 0.0 { 1.0 } else { -1.0 };
                continue;
            }
            let floor = (index[axis] + ON_GRID).floor().clamp(0.0, last);
            let rest = index[axis] - floor;
            low[axis] = floor as usize;
            share[axis] = if rest > ON_GRID && floor < last { rest as f32 } else { 0.0 };
        }
        if away != [0.0; 3] {
            return self.outward(away);
        }
        let mut sum = Weighted::default();
        for corner in 0..8_usize {
            let upper = [corner & 1, corner >> 1 & 1, corner >> 2];
            let weight: f32 = (0..3).map(|a| if upper[a] == 1 { share[a] } else { 1.0 - share[a] }).product();
            if weight > 0.0 {
                sum.add(weight, self.at_point([0, 1, 2].map(|axis| low[axis] + upper[axis])));
            }
        }
        self.outward(sum.0)
    }

    /// Unit outward normal on the edge from a grid point along an axis, `share` of the way.
    #[inline]
    pub(crate) fn normal_on_edge(&self, low: [usize; 3], axis: usize, share: f32) -> [f32; 3] {
        let mut high = low;
        high[axis] += 1;
        let mut sum = Weighted::default();
        sum.add(1.0 - share, self.at_point(low));
        sum.add(share, self.at_point(high));
        self.outward(sum.0)
    }

    /// Unit outward normal beyond the border of the grid.
    pub(crate) fn normal_beyond(&self, axis: usize, above: bool) -> [f32; 3] {
        let mut gradient = [0.0; 3];
        gradient[axis] = if above { -1.0 } else { 1.0 };
        self.outward(gradient)
    }

    /// Sign of the way an outward normal goes along a grid axis: that of its product with the axis.
    #[inline]
    pub(crate) fn along(&self, normal: [f32; 3], axis: usize) -> f32 {
        let [x, y, z] = self.axes[axis];
        normal[0] * x + normal[1] * y + normal[2] * z
    }

    #[inline]
    fn outward(&self, gradient: [f32; 3]) -> [f32; 3] {
        let [a, b, c] = &self.outward;
        let [x, y, z] = gradient;
        let normal = [0, 1, 2].map(|row| a[row] * x + b[row] * y + c[row] * z);
        let square = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2];
        if square.is_normal() {
            let length = square.sqrt();
            return normal.map(|c| c / length);
        }
        // In f64: squares of very small and very large gradients leave the range of f32.
        let length = normal.iter().map(|&c| f64::from(c).powi(2)).sum::<f64>().sqrt();
        if length > 0.0 && length.is_finite() { normal.map(|c| (f64::from(c) / length) as f32) } else { [0.0; 3] }
    }

    /// Gradient per index at a grid point.
    #[inline]
    fn at_point(&self, ijk: [usize; 3]) -> [f32; 3] {
        match self.of {
            GradientOf::Field => self.plain(ijk),
            GradientOf::Smoothed => self.smoothed(ijk),
        }
    }

    #[inline]
    fn plain(&self, [i, j, k]: [usize; 3]) -> [f32; 3] {
        let GridShape { nx, ny, nz } = self.shape;
        let (row, layer) = (nx, nx * ny);
        let inner = i.wrapping_sub(1) < nx.saturating_sub(2)
            && j.wrapping_sub(1) < ny.saturating_sub(2)
            && k.wrapping_sub(1) < nz.saturating_sub(2);
        if inner {
            let at = (k * ny + j) * nx + i;
            // One slice from the first to the last value used: one check of its length instead of six.
            let window = &self.values[at - layer..=at + layer];
            let gradient = [
                0.5 * (window[layer + 1] - window[layer - 1]),
                0.5 * (window[layer + row] - window[layer - row]),
                0.5 * (window[2 * layer] - window[0]),
            ];
            if gradient.iter().all(|c| c.is_finite()) {
                return gradient;
            }
        }
        self.one_sided([i, j, k])
    }

    /// Differences over the finite values around a grid point, whichever there are; 0 along an axis without.
    #[cold]
    fn one_sided(&self, ijk: [usize; 3]) -> [f32; 3] {
        let here = self.values[self.shape.linear(ijk)];
        [0, 1, 2].map(|axis| {
            let mut step = [0; 3];
            let mut value = |by: i32| {
                step[axis] = by;
                let value = self.shape.neighbour(ijk, step).map(|at| self.values[at]);
                value.filter(|value| value.is_finite())
            };
            let difference = match (value(-1), value(1)) {
                (Some(below), Some(above)) => 0.5 * above - 0.5 * below,
                (Some(below), None) => here - below,
                (None, Some(above)) => above - here,
                (None, None) => 0.0,
            };
            if difference.is_finite() { difference } else { 0.0 }
        })
    }

    /// Slope along each axis of the field smoothed across it.
    fn smoothed(&self, ijk: [usize; 3]) -> [f32; 3] {
        let dims = self.shape.dims();
        let inner = (0..3).all(|axis| ijk[axis] >= 2 && ijk[axis] + 2 < dims[axis]);
        let mut gradient = [0.0_f32; 3];
        for dz in 0..5 {
            for dy in 0..5 {
                let line = if inner {
                    let from = self.shape.linear([ijk[0] - 2, ijk[1] + dy - 2, ijk[2] + dz - 2]);
                    [0, 1, 2, 3, 4].map(|dx| self.values[from..from + 5][dx])
                } else {
                    [0, 1, 2, 3, 4].map(|dx| self.beyond([0, 1, 2].map(|a| (ijk[a] + [dx, dy, dz][a]) as i64 - 2)))
                };
                let weighed = |weights: [f32; 5]| -> f32 { (0..5).map(|dx| weights[dx] * line[dx]).sum() };
                let smooth = weighed(SMOOTH);
                gradient[0] += SMOOTH[dy] * SMOOTH[dz] * weighed(SLOPE);
                gradient[1] += SLOPE[dy] * SMOOTH[dz] * smooth;
                gradient[2] += SMOOTH[dy] * SLOPE[dz] * smooth;
            }
        }
        if gradient.iter().all(|c| c.is_finite()) { gradient } else { self.plain(ijk) }
    }

    /// The value at an index that may lie beyond the grid: carried on straight from the values on this side.
    fn beyond(&self, ijk: [i64; 3]) -> f32 {
        for axis in 0..3 {
            let last = self.shape.dims()[axis] as i64 - 1;
            let border = ijk[axis].clamp(0, last);
            if border != ijk[axis] {
                let (mut on, mut mirrored) = (ijk, ijk);
                on[axis] = border;
                mirrored[axis] = (2 * border - ijk[axis]).clamp(0, last);
                return 2.0 * self.beyond(on) - self.beyond(mirrored);
            }
        }
        self.values[self.shape.linear(ijk.map(|i| i as usize))]
    }
}

/// A sum of gradients.
#[derive(Default)]
struct Weighted([f32; 3]);

impl Weighted {
    #[inline]
    fn add(&mut self, weight: f32, gradient: [f32; 3]) {
        for axis in 0..3 {
            self.0[axis] += weight * gradient[axis];
        }
    }
}
