//! Backward Euler: stable at any step.
//!
//! ```text
//! u' = u + dt v'        M v' = M v + dt (f(u', v') + loads)
//! ```
//!
//! solved as the lowest point of an energy, see `newton.rs`: inertia's `1/2 m |u' - u - dt v|^2 / dt^2`, the elastic energy, and what
//! dampers take. The damper is the paper's own, `c (l' - l) / dt` with `l` the length when the step began: it is the gradient of
//! `c / (2 dt) (l' - l)^2`, and a rigid turn does not feel it. Drag is `rate m (u' - u) / dt`, read at the end of the step as all
//! else.
//!
//! Order 1. No step is too long: of a mode of frequency `w`, a step leaves `1 / (1 + w^2 dt^2)` of the energy, so what is fast against the step dies
//! down at once and what is slow is kept; every swing is damped like `exp(-w^2 dt t / 2)`. Where the energy is convex (strains
//! that press no spring by much) the sum of kinetic and elastic energy never grows; from any shape, elastic energy stays below the
//! sum at the start of the step.
//!
//! Cost: some 3 to 8 Newton iterations per step, each of one or two evaluations of the forces and 5 to a hundred products with the
//! tangent, the more the longer the step. A product costs about four plain steps. That pays only where the plain step is far
//! shorter than what is looked at, because stiff tissue meets soft or only the slow part of a motion matters;
//! `RAYON_NUM_THREADS=1 cargo test --test integrators price_of_the_same_error -- --ignored --nocapture` prints where. For a small block with a
//! hard kernel, drawn aside within 0.3 s and to 0.3 % of its motion: all soft, 1.5 s against 0.04 s of the plain step; a kernel
//! 1e4 times as stiff, 1.8 s against 11 s; 1e6 times, 3.4 s against 62 s. The iteration ends when it would move no particle by more
//! than the **tolerance, a length**.
//!
//! Always in f64, with the memory that takes, see [`PreciseLattice`]: energies decide, and f32 could not tell them apart. The
//! state of the world is rounded to f32 after each step unless it is wanted in f64 as well; between steps the f64 state is kept.
//!
//! Where the iteration does not end (tissue that falls through itself, a shape that snaps) the step is taken in halves, and these
//! in halves, down to 1/4096 of it.
//!
//! A pressure acts as at the places where the step begins.
//!
//! Why not of order 2: the trapezoidal rule and the implicit midpoint leave what is fast against the step swinging for ever, with
//! the sign turned in each, and BDF2 grows without bound where the step changes quickly, as it does when frames end. Where order counts
//! the explicit methods are cheaper, see the module above.
//!
//! Why not XPBD (one sweep of corrections over all springs and cells per step): stable at any step as well, but what its sweep leaves
//! undone makes tissue too soft until steps are nearly as short as the soft tissue's own, and a sweep costs many plain steps.
//!
//! Source: D. Baraff and A. Witkin, "Large steps in cloth simulation", 1998; the potential: R. Radovitzky and M. Ortiz, "Error estimation
//! and adaptive meshing in strongly nonlinear dynamic problems", 1999.

use super::field::{Field, combine, fit};
use super::newton::{Effort, Newton, Unsettled, Wanted};
use super::precise_lattice::PreciseLattice;

/// A step is divided into parts as short as one over this.
const MOST_PARTS: f64 = 4096.0;

/// Buffers.
#[derive(Debug, Clone, Default)]
pub(super) struct BackwardEuler {
    newton: Newton,
    before: Field<f64>,
    inertial: Field<f64>,
    shift: Field<f64>,
}

impl BackwardEuler {
    /// - `velocity`: of what is prescribed, that which leads to its next place.
    pub(super) fn advance(
        &mut self,
        lattice: &mut PreciseLattice,
        displacement: &mut Field<f64>,
        velocity: &mut Field<f64>,
        dt: f64,
        tolerance: f64,
    ) -> Result<(), Unsettled> {
        let Self { newton, before, inertial, shift } = self;
        fit(inertial, lattice.slots());
        let (mut left, mut part) = (dt, dt);
        while left > 0.0 {
            for axis in 0..3 {
                before[axis].clone_from(&displacement[axis]);
            }
            let moved = prescribed(lattice, velocity, part, shift);
            // s (u - w) is what inertia and drag resist together.
            let rates = [part.powi(-2), lattice.drag() / part];
            let inertia = rates[0] + rates[1];
            combine(inertial, before, [(part * rates[0] / inertia, &*velocity)]);
            let shift = moved.then_some(&*shift);
            let wanted = Wanted { before, inertial, inertia, dt: part, shift, tolerance };
            if let Err(unsettled) = newton.settle(lattice, displacement, wanted) {
                displacement.clone_from(before);
                part *= 0.5;
                if part < dt / MOST_PARTS {
                    return Err(unsettled);
                }
                continue;
            }
            for axis in 0..3 {
                let moved = displacement[axis].iter().zip(&before[axis]);
                velocity[axis].iter_mut().zip(moved).for_each(|(v, (now, then))| *v = (now - then) / part);
            }
            newton.effort.parts += 1;
            // Parts are halves of halves, so the last one ends exactly.
            left -= part;
            part = if left >= 2.0 * part { 2.0 * part } else { part.min(left) };
        }
        Ok(())
    }

    pub(super) fn effort(&self) -> Effort {
        self.newton.effort
    }
}

/// How far what is not free moves in a step; false when it does not.
pub(super) fn prescribed(lattice: &PreciseLattice, velocity: &Field<f64>, dt: f64, shift: &mut Field<f64>) -> bool {
    fit(shift, lattice.slots());
    let mut moved = false;
    for axis in 0..3 {
        let of_slot = velocity[axis].iter().zip(lattice.free());
        for (shift, (velocity, free)) in shift[axis].iter_mut().zip(of_slot) {
            *shift = if *free > 0.0 { 0.0 } else { velocity * dt };
            moved |= *shift != 0.0;
        }
    }
    moved
}
