//! Sums of squared distances to planes, and the point that makes one least.
//!
//! # Source
//! Garland and Heckbert, Surface simplification using quadric error metrics, 1997.

use crate::geometry::{Matrix3, Vector3};

/// Weight of the pull towards the middle of an edge, as a share of the quadric's mean curvature: on flat ground it decides.
const PULL: f64 = 1e-3;

/// `p A p + 2 b p + c`: the sum of weight * distance^2 to planes.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Quadric {
    /// xx, xy, xz, yy, yz, zz.
    a: [f64; 6],
    b: [f64; 3],
    c: f64,
    /// Sum of the weights.
    weight: f64,
}

impl Quadric {
    /// The plane through a point with a unit normal.
    pub(super) fn plane(point: Vector3, normal: Vector3, weight: f64) -> Self {
        let (n, d) = (normal, -normal.dot(&point));
        let a = [n.x * n.x, n.x * n.y, n.x * n.z, n.y * n.y, n.y * n.z, n.z * n.z].map(|c| weight * c);
        Self { a, b: [n.x, n.y, n.z].map(|c| weight * d * c), c: weight * d * d, weight }
    }

    pub(super) fn plus(&self, other: &Self) -> Self {
        Self {
            a: std::array::from_fn(|at| self.a[at] + other.a[at]),
            b: std::array::from_fn(|at| self.b[at] + other.b[at]),
            c: self.c + other.c,
            weight: self.weight + other.weight,
        }
    }

    /// Sum of weight * distance^2 at a point.
    pub(super) fn at(&self, p: Vector3) -> f64 {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        let squares = p.x * p.x * xx + p.y * p.y * yy + p.z * p.z * zz;
        let mixed = p.x * p.y * xy + p.x * p.z * xz + p.y * p.z * yz;
        let linear = p.x * self.b[0] + p.y * self.b[1] + p.z * self.b[2];
        // Rounding may take a point on all planes below zero.
        (squares + 2.0 * (mixed + linear) + self.c).max(0.0)
    }

    /// Root mean square distance to the planes at a point.
    pub(super) fn distance(&self, p: Vector3) -> f64 {
        if self.weight > 0.0 { (self.at(p) / self.weight).sqrt() } else { 0.0 }
    }

    /// The point of least sum, drawn a little towards `middle`, and the inverse of what was solved. `None` without planes.
    pub(super) fn least(&self, middle: Vector3) -> Option<(Vector3, Matrix3)> {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        let pull = PULL * (xx + yy + zz) / 3.0;
        let a = Matrix3::new(xx + pull, xy, xz, xy, yy + pull, yz, xz, yz, zz + pull);
        let inverse = a.try_inverse()?;
        // Solved for the way from the middle: no cancellation far from the origin.
        let slope = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) * middle + Vector3::from(self.b);
        Some((middle - inverse * slope, inverse))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_planes_meet_in_their_corner_and_one_leaves_the_middle() {
        let corner = Vector3::new(1e3, -2e3, 5e2);
        let planes = [Vector3::x(), Vector3::y(), Vector3::z()].map(|n| Quadric::plane(corner, n, 2.0));
        let all = planes[0].plus(&planes[1]).plus(&planes[2]);
        let middle = corner + Vector3::new(0.5, -0.25, 0.1);
        let (point, _) = all.least(middle).unwrap();
        // The pull towards the middle leaves a thousandth of the way.
        assert!((point - corner).norm() < 1.1 * PULL * (middle - corner).norm(), "{point}");
        assert!((all.at(middle) - 2.0 * (middle - corner).norm_squared()).abs() < 1e-6);
        assert!((all.distance(middle) - (middle - corner).norm() / 3.0_f64.sqrt()).abs() < 1e-6);
        let (on_plane, _) = planes[0].least(middle).unwrap();
        assert!((on_plane - Vector3::new(corner.x, middle.y, middle.z)).norm() < 1e-3);
        assert!(Quadric::default().least(middle).is_none());
    }
}
