//! Which pitch, integrator and step keep a bound: probes, choices, and the judgement of runs.

use super::pitches::Pitches;
use super::space::{self, pitch_law};
use super::steps::{Law, MOST_FINENESS, better, error_mm, least_price, order};
use super::trial::{Choice, Trial};
use crate::deviation::pitch_law::PitchLaw;
use crate::dynamics::StepError;
use crate::dynamics::integrator::Method;
use crate::dynamics::timeline::{Timeline, TimelineError};
use crate::run::inputs::Inputs;
use crate::run::prepare::{PrepareError, Prepared};
use crate::scene::resolved::{Model, Scene, needs_plain_step};

/// Steps are tried, and pitches chosen, on lattices with so many particles.
const LEAST_PARTICLES: usize = 60;
/// A lattice with so many says something about finer ones.
const LEAST_COMPARED: usize = 20;
/// No lattice with more is chosen unless the scene names its pitch.
const MOST_PARTICLES: f64 = 3e6;
/// Share of the bound that is left to steps where the pitch is chosen too.
const STEPS_SHARE: f64 = 0.2;
/// The next pitch is sought for an error so many times the bound: coarse lattices mostly say too much of finer ones, and a pitch too fine
/// costs more than one more between.
const TOWARD: f64 = 1.2;
/// It is at most so many times finer, by lattices that tell the power of the pitch and by fewer.
const STRIDE: [f64; 2] = [2.0, 1.5];
/// Lattices that are needed to know the power of the pitch.
const KNOWN: usize = 3;
/// With fewer, an error counts as known below this share of the bound.
const UNKNOWN: f64 = 0.4;
/// Particles of a lattice that says of a much finer one what its error will be.
const TRUSTED: f64 = 1000.0;
/// A pitch so many times coarser costs a third: what saves less is not sought once a run is good enough.
const WORTH_KNOWING: f64 = 1.3;
/// A pitch whose error is so many times the bound by its law may happen to keep it.
const HAPPENS: f64 = 5.0;
/// Runs that are judged at most.
const ROUNDS: usize = 12;
/// Steps of a run that another is judged by, over its own.
const CHECK: [f64; 2] = [0.5, 6.0];

/// Why no run could be chosen.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AccuracyError {
    /// The scene cannot be prepared.
    #[error(transparent)]
    Prepare(#[from] PrepareError),
    /// The scene's operations cannot be applied.
    #[error(transparent)]
    Timeline(#[from] TimelineError),
    /// A trial diverged.
    #[error(transparent)]
    Step(#[from] StepError),
}

/// What a search tells while it goes on.
#[derive(Debug)]
pub enum Told<'a> {
    /// A trial begins.
    Begins(&'a Choice),
    /// This share of its time is done, 0 to 1.
    At(f64),
    /// It is over.
    Ended(&'a Trial),
    /// It cannot be run, and a finer lattice is tried.
    Unusable(&'a Choice, &'a AccuracyError),
}

/// The estimated error of a run, relative to the largest displacement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Of stepping.
    pub steps: f64,
    /// Of the pitch; `None` where the scene names it.
    pub pitch: Option<f64>,
    /// The power of the pitch that this follows; `None` likewise.
    pub order: Option<f64>,
    /// Largest displacement of a judged particle [mm].
    pub largest_mm: f64,
}

impl Estimate {
    /// Of both together.
    pub fn error(&self) -> f64 {
        self.steps + self.pitch.unwrap_or(0.0)
    }
}

/// What becomes of a run.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// Its error is within the bound; so would be that of a coarser one, which was found too late.
    Kept(Estimate, Option<Choice>),
    /// It is not, or it diverged and has none, and another choice may be.
    Again(Option<Estimate>, Choice),
    /// It is not, and no choice would be; why, and what to do.
    Missed(Estimate, String),
    /// It diverged, and so would any other.
    Diverged(StepError),
}

/// The search for a scene.
pub struct Search<'a> {
    scene: &'a Scene,
    inputs: &'a Inputs,
    /// The bound, relative to the largest displacement.
    asked: f64,
    /// To choose from.
    pitches: Pitches,
    /// The pitch that the scene names [mm].
    fixed_mm: Option<f64>,
    /// Integrators other than the plain step will do.
    any_method: bool,
    /// Where stepping was tried [mm].
    probed_mm: f64,
    laws: Vec<Law>,
    /// Runs for stepping, on the lattice that was tried.
    probes: Vec<Trial>,
    /// Runs for the pitch, coarsest first; where the scene names it, on that lattice.
    levels: Vec<Trial>,
    /// Nothing better is to be had.
    last: Option<String>,
}

impl<'a> Search<'a> {
    /// The search for a scene; `None` when it asks for no accuracy.
    ///
    /// # Errors
    /// If an organ is empty.
    pub fn new(scene: &'a Scene, inputs: &'a Inputs) -> Result<Option<Self>, AccuracyError> {
        let Some(asked) = scene.accuracy else { return Ok(None) };
        let pitches = Pitches::of(scene, inputs)?;
        let named = scene.lattice.pitch.map(|pitch| pitch * 1e3);
        let fixed_mm = named.or((scene.lattice.model == Model::Paper).then_some(pitches.own_mm));
        let any_method = needs_plain_step(&scene.organs, &scene.operations, scene.sleep).is_none();
        Ok(Some(Self {
            scene,
            inputs,
            asked,
            pitches,
            fixed_mm,
            any_method,
            probed_mm: 0.0,
            laws: Vec::new(),
            probes: Vec::new(),
            levels: Vec::new(),
            last: None,
        }))
    }

    /// The bound, relative to the largest displacement.
    pub fn asked(&self) -> f64 {
        self.asked
    }

    /// The pitch that the scene names, and that is not judged [mm].
    pub fn fixed_mm(&self) -> Option<f64> {
        self.fixed_mm
    }

    /// What to run first, after probes on coarse lattices.
    ///
    /// # Errors
    /// If the scene cannot be run at any pitch.
    pub fn first(&mut self, tell: &mut dyn FnMut(&Told<'_>)) -> Result<Choice, AccuracyError> {
        if let Some(pitch_mm) = self.fixed_mm {
            let plain = Choice { pitch_mm, method: Method::SymplecticEuler, fineness: 1.0 };
            // The constants of model "paper" mean something else at another pitch.
            if self.scene.lattice.model == Model::Paper || !self.probe(2.0 * pitch_mm, tell).unwrap_or(false) {
                self.probes.clear();
                self.laws.clear();
                return Ok(plain);
            }
            let bound_mm = self.asked * self.probes[0].largest_mm;
            return self.choose(pitch_mm, bound_mm, tell);
        }
        let all = self.pitches.all().to_vec();
        let mut pitches = all.into_iter().peekable();
        while let Some(pitch_mm) = pitches.next() {
            match self.probe(pitch_mm, tell) {
                Ok(true) => break,
                // A finer lattice may have what this one lacks.
                Err(error) if pitches.peek().is_none() => return Err(error),
                Ok(false) | Err(_) => {}
            }
        }
        let bound_mm = STEPS_SHARE * self.asked * self.probes[0].largest_mm;
        let Some(next_mm) = self.pitches.below(self.probed_mm, self.probed_mm) else {
            return self.choose(self.pitches.own_mm, bound_mm, tell);
        };
        if let Some(coarser) = self.coarser(bound_mm, tell)? {
            self.levels.push(coarser);
        }
        let here = self.choose(self.probed_mm, bound_mm, tell)?;
        let coarsest = match self.probes.iter().find(|probe| probe.choice == here) {
            Some(probe) => probe.clone(),
            None => self.run(here, tell)?,
        };
        self.levels.push(coarsest);
        self.usable(next_mm, bound_mm, tell)
    }

    /// A lattice clearly coarser than the one that was tried, to compare with: it need not be good for anything else.
    fn coarser(&mut self, bound_mm: f64, tell: &mut dyn FnMut(&Told<'_>)) -> Result<Option<Trial>, AccuracyError> {
        let choice = self.choose(self.pitches.clearly_above(self.probed_mm), bound_mm, tell)?;
        let prepared = choice.prepare(self.scene, self.inputs);
        let compares = prepared.is_ok_and(|(_, prepared)| prepared.lattice.len() >= LEAST_COMPARED);
        Ok(if compares { self.run(choice, tell).ok() } else { None })
    }

    /// Judges a run of the last choice, or what ended it.
    ///
    /// # Errors
    /// If a run that it takes to judge this one cannot be made.
    pub fn judge(
        &mut self,
        choice: &Choice,
        run: Result<Trial, StepError>,
        tell: &mut dyn FnMut(&Told<'_>),
    ) -> Result<Verdict, AccuracyError> {
        match (run, self.fixed_mm) {
            (Ok(trial), Some(_)) => self.judge_steps(trial, tell),
            (Ok(trial), None) => self.judge_pitch(trial, tell),
            (Err(error), Some(_)) => Ok(Verdict::Diverged(error)),
            (Err(error), None) => {
                // A finer lattice may hold together.
                let Some(finer_mm) = self.pitches.below(choice.pitch_mm, choice.pitch_mm) else {
                    return Ok(Verdict::Diverged(error));
                };
                tell(&Told::Unusable(choice, &error.into()));
                let bound_mm = STEPS_SHARE * self.asked * self.probes[0].largest_mm;
                Ok(Verdict::Again(None, self.usable(finer_mm, bound_mm, tell)?))
            }
        }
    }

    /// Where the pitch is chosen: by the lattices before.
    fn judge_pitch(&mut self, trial: Trial, tell: &mut dyn FnMut(&Told<'_>)) -> Result<Verdict, AccuracyError> {
        let Choice { pitch_mm, method, .. } = trial.choice;
        let (largest_mm, dt, particles) = (trial.largest_mm, trial.dt, trial.len() as f64);
        self.levels.push(trial);
        let law = self.laws.iter().find(|law| law.method == method);
        let steps_mm = law.map_or(0.0, |law| law.error_mm(dt));
        let share = |mm: f64| if largest_mm > 0.0 { mm / largest_mm } else { 0.0 };
        let found = pitch_law(&self.levels);
        let estimate = Estimate {
            steps: share(steps_mm),
            pitch: found.map(|law| share(law.error(pitch_mm).rms_mm)),
            order: found.map(|law| law.order),
            largest_mm,
        };
        let Some(found) = found else {
            let what = match self.levels.len() {
                1 => "the organs have too few voxels for coarser lattices",
                _ => {
                    "no place of this lattice can be compared with a coarser one: it has few particles, or cuts leave no cell whole"
                }
            };
            let why = format!("{what}; name a lattice.pitch, and the bound will be that of the steps");
            return Ok(Verdict::Missed(estimate, why));
        };
        let known = self.levels.len() >= KNOWN;
        let affordable_mm = pitch_mm * (particles / MOST_PARTICLES).cbrt();
        let finest_mm = affordable_mm.max(self.pitches.finest());
        let can_be_had = |next_mm: f64| next_mm < 0.999 * pitch_mm && next_mm > 0.99 * finest_mm;
        let ends_here = self.last.is_some() || !self.pitches.below(pitch_mm, pitch_mm).is_some_and(can_be_had);
        if estimate.error() <= if known || ends_here { self.asked } else { UNKNOWN * self.asked } {
            let enough = self.enough(tell);
            return Ok(Verdict::Kept(estimate, enough));
        }
        if let Some(why) = self.last.take() {
            return Ok(Verdict::Missed(estimate, why));
        }
        let bound_mm = self.asked * largest_mm;
        let room_mm = (bound_mm - steps_mm).max(0.1 * bound_mm);
        let wish_mm = found.pitch(room_mm);
        let toward_mm = found.pitch(TOWARD * room_mm).max(pitch_mm / STRIDE[usize::from(!known)]);
        let mut next_mm = self.pitches.below(pitch_mm, toward_mm).unwrap_or(pitch_mm);
        if (known && particles > TRUSTED && wish_mm < 0.75 * finest_mm)
            || !can_be_had(next_mm)
            || self.levels.len() > ROUNDS
        {
            let PitchLaw { order: power, .. } = found;
            let many = particles * (pitch_mm / wish_mm).powi(3);
            let why = format!(
                "the error falls with the power {power:.1} of the pitch: some {wish_mm:.2} mm, with {many:.0e} particles, would be \
                 needed; name that lattice.pitch if you can wait for it, or ask for less"
            );
            // The lattice that the scene would have without being asked for accuracy is the best offer.
            let own_mm = self.pitches.own_mm;
            if pitch_mm <= own_mm * 1.001 || own_mm < finest_mm {
                return Ok(Verdict::Missed(estimate, why));
            }
            next_mm = own_mm;
            self.last = Some(why);
        }
        let choice = self.usable(next_mm, STEPS_SHARE * bound_mm, tell)?;
        Ok(Verdict::Again(Some(estimate), choice))
    }

    /// The coarsest lattice whose error is within the bound too, now that it is known: of those before, and of those passed over, in a
    /// stride or because a box is not whole there, which may happen to do.
    fn enough(&mut self, tell: &mut dyn FnMut(&Told<'_>)) -> Option<Choice> {
        let finest = self.levels.last()?;
        let (finest, largest_mm) = (finest.choice, finest.largest_mm);
        let law = pitch_law(&self.levels)?;
        let known = self.coarsest_within(&[]);
        let least = known.unwrap_or(finest);
        let passed_over = self.pitches.of_any_body().filter(|pitch_mm| {
            let not_run = self.levels.iter().all(|level| (level.choice.pitch_mm / pitch_mm - 1.0).abs() > 0.01);
            not_run && *pitch_mm > WORTH_KNOWING * least.pitch_mm
        });
        let may_do = |pitch_mm: &f64| law.error(*pitch_mm).rms_mm < HAPPENS * self.asked * largest_mm;
        // Runs of boxes that are not whole.
        let mut in_parts = Vec::new();
        for pitch_mm in passed_over.filter(may_do).collect::<Vec<_>>() {
            let choice = Choice { pitch_mm, ..least };
            let tells = |(_, prepared): (Scene, Prepared)| prepared.lattice.len() >= LEAST_COMPARED;
            if !choice.prepare(self.scene, self.inputs).is_ok_and(tells) {
                continue;
            }
            let Ok(trial) = self.run(choice, tell) else { continue };
            if self.pitches.all().iter().any(|own| (own / pitch_mm - 1.0).abs() < 1e-9) {
                // Whole there, it tells more of the errors of all.
                let place = self.levels.partition_point(|level| level.choice.pitch_mm > pitch_mm);
                self.levels.insert(place, trial);
            } else {
                in_parts.push(trial);
            }
            let within = self.coarsest_within(&in_parts);
            if within != known {
                return within;
            }
        }
        known
    }

    /// The coarsest that keeps the bound of the lattices before the last and of others.
    fn coarsest_within(&self, others: &[Trial]) -> Option<Choice> {
        let law = pitch_law(&self.levels)?;
        let (_, before) = self.levels.split_last()?;
        let within = before.iter().chain(others).filter(|run| self.is_within(run, &law)).map(|run| run.choice);
        within.max_by(|a, b| a.pitch_mm.total_cmp(&b.pitch_mm))
    }

    /// Whether a coarser run keeps the bound, by all lattices.
    fn is_within(&self, coarser: &Trial, law: &PitchLaw) -> bool {
        let Some(finest) = self.levels.last() else { return false };
        let steps = self.laws.iter().find(|law| law.method == coarser.choice.method);
        let steps_mm = steps.map_or(0.0, |law| law.error_mm(coarser.dt));
        let pitch_mm = space::error_mm(coarser, &self.levels, law).unwrap_or(f64::INFINITY);
        pitch_mm + steps_mm <= self.asked * finest.largest_mm
    }

    /// Where the scene names the pitch: by another run on the same lattice.
    fn judge_steps(&mut self, trial: Trial, tell: &mut dyn FnMut(&Told<'_>)) -> Result<Verdict, AccuracyError> {
        let Choice { pitch_mm, method, fineness } = trial.choice;
        let (largest_mm, dt) = (trial.largest_mm, trial.dt);
        let here = self.probes.iter().chain(&self.levels).filter(|other| other.choice.pitch_mm == pitch_mm);
        let mut known = here.filter_map(|other| error_mm(&trial, other)).next_back();
        // Where the step control divides steps, those asked for may come out the same.
        let mut ratio = if fineness >= 2.0 { 0.5 } else { 1.5 };
        while known.is_none() && (CHECK[0]..=CHECK[1]).contains(&ratio) {
            match self.run(Choice { fineness: ratio * fineness, ..trial.choice }, tell) {
                Ok(other) => {
                    known = error_mm(&trial, &other);
                    self.levels.push(other);
                }
                // Longer steps may diverge where these do not.
                Err(AccuracyError::Step(_)) => {}
                Err(error) => return Err(error),
            }
            ratio = if ratio < 1.0 { 1.5 } else { 2.0 * ratio };
        }
        self.levels.push(trial);
        let error = known.unwrap_or(f64::INFINITY);
        let share = if largest_mm > 0.0 { error / largest_mm } else { 0.0 };
        let estimate = Estimate { steps: share, pitch: None, order: None, largest_mm };
        if share <= self.asked {
            return Ok(Verdict::Kept(estimate, None));
        }
        self.laws.retain(|law| law.method != method);
        if error.is_finite() {
            self.laws.push(Law { method, dt, error_mm: error });
        }
        if self.probes.is_empty() {
            // No coarser lattice could be tried: this one has been.
            self.probed_mm = pitch_mm;
            self.probes = self.levels.clone();
        }
        let choice = self.choose(pitch_mm, self.asked * largest_mm, tell)?;
        if choice.fineness >= MOST_FINENESS
            || self.levels.len() > ROUNDS
            || choice == self.levels[self.levels.len() - 1].choice
        {
            let why = "shorter steps do not help: cuts, contact or the rounding of f32 decide; ask for less".to_owned();
            return Ok(Verdict::Missed(estimate, why));
        }
        Ok(Verdict::Again(Some(estimate), choice))
    }

    /// Tries the plain step on a lattice; false when that has too few particles.
    fn probe(&mut self, pitch_mm: f64, tell: &mut dyn FnMut(&Told<'_>)) -> Result<bool, AccuracyError> {
        let plain = Choice { pitch_mm, method: Method::SymplecticEuler, fineness: 1.0 };
        let (_, prepared) = plain.prepare(self.scene, self.inputs)?;
        let finest = pitch_mm < 1.01 * self.pitches.finest();
        if prepared.lattice.len() < LEAST_PARTICLES && !finest {
            return Ok(false);
        }
        drop(prepared);
        self.probed_mm = pitch_mm;
        self.probes.clear();
        self.laws.clear();
        let learnt = self.learn(Method::SymplecticEuler, tell);
        if let Err(error) = &learnt {
            tell(&Told::Unusable(&plain, error));
        }
        learnt.map(|()| true)
    }

    /// Finds the error of an integrator on the lattice that is tried.
    fn learn(&mut self, method: Method, tell: &mut dyn FnMut(&Told<'_>)) -> Result<(), AccuracyError> {
        let own = Choice { pitch_mm: self.probed_mm, method, fineness: 1.0 };
        let number = self.probed(own, tell)?;
        // Where the step control divides steps, twice as many may come out the same.
        for fineness in [2.0, 4.0, 8.0] {
            let other = self.probed(Choice { fineness, ..own }, tell)?;
            let run = &self.probes[number];
            if let Some(error_mm) = error_mm(run, &self.probes[other]) {
                self.laws.push(Law { method, dt: run.dt, error_mm });
                break;
            }
        }
        Ok(())
    }

    /// Number of a probe, which is run if it was not yet.
    fn probed(&mut self, choice: Choice, tell: &mut dyn FnMut(&Told<'_>)) -> Result<usize, AccuracyError> {
        if let Some(number) = self.probes.iter().position(|probe| probe.choice == choice) {
            return Ok(number);
        }
        let trial = self.run(choice, tell)?;
        self.probes.push(trial);
        Ok(self.probes.len() - 1)
    }

    fn run(&self, choice: Choice, tell: &mut dyn FnMut(&Told<'_>)) -> Result<Trial, AccuracyError> {
        tell(&Told::Begins(&choice));
        let trial = Trial::run(choice, self.scene, self.inputs, &mut |share| tell(&Told::At(share)))?;
        tell(&Told::Ended(&trial));
        Ok(trial)
    }

    /// What [`Search::choose`] says for a pitch, or for the next finer one on which the scene can be run: on a coarse lattice an organ may be
    /// lost, or a region select no particle.
    ///
    /// # Errors
    /// If the scene cannot be run on the finest either.
    fn usable(
        &mut self,
        mut pitch_mm: f64,
        bound_mm: f64,
        tell: &mut dyn FnMut(&Told<'_>),
    ) -> Result<Choice, AccuracyError> {
        loop {
            let choice = self.choose(pitch_mm, bound_mm, tell)?;
            let Err(error) = self.can_run(&choice) else { return Ok(choice) };
            let Some(finer_mm) = self.pitches.below(pitch_mm, pitch_mm) else { return Err(error) };
            tell(&Told::Unusable(&choice, &error));
            pitch_mm = finer_mm;
        }
    }

    fn can_run(&self, choice: &Choice) -> Result<(), AccuracyError> {
        let (scene, prepared) = choice.prepare(self.scene, self.inputs)?;
        Timeline::with_tools(&scene.operations, &prepared.lattice, &self.inputs.tools)?;
        Ok(())
    }

    /// The cheapest integrator and step whose error at a pitch is within a bound. Better integrators are tried while they might
    /// be cheaper.
    fn choose(
        &mut self,
        pitch_mm: f64,
        bound_mm: f64,
        tell: &mut dyn FnMut(&Told<'_>),
    ) -> Result<Choice, AccuracyError> {
        loop {
            // Stable steps go with the pitch.
            let stable = |law: &Law| {
                let runs = self.probes.iter().chain(&self.levels).filter(|run| run.choice.method == law.method);
                let nearest = runs.min_by(|a, b| {
                    let away = |run: &Trial| (run.choice.pitch_mm / pitch_mm).ln().abs();
                    away(a).total_cmp(&away(b))
                });
                nearest.map_or(law.dt, |run| run.dt * run.choice.fineness * pitch_mm / run.choice.pitch_mm)
            };
            let price = |law: &Law| law.price(stable(law), bound_mm);
            let Some(best) = self.laws.iter().min_by(|a, b| price(a).total_cmp(&price(b))) else {
                return Ok(Choice { pitch_mm, method: Method::SymplecticEuler, fineness: 1.0 });
            };
            let choice = Choice { pitch_mm, method: best.method, fineness: best.fineness(stable(best), bound_mm) };
            let last = self.laws.iter().map(|law| law.method).max_by(|a, b| order(*a).total_cmp(&order(*b)));
            let next = last.and_then(better).filter(|_| self.any_method && !self.probes.is_empty());
            match next {
                Some(next) if least_price(next, stable(best)) < price(best) => {
                    let laws = self.laws.len();
                    match self.learn(next, tell) {
                        // What is known without it will do.
                        Err(AccuracyError::Step(_)) => return Ok(choice),
                        learnt => learnt?,
                    }
                    if self.laws.len() == laws {
                        return Ok(choice);
                    }
                }
                _ => return Ok(choice),
            }
        }
    }
}
