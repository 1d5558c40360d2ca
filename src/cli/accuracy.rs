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
        let run = match (&recorded.driven, recorded.collector.take()) {
            (Ok(_), Some(collector)) => Ok(collector.into_trial(choice, &recorded.world, &chosen)),
            (Err(DriveError::Step(error)), _) => Err(error.clone()),
            _ => return recorded.conclude(&chosen, output, messages),
        };
        let stopped = match &run {
            Ok(_) => "the accuracy asked for was not reached".to_owned(),
            Err(error) => error.to_string(),
        };
        let (estimate, outcome) = match search.judge(&choice, run, &mut |told| said.told(told))? {
            Verdict::Again(estimate, next) => {
                if let Some(estimate) = estimate {
                    said.line(format!("accuracy: {}: more than asked", words(&estimate)));
                }
                recorded.recorder.finish(Status::Stopped { reason: stopped })?;
                choice = next;
                continue;
            }
            Verdict::Kept(estimate, enough) => (estimate, Ok(enough)),
            Verdict::Missed(estimate, why) => (estimate, Err(why)),
            Verdict::Diverged(_) => return recorded.conclude(&chosen, output, messages),
        };
        for line in said.lines {
            recorded.recorder.log(&line)?;
        }
        let kept = if outcome.is_ok() { "kept" } else { "NOT kept" };
        let line = format!("accuracy: {}: {} {kept}", words(&estimate), percent(search.asked()));
        tell(&mut recorded.recorder, messages, &line)?;
        match &outcome {
            Ok(None) => {}
            Ok(Some(enough)) => {
                let line = format!(
                    "accuracy: {enough} would have been enough, as far as this run can tell: lattice.pitch = {} should do for scenes like it",
                    enough.pitch_mm
                );
                tell(&mut recorded.recorder, messages, &line)?;
            }
            Err(why) => {
                recorded.recorder.log(why)?;
                messages.warning(format_args!("the accuracy asked for was not reached: {why}"));
            }
        }
        let concluded = recorded.conclude(&chosen, output, messages)?;
        return Ok(if outcome.is_err() && concluded == Outcome::Done { Outcome::CheckFailed } else { concluded });
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
