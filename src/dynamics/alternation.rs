//! Catches a step that is too long although nothing flies apart.
//!
//! Symplectic Euler leaves its stable range through the eigenvalue -1, with and without dampers: what grows changes its
//! sign in every step. Without dampers it grows until neighbours part beyond all bounds, which the check of every step
//! finds. With dampers the growing mode can shift its own limit and go on alternating within bounds: no number is bad, and
//! the motion is none that tissue would make. Motion that the step resolves does not look like that. With relative
//! velocities `w` of joined particles in two consecutive steps, a mode that turns by `theta` per step has, averaged over
//! its phase,
//!
//! ```text
//! |w - w'|^2 / |w + w'|^2 = tan^2(theta / 2) = q^2 / (1 - q^2),   q = dt over the limit
//! ```
//!
//! that is 1.8 at 0.8 of the limit, 2.6 at 0.85, 10 at 0.95, and without bound at the limit. Strongly damped modes alternate
//! below it, too (at 0.8 of the limit with an eigenvalue down to -0.6), but die down at once. So alternation counts only when
//! it dominates a block over many looks, at steps without rhythm so that no phase is met again and again, and does not
//! die down meanwhile.
//!
//! A body that tumbles so fast that turning outweighs alternation hides it: among bodies at 1.01 of the limit, those that
//! start with random speeds of a fifth of a pitch per step are not all caught.
//!
//! An audit of energy was the other choice: it needs all forces once more, and dampers hide in it what an instability gains.

use rayon::prelude::*;

use super::springs::Scratch;
use super::step_error::{StepError, step_too_long};
use super::workers::Worker;
use super::world::World;
use crate::geometry::Vector3;
use crate::kernel::alternation::{Alternation, alternation};
use crate::kernel::halo::gather_rows;
use crate::lattice::layout::{BLOCK_LEN, NO_BLOCK};
use crate::lattice::neighbours::NEIGHBOURS;
use crate::lattice::{Lattice, Topology};
use crate::material::Assembly;
use crate::splitmix::mix;

/// Looks of which one verdict is made.
const LOOKS: u32 = 32;
/// One step in so many is looked at, on average.
const STEPS_PER_LOOK: u64 = 16;
/// Alternation dominates beyond this ratio to what stays: 0.95 of the limit of one undamped mode.
const DOMINATES: f64 = 10.0;
/// Below so much, rounding and the last of a decaying motion may alternate as they like [pitches per step].
const LEAST: f64 = 1e-3;
/// Dies down: in the second half of the looks there is less than this share of the first.
const DIES_DOWN: f64 = 0.5;

/// What has been seen of the blocks of a world since the last verdict.
#[derive(Debug, Clone)]
pub(super) struct AlternationWatch {
    /// Per block: the halves of `|w - w'|^2 dt^2`, and the sum of `|w + w'|^2 dt^2` [m^2].
    blocks: Vec<([f64; 2], f64)>,
    looks: u32,
    /// What the last look found, kept for its memory.
    found: Vec<Alternation>,
}

impl AlternationWatch {
    pub(super) fn new(blocks: usize) -> Self {
        Self { blocks: vec![([0.0; 2], 0.0); blocks], looks: 0, found: Vec::new() }
    }

    /// The step with this number is to be looked at.
    pub(super) fn is_due(step: u64) -> bool {
        // Steps without rhythm.
        mix(step).is_multiple_of(STEPS_PER_LOOK)
    }

    /// Speeds below this need not be looked at: no spring can alternate enough [m/s].
    pub(super) fn slow(pitch: f64, dt: f64) -> f64 {
        // Four speeds make a difference of two relative velocities; a block has some 13 000 springs.
        LEAST * pitch / dt / 4.0 / 115.0
    }

    /// Takes note of one look at every block; the block that alternates most when it is time for a verdict and one does.
    pub(super) fn look(&mut self, dt: f64, pitch: f64, found: impl IntoIterator<Item = Alternation>) -> Option<usize> {
        let half = usize::from(self.looks >= LOOKS / 2);
        for ((alternating, staying), found) in self.blocks.iter_mut().zip(found) {
            alternating[half] += found.difference * dt * dt;
            *staying += found.sum * dt * dt;
        }
        self.looks += 1;
        if self.looks < LOOKS {
            return None;
        }
        let least = f64::from(LOOKS / 2) * (LEAST * pitch).powi(2);
        let unstable = |&([first, second], staying): &([f64; 2], f64)| {
            second >= least && second >= DIES_DOWN * first && first + second >= DOMINATES * staying
        };
        let blocks = self.blocks.iter().enumerate().filter(|(_, block)| unstable(block));
        let worst = blocks.max_by(|(_, a), (_, b)| a.0[1].total_cmp(&b.0[1])).map(|(block, _)| block);
        self.blocks.fill(Default::default());
        self.looks = 0;
        worst
    }
}

impl World {
    /// To be called between the new velocities of a step and its places; nearly free, see [the module](self).
    ///
    /// # Errors
    /// [`StepError::Alternates`].
    pub(super) fn watch_alternation(&mut self, fastest: &[f32]) -> Result<(), StepError> {
        if self.alternation.is_none() || !AlternationWatch::is_due(self.steps()) {
            return Ok(());
        }
        let (dt, pitch) = (self.dt(), self.lattice.pitch);
        let mut watch = self.alternation.take();
        let worst = watch.as_mut().and_then(|watch| {
            let mut found = std::mem::take(&mut watch.found);
            self.alternations(fastest, &mut found);
            let worst = watch.look(dt, pitch, found.iter().copied());
            watch.found = found;
            worst
        });
        self.alternation = watch;
        let Some(block) = worst else { return Ok(()) };
        let slots = block * BLOCK_LEN..(block + 1) * BLOCK_LEN;
        let change = |particle: u32| {
            let slot = self.layout.slot[particle as usize] as usize;
            Vector3::from([0, 1, 2].map(|axis| f64::from(self.velocity[axis][slot] - self.next_velocity[axis][slot])))
        };
        Err(alternates(
            (&self.lattice, &self.topology, &self.assembly),
            (self.time(), self.steps(), dt),
            slots.filter_map(|slot| self.layout.particle_of_slot(&self.lattice, slot)),
            change,
        ))
    }

    /// One look at every block, in place of what was found before.
    fn alternations(&self, fastest: &[f32], found: &mut Vec<Alternation>) {
        let slow = AlternationWatch::slow(self.lattice.pitch, self.dt()).powi(2);
        let fast = |block: u32| f64::from(fastest[block as usize].max(self.fastest_squared[block as usize])) > slow;
        let look = |block: usize| {
            let (neighbours, rows) = (&self.layout.neighbours[block], self.layout.rows[block]);
            if !neighbours.iter().any(|&other| other != NO_BLOCK && fast(other)) {
                return Alternation::default();
            }
            // Between steps the velocities to come are those of the step before.
            let Worker { scratch, .. } = &mut *self.workers.own();
            let Scratch { velocity: now, displacement: before, .. } = &mut **scratch;
            for (field, halo) in
                self.velocity.iter().zip(now.iter_mut()).chain(self.next_velocity.iter().zip(before.iter_mut()))
            {
                gather_rows(field, neighbours, rows, halo);
            }
            alternation(now.each_ref(), before.each_ref(), self.living_springs(block))
        };
        (0..self.layout.blocks.len()).into_par_iter().map(look).collect_into_vec(found);
    }
}

/// The error, at the one of some particles that alternates most.
///
/// - `change`: the change of a particle's velocity in the step [m/s].
pub(super) fn alternates(
    (lattice, topology, assembly): (&Lattice, &Topology, &Assembly),
    (time, steps, dt): (f64, u64, f64),
    particles: impl Iterator<Item = u32>,
    change: impl Fn(u32) -> Vector3,
) -> StepError {
    let alternating = |particle: u32| {
        let alive = topology.alive()[particle as usize];
        let joined = (0..NEIGHBOURS).filter(|direction| alive >> direction & 1 == 1);
        let others = joined.filter_map(|direction| lattice.neighbour(particle, direction));
        others.map(|other| (change(other) - change(particle)).norm()).fold(0.0, f64::max)
    };
    let all = particles.map(|particle| (alternating(particle), particle));
    let (speed, particle) = all.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or_default();
    StepError::Alternates {
        time: time + dt,
        step: steps + 1,
        place: lattice.rest_place(particle),
        // Half of the change is there, half is back.
        moves: 0.5 * speed * dt / lattice.pitch,
        dt,
        cause: step_too_long(lattice, topology, assembly, dt).unwrap_or_else(|| {
            "at rest the step is stable, so the tissue is deformed until it is no more: ask for a smaller time.dt, or step \
             as yawara run does, which divides the step"
                .to_owned()
        }),
    }
}
