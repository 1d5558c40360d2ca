//! No particle that is outside gets inside; contact gives no energy.

use yawara::dynamics::effects::contact::{Shape, ToolMesh};
use yawara::dynamics::measure::balance;
use yawara::surface::mesh::TriangleMesh;

use super::*;

/// What rounding of places in f32 may leave inside [mm].
const ROUNDING: f64 = 2e-5;

/// A twisted ring [mm]: hollow, bent, with sharp edges.
fn ring(center: Vector3) -> ToolMesh {
    let (around, sides) = (24_u32, 5_u32);
    let place = |i: u32, j: u32| {
        let [phi, theta] = [f64::from(i) / f64::from(around), f64::from(j) / f64::from(sides)]
            .map(|share| share * std::f64::consts::TAU);
        let out = 9.0 + 4.0 * (theta + phi).cos();
        (center + Vector3::new(out * phi.cos(), out * phi.sin(), 4.0 * (theta + phi).sin())).map(|x| x as f32).into()
    };
    // The twist is one whole turn, so it closes.
    let at = |i: u32, j: u32| (i % around) * sides + j % sides;
    let mut mesh = ToolMesh::default();
    (0..around).for_each(|i| (0..sides).for_each(|j| mesh.positions.push(place(i, j))));
    for i in 0..around {
        for j in 0..sides {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)];
            mesh.triangles.extend([[a, b, d], [a, d, c]]);
        }
    }
    mesh
}

fn random_shape(random: &mut Random, pitch: f64) -> Shape {
    // The block of the tests lies around this place.
    let middle = Vector3::new(-1.0, 14.0, 29.0);
    let at = middle + random.vector() * 20.0;
    let point = Point3::from(at);
    match random.below(5) {
        0 => Shape::sphere(point, 4.0 + 8.0 * random.unit()),
        1 => Shape::capsule(point, point + random.vector() * 20.0, 3.0 + 5.0 * random.unit()),
        2 => {
            let half = Vector3::repeat(4.0) + random.vector().abs() * 8.0;
            Shape::block(point - half, point + half)
        }
        3 => Shape::plane(Point3::from(middle + (at - middle).normalize() * 9.0), middle - at),
        _ => Shape::mesh(&ring(at), pitch).unwrap(),
    }
}

/// Drops and shakes small blocks onto random obstacles; gives how many particles touched one.
fn no_particle_enters(moving: bool, seed: u64) -> usize {
    let mut random = Random::new(seed);
    let mut world = world(tissue_lattice(&blob([6, 6, 6], 0.7, seed), &[Some(DAMPED), Some(TISSUE)]));
    world.set_gravity(random.vector() * 9.81);
    shake(&mut world, 0.05, 0.5, seed);
    let count = if moving { 1 } else { 1 + random.below(3) };
    let (friction, speed) = ([0.0, 0.3][random.below(2)], random.vector() * 0.3);
    let shapes: Vec<Shape> = (0..count).map(|_| random_shape(&mut random, world.lattice().pitch)).collect();
    let handles: Vec<_> = shapes.iter().map(|shape| world.add_obstacle("it", shape.clone(), friction)).collect();
    let offset = |time: f64| if moving { speed * time * 1e3 } else { Vector3::zeros() };
    let deep = |world: &World| -> Vec<bool> {
        let moved = offset(world.time());
        let inside = |place: &Point3| shapes.iter().any(|shape| shape.signed_distance(place - moved) * 1e3 < -ROUNDING);
        places_mm(world).iter().map(inside).collect()
    };
    let mut inside = deep(&world);
    let mut touched = 0;
    for _ in 0..60 {
        let then = world.time() + world.dt();
        handles.iter().for_each(|&handle| world.move_obstacle(handle, offset(then)));
        // Thrown together so that neighbours part too fast: that is another matter.
        if world.step().is_err() {
            break;
        }
        let now = deep(&world);
        for (particle, (before, now)) in inside.iter().zip(&now).enumerate() {
            assert!(*before || !now, "seed {seed}, moving {moving}: particle {particle} went in at {}", world.time());
        }
        touched += usize::from(handles.iter().any(|&handle| world.tool_force(handle).norm() > 0.0));
        inside = now;
    }
    touched
}

#[test]
fn no_particle_ends_inside_what_stands_still() {
    let touched: usize = (0..200).map(|seed| no_particle_enters(false, seed)).sum();
    assert!(touched > 3000, "only {touched} steps with contact");
}

#[test]
fn no_particle_ends_inside_what_moves() {
    let touched: usize = (0..200).map(|seed| no_particle_enters(true, seed)).sum();
    assert!(touched > 3000, "only {touched} steps with contact");
}

#[test]
fn the_ring_is_a_ring() {
    let ToolMesh { positions, triangles } = ring(Vector3::zeros());
    let mesh = TriangleMesh { positions, triangles, ..TriangleMesh::default() };
    assert!(yawara::surface::check::check(&mesh).passes());
}

/// Kinetic and elastic energy and that of gravity [J].
fn energy(world: &World, gravity: Vector3) -> f64 {
    let balance = balance(world);
    let high: f64 = particles(world)
        .into_iter()
        .map(|p| f64::from(world.mass()[p as usize]) * -gravity.dot(&world.to_patient_axes(world.displacement(p))))
        .sum();
    balance.kinetic + balance.elastic + high
}

#[test]
fn contact_without_friction_gives_no_energy() {
    let shapes = [
        Shape::plane(Point3::new(0.0, 0.0, 16.0), Vector3::z()),
        Shape::sphere(Point3::new(0.0, 14.0, 2.0), 14.0),
        Shape::block(Point3::new(-30.0, 10.0, 0.0), Point3::new(2.0, 40.0, 16.0)),
        Shape::capsule(Point3::new(-30.0, 12.0, 9.0), Point3::new(30.0, 14.0, 12.0), 5.0),
        Shape::mesh(&ring(Vector3::new(0.0, 14.0, 10.0)), 3e-3).unwrap(),
    ];
    let gravity = Vector3::new(0.3, 0.0, -9.81);
    for (number, shape) in shapes.into_iter().enumerate() {
        // Undamped, so that nothing but contact takes energy.
        let mut world = world(tissue_lattice(&block([8, 7, 6]), &[Some(TISSUE)]));
        world.set_dt(0.25 * world.dt());
        world.set_gravity(gravity);
        let table = world.add_obstacle("it", shape, 0.0);
        let start = energy(&world, gravity);
        // What it could gain by falling the 3 mm to what lies below, and the swing of energy within a step.
        let scale = total_mass(&world) * 9.81 * 3e-3;
        let (mut highest, mut touched) = (f64::NEG_INFINITY, 0);
        for _ in 0..1500 {
            world.step().unwrap();
            highest = highest.max(energy(&world, gravity) - start);
            touched += usize::from(world.tool_force(table).norm() > 0.0);
        }
        println!("{number}: {:.2e} of the fall at most, {touched} steps with contact", highest / scale);
        assert!(touched > 100 && highest < 1e-4 * scale, "{number}: {highest:e} of {scale:e}, {touched}");
    }
}
