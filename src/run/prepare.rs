//! From volumes to a lattice that is ready to move: organs, pitch, materials, time step.

use std::path::PathBuf;

use crate::dynamics::World;
use crate::dynamics::effects::sleep::Sleep;
use crate::dynamics::integrator::{Integrator, Method};
use crate::dynamics::stable_dt::{Limits, SAFETY};
use crate::geometry::Point3;
use crate::kernel::dispatch::{Arithmetic, InstructionSet};
use crate::lattice::build::{BuildLatticeError, build};
use crate::lattice::cells::build_cells;
use crate::lattice::{Lattice, Topology};
use crate::material::Assembly;
use crate::scene::resolved::{Body, Model, PropertyKind, Scene, TimeSpec};
use crate::volume::ResampleError;

use super::inputs::Inputs;
use super::materials::{Materials, assemble};
pub use super::materials::{Spread, Spreads};
use super::organs::{Organs, organs};
use super::range;

/// More steps than this would take years: as many as a scene may ask for by its own step.
const MOST_STEPS: f64 = 1e12;

/// A step that was asked for is refused only after looking for the true limit as hard as a run of so many steps would.
const WORTH_REFUSING: f64 = 1e4;

/// A step of backward Euler that is not asked for, over the plain step's: its error is then of the size that the frames of
/// an animation show, and each step still costs less than the plain steps it replaces where stiff and soft tissue meet.
const LONG_STEP: f64 = 20.0;

/// How far particles may be off because blocks sleep, over the pitch.
const SLEEP_TOLERANCE: f64 = 0.01;

/// Why a scene cannot be turned into a world.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PrepareError {
    /// An organ selects no voxel.
    #[error("organ `{organ}`: no voxel has {selection}; {hint}")]
    EmptyOrgan {
        /// Name of the organ.
        organ: String,
        /// What it asks for.
        selection: String,
        /// What the volume holds instead.
        hint: String,
    },
    /// Every organ is rigid.
    #[error("every organ is rigid, so nothing can deform; give at least one organ a material instead of rigid = true")]
    AllRigid,
    /// An organ that was there is lost at this pitch.
    #[error(
        "organ `{organ}`: none of its {voxels} voxels is left at a pitch of {pitch} mm; choose a finer lattice.pitch"
    )]
    LostOrgan {
        /// Name of the organ.
        organ: String,
        /// Voxels it has in the volume.
        voxels: usize,
        /// The pitch [mm].
        pitch: f64,
    },
    /// A volume of moduli or densities has none where an organ needs one.
    #[error(
        "organ `{organ}`: {} gives a {} of {found} {} at ({:.1}, {:.1}, {:.1}) mm (RAS+), expected a number above 0 in \
         every voxel of the organ; mend the volume or restrict the organ",
        file.display(), kind.name(), kind.unit(), place.x, place.y, place.z
    )]
    Property {
        /// Name of the organ.
        organ: String,
        /// What the volume should hold.
        kind: PropertyKind,
        /// The volume.
        file: PathBuf,
        /// Where, RAS+ [mm].
        place: Point3,
        /// What it gives, in the unit of `kind`.
        found: f64,
    },
    /// The lattice cannot be built.
    #[error(transparent)]
    Lattice(#[from] BuildLatticeError),
    /// The volume cannot be resampled to the pitch.
    #[error("lattice.pitch: {0}")]
    Pitch(#[from] ResampleError),
    /// A number is too small or too large for the f32 the state is kept in.
    #[error(
        "organ `{organ}`: {what} becomes {found:e}, which f32 cannot hold (1.2e-38 to 3.4e38); check the units of its material and \
         of time.dt"
    )]
    OutOfRange {
        /// Name of the organ.
        organ: String,
        /// What it is, with its unit.
        what: &'static str,
        /// Its value.
        found: f64,
    },
    /// The stable step is so small that the run would never end.
    #[error(
        "time.duration = {duration:e} s takes {steps:.1e} steps, for the largest stable one is {bound:.3e} s; expected at most \
         1e12: shorten it, or take a softer, denser or less damped material"
    )]
    TooManySteps {
        /// Simulated time asked for [s].
        duration: f64,
        /// Steps it would take.
        steps: f64,
        /// The largest stable step [s].
        bound: f64,
    },
    /// The step asked for is not stable.
    #[error(
        "time.dt = {asked:e} s is not stable for these materials: the largest step that is, is {bound:.3e} s; ask for at \
         most {suggested:.2e} s, or leave time.dt out and let the program choose"
    )]
    UnstableStep {
        /// The step in the scene [s].
        asked: f64,
        /// The largest stable one [s].
        bound: f64,
        /// A rounded value below it [s].
        suggested: f64,
    },
}

/// A scene's lattice with its materials and its steps.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// The rest state.
    pub lattice: Lattice,
    /// Masses and spring constants.
    pub assembly: Assembly,
    /// How the properties of each organ spread that differ from place to place.
    pub spreads: Vec<Spreads>,
    /// Steps and frames.
    pub schedule: Schedule,
}

/// Steps and frames of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Schedule {
    /// Time step [s].
    pub dt: f64,
    /// The largest step that is stable near rest [s]; infinite when no spring limits it.
    pub stable_dt: f64,
    /// All limits of the rest state.
    pub limits: Limits,
    /// True when the scene asked for the step.
    pub asked: bool,
    /// Steps in all.
    pub steps: u64,
    /// Frames after the first.
    pub frames: u64,
}

impl Schedule {
    /// Chooses the step, or checks the one that is asked for; `sharpen` looks for the true limit as far as that pays in a
    /// run of so many steps.
    ///
    /// # Errors
    /// If the step asked for is larger than the stable one.
    pub fn new(
        time: &TimeSpec,
        at_rest: Limits,
        sharpen: impl Fn(Limits, f64) -> Limits,
    ) -> Result<Self, PrepareError> {
        let frames = time.frames as u64;
        let per_frame = time.duration / frames as f64;
        if let Some(asked) = time.dt {
            // Only a step between both limits needs the true one.
            let limits = if asked > at_rest.rest {
                sharpen(at_rest, WORTH_REFUSING.max(time.duration / asked))
            } else {
                at_rest
            };
            let stable_dt = limits.sharp;
            if asked > stable_dt {
                // Two digits, rounded down.
                let scale = 10_f64.powf(stable_dt.log10().floor() - 1.0);
                let suggested = (SAFETY * stable_dt / scale).floor() * scale;
                return Err(PrepareError::UnstableStep { asked, bound: stable_dt, suggested });
            }
            let steps = (time.duration / asked - 1e-6).ceil().max(1.0) as u64;
            return Ok(Self { dt: asked, stable_dt, limits, asked: true, steps, frames });
        }
        let steps_of = |limit: f64| (per_frame / (SAFETY * limit)).ceil().max(1.0);
        let limits = sharpen(at_rest, frames as f64 * steps_of(at_rest.rest));
        let steps_per_frame = steps_of(limits.sharp);
        let steps = frames as f64 * steps_per_frame;
        if steps > MOST_STEPS {
            return Err(PrepareError::TooManySteps { duration: time.duration, steps, bound: limits.sharp });
        }
        let (dt, steps) = (per_frame / steps_per_frame, frames * steps_per_frame as u64);
        Ok(Self { dt, stable_dt: limits.sharp, limits, asked: false, steps, frames })
    }

    /// Steps of a method that is stable at any: as asked; or of backward Euler [`LONG_STEP`] of the plain step's, at most
    /// one frame; or one for each frame.
    ///
    /// - `plain`: the largest stable one of the plain step [s].
    fn of_any_step(time: &TimeSpec, limits: Limits, plain: f64) -> Result<Self, PrepareError> {
        let longest = if time.integrator == Method::BackwardEuler { LONG_STEP * SAFETY * plain } else { f64::INFINITY };
        let per_frame = time.duration / time.frames as f64;
        let steps = (per_frame / longest).ceil().max(1.0);
        if time.dt.is_some() || !longest.is_finite() || steps * time.frames as f64 > MOST_STEPS {
            let asked = TimeSpec { dt: time.dt.or(Some(per_frame)), ..*time };
            let schedule = Self::new(&asked, limits, |limits, _| limits)?;
            return Ok(Self { asked: time.dt.is_some(), ..schedule });
        }
        let asked = TimeSpec { dt: Some(per_frame / steps), ..*time };
        let schedule = Self::new(&asked, limits, |limits, _| limits)?;
        Ok(Self { asked: false, steps: time.frames as u64 * steps as u64, ..schedule })
    }

    /// The same frames with steps so many times shorter, rounded up to whole steps between two frames.
    pub fn finer(&self, fineness: f64) -> Self {
        let per_frame = (self.steps as f64 / self.frames as f64 * fineness - 1e-9).ceil().max(1.0);
        let steps = per_frame as u64 * self.frames;
        Self { dt: self.dt * self.steps as f64 / steps as f64, steps, ..*self }
    }

    /// What the stable step is the limit of, in words.
    pub fn limit_in_words(&self) -> &'static str {
        match self.limits {
            Limits { rest, .. } if rest.is_infinite() => "nothing limits the step",
            Limits { rest, sharp, .. } if sharp > rest => "sharpened: the limit of the whole lattice at rest",
            _ => "the limit at rest, particle by particle",
        }
    }

    /// After how many steps a frame is due; frame 0 is the start.
    pub fn step_of_frame(&self, frame: u64) -> u64 {
        (u128::from(frame) * u128::from(self.steps) / u128::from(self.frames)) as u64
    }
}

/// Builds the lattice of a scene and chooses its time step.
///
/// # Errors
/// See [`PrepareError`].
pub fn prepare(scene: &Scene, inputs: &Inputs) -> Result<Prepared, PrepareError> {
    let soft = |body: &Body| !matches!(body, Body::Rigid { .. });
    if !scene.organs.iter().any(|organ| soft(&organ.body)) {
        return Err(PrepareError::AllRigid);
    }
    let Organs { map, fill, native } = organs(scene, inputs)?;
    let lattice = match scene.lattice.model {
        Model::Paper => build(&map)?,
        Model::Tissue => build_cells(&map, fill.as_ref())?,
    };
    let Materials { assembly, spreads } = assemble(scene, inputs, &native, &lattice)?;
    let rigid: Vec<bool> = scene.organs.iter().map(|organ| !soft(&organ.body)).collect();
    let names: Vec<&str> = scene.organs.iter().map(|organ| organ.name.as_str()).collect();
    // Infinite or zero constants first: they make the limits meaningless.
    range::check(&lattice, &assembly, &names, &rigid, scene.time.dt.unwrap_or(0.0))?;
    let topology = Topology::new(&lattice);
    let drag = scene.drag.unwrap_or(0.0);
    let schedule = {
        let (at_rest, sharpen) = scene.time.integrator.limits(&lattice, &topology, &assembly, drag);
        if scene.time.integrator.is_stable_at_any_step() {
            let plain = Limits::at_rest(&lattice, &topology, &assembly).rest;
            Schedule::of_any_step(&scene.time, at_rest, plain)?
        } else {
            Schedule::new(&scene.time, at_rest, sharpen)?
        }
    };
    range::check(&lattice, &assembly, &names, &rigid, schedule.dt)?;
    Ok(Prepared { lattice, assembly, spreads, schedule })
}

impl Prepared {
    /// The lattice at rest, under the scene's gravity and drag, with its arithmetic and its sleep.
    pub fn into_world(self, scene: &Scene) -> World {
        let mut world = World::new(self.lattice, self.assembly, self.schedule.dt);
        world.set_gravity(scene.gravity);
        world.set_drag(scene.drag.unwrap_or(0.0));
        world.set_sleep(scene.sleep.map(|sleep| Sleep {
            tolerance: sleep.tolerance.unwrap_or(SLEEP_TOLERANCE * world.lattice().pitch),
            window: sleep.window.unwrap_or_else(|| world.slowest_wave().max(world.dt())),
        }));
        world.set_arithmetic(Arithmetic::new(InstructionSet::best(), scene.time.exact));
        let integrator = Integrator::new(scene.time.integrator);
        world.set_integrator(Integrator {
            tolerance: scene.time.tolerance.unwrap_or(integrator.tolerance),
            ..integrator
        });
        world
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn schedule(time: &TimeSpec, stable: f64) -> Result<Schedule, PrepareError> {
        Schedule::new(time, Limits { promise: 0.6 * stable, rest: 0.9 * stable, sharp: 0.9 * stable }, |limits, _| {
            Limits { sharp: stable, ..limits }
        })
    }

    #[test]
    fn the_step_divides_a_frame() {
        let time = TimeSpec {
            duration: 0.4,
            frames: 40,
            dt: None,
            integrator: Method::SymplecticEuler,
            tolerance: None,
            exact: false,
        };
        let schedule = schedule(&time, 3.3e-4).unwrap();
        assert!(schedule.dt <= SAFETY * 3.3e-4);
        assert_eq!(schedule.steps % 40, 0);
        assert!((schedule.dt * schedule.steps as f64 - 0.4).abs() < 1e-12);
        assert_eq!(schedule.step_of_frame(40), schedule.steps);
        assert_eq!(schedule.step_of_frame(0), 0);
    }

    #[test]
    fn an_unstable_step_is_refused_with_one_that_works() {
        let time = TimeSpec {
            duration: 0.4,
            frames: 40,
            dt: Some(1e-3),
            integrator: Method::SymplecticEuler,
            tolerance: None,
            exact: false,
        };
        let error = schedule(&time, 3.3e-4).unwrap_err();
        let PrepareError::UnstableStep { suggested, .. } = error else { panic!("{error}") };
        assert!(schedule(&TimeSpec { dt: Some(suggested), ..time }, 3.3e-4).is_ok());
        assert!(error.to_string().contains("3.300e-4"), "{error}");
    }

    #[test]
    fn a_run_without_end_is_refused() {
        let time = TimeSpec {
            duration: 1e300,
            frames: 40,
            dt: None,
            integrator: Method::SymplecticEuler,
            tolerance: None,
            exact: false,
        };
        let error = schedule(&time, 1e-3).unwrap_err().to_string();
        assert!(["1e300", "steps", "1.000e-3", "1e12"].iter().all(|part| error.contains(part)), "{error}");
    }

    #[test]
    fn a_given_step_is_kept() {
        let time = TimeSpec {
            duration: 0.1,
            frames: 7,
            dt: Some(1e-3),
            integrator: Method::SymplecticEuler,
            tolerance: None,
            exact: false,
        };
        let schedule = schedule(&time, 2e-3).unwrap();
        assert_eq!((schedule.dt, schedule.steps), (1e-3, 100));
        assert_eq!(schedule.step_of_frame(7), 100);
    }
}
