//! The surface of a plain field, without a lattice.
//!
//! A crossing lies at the zero of a parabola through both ends of its edge whose second difference is the smaller one of
//! those at the ends, or none when they disagree. A distance field of radius R (in spacings) is met within 0.07 / R^2 instead of the
//! 1 / (8 R) of linear interpolation, and borders that ramp from one value to another are not bent by the ends of the ramp.
//!
//! # Source
//! Min and Gibou, A second order accurate level set method on non-graded adaptive Cartesian grids, 2007, section 4 (minmod of
//! the second differences at an interface).

use rayon::prelude::*;

use super::Triangles;
use super::bits::InsideBits;
use super::sweep::{self, LayeredTriangles, Numbering, split_layers};
use crate::geometry::{Affine, GridShape};
use crate::surface::SurfaceError;
use crate::surface::field_normals::FieldGradient;
use crate::surface::mesh::TriangleMesh;
use crate::surface::normals::{Layers, Sheet, vertex_normals};
use crate::surface::seam::Seam;

/// Crossings keep this share of their edge from both its ends: less than the accuracy asked of them, and hundreds of times
/// the rounding of f32 at the far end of a large grid.
const CLEARANCE: f32 = 0.001;

/// The surface of a field before its vertices have places.
struct PlainSurface {
    bits: InsideBits,
    numbering: Numbering,
    drawn: LayeredTriangles,
}

impl PlainSurface {
    fn new(shape: GridShape, values: &[f32], flip: bool) -> Result<Self, SurfaceError> {
        let seam = Seam::none();
        let bits = InsideBits::new(shape, values, None);
        let numbering = Numbering::new(&bits, &seam)?;
        let drawn = sweep::triangles(&bits, &seam, &numbering, flip)?;
        Ok(Self { bits, numbering, drawn })
    }
}

/// Closed mesh with normals; the number of values is that of grid points.
pub(super) fn mesh(
    shape: GridShape,
    affine: &Affine,
    values: &[f32],
    gradient: &FieldGradient<'_>,
) -> Result<TriangleMesh, SurfaceError> {
    let surface = PlainSurface::new(shape, values, affine.determinant() < 0.0)?;
    let PlainSurface { bits, numbering, drawn } = surface;
    let count = numbering.vertex_count();
    let (mut positions, mut normals) = (vec![[0.0; 3]; count], vec![[0.0; 3]; count]);
    let parts = split_layers(&mut positions, &numbering.layers).into_par_iter();
    let edges = Edges { shape, values, bits: &bits, gradient };
    let (axes, origin) = (affine.linear(), affine.origin().coords);
    // Places without a normal: where the field is flat, or its gradient does not point out of the tissue.
    let unset: usize = parts
        .zip(split_layers(&mut normals, &numbering.layers))
        .enumerate()
        .map(|(k, (positions, normals))| {
            let (mut slots, mut unset) = (positions.iter_mut().zip(normals), 0);
            sweep::each_crossing(&bits, k, |low, axis| {
                let Some((position, normal)) = slots.next() else { return };
                let (upper, toward) = edges.vertex(low, axis);
                let mut index = low.map(|i| i as f64 - 1.0);
                index[axis] += f64::from(upper);
                let place = axes * nalgebra::Vector3::from(index) + origin;
                *position = [place.x as f32, place.y as f32, place.z as f32];
                *normal = toward;
                unset += usize::from(toward == [0.0; 3]);
            });
            unset
        })
        .sum();
    let triangles = drawn.triangles;
    if unset > 0 {
        let layers = Layers { vertices: &numbering.layers, triangles: &drawn.layers, turned: &[] };
        let around = vertex_normals(&positions, &triangles, layers, |_| Sheet::Skin);
        normals.par_iter_mut().zip(around).filter(|(normal, _)| **normal == [0.0; 3]).for_each(|(n, a)| *n = a);
    }
    Ok(TriangleMesh { positions, triangles, normals, ..TriangleMesh::default() })
}

/// The surface of a field in the indices of its grid, without normals, placed as on a lattice.
pub(crate) fn surface_in_cells(shape: GridShape, values: &[f32]) -> Result<Triangles, SurfaceError> {
    let PlainSurface { bits, numbering, drawn } = PlainSurface::new(shape, values, false)?;
    let positions = sweep::crossing_values(&bits, values, &numbering, |crossing| {
        let mut index = crossing.low.map(|i| i as f64 - 1.0);
        let t = f64::from(crossing.t);
        index[crossing.axis] += if crossing.upward { t } else { 1.0 - t };
        index.map(|i| i as f32)
    });
    Ok((positions, drawn.triangles))
}

/// Makes the vertices of a plain field.
struct Edges<'a> {
    shape: GridShape,
    values: &'a [f32],
    bits: &'a InsideBits,
    gradient: &'a FieldGradient<'a>,
}

impl Edges<'_> {
    /// Share of the way from the lower end of an edge (padded indices), and unit outward normal or zero.
    #[inline]
    fn vertex(&self, padded: [usize; 3], axis: usize) -> (f32, [f32; 3]) {
        let dims = self.shape.dims();
        if padded[axis] == 0 || padded[axis] == dims[axis] {
            // One end lies beyond the grid: the surface is capped half-way.
            return (0.5, self.gradient.normal_beyond(axis, padded[axis] != 0));
        }
        let low = padded.map(|i| i - 1);
        let stride = [1, dims[0], dims[0] * dims[1]][axis];
        let at = self.shape.linear(low);
        let (lower, upper) = (self.values[at], self.values[at + stride]);
        let before = if low[axis] > 0 { self.values[at - stride] } else { f32::NAN };
        let after = if low[axis] + 2 < dims[axis] { self.values[at + 2 * stride] } else { f32::NAN };
        let upward = self.bits.get(padded);
        let share =
            if upward { crossing(before, lower, upper, after) } else { 1.0 - crossing(after, upper, lower, before) };
        let normal = self.gradient.normal_on_edge(low, axis, share);
        let along = self.gradient.along(normal, axis);
        (share, if (along > 0.0) == upward { normal } else { [0.0; 3] })
    }
}

/// Share of the way from the inside end to the outside one; `behind` and `ahead` lie one step beyond each.
#[inline]
fn crossing(behind: f32, inside: f32, outside: f32, ahead: f32) -> f32 {
    let (one, two) = (outside - 2.0 * inside + behind, ahead - 2.0 * outside + inside);
    // False for NaN: then the way between both ends is straight.
    let bend = if one * two > 0.0 { if one.abs() < two.abs() { one } else { two } } else { 0.0 };
    // inside + slope t + square t^2, which falls from above zero to at most zero: its one root in 0..=1, without cancellation.
    let square = 0.5 * bend;
    let slope = outside - inside - square;
    let root = (slope * slope - 4.0 * square * inside).sqrt();
    // The straight one on its own: it needs no squares, which leave the range of f32 early.
    let t = if bend == 0.0 { inside / (inside - outside) } else { 2.0 * inside / (root - slope) };
    if t.is_finite() { t.clamp(CLEARANCE, 1.0 - CLEARANCE) } else { 0.5 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crossings_are_roots_of_what_the_field_does() {
        let on = |f: fn(f32) -> f32| crossing(f(-1.0), f(0.0), f(1.0), f(2.0));
        assert_eq!(on(|t| 0.25 - t), 0.25);
        // A parabola is met exactly, also where linear interpolation is a tenth off.
        assert!((on(|t| (0.6 - t) * (1.5 + t)) - 0.6).abs() < 1e-6);
        assert!((on(|t| (0.6 - t) * (3.5 - t)) - 0.6).abs() < 1e-6);
        // The ends of a ramp do not bend it.
        assert!((on(|t| (0.4 - t).clamp(-1.0, 1.0)) - 0.4).abs() < 1e-6);
    }

    #[test]
    fn crossings_keep_clear_of_grid_points_whatever_the_values() {
        let values = [0.0, -0.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e-38, -1e-38, 1.0, -1.0, 3e38, -3e38];
        for inside in values.into_iter().filter(|value| *value > 0.0) {
            for outside in values.into_iter().filter(|value| value.is_nan() || *value <= 0.0) {
                for behind in values {
                    for ahead in values {
                        let t = crossing(behind, inside, outside, ahead);
                        assert!((CLEARANCE..=1.0 - CLEARANCE).contains(&t), "{behind} {inside} {outside} {ahead}: {t}");
                    }
                }
            }
        }
    }
}
