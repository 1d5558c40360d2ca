//! Free bodies: what nothing from outside may change.

use super::bodies::{
    ALL_MODELS, MODELS, Model, Random, Trial, alone, block_of, centre, energy, largest, particles, rest_place, shake,
    state,
};
use super::tally::Tally;
use super::{Case, Finding, Group};
use crate::dynamics::World;
use crate::dynamics::measure::balance;
use crate::dynamics::reference_world::ReferenceWorld;
use crate::geometry::{Matrix3, Vector3};
use crate::kernel::reference::{spring_forces, volume_forces};

pub(super) fn cases() -> Vec<Case> {
    let case = |name, asked, run| Case { group: Group::Free, name, asked, run };
    vec![
        case(
            "linear-momentum",
            "a free body that vibrates and flies keeps its momentum, with and without dampers",
            linear,
        ),
        case(
            "angular-momentum",
            "a free body that vibrates and tumbles keeps its angular momentum, with and without dampers",
            angular,
        ),
        case(
            "energy-without-dampers",
            "over 100 000 steps without dampers, at the step of a scene, the energy of a vibrating body neither drifts nor \
             leaves its bounds",
            energy_kept,
        ),
        case(
            "energy-with-dampers",
            "with dampers the energy of a vibrating body never rises, looked at after every step",
            energy_falls,
        ),
        case(
            "rigid-rotation",
            "a body that turns as a whole feels no force from springs, dampers or cells, at any angle",
            rigid_rotation,
        ),
        case(
            "spin-with-strong-dampers",
            "a body that spins freely for many turns loses nothing to its dampers once it has stopped vibrating",
            spin,
        ),
    ]
}

/// Bodies with an odd shape: sides of 5, 4 and 3 voxels of 3 mm.
fn body(model: Model, damping: f64) -> Trial {
    Trial::new(block_of(model, 3.0, [5, 4, 3], damping))
}

/// Sets a body vibrating, flying and tumbling.
fn throw(world: &mut World, flight: Vector3, turn_per_step: f64) {
    shake(world, 0.01, 0.02, &mut Random::new(3));
    let (middle, spin) = (centre(world), Vector3::new(1.0, -2.0, 0.5).normalize() * (turn_per_step / world.dt()));
    for p in particles(world) {
        let velocity = world.velocity(p) + flight + spin.cross(&(rest_place(world, p) - middle));
        world.set_velocity(p, velocity);
    }
}

/// Momentum [kg m/s], angular momentum [kg m^2/s], and for each what the parts of the sum come to.
fn momenta(mass: &[f32], place: impl Fn(usize) -> Vector3, velocity: &[Vector3]) -> [(Vector3, f64); 2] {
    let mut sums = [(Vector3::zeros(), 0.0); 2];
    for (p, (&mass, v)) in mass.iter().zip(velocity).enumerate() {
        let push = v * f64::from(mass);
        for (sum, part) in sums.iter_mut().zip([push, place(p).cross(&push)]) {
            sum.0 += part;
            sum.1 += part.norm();
        }
    }
    sums
}

/// Largest relative change of one of the momenta over 2000 steps in f32, and over 200 in f64.
fn keeps(which: usize, flight: Vector3) -> Finding {
    let mut tally = Tally::default();
    let mut in_f64 = 0.0_f64;
    for model in ALL_MODELS {
        for damping in [0.0, 0.2] {
            let mut trial = body(model, damping);
            throw(&mut trial.world, flight, 2e-3);
            let of = |world: &World, displacement: &[Vector3], velocity: &[Vector3]| {
                let place = |p: usize| rest_place(world, p as u32) + displacement[p];
                momenta(world.mass(), place, velocity)[which]
            };
            let now = |world: &World| {
                let (displacement, velocity) = state(world);
                of(world, &displacement, &velocity)
            };
            let before = now(&trial.world);
            let mut twin = ReferenceWorld::of(&trial.world);
            for step in 0..200 {
                if let Err(error) = twin.step() {
                    tally.fault(format!("{model} in f64, step {step}: {error}"));
                }
            }
            let after = of(&trial.world, twin.displacement(), twin.velocity());
            in_f64 = in_f64.max((after.0 - before.0).norm() / before.1);
            for _ in 0..20 {
                if let Err(error) = trial.run(10, |_| {}) {
                    tally.fault(format!("{model}, damping ratio {damping}: {error}"));
                }
                let after = now(&trial.world);
                tally.error(model, (after.0 - before.0).norm() / before.1.max(after.1));
            }
            tally.steps += trial.steps + 200;
        }
    }
    tally.expect(in_f64 < 1e-12, || format!("in f64 it changes by {in_f64:.1e} of the sum of its parts"));
    let name = ["momentum", "angular momentum"][which];
    let happened = format!(
        "{name} changed by at most {:.1e} of the sum of its parts over 2000 steps in f32, by {in_f64:.1e} over 200 in f64 \
         (paper; tissue with Poisson's ratios 0, 0.25, 0.45; damping ratios 0 and 0.2)",
        tally.error
    );
    tally.finding(1e-5, happened)
}

fn linear() -> Finding {
    alone(|| keeps(0, Vector3::new(0.3, -0.1, 0.2)))
}

fn angular() -> Finding {
    alone(|| keeps(1, Vector3::new(0.05, 0.0, -0.02)))
}

fn energy_kept() -> Finding {
    alone(|| {
        let mut tally = Tally::default();
        let (mut said, mut widest) = (Vec::new(), 0.0_f64);
        for model in MODELS {
            let mut trial = Trial::new(block_of(model, 3.0, [3, 3, 2], 0.0));
            let world = &mut trial.world;
            shake(world, 0.003, 0.0, &mut Random::new(4));
            let start = energy(world);
            let mut samples = vec![1.0];
            for _ in 0..500 {
                if let Some(error) = (0..200).find_map(|_| world.step().err()) {
                    tally.fault(format!("{model}: {error}"));
                    break;
                }
                samples.push(energy(world) / start);
            }
            tally.steps += world.steps();
            let drift = slope(&samples);
            tally.error(model, drift.abs());
            let bound = largest(samples.iter().map(|sample| (sample - 1.0).abs()));
            widest = widest.max(bound);
            said.push(format!("{model} {drift:+.1e} within {bound:.1e}"));
        }
        tally.expect(widest < 0.02, || format!("the energy leaves its bounds: {widest:.1e} of the start"));
        let happened =
            format!("drift of the straight line through 500 energies, relative to the start: {}", said.join(", "));
        tally.finding(DRIFT, happened)
    })
}

/// Allowed drift over 100 000 steps. At a strain of 0.003, f32 rounds forces by 2e-5 of themselves; at random, that comes to
/// 2e-5 times the root of the number of steps.
const DRIFT: f64 = 6e-3;

/// Change over the whole run of the least-squares line through evenly spaced samples.
fn slope(samples: &[f64]) -> f64 {
    let n = samples.len() as f64;
    let mean = samples.iter().sum::<f64>() / n;
    let at = |i: usize| i as f64 / (n - 1.0) - 0.5;
    let along = |weight: fn(f64, f64) -> f64| samples.iter().enumerate().map(|(i, s)| weight(at(i), *s)).sum::<f64>();
    (along(|t, s| t * s) - mean * along(|t, _| t)) / along(|t, _| t * t)
}

fn energy_falls() -> Finding {
    alone(|| {
        let mut tally = Tally::default();
        let mut left = 0.0_f64;
        for model in ALL_MODELS {
            for damping in [0.02, 0.2, 1.0] {
                let mut trial = Trial::new(block_of(model, 3.0, [4, 3, 3], damping));
                shake(&mut trial.world, 0.01, 0.0, &mut Random::new(5));
                let start = energy(&trial.world);
                let mut last = start;
                for _ in 0..500 {
                    if let Err(error) = trial.world.step() {
                        tally.fault(format!("{model}, damping ratio {damping}: {error}"));
                    }
                    let now = energy(&trial.world);
                    tally.error(model, (now - last) / start);
                    last = now;
                }
                tally.steps += 500;
                left = left.max(last / start);
            }
        }
        let happened = format!(
            "the largest rise in a step is {:.1e} of the energy at the start, of which at most {:.0} % is left after 500 steps \
             (paper; tissue with Poisson's ratios 0, 0.25, 0.45; damping ratios 0.02, 0.2, 1)",
            tally.error,
            100.0 * left
        );
        tally.finding(1e-6, happened)
    })
}

fn rotation(radians: f64) -> Matrix3 {
    let axis = nalgebra::Unit::new_normalize(Vector3::new(1.0, -2.0, 0.5));
    nalgebra::Rotation3::from_axis_angle(&axis, radians).into_inner()
}

fn rigid_rotation() -> Finding {
    alone(|| {
        let mut tally = Tally::default();
        let mut in_f64 = 0.0_f64;
        for model in ALL_MODELS {
            let mut trial = body(model, 0.3);
            let world = &mut trial.world;
            let (middle, h, dt) = (centre(world), world.lattice().pitch, world.dt());
            // What one per cent of stretch of a spring along an edge of the voxels would give.
            let inside = world.lattice().particle_at[world.lattice().grid.shape.linear([2, 2, 2])];
            let scale = 0.01 * h * world.assembly().stiffness.of(world.lattice(), inside, 14);
            for turn in 0..72 {
                let angle = f64::from(turn) * 5.0_f64.to_radians() + 0.01;
                let (now, before) = (rotation(angle), rotation(angle - 0.02));
                let arm: Vec<Vector3> = particles(world).into_iter().map(|p| rest_place(world, p) - middle).collect();
                let displacement: Vec<Vector3> = arm.iter().map(|r| now * r - r).collect();
                let velocity: Vec<Vector3> = arm.iter().map(|r| (now - before) * r / dt).collect();
                let (lattice, topology, assembly) = (world.lattice(), world.topology(), world.assembly());
                let springs = spring_forces(lattice, topology, assembly, &displacement, &velocity, dt);
                let cells = volume_forces(lattice, topology, assembly, &displacement, &velocity, dt);
                in_f64 = in_f64.max(largest(springs.iter().zip(&cells).map(|(s, c)| (s + c).norm() / scale)));
                for p in particles(world) {
                    world.set_displacement(p, displacement[p as usize]);
                    world.set_velocity(p, velocity[p as usize]);
                }
                let old = state(world).1;
                if let Err(error) = world.step() {
                    tally.fault(format!("{model}: {error}"));
                }
                let new = state(world).1;
                let force = |p: u32| {
                    let p = p as usize;
                    (new[p] - old[p]).norm() * f64::from(world.mass()[p]) / dt / scale
                };
                tally.error(model, largest(particles(world).into_iter().map(force)));
                tally.steps += 1;
            }
        }
        tally.expect(in_f64 < 1e-8, || format!("in f64 the force is {in_f64:.1e} of that of 1 % stretch"));
        let happened = format!(
            "at 72 angles the force on a particle is at most {:.1e} of what one spring stretched by 1 % gives in f32, {in_f64:.1e} \
             in f64 (damping ratio 0.3, one turn in 314 steps)",
            tally.error
        );
        tally.finding(2e-3, happened)
    })
}

fn spin() -> Finding {
    alone(|| {
        let mut tally = Tally::default();
        let mut turns = 0.0_f64;
        for model in MODELS {
            let mut trial = Trial::new(block_of(model, 3.0, [3, 3, 3], 1.0));
            let (middle, turn) = (centre(&trial.world), 0.01);
            let spin = Vector3::z() * (turn / trial.world.dt());
            for p in particles(&trial.world) {
                let velocity = spin.cross(&(rest_place(&trial.world, p) - middle));
                trial.world.set_velocity(p, velocity);
            }
            let mut energies = Vec::new();
            for _ in 0..2 {
                // The body widens, swings and comes to rest in its own frame before the first reading.
                if let Err(error) = trial.run(600, |_| {}) {
                    tally.fault(format!("{model}: {error}"));
                }
                let now = balance(&trial.world);
                energies.push(now.kinetic + now.elastic);
            }
            tally.error(model, (energies[1] / energies[0] - 1.0).abs());
            tally.steps += trial.steps;
            turns = turns.max(6000.0 * turn / std::f64::consts::TAU);
        }
        let happened = format!(
            "the energy changes by at most {:.1e} over {turns:.0} turns in 6000 steps, at a damping ratio of 1",
            tally.error
        );
        tally.finding(1e-3, happened)
    })
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_line_has_its_slope() {
        assert!((super::slope(&[1.0, 1.5, 2.0, 2.5]) - 1.5).abs() < 1e-12);
        assert!(super::slope(&[1.0, 2.0, 2.0, 1.0]).abs() < 1e-12);
    }
}
