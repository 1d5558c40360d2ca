//! Bodies in flight: mass, fall and spin without anything soft.

use yawara::dynamics::World;
use yawara::dynamics::measure::balance;
use yawara::geometry::{Matrix3, Vector3};

use crate::parts::*;
use crate::support::*;

#[test]
fn mass_and_inertia_are_those_of_the_block() {
    let dims = [6, 3, 2];
    let world = bone(dims, 1e-3);
    let [body] = world.rigid_bodies() else { panic!("one body") };
    let h = world.lattice().pitch;
    let size = dims.map(|n| n as f64 * h);
    let mass = BONE * size.iter().product::<f64>();
    assert!((body.mass() / mass - 1.0).abs() < 1e-7, "{} kg", body.mass());
    // The block's middle, from a first grid point that lies one layer outside it.
    let middle = Vector3::from(dims.map(|n| 0.5 * (n as f64 + 1.0) * h));
    assert!((body.centre() - middle).norm() < 1e-12);
    let square = size.map(|s| s * s);
    let moments = [square[1] + square[2], square[0] + square[2], square[0] + square[1]].map(|s| mass / 12.0 * s);
    let error = (body.inertia() - Matrix3::from_diagonal(&moments.into())).norm() / moments[2];
    assert!(error < 1e-7, "inertia of a cuboid: {error:e}");
}

#[test]
fn bone_falls_exactly() {
    let mut world = bone([5, 4, 3], 1e-3);
    let gravity = Vector3::new(0.5, -1.0, -9.81);
    world.set_gravity(gravity);
    let steps = 500;
    for _ in 0..steps {
        world.step().unwrap();
    }
    let n = f64::from(steps);
    let expected = gravity * (0.5 * n * (n + 1.0) * 1e-6);
    for particle in particles(&world) {
        let fallen = world.displacement(particle);
        // f64 all the way; the place handed out is rounded once.
        assert_eq!(fallen.map(|u| u as f32), expected.map(|u| u as f32));
    }
    assert!((world.rigid_bodies()[0].velocity() - gravity * (n * 1e-3)).norm() < 1e-12);
}

#[test]
fn a_spinning_box_keeps_angular_momentum_energy_and_shape() {
    // About its middle axis, nearly: it tumbles.
    let mut world = bone([6, 4, 2], 1e-3);
    world.set_rigid_motion(0, Vector3::zeros(), Vector3::new(0.3, 30.0, 0.1));
    let before = world.rigid_bodies()[0].clone();
    let (mut energy, mut distorted, mut tumbled) = (0.0_f64, 0.0_f64, 0.0_f64);
    for step in 0..100_000 {
        world.step().unwrap();
        let body = &world.rigid_bodies()[0];
        energy = energy.max((body.kinetic_energy() / before.kinetic_energy() - 1.0).abs());
        tumbled = tumbled
            .max(body.angular_velocity().dot(&before.angular_velocity()) / -900.0)
            .max((body.orientation() * Vector3::y()).dot(&-Vector3::y()));
        if step % 1000 == 999 {
            distorted = distorted.max(distortion(&world, body) / world.lattice().pitch);
        }
    }
    let body = &world.rigid_bodies()[0];
    eprintln!("energy within {energy:.2e}, shape within {distorted:.2e} pitches, after 480 turns");
    assert_eq!(body.angular_momentum(), before.angular_momentum(), "a constant of the scheme");
    assert_eq!(body.centre(), before.centre());
    assert!(tumbled > 0.9, "the middle axis is unstable: {tumbled}");
    // 0.03 rad a step: a bounded error of that squared.
    assert!(energy < 1e-3, "energy {energy:e}");
    assert!(distorted < 1e-6, "shape {distorted:e} pitches");
    let turn = body.orientation();
    assert!((turn * turn.transpose() - Matrix3::identity()).norm() < 1e-14);
}

/// The energy error is of second order: a quarter for half the step.
#[test]
fn the_energy_error_falls_with_the_square_of_the_step() {
    let error = |dt: f64, steps: u32| {
        let mut world = bone([6, 4, 2], dt);
        world.set_rigid_motion(0, Vector3::zeros(), Vector3::new(3.0, 20.0, 5.0));
        let before = world.rigid_bodies()[0].kinetic_energy();
        (0..steps)
            .map(|_| {
                world.step().unwrap();
                (world.rigid_bodies()[0].kinetic_energy() / before - 1.0).abs()
            })
            .fold(0.0, f64::max)
    };
    let ratio = error(2e-3, 2000) / error(1e-3, 4000);
    assert!((3.7..4.3).contains(&ratio), "{ratio}");
}

/// A symmetric top precesses about its angular momentum at `|L| / I` and turns about its axis besides: exact at any step.
#[test]
fn a_symmetric_top_is_exact() {
    let mut world = bone([3, 3, 7], 5e-3);
    world.set_rigid_motion(0, Vector3::zeros(), Vector3::new(20.0, 0.0, 35.0));
    let start = world.rigid_bodies()[0].clone();
    let (across, along) = (start.inertia()[(0, 0)], start.inertia()[(2, 2)]);
    let steps = 1000;
    for _ in 0..steps {
        world.step().unwrap();
    }
    let time = f64::from(steps) * 5e-3;
    let spin = start.angular_momentum();
    let about = |axis: Vector3| nalgebra::Rotation3::from_scaled_axis(axis).into_inner();
    let expected = about(spin * (time / across)) * about(Vector3::z() * (spin.z * (1.0 / along - 1.0 / across) * time));
    let error = (world.rigid_bodies()[0].orientation() - expected).norm();
    assert!(error < 1e-9, "{error:e} after {:.0} rad", spin.norm() / across * time);
}

#[test]
fn velocities_lead_from_place_to_place() {
    let mut world = bone([4, 3, 2], 2e-3);
    world.set_rigid_motion(0, Vector3::new(0.1, 0.2, -0.3), Vector3::new(30.0, -20.0, 10.0));
    for _ in 0..20 {
        let before = displacements(&world);
        world.step().unwrap();
        for particle in particles(&world) {
            let moved = (world.displacement(particle) - before[particle as usize]) / world.dt();
            // Two f32 places of some centimetres, over a step.
            assert!((world.velocity(particle) - moved).norm() < 1e-5);
        }
    }
}

#[test]
fn a_single_voxel_and_a_row_are_bodies_too() {
    for dims in [[1, 1, 1], [7, 1, 1]] {
        let mut world = bone(dims, 1e-3);
        world.set_rigid_motion(0, Vector3::x(), Vector3::new(40.0, 5.0, -3.0));
        let before = balance(&world);
        for _ in 0..1000 {
            world.step().unwrap();
        }
        let after = balance(&world);
        assert!(relative(after.angular_momentum - before.angular_momentum, before.angular_momentum.norm()) < 1e-12);
        assert!((after.kinetic / before.kinetic - 1.0).abs() < 1e-9, "symmetric: exact");
        let angular: World = world.clone();
        assert!(angular.rigid_bodies()[0].inertia().symmetric_eigenvalues().min() > 0.0);
    }
}

#[test]
fn a_body_that_diverges_is_reported() {
    let mut world = bone([3, 3, 3], 1e-3);
    world.set_rigid_motion(0, Vector3::new(f64::NAN, 0.0, 0.0), Vector3::zeros());
    let before = displacements(&world);
    assert!(world.step().is_err());
    assert_eq!(displacements(&world), before, "places stay as they were");
}
