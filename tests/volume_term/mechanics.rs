//! What the law is for, and what it must not do.

use super::*;
use yawara::dynamics::measure::{balance, volume_energy};
use yawara::geometry::Matrix3;
use yawara::kernel::reference::cell_volume_energy;

fn energy(lattice: &Lattice, topology: &Topology, assembly: &Assembly, displacement: &[Vector3]) -> f64 {
    let term = assembly.volume.as_ref().unwrap();
    let of = |cell| cell_volume_energy(lattice, topology, term, cell, |p| displacement[p as usize]);
    (0..lattice.len() as u32).map(of).sum()
}

#[test]
fn the_force_is_minus_the_gradient_of_the_energy() {
    for factor in [STIFF, NEGATIVE] {
        let (lattice, assembly) = with_volume(&blob([3, 3, 3], 0.8, 1), &[Some(TISSUE), Some(TISSUE)], factor, None);
        let topology = Topology::new(&lattice);
        let mut random = Random::new(2);
        let h = lattice.pitch;
        let still = vec![Vector3::zeros(); lattice.len()];
        let mut u: Vec<Vector3> = still.iter().map(|_| random.vector() * 0.3 * h).collect();
        let force = volume_forces(&lattice, &topology, &assembly, &u, &still, 1e-4);
        let scale = largest(&force);
        let mut worst = 0.0_f64;
        // Fourth-order central difference: error of (1e-3)^4, rounding of 1e-16 / 1e-3.
        let step = 1e-3 * h;
        for particle in 0..lattice.len() {
            for axis in 0..3 {
                let start = u[particle][axis];
                let mut at = |offset: f64| {
                    u[particle][axis] = start + offset * step;
                    energy(&lattice, &topology, &assembly, &u)
                };
                let slope = (8.0 * (at(1.0) - at(-1.0)) - (at(2.0) - at(-2.0))) / (12.0 * step);
                u[particle][axis] = start;
                worst = worst.max((force[particle][axis] + slope).abs() / scale);
            }
        }
        println!("factor {factor}: force against energy {worst:e}");
        assert!(worst < 1e-8, "factor {factor}: {worst:e}");
    }
}

/// Collapsed or blown up, a cell of negative modulus never gives more than the documented energy.
#[test]
fn the_energy_is_bounded_below() {
    let (lattice, assembly) = with_volume(&block([3, 3, 3]), &[Some(TISSUE)], NEGATIVE, None);
    let topology = Topology::new(&lattice);
    let modulus = &assembly.volume.as_ref().unwrap().modulus;
    let bound: f64 = modulus.iter().map(|&l| 0.5 * f64::from(l) * lattice.pitch.powi(3)).sum();
    for scale in [-10.0, -1.0, -0.5, 0.5, 3.0, 100.0] {
        let u: Vec<Vector3> =
            (0..lattice.len() as u32).map(|p| Vector3::from(lattice.ijk(p).map(|n| n as f64)) * 3e-3 * scale).collect();
        let energy = energy(&lattice, &topology, &assembly, &u);
        assert!(energy < 0.0 && energy >= bound * (1.0 + 1e-12), "{scale}: {energy:e} J, bound {bound:e} J");
    }
}

#[test]
fn momentum_is_kept_to_rounding() {
    for (factor, viscous) in [(STIFF, Some(1.0)), (NEGATIVE, None)] {
        let map = blob([12, 12, 12], 0.6, 2);
        let mut world = steady(with_volume(&map, &[Some(damped(0.1)), Some(damped(0.1))], factor, viscous));
        shake(&mut world, 0.1, 0.2, 3);
        let before = balance(&world);
        let scale: f64 =
            particles(&world).iter().map(|&p| f64::from(world.mass()[p as usize]) * world.velocity(p).norm()).sum();
        let arm = rest_places(&world).iter().map(Vector3::norm).fold(0.0, f64::max);
        for _ in 0..500 {
            world.step().unwrap();
        }
        let after = balance(&world);
        // Every step rounds every velocity once, at random, and forces that are up to twenty times the springs'.
        let linear = (after.momentum - before.momentum).norm() / scale;
        let angular = (after.angular_momentum - before.angular_momentum).norm() / (scale * arm);
        println!("factor {factor}: momentum {linear:e}, angular momentum {angular:e}");
        assert!(linear < 1e-6, "momentum changed by {linear:e} of the particles' total");
        assert!(angular < 1e-6, "angular momentum changed by {angular:e}");
    }
}

/// Without damping the sum of all energies swings by the first order of the step and does not drift.
#[test]
fn energy_is_kept() {
    for factor in [STIFF, NEGATIVE] {
        let mut world = steady(with_volume(&block([6, 6, 6]), &[Some(TISSUE)], factor, None));
        shake(&mut world, 0.03, 0.0, 4);
        let total = |world: &World| balance(world).kinetic + balance(world).elastic;
        let start = total(&world);
        let share = volume_energy(&world) / start;
        assert!(share.abs() > 0.01 && share.signum() == factor.signum(), "the cells' share is {share}");
        for _ in 0..3000 {
            world.step().unwrap();
        }
        let ratio = total(&world) / start;
        println!("factor {factor}: share {share:.3}, energy after 3000 steps {ratio:.5}");
        assert!((ratio - 1.0).abs() < 0.05, "energy went to {ratio} of what it was");
    }
}

#[test]
fn a_rigid_rotation_has_no_force_and_no_loss() {
    let axis = nalgebra::Unit::new_normalize(Vector3::new(1.0, -2.0, 0.5));
    let turn = |degrees: f64| nalgebra::Rotation3::from_axis_angle(&axis, degrees.to_radians()).into_inner();
    for factor in [STIFF, NEGATIVE] {
        for degrees in [1.0, 30.0, 90.0, 179.0] {
            let lattice = with_volume(&block([9, 8, 7]), &[Some(damped(0.5))], factor, Some(factor.abs()));
            let mut world = steady(lattice);
            let rest = rest_places(&world);
            // Turning by 2 degrees a step: the places one step ago and now are both on the circle.
            let (now, before) = (turn(degrees), turn(degrees - 2.0));
            for particle in particles(&world) {
                let rest = rest[particle as usize];
                world.set_displacement(particle, now * rest - rest);
                world.set_velocity(particle, (now * rest - before * rest) / world.dt());
            }
            // What one per cent of volume, and that much in one step, would give.
            let scale = {
                let (lattice, topology, assembly) = (world.lattice(), world.topology(), world.assembly());
                let grown: Vec<Vector3> = rest.iter().map(|r| r * (0.01 / 3.0)).collect();
                let rate: Vec<Vector3> = grown.iter().map(|u| u / world.dt()).collect();
                largest(&volume_forces(lattice, topology, assembly, &grown, &rate, world.dt()))
            };
            let ghost = largest(&reference_forces(&world).1) / scale;
            // f32 places of a turned block 10 pitches large: 1e-6 of a pitch against 1e-2.
            assert!(ghost < 1e-3, "{degrees} degrees: {ghost:e} of a 1 % change of volume");
            let speeds = velocities(&world);
            world.step().unwrap();
            let kick = particles(&world)
                .into_iter()
                .map(|p| (world.velocity(p) - speeds[p as usize]).norm() * f64::from(world.mass()[p as usize]))
                .fold(0.0, f64::max)
                / world.dt();
            assert!(kick < 1e-3 * scale, "{degrees} degrees: the fast loop made {:e} of it", kick / scale);
        }
    }
}

/// A uniform strain in the bulk: the layers of one half of the block carry stress times cross-section, computed by the fast
/// loop. The springs' Lame constants are both `mu`; the volume term adds `L` to the first.
#[test]
fn the_bulk_has_the_stiffness_of_springs_and_cells() {
    let dims = [20, 12, 10];
    let young = TISSUE.youngs_modulus;
    let mu = young / 2.5;
    for factor in [STIFF, 1.5, NEGATIVE] {
        let modulus = factor * young;
        let strain = 1e-3;
        let uniaxial = Matrix3::from_diagonal(&Vector3::new(strain, 0.0, 0.0));
        let all_round = Matrix3::from_diagonal_element(strain / 3.0);
        // Simple shear keeps the volume to every order.
        let shear = Matrix3::new(0.0, 0.0, 0.0, 2.0 * strain, 0.0, 0.0, 0.0, 0.0, 0.0);
        for (name, gradient, stress) in [
            ("uniaxial", uniaxial, Vector3::new((modulus + 3.0 * mu) * strain, 0.0, 0.0)),
            ("bulk", all_round, Vector3::new((modulus + 5.0 / 3.0 * mu) * strain, 0.0, 0.0)),
            ("shear", shear, Vector3::new(0.0, 2.0 * mu * strain, 0.0)),
        ] {
            // Half the difference of both signs of the strain: free of the second order.
            let pull: Vector3 = [0.5, -0.5]
                .into_iter()
                .map(|sign: f64| {
                    let mut world = steady(with_volume(&block(dims), &[Some(TISSUE)], factor, None));
                    let rest = rest_places(&world);
                    for particle in particles(&world) {
                        world.set_displacement(particle, gradient * rest[particle as usize] * sign.signum());
                    }
                    world.step().unwrap();
                    let near = particles(&world).into_iter().filter(|&p| world.lattice().ijk(p)[0] <= 10);
                    let push = |p: u32| world.velocity(p) * f64::from(world.mass()[p as usize]) / world.dt();
                    near.map(push).sum::<Vector3>() * sign
                })
                .sum();
            let expected = stress * (dims[1] * dims[2]) as f64 * 9e-6;
            let error = (pull - expected).norm() / expected.norm();
            println!("factor {factor}, {name}: {error:e}");
            // Springs compare lengths in f32, which resolves strains of 1e-7.
            assert!(error < 5e-4, "factor {factor}, {name}: off by {error:e}");
        }
    }
}

/// A breathing block loses its energy to the volume viscosity alone, and to nothing when that is absent.
#[test]
fn viscosity_damps_changes_of_volume() {
    let run = |viscous: Option<f64>| {
        let mut world = steady(with_volume(&block([6, 6, 6]), &[Some(damped(1e-4))], STIFF, viscous));
        let rest = rest_places(&world);
        for particle in particles(&world) {
            world.set_displacement(particle, rest[particle as usize] * 1e-3);
        }
        let start = balance(&world).elastic;
        for _ in 0..400 {
            world.step().unwrap();
        }
        (balance(&world).kinetic + balance(&world).elastic) / start
    };
    let (free, viscous) = (run(None), run(Some(3e3)));
    println!("energy left: {free:.4} without, {viscous:.4} with viscosity");
    assert!(free > 0.9, "{free}");
    assert!(viscous < 0.5 * free, "{viscous} against {free}");
}
