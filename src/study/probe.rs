//! What runs of a pitch will take, from a part of one.
//!
//! The plain step goes first, up to the middle of the scene where there is time for that: by then blades cut and loads act, which
//! decides what steps cost that are divided or solved for. Every other way goes on for some steps from where the last one left the world.

use std::time::{Duration, Instant};

use super::choice::Choice;
use super::ledger::Pace;
use crate::dynamics::step_control::{Interval, StepControl};
use crate::dynamics::timeline::Timeline;
use crate::dynamics::{StepError, World};
use crate::run::prepare::Schedule;

/// All ways but the first are timed for about this long; one step is taken however long it is.
const EACH: Duration = Duration::from_millis(150);

/// Times steps of some choices on one world.
///
/// - `ways`: the choices with their steps; the plain step first.
/// - `most`: time for that one.
///
/// A way that fails is left out, with all that come after it.
///
/// # Errors
/// If the first fails.
pub fn paces(
    world: &mut World,
    timeline: &mut Timeline,
    ways: &[(Choice, Schedule)],
    most: Duration,
) -> Result<Vec<Pace>, StepError> {
    let mut paces = Vec::new();
    for (number, (choice, schedule)) in ways.iter().enumerate() {
        let most = if number == 0 { most } else { EACH };
        world.set_integrator(choice.way());
        match time_steps(world, timeline, schedule, most) {
            Ok(seconds) => paces.push(Pace { choice: choice.clone(), seconds }),
            Err(error) if number == 0 => return Err(error),
            Err(_) => break,
        }
    }
    Ok(paces)
}

/// What stepping a whole schedule takes at the present pace \[s\]. The first step meets cold memory and is not counted, unless it is
/// the only one.
fn time_steps(
    world: &mut World,
    timeline: &mut Timeline,
    schedule: &Schedule,
    most: Duration,
) -> Result<f64, StepError> {
    let mut control = StepControl::new(world, schedule.limits);
    let steps = (schedule.steps / 2).max(1);
    let mut interval = Interval::new(world.time() + steps as f64 * schedule.dt, schedule.dt, steps);
    let started = Instant::now();
    let (mut begun, mut from, mut cold, mut seconds) = (started, world.time(), true, 0.0);
    while started.elapsed() < most && control.plan(world, &mut interval)? {
        timeline.advance(world);
        world.step()?;
        control.stepped(world, &mut interval);
        seconds = begun.elapsed().as_secs_f64() / (world.time() - from);
        if std::mem::take(&mut cold) {
            (begun, from) = (Instant::now(), world.time());
        }
    }
    Ok(seconds * schedule.dt * schedule.steps as f64)
}
