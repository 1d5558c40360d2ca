//! Cuts that leave little, cut again, or meet tissue in motion.

use std::collections::BTreeSet;

use super::super::bodies::{
    MODELS, Random, SIZES, Trial, alone, block_of, centre, distance, energy, particles, pieces, sever, shake, state,
};
use super::super::tally::Tally;
use super::super::{Case, Finding, Group};
use super::some_block;
use crate::cut::Blade;
use crate::dynamics::World;
use crate::dynamics::measure::balance;
use crate::dynamics::reference_world::ReferenceWorld;
use crate::geometry::{Point3, Vector3};

pub(super) fn cases() -> Vec<Case> {
    let case = |name, asked, run| Case { group: Group::Hard, name, asked, run };
    vec![
        case("cut-leaves-one-particle", "a single particle that is cut off flies on by itself", one_particle),
        case("cut-leaves-a-chain", "a chain of single particles that is cut out swings as one in f64", chain),
        case("cut-leaves-a-sliver", "a layer one particle thick that is cut off swings as one in f64", sliver),
        case("cutting-twice", "a blade that goes through the same cut again, either way, finds nothing", twice),
        case(
            "cutting-while-moving",
            "a body that flies through a still blade is cut as a still body by a moving one",
            while_moving,
        ),
    ]
}

/// Cuts a shaken block so that the particles with `chosen` grid indices are a piece of their own, and follows it together
/// with its twin in f64.
fn leaves(what: &str, chosen: impl Fn([usize; 3]) -> bool) -> Finding {
    let mut tally = Tally::default();
    for model in MODELS {
        for (pitch, n) in SIZES {
            let what = format!("{model}, {pitch} mm");
            let mut trial = Trial::new(block_of(model, pitch, [n + 2, n, n], 0.0));
            let world = &mut trial.world;
            shake(world, 0.003, 0.01, &mut Random::new(11));
            // Grid indices begin at 1, beside the empty border.
            let inside = |world: &World, p: u32| chosen(world.lattice().ijk(p).map(|i| i - 1));
            let before = balance(world);
            let probe = world.clone();
            let count = sever(world, |a, b| inside(&probe, a) != inside(&probe, b));
            let piece = pieces(world);
            let own: BTreeSet<u32> =
                particles(world).into_iter().filter(|&p| inside(world, p)).map(|p| piece[p as usize]).collect();
            let all: BTreeSet<u32> = piece.iter().copied().collect();
            tally.expect(count > 0 && own.len() == 1 && all.len() == 2, || {
                format!("{what}: {count} springs severed, {} pieces", all.len())
            });
            let start = energy(world);
            let after = balance(world);
            tally.expect(after.momentum == before.momentum, || format!("{what}: momentum changed"));
            match trial.run_with_twin(30) {
                Ok(apart) => tally.error(&what, apart),
                Err(error) => tally.fault(format!("{what}: {error}")),
            }
            let (end, scale) = (balance(&trial.world), state(&trial.world).1);
            let scale: f64 = scale.iter().zip(trial.world.mass()).map(|(v, &m)| v.norm() * f64::from(m)).sum();
            let lost = (end.momentum - before.momentum).norm() / scale;
            tally.expect(lost < 1e-5, || format!("{what}: {lost:.1e} of the momentum lost"));
            let rise = energy(&trial.world) / start - 1.0;
            tally.expect(rise < 0.1, || format!("{what}: energy rises by {rise:.1e}"));
            tally.steps += trial.steps;
            tally.trials += 1;
        }
    }
    let happened = format!(
        "{} blocks (paper; tissue with Poisson's ratios 0.25, 0.45; pitches of 1.5, 3 and 6 mm) leave {what}; over 300 steps \
         momentum is kept, energy does not rise, and f32 and f64 differ by at most {:.1e} pitches",
        tally.trials, tally.error
    );
    tally.finding(1e-3, happened)
}

fn one_particle() -> Finding {
    alone(|| leaves("a single particle", |ijk| ijk == [0, 0, 0]))
}

fn chain() -> Finding {
    alone(|| leaves("a chain along one edge", |[_, j, k]| j == 0 && k == 0))
}

fn sliver() -> Finding {
    alone(|| leaves("a layer one particle thick", |[i, ..]| i == 0))
}

/// A blade across x between the layers, far beyond the sides [m].
fn across(world: &World) -> (Blade, Blade) {
    let middle = centre(world) + Vector3::new(0.13, 0.0, 0.0) * world.lattice().pitch;
    let edge = [-0.2, 0.2].map(|z| Point3::from(middle + Vector3::new(0.0, 0.0, z)));
    let (from, to) = (Vector3::y() * -0.2, Vector3::y() * 0.2);
    (Blade::new(edge.to_vec(), &[from, to]), Blade::new(edge.to_vec(), &[to, from]))
}

fn twice() -> Finding {
    alone(|| {
        let mut tally = Tally::default();
        let (mut severed, mut apart) = (0, 0.0_f64);
        for model in MODELS {
            for (pitch, n) in SIZES {
                let (mut trial, _) = some_block(model, pitch, n, 0.1);
                shake(&mut trial.world, 0.02, 0.0, &mut Random::new(12));
                let (there, back) = across(&trial.world);
                let first = trial.world.cut(&there.sweep(0.0, there.path_length()));
                tally.expect(first > 20, || format!("{model}, {pitch} mm: {first} springs severed"));
                severed += first;
                let list = trial.world.topology().severed().len();
                let again = trial.world.cut(&there.sweep(0.0, there.path_length()))
                    + trial.world.cut(&back.sweep(0.0, back.path_length()));
                tally.error(model, again as f64);
                tally.expect(trial.world.topology().severed().len() == list, || format!("{model}: listed twice"));
                match trial.run_with_twin(20) {
                    Ok(far) => apart = apart.max(far),
                    Err(error) => tally.fault(format!("{model}, {pitch} mm: {error}")),
                }
                tally.steps += trial.steps;
            }
        }
        let happened = format!(
            "{severed} springs severed the first time, {} the second and third time; over the next 200 steps the halves differ \
             from a twin in f64 by at most {apart:.1e} pitches",
            tally.error
        );
        tally.expect(apart < 1e-3, || format!("f32 and f64 differ by {apart:.1e} pitches"));
        tally.finding(0.0, happened)
    })
}

/// The edge stands still while the body flies over it; the same in the frame of the body.
fn while_moving() -> Finding {
    alone(|| {
        let mut tally = Tally::default();
        let (mut severed, mut apart) = (0, 0.0_f64);
        for model in MODELS {
            for (pitch, n) in SIZES {
                for (number, way) in [Vector3::new(0.0, 1.0, 0.0), Vector3::new(0.1, -1.0, 0.2)].into_iter().enumerate()
                {
                    let what = format!("{model}, {pitch} mm, way {number}");
                    let (mut trial, middle) = some_block(model, pitch, n, 0.1);
                    let (h, dt) = (trial.world.lattice().pitch, trial.world.dt());
                    // A third of a pitch in a step: 60 steps from one side to the other.
                    let velocity = way * (h / 3.0 / dt);
                    let flight = velocity * (60.0 * dt);
                    let side = Vector3::new(0.05, 0.1, 1.0) * 40.0 * h;
                    let foot = middle + Vector3::new(0.13, 0.0, 0.0) * h;
                    let ends = |at: Vector3| [at - 0.5 * side, at + 0.5 * side].map(Point3::from).to_vec();
                    let mut still = trial.world.clone();
                    let moving = Blade::new(ends(foot), &[0.5 * flight, -0.5 * flight]);
                    still.cut(&moving.sweep(0.0, moving.path_length()));
                    for p in particles(&trial.world) {
                        trial.world.set_velocity(p, velocity);
                    }
                    let waiting = Blade::new(ends(foot + 0.5 * flight), &[Vector3::zeros(), Vector3::zeros()]);
                    let mut twin = ReferenceWorld::of(&trial.world);
                    let mut before = trial.world.moment();
                    for _ in 0..60 {
                        for result in [trial.world.step(), twin.step()] {
                            if let Err(error) = result {
                                tally.fault(format!("{what}: {error}"));
                            }
                        }
                        let old = trial.world.topology().severed().len();
                        trial.world.cut_since(&before, &waiting.sweep(0.0, 0.0));
                        twin.sever(trial.world.topology().severed()[old..].iter().copied());
                        before = trial.world.moment();
                    }
                    apart = apart.max(distance(&trial.world, &twin));
                    let of = |world: &World| -> BTreeSet<(u32, u8)> {
                        world.topology().severed().iter().map(|s| (s.particle, s.direction)).collect()
                    };
                    let (a, b) = (of(&still), of(&trial.world));
                    tally.expect(a.len() > 20, || format!("{what}: {} springs severed", a.len()));
                    tally.error(&what, a.symmetric_difference(&b).count() as f64);
                    severed += b.len();
                    // The body is not moved by a blade that only cuts.
                    let gone = (trial.world.displacement(0) - flight).norm() / flight.norm();
                    tally.expect(gone < 1e-3, || format!("{what}: {gone:.1e} off its way"));
                    tally.steps += trial.world.steps();
                }
            }
        }
        let happened = format!(
            "of {severed} springs severed in flight {} differ; after 20 pitches of flight f32 and f64 differ by at most {apart:.1e} \
             pitches",
            tally.error
        );
        tally.expect(apart < 1e-3, || format!("f32 and f64 differ by {apart:.1e} pitches"));
        tally.finding(0.0, happened)
    })
}
