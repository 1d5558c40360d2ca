//! The fast loops against the plain reference, for every law, damper, body and thread count.

#[path = "../support/mod.rs"]
mod support;

use support::*;
use yawara::dynamics::World;
use yawara::geometry::Vector3;
use yawara::kernel::reference::spring_forces;
use yawara::lattice::SeveredSpring;
use yawara::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS};

/// f32 sums of 26 forces against f64, relative to the largest force: 26 roundings of 6e-8, with room for cancellation.
const TOLERANCE: f64 = 1e-5;

/// Every law with and without dampers, on blocks large enough for the fast body and ragged enough for the general one.
fn worlds() -> Vec<(String, World)> {
    let mut worlds = Vec::new();
    let full = [40, 20, 20];
    for (damper, damping, ratio) in [("undamped", 0.0, 0.0), ("damped", 2e-3, 0.3)] {
        let paper = yawara::material::paper::PaperBody { damping, ..PAPER };
        let stiff = yawara::material::paper::PaperBody { stiffness: 25.0, damping: 0.5 * damping, mass: 5e-5 };
        let tissue =
            yawara::material::tissue::TissueBody { damping: yawara::material::tissue::Damping::Ratio(ratio), ..TISSUE };
        let dense = yawara::material::tissue::TissueBody {
            youngs_modulus: 2e4,
            poissons_ratio: 0.25,
            density: 2000.0,
            damping: yawara::material::tissue::Damping::Ratio(2.0 * ratio),
        };
        let mut add = |name: &str, lattice| worlds.push((format!("{name}, {damper}"), world(lattice)));
        add("paper block", paper_lattice(&block(full), &[Some(paper)]));
        add("paper blob", paper_lattice(&blob([21, 19, 17], 0.7, 1), &[Some(paper), Some(paper)]));
        add("paper, two organs", paper_lattice(&blob([21, 19, 17], 0.7, 2), &[Some(paper), Some(stiff)]));
        add("paper with bone", paper_lattice(&blob([21, 19, 17], 0.7, 3), &[Some(paper), None]));
        add("tissue block", tissue_lattice(&block(full), &[Some(tissue)]));
        add("tissue blob", tissue_lattice(&blob([21, 19, 17], 0.5, 4), &[Some(tissue), Some(tissue)]));
        add("tissue, two organs", tissue_lattice(&blob([21, 19, 17], 0.5, 5), &[Some(tissue), Some(dense)]));
        add("tissue with bone", tissue_lattice(&blob([21, 19, 17], 0.5, 6), &[Some(tissue), None]));
    }
    worlds
}

/// Force on each particle as the fast loop saw it: change of momentum in one step.
fn check_against_reference(name: &str, world: &mut World) {
    let (displacement, velocity) = (displacements(world), velocities(world));
    let expected =
        spring_forces(world.lattice(), world.topology(), world.assembly(), &displacement, &velocity, world.dt());
    world.step().unwrap_or_else(|error| panic!("{name}: {error}"));
    let largest = expected.iter().map(Vector3::norm).fold(0.0, f64::max);
    let mut worst = 0.0_f64;
    for (particle, before) in velocity.iter().enumerate() {
        let mass = f64::from(world.mass()[particle]);
        let change = world.velocity(particle as u32) - before;
        if mass == 0.0 {
            assert_eq!(change, Vector3::zeros(), "{name}: bone moved");
            continue;
        }
        // The velocity itself is rounded to f32: 6e-8 of its size, seen as a force.
        let rounding = 1e-7 * before.norm() * mass / world.dt();
        worst = worst.max((change * mass / world.dt() - expected[particle]).norm() - rounding);
    }
    assert!(worst <= TOLERANCE * largest, "{name}: off by {worst:e} N of {largest:e} N");
}

#[test]
fn every_law_and_body_agrees_with_the_reference() {
    let mut count = 0;
    let mut fast_blocks = 0;
    for (name, mut world) in worlds() {
        shake(&mut world, 0.1, 0.05, 7);
        fast_blocks += usize::from(world.alike_share() > 0.0);
        check_against_reference(&name, &mut world);

        // Sever a third of the springs at random, so that every block takes the general body.
        let mut random = Random::new(8);
        let mut pieces = Vec::new();
        for particle in particles(&world) {
            for direction in FIRST_FORWARD..NEIGHBOURS {
                if world.topology().alive()[particle as usize] >> direction & 1 == 1 && random.unit() < 0.33 {
                    pieces.push(SeveredSpring { particle, direction: direction as u8, at: 0.5, time: 0.0 });
                }
            }
        }
        let severed = pieces.len();
        assert_eq!(world.sever(pieces), severed);
        check_against_reference(&format!("{name}, severed"), &mut world);
        count += 2;
    }
    assert_eq!(count, 32, "worlds compared");
    assert_eq!(fast_blocks, 4, "worlds that used the fast body");
}

#[test]
fn fast_and_general_bodies_give_the_same_bits() {
    for (name, mut fast) in worlds().into_iter().filter(|(name, _)| name.contains("block")) {
        assert!(fast.alike_share() > 0.0, "{name}");
        shake(&mut fast, 0.1, 0.05, 9);
        let mut general = fast.clone();
        general.forget_alike_blocks();
        assert_eq!(general.alike_share(), 0.0);
        for _ in 0..5 {
            fast.step().unwrap();
            general.step().unwrap();
        }
        assert_eq!(displacements(&fast), displacements(&general), "{name}");
        assert_eq!(velocities(&fast), velocities(&general), "{name}");
    }
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    for (name, world) in worlds() {
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut world = world.clone();
                shake(&mut world, 0.1, 0.05, 10);
                for _ in 0..20 {
                    world.step().unwrap();
                }
                (displacements(&world), velocities(&world))
            })
        };
        let one = run(1);
        assert_eq!(one, run(2), "{name}: 2 threads");
        assert_eq!(one, run(4), "{name}: 4 threads");
    }
}
