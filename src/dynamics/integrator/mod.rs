//! How a world goes on in time: the integrators a scene can choose, written once for f32 and f64.
//!
//! | integrator | order | force evaluations per step | largest step, undamped and damped | what it does to energy |
//! |---|---|---|---|---|
//! | `symplectic_euler` | 1 | 1 | `w dt < 2`; `w^2 dt^2 + 2 c dt < 4` | swings, does not drift |
//! | [`verlet`] | 2 | 1 | `w dt < 2`; `w^2 dt^2 + 4 c dt < 4` | swings, does not drift |
//! | [`rk4`] | 4 | 4 | `w dt < 2.82`; `max(w, c) dt < 2.61` | loses `(w dt)^6 / 72` of a mode's per step |
//! | [`bogacki_shampine`] | 3, steps by its own error | 4, and 3 for each further part | `w dt < 1.73`; `max(w, c) dt < 1.73` | loses `(w dt)^4 / 12` of a mode's per step |
//! | [`backward_euler`] | 1 | until Newton's iteration has converged | any | only loses: `w^2 dt^2` of a mode's per step |
//! | [`quasi_static`] | none: the settled shape | the same | any | there is no motion |
//!
//! `w` is the angular frequency of the fastest mode and `c` its damping over mass. The plain step of a [`World`] is symplectic
//! Euler, fused with all that acts on it; whatever else a scene names runs through the trait [`Mechanics`]: accelerations at
//! given places and velocities. A world in f32 computes them with the same block kernels as its plain step, and
//! [`PreciseLattice`] in f64.
//!
//! # What is prescribed, and what acts
//!
//! - Held particles stay. Grabbed ones go to their next place with constant velocity and no acceleration, so every one of
//!   these methods takes them along a straight line, exactly, at all its stages; a path with corners or a ramp is followed
//!   as by the step's own polygon.
//! - Dampers act on the rate of change of length, `c n.(v_j - v_i)`; the plain step and [`backward_euler`] take the difference of
//!   two lengths, which agrees with it to the first order in `dt`. A rigid turn feels neither.
//! - Forces and pressures that a scene changes over time change evenly within a step, and each method takes them when it asks for the
//!   forces: the plain step at its start, the explicit ones at each of their stages, so that they keep their order while a load is
//!   ramped (a ramp that ends within a step costs that step all orders above 2), the implicit ones at its end.
//! - Rigid bodies that move, and contact, act on the velocities between the halves of the plain step, and springs relax, yield and
//!   tear after it: only that step has them. Scenes with both such and another integrator are refused.

pub mod backward_euler;
pub mod bogacki_shampine;
mod cells;
mod field;
mod newton;
mod of_world;
mod precise_lattice;
pub mod quasi_static;
mod reach;
pub mod rk4;
pub mod verlet;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use field::{Field, Real};
pub use precise_lattice::PreciseLattice;

pub use newton::Effort;

pub(super) use of_world::Integration;

#[cfg(doc)]
use super::world::World;

/// How a world goes on in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// The plain step: one evaluation of the forces, fused with all that acts. Order 1; keeps energy within bounds.
    #[default]
    SymplecticEuler,
    /// Position Verlet: one evaluation per step, order 2, also with dampers; keeps energy within bounds.
    Verlet,
    /// The classical method of Runge and Kutta: four evaluations per step, order 4.
    Rk4,
    /// The pair of Bogacki and Shampine, order 3, whose steps are divided until the error of each is below a tolerance.
    BogackiShampine,
    /// Backward Euler: stable at any step, order 1; damps what is fast.
    BackwardEuler,
    /// No motion: the settled shape at every moment of what is prescribed.
    QuasiStatic,
}

impl Method {
    /// Name as in scenes.
    pub fn name(self) -> &'static str {
        match self {
            Self::SymplecticEuler => "symplectic_euler",
            Self::Verlet => "verlet",
            Self::Rk4 => "rk4",
            Self::BogackiShampine => "bogacki_shampine",
            Self::BackwardEuler => "backward_euler",
            Self::QuasiStatic => "quasi_static",
        }
    }

    /// Its error goes with this power of the step; `None` where there is no motion to be wrong about.
    pub fn order(self) -> Option<u32> {
        match self {
            Self::SymplecticEuler | Self::BackwardEuler => Some(1),
            Self::Verlet => Some(2),
            Self::BogackiShampine => Some(3),
            Self::Rk4 => Some(4),
            Self::QuasiStatic => None,
        }
    }

    /// Evaluations of the forces per step; `None` where it finds out itself how many it needs.
    pub fn evaluations(self) -> Option<u64> {
        match self {
            Self::SymplecticEuler | Self::Verlet => Some(1),
            Self::Rk4 => Some(4),
            Self::BogackiShampine | Self::BackwardEuler | Self::QuasiStatic => None,
        }
    }

    /// Order and evaluations of the forces per step, in words.
    pub fn cost_in_words(self) -> String {
        let order = self.order().map_or("the settled shape".to_owned(), |order| format!("order {order}"));
        let evaluations = match self {
            Self::BogackiShampine => " with error control, four force evaluations per step and three per further part",
            Self::BackwardEuler => ", stable at any step, as many force evaluations as Newton's iteration takes",
            Self::QuasiStatic => ", as many force evaluations as Newton's iteration takes",
            Self::SymplecticEuler | Self::Verlet | Self::Rk4 => match self.evaluations() {
                Some(1) => ", one force evaluation per step",
                _ => ", four force evaluations per step",
            },
        };
        order + evaluations
    }

    /// True when no step is too long for it.
    pub fn is_stable_at_any_step(self) -> bool {
        matches!(self, Self::BackwardEuler | Self::QuasiStatic)
    }

    /// True when it takes a tolerance.
    pub fn has_tolerance(self) -> bool {
        matches!(self, Self::BogackiShampine | Self::BackwardEuler | Self::QuasiStatic)
    }
}

/// The numbers the state is kept in between steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Precision {
    /// f32, and the block kernels of the plain step. Implicit methods compute in f64 even so.
    #[default]
    Single,
    /// f64: the world's own state is that, rounded. Some ten times slower; for references.
    Double,
}

/// An integrator of a [`World`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Integrator {
    /// The method.
    pub method: Method,
    /// Tolerance of those that have one [m]: see [`bogacki_shampine`] and [`backward_euler`].
    pub tolerance: f64,
    /// In which numbers.
    pub precision: Precision,
}

impl Integrator {
    /// Tolerance unless a scene names one [m].
    pub const TOLERANCE: f64 = 1e-8;

    /// A method with the usual tolerance, in f32.
    pub fn new(method: Method) -> Self {
        Self { method, tolerance: Self::TOLERANCE, precision: Precision::Single }
    }
}

/// Particles that move by forces: all that an explicit integrator needs to know.
pub trait Mechanics {
    /// Numbers of the state.
    type Real: Real;

    /// Accelerations of the free particles, 0 for all others, times [`Mechanics::unit`]; lattice axes, overwritten.
    ///
    /// - `share`: of the step of the world, 0 at its start and 1 at its end, for what changes over time;
    /// - `displacement` [m], `velocity` [m/s]: one value per slot and axis; velocities count only when [`Mechanics::damped`].
    fn accelerations(
        &mut self,
        share: f64,
        displacement: &Field<Self::Real>,
        velocity: &Field<Self::Real>,
        out: &mut Field<Self::Real>,
    );

    /// Accelerations are given times this time [s].
    fn unit(&self) -> f64;

    /// True when accelerations depend on velocities.
    fn damped(&self) -> bool;
}

/// The plain step over [`Mechanics`], for f64: dampers read the rate of length itself.
fn symplectic_euler<M: Mechanics>(
    mechanics: &mut M,
    displacement: &mut Field<M::Real>,
    velocity: &mut Field<M::Real>,
    dt: f64,
) {
    let mut kick = field::zeros(displacement[0].len());
    mechanics.accelerations(0.0, displacement, velocity, &mut kick);
    field::add(velocity, [(dt / mechanics.unit(), &kick)]);
    field::add(displacement, [(dt, &*velocity)]);
}
