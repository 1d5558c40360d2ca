//! Hard cases: each ends in a right answer or in a clear refusal, never in a number that is none.

mod cuts;
mod refusals;
mod shapes;

use super::bodies::{
    ALL_MODELS, MODELS, Model, Organ, Random, SIZES, Trial, alone, block_of, centre, largest, lattice, near_origin,
    organ, organ_map, particles, rest_place, shake, state,
};
use super::tally::Tally;
use super::{Case, Finding, Group};
use crate::dynamics::World;
use crate::dynamics::reference_world::ReferenceWorld;
use crate::geometry::{Affine, Vector3};
use crate::lattice::build::NO_ORGAN;
use crate::lattice::region::Region;

pub(super) fn cases() -> Vec<Case> {
    let case = |name, asked, run| Case { group: Group::Hard, name, asked, run };
    vec![
        case("stiffness-contrast", "organs whose stiffness differs by a million, joined, do not fly apart", stiffness),
        case("mass-contrast", "organs whose density differs by a million, joined, do not fly apart", mass),
        case(
            "lone-voxels",
            "voxels that touch no other fall freely under gravity; no spring limits their step",
            lone_voxels,
        ),
        case("million-steps-at-rest", "a body at rest stays at rest exactly, over a million steps", rest),
        case(
            "rotation-without-ghost-forces",
            "a body that is turned by any angle and left alone stays as it is",
            turned_and_left,
        ),
        case(
            "far-from-the-origin",
            "an organ whose scan lies 10 km from the origin of the patient space moves as one at the origin",
            far_away,
        ),
    ]
    .into_iter()
    .chain(shapes::cases())
    .chain(cuts::cases())
    .chain(refusals::cases())
    .collect()
}

/// Two organs that differ, half and half and mixed voxel by voxel: 300 steps with a twin in f64.
fn contrast(differs: impl Fn(f64) -> Organ) -> Tally {
    let mut tally = Tally::default();
    for model in ALL_MODELS {
        for (pitch, n) in SIZES {
            for mixed in [false, true] {
                let map = organ_map(near_origin(pitch), [n + 1, n, n], |[i, j, k]| {
                    u8::from(if mixed { (i + j + k) % 2 == 0 } else { 2 * i > n })
                });
                for factor in [1e-6, 1e6] {
                    let what = format!("{model}, {pitch} mm, times {factor:e}");
                    let mut trial = Trial::new(lattice(model, &map, &[organ(0.02), differs(factor)]));
                    shake(&mut trial.world, 0.005, 0.0, &mut Random::new(1));
                    let before = super::bodies::energy(&trial.world);
                    match trial.run_with_twin(30) {
                        Ok(apart) => tally.error(&what, apart),
                        Err(error) => tally.fault(format!("{what}: {error}")),
                    }
                    let rise = super::bodies::energy(&trial.world) / before - 1.0;
                    tally.expect(rise < 1e-3, || format!("{what}: energy rises by {rise:.1e}"));
                    tally.steps += trial.steps;
                    tally.trials += 1;
                }
            }
        }
    }
    tally
}

fn contrast_finding(what: &str, tally: Tally) -> Finding {
    let happened = format!(
        "{} blocks of two organs, one a million times {what} (paper; tissue with Poisson's ratios 0, 0.25, 0.45; pitches of 1.5, 3 \
         and 6 mm; half and half, and mixed voxel by voxel): energy never rises, and after 300 steps f32 and f64 differ by at \
         most {:.1e} pitches",
        tally.trials, tally.error
    );
    tally.finding(1e-3, happened)
}

fn stiffness() -> Finding {
    alone(|| contrast_finding("stiffer or softer", contrast(|factor| Organ { stiffness: factor, ..organ(0.02) })))
}

fn mass() -> Finding {
    alone(|| contrast_finding("heavier or lighter", contrast(|factor| Organ { mass: factor, ..organ(0.02) })))
}

/// Single voxels far enough from each other to share nothing.
fn lone_voxels() -> Finding {
    alone(|| {
        let (mut tally, mut double) = (Tally::default(), 0.0_f64);
        let gravity = Vector3::new(0.0, 0.0, -9.81);
        for model in ALL_MODELS {
            for (pitch, n) in [(1.5, 7), (3.0, 1), (6.0, 5)] {
                let apart = |ijk: [usize; 3]| ijk.iter().all(|i| i.is_multiple_of(3));
                let map = organ_map(near_origin(pitch), [n; 3], |ijk| if apart(ijk) { 0 } else { NO_ORGAN });
                let mut trial = Trial::new(lattice(model, &map, &[organ(0.1)]));
                let free = trial.limits.sharp.is_infinite();
                tally.expect(free == (model == Model::Paper), || format!("{model}: limit {} s", trial.limits.sharp));
                trial.world.set_gravity(gravity);
                let mut twin = ReferenceWorld::of(&trial.world);
                if let Err(error) = trial.run_beside(&mut twin, 50, |_, _| {}) {
                    tally.fault(format!("{model}: {error}"));
                }
                // What symplectic Euler makes of a fall.
                let steps = trial.world.steps() as f64;
                let fallen = gravity * (0.5 * steps * (steps + 1.0) * trial.world.dt().powi(2));
                let off = |places: &[Vector3]| largest(places.iter().map(|u| (u - fallen).norm() / fallen.norm()));
                tally.error(model, off(&state(&trial.world).0));
                double = double.max(off(twin.displacement()));
                tally.steps += trial.steps;
            }
        }
        tally.expect(double < 1e-12, || format!("in f64 the fall is off by {double:.1e}"));
        let happened = format!(
            "every voxel falls as the formula says, to {:.1e} of the way in 500 steps in f32, to {double:.1e} in f64",
            tally.error
        );
        tally.finding(1e-5, happened)
    })
}

fn rest() -> Finding {
    alone(|| {
        let mut tally = Tally::default();
        let trials = [Model::Paper, Model::Tissue(0.45)]
            .into_iter()
            .flat_map(|model| [(model, 3.0, 1_000_000_u64), (model, 1.5, 100_000), (model, 6.0, 100_000)]);
        for (model, pitch, steps) in trials {
            let Trial { mut world, .. } = Trial::new(block_of(model, pitch, [2, 2, 1], 0.1));
            let mut twin = ReferenceWorld::of(&world);
            if let Some(error) = (0..steps).find_map(|_| world.step().err()) {
                tally.fault(format!("{model}: {error}"));
            }
            if let Some(error) = (0..100_000).find_map(|_| twin.step().err()) {
                tally.fault(format!("{model}, f64: {error}"));
            }
            let (displacement, velocity) = state(&world);
            let all = displacement.iter().chain(&velocity).chain(twin.displacement()).chain(twin.velocity());
            tally.error(model, largest(all.map(|v| v.amax())));
            tally.steps += world.steps() + 100_000;
        }
        let happened = format!(
            "the largest displacement (m) or speed (m/s) after a million steps in f32 or a hundred thousand in f64 is {} (a \
             hundred thousand at 1.5 and 6 mm)",
            tally.error
        );
        tally.finding(0.0, happened)
    })
}

fn turned_and_left() -> Finding {
    alone(|| {
        let (mut tally, mut double) = (Tally::default(), 0.0_f64);
        for model in ALL_MODELS {
            for (pitch, n) in SIZES {
                let rest = Trial::new(block_of(model, pitch, [n + 2, n, n], 0.0));
                let (h, middle) = (rest.world.lattice().pitch, centre(&rest.world));
                for degrees in [1.0, 30.0, 45.0, 90.0, 133.7, 180.0, 270.0] {
                    let axis = nalgebra::Unit::new_normalize(Vector3::new(1.0, -2.0, 0.5));
                    let turn = nalgebra::Rotation3::from_axis_angle(&axis, f64::to_radians(degrees));
                    let mut trial = rest.clone();
                    let mut twin = ReferenceWorld::of(&trial.world);
                    trial.place_both(&mut twin, |_, rest| middle + turn * (rest - middle));
                    let (start, exact) = (state(&trial.world).0, twin.displacement().to_vec());
                    if let Err(error) = trial.run_beside(&mut twin, 20, |_, _| {}) {
                        tally.fault(format!("{model}, {degrees} degrees: {error}"));
                    }
                    let moved = |now: &[Vector3], then: &[Vector3]| {
                        largest(now.iter().zip(then).map(|(now, then)| (now - then).norm() / h))
                    };
                    tally.error(model, moved(&state(&trial.world).0, &start));
                    double = double.max(moved(twin.displacement(), &exact));
                    tally.steps += trial.steps;
                    tally.trials += 1;
                }
            }
        }
        let happened = format!(
            "{} turned bodies (1 to 270 degrees, paper; tissue with Poisson's ratios 0, 0.25, 0.45, no dampers): over 200 steps no \
             particle moves by more than {:.1e} pitches in f32 and {double:.1e} in f64, the rounding of its place",
            tally.trials, tally.error
        );
        tally.expect(double < 1e-12, || format!("in f64 a particle moves by {double:.1e} pitches"));
        tally.finding(1e-4, happened)
    })
}

/// Where the particles are after 300 steps of being held, drawn and shaken, regions and offsets in patient mm.
fn drawn(model: Model, pitch: f64, origin: [f64; 3], tally: &mut Tally) -> Vec<[f32; 3]> {
    let affine = Affine::from_spacing([pitch; 3], origin).expect("a positive pitch");
    let map = organ_map(affine, [6, 4, 4], |_| 0);
    let mut trial = Trial::new(lattice(model, &map, &[organ(0.1)]));
    shake(&mut trial.world, 0.02, 0.05, &mut Random::new(6));
    let side = |sign: f64, at: f64| Region::HalfSpace {
        point: affine.apply([at, 0.0, 0.0].into()),
        normal: Vector3::new(sign, 0.0, 0.0),
    };
    let (held, drawn) = (side(-1.0, 0.7).select(trial.world.lattice()), side(1.0, 4.3).select(trial.world.lattice()));
    tally.expect(!held.is_empty() && !drawn.is_empty(), || format!("{model}: a region of {origin:?} is empty"));
    trial.world.hold(&held);
    let grab = trial.world.grab(&drawn);
    let dt = trial.world.dt();
    let mut twin = ReferenceWorld::of(&trial.world);
    twin.grab(&drawn);
    let apart = trial.run_beside(&mut twin, 30, |world, twin| {
        let share = (world.time() + world.dt()) / (300.0 * dt);
        let way = Vector3::new(1.0, 2.0, 0.5) * (share * pitch / 3.0);
        world.move_grab(grab, way);
        // The affine has no rotation: lattice axes are the patient's.
        twin.move_grab(way * 1e-3);
    });
    match apart {
        Ok(apart) => tally.expect(apart < 1e-4, || format!("{model}: f32 and f64 differ by {apart:.1e} pitches")),
        Err(error) => tally.fault(format!("{model} at {origin:?} mm: {error}")),
    }
    tally.steps += trial.steps;
    trial.world.displacements_mm()
}

fn far_away() -> Finding {
    alone(|| {
        let mut tally = Tally::default();
        for model in MODELS {
            for (pitch, _) in SIZES {
                let [near, far] = [[0.0; 3], [1e7, -1e7, 1e7]].map(|origin| drawn(model, pitch, origin, &mut tally));
                let apart =
                    near.iter().zip(&far).flat_map(|(a, b)| (0..3).map(|axis| f64::from((a[axis] - b[axis]).abs())));
                tally.error(format!("{model}, {pitch} mm"), largest(apart));
            }
        }
        let happened = format!(
            "held, drawn and shaken over 300 steps at 1.5, 3 and 6 mm, with regions in patient mm, places differ by {} mm (state is kept relative to \
             rest), and from a twin in f64 by less than 1e-4 pitches",
            tally.error
        );
        tally.finding(0.0, happened)
    })
}

/// A block at rest, one voxel longer than wide, and its middle [m].
fn some_block(model: Model, pitch: f64, n: usize, damping: f64) -> (Trial, Vector3) {
    let trial = Trial::new(block_of(model, pitch, [n + 1, n, n], damping));
    let middle = centre(&trial.world);
    (trial, middle)
}

/// The particles of a layer: those with this grid index along x.
fn layer(world: &World, i: usize) -> Vec<u32> {
    particles(world).into_iter().filter(|&p| world.lattice().ijk(p)[0] == i).collect()
}

/// The particle nearest to the middle of the rest places.
fn innermost(world: &World) -> u32 {
    let middle = centre(world);
    let far = |p: &u32| (rest_place(world, *p) - middle).norm();
    particles(world).into_iter().min_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or_default()
}
