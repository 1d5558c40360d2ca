//! `yawara bench scene`: how far from real time a scene is, and where the time of its steps goes.

use anyhow::bail;
use serde_json::{Value, json};

use super::super::args::BenchSceneArguments;
use super::super::messages::out;
use crate::dynamics::timeline::Timeline;
use crate::run::inputs;
use crate::run::label_lookup::Files;
use crate::run::prepare::prepare;
use crate::run::step_times::{StepTime, step_times};

/// Steps that are told as a stretch: what a user feels as one stroke.
const STRETCH: usize = 100;

/// What stepping through a scene at one pitch took.
struct Row {
    /// [mm]
    pitch: f64,
    particles: usize,
    steps: usize,
    /// Simulated [s].
    duration: f64,
    /// Sum over all steps [s].
    total: StepTime,
    /// The slowest [`STRETCH`] steps in a row, and the quickest [s].
    stretches: [f64; 2],
}

impl Row {
    /// How many times longer stepping takes than what it simulates.
    fn slower_than_life(&self) -> f64 {
        self.total.total() / self.duration
    }
}

pub(super) fn scene(arguments: &BenchSceneArguments) -> anyhow::Result<()> {
    let BenchSceneArguments { scene: ref path, ref pitches, runs, json } = *arguments;
    if runs == 0 || pitches.iter().any(|pitch| !(*pitch > 0.0 && pitch.is_finite())) {
        bail!("--runs is {runs} and --pitch {pitches:?}; expected at least one run and lengths above 0 mm");
    }
    let (asked, _) = crate::scene::load(path, &Files)?;
    let inputs = inputs::load(&asked)?;
    let pitches: Vec<Option<f64>> =
        if pitches.is_empty() { vec![None] } else { pitches.iter().copied().map(Some).collect() };
    let mut rows: Vec<Row> = Vec::new();
    for pitch in pitches {
        let mut scene = asked.clone();
        scene.lattice.pitch = pitch.map(|mm| mm * 1e-3).or(scene.lattice.pitch);
        let prepared = prepare(&scene, &inputs)?;
        let mut best: Option<Row> = None;
        for _ in 0..runs {
            let mut timeline = Timeline::with_tools(&scene.operations, &prepared.lattice, &inputs.tools)?;
            let mut world = prepared.clone().into_world(&scene);
            let times = step_times(&mut world, &mut timeline, &prepared.schedule)?;
            let row = Row {
                pitch: world.lattice().pitch * 1e3,
                particles: world.lattice().len(),
                steps: times.len(),
                duration: world.time(),
                total: sum(&times),
                stretches: stretches(&times),
            };
            if best.as_ref().is_none_or(|best| row.total.total() < best.total.total()) {
                best = Some(row);
            }
        }
        rows.extend(best);
    }
    report(&rows, runs, json)
}

fn sum(times: &[StepTime]) -> StepTime {
    times.iter().fold(StepTime::default(), |sum, time| StepTime {
        control: sum.control + time.control,
        operations: sum.operations + time.operations,
        step: sum.step + time.step,
    })
}

/// The slowest and the quickest stretch [s].
fn stretches(times: &[StepTime]) -> [f64; 2] {
    let long = times.windows(STRETCH.min(times.len())).map(|steps| sum(steps).total());
    long.fold([0.0, f64::INFINITY], |[slowest, quickest], time| [time.max(slowest), time.min(quickest)])
}

fn report(rows: &[Row], runs: usize, json: bool) -> anyhow::Result<()> {
    if json {
        let object = |row: &Row| {
            json!({
                "pitch_mm": row.pitch,
                "particles": row.particles,
                "steps": row.steps,
                "simulated_s": row.duration,
                "step_s": row.total.step,
                "operations_s": row.total.operations,
                "control_s": row.total.control,
                "slowest_100_steps_s": row.stretches[0],
                "quickest_100_steps_s": row.stretches[1],
                "slower_than_life": row.slower_than_life(),
            })
        };
        let rows: Vec<Value> = rows.iter().map(object).collect();
        return out(&json!({ "threads": rayon::current_num_threads(), "runs": runs, "pitches": rows }).to_string());
    }
    let mut text = format!(
        "{} threads, the quickest of {runs} runs, stepping without frames\n\n| pitch [mm] | particles | steps | steps [s] | \
         operations [s] | step control [s] | 100 steps [s] | times slower than life |\n|---:|---:|---:|---:|---:|---:|---:|---:|",
        rayon::current_num_threads()
    );
    for row in rows {
        let StepTime { control, operations, step } = row.total;
        let [slowest, quickest] = row.stretches;
        text += &format!(
            "\n| {:.2} | {} | {} | {step:.2} | {operations:.2} | {control:.2} | {quickest:.2} to {slowest:.2} | {:.1} |",
            row.pitch,
            row.particles,
            row.steps,
            row.slower_than_life()
        );
    }
    out(&text)
}
