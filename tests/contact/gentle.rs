//! Tissue that finds itself inside is led out, not shot out.

use yawara::dynamics::effects::contact::{PUSH_OUT_SPEED, Shape};

use super::*;

#[test]
fn a_tool_that_appears_in_tissue_opens_it_slowly() {
    let start = world(tissue_lattice(&block([12, 12, 10]), &[Some(DAMPED)]));
    // In the middle of the block, and beside a particle, so that every one has a way out.
    let (center, radius) = (Point3::new(6.7, 21.2, 33.1), 8.0);
    let mut world = start.clone();
    let tool = world.add_obstacle("ball", Shape::sphere(center, radius), 0.0);
    let inside =
        |world: &World| places_mm(world).iter().filter(|place| (*place - center).norm() < radius - 1e-4).count();
    let first = inside(&world);
    assert!(first > 50, "{first}");
    // The deepest has the radius to go; all are out by then.
    let needed = radius * 1e-3 / PUSH_OUT_SPEED;
    let mut fastest = 0.0_f64;
    while world.time() < 1.05 * needed {
        world.step().unwrap();
        fastest = velocities(&world).iter().map(Vector3::norm).fold(fastest, f64::max);
    }
    println!("fastest {fastest:.3} m/s, {} of {first} left", inside(&world));
    assert_eq!(inside(&world), 0);
    assert!(fastest < 4.0 * PUSH_OUT_SPEED, "{fastest}");
    assert!(world.tool_force(tool).norm() < 1.0);

    // What a hold kept inside is led out, too, when it ends; held, it stays.
    let mut world = start;
    let held: Vec<u32> =
        particles(&world).into_iter().filter(|&p| (world.lattice().rest_place(p) - center).norm() < radius).collect();
    let hold = world.hold(&held);
    world.add_obstacle("ball", Shape::sphere(center, radius), 0.0);
    run(&mut world, 0.02);
    assert!(held.iter().all(|&p| world.displacement(p).norm() == 0.0));
    world.release(hold);
    run(&mut world, 1.05 * needed);
    assert_eq!(inside(&world), 0);
}

/// A block taken by its end and pulled over a ball; what is grabbed goes through it.
#[test]
fn what_is_grabbed_goes_where_it_is_told() {
    let mut world = world(tissue_lattice(&block([10, 4, 4]), &[Some(DAMPED)]));
    let taken: Vec<u32> = particles(&world).into_iter().filter(|&p| world.lattice().ijk(p)[0] == 10).collect();
    let grab = world.grab(&taken);
    let (center, radius) = (Point3::new(22.0, 9.0, 14.0), 6.0);
    world.add_obstacle("ball", Shape::sphere(center, radius), 0.2);
    while world.time() < 0.1 {
        world.move_grab(grab, Vector3::new(0.0, 0.0, -60.0 * world.time()));
        world.step().unwrap();
    }
    for &p in &taken {
        assert!((world.to_patient_axes(world.displacement(p)).z * 1e3 + 6.0).abs() < 0.1);
    }
    let free = places_mm(&world).into_iter().enumerate().filter(|(p, _)| !taken.contains(&(*p as u32)));
    assert!(free.into_iter().all(|(_, place)| (place - center).norm() > radius - 1e-4));
}
