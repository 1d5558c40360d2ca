//! A block on a slope: Coulomb's law, and the weight.

use yawara::dynamics::Handle;
use yawara::dynamics::effects::contact::Shape;
use yawara::geometry::Affine;

use super::*;

const G: f64 = 9.81;

/// A block of 9 x 8 x 4 cells that lies on a slope, in a volume turned with it; the slope's handle, its normal and the way
/// down.
fn on_slope(degrees: f64, friction: f64) -> (World, Handle, [Vector3; 2]) {
    // Turned about the vertical as well, so that no axis is the volume's own.
    let turn = nalgebra::Rotation3::from_euler_angles(0.0, degrees.to_radians(), 0.0);
    let turn = nalgebra::Rotation3::from_euler_angles(0.0, 0.0, 0.4) * turn;
    let affine = Affine::from_parts(turn.into_inner() * 3.0, Vector3::new(-20.0, 7.0, 30.0)).unwrap();
    let mut world = world(tissue_lattice(&block_placed(affine, [9, 8, 4]), &[Some(DAMPED)]));
    world.set_gravity(Vector3::new(0.0, 0.0, -G));
    let (normal, down) = (turn * Vector3::z(), turn * Vector3::x());
    assert!(degrees == 0.0 || down.z < -0.01);
    // Through the lowest layer of particles, half a voxel below the middle of the first voxel.
    let point = affine.apply(Point3::new(-0.5, -0.5, -0.5));
    let slope = world.add_obstacle("slope", Shape::plane(point, normal * 7.0), friction);
    (world, slope, [normal, down])
}

#[test]
fn a_block_at_rest_presses_with_its_weight() {
    for friction in [0.0, 0.4] {
        let (mut world, table, [normal, _]) = on_slope(0.0, friction);
        run(&mut world, 0.6);
        let weight = -normal * G * total_mass(&world);
        let force = world.tool_force(table);
        assert!((force - weight).norm() < 1e-3 * weight.norm(), "{force} {weight}");
        // The impulse is the force summed: from the start, when nothing pressed, it lacks what still moves, and that is nothing.
        let before = world.tool_impulse(table);
        run(&mut world, 0.05);
        let mean = (world.tool_impulse(table) - before) / 0.05;
        assert!((mean - weight).norm() < 0.02 * weight.norm(), "{mean} {weight}");
    }
}

#[test]
fn a_block_slides_as_coulomb_says() {
    for (degrees, friction) in [(25.0, 0.0), (25.0, 0.2), (35.0, 0.5), (15.0, 0.1)] {
        let (mut world, slope, [normal, down]) = on_slope(degrees, friction);
        run(&mut world, 0.3);
        let (start, before) = (world.time(), mean_velocity(&world));
        run(&mut world, 0.3);
        let passed = world.time() - start;
        let gained = (mean_velocity(&world) - before) / passed;
        let angle = f64::to_radians(degrees);
        let expected = G * (angle.sin() - friction * angle.cos());
        println!("{degrees} degrees, friction {friction}: {:.4} of {expected:.4} m/s2", gained.dot(&down));
        assert!((gained.dot(&down) - expected).abs() < 0.02 * G * angle.sin(), "{degrees} {friction}: {gained}");
        assert!(gained.dot(&normal).abs() < 0.02 * G, "{gained}");
        // The slope feels the weight across it, and the friction along it.
        let force = world.tool_force(slope) / total_mass(&world);
        let across = -force.dot(&normal);
        assert!((across - G * angle.cos()).abs() < 0.05 * G, "{across}");
        assert!((force.dot(&down) - friction * across).abs() < 1e-6 * G, "{force}");
    }
}

#[test]
fn a_block_sticks_below_the_angle_of_friction() {
    for (degrees, friction) in [(10.0, 0.25), (25.0, 0.6), (25.0, 5.0)] {
        let (mut world, slope, [_, down]) = on_slope(degrees, friction);
        run(&mut world, 0.6);
        let before = places_mm(&world);
        run(&mut world, 0.3);
        let farthest = places_mm(&world).iter().zip(before).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        println!("{degrees} degrees, friction {friction}: {farthest:.2e} mm in 0.3 s");
        // Sliding it would have gone down by centimetres.
        assert!(farthest < 0.01, "{degrees} {friction}: {farthest} mm");
        let held = world.tool_force(slope).dot(&down) / total_mass(&world);
        assert!((held / (G * f64::to_radians(degrees).sin()) - 1.0).abs() < 0.01, "{held}");
    }
}

/// Friction is with the obstacle and not with the room: a belt takes the block along, up to its own speed.
#[test]
fn a_moving_plane_takes_the_block_along() {
    let (mut world, belt, [_, down]) = on_slope(0.0, 0.5);
    run(&mut world, 0.2);
    let (start, speed) = (world.time(), 0.2);
    while world.time() < start + 0.3 {
        let then = world.time() + world.dt() - start;
        world.move_obstacle(belt, down * (1e3 * speed * then));
        world.step().unwrap();
    }
    let reached = mean_velocity(&world);
    assert!((reached - down * speed).norm() < 0.01 * speed, "{reached}");
}
