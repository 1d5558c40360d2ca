//! Where the time of a run's steps goes: operations, step control, the steps themselves. Frames are neither measured nor
//! kept.

use super::drive::Stepper;
use super::prepare::Schedule;
use crate::dynamics::timeline::Timeline;
use crate::dynamics::{StepError, World};

/// What one step took [s].
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct StepTime {
    /// Choosing its length, which may look at the shape.
    pub control: f64,
    /// What begins, moves or ends before it: cuts above all.
    pub operations: f64,
    /// The step.
    pub step: f64,
}

impl StepTime {
    /// All of it [s].
    pub fn total(&self) -> f64 {
        self.control + self.operations + self.step
    }
}

/// Steps a world through its whole schedule as [`super::drive::drive`] does, and tells what each step took.
///
/// # Errors
/// If the state diverges.
pub fn step_times(world: &mut World, timeline: &mut Timeline, schedule: &Schedule) -> Result<Vec<StepTime>, StepError> {
    let mut stepper = Stepper::new(world, schedule, timeline);
    let (mut times, mut events) = (Vec::new(), Vec::new());
    for frame in 1..=schedule.frames {
        while let Some(time) = stepper.step(world, timeline, schedule.step_of_frame(frame), &mut events)? {
            times.push(time);
        }
    }
    timeline.finish(world);
    Ok(times)
}
