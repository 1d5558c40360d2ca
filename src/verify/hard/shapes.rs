//! Bodies in shapes that no force should bring them to.

use super::super::bodies::{MODELS, Random, SIZES, Trial, alone, energy, is_finite};
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
        case(
            "one-cell-inside-out",
            "a cell turned inside out is reported, and either finds its way back or stays reported",
            one_cell,
        ),
        case("block-inside-out", "a body that is its own mirror image is reported and gains no energy", mirrored),
    ]
}

/// Forty frames of ten steps with the guard; what energy comes to, relative to the start, is the error.
fn survives(what: &str, trial: &mut Trial, tally: &mut Tally) {
    let before = energy(&trial.world);
    let world = &trial.world;
    // About the energy of a strain of a thousandth: a mirrored body starts from none.
    let mass: f64 = world.mass().iter().map(|&m| f64::from(m)).sum();
    let floor = 1e-6 * mass * (world.lattice().pitch / world.dt()).powi(2);
    let result = trial.run(40, |_| {});
    tally.expect(is_finite(&trial.world), || format!("{what}: a place is not a number"));
    match result {
        Ok(()) => tally.error(what, (energy(&trial.world) - before) / (before + floor)),
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
                    // No direction is right for such a spring, and rounding may decide: a twin in f64 can only be another answer.
                    let before = energy(&trial.world);
                    if let Err(error) = trial.run(20, |_| {}) {
                        tally.fault(format!("{what}: {error}"));
                    }
                    let after = energy(&trial.world);
                    tally.error(&what, after / before - 1.0);
                    tally.expect(is_finite(&trial.world), || format!("{what}: a place is not a number"));
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
            "{} blocks with a particle on its neighbour's place: over 200 steps energy rises by at most {:.1} % of the start, and \
             by less than a quarter with all particles at one point",
            tally.trials,
            100.0 * tally.error
        );
        tally.finding(0.05, happened)
    })
}

/// A cell of the inside mirrored, with dampers, until everything is at rest.
fn one_cell() -> Finding {
    alone(|| {
        let mut tally = Tally::default();
        let mut stuck = 0;
        for model in MODELS {
            for (pitch, n) in SIZES {
                let what = format!("{model}, {pitch} mm");
                let (mut trial, _) = some_block(model, pitch, n.max(4), 0.3);
                let world = &mut trial.world;
                let h = world.lattice().pitch;
                let Some(corners) = world.topology().whole_cell(world.lattice(), innermost(world)) else {
                    tally.fault(format!("{what}: no cell in the middle"));
                    continue;
                };
                for (c, &corner) in corners.iter().enumerate() {
                    // Corners run x fastest: the even ones go to where the odd ones are, and back.
                    world.set_displacement(corner, Vector3::x() * if c % 2 == 0 { h } else { -h });
                }
                let inverted = |trial: &Trial| {
                    let world = &trial.world;
                    cell_volume(world.lattice(), world.topology(), |p| world.displacement(p)).inverted
                };
                tally.expect(inverted(&trial) > 0, || format!("{what}: no cell is reported inside out"));
                let before = energy(&trial.world);
                if let Err(error) = trial.run(150, |_| {}) {
                    tally.fault(format!("{what}: {error}"));
                }
                tally.trials += 1;
                tally.steps += trial.steps;
                // Inside out can be a rest of its own, which is told and not hidden.
                match inverted(&trial) {
                    0 => tally.error(&what, energy(&trial.world) / before),
                    _ => stuck += 1,
                }
                tally.expect(is_finite(&trial.world), || format!("{what}: a place is not a number"));
            }
        }
        let happened = format!(
            "all are reported; {} of {} turn back by themselves, until {:.1e} of the energy is left after 1500 planned steps; {stuck} \
             stay inside out and are still reported (paper; tissue with Poisson's ratios 0.25, 0.45; damping ratio 0.3)",
            tally.trials - stuck,
            tally.trials,
            tally.error
        );
        tally.finding(0.01, happened)
    })
}
