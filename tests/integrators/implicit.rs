//! Implicit methods at steps and from shapes that no other takes.

use super::*;
use yawara::dynamics::StepError;
use yawara::dynamics::measure::balance;
use yawara::dynamics::stable_dt::stable_dt;
use yawara::geometry::Point3;
use yawara::kernel::reference::{fibre_forces, spring_forces, volume_forces};
use yawara::lattice::region::Region;
use yawara::material::{Assembly, FibreTerm};

/// Kinetic and elastic energy, and that of weight [J].
fn energy(world: &World, gravity: Vector3) -> f64 {
    let balance = balance(world);
    let weight: f64 = particles(world)
        .iter()
        .map(|&p| f64::from(world.mass()[p as usize]) * gravity.dot(&world.displacement(p)))
        .sum();
    balance.kinetic + balance.elastic - weight
}

/// What the plain step may take of a world [s].
fn plain_dt(world: &World) -> f64 {
    stable_dt(world.lattice(), world.topology(), world.assembly())
}

/// Everything below a height in pitches above the lowest particle.
fn foot(world: &World, layers: f64) -> Vec<u32> {
    let low = world.lattice().rest_place(0);
    let normal = Vector3::new(0.0, 0.0, -1.0);
    Region::HalfSpace { point: Point3::new(low.x, low.y, low.z + 3.0 * layers), normal }.select(world.lattice())
}

/// Steps and sees to it that all stays finite and no energy comes from anywhere.
fn settles_down(name: &str, world: &mut World, gravity: Vector3, steps: usize) {
    let begun = energy(world, gravity);
    let mut before = begun;
    for step in 0..steps {
        world.step().unwrap_or_else(|error| panic!("{name}, step {step}: {error}"));
        let now = energy(world, gravity);
        assert!(now.is_finite(), "{name}, step {step}");
        // Read from places in f32.
        assert!(
            now <= before + 1e-5 * begun.abs().max(before.abs()),
            "{name}, step {step}: {now:e} J after {before:e} J"
        );
        before = now;
    }
    println!("{name}: from {begun:.2e} J to {before:.2e} J, {:?}", world.effort());
}

#[test]
fn any_step_is_stable() {
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    for factor in [1.0, 10.0, 100.0, 1000.0] {
        for contrast in [1.0, 1e6] {
            let body = TissueBody { poissons_ratio: 0.4, damping: Damping::Ratio(0.1), ..TISSUE };
            let hard = TissueBody { youngs_modulus: contrast * body.youngs_modulus, ..body };
            let map = organ_map([7, 6, 8], |[i, j, k]| u8::from(i < 3 && j < 3 && k > 2));
            let mut world = world(tissue_lattice(&map, &[Some(body), Some(hard)]));
            world.set_gravity(gravity);
            world.hold(&foot(&world, 1.5));
            world.set_integrator(Integrator::new(Method::BackwardEuler));
            world.set_dt(factor * plain_dt(&world));
            settles_down(&format!("{factor} x the plain step, contrast {contrast:e}"), &mut world, gravity, 12);
        }
    }
}

/// A block whose particles were put somewhere else, with a step that is so many times that of the plain step.
fn put(factor: f64, mut to: impl FnMut(Vector3, f64) -> Vector3) -> World {
    let body = TissueBody { poissons_ratio: 0.4, damping: Damping::Ratio(0.1), ..TISSUE };
    let mut world = world(tissue_lattice(&block([6, 5, 4]), &[Some(body)]));
    let (rest, h) = (rest_places(&world), world.lattice().pitch);
    for particle in particles(&world) {
        let place = rest[particle as usize];
        world.set_displacement(particle, to(place, h) - place);
    }
    world.set_integrator(Integrator::new(Method::BackwardEuler));
    world.set_dt(factor * plain_dt(&world));
    world
}

#[test]
fn from_random_places() {
    for factor in [1.0, 100.0] {
        let mut random = Random::new(9);
        let mut world =
            put(factor, |_, h| Vector3::new(9.0 * random.unit(), 8.0 * random.unit(), 7.0 * random.unit()) * h);
        let name = format!("random places at {factor} x the plain step");
        settles_down(&name, &mut world, Vector3::zeros(), 12);
    }
}

/// Pressed flat, but for a hundredth of a pitch that tells up from down.
#[test]
fn from_a_flattened_block() {
    for factor in [1.0, 10.0, 100.0] {
        let mut random = Random::new(9);
        let mut world = put(factor, |place, h| Vector3::new(place.x, place.y, (3.0 + 0.01 * random.unit()) * h));
        let name = format!("flattened at {factor} x the plain step");
        settles_down(&name, &mut world, Vector3::zeros(), 12);
    }
}

/// In a perfect plane springs have no length and forces no direction: it either settles or says that it does not, and the world stays
/// as it was.
#[test]
fn from_a_perfect_plane_it_settles_or_says_so() {
    for factor in [1.0, 100.0] {
        let mut world = put(factor, |place, h| Vector3::new(place.x, place.y, 3.0 * h));
        let before = displacements(&world);
        let result = world.step();
        let now = displacements(&world);
        assert!(now.iter().all(|u| u.norm().is_finite()), "{factor}");
        if let Err(error) = result {
            println!("a perfect plane at {factor} x the plain step: {error}");
            assert!(matches!(error, StepError::Unsettled { .. }), "{error}");
            assert!(error.to_string().contains("smaller time.dt"), "{error}");
            assert_eq!(now, before, "{factor}");
        }
    }
}

/// The largest force that is out of balance on what is free, over the weight of a particle.
fn out_of_balance(world: &World, gravity: Vector3, held: &[u32]) -> f64 {
    let places = world.precise_displacements().unwrap();
    let still = vec![Vector3::zeros(); places.len()];
    let (lattice, topology, assembly): (_, _, &Assembly) = (world.lattice(), world.topology(), world.assembly());
    let springs = spring_forces(lattice, topology, assembly, &places, &still, 1.0);
    let cells = volume_forces(lattice, topology, assembly, &places, &still, 1.0);
    let fibres = fibre_forces(lattice, topology, assembly, &places);
    let of = |p: u32| {
        let p = p as usize;
        let weight = f64::from(world.mass()[p]) * gravity;
        (springs[p] + cells[p] + fibres[p] + weight).norm() / weight.norm()
    };
    particles(world).into_iter().filter(|p| !held.contains(p)).map(of).fold(0.0, f64::max)
}

/// A hanging block with a volume term and fibres, judged by the plain f64 forces.
#[test]
fn a_settled_shape_is_in_balance() {
    let body = TissueBody { poissons_ratio: 0.45, damping: Damping::Ratio(0.1), ..TISSUE };
    let (lattice, mut assembly) = tissue_lattice(&block([5, 4, 9]), &[Some(body)]);
    let root = (0..lattice.len()).map(|p| if p % 3 == 0 { [0.0, 20.0, 90.0] } else { [0.0; 3] }).collect();
    assembly.fibres = Some(FibreTerm { root });
    let mut world = World::new(lattice, assembly, 1.0);
    let gravity = Vector3::new(4.0, 0.0, -9.81);
    world.set_gravity(gravity);
    let held = foot(&world, 1.5);
    world.hold(&held);
    // Tissue under a clamp that moves up and aside, in one step.
    world.set_integrator(Integrator {
        tolerance: 1e-11,
        precision: Precision::Double,
        ..Integrator::new(Method::QuasiStatic)
    });
    world.step().unwrap();
    let first = out_of_balance(&world, gravity, &held);
    let top: Vec<u32> = {
        let high = particles(&world).into_iter().map(|p| world.lattice().ijk(p)[2]).max().unwrap();
        particles(&world).into_iter().filter(|&p| world.lattice().ijk(p)[2] == high).collect()
    };
    let clamp = world.grab(&top);
    world.move_grab(clamp, Vector3::new(6.0, -4.0, 5.0));
    world.step().unwrap();
    let fixed: Vec<u32> = held.iter().chain(&top).copied().collect();
    let second = out_of_balance(&world, gravity, &fixed);
    println!("out of balance: {first:.1e} and {second:.1e} of a particle's weight; {:?}", world.effort());
    assert!(first < 1e-4 && second < 1e-4, "{first:e} {second:e}");
    let moved = world.displacement(top[0]) - Vector3::new(6e-3, -4e-3, 5e-3);
    assert!(moved.norm() < 0.02, "{moved}");
    assert!(world.longest_move() > 1e-3, "what follows moving tissue is told");
}

#[test]
fn what_has_no_settled_shape_is_refused() {
    let mut world = world(tissue_lattice(&block([4, 3, 3]), &[Some(TISSUE)]));
    world.set_gravity(Vector3::new(0.0, 0.0, -9.81));
    world.set_integrator(Integrator::new(Method::QuasiStatic));
    let error = world.step().unwrap_err();
    assert!(matches!(error, StepError::Unsettled { .. }), "{error}");
    let message = error.to_string();
    assert!(message.contains("time.tolerance = 1e-5 mm") && message.contains("fix a region"), "{message}");
}
