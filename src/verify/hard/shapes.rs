//! Bodies in shapes that no force should bring them to.

use super::super::bodies::{MODELS, Random, SIZES, Trial, alone, energy, is_finite, largest, particles, state};
use super::super::tally::Tally;
use super::super::{Case, Finding, Group};
use super::{innermost, some_block};
use crate::dynamics::measure::cell_volume;
use crate::geometry::Vector3;

pub(super) fn cases() -> Vec<Case> {
    let case = |name, asked, run| Case { group: Group::Hard, name, asked, run };
    vec![
        case(
            "zero-length-springs",
            "joined particles at the same place push or pull nobody in no direction",
            zero_length,
        ),
        case("particles-at-random-places", "a body whose particles lie anywhere in its box gains no energy", scattered),
        case(
            "block-flattened-to-a-plane",
            "a body pressed to a plane gains no energy and unfolds or is refused",
            flattened,
        ),
        case("one-cell-inside-out", "a particle pushed through its cell is reported, and finds its way back", one_cell),
        case("block-inside-out", "a body that is its own mirror image is reported and gains no energy", mirrored),
    ]
}

/// Forty frames of ten steps with the guard; what energy comes to, relative to the start, is the error.
fn survives(what: &str, trial: &mut Trial, tally: &mut Tally) {
    let before = energy(&trial.world);
    let result = trial.run(40, |_| {});
    tally.expect(is_finite(&trial.world), || format!("{what}: a place is not a number"));
    match result {
        Ok(()) => tally.error(what, energy(&trial.world) / before - 1.0),
        Err(error) => tally.refusal(what, &error),
    }
    tally.steps += trial.steps;
    tally.trials += 1;
}

/// All models, sizes, without and with dampers; `place` gives the new place of each particle.
fn all(
    tally: &mut Tally,
    place: impl Fn(&Trial, Vector3, &mut Random, Vector3) -> Vector3,
    look: impl Fn(&str, &Trial, &mut Tally),
) {
    for model in MODELS {
        for (pitch, n) in SIZES {
            for damping in [0.0, 0.2] {
                let what = format!("{model}, {pitch} mm, damping ratio {damping}");
                let (mut trial, middle) = some_block(model, pitch, n, damping);
                let random = std::cell::RefCell::new(Random::new(7));
                let rest = trial.clone();
                trial.place(|_, at| place(&rest, middle, &mut random.borrow_mut(), at));
                look(&what, &trial, tally);
                survives(&what, &mut trial, tally);
            }
        }
    }
}

fn outcome(tally: Tally, what: &str) -> Finding {
    let happened = format!(
        "{} of {} {what} went on for 400 planned steps and {} were refused with place and reason; energy rises by at most {:.1} % \
         (paper; tissue with Poisson's ratios 0.25, 0.45; pitches of 1.5, 3 and 6 mm; with and without dampers)",
        tally.trials - tally.refused,
        tally.trials,
        tally.refused,
        100.0 * tally.error
    );
    tally.finding(0.25, happened)
}

fn scattered() -> Finding {
    alone(|| {
        let mut tally = Tally::default();
        all(
            &mut tally,
            |trial, middle, random, _| middle + random.vector() * 2.5 * trial.world.lattice().pitch,
            |_, _, _| {},
        );
        outcome(tally, "scattered blocks")
    })
}

fn flattened() -> Finding {
    alone(|| {
        let mut tally = Tally::default();
        all(&mut tally, |_, middle, _, at| Vector3::new(at.x, at.y, middle.z), |_, _, _| {});
        outcome(tally, "flattened blocks")
    })
}

fn mirrored() -> Finding {
    alone(|| {
        let mut tally = Tally::default();
        let look = |what: &str, trial: &Trial, tally: &mut Tally| {
            let world = &trial.world;
            let volume = cell_volume(world.lattice(), world.topology(), |p| world.displacement(p));
            tally.expect(volume.inverted == volume.cells && volume.cells > 0, || {
                format!("{what}: {} of {} cells reported inside out", volume.inverted, volume.cells)
            });
        };
        all(&mut tally, |_, middle, _, at| Vector3::new(2.0 * middle.x - at.x, at.y, at.z), look);
        outcome(tally, "mirrored blocks, all their cells reported inside out,")
    })
}

/// One pair of neighbours at one place, along each kind of spring, and whole bodies at one point.
fn zero_length() -> Finding {
    alone(|| {
        let mut tally = Tally::default();
        for model in MODELS {
            for (pitch, n) in SIZES {
                for offset in [[1, 0, 0], [0, -1, 0], [1, 1, 0], [1, -1, 1]] {
                    let what = format!("{model}, {pitch} mm, {offset:?}");
                    let (mut trial, _) = some_block(model, pitch, n, 0.2);
                    let middle = innermost(&trial.world);
                    let onto = Vector3::from(offset.map(f64::from)) * trial.world.lattice().pitch;
                    trial.world.set_displacement(middle, onto);
                    let before = energy(&trial.world);
                    // Later the two ways of rounding part, as they do wherever neighbours pass through each other.
                    match trial.run_with_twin(1) {
                        Ok(apart) => tally.error(&what, apart),
                        Err(error) => tally.fault(format!("{what}: {error}")),
                    }
                    if let Err(error) = trial.run(20, |_| {}) {
                        tally.fault(format!("{what}: {error}"));
                    }
                    let after = energy(&trial.world);
                    tally.expect(after < 1.05 * before, || {
                        format!("{what}: energy rises from {before:e} to {after:e} J")
                    });
                    tally.steps += trial.steps;
                    tally.trials += 1;
                }
                let (mut trial, middle) = some_block(model, pitch, n, 0.2);
                trial.place(|_, _| middle);
                let mut at_a_point = Tally::default();
                survives(&format!("{model}, {pitch} mm, at one point"), &mut trial, &mut at_a_point);
                tally.expect(at_a_point.refused > 0 || at_a_point.error < 0.25, || {
                    format!("{model}, {pitch} mm, at one point: energy rises by {:.1e}", at_a_point.error)
                });
                tally.steps += at_a_point.steps;
            }
        }
        let happened = format!(
            "{} blocks with a particle on its neighbour's place: f32 and f64 differ by at most {:.1e} pitches after ten steps, and \
             energy does not rise; nor does it with all particles at one point",
            tally.trials, tally.error
        );
        tally.finding(1e-4, happened)
    })
}

/// A particle of the inside pushed past its neighbour, with dampers, until everything is at rest.
fn one_cell() -> Finding {
    alone(|| {
        let mut tally = Tally::default();
        let mut stuck = 0;
        for model in MODELS {
            for (pitch, n) in SIZES {
                let what = format!("{model}, {pitch} mm");
                let (mut trial, _) = some_block(model, pitch, n.max(4), 0.3);
                let h = trial.world.lattice().pitch;
                let middle = innermost(&trial.world);
                trial.world.set_displacement(middle, Vector3::x() * 1.3 * h);
                let inverted = |trial: &Trial| {
                    let world = &trial.world;
                    cell_volume(world.lattice(), world.topology(), |p| world.displacement(p)).inverted
                };
                let reported = inverted(&trial);
                tally.expect(reported > 0, || format!("{what}: no cell is reported inside out"));
                if let Err(error) = trial.run(150, |_| {}) {
                    tally.fault(format!("{what}: {error}"));
                }
                tally.trials += 1;
                tally.steps += trial.steps;
                if inverted(&trial) > 0 {
                    // A rest of its own, which has to be told.
                    stuck += 1;
                    continue;
                }
                let displacement = state(&trial.world).0;
                // It may have pushed itself off a little: only shape counts.
                let mean = displacement.iter().sum::<Vector3>() / displacement.len() as f64;
                let off = |p: u32| (displacement[p as usize] - mean).norm() / h;
                tally.error(&what, largest(particles(&trial.world).into_iter().map(off)));
            }
        }
        let happened = format!(
            "{} of {} cells turn back by themselves, to {:.1e} pitches of their rest shape; {stuck} stay inside out and are reported",
            tally.trials - stuck,
            tally.trials,
            tally.error
        );
        tally.expect(stuck == 0, || format!("{stuck} of 9 cells stay inside out"));
        tally.finding(0.05, happened)
    })
}
