//! Steps a world through its schedule and shows every frame to an observer.

use std::time::Instant;

use super::prepare::Schedule;
use super::step_times::StepTime;
use crate::dynamics::measure::{Balance, CellVolume, balance, cell_volume};
use crate::dynamics::step_control::{Interval, StepControl, StepCounts};
use crate::dynamics::timeline::{Event, Timeline};
use crate::dynamics::{StepError, World};

/// A frame, when it is due.
pub struct Frame<'a> {
    /// Number of the frame, from 0.
    pub number: u64,
    /// The world now.
    pub world: &'a World,
    /// Energy and momentum now.
    pub balance: Balance,
    /// Volume of the cells that are whole, now and at rest.
    pub volume: CellVolume,
}

/// Watches a run. Everything has an empty default.
pub trait Observer {
    /// Why watching may fail, for example a full disk.
    type Error;

    /// A frame is due.
    ///
    /// # Errors
    /// Ends the run.
    fn frame(&mut self, _frame: &Frame<'_>) -> Result<(), Self::Error> {
        Ok(())
    }

    /// An operation began or ended.
    ///
    /// # Errors
    /// Ends the run.
    fn event(&mut self, _event: &Event) -> Result<(), Self::Error> {
        Ok(())
    }

    /// A step was taken, planned or divided. Called often: to be cheap.
    fn step(&mut self, _world: &World) {}
}

/// Nobody watches.
impl Observer for () {
    type Error = std::convert::Infallible;
}

/// Why a run ended before its time.
#[derive(Debug, thiserror::Error)]
pub enum DriveError<E> {
    /// The state diverged; frames already shown stay valid.
    #[error(transparent)]
    Step(#[from] StepError),
    /// The observer could not go on.
    #[error("the run was stopped while its results were written")]
    Observer(#[source] E),
}

/// Runs a schedule: operations, steps, frames. Frame 0 shows the world as it is handed in.
///
/// The step of the schedule is divided where the tissue is deformed too far for it, see [`step_control`]; operations
/// follow the shorter steps, frames come when they are due. Steps that the scene leaves to the program end where operations
/// begin and end, for a force that came late would be an error of first order whatever the integrator; where the scene
/// names its step, operations wait for the next.
///
/// # Errors
/// If the state diverges, or the observer fails. The world is left where the run ended.
///
/// [`step_control`]: crate::dynamics::step_control
pub fn drive<O: Observer>(
    world: &mut World,
    timeline: &mut Timeline,
    schedule: &Schedule,
    observer: &mut O,
) -> Result<StepCounts, DriveError<O::Error>> {
    let mut stepper = Stepper::new(world, schedule, timeline);
    let mut events = Vec::new();
    let show = |number: u64, world: &World, observer: &mut O| {
        let volume = cell_volume(world.lattice(), world.topology(), |particle| world.displacement(particle));
        let frame = Frame { number, world, balance: balance(world), volume };
        observer.frame(&frame).map_err(DriveError::Observer)
    };
    show(0, world, observer)?;
    for number in 1..=schedule.frames {
        loop {
            let step = stepper.step(world, timeline, schedule.step_of_frame(number), &mut events);
            for event in events.drain(..) {
                observer.event(&event).map_err(DriveError::Observer)?;
            }
            if step?.is_none() {
                break;
            }
            observer.step(world);
        }
        if number == schedule.frames {
            for event in timeline.finish(world) {
                observer.event(&event).map_err(DriveError::Observer)?;
            }
        }
        show(number, world, observer)?;
    }
    Ok(stepper.control.counts())
}

/// Takes a world through the planned steps of a schedule, divided where the tissue asks for it.
pub(super) struct Stepper {
    control: StepControl,
    schedule: Schedule,
    /// When the schedule begins: a world may have been stepped before [s].
    start: f64,
    /// Steps of the schedule that are begun, in whole frames unless the scene named the step.
    planned: u64,
    interval: Interval,
    /// When operations begin and end that have not yet, latest first [s].
    turns: Vec<f64>,
}

impl Stepper {
    pub(super) fn new(world: &World, schedule: &Schedule, timeline: &Timeline) -> Self {
        let turns = if schedule.asked { Vec::new() } else { timeline.turns() };
        let start = world.time();
        Self {
            control: StepControl::new(world, schedule.limits),
            schedule: *schedule,
            start,
            planned: 0,
            interval: Interval::new(start, schedule.dt, 0),
            turns,
        }
    }

    /// Takes the world one step on, with the operations that are due before it, and tells what each part took; `None` when it
    /// stands where step `due` of the schedule ends.
    ///
    /// - `events`: gets what happened, also where the step fails.
    pub(super) fn step(
        &mut self,
        world: &mut World,
        timeline: &mut Timeline,
        due: u64,
        events: &mut Vec<Event>,
    ) -> Result<Option<StepTime>, StepError> {
        // Handed to the workers once: each of the parts is short, and asks them often.
        rayon::scope(|_| {
            let mut time = StepTime::default();
            let took = |began: Instant| began.elapsed().as_secs_f64();
            let began = Instant::now();
            if !self.ready(world, due)? {
                return Ok(None);
            }
            time.control = took(began);
            let began = Instant::now();
            events.extend(timeline.advance(world));
            time.operations = took(began);
            let began = Instant::now();
            world.step()?;
            time.step = took(began);
            let began = Instant::now();
            self.control.stepped(world, &mut self.interval);
            time.control += took(began);
            Ok(Some(time))
        })
    }

    /// Gives the world its next step; false when it stands where step `due` of the schedule ends.
    fn ready(&mut self, world: &mut World, due: u64) -> Result<bool, StepError> {
        loop {
            if self.control.plan(world, &mut self.interval)? {
                return Ok(true);
            }
            if self.planned >= due {
                return Ok(false);
            }
            self.interval = self.next_interval(due);
        }
    }

    /// The next stretch of equal steps: to where step `due` of the schedule ends, or to a turn before that. Steps that
    /// the scene named are kept one by one.
    fn next_interval(&mut self, due: u64) -> Interval {
        let dt = self.schedule.dt;
        let from = self.interval.until();
        // As near as this, a turn is where a step ends anyway.
        let close = 1e-6 * dt;
        while self.turns.last().is_some_and(|turn| *turn <= from + close) {
            self.turns.pop();
        }
        let end = self.start + due as f64 * dt;
        let until = match self.turns.last() {
            Some(&turn) if turn < end - close => turn,
            _ if self.schedule.asked => {
                self.planned += 1;
                self.start + self.planned as f64 * dt
            }
            _ => {
                self.planned = due;
                end
            }
        };
        let steps = (until - from) / dt;
        let whole = steps.round();
        // What is no whole number of steps is stepped in shorter ones.
        if (steps - whole).abs() < 1e-6 {
            Interval::new(until, dt, whole as u64)
        } else {
            Interval::new(until, (until - from) / steps.ceil(), steps.ceil() as u64)
        }
    }
}
