//! From finished runs to errors.
//!
//! Errors are kept apart by where they come from:
//!
//! - **time**: a run against the [`Reference`] of its own lattice;
//! - **space**: the references of the pitches against that of the finest one, at the particles of the coarser lattice. The finest pitch
//!   is no truth: if errors go with a power of the pitch, `D(h) = c (h^q - H^q)` is what is seen against the finest pitch `H`, and
//!   `c h^q` is the error; `q` and `c` are fitted to all pitches;
//! - **both**: their sum, a bound for what both do together.
//!
//! Relative errors are distances over the largest displacement of any particle at any instant in the reference of the scene's own pitch.

use std::collections::BTreeMap;

use super::choice::Choice;
use super::deviation::{Deviation, between_lattices};
use super::ledger::RunLine;
use super::order::{PowerLaw, fit};
use super::plan::{Plan, Task};
use super::reference::{Reference, Track};
use super::surface_distance::{Measured, SurfaceDistance};
use super::surfaces::surface_of;
use super::sweep::Study;
use crate::run::meshes::Resolution;
use crate::store::ReadRunError;

/// An error this many times larger than the doubt about its reference is resolved.
const RESOLVED: f64 = 10.0;
/// One this many times larger still shows an order: the doubt is that about the limit before the last.
const SHOWS_ORDER: f64 = 4.0;
/// A run with a larger share of divided steps does not have the step it was given.
const DIVIDED: f64 = 0.05;

/// Two sizes of an error \[mm\].
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Sizes {
    /// Of the particle that is off most.
    pub max_mm: f64,
    /// Root of the mean square over the particles.
    pub rms_mm: f64,
}

/// What one choice costs and brings.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Row {
    /// The choice.
    pub choice: Choice,
    /// There only to judge others by.
    pub reference: bool,
    /// Particles.
    pub particles: usize,
    /// Time step \[s\].
    pub dt_s: f64,
    /// Steps taken.
    pub steps: u64,
    /// Those that were divided, where the tissue was deformed too far for the step.
    pub divided: u64,
    /// Computations of all forces.
    pub evaluations: u64,
    /// Springs severed.
    pub severed: usize,
    /// Time of each repeat, ascending \[s\].
    pub seconds: Vec<f64>,
    /// All repeats came to the same bits.
    pub same_bits: bool,
    /// Distance from the reference of its lattice.
    pub time_error: Option<Deviation>,
    /// Whether that is ten times the doubt about the reference.
    pub time_resolved: bool,
    /// Whether the row may show the order of its integrator: its error is clear enough, and its steps were not divided.
    pub shows_order: bool,
    /// Error of its pitch, estimated.
    pub space_error: Option<Sizes>,
    /// Sum of both.
    pub error: Option<Sizes>,
    /// Largest difference of the volume of whole cells from the finest run of its pitch, over that volume at rest.
    pub volume_error: Option<f64>,
    /// Largest difference of kinetic and elastic energy from the same, over the largest energy.
    pub energy_error: Option<f64>,
    /// Largest difference of momentum from the same \[kg m/s\].
    pub momentum_error: Option<f64>,
    /// Distance of the surfaces at the end from those of the finest run of all; `None` for that run.
    pub surface: Option<SurfaceDistance>,
}

impl Row {
    /// The shortest time \[s\].
    pub fn least_seconds(&self) -> f64 {
        self.seconds.first().copied().unwrap_or(f64::NAN)
    }

    /// The middle time \[s\].
    pub fn median_seconds(&self) -> f64 {
        self.seconds.get((self.seconds.len().max(1) - 1) / 2).copied().unwrap_or(f64::NAN)
    }
}

/// A pitch.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Level {
    /// Distance of particles \[mm\].
    pub pitch_mm: f64,
    /// Particles.
    pub particles: usize,
    /// Whether its reference is a limit of vanishing steps, or its finest run.
    pub extrapolated: bool,
    /// Doubt about its reference.
    pub doubt: Option<Deviation>,
    /// Power of the step that the time errors (rms) follow, of rows that show it.
    pub time_order: Option<PowerLaw>,
    /// Its reference against that of the finest pitch.
    pub from_finest: Option<Deviation>,
    /// Estimated error of the pitch.
    pub space_error: Option<Sizes>,
}

/// How errors go with the pitch: `c h^q`.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct SpaceLaw {
    /// The power `q`.
    pub order: f64,
    /// Whether it was found in the runs, or taken as 1 because there are too few pitches or no power fits.
    pub found: bool,
    /// Pitches that were compared with the finest.
    pub pitches: usize,
}

/// All that was found.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Findings {
    /// The pitch of the scene \[mm\].
    pub base_mm: f64,
    /// Largest displacement in its reference: what relative errors are relative to \[mm\].
    pub largest_mm: f64,
    /// One row for each choice that came to its end.
    pub rows: Vec<Row>,
    /// Pitches, coarsest first.
    pub levels: Vec<Level>,
    /// How errors go with the pitch; `None` with one pitch.
    pub space_law: Option<SpaceLaw>,
    /// Choices that did not come to their end, and why.
    pub failed: Vec<(Choice, String)>,
    /// Whether runs of one pitch severed different springs.
    pub cuts_differ: bool,
}

/// Judges the runs of a study. `None` when no run came to its end.
///
/// # Errors
/// If a run cannot be read.
pub fn judge(study: &Study<'_>, plan: &Plan) -> Result<Option<Findings>, ReadRunError> {
    let done: Vec<(&Task, &RunLine)> = plan
        .tasks
        .iter()
        .filter_map(|task| {
            Some((task, study.ledger().runs().find(|run| run.choice == task.choice && run.repeat == 0)?))
        })
        .collect();
    let failed = done.iter().filter_map(|(task, run)| Some((task.choice.clone(), run.failed.clone()?))).collect();
    let done: Vec<(&Task, &RunLine)> = done.into_iter().filter(|(_, run)| run.failed.is_none()).collect();
    // Arithmetic of the grid; the other one is there only for comparison.
    let usual = plan.tasks.first().is_some_and(|task| task.choice.exact);
    let judges = |pitch: f64| {
        let own = |(task, _): &&(&Task, &RunLine)| {
            let Choice { integrator, pitch_mm, exact, .. } = &task.choice;
            *pitch_mm == pitch && integrator == plan.judge.name && *exact == usual
        };
        let mut list: Vec<&(&Task, &RunLine)> = done.iter().filter(own).collect();
        list.sort_by(|a, b| a.0.choice.fineness.total_cmp(&b.0.choice.fineness));
        list
    };
    let mut pitches: Vec<f64> = done.iter().map(|(task, _)| task.choice.pitch_mm).collect();
    pitches.sort_by(|a, b| b.total_cmp(a));
    pitches.dedup();

    // The scene's own pitch first: it shows whether the order of the integrator can be trusted.
    let mut order: Vec<f64> = pitches.clone();
    order.sort_by_key(|&pitch| pitch != plan.base_mm);
    let mut smooth = false;
    let mut references: BTreeMap<u64, Reference> = BTreeMap::new();
    for pitch in order {
        let ladder = judges(pitch);
        let last = &ladder[ladder.len().saturating_sub(3)..];
        let read =
            |run: &&&(&Task, &RunLine)| Ok((run.0.choice.fineness, Track::read(&study.run_folder(&run.0.choice))?));
        let runs = last.iter().map(|run| read(&run)).collect::<Result<Vec<_>, ReadRunError>>()?;
        // A step that was divided is not the one that was chosen.
        let whole = last.iter().all(|(_, run)| run.divided as f64 <= DIVIDED * run.steps as f64);
        if let Some(reference) = Reference::of(runs, study.scene(), plan.judge.order, smooth && whole) {
            if pitch == plan.base_mm {
                smooth = reference.extrapolated;
            }
            references.insert(pitch.to_bits(), reference);
        }
    }
    let Some(base) = references.get(&plan.base_mm.to_bits()).or(references.values().next()) else { return Ok(None) };
    let largest_mm = base.largest_mm;

    let mut levels: Vec<Level> = Vec::new();
    let finest = pitches.last().and_then(|pitch| references.get(&pitch.to_bits()));
    let topology = finest.map(|finest| finest.track.topology()).transpose()?;
    for &pitch_mm in &pitches {
        let Some(reference) = references.get(&pitch_mm.to_bits()) else { continue };
        let from_finest = match (finest, &topology) {
            (Some(finest), Some(topology)) if !std::ptr::eq(finest, reference) => {
                let coarse = reference.track.lattice();
                let pairs = reference.track.frames.iter().zip(&finest.track.frames);
                pairs
                    .map(|(found, expected)| {
                        let fine = (finest.track.lattice(), topology, &expected[..]);
                        between_lattices((coarse, &reference.particles, found), fine)
                    })
                    .reduce(Deviation::worse)
            }
            _ => None,
        };
        levels.push(Level {
            pitch_mm,
            particles: reference.track.lattice().len(),
            extrapolated: reference.extrapolated,
            doubt: reference.doubt,
            time_order: None,
            from_finest,
            space_error: None,
        });
    }
    let space_law = space_errors(&mut levels);

    let finest_choice = finest_run(&done, plan);
    let finest_surface = finest_choice.and_then(|choice| surface_of(study, choice, Resolution::Volume));
    let finest_surface = finest_surface.and_then(|surface| Measured::new(surface.meshes.iter().map(|m| &m.mesh)));
    let mut rows = Vec::new();
    for (task, run) in &done {
        let reference = references.get(&task.choice.pitch_mm.to_bits());
        let ladder = judges(task.choice.pitch_mm);
        let finest_of_pitch = ladder.last().map(|last| last.1);
        let is_finest = finest_of_pitch.is_some_and(|finest| finest.choice == task.choice);
        let track = Track::read(&study.run_folder(&task.choice))?;
        // The finest run is no better judged by its own limit than that limit is known.
        let time_error = reference.filter(|_| ladder.len() > 1).and_then(|reference| reference.deviation(&track));
        let doubt = reference.and_then(|reference| reference.doubt);
        let time_resolved = match (&time_error, &doubt) {
            (Some(error), Some(doubt)) => !is_finest && error.rms_mm >= RESOLVED * doubt.rms_mm,
            _ => false,
        };
        let level = levels.iter().find(|level| level.pitch_mm == task.choice.pitch_mm);
        let space_error = level.and_then(|level| level.space_error);
        let error = time_error
            .zip(space_error)
            .map(|(time, space)| Sizes { max_mm: time.max_mm + space.max_mm, rms_mm: time.rms_mm + space.rms_mm });
        let mut seconds: Vec<f64> =
            study.ledger().runs().filter(|other| other.choice == task.choice).map(|other| other.seconds).collect();
        seconds.sort_by(f64::total_cmp);
        let same_bits = study.ledger().runs().all(|other| other.choice != task.choice || other.bits == run.bits);
        let judged = finest_of_pitch.filter(|_| !is_finest);
        let drawn = (finest_choice != Some(&task.choice))
            .then(|| surface_of(study, &task.choice, Resolution::Volume))
            .flatten();
        let surface = drawn
            .and_then(|surface| Measured::new(surface.meshes.iter().map(|mesh| &mesh.mesh)))
            .zip(finest_surface.as_ref())
            .map(|(own, finest)| own.distance(finest));
        rows.push(Row {
            choice: task.choice.clone(),
            reference: task.reference,
            particles: run.particles,
            dt_s: run.dt_s,
            steps: run.steps,
            divided: run.divided,
            evaluations: run.evaluations,
            severed: run.severed,
            seconds,
            same_bits,
            time_error,
            time_resolved,
            shows_order: match (&time_error, &doubt) {
                (Some(error), Some(doubt)) => {
                    !is_finest
                        && error.rms_mm >= SHOWS_ORDER * doubt.rms_mm
                        && run.divided as f64 <= DIVIDED * run.steps as f64
                }
                _ => false,
            },
            space_error,
            error,
            volume_error: judged.map(|finest| furthest(&run.volume, &finest.volume)),
            energy_error: judged.map(|finest| {
                let sums = |run: &RunLine| run.energy_j.iter().map(|[k, e]| k + e).collect::<Vec<f64>>();
                let largest = sums(finest).into_iter().fold(f64::MIN_POSITIVE, f64::max);
                furthest(&sums(run), &sums(finest)) / largest
            }),
            momentum_error: judged.map(|finest| {
                let apart = run.momentum.iter().zip(&finest.momentum);
                apart.map(|(a, b)| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()).fold(0.0, f64::max)
            }),
            surface,
        });
    }
    for level in &mut levels {
        let own = |row: &&Row| {
            row.choice.pitch_mm == level.pitch_mm
                && row.choice.integrator == plan.judge.name
                && row.shows_order
                && row.choice.exact == usual
        };
        let points: Vec<[f64; 2]> =
            rows.iter().filter(own).filter_map(|row| Some([row.dt_s, row.time_error?.rms_mm])).collect();
        level.time_order = fit(&points);
    }
    let cuts_differ = pitches.iter().any(|&pitch| {
        let own: Vec<usize> = rows.iter().filter(|row| row.choice.pitch_mm == pitch).map(|row| row.severed).collect();
        own.windows(2).any(|pair| pair[0] != pair[1])
    });
    Ok(Some(Findings { base_mm: plan.base_mm, largest_mm, rows, levels, space_law, failed, cuts_differ }))
}

/// The run of the finest pitch with the shortest step.
fn finest_run<'a>(done: &[(&'a Task, &RunLine)], plan: &Plan) -> Option<&'a Choice> {
    let own = done.iter().filter(|(task, _)| task.choice.integrator == plan.judge.name);
    own.map(|(task, _)| &task.choice)
        .min_by(|a, b| a.pitch_mm.total_cmp(&b.pitch_mm).then(b.fineness.total_cmp(&a.fineness)))
}

fn furthest(found: &[f64], expected: &[f64]) -> f64 {
    found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Estimates the error of every pitch from how far each is from the finest.
fn space_errors(levels: &mut [Level]) -> Option<SpaceLaw> {
    /// Regions and cuts take in a little more or less tissue at each pitch: distances are known to about this share.
    const NOISE: f64 = 0.07;
    /// What distances that noisy leave open is settled for powers near 1, within about this share.
    const NEAR_ONE: f64 = 0.4;
    /// A power that leaves distances this far from it, relative, is none.
    const NO_POWER: f64 = 0.2;
    let finest = levels.last()?.pitch_mm;
    let seen: Vec<[f64; 3]> = levels
        .iter()
        .filter_map(|level| Some([level.pitch_mm, level.from_finest?.rms_mm, level.from_finest?.max_mm]))
        .filter(|seen| seen[1] > 0.0 && seen[1].is_finite())
        .collect();
    if seen.is_empty() {
        return None;
    }
    // The factors that each pitch asks for agree best at the right power.
    let spread = |order: f64| {
        let logs: Vec<f64> = seen.iter().map(|[h, rms, _]| (rms / (h.powf(order) - finest.powf(order))).ln()).collect();
        let mean = logs.iter().sum::<f64>() / logs.len() as f64;
        logs.iter().map(|log| (log - mean).powi(2)).sum::<f64>()
    };
    let unlikely = |order: f64| spread(order) / NOISE.powi(2) + (order.ln() / NEAR_ONE).powi(2);
    let orders = (40..=400).map(|n| f64::from(n) * 0.01);
    let best = orders.min_by(|&a, &b| unlikely(a).total_cmp(&unlikely(b))).unwrap_or(1.0);
    let found = seen.len() > 1 && spread(best) < NO_POWER.powi(2) * seen.len() as f64;
    let order = if found { best } else { 1.0 };
    let factor = |part: usize| {
        let logs = seen.iter().map(|seen| (seen[part] / (seen[0].powf(order) - finest.powf(order))).ln());
        (logs.sum::<f64>() / seen.len() as f64).exp()
    };
    let [rms, max] = [factor(1), factor(2)];
    for level in levels.iter_mut() {
        let power = level.pitch_mm.powf(order);
        level.space_error = Some(Sizes { max_mm: max * power, rms_mm: rms * power });
    }
    Some(SpaceLaw { order, found, pitches: seen.len() })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn level(pitch_mm: f64, off: Option<f64>) -> Level {
        let of = |off| Deviation { max_mm: 5.0 * off, most_mm: 2.0 * off, rms_mm: off, points: 9, left_out: 0 };
        Level {
            pitch_mm,
            particles: 9,
            extrapolated: true,
            doubt: None,
            time_order: None,
            from_finest: off.map(of),
            space_error: None,
        }
    }

    #[test]
    fn the_error_of_a_pitch_is_more_than_what_is_seen_against_the_finest() {
        let error = |h: f64| 0.02 * h.powf(1.5);
        let seen = |h: f64| level(h, Some(error(h) - error(2.25)));
        let mut levels = [seen(6.0), seen(4.5), seen(3.0), level(2.25, None)];
        let law = space_errors(&mut levels).unwrap();
        assert!(law.found && (law.order - 1.5).abs() < 0.12, "{law:?}");
        for level in levels {
            let Sizes { max_mm, rms_mm } = level.space_error.unwrap();
            // Leaning towards a power of 1 makes errors a little too large.
            let ratio = rms_mm / error(level.pitch_mm);
            assert!(ratio > 0.97 && ratio < 1.15, "{ratio}");
            assert!((max_mm / rms_mm - 5.0).abs() < 1e-9);
        }
    }

    #[test]
    fn one_pitch_tells_no_power() {
        let mut levels = [level(4.0, Some(0.1)), level(2.0, None)];
        let law = space_errors(&mut levels).unwrap();
        assert!(!law.found && law.order == 1.0);
        assert!((levels[0].space_error.unwrap().rms_mm - 0.2).abs() < 1e-12);
        assert_eq!(space_errors(&mut [level(3.0, None)]), None);
        // Nearer at a coarser pitch: no power does that.
        let mut levels = [level(20.0, Some(9.1)), level(15.0, Some(2.6)), level(10.0, Some(3.2)), level(7.5, None)];
        assert!(!space_errors(&mut levels).unwrap().found);
    }
}
