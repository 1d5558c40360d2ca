//! No motion: the settled shape under what holds, grabs and loads it, at the end of every step.
//!
//! A step moves what is prescribed to its next place and lets the rest settle to the nearest shape without forces: a lowest point of the
//! elastic energy and the loads, found from the shape before by Newton's iteration with conjugate gradients (`newton.rs`). Masses count
//! only as weight, dampers and drag not at all, and velocities are 0. What was cut loose and is held by nothing
//! stays where it is while no load acts on it; under gravity it has no settled shape, and the step is refused.
//!
//! The step is the time between two looks at the scene: by default one per frame. A blade cuts along straight ways of the tissue
//! between steps, so a cut that moves with the tissue wants shorter ones.
//!
//! Where the iteration does not end, what is prescribed is moved by half of its way first, or half of that.
//!
//! A pressure follows its faces: it is taken where the faces came to rest, again and again until nothing moves by more than ten times the
//! **tolerance, a length**, which also ends Newton's iteration.
//!
//! Always in f64. Where there are several settled shapes (a strip that buckles) it is the one that the shape before leads down to.
//!
//! Why not dynamic relaxation, that is the plain step with `[drag]`: it has to be told twice the frequency of the slowest swing and when
//! to stop, and its steps are as short as the stiffest tissue wants. Where both are known it is the faster of the two: a beam of
//! 4961 particles that sags by 17.5 mm took 3.6 s to 0.1 % of its sag against 5.5 s to 1e-5 mm
//! (`RAYON_NUM_THREADS=1 cargo test --test integrators price_of_a_settled -- --ignored --nocapture`, on a machine with other work).
//! Tissue that a cut left in threads can take thousands of conjugate gradients per iteration.
//!
//! Source: see `newton.rs`.

use super::backward_euler::prescribed;
use super::field::{Field, combine, fit, largest};
use super::newton::{Effort, Newton, Unsettled, Wanted};
use super::precise_lattice::PreciseLattice;

/// What is prescribed moves in parts as short as one over this of a step.
const MOST_PARTS: f64 = 256.0;
/// How often loads that follow are looked at again.
const MOST_ROUNDS: u32 = 50;

/// Buffers.
#[derive(Debug, Clone, Default)]
pub(super) struct QuasiStatic {
    newton: Newton,
    before: Field<f64>,
    shift: Field<f64>,
    moved: Field<f64>,
}

impl QuasiStatic {
    /// - `velocity`: of what is prescribed, that which leads to its next place; 0 afterwards.
    /// - `load`: takes the loads at given places; true when they follow the places.
    pub(super) fn advance(
        &mut self,
        lattice: &mut PreciseLattice,
        displacement: &mut Field<f64>,
        velocity: &mut Field<f64>,
        dt: f64,
        tolerance: f64,
        mut load: impl FnMut(&mut PreciseLattice, &Field<f64>) -> bool,
    ) -> Result<(), Unsettled> {
        let Self { newton, before, shift, moved } = self;
        let (mut left, mut part, mut rounds) = (dt, dt, 0);
        while left > 0.0 || rounds > 0 {
            let shifted = rounds == 0 && prescribed(lattice, velocity, part, shift);
            for axis in 0..3 {
                before[axis].clone_from(&displacement[axis]);
            }
            let follows = load(lattice, displacement);
            let wanted = Wanted {
                before,
                inertial: before,
                inertia: 0.0,
                dt: f64::INFINITY,
                shift: shifted.then_some(&*shift),
                tolerance,
            };
            if let Err(unsettled) = newton.settle(lattice, displacement, wanted) {
                displacement.clone_from(before);
                part *= 0.5;
                if !shifted || part < dt / MOST_PARTS {
                    return Err(unsettled);
                }
                continue;
            }
            fit(moved, lattice.slots());
            combine(moved, displacement, [(-1.0, &*before)]);
            let further = largest([(1.0, &*moved)]);
            if rounds == 0 {
                left -= part;
            }
            if follows && further > 10.0 * tolerance {
                rounds += 1;
                if rounds > MOST_ROUNDS {
                    return Err(Unsettled { step: further, slot: 0, iterations: MOST_ROUNDS });
                }
                continue;
            }
            rounds = 0;
            part = if left >= 2.0 * part { 2.0 * part } else { part.min(left) };
        }
        velocity.iter_mut().for_each(|axis| axis.fill(0.0));
        Ok(())
    }

    pub(super) fn effort(&self) -> Effort {
        self.newton.effort
    }
}
