//! Verlet's method in its position form: half a step on, the forces there, half a step on.
//!
//! ```text
//! u_half = u + dt/2 v        v' = v + dt a(u_half, v_half)        u' = u_half + dt/2 v'
//! ```
//!
//! One evaluation of the forces per step, order 2. Without dampers the step is symplectic and can be taken back exactly: the
//! energy swings by `(w dt)^2 / 4` of a mode's, and does not drift. Dampers need the velocity in the middle of the step; it is
//! predicted as `v + dt/2 a` with the acceleration of the step before, which keeps order 2 and one evaluation.
//!
//! Stability: with `p = w^2 dt^2` and `q = c dt` (drag included) the step's polynomial has its root at -1 where
//!
//! ```text
//! p + 4 q = 4
//! ```
//!
//! and all roots within the unit circle before. Dampers cost twice what they cost the plain step, which reads old velocities and
//! ends at `p + 2 q = 4`.
//!
//! The middle of the step is also where forces and pressures act, so a load that changes with time is taken to order 2.
//!
//! Source: L. Verlet, "Computer experiments on classical fluids I", 1967; the position form by M. Tuckerman, B. J. Berne and G. J.
//! Martyna, "Reversible multiple time scale molecular dynamics", 1992.

use super::Mechanics;
use super::field::{Field, Real, add, combine, fit};

/// What is kept from step to step.
#[derive(Debug, Clone, Default)]
pub(super) struct Verlet<R> {
    acceleration: Field<R>,
    middle: Field<R>,
    /// What that of the step before is to be divided by [s]; 0 before the first.
    unit: f64,
}

impl<R: Real> Verlet<R> {
    pub(super) fn advance<M: Mechanics<Real = R>>(
        &mut self,
        mechanics: &mut M,
        displacement: &mut Field<R>,
        velocity: &mut Field<R>,
        dt: f64,
    ) {
        let slots = displacement[0].len();
        fit(&mut self.acceleration, slots);
        let kick = dt / mechanics.unit();
        add(displacement, [(0.5 * dt, velocity)]);
        if mechanics.damped() {
            fit(&mut self.middle, slots);
            let ahead = if self.unit > 0.0 { 0.5 * dt / self.unit } else { 0.0 };
            combine(&mut self.middle, velocity, [(ahead, &self.acceleration)]);
            mechanics.accelerations(0.5, displacement, &self.middle, &mut self.acceleration);
            self.unit = mechanics.unit();
        } else {
            mechanics.accelerations(0.5, displacement, velocity, &mut self.acceleration);
        }
        add(velocity, [(kick, &self.acceleration)]);
        add(displacement, [(0.5 * dt, velocity)]);
    }
}
