//! Five vertebrae (T9 to L1) with their discs and canal, and the ribs 6 to 12 of both sides.

use super::sdf::{FAR, capsule, ellipse, length, smooth_max, smooth_min};
use super::torso;
use crate::geometry::Point3;

/// Distance of neighbouring vertebrae [mm].
const LEVEL: f64 = 32.0;
/// Half height of a vertebral body [mm].
const BODY_HALF_HEIGHT: f64 = 12.8;
/// Thickness of the cortical bone of a vertebra and of a rib [mm].
const CORTEX: [f64; 2] = [1.8, 1.5];

/// Distances to the parts of the spine.
pub(super) struct Spine {
    /// The canal with the cord.
    pub(super) canal: f64,
    /// Spongy bone inside the cortex.
    pub(super) cancellous: f64,
    /// Whole vertebrae.
    pub(super) bone: f64,
    /// Discs, which reach a little into the vertebrae above and below.
    pub(super) disc: f64,
}

impl Spine {
    /// Nothing near.
    const NONE: Self = Self { canal: FAR, cancellous: FAR, bone: FAR, disc: FAR };

    /// All four at a place.
    pub(super) fn at(p: Point3) -> Self {
        if p.x.abs() > 58.0 || p.y > -6.0 || p.y < -112.0 {
            return Self::NONE;
        }
        // A gentle kyphosis: the bodies' centre line bows backwards in the middle.
        let y = p.y + 41.0 - 0.0006 * p.z * p.z;
        let level = (p.z / LEVEL).round().clamp(-2.0, 2.0);
        let z = p.z - level * LEVEL;
        let mirrored = Point3::new(p.x.abs(), y, z);
        let end = p.z.abs() - torso::CONTENT_HEIGHT;
        let canal = smooth_max(ellipse(p.x, y + 23.5, 9.5, 7.5), end, 2.0);
        let bone = smooth_max(vertebra(mirrored), end + 1.0, 1.5);
        let disc = {
            let z = p.z - ((p.z / LEVEL - 0.5).round() + 0.5).clamp(-1.5, 1.5) * LEVEL;
            smooth_max(ellipse(p.x, y, 22.5, 16.5), z.abs() - 5.5, 3.0)
        };
        Self { canal, cancellous: bone + CORTEX[0], bone, disc }
    }
}

/// Distance to one vertebra; the place is relative to the centre of its body, x mirrored to the right side.
fn vertebra(p: Point3) -> f64 {
    // The body has a waist between its end plates.
    let waist = 2.0 * (1.0 - (p.z / BODY_HALF_HEIGHT).powi(2)).max(0.0);
    let body = smooth_max(ellipse(p.x, p.y, 22.5 - waist, 17.0 - waist), p.z.abs() - BODY_HALF_HEIGHT, 3.0);
    if p.y > -8.0 {
        return body;
    }
    // Plates stand upright: measured with z shortened they come out taller than thick.
    let tall = |factor: f64| Point3::new(p.x, p.y, p.z * factor);
    let point = Point3::new;
    let pedicle = capsule(tall(0.65), point(12.0, -12.0, 2.0), point(14.5, -26.0, 2.0), 4.2, 4.2);
    let lamina = capsule(tall(0.45), point(14.5, -27.0, 0.0), point(0.0, -37.0, -1.0), 3.6, 3.2);
    let spinous = capsule(tall(0.45), point(0.0, -37.0, -1.0), point(0.0, -54.0, -3.0), 3.0, 3.4);
    let transverse = capsule(p, point(14.5, -26.0, 2.0), point(37.0, -33.0, 4.0), 4.4, 4.8);
    let facet = capsule(p, point(15.0, -28.0, -11.0), point(15.0, -28.0, 11.0), 4.3, 4.3);
    let arch = smooth_min(smooth_min(lamina, pedicle, 3.0), smooth_min(transverse, facet, 3.0), 3.0);
    smooth_min(body, smooth_min(arch, spinous, 3.0), 3.0)
}

/// Height of a rib where it leaves the spine, for rib 12 [mm]; the others follow one level apart.
const TWELFTH: f64 = -29.0;
/// How far a rib falls per angle on its way to the front [mm/rad].
const FALL: f64 = 62.0;
/// Angle at which ribs begin, and at which the ribs 12, 11, ... 6 end [rad].
const BEGIN: f64 = 0.34;
const END: [f64; 7] = [0.95, 1.5, 2.1, 2.3, 2.35, 2.4, 2.4];

/// Distances to the spongy inside of the ribs and to whole ribs.
pub(super) fn ribs(p: Point3, cavity: f64) -> [f64; 2] {
    if !(-6.0..16.0).contains(&cavity) {
        return [FAR; 2];
    }
    let angle = torso::angle(p);
    let height = p.z + FALL * (angle - BEGIN) - TWELFTH;
    let number = (height / LEVEL).round().clamp(0.0, (END.len() - 1) as f64);
    // Measured across the rib, which runs obliquely over a wall of about 110 mm per radian.
    let across = (height - number * LEVEL) * 0.87;
    let section = ellipse(cavity - 4.6, across, 3.5, 6.6);
    let beyond = (BEGIN - angle).max(angle - END[number as usize]) * 110.0;
    let rib = if beyond > 0.0 { length((section + 3.0).max(0.0), beyond) - 3.0 } else { section };
    let rib = smooth_max(rib, p.z.abs() - torso::CONTENT_HEIGHT + 1.0, 1.5);
    [rib + CORTEX[1], rib]
}
