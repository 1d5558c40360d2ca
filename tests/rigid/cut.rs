//! Bone that is cut.

use yawara::cut::Blade;
use yawara::dynamics::World;
use yawara::dynamics::measure::balance;
use yawara::dynamics::stable_dt::stable_dt;
use yawara::geometry::{Point3, Vector3};
use yawara::material::RigidKind;

use crate::parts::*;
use crate::support::*;

/// A blade through everything, in the plane through a place and across a direction, lattice axes [m].
fn across(place: Vector3, normal: Vector3) -> Blade {
    let normal = normal.normalize();
    let side = normal.cross(&Vector3::new(0.3, 0.5, 0.8)).normalize();
    let stroke = normal.cross(&side);
    let corner = Point3::from(place - side - stroke);
    Blade::new(vec![corner, corner + side * 2.0], &[Vector3::zeros(), stroke * 2.0])
}

fn cut(world: &mut World, blade: &Blade) -> usize {
    world.cut(&blade.sweep(0.0, blade.path_length()))
}

#[test]
fn a_spinning_bar_cut_in_two_is_two_bodies_that_part() {
    let mut world = bone([12, 3, 2], 1e-3);
    let h = world.lattice().pitch;
    world.set_rigid_motion(0, Vector3::new(0.2, -0.1, 0.3), Vector3::new(4.0, 3.0, 20.0));
    for _ in 0..150 {
        world.step().unwrap();
    }
    let whole = world.rigid_bodies()[0].clone();
    let (before, places, speeds) = (balance(&world), displacements(&world), velocities(&world));
    // Across the bar as it is turned now, a pitch beyond its middle: 7 and 5 layers.
    let along = whole.orientation() * Vector3::x();
    assert!(cut(&mut world, &across(whole.centre() + along * h, along)) > 20);
    let [near, far] = world.rigid_bodies() else { panic!("{} bodies", world.rigid_bodies().len()) };
    assert_eq!([near.particles().len(), far.particles().len()], [42, 30]);
    assert!((near.mass() / whole.mass() - 7.0 / 12.0).abs() < 1e-12);
    assert_eq!((places, speeds), (displacements(&world), velocities(&world)), "a cut moves nothing");
    let after = balance(&world);
    let linear = relative(after.momentum - before.momentum, before.momentum.norm());
    let angular = relative(after.angular_momentum - before.angular_momentum, before.angular_momentum.norm());
    eprintln!("cut: momentum {linear:.1e}, angular momentum {angular:.1e}");
    assert!(linear < 1e-14 && angular < 1e-14, "{linear:e} {angular:e}");
    assert!((after.kinetic / before.kinetic - 1.0).abs() < 1e-13, "nothing moves otherwise than before");
    for part in [near, far] {
        assert!((part.angular_velocity() - whole.angular_velocity()).norm() < 1e-11);
        // The tensor of its own block, turned: 7 or 5 x 3 x 2.
        let size = Vector3::new(part.particles().len() as f64 / 6.0, 3.0, 2.0) * h;
        let longest = part.mass() / 12.0 * (size.x.powi(2) + size.y.powi(2));
        assert!((part.inertia().symmetric_eigenvalues().max() / longest - 1.0).abs() < 1e-7);
    }
    let gap = |world: &World| (world.rigid_bodies()[0].centre() - world.rigid_bodies()[1].centre()).norm();
    let start = gap(&world);
    assert!((start - 6.0 * h).abs() < 1e-9);
    for _ in 0..2000 {
        world.step().unwrap();
    }
    // They leave each other along the tangent: at the relative speed they had.
    assert!(gap(&world) > start + 0.5 * 2.0 * 6.0 * h * 20.0 * 0.5, "{} m apart", gap(&world));
    let end = balance(&world);
    assert!(relative(end.momentum - before.momentum, before.momentum.norm()) < 1e-14);
    // 2000 times the same step added to the same binade in f64, 0.5 m from the origin: 2000 * 6e-17 m of arm.
    let angular = relative(end.angular_momentum - before.angular_momentum, before.angular_momentum.norm());
    eprintln!("apart: angular momentum {angular:.1e}");
    assert!(angular < 1e-11, "{angular:e}");
    for body in world.rigid_bodies() {
        // They are 0.2 m away and more by now, where f32 places are 1e-8 m apart: 5e-6 of a pitch.
        assert!(distortion(&world, body) < 2e-5 * h, "{:e}", distortion(&world, body) / h);
    }
}

#[test]
fn half_a_cut_leaves_one_body() {
    let mut world = bone([8, 4, 3], 1e-3);
    let h = world.lattice().pitch;
    let edge = vec![Point3::new(4.5 * h, -1.0, 2.5 * h), Point3::new(4.5 * h, 1.0, 2.5 * h)];
    let half = Blade::new(edge, &[Vector3::zeros(), Vector3::z()]);
    assert!(cut(&mut world, &half) > 4);
    assert_eq!(world.rigid_bodies().len(), 1);
    // Once more, wholly through.
    assert!(cut(&mut world, &across(Vector3::x() * 4.5 * h, Vector3::x())) > 4);
    assert_eq!(world.rigid_bodies().len(), 2);
    // And down to single voxels.
    let mut last = 2;
    for axis in 0..3 {
        for n in 1..8 {
            let normal = Vector3::ith(axis, 1.0);
            cut(&mut world, &across(normal * ((n as f64 + 0.5) * h), normal));
            assert!(world.rigid_bodies().len() >= last);
            last = world.rigid_bodies().len();
        }
    }
    assert_eq!(last, 8 * 4 * 3);
    let mut seen: Vec<u32> = world.rigid_bodies().iter().flat_map(|body| body.particles().to_vec()).collect();
    seen.sort_unstable();
    assert_eq!(seen, particles(&world));
    world.step().unwrap();
}

#[test]
fn bone_in_tissue_is_cut_while_all_moves() {
    let mut world = world(tissue_bone(&bar_in_tissue(), TISSUE));
    let h = world.lattice().pitch;
    world.set_rigid_motion(0, Vector3::new(0.1, 0.0, 0.0), Vector3::new(0.0, 10.0, 5.0));
    for _ in 0..50 {
        world.step().unwrap();
    }
    let (before, places) = (balance(&world), displacements(&world));
    let bound = stable_dt(world.lattice(), world.topology(), world.assembly());
    let scale: f64 =
        particles(&world).iter().map(|&p| f64::from(world.mass()[p as usize]) * world.velocity(p).norm()).sum();
    let middle = world.rigid_bodies()[0].centre() + Vector3::new(0.6, 0.2, 0.1) * h;
    assert!(cut(&mut world, &across(middle, Vector3::new(1.0, 0.4, 0.1))) > 50);
    assert_eq!(world.rigid_bodies().len(), 2);
    assert_eq!(displacements(&world), places);
    assert!(stable_dt(world.lattice(), world.topology(), world.assembly()) >= bound);
    let after = balance(&world);
    assert!(relative(after.momentum - before.momentum, scale) < 1e-14);
    assert!(relative(after.angular_momentum - before.angular_momentum, scale * 0.05) < 1e-13);
    for _ in 0..500 {
        world.step().unwrap();
    }
    let end = balance(&world);
    assert!(relative(end.momentum - before.momentum, scale) < 1e-6);
    assert!(relative(end.angular_momentum - before.angular_momentum, scale * 0.05) < 1e-6);
}

#[test]
fn a_part_cut_off_a_held_bone_is_free() {
    let mut world = bone([10, 2, 2], 1e-3);
    let h = world.lattice().pitch;
    world.set_gravity(Vector3::new(0.0, 0.0, -9.81));
    let first = world.rigid_bodies()[0].particles()[0];
    world.hold(&[first]);
    cut(&mut world, &across(Vector3::x() * 5.5 * h, Vector3::x()));
    for _ in 0..10 {
        world.step().unwrap();
    }
    let [held, free] = world.rigid_bodies() else { panic!("two bodies") };
    assert!(held.held() && held.particles().contains(&first) && !free.held());
    assert_eq!(held.velocity(), Vector3::zeros());
    assert!((free.velocity().norm() - 9.81 * 0.01).abs() < 1e-12);
}

#[test]
fn a_part_cut_off_anchored_bone_falls() {
    let map = organ_map([10, 2, 2], |[i, _, _]| if i < 4 { 2 } else { 1 });
    let (lattice, assembly) = paper_bone(&map, PAPER);
    let mut world = World::new(lattice, assembly, 1e-3);
    let h = world.lattice().pitch;
    world.set_gravity(Vector3::new(0.0, 0.0, -9.81));
    assert!(world.rigid_bodies().is_empty());
    // Grabbed and moved as a whole first: the part falls from there.
    let all = particles(&world);
    let grab = world.grab(&all);
    world.move_grab(grab, Vector3::new(0.0, 2.0, 0.0));
    world.step().unwrap();
    world.release(grab);
    let aside = world.to_lattice_axes(Vector3::new(0.0, 2e-3, 0.0));
    cut(&mut world, &across(Vector3::x() * 6.5 * h, Vector3::x()));
    assert_eq!(world.rigid_bodies().len(), 1);
    assert_eq!(world.rigid_bodies()[0].particles().len(), 4 * 4);
    for _ in 0..10 {
        world.step().unwrap();
    }
    let fall = world.to_lattice_axes(Vector3::new(0.0, 0.0, -9.81 * 55.0 * 1e-6));
    for p in particles(&world) {
        let expected = if world.rigid_body_of(p).is_some() { aside + fall } else { aside };
        assert!((world.displacement(p) - expected).norm() < 1e-9, "particle {p}");
    }
    // Exactly where free and anchored bone meet.
    cut(&mut world, &across(Vector3::x() * 4.5 * h, Vector3::x()));
    assert_eq!(world.rigid_bodies().len(), 2);
    assert_eq!(world.rigid_bodies()[1].particles().len(), 2 * 4);
}

#[test]
fn bones_that_touch_are_one_body_until_they_are_cut_apart() {
    let map = organ_map([8, 3, 3], |[i, _, _]| if i < 5 { 0 } else { 1 });
    let (lattice, assembly) = with_bone(paper_lattice(&map, &[None, None]), |_| RigidKind::Free);
    let mut world = World::new(lattice, assembly, 1e-3);
    let h = world.lattice().pitch;
    assert_eq!(world.rigid_bodies().len(), 1);
    cut(&mut world, &across(Vector3::x() * 5.5 * h, Vector3::x()));
    let [five, three] = world.rigid_bodies() else { panic!("two bodies") };
    assert_eq!([five.particles().len(), three.particles().len()], [45, 27]);
}
