//! Runs what is planned, in turn, and writes down what came of it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use sha2::{Digest, Sha256};

use super::choice::{Arithmetic, Choice, METHODS, longest, may_judge, plain};
use super::ledger::{FORMAT, Ledger, LedgerError, Line, Pace, ProbeLine, RunLine, SkippedLine, Subject};
use super::plan::{Options, PITCHES, Plan, SLACK, plan};
use super::probe::paces;
use super::rounding;
use crate::dynamics::World;
use crate::dynamics::integrator::Method;
use crate::dynamics::timeline::{Event, Timeline, TimelineError};
use crate::run::drive::{DriveError, Frame, Observer, drive};
use crate::run::inputs::Inputs;
use crate::run::prepare::{PrepareError, Prepared, Schedule, prepare};
use crate::run::record::Recorder;
use crate::scene::resolved::Scene;
use crate::store::{RunWriter, Status, WriteRunError};

/// Folder of the runs in that of a study.
pub const RUNS: &str = "runs";
/// A probe steps for this share of the budget, of each pitch, to come where steps cost what they cost.
const PROBE: f64 = 0.01;
/// Share of the budget after which no run is begun that would go beyond.
const ALL_RUNS: f64 = 0.85;

/// Why a study ended early.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StudyError {
    /// The results cannot be kept, or belong to something else.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    /// The scene cannot be prepared.
    #[error(transparent)]
    Prepare(#[from] PrepareError),
    /// The scene's operations cannot be applied.
    #[error(transparent)]
    Timeline(#[from] TimelineError),
    /// A run cannot be written.
    #[error(transparent)]
    Write(#[from] WriteRunError),
    /// Nothing can be run.
    #[error("no pitch of this study can be had: {why}")]
    NoPitch {
        /// Why, for each.
        why: String,
    },
}

/// What a study is made of.
pub struct Study<'a> {
    scene: &'a Scene,
    /// The scene under the plain step, at its own pitch.
    plain: Scene,
    inputs: &'a Inputs,
    folder: PathBuf,
    options: Options,
    ledger: Ledger,
    levels: BTreeMap<u64, Level>,
    scene_pitch_mm: f64,
    began: Instant,
    /// Time spent before \[s\].
    spent_before: f64,
}

/// A pitch that was prepared.
struct Level {
    /// For the plain step.
    prepared: Prepared,
    /// Longest steps of the integrators that were asked for so far.
    longest: Vec<(Method, Schedule)>,
}

/// What a study tells while it goes on.
pub enum Progress<'a> {
    /// So many runs are planned, and so many of them are already there.
    Planned {
        /// All runs.
        runs: usize,
        /// Those of an earlier call.
        known: usize,
    },
    /// A run begins.
    Begins(&'a Choice),
    /// A run is over: done, skipped, or failed.
    Ended,
}

impl<'a> Study<'a> {
    /// Opens the study of a scene in a folder, or begins it.
    ///
    /// # Errors
    /// If the folder holds the study of something else, or the scene cannot be prepared.
    ///
    /// # Panics
    /// Never: a resolved scene is plain data.
    pub fn open(scene: &'a Scene, inputs: &'a Inputs, folder: &Path, options: Options) -> Result<Self, StudyError> {
        let began = Instant::now();
        let mut hash = Sha256::new();
        hash.update(serde_json::to_vec(scene).expect("a resolved scene is plain data"));
        inputs.files.iter().for_each(|file| hash.update(file.sha256.as_bytes()));
        let subject = Subject {
            format: FORMAT,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            scene_sha256: hex(hash),
            instants: options.instants,
        };
        let ledger = Ledger::open(folder, &subject)?;
        let spent_before = ledger.runs().map(|run| run.all_seconds).sum();
        // The pitch the scene has by itself, which may come from its volume.
        let plain = plain(scene, options.instants);
        let prepared = prepare(&plain, inputs)?;
        let scene_pitch_mm = rounded(prepared.lattice.pitch * 1e3);
        let levels = BTreeMap::from([(scene_pitch_mm.to_bits(), Level { prepared, longest: Vec::new() })]);
        let folder = folder.to_owned();
        Ok(Self { scene, plain, inputs, folder, options, ledger, levels, scene_pitch_mm, began, spent_before })
    }

    /// What was found so far.
    pub fn ledger(&self) -> &Ledger {
        &self.ledger
    }

    /// The same, to be added to.
    pub fn ledger_mut(&mut self) -> &mut Ledger {
        &mut self.ledger
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        self.scene
    }

    /// The volumes of the scene.
    pub fn inputs(&self) -> &Inputs {
        self.inputs
    }

    /// What is asked for.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Folder of the first run of a choice.
    pub fn run_folder(&self, choice: &Choice) -> PathBuf {
        self.folder.join(RUNS).join(choice.key())
    }

    /// Time since the study was begun, over all calls \[s\].
    pub fn spent(&self) -> f64 {
        self.spent_before + self.began.elapsed().as_secs_f64()
    }

    /// Times steps of every pitch, where that is not known yet, and plans the runs. What runs took is a better guess than the probe,
    /// so that a plan made after some runs may hold more of them; it holds all that were made.
    ///
    /// # Errors
    /// If no pitch can be had.
    pub fn plan(&mut self) -> Result<Plan, StudyError> {
        let by_scene = || PITCHES.iter().map(|share| rounded(share * self.scene_pitch_mm)).collect();
        let pitches: Vec<f64> = self.options.pitches_mm.clone().unwrap_or_else(by_scene);
        for &pitch_mm in &pitches {
            let wanted = self.probed(pitch_mm);
            let knows = |probe: &ProbeLine, choice: &Choice| {
                probe.paces.iter().any(|pace| pace.choice == *choice) || probe.untimed.contains(choice)
            };
            let known = self.ledger.probe(pitch_mm);
            if known.is_none_or(|probe| probe.failed.is_none() && !wanted.iter().all(|choice| knows(probe, choice))) {
                let probe = self.probe(pitch_mm, &wanted);
                self.ledger.push(Line::Probe(probe))?;
            }
        }
        let probes = pitches.iter().filter_map(|&pitch_mm| self.ledger.probe(pitch_mm));
        let probes: Vec<ProbeLine> = probes.map(|probe| self.learned(probe)).collect();
        let known = |choice: &Choice| self.ledger.has(choice, 0);
        plan(&probes, &self.options, self.scene_pitch_mm, &known).ok_or_else(|| {
            let why: Vec<String> = probes.iter().filter_map(|probe| probe.failed.clone()).collect();
            StudyError::NoPitch { why: why.join("; ") }
        })
    }

    /// The choices that are timed at a pitch: every integrator, and at the finest step too where that costs not just so many times more;
    /// f64 where it may be run. The dearest come last.
    fn probed(&self, pitch_mm: f64) -> Vec<Choice> {
        let Options { integrators, arithmetic, finenesses, .. } = &self.options;
        let usual = self.options.usual();
        let coarsest = finenesses.iter().copied().fold(f64::INFINITY, f64::min);
        let most = finenesses.iter().copied().fold(0.0, f64::max);
        let methods = || METHODS.iter().copied().filter(|method| integrators.contains(method));
        let timed = |integrator, fineness, arithmetic| Choice { integrator, pitch_mm, fineness, arithmetic };
        let mut wanted: Vec<Choice> =
            methods().filter(|&method| may_judge(method)).map(|method| timed(method, coarsest, usual)).collect();
        if usual != Arithmetic::Double && arithmetic.contains(&Arithmetic::Double) && pitch_mm == self.scene_pitch_mm {
            let of_grid = wanted.clone();
            wanted.extend(of_grid.iter().map(|choice| choice.in_arithmetic(Arithmetic::Double)));
        }
        for method in methods().filter(|&method| !may_judge(method)) {
            wanted.push(timed(method, coarsest, usual));
            if most > coarsest {
                wanted.push(timed(method, most, usual));
            }
        }
        wanted
    }

    /// A probe with what runs of its pitch took in place of its own guesses.
    fn learned(&self, probe: &ProbeLine) -> ProbeLine {
        let mut learned = probe.clone();
        for run in self.ledger.runs().filter(|run| run.failed.is_none() && run.repeat == 0) {
            if run.choice.pitch_mm == probe.pitch_mm {
                learned.paces.retain(|pace| pace.choice != run.choice);
                learned.paces.push(Pace { choice: run.choice.clone(), seconds: run.seconds / SLACK });
            }
        }
        learned
    }

    fn probe(&mut self, pitch_mm: f64, wanted: &[Choice]) -> ProbeLine {
        let begun = Instant::now();
        let most = Duration::from_secs_f64(PROBE * self.options.budget_seconds);
        let mut probed = || -> Result<(usize, Vec<Pace>, Duration), String> {
            let text = |error: &dyn std::error::Error| error.to_string();
            let scene = self.at_pitch(pitch_mm);
            let schedule = |choice: &Choice| Ok((choice.clone(), self.schedule(choice)?));
            let ways = wanted.iter().map(schedule).collect::<Result<Vec<_>, PrepareError>>();
            let ways = ways.map_err(|error| text(&error))?;
            let prepared = self.level(pitch_mm).map_err(|error| text(&error))?.prepared.clone();
            let particles = prepared.lattice.len();
            let timeline = Timeline::with_tools(&scene.operations, &prepared.lattice, &self.inputs.tools);
            let mut timeline = timeline.map_err(|error| text(&error))?;
            let mut world = prepared.into_world(&scene);
            let stepping = Instant::now();
            let paces = paces(&mut world, &mut timeline, &ways, most).map_err(|error| text(&error))?;
            Ok((particles, paces, stepping.elapsed()))
        };
        let found = probed();
        // Preparing is timed with it: runs clone what was prepared, and write a few frames.
        let other_seconds = |stepping: Duration| begun.elapsed().saturating_sub(stepping).as_secs_f64().max(0.05);
        match found {
            Ok((particles, paces, stepping)) => {
                let untimed = |choice: &&Choice| paces.iter().all(|pace| pace.choice != **choice);
                let untimed = wanted.iter().filter(untimed).cloned().collect();
                let other_seconds = other_seconds(stepping);
                ProbeLine { pitch_mm, particles, paces, untimed, other_seconds, failed: None }
            }
            Err(why) => ProbeLine {
                pitch_mm,
                particles: 0,
                paces: Vec::new(),
                untimed: Vec::new(),
                other_seconds: other_seconds(Duration::ZERO),
                failed: Some(format!("pitch {pitch_mm} mm: {why}")),
            },
        }
    }

    fn at_pitch(&self, pitch_mm: f64) -> Scene {
        self.plain.at_pitch(self.scene_pitch_mm * 1e-3, pitch_mm * 1e-3)
    }

    fn level(&mut self, pitch_mm: f64) -> Result<&mut Level, PrepareError> {
        let key = pitch_mm.to_bits();
        if !self.levels.contains_key(&key) {
            let prepared = prepare(&self.at_pitch(pitch_mm), self.inputs)?;
            self.levels.insert(key, Level { prepared, longest: Vec::new() });
        }
        Ok(self.levels.get_mut(&key).expect("just prepared"))
    }

    /// The steps of a choice.
    fn schedule(&mut self, choice: &Choice) -> Result<Schedule, PrepareError> {
        let scene = self.at_pitch(choice.pitch_mm);
        let Level { prepared, longest: known } = self.level(choice.pitch_mm)?;
        let own = known.iter().find(|(method, _)| *method == choice.integrator).map(|(_, schedule)| *schedule);
        let own = match own {
            Some(own) => own,
            None => {
                let own = longest(choice.integrator, prepared, &scene)?;
                known.push((choice.integrator, own));
                own
            }
        };
        Ok(choice.schedule(&own))
    }

    /// Makes the runs of a plan that are not known yet, round after round.
    ///
    /// # Errors
    /// If a run cannot be prepared or written. A run that diverges is a result, and no error.
    pub fn run(&mut self, plan: &Plan, tell: &mut dyn FnMut(&Progress<'_>)) -> Result<(), StudyError> {
        let rounds = plan.tasks.iter().map(|task| task.repeats).max().unwrap_or(0);
        let budget_seconds = self.options.budget_seconds;
        let all = (0..rounds).flat_map(|round| plan.tasks.iter().map(move |task| (round, task)));
        let all: Vec<_> = all.filter(|(round, task)| *round < task.repeats).collect();
        let known = |(round, task): &&(usize, &super::plan::Task)| self.ledger.has(&task.choice, *round);
        tell(&Progress::Planned { runs: all.len(), known: all.iter().filter(known).count() });
        for (round, task) in all {
            if self.ledger.has(&task.choice, round) {
                continue;
            }
            let was_skipped = |skipped: &SkippedLine| skipped.choice == task.choice && skipped.repeat == round;
            if self.ledger.skipped(budget_seconds).any(was_skipped) {
                tell(&Progress::Ended);
                continue;
            }
            // What this choice took before is the best guess.
            let before = self.ledger.runs().filter(|run| run.choice == task.choice).map(|run| run.all_seconds);
            let seconds = before.reduce(f64::max).unwrap_or_else(|| self.corrected(task.seconds, plan));
            let must = round == 0 && self.ledger.runs().count() < 2;
            if !must && self.spent() + seconds > ALL_RUNS * budget_seconds {
                let choice = task.choice.clone();
                self.ledger.push(Line::Skipped(SkippedLine { choice, repeat: round, seconds, budget_seconds }))?;
                tell(&Progress::Ended);
                continue;
            }
            tell(&Progress::Begins(&task.choice));
            let rounding = round == 0 && plan.tasks.first().is_some_and(|first| first.choice == task.choice);
            self.run_one(&task.choice, round, rounding)?;
            tell(&Progress::Ended);
        }
        Ok(())
    }

    /// An estimate \[s\], corrected by how others turned out.
    fn corrected(&self, seconds: f64, plan: &Plan) -> f64 {
        let (mut taken, mut planned) = (0.0, 0.0);
        for run in self.ledger.runs().filter(|run| run.failed.is_none()) {
            if let Some(task) = plan.tasks.iter().find(|task| task.choice == run.choice) {
                taken += run.all_seconds;
                planned += task.seconds;
            }
        }
        if planned > 0.0 { seconds * (taken / planned).clamp(0.3, 4.0) } else { seconds }
    }

    fn run_one(&mut self, choice: &Choice, repeat: usize, rounding: bool) -> Result<(), StudyError> {
        let begun = Instant::now();
        let scene = choice.apply(&self.plain, self.scene_pitch_mm);
        let schedule = self.schedule(choice)?;
        let mut prepared = self.level(choice.pitch_mm)?.prepared.clone();
        prepared.schedule = schedule;
        let particles = prepared.lattice.len();
        let mut timeline = Timeline::with_tools(&scene.operations, &prepared.lattice, &self.inputs.tools)?;
        let folder = self.run_folder(choice);
        let recorder = if repeat == 0 {
            // One that was interrupted is there, but not in the ledger.
            RunWriter::check_place(&folder, true)?;
            Some(Recorder::create(&folder, &scene, None, self.inputs, &prepared, true)?)
        } else {
            None
        };
        let mut world = prepared.into_world(&scene);
        world.set_integrator(choice.way());
        let mut watch = Watch { recorder, ..Watch::new() };
        let driven = drive(&mut world, &mut timeline, &schedule, &mut watch);
        let (failed, counts) = match driven {
            Ok(counts) => (None, Some(counts)),
            Err(DriveError::Step(error)) => (Some(error.to_string()), None),
            Err(DriveError::Observer(
                error @ (WriteRunError::NotFinite { .. } | WriteRunError::SeriesNotFinite { .. }),
            )) => (Some(error.to_string()), None),
            Err(DriveError::Observer(error)) => return Err(error.into()),
        };
        if let Some(recorder) = watch.recorder.take() {
            recorder.finish(match &failed {
                None => Status::Complete,
                Some(reason) => Status::Stopped { reason: reason.clone() },
            })?;
        }
        let mut bits = Sha256::new();
        for displacement in world.displacements_mm() {
            displacement.iter().for_each(|part| bits.update(part.to_le_bytes()));
        }
        let effort = world.effort();
        let (steps, evaluations) = match choice.integrator.evaluations() {
            Some(each) => (world.steps(), each * world.steps()),
            None => (effort.parts, effort.evaluations),
        };
        let planned = choice.integrator.evaluations().is_some() || steps <= schedule.steps;
        let line = RunLine {
            choice: choice.clone(),
            repeat,
            particles,
            dt_s: if planned { schedule.dt } else { schedule.dt * schedule.steps as f64 / steps as f64 },
            steps,
            divided: counts.map_or(0, |counts| counts.divided),
            evaluations,
            seconds: watch.stepping.as_secs_f64(),
            severed: world.topology().severed().len(),
            energy_j: watch.energy_j,
            momentum: watch.momentum,
            volume: watch.volume,
            all_seconds: begun.elapsed().as_secs_f64(),
            bits: hex(bits),
            failed,
        };
        let sound = line.failed.is_none();
        self.ledger.push(Line::Run(line))?;
        if rounding && sound && self.ledger.rounding().is_none() {
            let most = Duration::from_secs_f64(0.05 * self.options.budget_seconds);
            if let Some(found) = rounding::measure(&world, &scene, &choice.key(), most) {
                self.ledger.push(Line::Rounding(found))?;
            }
        }
        Ok(())
    }
}

/// Times the steps of a run, and keeps what is judged.
struct Watch {
    recorder: Option<Recorder>,
    /// End of the last frame.
    from: Instant,
    /// End of the last step.
    to: Instant,
    stepping: Duration,
    energy_j: Vec<[f64; 2]>,
    momentum: Vec<[f64; 3]>,
    volume: Vec<f64>,
}

impl Watch {
    fn new() -> Self {
        let now = Instant::now();
        Self {
            recorder: None,
            from: now,
            to: now,
            stepping: Duration::ZERO,
            energy_j: Vec::new(),
            momentum: Vec::new(),
            volume: Vec::new(),
        }
    }
}

impl Observer for Watch {
    type Error = WriteRunError;

    fn frame(&mut self, frame: &Frame<'_>) -> Result<(), WriteRunError> {
        self.stepping += self.to.saturating_duration_since(self.from);
        if frame.number > 0 {
            let balance = &frame.balance;
            self.energy_j.push([balance.kinetic, balance.elastic]);
            self.momentum.push(balance.momentum.into());
            self.volume.push(frame.volume.change().map_or(1.0, |change| 1.0 + change));
        }
        if let Some(recorder) = &mut self.recorder {
            recorder.frame(frame)?;
        }
        self.from = Instant::now();
        Ok(())
    }

    fn event(&mut self, event: &Event) -> Result<(), WriteRunError> {
        self.recorder.as_mut().map_or(Ok(()), |recorder| recorder.event(event))
    }

    fn step(&mut self, _world: &World) {
        self.to = Instant::now();
    }
}

/// Nine digits are enough of a length in millimetres, and make good names.
fn rounded(mm: f64) -> f64 {
    (mm * 1e6).round() / 1e6
}

fn hex(hash: Sha256) -> String {
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}
