//! `yawara run`: simulate a scene into a run directory.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context;
use indicatif::ProgressBar;

use super::accuracy;
use super::args::RunArguments;
use super::exit::Outcome;
use super::messages::Messages;
use super::progress;
use super::source::Source;
use crate::accuracy::{Collector, Search};
use crate::dynamics::World;
use crate::dynamics::effects::sleep::SleepCounts;
use crate::dynamics::step_control::StepCounts;
use crate::dynamics::timeline::{Event, Timeline, What};
use crate::run::drive::{DriveError, Frame, Observer, drive};
use crate::run::inputs::{self, Inputs};
use crate::run::label_lookup::Files;
use crate::run::meshes::organ_volumes;
use crate::run::prepare::{Prepared, Schedule, prepare};
use crate::run::record::{Recorder, describe, organ_name};
use crate::run::thin_tools::thin_tools;
use crate::scene::resolved::{Action, Scene};
use crate::store::{RunWriter, Status, WriteRunError};

/// Cells may lose this share of their volume before the end of a run says so.
const NOTABLE_VOLUME_CHANGE: f64 = 0.05;

pub(super) fn run(arguments: &RunArguments, messages: &Messages) -> anyhow::Result<Outcome> {
    match Source::of(&arguments.scene)? {
        // A scene may have any name.
        Source::Scene | Source::Volume => {}
        other => return Err(other.refuse(&arguments.scene, "a scene (TOML)")),
    }
    let (scene, warnings) = crate::scene::load(&arguments.scene, &Files)?;
    warnings.iter().for_each(|warning| messages.warning(warning));
    let text = std::fs::read_to_string(&arguments.scene)
        .with_context(|| format!("{}: could not read the scene", arguments.scene.display()))?;
    let output = arguments.output.clone().unwrap_or_else(|| default_output(&arguments.scene));
    simulate(&scene, text, &output, arguments.overwrite, messages)
}

fn default_output(scene: &Path) -> PathBuf {
    Path::new("outputs").join(scene.file_stem().unwrap_or_default())
}

/// Simulates a scene into a run directory, with progress and a summary.
pub(super) fn simulate(
    scene: &Scene,
    scene_toml: String,
    output: &Path,
    overwrite: bool,
    messages: &Messages,
) -> anyhow::Result<Outcome> {
    RunWriter::check_place(output, overwrite)?;
    let inputs = inputs::load(scene)?;
    if inputs.replaced_voxels > 0 {
        messages.warning(format_args!("{} voxels of the image are not finite; read as air", inputs.replaced_voxels));
    }
    if let Some(search) = Search::new(scene, &inputs)? {
        return accuracy::simulate(search, (scene, scene_toml), &inputs, (output, overwrite), messages);
    }
    let prepared = prepare(scene, &inputs)?;
    let begun = Begun::new((scene, scene_toml), &inputs, prepared, (output, overwrite), messages)?;
    // The volumes are not needed while stepping.
    drop(inputs);
    begun.run(None, messages).conclude(scene, output, messages)
}

/// A run whose directory is there, with no step taken.
pub(super) struct Begun<'a> {
    scene: &'a Scene,
    recorder: Recorder,
    world: World,
    timeline: Timeline,
    schedule: Schedule,
}

impl<'a> Begun<'a> {
    /// Makes the directory of a prepared scene, and tells what is to be run.
    pub(super) fn new(
        (scene, scene_toml): (&'a Scene, String),
        inputs: &Inputs,
        prepared: Prepared,
        (output, overwrite): (&Path, bool),
        messages: &Messages,
    ) -> anyhow::Result<Self> {
        let timeline = Timeline::with_tools(&scene.operations, &prepared.lattice, &inputs.tools)?;
        thin_tools(scene, prepared.lattice.pitch).iter().for_each(|warning| messages.warning(warning));
        let schedule = prepared.schedule;
        messages.note(format_args!(
            "{} particles, {} springs, pitch {:.3} mm",
            prepared.lattice.len(),
            prepared.lattice.spring_count(),
            prepared.lattice.pitch * 1e3
        ));
        messages.note(format_args!(
            "{} steps of {:.3e} s ({}; stable up to {:.3e} s, {}), {} frames",
            schedule.steps,
            schedule.dt,
            if scene.time.dt.is_some() { "as the scene asks" } else { "chosen" },
            schedule.stable_dt,
            schedule.limit_in_words(),
            schedule.frames
        ));
        messages.note(format_args!("{}: {}", scene.time.integrator.name(), scene.time.integrator.cost_in_words()));
        let recorder = Recorder::create(output, scene, Some(scene_toml), inputs, &prepared, overwrite)?;
        Ok(Self { scene, recorder, world: prepared.into_world(scene), timeline, schedule })
    }

    /// Steps it to its end, with progress.
    ///
    /// - `collector`: gets to see every frame.
    pub(super) fn run(self, collector: Option<Collector>, messages: &Messages) -> Recorded {
        let Self { scene, recorder, mut world, mut timeline, schedule } = self;
        let bar = progress::bar(messages, "steps", schedule.steps);
        let (planned_dt, started) = (schedule.dt, Instant::now());
        let mut watch = Watch { recorder, collector, bar, messages, scene, planned_dt, started, change: None };
        let driven = drive(&mut world, &mut timeline, &schedule, &mut watch);
        watch.bar.finish_and_clear();
        let seconds = watch.started.elapsed().as_secs_f64();
        let Watch { recorder, collector, change, .. } = watch;
        Recorded { world, recorder, collector, driven, seconds, change }
    }
}

/// A run that was stepped to its end, or as far as it came, with its directory still open.
pub(super) struct Recorded {
    /// As it is at the end.
    pub(super) world: World,
    /// Its directory.
    pub(super) recorder: Recorder,
    /// What was asked to see the frames.
    pub(super) collector: Option<Collector>,
    /// How stepping ended.
    pub(super) driven: Result<StepCounts, DriveError<WriteRunError>>,
    /// Time it took [s].
    seconds: f64,
    /// Change of the volume of whole cells relative to rest in the last frame; `None` when none is whole.
    change: Option<f64>,
}

impl Recorded {
    /// Sums the run up and closes its directory.
    pub(super) fn conclude(self, scene: &Scene, output: &Path, messages: &Messages) -> anyhow::Result<Outcome> {
        let Self { world, mut recorder, driven, seconds, change, .. } = self;
        let particles = world.lattice().len();
        if let Ok(counts) = &driven {
            let rate = particles as f64 * world.steps() as f64 / seconds * 1e-6;
            let time = world.time();
            tell(
                &mut recorder,
                messages,
                &format!(
                    "{time:.4} s simulated in {seconds:.2} s: {rate:.1} million particle-steps/s with frames written"
                ),
            )?;
            tell(&mut recorder, messages, &steps_taken(counts))?;
        }
        let worst = recorder.worst().clone();
        if let (Some(change), Some((furthest, frame))) = (change, worst.change) {
            let [change, furthest] = [change, furthest].map(|share| 100.0 * share);
            let line = format!(
                "volume of whole cells {change:+.3} % in the last frame, furthest {furthest:+.3} % (frame {frame})"
            );
            tell(&mut recorder, messages, &line)?;
        }
        if driven.is_ok() {
            for volume in organ_volumes(&world, scene, recorder.hu())? {
                tell(&mut recorder, messages, &volume.to_string())?;
            }
        }
        if let Some((_, counts)) = world.sleep() {
            tell(&mut recorder, messages, &slept(&counts))?;
        }
        if let Some(torn) = world.torn() {
            tell(&mut recorder, messages, &format!("{torn} springs torn"))?;
        }
        for line in recorder.obstacle_lines() {
            tell(&mut recorder, messages, &line)?;
        }
        if let Some(inverted) = &worst.inverted {
            recorder.log(&inverted.to_string())?;
            messages.warning(format_args!("{inverted}; lower the forces, or refine lattice.pitch"));
        } else if worst.change.is_some_and(|(furthest, _)| furthest.abs() > NOTABLE_VOLUME_CHANGE) {
            messages.warning("whole cells changed their volume by more than 5 %; tissue hardly does that");
        }
        match driven {
            Ok(_) => {
                recorder.finish(Status::Complete)?;
                messages.note(format_args!("run: {}", output.display()));
                Ok(Outcome::Done)
            }
            Err(DriveError::Step(error)) => {
                let lattice = world.lattice();
                let index = lattice.grid.affine.index_of(error.place());
                let ijk = [index.x, index.y, index.z].map(|i| i.round() as usize);
                let particle = lattice.particle_at[lattice.grid.shape.linear(ijk)];
                let organ = organ_name(lattice, particle, recorder.organs());
                stop(recorder, format!("organ `{organ}`: {error}"), output, messages)
            }
            // The step went through, but left numbers that no file can hold.
            Err(DriveError::Observer(
                error @ (WriteRunError::NotFinite { .. } | WriteRunError::SeriesNotFinite { .. }),
            )) => {
                let reason = format!(
                    "the state diverged at t = {:.6} s (step {}): {error}; a force or a grab moves the tissue beyond all measure: \
                     lower it",
                    world.time(),
                    world.steps()
                );
                stop(recorder, reason, output, messages)
            }
            Err(DriveError::Observer(error)) => Err(error.into()),
        }
    }
}

/// How many steps it took, how many of them were shorter than planned, and the shortest.
fn slept(counts: &SleepCounts) -> String {
    let share = 100.0 * counts.left_out as f64 / counts.of.max(1) as f64;
    format!(
        "{share:.1} % of the blocks' steps left out because they slept; {} of {} blocks sleep",
        counts.asleep, counts.blocks
    )
}

fn steps_taken(counts: &StepCounts) -> String {
    let StepCounts { steps, divided, shortest_dt, looks, .. } = *counts;
    let looks = match looks {
        0 => String::new(),
        _ => format!("; the shape was looked at {looks} times"),
    };
    match divided {
        0 => format!("{steps} steps taken, all as planned{looks}"),
        _ => format!(
            "{steps} steps taken: {divided} of them from planned steps divided where the tissue was deformed or fast, the \
             shortest {shortest_dt:.3e} s{looks}"
        ),
    }
}

/// A line for the run's log and for the user.
pub(super) fn tell(recorder: &mut Recorder, messages: &Messages, line: &str) -> Result<(), WriteRunError> {
    messages.note(line);
    recorder.log(line)
}

/// Ends a run whose state diverged: its frames stay, with the reason.
fn stop(mut recorder: Recorder, reason: String, output: &Path, messages: &Messages) -> anyhow::Result<Outcome> {
    let path = output.display();
    let last = recorder.last_frame();
    recorder.log(&reason)?;
    recorder.finish(Status::Stopped { reason: reason.clone() })?;
    messages.error(&anyhow::Error::msg(reason));
    messages.note(match last {
        Some((frame, time)) => format!(
            "the frames before are in {path}; the last good one is frame {frame}, t = {time:.6} s: `yawara mesh {path} --frame \
             {frame} -o last.stl` shows it"
        ),
        None => format!("no frame was written; what was prepared is in {path}"),
    });
    Ok(Outcome::CheckFailed)
}

/// Records a run and shows how far it is.
struct Watch<'a> {
    recorder: Recorder,
    collector: Option<Collector>,
    bar: ProgressBar,
    messages: &'a Messages,
    scene: &'a Scene,
    /// A step of the schedule [s].
    planned_dt: f64,
    started: Instant,
    /// Change of the volume of whole cells relative to rest in the last frame; `None` when none is whole.
    change: Option<f64>,
}

impl Observer for Watch<'_> {
    type Error = WriteRunError;

    fn frame(&mut self, frame: &Frame<'_>) -> Result<(), WriteRunError> {
        self.change = frame.volume.change();
        if let Some(collector) = &mut self.collector {
            collector.frame(frame);
        }
        self.recorder.frame(frame)
    }

    fn event(&mut self, event: &Event) -> Result<(), WriteRunError> {
        let is_cut = || {
            let mut operations = self.scene.operations.iter();
            operations.any(|o| o.name == event.operation && matches!(o.action, Action::Cut { .. }))
        };
        self.bar.suspend(|| match event.what {
            What::Severed(0) => self.messages.warning(format_args!(
                "cut `{}` severed no spring: the blade missed the organs; check its blade and path (mm, RAS+)",
                event.operation
            )),
            What::NeverBegan => self.messages.warning(format_args!(
                "`{}` never began: its `from` is not before the end of the run",
                event.operation
            )),
            What::Began(_) if is_cut() => {}
            _ => self.messages.note(describe(event)),
        });
        self.recorder.event(event)
    }

    fn step(&mut self, world: &World) {
        // Planned steps, however they are divided.
        self.bar.set_position((world.time() / self.planned_dt).round() as u64);
    }
}
