//! Pressure against closed forms, and what a closed surface must not do.

use std::f64::consts::PI;
use std::path::Path;

use nalgebra::Rotation3;
use yawara::dynamics::measure::balance;
use yawara::dynamics::timeline::{Timeline, What};
use yawara::dynamics::{Face, World, boundary_faces};
use yawara::geometry::{Matrix3, Point3, Vector3};
use yawara::lattice::SeveredSpring;
use yawara::lattice::build::{NO_ORGAN, OrganMap};
use yawara::lattice::neighbours::direction_of;
use yawara::lattice::region::Region;
use yawara::material::tissue::{Damping, TissueBody};
use yawara::run::label_lookup::Files;
use yawara::scene;

use crate::parts::tissue_bone;
use crate::support::*;

/// Everywhere.
fn everywhere() -> Region {
    Region::Not(Box::new(Region::Any(Vec::new())))
}

/// A block with a cavity in its middle that nothing reaches.
fn hollow(dims: [usize; 3], wall: usize) -> OrganMap {
    let inside = move |ijk: [usize; 3]| (0..3).all(|axis| (wall..dims[axis] - wall).contains(&ijk[axis]));
    organ_map(dims, move |ijk| if inside(ijk) { NO_ORGAN } else { 0 })
}

/// The faces of a hollow block's cavity.
fn inner(world: &World, dims: [usize; 3], wall: usize) -> Vec<Face> {
    // Centres of voxels lie on the grid of the map.
    let low = Point3::new(-10.0, 5.0, 20.0);
    let corner = |n: [f64; 3]| low + Vector3::from(n) * 3.0;
    let min = corner([wall as f64 - 0.5; 3]);
    let max = corner(dims.map(|n| (n - wall) as f64 - 0.5));
    boundary_faces(world.lattice(), &Region::Box { min, max })
}

/// Change of momentum of each particle in one step of a world at rest, over the step [N].
fn forces(world: &World) -> Vec<Vector3> {
    let mut world = world.clone();
    let before = velocities(&world);
    world.step().unwrap();
    particles(&world)
        .into_iter()
        .map(|p| (world.velocity(p) - before[p as usize]) * f64::from(world.mass()[p as usize]) / world.dt())
        .collect()
}

/// What a pressure does to a world in one step [N].
fn pressed(world: &World, faces: &[Face], pressure: f64) -> Vec<Vector3> {
    let mut with = world.clone();
    let handle = with.press(faces);
    with.set_pressure(handle, pressure);
    forces(&with).iter().zip(&forces(world)).map(|(with, without)| with - without).collect()
}

#[test]
fn every_outer_and_inner_face_is_found_once() {
    let dims = [7, 6, 8];
    let world = world(tissue_lattice(&hollow(dims, 2), &[Some(TISSUE)]));
    let inside = inner(&world, dims, 2);
    assert_eq!(inside.len(), 2 * (3 * 2 + 2 * 4 + 3 * 4));
    let all = boundary_faces(world.lattice(), &everywhere());
    assert_eq!(all.len(), inside.len() + 2 * (7 * 6 + 6 * 8 + 7 * 8));
    assert_eq!(all.len(), boundary_faces(world.lattice(), &Region::Organ(0)).len());
    assert_eq!(boundary_faces(world.lattice(), &Region::Organ(1)), []);
    let nearest = Region::Nearest { point: Point3::new(-100.0, 12.0, 30.0), count: 3 };
    assert_eq!(boundary_faces(world.lattice(), &nearest).len(), 3);
    // At rest and outwards: a pressure from outside pushes every corner towards the block.
    let outside: Vec<Face> = all.into_iter().filter(|face| !inside.contains(face)).collect();
    let centre = rest_places(&world).iter().sum::<Vector3>() / world.lattice().len() as f64;
    let found = pressed(&world, &outside, 100.0);
    let towards = found.iter().zip(rest_places(&world)).filter(|(force, place)| force.dot(&(place - centre)) < 0.0);
    let feel: std::collections::BTreeSet<u32> = outside.iter().flat_map(|face| face.corners).collect();
    assert_eq!(towards.count(), feel.len());
}

#[test]
fn a_closed_surface_has_no_force_and_no_torque() {
    let dims = [9, 8, 7];
    for turn in [0.0, 1.0] {
        let mut world = world(tissue_lattice(&hollow(dims, 2), &[Some(TISSUE)]));
        let faces = inner(&world, dims, 2);
        let turn = Rotation3::from_euler_angles(0.3 * turn, -turn, 2.0 * turn).into_inner();
        let mut random = Random::new(3);
        let rest = rest_places(&world);
        for p in particles(&world) {
            let place = turn * (rest[p as usize] + random.vector() * 0.2 * world.lattice().pitch);
            world.set_displacement(p, place - rest[p as usize]);
        }
        let found = pressed(&world, &faces, 500.0);
        let size: f64 = found.iter().map(Vector3::norm).sum();
        let area = 2.0 * 9e-6 * (5.0 * 4.0 + 4.0 * 3.0 + 5.0 * 3.0);
        assert!(size > 0.7 * 500.0 * area, "{size} N");
        let sum: Vector3 = found.iter().sum();
        let places = places(&world);
        let torque: Vector3 = found.iter().zip(&places).map(|(force, place)| place.cross(force)).sum();
        let arm = places.iter().map(Vector3::norm).fold(0.0, f64::max);
        println!("force {:e}, torque {:e}", sum.norm() / size, torque.norm() / (size * arm));
        // Velocities are f32.
        assert!(sum.norm() < 1e-6 * size && torque.norm() < 1e-6 * size * arm);
    }
}

#[test]
fn where_it_is_does_not_matter_and_how_it_stands_does() {
    let mut world = world(tissue_lattice(&block([4, 3, 2]), &[Some(TISSUE)]));
    let front = Region::HalfSpace { point: Point3::new(0.4, 0.0, 0.0), normal: Vector3::x() };
    let faces = boundary_faces(world.lattice(), &Region::All(vec![front, everywhere()]));
    assert_eq!(faces.len(), 3 * 2, "one side of the block");
    let here = pressed(&world, &faces, 200.0);
    let sum: Vector3 = here.iter().sum();
    assert!((sum - Vector3::new(-200.0 * 6.0 * 9e-6, 0.0, 0.0)).norm() < 1e-6 * sum.norm(), "{sum}");
    let scale = here.iter().map(Vector3::norm).fold(0.0, f64::max);
    let rest = rest_places(&world);
    particles(&world).into_iter().for_each(|p| world.set_displacement(p, Vector3::new(0.3, -0.2, 0.1)));
    let there = pressed(&world, &faces, 200.0);
    let off = here.iter().zip(&there).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    // Places 0.4 m away are known to 3e-8 m, of 3e-3.
    assert!(off < 3e-5 * scale, "{:e}", off / scale);
    let turn = Rotation3::from_euler_angles(0.5, 1.2, -2.0).into_inner();
    particles(&world)
        .into_iter()
        .for_each(|p| world.set_displacement(p, (turn - Matrix3::identity()) * rest[p as usize]));
    let turned = pressed(&world, &faces, 200.0);
    let off = here.iter().zip(&turned).map(|(a, b)| (turn * a - b).norm()).fold(0.0, f64::max);
    assert!(off < 3e-5 * scale, "{:e}", off / scale);
}

/// Steps under a drag until nothing moves.
fn settle(world: &mut World, rate: f64) {
    world.set_drag(rate);
    let end = world.time() + 60.0 / rate;
    while world.time() < end {
        world.step().unwrap();
    }
}

#[test]
fn pressure_all_round_shrinks_a_block_alike() {
    for nu in [0.25, 0.4] {
        let body = TissueBody { poissons_ratio: nu, ..TISSUE };
        let mut world = world(tissue_lattice(&block([6, 5, 4]), &[Some(body)]));
        let faces = boundary_faces(world.lattice(), &everywhere());
        let pressure = 1e-3 * TISSUE.youngs_modulus;
        let handle = world.press(&faces);
        world.set_pressure(handle, pressure);
        settle(&mut world, 2.0 * PI * (TISSUE.youngs_modulus / TISSUE.density).sqrt() / 18e-3);
        let strain = -pressure * (1.0 - 2.0 * nu) / TISSUE.youngs_modulus;
        let rest = rest_places(&world);
        let mut worst = 0.0_f64;
        for p in particles(&world) {
            let expected = (rest[p as usize] - rest[0]) * strain;
            worst = worst.max((world.displacement(p) - world.displacement(0) - expected).norm());
        }
        let share = worst / (strain.abs() * 18e-3);
        println!("nu {nu}: off by {share:e} of what the block shrinks by");
        // Second order of strain.
        assert!(share < 5e-3, "nu {nu}: {share:e}");
    }
}

/// A thick-walled sphere under pressure from inside, against Lame (1852):
/// `u(r) = p a^3 / (E (b^3 - a^3)) ((1 - 2 nu) r + (1 + nu) b^3 / (2 r^2))`.
#[test]
fn a_thick_walled_sphere_widens_as_lame_says() {
    let mut errors = Vec::new();
    for (inner, nu) in [(4, 0.25), (8, 0.25), (8, 0.4)] {
        // Of voxels: twice as wide outside.
        let (a, b) = (inner as f64, 2.0 * inner as f64);
        let n = 4 * inner;
        let middle = 0.5 * (n as f64 - 1.0);
        let radius = move |ijk: [usize; 3]| Vector3::from(ijk.map(|i| i as f64 - middle)).norm();
        let map = organ_map([n; 3], move |ijk| if (a..b).contains(&radius(ijk)) { 0 } else { NO_ORGAN });
        let voxels = map.as_slice().iter().filter(|&&organ| organ == 0).count() as f64;
        assert!((voxels / (4.0 / 3.0 * PI * (b.powi(3) - a.powi(3))) - 1.0).abs() < 0.02, "{voxels}");
        let body = TissueBody { poissons_ratio: nu, ..TISSUE };
        let mut world = world(tissue_lattice(&map, &[Some(body)]));
        let centre = Vector3::repeat(0.5 * (n as f64 + 1.0)) * world.lattice().pitch;
        let place = Point3::new(-10.0, 5.0, 20.0) + Vector3::repeat(middle * 3.0);
        let cavity = Region::Sphere { center: place, radius: 3.0 * (a + 1.0) };
        let faces = boundary_faces(world.lattice(), &cavity);
        let pressure = 2e-3 * TISSUE.youngs_modulus;
        let handle = world.press(&faces);
        world.set_pressure(handle, pressure);
        let h = world.lattice().pitch;
        settle(&mut world, 2.0 * (TISSUE.youngs_modulus / TISSUE.density).sqrt() / (a * h));
        let expected = |r: f64| {
            pressure * a.powi(3) / (TISSUE.youngs_modulus * (b.powi(3) - a.powi(3)))
                * ((1.0 - 2.0 * nu) * r + (1.0 + nu) * (b * h).powi(3) / (2.0 * r * r))
        };
        // Means over shells of the wall, away from its steps.
        let mut shells = Vec::new();
        for shell in 0..4 {
            let (low, high) = (
                a + 1.0 + f64::from(shell) * (b - a - 2.0) / 4.0,
                a + 1.0 + f64::from(shell + 1) * (b - a - 2.0) / 4.0,
            );
            let (mut found, mut wanted) = (0.0, 0.0);
            for (p, rest) in particles(&world).into_iter().zip(rest_places(&world)) {
                let arm = rest - centre;
                if (low..high).contains(&(arm.norm() / h)) {
                    found += world.displacement(p).dot(&arm.normalize());
                    wanted += expected(arm.norm());
                }
            }
            shells.push(found / wanted - 1.0);
        }
        println!("inner radius {inner} cells, nu {nu}: {} faces, off by {shells:.4?}", faces.len());
        errors.push(shells.iter().map(|e| e.abs()).fold(0.0, f64::max));
    }
    // Steps of voxels make the wall a little thinner than the sphere's: an error of the first order of the pitch.
    assert!(errors[0] < 0.08 && errors[1] < 0.045 && errors[2] < 0.05, "{errors:?}");
    let limit = 2.0 * errors[1] - errors[0];
    assert!(limit.abs() < 0.015, "towards no pitch: {limit}");
}

/// Volume under faces that close a surface [m^3].
fn enclosed(world: &World, faces: &[Face]) -> f64 {
    let places = places(world);
    let of_face = |face: &Face| {
        let [a, b, c, d] = face.corners.map(|corner| places[corner as usize]);
        let triple = |a: Vector3, b: Vector3, c: Vector3| a.dot(&b.cross(&c));
        (triple(a, b, c) + triple(a, c, d) + triple(a, b, d) + triple(b, c, d)) / 12.0
    };
    // From inside: the faces look into the cavity.
    -faces.iter().map(of_face).sum::<f64>()
}

/// Without losses, what tissue gains is the pressure times what the cavity gains.
#[test]
fn the_work_is_pressure_times_volume() {
    let dims = [9, 9, 9];
    let mut world = world(tissue_lattice(&hollow(dims, 2), &[Some(TISSUE)]));
    let faces = inner(&world, dims, 2);
    let start = enclosed(&world, &faces);
    assert!((start / (125.0 * 27e-9) - 1.0).abs() < 1e-6, "{start}");
    let pressure = 300.0;
    let handle = world.press(&faces);
    world.set_pressure(handle, pressure);
    let (mut off, mut most) = (0.0_f64, 0.0_f64);
    for _ in 0..400 {
        world.step().unwrap();
        let now = balance(&world);
        let work = pressure * (enclosed(&world, &faces) - start);
        off = off.max((now.kinetic + now.elastic - work).abs());
        most = most.max(work);
    }
    println!("off by {:e} of {most:e} J", off / most);
    assert!(most > 0.02 * pressure * start && off < 0.05 * most, "{off:e} {most:e}");
}

#[test]
fn a_severed_face_lets_go() {
    let mut world = world(tissue_lattice(&block([3, 3, 3]), &[Some(TISSUE)]));
    let top = Region::HalfSpace { point: Point3::new(0.0, 0.0, 27.4), normal: Vector3::z() };
    let faces = boundary_faces(world.lattice(), &top);
    assert_eq!(faces.len(), 9);
    let handle = world.press(&faces);
    world.set_pressure(handle, 100.0);
    let before: Vector3 = forces(&world).iter().sum();
    let particle = |ijk| world.lattice().particle_at[world.lattice().grid.shape.linear(ijk)];
    // The diagonal of one face; of a second one nothing but an inner spring of its cell.
    let diagonal =
        SeveredSpring { particle: particle([1, 1, 4]), direction: direction_of([1, 1, 0]) as u8, at: 0.5, time: 0.0 };
    let inside =
        SeveredSpring { particle: particle([3, 3, 3]), direction: direction_of([0, 0, 1]) as u8, at: 0.5, time: 0.0 };
    assert_eq!(world.sever([diagonal, inside]), 2);
    let after: Vector3 = forces(&world).iter().sum();
    assert!((before.z + 900.0 * 9e-6).abs() < 1e-7 && (after.z + 800.0 * 9e-6).abs() < 1e-7, "{before} {after}");
    world.release(handle);
    assert!(forces(&world).iter().all(|force| force.norm() < 1e-12));
}

#[test]
fn a_rigid_body_is_pushed_with_its_torque() {
    let map = organ_map([3, 4, 2], |_| 1);
    let mut world = World::new(tissue_bone(&map, TISSUE).0, tissue_bone(&map, TISSUE).1, 1e-4);
    let high = Region::HalfSpace { point: Point3::new(0.0, 11.0, 0.0), normal: Vector3::y() };
    let right = Region::HalfSpace { point: Point3::new(-2.6, 0.0, 0.0), normal: Vector3::x() };
    let faces = boundary_faces(world.lattice(), &Region::All(vec![high, right]));
    assert_eq!(faces.len(), 2 * 2, "two of four rows of one side");
    let handle = world.press(&faces);
    world.set_pressure(handle, 1e3);
    world.step().unwrap();
    let [body] = world.rigid_bodies() else { panic!("one body") };
    let impulse = Vector3::new(-1e3 * 4.0 * 9e-6 * 1e-4, 0.0, 0.0);
    assert!((body.momentum() - impulse).norm() < 1e-9 * impulse.norm(), "{}", body.momentum());
    let torque = Vector3::new(0.0, 3e-3, 0.0).cross(&impulse);
    assert!((body.angular_momentum() - torque).norm() < 1e-9 * torque.norm(), "{}", body.angular_momentum());
}

#[test]
fn threads_change_no_bit() {
    let dims = [12, 20, 11];
    let body = TissueBody { damping: Damping::Ratio(0.2), ..TISSUE };
    let start = world(tissue_lattice(&hollow(dims, 2), &[Some(body)]));
    let faces = inner(&start, dims, 2);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut world = start.clone();
            shake(&mut world, 0.1, 0.02, 10);
            let handle = world.press(&faces);
            world.set_pressure(handle, 400.0);
            (0..10).for_each(|_| world.step().unwrap());
            (displacements(&world), velocities(&world))
        })
    };
    let one = run(1);
    assert!(one == run(2) && one == run(4));
}

#[test]
fn a_scene_blows_up_a_side_and_lets_go() {
    let text = "[volume]\nphantom = \"cube\"\nspacing = 6\n[[organ]]\nname = \"cube\"\nlabel = \"cube\"\nmaterial = \"liver\"\n\
                [time]\nduration = 0.1\n[[fix]]\nregion = { half_space = { point = [0, 0, -24], normal = [0, 0, -1] } }\n\
                [[pressure]]\nname = \"hand\"\nregion = { half_space = { point = [0, 0, 29], normal = [0, 0, 1] } }\n\
                pressure = 200\nramp = 0.02\nfrom = 0.01\n[[release]]\nof = \"hand\"\nat = 0.06\n";
    let (scene, warnings) = scene::parse(text, Path::new("s.toml"), Path::new("/"), &Files).unwrap();
    assert!(warnings.is_empty(), "{}", warnings[0]);
    let inputs = yawara::run::inputs::load(&scene).unwrap();
    let mut world = yawara::run::prepare::prepare(&scene, &inputs).unwrap().into_world(&scene);
    let mut timeline = Timeline::new(&scene.operations, world.lattice()).unwrap();
    let mut events = Vec::new();
    let mut lowest = 0.0_f64;
    while world.time() < 0.1 {
        events.extend(timeline.advance(&mut world));
        world.step().unwrap();
        lowest = particles(&world).iter().map(|&p| world.displacement(p).z).fold(lowest, f64::min);
    }
    let hand: Vec<(f64, What)> =
        events.into_iter().filter(|event| event.operation == "hand").map(|event| (event.time, event.what)).collect();
    assert_eq!(hand.len(), 2);
    assert!(matches!(hand[0].1, What::Began(100)) && (hand[0].0 - 0.01).abs() < 2e-3, "{hand:?}");
    assert!(matches!(hand[1].1, What::Ended) && (hand[1].0 - 0.06).abs() < 2e-3, "{hand:?}");
    // 200 Pa on a liver of some kPa, 6 cm high: millimetres.
    assert!(lowest < -5e-4, "{lowest}");
    let missed = text.replace("29], normal = [0, 0, 1]", "59], normal = [0, 0, 1]");
    let scene = scene::parse(&missed, Path::new("s.toml"), Path::new("/"), &Files).unwrap().0;
    let error = Timeline::new(&scene.operations, world.lattice()).unwrap_err().to_string();
    assert!(error.contains("`hand`: its region selects no face"), "{error}");
}
