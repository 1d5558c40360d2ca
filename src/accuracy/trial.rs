//! One run of a scene with choices made, kept in memory to be compared.

use crate::deviation::{Carrier, Deviation, Judged, Witness};
use crate::dynamics::World;
use crate::dynamics::integrator::Method;
use crate::dynamics::timeline::Timeline;
use crate::geometry::Vector3;
use crate::lattice::{Lattice, Topology};
use crate::run::drive::{DriveError, Frame, Observer, drive};
use crate::run::inputs::Inputs;
use crate::run::organs::own_pitch_mm;
use crate::run::prepare::{Prepared, prepare};
use crate::scene::resolved::Scene;

use super::search::AccuracyError;

/// Frames that are compared at most.
pub const INSTANTS: usize = 8;

/// What a run chooses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Choice {
    /// Distance of neighbouring particles [mm].
    pub pitch_mm: f64,
    /// How it goes on in time.
    pub method: Method,
    /// How many times shorter the step is than the largest that is stable with this method at this pitch.
    pub fineness: f64,
}

impl Choice {
    /// The scene with this choice made, and the lattice and schedule it leads to.
    ///
    /// # Errors
    /// If there is no such lattice.
    pub fn prepare(&self, scene: &Scene, inputs: &Inputs) -> Result<(Scene, Prepared), AccuracyError> {
        let own = scene.lattice.pitch.or(own_pitch_mm(inputs).map(|mm| mm * 1e-3));
        // As it was written, where it was: a pitch of the volume's own takes its voxels as they are.
        let mut scene = match own.filter(|own| (own * 1e3 / self.pitch_mm - 1.0).abs() > 1e-9) {
            Some(own) => scene.at_pitch(own, self.pitch_mm * 1e-3),
            None => scene.clone(),
        };
        scene.time.integrator = self.method;
        scene.time.dt = None;
        let mut prepared = prepare(&scene, inputs)?;
        prepared.schedule = prepared.schedule.finer(self.fineness);
        Ok((scene, prepared))
    }
}

impl std::fmt::Display for Choice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { pitch_mm, method, fineness } = self;
        write!(f, "pitch {:.3} mm, {}", pitch_mm, method.name())?;
        if *fineness == 1.0 { Ok(()) } else { write!(f, ", steps {fineness:.2} times shorter") }
    }
}

/// Gathers the frames of a run that are compared.
#[derive(Debug, Clone)]
pub struct Collector {
    frames: u64,
    kept: Vec<Vec<[f32; 3]>>,
}

impl Collector {
    /// For a run of so many frames after the first.
    pub fn new(frames: u64) -> Self {
        Self { frames, kept: Vec::new() }
    }

    /// Takes a frame, when it is one that counts.
    pub fn frame(&mut self, frame: &Frame<'_>) {
        let instants = self.frames.min(INSTANTS as u64);
        let next = self.kept.len() as u64 + 1;
        if next <= instants && frame.number == (next * self.frames).div_ceil(instants) {
            self.kept.push(frame.world.displacements_mm());
        }
    }

    /// The finished run.
    pub fn into_trial(self, choice: Choice, world: &World, scene: &Scene) -> Trial {
        let lattice = world.lattice().clone();
        let judged = Judged::of(&lattice, scene);
        let largest = |frame: &Vec<[f32; 3]>| judged.largest(|particle| wide(&frame[particle as usize]));
        Trial {
            choice,
            steps: world.steps(),
            dt: world.time() / world.steps().max(1) as f64,
            largest_mm: self.kept.iter().map(largest).fold(0.0, f64::max),
            judged,
            topology: world.topology().clone(),
            frames: self.kept,
            lattice,
        }
    }
}

/// A finished run.
#[derive(Debug, Clone)]
pub struct Trial {
    /// What was chosen.
    pub choice: Choice,
    /// Steps taken.
    pub steps: u64,
    /// Their mean length [s].
    pub dt: f64,
    /// Largest displacement of a judged particle at any instant [mm].
    pub largest_mm: f64,
    judged: Judged,
    lattice: Lattice,
    /// Springs at the end.
    topology: Topology,
    /// Displacements at each instant [mm]: shape `[particles]`.
    frames: Vec<Vec<[f32; 3]>>,
}

impl Trial {
    /// Runs a choice in memory.
    ///
    /// - `step`: told after every step the share of the time that is done, 0 to 1.
    ///
    /// # Errors
    /// If it cannot be prepared, or diverges.
    pub fn run(
        choice: Choice,
        scene: &Scene,
        inputs: &Inputs,
        step: &mut dyn FnMut(f64),
    ) -> Result<Self, AccuracyError> {
        let (scene, prepared) = choice.prepare(scene, inputs)?;
        let mut timeline = Timeline::with_tools(&scene.operations, &prepared.lattice, &inputs.tools)?;
        let schedule = prepared.schedule;
        let mut world = prepared.into_world(&scene);
        let duration = schedule.dt * schedule.steps as f64;
        let mut watch = Watch { collector: Collector::new(schedule.frames), duration, step };
        match drive(&mut world, &mut timeline, &schedule, &mut watch) {
            Ok(_) => Ok(watch.collector.into_trial(choice, &world, &scene)),
            Err(DriveError::Step(error)) => Err(error.into()),
            Err(DriveError::Observer(never)) => match never {},
        }
    }

    /// Particles of its lattice.
    pub fn len(&self) -> usize {
        self.lattice.len()
    }

    /// True without particles, which no run is.
    pub fn is_empty(&self) -> bool {
        self.lattice.is_empty()
    }

    /// How far it is from another run, at the worst instant: on the same lattice particle by particle, or on a finer one where
    /// that carries the places of these particles. `None` where nothing can be compared.
    pub fn distance(&self, other: &Self) -> Option<Deviation> {
        let same = self.choice.pitch_mm == other.choice.pitch_mm;
        let instants = self.frames.iter().zip(&other.frames).map(|(found, expected)| {
            let [found, expected] = [found, expected].map(|frame| frame.iter().map(wide).collect::<Vec<_>>());
            if same {
                self.judged.on_one_lattice(&found, &expected)
            } else {
                self.judged.between_lattices((&self.lattice, &found), other.carrier(&expected))
            }
        });
        instants.reduce(Deviation::worse).filter(|deviation| deviation.points > 0)
    }

    /// How far it is from the limit that finer runs tend to, at the worst instant ([`Judged::against_limit`]). `None` where nothing can be
    /// compared.
    pub(super) fn distance_from_limit(
        &self,
        finest: &Self,
        coarser: &[(&Self, Witness)],
        unknown_mm: f64,
    ) -> Option<Deviation> {
        let frame = |trial: &Self, instant: usize| trial.frames[instant].iter().map(wide).collect::<Vec<_>>();
        let instants = self.frames.len().min(finest.frames.len());
        let deviations = (0..instants).map(|instant| {
            let (found, expected) = (frame(self, instant), frame(finest, instant));
            let moved: Vec<Vec<Vector3>> = coarser.iter().map(|(trial, _)| frame(trial, instant)).collect();
            let carriers = coarser.iter().zip(&moved).map(|((trial, told), moved)| (trial.carrier(moved), *told));
            let carriers: Vec<(Carrier<'_>, Witness)> = carriers.collect();
            self.judged.against_limit((&self.lattice, &found), finest.carrier(&expected), &carriers, unknown_mm)
        });
        deviations.reduce(Deviation::worse).filter(|deviation| deviation.points > 0)
    }

    fn carrier<'a>(&'a self, displacements: &'a [Vector3]) -> Carrier<'a> {
        Carrier { lattice: &self.lattice, topology: &self.topology, displacements }
    }
}

fn wide(moved: &[f32; 3]) -> Vector3 {
    Vector3::from(moved.map(f64::from))
}

struct Watch<'a> {
    collector: Collector,
    /// Of the whole run [s].
    duration: f64,
    step: &'a mut dyn FnMut(f64),
}

impl Observer for Watch<'_> {
    type Error = std::convert::Infallible;

    fn frame(&mut self, frame: &Frame<'_>) -> Result<(), Self::Error> {
        self.collector.frame(frame);
        Ok(())
    }

    fn step(&mut self, world: &World) {
        (self.step)(world.time() / self.duration);
    }
}
