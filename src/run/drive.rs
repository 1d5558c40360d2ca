//! Steps a world through its schedule and shows every frame to an observer.

use super::prepare::Schedule;
use crate::dynamics::measure::{Balance, CellVolume, balance, cell_volume};
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

    /// A step was taken. Called often: to be cheap.
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
/// # Errors
/// If the state diverges, or the observer fails. The world is left where the run ended.
pub fn drive<O: Observer>(
    world: &mut World,
    timeline: &mut Timeline,
    schedule: &Schedule,
    observer: &mut O,
) -> Result<(), DriveError<O::Error>> {
    let show = |number: u64, world: &World, observer: &mut O| {
        let volume = cell_volume(world.lattice(), world.topology(), |particle| world.displacement(particle));
        let frame = Frame { number, world, balance: balance(world), volume };
        observer.frame(&frame).map_err(DriveError::Observer)
    };
    show(0, world, observer)?;
    for number in 1..=schedule.frames {
        while world.steps() < schedule.step_of_frame(number) {
            for event in timeline.advance(world) {
                observer.event(&event).map_err(DriveError::Observer)?;
            }
            world.step()?;
            observer.step(world);
        }
        if number == schedule.frames {
            for event in timeline.finish(world) {
                observer.event(&event).map_err(DriveError::Observer)?;
            }
        }
        show(number, world, observer)?;
    }
    Ok(())
}
