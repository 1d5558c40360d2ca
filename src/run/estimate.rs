//! How long a run will take on this machine, from a short part of it.

use std::time::{Duration, Instant};

use super::drive::Stepper;
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
    /// Time that a step of the schedule took [s], however many it was divided into.
    pub step: f64,
    /// Time to measure one frame and to gather its displacements [s]; compressing and writing them is not in it.
    pub frame: f64,
}

impl Pace {
    /// Steps a world as [`super::drive::drive`] does for about `budget`, at least three steps and at most all of the
    /// schedule's, with the operations that are due. The first step, which meets cold memory, is not timed. The world is
    /// left where it came to.
    ///
    /// # Errors
    /// If the state diverges within these steps.
    pub fn measure(
        world: &mut World,
        timeline: &mut Timeline,
        schedule: &Schedule,
        budget: Duration,
    ) -> Result<Self, StepError> {
        let mut stepper = Stepper::new(world, schedule, timeline);
        let (mut frame, mut events) = (1, Vec::new());
        let mut step = |world: &mut World| {
            while stepper.step(world, timeline, schedule.step_of_frame(frame), &mut events)?.is_none() {
                frame += 1;
            }
            Ok::<(), StepError>(())
        };
        step(world)?;
        let (started, begun) = (Instant::now(), world.time());
        let mut timed_steps = 0;
        let end = (schedule.steps as f64 - 0.5) * schedule.dt;
        while timed_steps < LEAST_STEPS || (started.elapsed() < budget && world.time() < end) {
            step(world)?;
            timed_steps += 1;
        }
        let step = started.elapsed().as_secs_f64() * schedule.dt / (world.time() - begun);
        let started = Instant::now();
        std::hint::black_box(balance(world));
        std::hint::black_box(cell_volume(world.lattice(), world.topology(), |particle| world.displacement(particle)));
        std::hint::black_box(world.displacements_mm());
        Ok(Self { timed_steps, step, frame: started.elapsed().as_secs_f64() })
    }

    /// Estimated time of a whole schedule at this pace [s]. Other load, cuts and steps divided later and a slow disk make it
    /// longer.
    pub fn of(&self, schedule: &Schedule) -> f64 {
        schedule.steps as f64 * self.step + (schedule.frames + 1) as f64 * self.frame
    }
}
