//! Bodies in shapes that no force should bring them to.

use super::super::bodies::{MODELS, Random, SIZES, Trial, alone, energy, is_finite};
use super::super::tally::Tally;
use super::super::{Case, Finding, Group};
use super::{innermost, some_block};
use crate::dynamics::World;
use crate::dynamics::measure::cell_volume;
use crate::dynamics::reference_world::ReferenceWorld;
use crate::geometry::Vector3;

/// f32 and f64 go the same way as long as places agree to this [pitches].
const CLOSE: f64 = 0.01;

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

/// Forty frames of ten steps with the guard, in f32 and beside it in f64; what either energy comes to, relative to the start, is
/// the error. Returns how far apart places ever were [pitches], unless the body is refused.
fn survives(what: &str, trial: &mut Trial, twin: &mut ReferenceWorld, tally: &mut Tally) -> Option<f64> {
    let before = energy(&trial.world);
    let world = &trial.world;
    // About the energy of a strain of a thousandth: a mirrored body starts from none.
    let mass: f64 = world.mass().iter().map(|&m| f64::from(m)).sum();
    let floor = 1e-6 * mass * (world.lattice().pitch / world.dt()).powi(2);
    let result = trial.run_beside(twin, 40, |_, _| {});
    tally.expect(is_finite(&trial.world), || format!("{what}: a place is not a number"));
    tally.steps += trial.steps;
    tally.trials += 1;
    match result {
        Ok(apart) => {
            for (precision, after) in [("f32", energy(&trial.world)), ("f64", twin.energy())] {
                tally.error(format!("{what}, {precision}"), (after - before) / (before + floor));
            }
            Some(apart)
        }
        Err(error) => {
            tally.refusal(what, &error);
            None
        }
    }
}

/// All models, sizes, without and with dampers; `place` gives the new place of each particle. Returns how far f32 and f64 were
/// apart in each body that went on [pitches].
fn all(
    tally: &mut Tally,
    place: impl Fn(&Trial, Vector3, &mut Random, Vector3) -> Vector3,
    look: impl Fn(&str, &Trial, &mut Tally),
) -> Vec<f64> {
    let mut apart = Vec::new();
    for model in MODELS {
        for (pitch, n) in SIZES {
            for damping in [0.0, 0.2] {
                let what = format!("{model}, {pitch} mm, damping ratio {damping}");
                let (mut trial, middle) = some_block(model, pitch, n, damping);
                let random = std::cell::RefCell::new(Random::new(7));
                let rest = trial.clone();
                let mut twin = ReferenceWorld::of(&trial.world);
                trial.place_both(&mut twin, |_, at| place(&rest, middle, &mut random.borrow_mut(), at));
                look(&what, &trial, tally);
                apart.extend(survives(&what, &mut trial, &mut twin, tally));
            }
        }
    }
    apart
}

fn outcome(tally: Tally, apart: &[f64], what: &str) -> Finding {
    let close = apart.iter().filter(|&&far| far < CLOSE).count();
    let happened = format!(
        "{} of {} {what} went on for 400 planned steps and {} were refused with place and reason; in f32 and in f64 energy rises \
         by at most {:.1} %; places agree to {CLOSE} pitches in {close}, the others fold one way or another as rounding has it \
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
        let apart = all(
            &mut tally,
            |trial, middle, random, _| middle + random.vector() * 2.5 * trial.world.lattice().pitch,
            |_, _, _| {},
        );
        outcome(tally, &apart, "scattered blocks")
    })
}

fn flattened() -> Finding {
    alone(|| {
        let mut tally = Tally::default();
        let apart = all(&mut tally, |_, middle, _, at| Vector3::new(at.x, at.y, middle.z), |_, _, _| {});
        outcome(tally, &apart, "flattened blocks")
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
        let apart = all(&mut tally, |_, middle, _, at| Vector3::new(2.0 * middle.x - at.x, at.y, at.z), look);
        outcome(tally, &apart, "mirrored blocks, all their cells reported inside out,")
    })
}

/// One pair of neighbours at one place, along each kind of spring, and whole bodies at one point.
///
/// The force of a spring has a direction as long as it has a length; at none it is zero. Between the two it jumps, so a twin
/// follows only if its spring, too, has exactly no length: placed with the rounding of f32 it would be pushed with full
/// force in the direction of the rounding.
fn zero_length() -> Finding {
    alone(|| {
        let (mut tally, mut apart) = (Tally::default(), 0.0_f64);
        for model in MODELS {
            for (pitch, n) in SIZES {
                for offset in [[1, 0, 0], [0, -1, 0], [1, 1, 0], [1, -1, 1]] {
                    let what = format!("{model}, {pitch} mm, {offset:?}");
                    let (mut trial, _) = some_block(model, pitch, n, 0.2);
                    let middle = innermost(&trial.world);
                    let onto = Vector3::from(offset.map(f64::from)) * trial.world.lattice().pitch;
                    let mut twin = ReferenceWorld::of(&trial.world);
                    trial.world.set_displacement(middle, onto);
                    twin.set_displacement(middle, onto);
                    let before = energy(&trial.world);
                    match trial.run_beside(&mut twin, 20, |_, _| {}) {
                        Ok(far) => apart = apart.max(far),
                        Err(error) => tally.fault(format!("{what}: {error}")),
                    }
                    tally.error(&what, energy(&trial.world).max(twin.energy()) / before - 1.0);
                    tally.expect(is_finite(&trial.world), || format!("{what}: a place is not a number"));
                    tally.steps += trial.steps;
                    tally.trials += 1;
                }
                // At one point to rounding: which way it unfolds is rounding's, so energy is all there is to compare.
                let (mut trial, middle) = some_block(model, pitch, n, 0.2);
                let mut twin = ReferenceWorld::of(&trial.world);
                trial.place_both(&mut twin, |_, _| middle);
                let mut at_a_point = Tally::default();
                survives(&format!("{model}, {pitch} mm, at one point"), &mut trial, &mut twin, &mut at_a_point);
                tally.expect(at_a_point.refused > 0 || at_a_point.error < 0.25, || {
                    format!("{model}, {pitch} mm, at one point: energy rises by {:.1e}", at_a_point.error)
                });
                tally.steps += at_a_point.steps;
            }
        }
        tally.expect(apart < 1e-4, || format!("f32 and f64 differ by {apart:.1e} pitches"));
        let happened = format!(
            "{} blocks with a particle on its neighbour's place: over 200 steps energy rises by at most {:.1} % of the start and \
             places agree with a twin in f64 to {apart:.1e} pitches; with all particles at one point energy rises by less than a \
             quarter in both",
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
        let (mut stuck, mut close) = (0, 0);
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
                let inverted = |world: &World, place: &(dyn Fn(u32) -> Vector3 + Sync)| {
                    cell_volume(world.lattice(), world.topology(), place).inverted
                };
                tally.expect(inverted(world, &|p| world.displacement(p)) > 0, || {
                    format!("{what}: no cell is reported inside out")
                });
                let before = energy(world);
                let mut twin = ReferenceWorld::of(world);
                match trial.run_beside(&mut twin, 150, |_, _| {}) {
                    Ok(apart) => close += u32::from(apart < CLOSE),
                    Err(error) => tally.fault(format!("{what}: {error}")),
                }
                tally.trials += 1;
                tally.steps += trial.steps;
                // Inside out can be a rest of its own, which is told and not hidden.
                let world = &trial.world;
                let single = (inverted(world, &|p| world.displacement(p)), energy(world));
                let double = (inverted(world, &|p| twin.displacement()[p as usize]), twin.energy());
                for (inverted, after) in [single, double] {
                    match inverted {
                        0 => tally.error(&what, after / before),
                        _ => stuck += 1,
                    }
                }
                tally.expect(is_finite(&trial.world), || format!("{what}: a place is not a number"));
            }
        }
        let happened = format!(
            "all are reported; {} of {} in f32 and f64 turn back by themselves, until {:.1e} of the energy is left after 1500 planned \
             steps; {stuck} stay inside out and are still reported; on the way f32 and f64 agree to {CLOSE} pitches in {close} of {} \
             (paper; tissue with Poisson's ratios 0.25, 0.45; damping ratio 0.3)",
            2 * tally.trials - stuck,
            2 * tally.trials,
            tally.error,
            tally.trials
        );
        tally.finding(0.01, happened)
    })
}
