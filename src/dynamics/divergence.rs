//! Whether a step came out sound: no velocity is not a number, and no joined particles part faster than the lattice can follow.

use rayon::prelude::*;

use super::springs::block_of;
use super::step_error::{StepError, likely_cause};
use super::world::World;
use crate::geometry::Vector3;
use crate::lattice::layout::{BLOCK_LEN, NO_BLOCK};
use crate::lattice::neighbours::NEIGHBOURS;

/// Joined particles that part further than this in one step outrun every wave the lattice can carry [pitches].
pub(super) const LONGEST_MOVE: f64 = 2.0;

impl World {
    /// Nearly free while everything is slow: one number per block. Otherwise fast blocks are looked at more closely.
    pub(super) fn check(&self, fastest: &[f32]) -> Result<(), StepError> {
        let limit = LONGEST_MOVE * self.lattice.pitch / self.dt;
        // Two particles slower than half the limit cannot part faster than the limit.
        let fast = |squared: f32| f64::from(squared).sqrt() > 0.5 * limit;
        if !fastest.iter().any(|&squared| fast(squared)) {
            return Ok(());
        }
        let spans: Vec<VelocitySpan> =
            (0..fastest.len()).into_par_iter().map(|block| self.velocity_span(block)).collect();
        let parting = (0..fastest.len()).into_par_iter().find_map_first(|block| {
            if !fast(fastest[block]) {
                return None;
            }
            let around = self.layout.neighbours[block].iter().filter(|&&neighbour| neighbour != NO_BLOCK);
            let span = around.fold(VelocitySpan::EMPTY, |span, &other| span.joined(spans[other as usize]));
            // Together, however fast: a body in flight.
            if fastest[block].is_finite() && span.width() <= limit {
                return None;
            }
            self.parting(block, fastest[block].is_finite()).filter(|&(speed, _)| speed > limit)
        });
        let Some((speed, particle)) = parting else { return Ok(()) };
        Err(StepError::Diverged {
            time: self.time() + self.dt,
            step: self.steps + 1,
            place: self.lattice.rest_place(particle),
            speed,
            moves: speed * self.dt / self.lattice.pitch,
            dt: self.dt,
            cause: likely_cause(&self.lattice, &self.topology, &self.assembly, self.dt),
        })
    }

    /// Smallest and largest velocity of a block's particles that have springs.
    fn velocity_span(&self, block: usize) -> VelocitySpan {
        let alive = self.springs.alive(block);
        let mut span = VelocitySpan::EMPTY;
        for axis in 0..3 {
            let velocity: &[f32; BLOCK_LEN] = block_of(&self.velocity[axis], block);
            for (&v, _) in velocity.iter().zip(alive).filter(|&(_, &springs)| springs != 0) {
                span.min[axis] = span.min[axis].min(v);
                span.max[axis] = span.max[axis].max(v);
            }
        }
        span
    }

    /// The largest speed at which a particle of a block and one it is joined to part, and the particle; infinite for a
    /// velocity that is not finite (or whose square is not).
    fn parting(&self, block: usize, finite: bool) -> Option<(f64, u32)> {
        let slots = block * BLOCK_LEN..(block + 1) * BLOCK_LEN;
        let particles = slots.filter_map(|slot| self.layout.particle_of_slot(&self.lattice, slot));
        let speed = |particle: u32| {
            let own = self.velocity(particle);
            let countable = own.norm_squared() < f64::from(f32::MAX);
            if !finite && !countable {
                return f64::INFINITY;
            }
            let alive = self.topology.alive()[particle as usize];
            (0..NEIGHBOURS)
                .filter(|d| alive >> d & 1 == 1)
                .filter_map(|direction| self.lattice.neighbour(particle, direction))
                .map(|other| (self.velocity(other) - own).norm())
                .fold(0.0, f64::max)
        };
        particles.map(|particle| (speed(particle), particle)).max_by(|a, b| a.0.total_cmp(&b.0))
    }
}

/// Smallest and largest velocity along each axis [m/s]. NaN is left out: it is found by its speed.
#[derive(Debug, Clone, Copy)]
struct VelocitySpan {
    min: [f32; 3],
    max: [f32; 3],
}

impl VelocitySpan {
    const EMPTY: Self = Self { min: [f32::MAX; 3], max: [f32::MIN; 3] };

    fn joined(self, other: Self) -> Self {
        Self {
            min: [0, 1, 2].map(|axis| self.min[axis].min(other.min[axis])),
            max: [0, 1, 2].map(|axis| self.max[axis].max(other.max[axis])),
        }
    }

    /// No two velocities of the span differ by more [m/s].
    fn width(&self) -> f64 {
        let width = |axis: usize| (f64::from(self.max[axis]) - f64::from(self.min[axis])).max(0.0);
        Vector3::new(width(0), width(1), width(2)).norm()
    }
}
