//! The liver: a wedge with a big right lobe under the diaphragm and a left lobe across the midline, and the gallbladder.

use super::noise::{Lumps, Stream};
use super::sdf::{FAR, capsule, ellipsoid, smooth_max, smooth_min};
use crate::geometry::{Point3, Vector3};

/// The seeded shape of one liver.
pub(super) struct Liver {
    /// Size relative to the typical liver.
    size: f64,
    /// Tilt of the left lobe [rad].
    tilt: f64,
    lumps: Lumps,
}

/// Where liver and gallbladder pivot when the size changes, RAS+ [mm].
const CENTER: [f64; 3] = [60.0, 10.0, 0.0];

impl Liver {
    pub(super) fn new(seed: u64) -> Self {
        let mut stream = Stream::new(seed, 1);
        let size = stream.between(0.96, 1.03);
        let tilt = stream.between(0.25, 0.4);
        Self { size, tilt, lumps: Lumps::new(&mut stream, 55.0, 4.0) }
    }

    /// Distance to the liver's surface. `cavity` is the distance to the inside of the wall; `clear` the distance to
    /// everything the liver gives way to (right kidney, spine, vena cava).
    pub(super) fn distance(&self, p: Point3, cavity: f64, clear: f64) -> f64 {
        if !(-75.0..142.0).contains(&p.x) || p.z.abs() > 74.0 {
            return FAR;
        }
        let center = Point3::from(CENTER);
        let q = center + (p - center) / self.size;
        let right = ellipsoid(q - Point3::new(70.0, 2.0, -6.0), [68.0, 74.0, 67.0]);
        let (sin, cos) = self.tilt.sin_cos();
        let from_left = q - Point3::new(-2.0, 44.0, 25.0);
        let turned =
            Vector3::new(cos * from_left.x - sin * from_left.z, from_left.y, sin * from_left.x + cos * from_left.z);
        let left = ellipsoid(turned, [58.0, 34.0, 21.0]);
        let lobes = smooth_min(right, left, 24.0);
        // The visceral surface looks down, back and to the left, and is slightly hollow.
        let hollow = 5.0 * (-((q.x - 45.0).powi(2) + (q.y - 5.0).powi(2)) / 1800.0).exp();
        let beneath = Vector3::new(-0.43, -0.30, -0.85).dot(&(q - Point3::new(112.0, -15.0, -64.0))) + hollow;
        let wedge = smooth_max(lobes, beneath, 16.0);
        // The fissure of the round ligament enters the front from below.
        let fissure = ellipsoid(q - Point3::new(14.0, 62.0, -4.0), [3.5, 34.0, 26.0]);
        let gallbladder = self.gallbladder(p) - 1.5;
        let shape = smooth_max(smooth_max(wedge, -fissure, 5.0), -gallbladder, 5.0) * self.size;
        let shape = shape + if shape.abs() < 12.0 { self.lumps.at(p) } else { 0.0 };
        smooth_max(smooth_max(shape, 3.5 - clear, 8.0), cavity + 2.5, 8.0)
    }

    /// Distance to the gallbladder, in its bed under the right lobe.
    pub(super) fn gallbladder(&self, p: Point3) -> f64 {
        let (neck, fundus) = (Point3::new(40.0, 18.0, -8.0), Point3::new(62.0, 58.0, -30.0));
        capsule(p, neck, fundus, 5.0, 13.0)
    }
}
