//! Bone that is pushed, held and grabbed.

use yawara::dynamics::measure::balance;
use yawara::geometry::Vector3;

use crate::parts::*;
use crate::support::*;

#[test]
fn a_force_off_centre_turns_the_body() {
    let mut world = bone([5, 5, 5], 1e-3);
    let h = world.lattice().pitch;
    let last = *world.rigid_bodies()[0].particles().last().unwrap();
    let push = world.push(&[last]);
    let force = Vector3::new(0.0, 1e-3, 0.0);
    world.set_force(push, force);
    let body = world.rigid_bodies()[0].clone();
    world.step().unwrap();
    let after = &world.rigid_bodies()[0];
    // A cube: I = m a^2 / 6. The corner voxel is two pitches from the centre along each axis.
    let inertia = body.mass() * (5.0 * h).powi(2) / 6.0;
    let turning = Vector3::new(2.0, 2.0, 2.0).cross(&force) * (h / inertia * world.dt());
    assert!(relative(after.angular_velocity() - turning, turning.norm()) < 1e-7, "{}", after.angular_velocity());
    let moving = force * (world.dt() / body.mass());
    assert!(relative(after.velocity() - moving, moving.norm()) < 1e-12);
    // The whole body pushed: no turn.
    world.release(push);
    let all = body.particles().to_vec();
    let push = world.push(&all);
    world.set_force(push, force);
    let before = world.rigid_bodies()[0].clone();
    world.step().unwrap();
    let after = &world.rigid_bodies()[0];
    assert!(relative(after.angular_momentum() - before.angular_momentum(), before.angular_momentum().norm()) < 1e-6);
    assert!(relative(after.momentum() - before.momentum() - force * world.dt(), 1e-6) < 1e-9);
}

#[test]
fn a_hold_of_one_particle_stops_the_body_until_released() {
    let mut world = world(paper_bone(&bar_in_tissue(), PAPER));
    world.set_gravity(Vector3::new(0.0, 0.0, -9.81));
    world.set_rigid_motion(0, Vector3::new(0.05, 0.0, 0.0), Vector3::new(0.0, 0.0, 5.0));
    for _ in 0..20 {
        world.step().unwrap();
    }
    let particles = world.rigid_bodies()[0].particles().to_vec();
    let hold = world.hold(&particles[..1]);
    assert!(world.rigid_bodies()[0].held());
    assert!(particles.iter().all(|&p| world.velocity(p) == Vector3::zeros()), "it stops at once");
    let held = displacements(&world);
    for _ in 0..50 {
        world.step().unwrap();
    }
    let now = displacements(&world);
    assert!(particles.iter().all(|&p| now[p as usize] == held[p as usize]), "it stays");
    assert_ne!(now, held, "the tissue does not");
    world.release(hold);
    for _ in 0..20 {
        world.step().unwrap();
    }
    assert!(particles.iter().all(|&p| world.displacement(p) != held[p as usize]), "it goes on");
    assert!(distortion(&world, &world.rigid_bodies()[0]) < 1e-6 * world.lattice().pitch);
}

#[test]
fn a_grab_of_bone_and_tissue_takes_the_whole_bone_along() {
    let mut world = world(paper_bone(&bar_in_tissue(), PAPER));
    world.set_rigid_motion(0, Vector3::zeros(), Vector3::new(0.0, 3.0, 5.0));
    for _ in 0..20 {
        world.step().unwrap();
    }
    let bone = world.rigid_bodies()[0].particles().to_vec();
    let soft: Vec<u32> = particles(&world).into_iter().filter(|p| !bone.contains(p)).take(10).collect();
    let start = displacements(&world);
    let grabbed: Vec<u32> = bone[..3].iter().chain(&soft).copied().collect();
    let grab = world.grab(&grabbed);
    let steps = 100;
    for step in 1..=steps {
        world.move_grab(grab, Vector3::new(0.02, -0.01, 0.005) * f64::from(step));
        world.step().unwrap();
    }
    let moved = world.to_lattice_axes(Vector3::new(2.0, -1.0, 0.5) * 1e-3);
    for &p in bone.iter().chain(&soft) {
        let error = (world.displacement(p) - start[p as usize] - moved).norm();
        // f32 places of a millimetre, and f32 velocities that take the tissue there.
        assert!(error < 2e-9, "particle {p}: {error:e} m");
    }
    let velocity = moved / (f64::from(steps) * world.dt());
    assert!(relative(world.rigid_bodies()[0].velocity() - velocity, velocity.norm()) < 1e-3);
    assert_eq!(world.rigid_bodies()[0].angular_momentum(), Vector3::zeros());
    // Held besides, it stays; released, it goes on as it went.
    let hold = world.hold(&bone[5..6]);
    let place = world.displacement(bone[0]);
    world.move_grab(grab, Vector3::new(5.0, 0.0, 0.0));
    world.step().unwrap();
    assert_eq!(world.displacement(bone[0]), place);
    world.release(hold);
    world.move_grab(grab, Vector3::new(2.05, -1.0, 0.5));
    world.step().unwrap();
    world.release(grab);
    let velocity = world.rigid_bodies()[0].velocity();
    assert!(velocity.norm() > 0.01);
    let before = balance(&world).momentum;
    world.step().unwrap();
    assert!((world.rigid_bodies()[0].velocity() - velocity).norm() < 0.5 * velocity.norm());
    assert!((balance(&world).momentum - before).norm() < 1e-4 * before.norm());
}

#[test]
fn anchored_bone_stays_and_anchors_what_it_is_joined_to() {
    // Anchored, free, and free apart from both.
    let map = organ_map([9, 3, 3], |[i, _, _]| [2, 2, 1, 1, 255, 255, 1, 1, 1][i]);
    let (lattice, assembly) = paper_bone(&map, PAPER);
    let mut world = yawara::dynamics::World::new(lattice, assembly, 1e-3);
    world.set_gravity(Vector3::new(0.0, 0.0, -9.81));
    let [body] = world.rigid_bodies() else { panic!("one free body") };
    assert_eq!(body.particles().len(), 27);
    let falling = body.particles().to_vec();
    for _ in 0..10 {
        world.step().unwrap();
    }
    for p in particles(&world) {
        assert_eq!(world.displacement(p) != Vector3::zeros(), falling.contains(&p), "particle {p}");
    }
    // As today, what is anchored moves while it is grabbed, and stops.
    let anchored: Vec<u32> = particles(&world).into_iter().filter(|p| !falling.contains(p)).collect();
    let grab = world.grab(&anchored);
    world.move_grab(grab, Vector3::new(1.0, 0.0, 0.0));
    world.step().unwrap();
    world.release(grab);
    world.step().unwrap();
    let moved = world.to_lattice_axes(Vector3::new(1e-3, 0.0, 0.0));
    assert!(anchored.iter().all(|&p| (world.displacement(p) - moved).norm() < 1e-9));
    assert!(anchored.iter().all(|&p| world.velocity(p) == Vector3::zeros()));
}
