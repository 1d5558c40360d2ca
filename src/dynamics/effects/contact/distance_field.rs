//! Signed distances sampled on a cubic grid, linear between.

use crate::geometry::{GridShape, Vector3};

/// Signed distances at the points of a cubic grid with some empty points all round the body.
///
/// Between points they are trilinear. For a body with flat faces that is exact but near edges; on a surface of radius `R` the
/// error is at most `spacing^2 / (4 R)` (the second derivatives of a distance are the curvatures), and edges sharper than
/// the spacing are rounded by less than half of it.
#[derive(Debug, Clone)]
pub(super) struct DistanceField {
    /// Place of the first point [m].
    pub(super) origin: Vector3,
    /// Distance of neighbouring points [m].
    pub(super) spacing: f64,
    pub(super) shape: GridShape,
    /// Signed distance at each point [m], x fastest.
    pub(super) values: Vec<f32>,
    /// Axes and origin are those of the lattice and not of the patient.
    pub(super) in_lattice_axes: bool,
}

/// Where a place lies in the grid.
struct Spot {
    /// The lowest corner of its cell.
    corner: usize,
    /// Its coordinates in the cell, each 0 to 1.
    share: Vector3,
    /// From the nearest place of the grid to it [m].
    beyond: Vector3,
}

impl DistanceField {
    /// Samples change by at most the spacing from point to point, so each part of the gradient is at most 1.
    pub(super) const STEEPNESS: f64 = 1.733;

    /// Signed distance [m]. Beyond the grid a lower bound of it: the body lies within, and at least as far from the border as
    /// its samples say.
    pub(super) fn value(&self, place: Vector3) -> f64 {
        let spot = self.spot(place);
        let within = self.within(&spot);
        let beyond = spot.beyond.norm();
        if beyond > 0.0 { beyond.max(within - beyond) } else { within }
    }

    /// Gradient over one spacing along each axis; outward beyond the grid. That of the linear pieces would jump from cell to cell
    /// and favour one side of what lies on their border.
    pub(super) fn gradient(&self, place: Vector3) -> Vector3 {
        let beyond = self.spot(place).beyond;
        if beyond.norm_squared() > 0.0 {
            return beyond.normalize();
        }
        Vector3::from_fn(|axis, _| {
            let mut half = Vector3::zeros();
            half[axis] = 0.5 * self.spacing;
            (self.value(place + half) - self.value(place - half)) / self.spacing
        })
    }

    pub(super) fn bytes(&self) -> usize {
        4 * self.values.len()
    }

    fn within(&self, spot: &Spot) -> f64 {
        let v = self.corners(spot.corner);
        let [x, y, z]: [f64; 3] = spot.share.into();
        let mix = |low: f64, high: f64, share: f64| low + (high - low) * share;
        let face = |i: usize| mix(mix(v[i], v[i + 1], x), mix(v[i + 2], v[i + 3], x), y);
        mix(face(0), face(4), z)
    }

    /// Values at the corners of a cell, x fastest.
    fn corners(&self, corner: usize) -> [f64; 8] {
        let (row, layer) = (self.shape.nx, self.shape.nx * self.shape.ny);
        let at = |offset: usize| f64::from(self.values[corner + offset]);
        [at(0), at(1), at(row), at(row + 1), at(layer), at(layer + 1), at(layer + row), at(layer + row + 1)]
    }

    fn spot(&self, place: Vector3) -> Spot {
        let dims = self.shape.dims();
        let index = (place - self.origin) / self.spacing;
        let mut corner = [0; 3];
        let (mut share, mut beyond) = (Vector3::zeros(), Vector3::zeros());
        for axis in 0..3 {
            let last = (dims[axis] - 1) as f64;
            // NaN becomes the first point: what is not a number is found by the check of every step.
            let clamped = index[axis].clamp(0.0, last).max(0.0);
            let low = clamped.floor().min(last - 1.0);
            corner[axis] = low as usize;
            share[axis] = clamped - low;
            beyond[axis] = (index[axis] - clamped) * self.spacing;
        }
        Spot { corner: self.shape.linear(corner), share, beyond }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(value: impl Fn(Vector3) -> f64) -> DistanceField {
        let shape = GridShape::new(5, 4, 6);
        let (origin, spacing) = (Vector3::new(0.1, -0.2, 0.3), 0.5);
        let place = |i: usize| origin + Vector3::from(shape.ijk(i).map(|n| n as f64)) * spacing;
        let values = (0..shape.len()).map(|i| value(place(i)) as f32).collect();
        DistanceField { origin, spacing, shape, values, in_lattice_axes: false }
    }

    #[test]
    fn what_is_linear_is_exact() {
        let slope = Vector3::new(0.3, -0.5, 0.7);
        let field = field(|p| slope.dot(&p) + 2.0);
        for share in [[0.0; 3], [0.3, 0.9, 0.1], [1.0, 1.0, 1.0], [0.77, 0.5, 0.99]] {
            let p = field.origin + Vector3::new(share[0] * 2.0, share[1] * 1.5, share[2] * 2.5);
            assert!((field.value(p) - slope.dot(&p) - 2.0).abs() < 1e-6);
        }
        for share in [[0.3, 0.8, 0.2], [0.5, 0.5, 0.5], [0.77, 0.6, 0.25]] {
            let p = field.origin + Vector3::new(share[0] * 2.0, share[1] * 1.5, share[2] * 2.5);
            assert!((field.gradient(p) - slope).norm() < 1e-6);
        }
    }

    #[test]
    fn beyond_the_grid_it_is_a_lower_bound() {
        // A small ball in the middle of the grid.
        let center = Vector3::new(1.1, 0.5, 1.5);
        let field = field(|p| (p - center).norm() - 0.2);
        let mut beyond = 0;
        for n in 0..400 {
            let angle = f64::from(n);
            let p = center + Vector3::new(angle.cos(), angle.sin(), (0.7 * angle).cos()) * (0.05 * angle);
            if field.spot(p).beyond.norm() > 0.0 {
                assert!(field.value(p) <= (p - center).norm() - 0.2, "{p}");
                beyond += 1;
            }
        }
        assert!(beyond > 300);
        let far = Vector3::new(1e3, 0.0, 0.0);
        assert!(field.value(far) > 990.0);
        assert!((field.gradient(far) - Vector3::x()).norm() < 1e-3);
    }

    #[test]
    fn no_number_is_no_panic() {
        let field = field(|p| p.x);
        let nowhere = Vector3::new(f64::NAN, f64::INFINITY, 0.4);
        let value = field.value(nowhere);
        assert!(value.is_nan() || value >= 0.0, "{value}");
    }
}
