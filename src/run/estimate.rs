//! How long a run will take on this machine, from a short part of it.

use std::time::{Duration, Instant};

use super::prepare::Schedule;
use crate::dynamics::measure::{balance, cell_volume};
use crate::dynamics::timeline::Timeline;
use crate::dynamics::{StepError, World};

/// At least so many steps are timed, however long they take.
const LEAST_STEPS: u64 = 3;

/// What a part of a run took.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pace {
    /// Steps that were timed.
    pub timed_steps: u64,
    /// Time of one of them [s].
    pub step: f64,
    /// Time to measure one frame and to gather its displacements [s]; compressing and writing them is not in it.
    pub frame: f64,
}

impl Pace {
    /// Steps a world for about `budget`, at least three steps and at most all of the schedule's, with the operations that are
    /// due. The first step, which meets cold memory, is not timed. The world is left where it came to.
    ///
    /// # Errors
    /// If the state diverges within these steps.
    pub fn measure(
        world: &mut World,
        timeline: &mut Timeline,
        schedule: &Schedule,
        budget: Duration,
    ) -> Result<Self, StepError> {
        timeline.advance(world);
        world.step()?;
        let started = Instant::now();
        let mut timed_steps = 0;
        while timed_steps < LEAST_STEPS || (started.elapsed() < budget && timed_steps + 1 < schedule.steps) {
            timeline.advance(world);
            world.step()?;
            timed_steps += 1;
        }
        let step = started.elapsed().as_secs_f64() / timed_steps as f64;
        let started = Instant::now();
        std::hint::black_box(balance(world));
        std::hint::black_box(cell_volume(world.lattice(), world.topology(), |particle| world.displacement(particle)));
        std::hint::black_box(world.displacements_mm());
        Ok(Self { timed_steps, step, frame: started.elapsed().as_secs_f64() })
    }

    /// Estimated time of a whole schedule at this pace [s]. Other load, cuts still to come and a slow disk make it longer.
    pub fn of(&self, schedule: &Schedule) -> f64 {
        schedule.steps as f64 * self.step + (schedule.frames + 1) as f64 * self.frame
    }
}
