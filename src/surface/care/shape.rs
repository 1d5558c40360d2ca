//! When a triangle is good enough.

use crate::geometry::Vector3;

/// A triangle below this may only get better; 0.1 is a needle with an angle of 5 degrees.
const FAIR: f64 = 0.1;

/// No change leaves a triangle below this, so that none is flat once its corners are rounded to f32.
const LEAST: f64 = 1e-3;

/// Cosine of the largest angle a triangle may turn by in one change: 70 degrees.
const TURN: f64 = 0.34;

/// Twice the area of a triangle along its normal.
pub(super) fn normal([a, b, c]: [Vector3; 3]) -> Vector3 {
    (b - a).cross(&(c - a))
}

/// 1 for an equilateral triangle, 0 for a flat one: area over the sum of the squared sides.
pub(super) fn quality(corners: [Vector3; 3]) -> f64 {
    let [a, b, c] = corners;
    let sides = (b - a).norm_squared() + (c - b).norm_squared() + (a - c).norm_squared();
    if sides > 0.0 { 2.0 * 3.0_f64.sqrt() * normal(corners).norm() / sides } else { 0.0 }
}

/// Whether a triangle may take a quality where the worst so far is `worst`.
pub(super) fn fair(quality: f64, worst: f64) -> bool {
    quality >= worst.min(FAIR) && quality >= LEAST
}

/// Whether a triangle still looks the same way.
pub(super) fn same_way(old: Vector3, new: Vector3) -> bool {
    old.dot(&new) > TURN * old.norm() * new.norm()
}

/// Cosine of the smallest angle: the smaller, the better.
pub(super) fn sharpest(corners: [Vector3; 3]) -> f64 {
    let cosine = |at: usize| {
        let (one, two) = (corners[(at + 1) % 3] - corners[at], corners[(at + 2) % 3] - corners[at]);
        one.dot(&two) / (one.norm() * two.norm())
    };
    cosine(0).max(cosine(1)).max(cosine(2))
}
