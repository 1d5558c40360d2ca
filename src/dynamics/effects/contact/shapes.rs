//! Shapes of obstacles, as signed distances: below zero inside.

use std::sync::Arc;

use super::distance_field::DistanceField;
use super::mesh_distance::{MeshShapeError, ToolMesh, mesh_field};
use super::voxel_distance::rigid_field;
use crate::geometry::{Point3, Vector3};
use crate::lattice::Lattice;

/// The shape of an obstacle, where it stands before it is moved.
#[derive(Debug, Clone)]
pub struct Shape(pub(super) Form);

/// Lengths in metres, patient axes, but for fields that say otherwise.
#[derive(Debug, Clone)]
pub(super) enum Form {
    Sphere { center: Vector3, radius: f64 },
    Capsule { from: Vector3, along: Vector3, radius: f64 },
    Block { center: Vector3, half: Vector3 },
    Plane { point: Vector3, normal: Vector3 },
    Field(Arc<DistanceField>),
}

impl Shape {
    /// A ball: centre and radius, RAS+ [mm].
    pub fn sphere(center: Point3, radius: f64) -> Self {
        Self(Form::Sphere { center: center.coords * 1e-3, radius: radius * 1e-3 })
    }

    /// All places at most a radius from a line: its ends and the radius, RAS+ [mm].
    pub fn capsule(from: Point3, to: Point3, radius: f64) -> Self {
        Self(Form::Capsule { from: from.coords * 1e-3, along: (to - from) * 1e-3, radius: radius * 1e-3 })
    }

    /// A box along the patient's axes: its lowest and highest corner, RAS+ [mm].
    pub fn block(min: Point3, max: Point3) -> Self {
        Self(Form::Block { center: 0.5e-3 * (min.coords + max.coords), half: 0.5e-3 * (max - min) })
    }

    /// Everything on the far side of a plane, RAS+ [mm]: tissue stays on the side that the normal (of any length) points to.
    pub fn plane(point: Point3, normal: Vector3) -> Self {
        Self(Form::Plane { point: point.coords * 1e-3, normal: normal / normal.norm() })
    }

    /// The inside of a closed triangle mesh, triangles counter-clockwise seen from outside. Its distance is sampled once on a
    /// grid; see [`SPACING_OF_PITCH`](super::SPACING_OF_PITCH) for the spacing and its error.
    ///
    /// - `pitch` of the lattice it is to meet [m].
    ///
    /// # Errors
    /// If the mesh is open, inside out, without volume, or too thin for the grid.
    pub fn mesh(mesh: &ToolMesh, pitch: f64) -> Result<Self, MeshShapeError> {
        mesh_field(mesh, pitch).map(|field| Self(Form::Field(Arc::new(field))))
    }

    /// The voxels of some organs of a lattice, where they are at rest; `None` when there is none. What moves them later is not
    /// noticed: for rigid organs that stay.
    ///
    /// - `organs`: indices into the scene's organs.
    pub fn rigid_organs(lattice: &Lattice, organs: &[usize]) -> Option<Self> {
        rigid_field(lattice, organs).map(|field| Self(Form::Field(Arc::new(field))))
    }

    /// Signed distance of a place from the surface [m], negative inside; for sampled shapes beyond their grid a lower bound.
    ///
    /// - `place`: RAS+ [mm]; for [`Shape::rigid_organs`] the lattice's own axes from its first point, in mm.
    pub fn signed_distance(&self, place: Point3) -> f64 {
        self.0.value(place.coords * 1e-3)
    }
}

impl Form {
    /// Signed distance of a place [m].
    pub(super) fn value(&self, place: Vector3) -> f64 {
        match self {
            Self::Sphere { center, radius } => (place - center).norm() - radius,
            Self::Capsule { from, along, radius } => (place - nearest_of_line(from, along, place)).norm() - radius,
            Self::Block { center, half } => {
                let beyond = (place - center).abs() - half;
                beyond.sup(&Vector3::zeros()).norm() + beyond.max().min(0.0)
            }
            Self::Plane { point, normal } => normal.dot(&(place - point)),
            Self::Field(field) => field.value(place),
        }
    }

    /// Gradient of [`Form::value`]: of length 1 but for sampled fields. Where there is none (in the centre of a sphere), some
    /// direction.
    pub(super) fn gradient(&self, place: Vector3) -> Vector3 {
        match self {
            Self::Sphere { center, .. } => direction(place - center),
            Self::Capsule { from, along, .. } => direction(place - nearest_of_line(from, along, place)),
            Self::Block { center, half } => {
                let from_center = place - center;
                let beyond = from_center.abs() - half;
                let outside = beyond.sup(&Vector3::zeros());
                let sign = from_center.map(|part| if part < 0.0 { -1.0 } else { 1.0 });
                if outside.norm_squared() > 0.0 {
                    return direction(outside.component_mul(&sign));
                }
                let nearest = beyond.imax();
                Vector3::from_fn(|axis, _| if axis == nearest { sign[axis] } else { 0.0 })
            }
            Self::Plane { normal, .. } => *normal,
            Self::Field(field) => field.gradient(place),
        }
    }

    /// The value changes by at most this much per length moved.
    pub(super) fn steepness(&self) -> f64 {
        match self {
            Self::Field(_) => DistanceField::STEEPNESS,
            _ => 1.0,
        }
    }

    /// True for what is described in the axes of the lattice and not of the patient.
    pub(super) fn in_lattice_axes(&self) -> bool {
        matches!(self, Self::Field(field) if field.in_lattice_axes)
    }

    pub(super) fn bytes(&self) -> usize {
        match self {
            Self::Field(field) => field.bytes(),
            _ => 0,
        }
    }
}

/// The point of a line from `from` to `from + along` that is nearest to a place.
fn nearest_of_line(from: &Vector3, along: &Vector3, place: Vector3) -> Vector3 {
    let length_squared = along.norm_squared();
    let share = if length_squared > 0.0 { (place - from).dot(along) / length_squared } else { 0.0 };
    from + along * share.clamp(0.0, 1.0)
}

fn direction(vector: Vector3) -> Vector3 {
    vector.try_normalize(f64::MIN_POSITIVE).unwrap_or_else(Vector3::z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splitmix::{GOLDEN, mix, unit};

    /// Each part from -1 to 1.
    fn vector(index: u64) -> Vector3 {
        Vector3::from_fn(|axis, _| 2.0 * unit(mix(GOLDEN.wrapping_mul(3 * index + axis as u64 + 1))) - 1.0)
    }

    fn shapes() -> Vec<Shape> {
        let (a, b) = (Point3::new(1.0, -2.0, 0.5), Point3::new(-3.0, 4.0, 6.0));
        vec![
            Shape::sphere(a, 4.0),
            Shape::capsule(a, b, 2.5),
            Shape::capsule(a, a, 2.5),
            Shape::block(Point3::new(-3.0, -2.0, -4.0), Point3::new(1.0, 5.0, 4.5)),
            Shape::plane(a, Vector3::new(0.0, -3.0, 4.0)),
        ]
    }

    /// The least distance to many points of the border, with the sign of a membership test that knows no distance.
    #[test]
    fn distances_agree_with_brute_force() {
        let (from, to) = (Vector3::new(1.0, -2.0, 0.5), Vector3::new(-3.0, 4.0, 6.0));
        let on_line = |p: Vector3, steps: usize| {
            let near = |i: usize| (p - from - (to - from) * (i as f64 / steps as f64)).norm();
            (0..=steps).map(near).fold(f64::INFINITY, f64::min)
        };
        let [sphere, capsule, ball, block, plane] = shapes().try_into().expect("five shapes");
        let (low, high) = (Vector3::new(-3.0, -2.0, -4.0), Vector3::new(1.0, 5.0, 4.5));
        for index in 0..300 {
            let p = vector(index) * 9.0;
            let of = |shape: &Shape| shape.signed_distance(p.into()) * 1e3;
            assert!((of(&sphere) - ((p - from).norm() - 4.0)).abs() < 1e-12);
            assert!((of(&ball) - ((p - from).norm() - 2.5)).abs() < 1e-12);
            assert!((of(&capsule) - (on_line(p, 20_000) - 2.5)).abs() < 1e-6, "{p}");
            assert!((of(&plane) - (-0.6 * (p.y + 2.0) + 0.8 * (p.z - 0.5))).abs() < 1e-12);
            // Every face of the box as a grid of points.
            let mut nearest = f64::INFINITY;
            for axis in 0..3 {
                for side in [low[axis], high[axis]] {
                    for step in 0..=60 * 60 {
                        let share = [step % 61, (step / 61).min(60)].map(|n| f64::from(n as u32) / 60.0);
                        let mut q = Vector3::zeros();
                        q[axis] = side;
                        for (other, share) in [(axis + 1) % 3, (axis + 2) % 3].into_iter().zip(share) {
                            q[other] = low[other] + share * (high[other] - low[other]);
                        }
                        nearest = nearest.min((p - q).norm());
                    }
                }
            }
            let inside = (0..3).all(|axis| p[axis] > low[axis] && p[axis] < high[axis]);
            let expected = if inside { -nearest } else { nearest };
            // Points of a face are at most 0.1 mm from the next of them.
            assert!((of(&block) - expected).abs() < 0.1, "{p}: {} {expected}", of(&block));
            assert_eq!(of(&block) < 0.0, inside);
        }
    }

    #[test]
    fn gradients_are_those_of_the_distance() {
        for (number, shape) in shapes().iter().enumerate() {
            for index in 0..300 {
                let p = vector(index) * 9e-3;
                let gradient = shape.0.gradient(p);
                assert!((gradient.norm() - 1.0).abs() < 1e-12);
                let h = 1e-8;
                let difference = Vector3::from_fn(|axis, _| {
                    let step = Vector3::from_fn(|i, _| if i == axis { h } else { 0.0 });
                    (shape.0.value(p + step) - shape.0.value(p - step)) / (2.0 * h)
                });
                // Not where two faces of the box are equally near.
                if (difference.norm() - 1.0).abs() < 1e-4 {
                    assert!((gradient - difference).norm() < 1e-3, "{number} {p}: {gradient} {difference}");
                }
            }
        }
    }

    #[test]
    fn a_centre_has_some_direction() {
        let sphere = Shape::sphere(Point3::origin(), 1.0);
        assert_eq!(sphere.0.gradient(Vector3::zeros()).norm(), 1.0);
    }
}
