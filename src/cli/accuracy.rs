//! `yawara run` of a scene that asks for an accuracy: searched for, run, judged, and told.

use std::path::Path;

use indicatif::ProgressBar;

use super::exit::Outcome;
use super::messages::Messages;
use super::progress;
use super::run::{Begun, tell};
use crate::accuracy::search::Told;
use crate::accuracy::trial::INSTANTS;
use crate::accuracy::{Collector, Estimate, Search, Verdict};
use crate::run::drive::DriveError;
use crate::run::inputs::Inputs;
use crate::scene::resolved::Scene;
use crate::store::Status;

/// Parts of a trial's progress bar.
const PARTS: u64 = 1000;

/// Searches for a run of a scene that keeps its bound, and leaves it in a run directory.
pub(super) fn simulate(
    mut search: Search<'_>,
    (scene, scene_toml): (&Scene, String),
    inputs: &Inputs,
    (output, mut overwrite): (&Path, bool),
    messages: &Messages,
) -> anyhow::Result<Outcome> {
    let mut said = Said { messages, lines: Vec::new(), bar: None };
    said.line(format!(
        "accuracy: at most {} of the largest displacement asked (root mean square over the tissue, at the worst of up to \
         {INSTANTS} frames); {}",
        percent(search.asked()),
        match search.fixed_mm() {
            Some(pitch) => format!("the pitch of {pitch:.3} mm is the scene's, so integrator and step are chosen"),
            None => "pitch, integrator and step are chosen".to_owned(),
        }
    ));
    let mut choice = search.first(&mut |told| said.told(told))?;
    loop {
        said.line(format!("accuracy: chosen: {choice}"));
        let (chosen, prepared) = choice.prepare(scene, inputs)?;
        let collector = Collector::new(prepared.schedule.frames);
        let begun = Begun::new((&chosen, scene_toml.clone()), inputs, prepared, (output, overwrite), messages)?;
        let mut recorded = begun.run(Some(collector), messages);
        overwrite = true;
        if let Err(DriveError::Step(error)) = &recorded.driven
            && let Some(finer) = search.in_place_of(&choice, &mut |told| said.told(told))?
        {
            said.line(format!("accuracy: {choice} will not do: {error}"));
            recorded.recorder.finish(Status::Stopped { reason: error.to_string() })?;
            choice = finer;
            continue;
        }
        let (Ok(_), Some(collector)) = (&recorded.driven, recorded.collector.take()) else {
            return recorded.conclude(&chosen, output, messages);
        };
        let trial = collector.into_trial(choice, &recorded.world, &chosen);
        let verdict = search.judge(trial, &mut |told| said.told(told))?;
        let (estimate, missed) = match verdict {
            Verdict::Again(estimate, next) => {
                said.line(format!("accuracy: {}: more than asked", words(&estimate)));
                recorded
                    .recorder
                    .finish(Status::Stopped { reason: "the accuracy asked for was not reached".into() })?;
                choice = next;
                continue;
            }
            Verdict::Kept(estimate) => (estimate, None),
            Verdict::Missed(estimate, why) => (estimate, Some(why)),
        };
        for line in said.lines {
            recorded.recorder.log(&line)?;
        }
        let kept = if missed.is_none() { "kept" } else { "NOT kept" };
        let line = format!("accuracy: {}: {} {kept}", words(&estimate), percent(search.asked()));
        tell(&mut recorded.recorder, messages, &line)?;
        if let Some(why) = &missed {
            recorded.recorder.log(why)?;
            messages.warning(format_args!("the accuracy asked for was not reached: {why}"));
        }
        let outcome = recorded.conclude(&chosen, output, messages)?;
        return Ok(if missed.is_some() && outcome == Outcome::Done { Outcome::CheckFailed } else { outcome });
    }
}

/// Says what goes on, and remembers it for the log of the run.
struct Said<'a> {
    messages: &'a Messages,
    lines: Vec<String>,
    bar: Option<ProgressBar>,
}

impl Said<'_> {
    fn line(&mut self, line: String) {
        self.messages.note(&line);
        self.lines.push(line);
    }

    fn told(&mut self, told: &Told<'_>) {
        match told {
            Told::Begins(choice) => {
                let bar = progress::bar(self.messages, "trial", PARTS);
                bar.set_message(choice.to_string());
                self.bar = Some(bar);
            }
            Told::At(share) => {
                if let Some(bar) = &self.bar {
                    bar.set_position((share * PARTS as f64) as u64);
                }
            }
            Told::Ended(trial) => {
                self.clear();
                self.line(format!(
                    "accuracy: tried {}: {} particles, {} steps",
                    trial.choice,
                    trial.len(),
                    trial.steps
                ));
            }
            Told::Unusable(choice, error) => {
                self.clear();
                self.line(format!("accuracy: {choice} will not do: {error}"));
            }
        }
    }

    fn clear(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
    }
}

/// An estimate in words.
fn words(estimate: &Estimate) -> String {
    let Estimate { steps, pitch, order, largest_mm } = estimate;
    let parts = match (pitch, order) {
        (Some(pitch), Some(order)) => {
            format!("pitch {} (falling with its power {order:.1}), steps {}", percent(*pitch), percent(*steps))
        }
        _ => format!("steps {}, the pitch not counted", percent(*steps)),
    };
    format!("estimated error {} of {largest_mm:.3} mm ({parts})", percent(estimate.error()))
}

/// Two digits in percent.
pub(super) fn percent(share: f64) -> String {
    let digits = if share > 0.0 { (1.0 - (share * 100.0).log10().floor()).clamp(0.0, 8.0) as usize } else { 0 };
    format!("{:.digits$} %", share * 100.0)
}
