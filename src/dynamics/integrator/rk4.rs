//! The classical method of Runge and Kutta, for places and velocities together.
//!
//! ```text
//! a1 = a(u, v)                          a2 = a(u + dt/2 v, v + dt/2 a1)
//! a3 = a(u + dt/2 v + dt^2/4 a1, v + dt/2 a2)
//! a4 = a(u + dt v + dt^2/2 a2, v + dt a3)
//! u' = u + dt v + dt^2/6 (a1 + a2 + a3)       v' = v + dt/6 (a1 + 2 a2 + 2 a3 + a4)
//! ```
//!
//! Four evaluations of the forces per step, order 4. Stable for undamped modes while `w dt < 2 sqrt(2)`; a half disc of radius
//! 2.61 in the left half plane lies within the stable region, so that with dampers (and drag) `max(w, c) dt < 2.61` will do
//! for any pair of matrices. Per evaluation that is a third of the steps the plain step may take: what is gained is accuracy.
//! An undamped mode loses `(w dt)^6 / 72` of its energy per step.
//!
//! Source: W. Kutta, "Beitrag zur naeherungsweisen Integration totaler Differentialgleichungen", 1901.

use super::Mechanics;
use super::field::{Field, Real, add, combine, fit};

/// Buffers; nothing in them is kept.
#[derive(Debug, Clone, Default)]
pub(super) struct Rk4<R> {
    a: [Field<R>; 4],
    stage: [Field<R>; 2],
}

impl<R: Real> Rk4<R> {
    pub(super) fn advance<M: Mechanics<Real = R>>(
        &mut self,
        mechanics: &mut M,
        displacement: &mut Field<R>,
        velocity: &mut Field<R>,
        dt: f64,
    ) {
        let Self { a: [a1, a2, a3, a4], stage: [u, v] } = self;
        for buffer in [&mut *a1, a2, a3, a4, u, v] {
            fit(buffer, displacement[0].len());
        }
        // Accelerations come times the unit.
        let kick = dt / mechanics.unit();
        mechanics.accelerations(0.0, displacement, velocity, a1);
        combine(u, displacement, [(0.5 * dt, velocity)]);
        combine(v, velocity, [(0.5 * kick, a1)]);
        mechanics.accelerations(0.5, u, v, a2);
        add(u, [(0.25 * dt * kick, a1)]);
        combine(v, velocity, [(0.5 * kick, a2)]);
        mechanics.accelerations(0.5, u, v, a3);
        combine(u, displacement, [(dt, velocity), (0.5 * dt * kick, a2)]);
        combine(v, velocity, [(kick, a3)]);
        mechanics.accelerations(1.0, u, v, a4);
        let sixth = dt * kick / 6.0;
        add(displacement, [(dt, velocity), (sixth, a1), (sixth, a2), (sixth, a3)]);
        let (sixth, third) = (kick / 6.0, kick / 3.0);
        add(velocity, [(sixth, a1), (third, a2), (third, a3), (sixth, a4)]);
    }
}
