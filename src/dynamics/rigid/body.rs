//! One rigid body: mass, centre, inertia, and how they move.
//!
//! The state is the centre, the orientation, the momentum and the angular momentum about the centre, in f64 and lattice
//! axes. Without forces both momenta are constants, not results. The orientation follows by splitting the energy of
//! rotation, with `m` the angular momentum along the principal axes and `I1 <= I2 <= I3`:
//!
//! ```text
//! H = |m|^2 / (2 I2)  +  m1^2 / 2 (1/I1 - 1/I2)  +  m3^2 / 2 (1/I3 - 1/I2)
//! ```
//!
//! Each term alone turns the body at a constant rate about an axis that stays (`L` in space; axis 1; axis 3 in the body),
//! so each is advanced exactly: half of the second, the third, half of the second; the first commutes with both. The step
//! is symplectic and reversible, its energy error stays bounded at order `dt^2`, and balls and symmetric tops are exact.
//!
//! Source: Touma and Wisdom, "Lie-Poisson integrators for rigid body dynamics in the solar system" (1994); Dullweber,
//! Leimkuhler and McLachlan, "Symplectic splitting methods for rigid molecular dynamics" (1997).

use nalgebra::{SymmetricEigen, UnitQuaternion};

use crate::geometry::{Matrix3, Vector3};
use crate::lattice::Lattice;

/// A rigid body of a [`super::super::World`]: rigid particles that living springs join. Vectors in lattice axes, SI units.
#[derive(Debug, Clone)]
pub struct RigidBody {
    particles: Vec<u32>,
    mass: f64,
    /// Centre of mass at rest [m].
    rest_centre: Vector3,
    /// About the centre, orientation at rest [kg m^2].
    rest_inertia: Matrix3,
    rest_inertia_inverse: Matrix3,
    /// Principal moments, ascending [kg m^2], and their axes at rest.
    principal: [(f64, Vector3); 3],
    place: Place,
    momentum: Vector3,
    angular_momentum: Vector3,
    /// What acts on it in this step.
    pub(super) load: Load,
}

/// Where a body is.
#[derive(Debug, Clone, Copy)]
struct Place {
    /// Of the centre from rest [m].
    offset: Vector3,
    orientation: UnitQuaternion<f64>,
}

/// What acts on a body in one step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Load {
    /// [N s]
    pub(super) impulse: Vector3,
    /// About the centre [N m s].
    pub(super) angular_impulse: Vector3,
    /// Grabbed: the velocity it is made to have [m/s].
    pub(super) driven: Option<Vector3>,
    /// Held: it stays where it is. Lasts until released.
    pub(super) held: bool,
}

impl Load {
    fn none(held: bool) -> Self {
        Self { impulse: Vector3::zeros(), angular_impulse: Vector3::zeros(), driven: None, held }
    }
}

/// A step of a body that has been found but not taken.
#[derive(Debug, Clone, Copy)]
pub(super) struct Advance {
    next: Place,
    /// Mean velocity of its particles over the step [m/s]: where they are after, less where they are, over `dt`.
    pub(super) velocities: PlaceMap,
}

/// A vector for every particle of a body, linear in its rest place: `base + slope * rest`.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlaceMap {
    base: Vector3,
    slope: Matrix3,
}

impl PlaceMap {
    /// `at_centre` for the centre, and `slope` times what a particle is away from it at rest.
    fn new(centre: Vector3, at_centre: Vector3, slope: Matrix3) -> Self {
        Self { base: at_centre - slope * centre, slope }
    }

    /// The vector of a particle from its rest place [m].
    pub(super) fn at(&self, rest: Vector3) -> Vector3 {
        self.base + self.slope * rest
    }
}

impl RigidBody {
    /// A body at rest in its rest place, from its particles (ascending, at least one).
    ///
    /// - `mass` of every particle of the lattice [kg].
    ///
    /// Each particle brings the inertia `m h^2 / 6` of a full cube of one pitch, so the tensor of a block of voxels is that
    /// of the block, and that of a single voxel is not zero.
    pub(super) fn new(lattice: &Lattice, mass: &[f32], particles: Vec<u32>) -> Self {
        let own = |p: u32| (f64::from(mass[p as usize]), rest_place(lattice, p));
        let total: f64 = particles.iter().map(|&p| own(p).0).sum();
        // Relative to one of them, so that a part far from the origin loses no digits.
        let first = rest_place(lattice, particles[0]);
        let moment: Vector3 = particles.iter().map(|&p| own(p)).map(|(m, x)| (x - first) * m).sum();
        let rest_centre = first + moment / total;
        let mut rest_inertia = Matrix3::identity() * (total * lattice.pitch.powi(2) / 6.0);
        for &particle in &particles {
            let (m, x) = own(particle);
            rest_inertia += point_inertia(m, x - rest_centre);
        }
        let eigen = SymmetricEigen::new(rest_inertia);
        let mut principal = [0, 1, 2].map(|i| (eigen.eigenvalues[i], eigen.eigenvectors.column(i).into_owned()));
        principal.sort_by(|a, b| a.0.total_cmp(&b.0));
        let rest_inertia_inverse = principal.iter().map(|(moment, axis)| axis * axis.transpose() / *moment).sum();
        Self {
            particles,
            mass: total,
            rest_centre,
            rest_inertia,
            rest_inertia_inverse,
            principal,
            place: Place { offset: Vector3::zeros(), orientation: UnitQuaternion::identity() },
            momentum: Vector3::zeros(),
            angular_momentum: Vector3::zeros(),
            load: Load::none(false),
        }
    }

    /// A part of this body as a body of its own: it stands where it stood and goes on as it went, so that the momenta of
    /// all parts add up to those of the whole.
    pub(super) fn part(&self, lattice: &Lattice, mass: &[f32], particles: Vec<u32>) -> Self {
        let mut part = Self::new(lattice, mass, particles);
        let arm = self.place.orientation * (part.rest_centre - self.rest_centre);
        part.place = Place { offset: self.centre() + arm - part.rest_centre, orientation: self.place.orientation };
        part.set_motion(self.velocity() + self.angular_velocity().cross(&arm), self.angular_velocity());
        part
    }

    /// Particles, ascending.
    pub fn particles(&self) -> &[u32] {
        &self.particles
    }

    /// Mass [kg].
    pub fn mass(&self) -> f64 {
        self.mass
    }

    /// Centre of mass from the lattice's first grid point [m].
    pub fn centre(&self) -> Vector3 {
        self.rest_centre + self.place.offset
    }

    /// Rotation from rest.
    pub fn orientation(&self) -> Matrix3 {
        self.place.orientation.to_rotation_matrix().into_inner()
    }

    /// Inertia about the centre as the body stands now [kg m^2].
    pub fn inertia(&self) -> Matrix3 {
        let turn = self.orientation();
        turn * self.rest_inertia * turn.transpose()
    }

    /// Velocity of the centre [m/s].
    pub fn velocity(&self) -> Vector3 {
        self.momentum / self.mass
    }

    /// Angular velocity [rad/s].
    pub fn angular_velocity(&self) -> Vector3 {
        let turn = self.place.orientation;
        turn * (self.rest_inertia_inverse * (turn.inverse() * self.angular_momentum))
    }

    /// Momentum [kg m/s].
    pub fn momentum(&self) -> Vector3 {
        self.momentum
    }

    /// Angular momentum about the centre [kg m^2/s].
    pub fn angular_momentum(&self) -> Vector3 {
        self.angular_momentum
    }

    /// Kinetic energy of translation and rotation [J].
    pub fn kinetic_energy(&self) -> f64 {
        0.5 * (self.momentum.dot(&self.velocity()) + self.angular_momentum.dot(&self.angular_velocity()))
    }

    /// True while a hold keeps it where it is.
    pub fn held(&self) -> bool {
        self.load.held
    }

    /// Sets velocity [m/s] and angular velocity [rad/s].
    pub(super) fn set_motion(&mut self, velocity: Vector3, angular_velocity: Vector3) {
        self.momentum = velocity * self.mass;
        self.angular_momentum = self.inertia() * angular_velocity;
    }

    /// Puts the whole body elsewhere, as it is turned [m].
    pub(super) fn shift(&mut self, by: Vector3) {
        self.place.offset += by;
    }

    /// An impulse [N s] at a place [m].
    pub(super) fn push(&mut self, impulse: Vector3, place: Vector3) {
        self.load.impulse += impulse;
        self.load.angular_impulse += (place - self.centre()).cross(&impulse);
    }

    /// Leaves it this share of its momenta and of the impulses that act on it in this step.
    pub(super) fn slow(&mut self, kept: f64) {
        self.momentum *= kept;
        self.angular_momentum *= kept;
        self.load.impulse *= kept;
        self.load.angular_impulse *= kept;
    }

    /// Displacements from rest [m].
    pub(super) fn displacements(&self) -> PlaceMap {
        PlaceMap::new(self.rest_centre, self.place.offset, self.orientation() - Matrix3::identity())
    }

    /// Velocities now [m/s].
    pub(super) fn velocities(&self) -> PlaceMap {
        let slope = self.angular_velocity().cross_matrix() * self.orientation();
        PlaceMap::new(self.rest_centre, self.velocity(), slope)
    }

    /// New momenta from the load, which is used up, and where they take the body in a step.
    pub(super) fn advance(&mut self, dt: f64) -> Advance {
        let load = self.load;
        self.load = Load::none(load.held);
        let prescribed = if load.held { Some(Vector3::zeros()) } else { load.driven };
        if let Some(velocity) = prescribed {
            self.set_motion(velocity, Vector3::zeros());
        } else {
            self.momentum += load.impulse;
            self.angular_momentum += load.angular_impulse;
        }
        let velocity = self.velocity();
        let orientation = self.turned_on(dt);
        let slope = (orientation.to_rotation_matrix().into_inner() - self.orientation()) / dt;
        Advance {
            next: Place { offset: self.place.offset + velocity * dt, orientation },
            velocities: PlaceMap::new(self.rest_centre, velocity, slope),
        }
    }

    /// Takes the step.
    pub(super) fn settle(&mut self, advance: &Advance) {
        self.place = advance.next;
    }

    /// Orientation after a time without torque.
    fn turned_on(&self, dt: f64) -> UnitQuaternion<f64> {
        if self.angular_momentum == Vector3::zeros() {
            return self.place.orientation;
        }
        let [(low, first), (middle, _), (high, third)] = self.principal;
        let about = |turn: UnitQuaternion<f64>, axis: Vector3, moment: f64, time: f64| {
            let momentum = (turn.inverse() * self.angular_momentum).dot(&axis);
            turn * UnitQuaternion::from_scaled_axis(axis * (momentum * (1.0 / moment - 1.0 / middle) * time))
        };
        let mut turn = about(self.place.orientation, first, low, 0.5 * dt);
        turn = about(turn, third, high, dt);
        turn = about(turn, first, low, 0.5 * dt);
        turn = UnitQuaternion::from_scaled_axis(self.angular_momentum * (dt / middle)) * turn;
        // The quaternion is the state, so the rotation stays orthonormal to rounding for ever.
        UnitQuaternion::new_normalize(turn.into_inner())
    }
}

/// Rest place of a particle from the lattice's first grid point, lattice axes [m].
pub(super) fn rest_place(lattice: &Lattice, particle: u32) -> Vector3 {
    place_of(lattice, lattice.ijk(particle).map(|index| index as i64))
}

/// Place of a grid point from the first one, lattice axes [m].
pub(super) fn place_of(lattice: &Lattice, ijk: [i64; 3]) -> Vector3 {
    Vector3::from(ijk.map(|n| n as f64)) * lattice.pitch
}

/// Inertia of a point mass at an arm from the centre.
fn point_inertia(mass: f64, arm: Vector3) -> Matrix3 {
    (Matrix3::identity() * arm.norm_squared() - arm * arm.transpose()) * mass
}
