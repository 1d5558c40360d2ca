//! Signed distances and how to blend them: negative inside, in millimetres.
//!
//! Boxes, capsules and planes are exact. Ellipsoids and superellipses are exact to first order at the surface, which is
//! where partial volume reads them; far away they are estimates that never change sign. A smooth blend of width `k`
//! moves a surface by at most `k / 4`.

use crate::geometry::{Point3, Vector3};

/// Farther than any border: what a shape returns when a point is outside the box that holds it.
pub(super) const FAR: f64 = 1e3;

/// Length of a vector in a plane; `hypot` guards against overflow that cannot occur here, at several times the price.
pub(super) fn length(x: f64, y: f64) -> f64 {
    (x * x + y * y).sqrt()
}

/// Distance to an ellipsoid at the origin.
pub(super) fn ellipsoid(p: Vector3, radii: [f64; 3]) -> f64 {
    let scaled = Vector3::new(p.x / radii[0], p.y / radii[1], p.z / radii[2]);
    let slope = Vector3::new(scaled.x / radii[0], scaled.y / radii[1], scaled.z / radii[2]).norm();
    let level = scaled.norm();
    if slope < 1e-9 { -radii[0].min(radii[1]).min(radii[2]) } else { level * (level - 1.0) / slope }
}

/// Distance to an ellipse in a plane.
pub(super) fn ellipse(x: f64, y: f64, a: f64, b: f64) -> f64 {
    let (u, v) = (x / a, y / b);
    let slope = length(u / a, v / b);
    let level = length(u, v);
    if slope < 1e-9 { -a.min(b) } else { level * (level - 1.0) / slope }
}

/// Distance to a superellipse `|x/a|^2.5 + |y/b|^2.5 = 1`: between an ellipse (exponent 2) and a rectangle, as trunks are.
pub(super) fn superellipse(x: f64, y: f64, a: f64, b: f64) -> f64 {
    let (u, v) = ((x / a).abs(), (y / b).abs());
    let (u_slope, v_slope) = (u * u.sqrt(), v * v.sqrt());
    let sum = u_slope * u + v_slope * v;
    if sum < 1e-12 {
        return -a.min(b);
    }
    // The gradient of level = sum^(1/2.5), a function of degree one.
    let level = sum.powf(0.4);
    let slope = level / sum * length(u_slope / a, v_slope / b);
    (level - 1.0) / slope
}

/// Distance to a capsule whose radius goes linearly from `ra` at `a` to `rb` at `b`.
pub(super) fn capsule(p: Point3, a: Point3, b: Point3, ra: f64, rb: f64) -> f64 {
    let axis = b - a;
    let along = ((p - a).dot(&axis) / axis.norm_squared().max(1e-12)).clamp(0.0, 1.0);
    (p - a - axis * along).norm() - (ra + (rb - ra) * along)
}

/// Smooth minimum: the union of two shapes with a fillet of width `k`.
pub(super) fn smooth_min(a: f64, b: f64, k: f64) -> f64 {
    let overlap = (k - (a - b).abs()).max(0.0) / k;
    a.min(b) - overlap * overlap * k * 0.25
}

/// Smooth maximum: the intersection of two shapes with a rounded edge of width `k`.
pub(super) fn smooth_max(a: f64, b: f64, k: f64) -> f64 {
    -smooth_min(-a, -b, k)
}

/// Share of a box of width `width` on the inside of a plane at signed distance `distance` from its centre.
pub(super) fn coverage(distance: f64, width: f64) -> f64 {
    (0.5 - distance / width).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_exact_to_first_order_at_the_surface() {
        let step = 0.01;
        for turn in 0..24 {
            let (s, c) = (f64::from(turn) * 0.27).sin_cos();
            let at = |r: f64| superellipse(160.0 * c * r, 110.0 * s * r, 160.0, 110.0);
            // Find the surface along this ray, then step along the gradient.
            let (mut lo, mut hi) = (0.5, 1.5);
            for _ in 0..60 {
                let mid = 0.5 * (lo + hi);
                if at(mid) < 0.0 { lo = mid } else { hi = mid }
            }
            let (x, y) = (160.0 * c * lo, 110.0 * s * lo);
            let f = |x, y| superellipse(x, y, 160.0, 110.0);
            let slope = ((f(x + step, y) - f(x - step, y)) / (2.0 * step))
                .hypot((f(x, y + step) - f(x, y - step)) / (2.0 * step));
            assert!((slope - 1.0).abs() < 1e-3, "slope {slope} at turn {turn}");
            let p = Vector3::new(26.0 * c, 24.0 * s, 0.0);
            let g = |p| ellipsoid(p, [26.0, 24.0, 48.0]);
            let e = Vector3::new(c / 26.0, s / 24.0, 0.0).normalize();
            assert!(((g(p + e * step) - g(p - e * step)) / (2.0 * step) - 1.0).abs() < 1e-3);
        }
    }

    #[test]
    fn blends_meet_the_sharp_ones_away_from_the_seam() {
        assert_eq!(smooth_min(1.0, 9.0, 4.0), 1.0);
        assert_eq!(smooth_max(1.0, 9.0, 4.0), 9.0);
        assert_eq!(smooth_min(2.0, 2.0, 4.0), 1.0);
        let p = Point3::new(5.0, 3.0, 0.0);
        assert_eq!(capsule(p, Point3::origin(), Point3::new(10.0, 0.0, 0.0), 1.0, 3.0), 1.0);
    }
}
