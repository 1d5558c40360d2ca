//! Tissue between bone that stays and bone that is grabbed.

use yawara::dynamics::timeline::{Timeline, TimelineError};
use yawara::lattice::build::NO_ORGAN;
use yawara::lattice::region::Region;
use yawara::scene::resolved::{Action, Operation};

use super::*;

/// Thickness of the block and of what is left for it when the plates are closed [mm].
const BLOCK: f64 = 12.0;
const CLOSED: f64 = 10.0;
/// Inner faces of the plates of bone, z [mm].
const LOWER: f64 = 27.5;
const UPPER: f64 = 51.5;

/// A soft block that touches neither of two plates of bone, one below and one above it.
fn between_plates() -> World {
    let map = organ_map([15, 15, 12], |[i, j, k]| match k {
        2 => 1,
        11 => 2,
        5..=8 if (3..12).contains(&i) && (3..12).contains(&j) => 0,
        _ => NO_ORGAN,
    });
    world(tissue_lattice(&map, &[Some(DAMPED), None, None]))
}

fn operation(name: &str, [from, until]: [f64; 2], action: Action) -> Operation {
    Operation { name: name.to_owned(), from, until, action }
}

fn bone() -> Operation {
    operation("bone", [0.0, f64::INFINITY], Action::Bone { organs: vec![1, 2], friction: 0.0 })
}

/// Moves the upper plate by so much along z [mm].
fn shift(name: &str, [from, until]: [f64; 2], way: f64) -> Operation {
    let path = vec![Vector3::zeros(), Vector3::z() * way];
    let arrive = from + 0.8 * (until - from);
    operation(name, [from, until], Action::Grab { region: Region::Organ(2), path, arrive })
}

/// Steps a world under operations until a time [s].
fn run_until(world: &mut World, timeline: &mut Timeline, until: f64) {
    while world.time() < until {
        timeline.advance(world);
        world.step().unwrap();
    }
}

/// Force of the tissue on the plate that stays and on the one that is moved, along z [N].
fn forces(world: &World) -> [f64; 2] {
    let felt: Vec<f64> = world.obstacles().map(|facts| facts.force.z).collect();
    felt.try_into().expect("two pieces of bone")
}

/// Lowest and highest soft particle, z [mm].
fn span(world: &World) -> [f64; 2] {
    let soft = particles(world).into_iter().filter(|&p| world.mass()[p as usize] > 0.0);
    let places = places_mm(world);
    let heights = soft.map(|p| places[p as usize].z);
    heights.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], z| [low.min(z), high.max(z)])
}

#[test]
fn a_block_is_pressed_between_bones() {
    let mut world = between_plates();
    let way = CLOSED - (UPPER - LOWER);
    let operations = [bone(), shift("press", [0.0, 0.5], way), shift("lift", [0.9, 1.2], 6.0)];
    let mut timeline = Timeline::new(&operations, world.lattice()).unwrap();
    // Pressed while it is grabbed, and where it was let go.
    for until in [0.49, 0.88] {
        run_until(&mut world, &mut timeline, until);
        let ([lower, upper], [low, high]) = (forces(&world), span(&world));
        println!("{until} s: {lower:.4} and {upper:.4} N on the plates, tissue from {low:.4} to {high:.4} mm");
        assert!((low - LOWER).abs() < 1e-3 && (high - LOWER - CLOSED).abs() < 1e-3, "{low} {high}");
        assert!(lower < 0.0 && (lower + upper).abs() < 0.02 * upper, "{lower} {upper}");
        // Nothing hinders it from growing wide.
        let area = (9.0 * 3e-3_f64).powi(2);
        let plain = TISSUE.youngs_modulus * (1.0 - CLOSED / BLOCK) * area;
        assert!((0.9..1.4).contains(&(upper / plain)), "{upper} N of {plain} N");
    }
    run_until(&mut world, &mut timeline, 1.4);
    let ([lower, upper], [low, high]) = (forces(&world), span(&world));
    assert_eq!(upper, 0.0);
    assert!(lower.abs() < 1e-3 && (high - low - BLOCK).abs() < 0.05, "{lower} {low} {high}");
    assert!(Region::Organ(1).select(world.lattice()).iter().all(|&p| world.displacement(p).norm() == 0.0));
}

#[test]
fn bone_that_is_held_stays_though_it_is_grabbed() {
    let mut world = between_plates();
    let hold = operation("hold", [0.0, f64::INFINITY], Action::Fix { region: Region::Organ(2) });
    let operations = [shift("press", [0.0, 0.2], -20.0), bone(), hold];
    let mut timeline = Timeline::new(&operations, world.lattice()).unwrap();
    run_until(&mut world, &mut timeline, 0.2);
    assert_eq!(forces(&world), [0.0; 2]);
    let still = displacements(&world).iter().map(Vector3::norm).fold(0.0, f64::max);
    assert!(still < 1e-12, "{still}");
}

#[test]
fn bone_that_moves_is_held_as_a_whole() {
    let world = between_plates();
    let everywhere = Point3::new(1e3, 1e3, 1e3);
    let part = Region::Box { min: Point3::new(10.0, -1e3, -1e3), max: everywhere };
    let hold = operation("hold", [0.0, f64::INFINITY], Action::Fix { region: part });
    let of = |operations: &[Operation]| Timeline::new(operations, world.lattice());
    assert!(of(&[bone(), hold.clone()]).is_ok());
    let refused = of(&[bone(), hold, shift("press", [0.0, 0.2], -1.0)]).unwrap_err();
    let TimelineError::BoneInPart { operation, organ: 2, found, particles } = &refused else { panic!("{refused}") };
    assert!(operation == "hold" && 0 < *found && found < particles, "{refused}");
}
