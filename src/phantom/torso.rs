//! What encloses the organs: skin, fat, the muscle wall, the cavity, the lung bases.

use super::sdf::{self, ellipse, smooth_max, smooth_min, superellipse};
use crate::geometry::Point3;

/// Half height of the section of the trunk, skin to skin [mm].
pub(super) const HALF_HEIGHT: f64 = 87.0;
/// Half width and half depth of the trunk [mm].
pub(super) const HALF_WIDTH: [f64; 2] = [160.0, 110.0];
/// Muscle, bone and lungs end at this height, so that fat and skin close the section [mm].
pub(super) const CONTENT_HEIGHT: f64 = 78.0;
/// Thickness of the skin [mm].
pub(super) const SKIN: f64 = 2.5;
/// The cavity's outline: centre y, half width, half depth [mm].
const CAVITY: [f64; 3] = [6.0, 133.0, 81.0];

/// Distance to the outer surface of the skin.
pub(super) fn body(p: Point3) -> f64 {
    let around = superellipse(p.x, p.y, HALF_WIDTH[0], HALF_WIDTH[1]);
    smooth_max(around, p.z.abs() - HALF_HEIGHT, 12.0)
}

/// Distance to the inner surface of the abdominal and chest wall, endless in z.
pub(super) fn cavity(p: Point3) -> f64 {
    superellipse(p.x, p.y - CAVITY[0], CAVITY[1], CAVITY[2])
}

/// Angle around the cavity: 0 at the back, pi at the front, the same on both sides [rad].
pub(super) fn angle(p: Point3) -> f64 {
    (p.x.abs() / CAVITY[1]).atan2((CAVITY[0] - p.y) / CAVITY[2])
}

/// Distance to the muscles: the wall, the erectors of the spine, the psoas; the diaphragm is added under the lungs.
pub(super) fn muscle(p: Point3, cavity: f64, lung: f64) -> f64 {
    let outer = superellipse(p.x, p.y - 4.0, 144.0, 90.0);
    let wall = outer.max(-cavity);
    let x = p.x.abs();
    let erector = ellipse(x - 29.0, p.y + 83.0, 25.0, 16.0);
    // The two recti: the wall is thicker at the front, and thin at the midline.
    let rectus = ellipse(x - 36.0, p.y - 90.0, 30.0, 6.5);
    let midline = 3.0 - (x * x * 0.25 + (p.y - 91.0).powi(2) * 0.04).sqrt();
    let wall = smooth_max(smooth_min(wall, smooth_min(erector, rectus, 4.0), 5.0), midline, 2.0);
    // The psoas grows downwards from the first lumbar vertebra.
    let girth = (0.25 - p.z / 90.0).clamp(0.0, 1.0);
    let psoas = ellipse(x - 31.0, p.y + 49.0, 3.0 + 11.0 * girth, 4.0 + 13.0 * girth) + 4.0 * (1.0 - girth);
    let psoas = smooth_max(psoas, p.z - 15.0, 10.0);
    let muscle = wall.min(psoas).min(lung - 3.0);
    smooth_max(muscle, p.z.abs() - CONTENT_HEIGHT, 3.0)
}

/// Distance to the lung bases: inside the wall, above the domes of the diaphragm, clear of what `beneath` measures.
pub(super) fn lung(p: Point3, cavity: f64, beneath: f64) -> f64 {
    let dome = |x: f64, y: f64, top: f64| {
        // At the back the recess goes deep, at the front the diaphragm is attached high.
        let depth = if p.y < y { 90.0 } else { 125.0 };
        top - 95.0 * (((p.x - x) / 100.0).powi(2) + ((p.y - y) / depth).powi(2))
    };
    let diaphragm = dome(68.0, 6.0, 66.0).max(dome(-70.0, 4.0, 60.0));
    // The dome is steep at the wall: divide by its slope to get a distance.
    let above = (diaphragm - p.z) / 1.6;
    let middle = -ellipse(p.x, p.y - 10.0, 30.0, 140.0);
    let shape = smooth_max(smooth_max(above, cavity + 1.5, 4.0), middle, 6.0);
    let shape = smooth_max(shape, 4.5 - beneath, 4.0);
    if shape > 30.0 { sdf::FAR } else { smooth_max(shape, p.z.abs() - CONTENT_HEIGHT + 2.0, 3.0) }
}
