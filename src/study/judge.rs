//! From finished runs to errors.
//!
//! Errors are kept apart by where they come from:
//!
//! - **time**: a run against the [`Reference`] of its own lattice;
//! - **space**: the references of the pitches against that of the finest one, at the particles of the coarser lattice, and from these
//!   an estimate, see [`super::space`];
//! - **both**: their sum, a bound for what both do together.
//!
//! Relative errors are distances over the largest displacement of any particle at any instant in the reference of the scene's own pitch.

use std::collections::BTreeMap;

use super::choice::{Arithmetic, Choice, METHODS};
use super::findings::{Findings, Level, Row, TimeOrder};
use super::ledger::RunLine;
use super::order::fit;
use super::plan::{Plan, Task};
use super::reference::{Reference, Track};
use super::surface_distance::Measured;
use super::surfaces::surface_of;
use super::sweep::Study;
use crate::deviation::pitch_law::PitchLaw;
use crate::deviation::{Carrier, Deviation, Sizes};
use crate::run::meshes::Resolution;
use crate::store::ReadRunError;

/// An error this many times larger than the doubt about its reference is resolved.
const RESOLVED: f64 = 10.0;
/// One this many times larger still shows an order: the doubt is that about the limit before the last, and the last is about three
/// times nearer where errors are smooth.
const SHOWS_ORDER: f64 = 2.5;
/// Half the step makes the error of any integrator smaller by more than this.
const LESS: f64 = 1.2;
/// A run with a larger share of divided steps does not have the step it was given.
const DIVIDED: f64 = 0.05;

/// Judges the runs of a study. `None` when no run came to its end.
///
/// # Errors
/// If a run cannot be read.
pub fn judge(study: &Study<'_>, plan: &Plan) -> Result<Option<Findings>, ReadRunError> {
    let first = |task: &Task| study.ledger().runs().find(|run| run.choice == task.choice && run.repeat == 0);
    let all: Vec<(&Task, &RunLine)> = plan.tasks.iter().filter_map(|task| Some((task, first(task)?))).collect();
    let failed = all.iter().filter_map(|(task, run)| Some((task.choice.clone(), run.failed.clone()?))).collect();
    let done = all.into_iter().filter(|(_, run)| run.failed.is_none()).collect();
    let usual = study.options().usual();
    let judge = Judge { study, plan, done, usual };

    let references = judge.references()?;
    let Some(base) = references.get(&Pitch(plan.base_mm)).or(references.values().next()) else { return Ok(None) };
    let largest_mm = base.largest_mm;
    let mut levels = levels(&references)?;
    let seen: Vec<(f64, Deviation)> =
        levels.iter().filter_map(|level| Some((level.pitch_mm, level.from_finest?))).collect();
    let space_law = levels.last().and_then(|finest| PitchLaw::fit(&seen, finest.pitch_mm));
    for level in &mut levels {
        level.space_error = space_law.map(|law| law.error(level.pitch_mm));
    }
    let rows = judge.rows(&references, &levels)?;
    for level in &mut levels {
        let shown =
            |row: &&Row| row.choice.pitch_mm == level.pitch_mm && row.choice.arithmetic == usual && row.shows_order;
        let order = |&integrator: &_| {
            let own = rows.iter().filter(shown).filter(|row| row.choice.integrator == integrator);
            let points = own.filter_map(|row| Some([row.dt_s, row.time_error?.rms_mm]));
            Some(TimeOrder { integrator, law: fit(&falling(points.collect()))? })
        };
        level.time_orders = METHODS.iter().filter_map(order).collect();
    }
    let cuts_differ = levels.iter().any(|level| {
        let mut severed = rows.iter().filter(|row| row.choice.pitch_mm == level.pitch_mm).map(|row| row.severed);
        let first = severed.next();
        severed.any(|other| Some(other) != first)
    });
    let (base_mm, judge) = (plan.base_mm, plan.judge);
    Ok(Some(Findings { base_mm, usual, judge, largest_mm, rows, levels, space_law, failed, cuts_differ }))
}

/// A pitch as a key; coarser ones come first.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Pitch(f64);

impl Eq for Pitch {}

impl Ord for Pitch {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        other.0.total_cmp(&self.0)
    }
}

impl PartialOrd for Pitch {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

/// The references of all pitches, coarsest first.
type References = BTreeMap<Pitch, Reference>;

/// What is judged.
struct Judge<'a> {
    study: &'a Study<'a>,
    plan: &'a Plan,
    /// First runs that came to their end.
    done: Vec<(&'a Task, &'a RunLine)>,
    /// Numbers of the grid; the others are there only for comparison.
    usual: Arithmetic,
}

impl<'a> Judge<'a> {
    /// Whether others may be judged by a choice.
    fn is_judge(&self, choice: &Choice) -> bool {
        choice.integrator == self.plan.judge && choice.arithmetic == self.usual
    }

    /// Runs of a pitch that others are judged by, coarsest step first.
    fn ladder(&self, pitch_mm: f64) -> Vec<&'a RunLine> {
        let own = |run: &&RunLine| run.choice.pitch_mm == pitch_mm && self.is_judge(&run.choice);
        let mut ladder: Vec<&RunLine> = self.done.iter().map(|(_, run)| *run).filter(own).collect();
        ladder.sort_by(|a, b| a.choice.fineness.total_cmp(&b.choice.fineness));
        ladder
    }

    fn references(&self) -> Result<References, ReadRunError> {
        let mut pitches: Vec<f64> = self.done.iter().map(|(task, _)| task.choice.pitch_mm).collect();
        pitches.sort_by(|a, b| b.total_cmp(a));
        pitches.dedup();
        // The scene's own first: it shows whether the order of the integrator can be trusted where there are but two runs.
        pitches.sort_by_key(|&pitch| pitch != self.plan.base_mm);
        let mut smooth = false;
        let mut references = References::new();
        for pitch in pitches {
            let ladder = self.ladder(pitch);
            let last = &ladder[ladder.len().saturating_sub(3)..];
            let read = |run: &&RunLine| Ok((run.choice.fineness, Track::read(&self.study.run_folder(&run.choice))?));
            let runs = last.iter().map(read).collect::<Result<Vec<_>, ReadRunError>>()?;
            let whole = last.iter().all(|run| keeps_its_step(run));
            let order = f64::from(self.plan.judge.order().unwrap_or(1));
            if let Some(reference) = Reference::of(runs, self.study.scene(), order, smooth && whole) {
                smooth |= pitch == self.plan.base_mm && reference.extrapolated;
                references.insert(Pitch(pitch), reference);
            }
        }
        Ok(references)
    }

    fn rows(&self, references: &References, levels: &[Level]) -> Result<Vec<Row>, ReadRunError> {
        let finest = self.finest();
        let surface = |choice: &Choice| {
            let drawn = surface_of(self.study, choice, Resolution::Volume)?;
            Measured::new(drawn.meshes.iter().map(|mesh| &mesh.mesh))
        };
        let finest_surface = finest.and_then(surface);
        let mut rows = Vec::new();
        for (task, run) in &self.done {
            let own = if finest == Some(&task.choice) { None } else { surface(&task.choice) };
            let distance = own.zip(finest_surface.as_ref()).map(|(own, finest)| own.distance(finest));
            let level = levels.iter().find(|level| level.pitch_mm == task.choice.pitch_mm);
            let reference = references.get(&Pitch(task.choice.pitch_mm));
            rows.push(Row { surface: distance, ..self.row(task, run, reference, level)? });
        }
        Ok(rows)
    }

    /// All of a row but its surface.
    fn row(
        &self,
        task: &Task,
        run: &RunLine,
        reference: Option<&Reference>,
        level: Option<&Level>,
    ) -> Result<Row, ReadRunError> {
        let ladder = self.ladder(task.choice.pitch_mm);
        let track = Track::read(&self.study.run_folder(&task.choice))?;
        // The finest run is no better judged by its own limit than that limit is known.
        let finest = ladder.last().copied().filter(|finest| finest.choice != task.choice);
        let time_error = reference.filter(|_| ladder.len() > 1).and_then(|reference| {
            let is_reference = finest.is_none() && !reference.extrapolated;
            // Its distance from itself says nothing.
            if is_reference { reference.doubt } else { reference.deviation(&track) }
        });
        let doubt = reference.and_then(|reference| reference.doubt).filter(|_| finest.is_some());
        let beyond_doubt =
            |times: f64| time_error.zip(doubt).is_some_and(|(error, doubt)| error.rms_mm >= times * doubt.rms_mm);
        let twin = task.choice.in_arithmetic(self.usual);
        let twin = self.done.iter().find(|(other, _)| task.choice != twin && other.choice == twin);
        let from_usual = match (twin, reference) {
            (Some(_), Some(reference)) => {
                let usual = Track::read(&self.study.run_folder(&task.choice.in_arithmetic(self.usual)))?;
                reference.apart(&track, &usual)
            }
            _ => None,
        };
        let space_error = level.and_then(|level| level.space_error);
        let both = |(time, space): (Deviation, Sizes)| Sizes {
            max_mm: time.max_mm + space.max_mm,
            rms_mm: time.rms_mm + space.rms_mm,
        };
        let repeats = || self.study.ledger().runs().filter(|other| other.choice == task.choice);
        let mut seconds: Vec<f64> = repeats().map(|other| other.seconds).collect();
        seconds.sort_by(f64::total_cmp);
        Ok(Row {
            choice: task.choice.clone(),
            reference: task.reference || (ladder.len() > 1 && finest.is_none()),
            particles: run.particles,
            dt_s: run.dt_s,
            steps: run.steps,
            divided: run.divided,
            evaluations: run.evaluations,
            severed: run.severed,
            seconds,
            same_bits: repeats().all(|other| other.bits == run.bits),
            time_error,
            time_resolved: beyond_doubt(RESOLVED),
            shows_order: beyond_doubt(SHOWS_ORDER) && keeps_its_step(run),
            from_usual,
            space_error,
            error: time_error.zip(space_error).map(both),
            volume_error: finest.map(|finest| furthest(&run.volume, &finest.volume)),
            energy_error: finest.map(|finest| energy_error(run, finest)),
            momentum_error: finest.map(|finest| momentum_error(run, finest)),
            surface: None,
        })
    }

    /// The run of the finest pitch with the shortest step.
    fn finest(&self) -> Option<&'a Choice> {
        let own = self.done.iter().map(|(task, _)| &task.choice).filter(|choice| self.is_judge(choice));
        own.min_by(|a, b| a.pitch_mm.total_cmp(&b.pitch_mm).then(b.fineness.total_cmp(&a.fineness)))
    }
}

/// Every pitch, with its distance from the finest; the errors are not known yet.
fn levels(references: &References) -> Result<Vec<Level>, ReadRunError> {
    let Some((&finest_pitch, finest)) = references.last_key_value() else { return Ok(Vec::new()) };
    let topology = finest.track.topology()?;
    let level = |(&pitch, reference): (&Pitch, &Reference)| {
        let coarse = reference.track.lattice();
        let instants = reference.track.frames.iter().zip(&finest.track.frames);
        let distances = instants.map(|(found, expected)| {
            let fine = Carrier { lattice: finest.track.lattice(), topology: &topology, displacements: expected };
            reference.judged.between_lattices((coarse, found), fine)
        });
        Level {
            pitch_mm: pitch.0,
            particles: coarse.len(),
            extrapolated: reference.extrapolated,
            doubt: reference.doubt,
            time_orders: Vec::new(),
            from_finest: if pitch == finest_pitch { None } else { distances.reduce(Deviation::worse) },
            space_error: None,
        }
    };
    Ok(references.iter().map(level).collect())
}

/// Points \[step, error\] from the longest step on, as long as a shorter one errs clearly less: from there on rounding, or what jumps from
/// step to step, decides.
fn falling(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_by(|a, b| b[0].total_cmp(&a[0]));
    let end = points.windows(2).position(|pair| pair[1][1] > pair[0][1] / LESS);
    points.truncate(end.map_or(points.len(), |end| end + 1));
    points
}

/// Whether a run has the step it was given: hardly any was divided, or it divides its steps itself.
fn keeps_its_step(run: &RunLine) -> bool {
    run.choice.tolerance().is_some() || run.divided as f64 <= DIVIDED * run.steps as f64
}

/// Largest difference of kinetic and elastic energy at any instant, over the largest energy.
fn energy_error(run: &RunLine, finest: &RunLine) -> f64 {
    let sums = |run: &RunLine| run.energy_j.iter().map(|[kinetic, elastic]| kinetic + elastic).collect::<Vec<f64>>();
    let largest = sums(finest).into_iter().fold(f64::MIN_POSITIVE, f64::max);
    furthest(&sums(run), &sums(finest)) / largest
}

/// Largest difference of momentum at any instant \[kg m/s\].
fn momentum_error(run: &RunLine, finest: &RunLine) -> f64 {
    let apart = |(a, b): (&[f64; 3], &[f64; 3])| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
    run.momentum.iter().zip(&finest.momentum).map(apart).fold(0.0, f64::max)
}

fn furthest(found: &[f64], expected: &[f64]) -> f64 {
    found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_order_ends_where_rounding_begins() {
        let steps = [1.0, 0.25, 0.5, 0.125, 0.0625];
        let errors = |floor: f64| steps.map(|dt: f64| [dt, dt.powi(2) + floor]).to_vec();
        assert_eq!(falling(errors(0.0)).len(), 5);
        assert_eq!(falling(errors(0.1)), [[1.0, 1.1], [0.5, 0.35], [0.25, 0.1625], [0.125, 0.115625]]);
        assert_eq!(falling(errors(9.0)), [[1.0, 10.0]]);
        assert!(falling(Vec::new()).is_empty());
    }
}
