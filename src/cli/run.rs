//! `yawara run`: simulate a scene into a run directory.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context;
use indicatif::ProgressBar;

use super::args::RunArguments;
use super::exit::Outcome;
use super::messages::Messages;
use super::progress;
use super::source::Source;
use crate::dynamics::World;
use crate::dynamics::timeline::{Event, Timeline, What};
use crate::run::drive::{DriveError, Frame, Observer, drive};
use crate::run::inputs;
use crate::run::label_lookup::Files;
use crate::run::prepare::prepare;
use crate::run::record::{Recorder, describe};
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
    let inputs = inputs::load(&scene.volume)?;
    if inputs.replaced_voxels > 0 {
        messages.warning(format_args!("{} voxels of the image are not finite; read as air", inputs.replaced_voxels));
    }
    let prepared = prepare(scene, &inputs)?;
    let mut timeline = Timeline::new(&scene.operations, &prepared.lattice)?;
    let schedule = prepared.schedule;
    let particles = prepared.lattice.len();
    messages.note(format_args!(
        "{particles} particles, {} springs, pitch {:.3} mm",
        prepared.lattice.spring_count(),
        prepared.lattice.pitch * 1e3
    ));
    messages.note(format_args!(
        "{} steps of {:.3e} s ({}; stable up to {:.3e} s), {} frames",
        schedule.steps,
        schedule.dt,
        if scene.time.dt.is_some() { "as the scene asks" } else { "chosen" },
        schedule.stable_dt,
        schedule.frames
    ));
    let recorder = Recorder::create(output, scene, Some(scene_toml), &inputs, &prepared, overwrite)?;
    // The volumes are not needed while stepping.
    drop(inputs);
    let mut world = prepared.into_world(scene.gravity);
    let bar = progress::bar(messages, "steps", schedule.steps);
    let mut watch = Watch { recorder, bar, messages, scene, started: Instant::now(), volume: (1.0, 0) };
    let driven = drive(&mut world, &mut timeline, &schedule, &mut watch);
    watch.bar.finish_and_clear();
    let seconds = watch.started.elapsed().as_secs_f64();
    let Watch { recorder, volume: (volume, inverted), .. } = watch;
    match driven {
        Ok(_) => {
            let mut recorder = recorder;
            let summary = format!(
                "{:.4} s simulated in {seconds:.2} s: {:.1} million particle-steps/s with frames written; volume of whole cells {:+.3} %",
                world.time(),
                particles as f64 * world.steps() as f64 / seconds * 1e-6,
                100.0 * (volume - 1.0)
            );
            recorder.log(&summary)?;
            recorder.finish(Status::Complete)?;
            messages.note(summary);
            if inverted > 0 {
                messages.warning(format_args!(
                    "{inverted} {} turned inside out at the end; lower the forces or refine lattice.pitch",
                    if inverted == 1 { "cell is" } else { "cells are" }
                ));
            } else if (volume - 1.0).abs() > NOTABLE_VOLUME_CHANGE {
                messages.warning("whole cells changed their volume by more than 5 %; tissue hardly does that");
            }
            messages.note(format_args!("run: {}", output.display()));
            Ok(Outcome::Done)
        }
        Err(DriveError::Step(error)) => {
            recorder.finish(Status::Stopped { reason: error.to_string() })?;
            messages.error(&error.into());
            messages.note(format_args!("the frames before are in {}", output.display()));
            Ok(Outcome::CheckFailed)
        }
        Err(DriveError::Observer(error)) => Err(error.into()),
    }
}

/// Records a run and shows how far it is.
struct Watch<'a> {
    recorder: Recorder,
    bar: ProgressBar,
    messages: &'a Messages,
    scene: &'a Scene,
    started: Instant,
    /// Volume of whole cells relative to rest, and inverted cells, at the last frame.
    volume: (f64, usize),
}

impl Observer for Watch<'_> {
    type Error = WriteRunError;

    fn frame(&mut self, frame: &Frame<'_>) -> Result<(), WriteRunError> {
        if frame.volume.rest > 0.0 {
            self.volume = (frame.volume.now / frame.volume.rest, frame.volume.inverted);
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

    fn step(&mut self, _: &World) {
        self.bar.inc(1);
    }
}
