//! Parts of the lattice by place or tissue: where an operation acts.

use crate::geometry::{Point3, Vector3};

/// A set of particles, by rest place (RAS+ [mm]) or by organ.
#[derive(Debug, Clone, PartialEq)]
pub enum Region {
    /// Particles at most `radius` from `center`.
    Sphere {
        /// Centre, RAS+ [mm].
        center: Point3,
        /// Radius [mm].
        radius: f64,
    },
    /// Particles inside an axis-aligned box, borders included.
    Box {
        /// Lowest corner, RAS+ [mm].
        min: Point3,
        /// Highest corner, RAS+ [mm].
        max: Point3,
    },
    /// Particles on the side of a plane its normal points to, the plane included.
    HalfSpace {
        /// Any point of the plane, RAS+ [mm].
        point: Point3,
        /// Normal of any length.
        normal: Vector3,
    },
    /// Particles of one organ: its index in the scene.
    Organ(usize),
    /// The `count` particles nearest to a point (ties by particle number).
    Nearest {
        /// The point, RAS+ [mm].
        point: Point3,
        /// How many particles.
        count: usize,
    },
    /// Particles in every one of these regions.
    All(Vec<Region>),
    /// Particles in at least one of these regions.
    Any(Vec<Region>),
    /// Particles outside a region.
    Not(Box<Region>),
}
