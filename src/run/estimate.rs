//! How long a run will take on this machine, from a short part of it.

use std::time::{Duration, Instant};

use super::prepare::Schedule;
use crate::dynamics::measure::{balance, cell_volume};
use crate::dynamics::step_control::{Interval, StepControl};
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
    /// Steps a world for about `budget`, at least three steps and at most all of the schedule, with the operations that are due
    /// and the step divided where a run would. The first step, which meets cold memory, is not timed. The world is left
    /// where it came to.
    ///
    /// # Errors
    /// If the state diverges within these steps.
    pub fn measure(
        world: &mut World,
        timeline: &mut Timeline,
        schedule: &Schedule,
        budget: Duration,
    ) -> Result<Self, StepError> {
        let mut control = StepControl::new(world, schedule.limits);
        let most = schedule.steps.max(LEAST_STEPS + 1);
        let (mut planned, mut taken, mut started) = (0, 0_u64, Instant::now());
        'steps: while planned < most {
            let steps = if schedule.asked { 1 } else { most };
            planned += steps;
            let mut interval = Interval::new(planned as f64 * schedule.dt, schedule.dt, steps);
            while control.plan(world, &mut interval)? {
                timeline.advance(world);
                world.step()?;
                control.stepped(world, &mut interval);
                taken += 1;
                if taken == 1 {
                    started = Instant::now();
                } else if taken > LEAST_STEPS && started.elapsed() >= budget {
                    break 'steps;
                }
            }
        }
        let timed_steps = taken.saturating_sub(1).max(1);
        let step = started.elapsed().as_secs_f64() / timed_steps as f64;
        let started = Instant::now();
        std::hint::black_box(balance(world));
        std::hint::black_box(cell_volume(world.lattice(), world.topology(), |particle| world.displacement(particle)));
        std::hint::black_box(world.displacements_mm());
        Ok(Self { timed_steps, step, frame: started.elapsed().as_secs_f64() })
    }

    /// Estimated time of a whole schedule at this pace [s]. Other load, cuts still to come, steps that have to be
    /// divided later and a slow disk make it longer.
    pub fn of(&self, schedule: &Schedule) -> f64 {
        schedule.steps as f64 * self.step + (schedule.frames + 1) as f64 * self.frame
    }
}
