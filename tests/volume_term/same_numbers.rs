//! One law, many ways to compute it.

use super::*;
use yawara::lattice::SeveredSpring;
use yawara::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS};

/// f32 sums over 26 springs and 8 cells of nine numbers each, relative to the largest force.
const TOLERANCE: f64 = 2e-5;

/// Blocks large enough for the fast body and blobs ragged enough for the general one, with and without viscosity.
fn worlds() -> Vec<(String, World)> {
    let mut worlds = Vec::new();
    let full = block([40, 20, 20]);
    let ragged = |seed| blob([21, 19, 17], 0.6, seed);
    let hard = TissueBody { youngs_modulus: 2e4, density: 2000.0, ..damped(0.4) };
    for (factor, sign) in [(STIFF, "positive"), (NEGATIVE, "negative")] {
        let mut add = |name: &str, lattice| worlds.push((format!("{name}, {sign}"), steady(lattice)));
        add("block", with_volume(&full, &[Some(TISSUE)], factor, None));
        add("block, damped springs", with_volume(&full, &[Some(damped(0.3))], factor, None));
        add("block, viscous", with_volume(&full, &[Some(damped(0.3))], factor, Some(1.0)));
        add("blob", with_volume(&ragged(1), &[Some(TISSUE); 2], factor, None));
        add("two organs, viscous", with_volume(&ragged(2), &[Some(damped(0.3)), Some(hard)], factor, Some(1.0)));
        add("bone, viscous", with_volume(&ragged(3), &[Some(damped(0.3)), None], factor, Some(1.0)));
    }
    // Signs side by side, and cells without a term between the others.
    let (lattice, mut assembly) = with_volume(&full, &[Some(damped(0.3))], STIFF, Some(1.0));
    let mut random = Random::new(4);
    for modulus in &mut assembly.volume.as_mut().unwrap().modulus {
        *modulus *= [1.0, -0.02, 0.0][(3.0 * random.unit()) as usize];
    }
    worlds.push(("mixed".to_owned(), steady((lattice, assembly))));
    worlds
}

/// Force on each particle as the fast loop saw it: change of momentum in one step.
fn check_against_reference(name: &str, world: &mut World) {
    let before = velocities(world);
    let (springs, volume) = reference_forces(world);
    assert!(largest(&volume) > 0.02 * largest(&springs), "{name}: the volume term matters");
    world.step().unwrap_or_else(|error| panic!("{name}: {error}"));
    let expected: Vec<Vector3> = springs.iter().zip(&volume).map(|(a, b)| a + b).collect();
    let mut worst = 0.0_f64;
    for (particle, before) in before.iter().enumerate() {
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
    assert!(worst <= TOLERANCE * largest(&expected), "{name}: off by {worst:e} N of {:e} N", largest(&expected));
}

/// About `share` of the living springs.
fn some_springs(world: &World, share: f64, seed: u64) -> Vec<SeveredSpring> {
    let mut random = Random::new(seed);
    let mut springs = Vec::new();
    for particle in particles(world) {
        for direction in FIRST_FORWARD..NEIGHBOURS {
            if world.topology().alive()[particle as usize] >> direction & 1 == 1 && random.unit() < share {
                springs.push(SeveredSpring { particle, direction: direction as u8, at: 0.5, time: 0.0 });
            }
        }
    }
    springs
}

#[test]
fn the_fast_body_agrees_with_the_reference() {
    let mut count = 0;
    for (name, mut world) in worlds() {
        // Up to a fifth of a pitch: changes of volume of tens of per cent, some cells near inversion.
        shake(&mut world, 0.2, 0.05, 7);
        check_against_reference(&name, &mut world);
        // 28 springs each: about a quarter of the cells stay whole.
        let severed = some_springs(&world, 0.05, 8);
        assert_eq!(world.sever(severed.clone()), severed.len());
        check_against_reference(&format!("{name}, severed"), &mut world);
        count += 2;
    }
    assert_eq!(count, 26, "worlds compared");
}

/// Springs of every direction, inside a block and across blocks: the dropped cells are exactly those around the spring.
#[test]
fn one_severed_spring_drops_the_cells_that_share_it() {
    let (lattice, assembly) = with_volume(&block([34, 18, 18]), &[Some(damped(0.3))], STIFF, Some(1.0));
    let whole = |world: &World| -> Vec<u32> {
        particles(world).into_iter().filter(|&p| world.topology().whole_cell(world.lattice(), p).is_some()).collect()
    };
    let fresh = steady((lattice, assembly));
    let all = whole(&fresh).len();
    assert_eq!(all, 34 * 18 * 18);
    for direction in FIRST_FORWARD..NEIGHBOURS {
        for ijk in [[5, 4, 4], [16, 8, 8], [15, 7, 7]] {
            let mut world = fresh.clone();
            let particle = world.lattice().particle_at[world.lattice().grid.shape.linear(ijk)];
            let spring = SeveredSpring { particle, direction: direction as u8, at: 0.5, time: 0.0 };
            assert_eq!(world.sever([spring]), 1);
            let expected = [4, 2, 1][yawara::lattice::neighbours::family(direction) - 1];
            assert_eq!(all - whole(&world).len(), expected);
            assert_eq!(world.lattice().cells_of_spring(particle, direction).count(), expected);
            shake(&mut world, 0.1, 0.05, direction as u64);
            check_against_reference(&format!("direction {direction} from {ijk:?}"), &mut world);
            assert_eq!(world.sever([spring]), 0, "cutting twice changes nothing");
        }
    }
}

#[test]
fn fast_and_general_bodies_give_the_same_bits() {
    for (name, mut fast) in worlds().into_iter().filter(|(name, _)| name.contains("block")) {
        assert!(fast.alike_share() > 0.0, "{name}");
        shake(&mut fast, 0.1, 0.05, 9);
        let mut general = fast.clone();
        general.forget_alike_blocks();
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
                for step in 0..10 {
                    if step == 5 {
                        world.sever(some_springs(&world, 0.02, 11));
                    }
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

#[test]
fn an_absent_term_is_absent() {
    let (lattice, assembly) = with_volume(&block([20, 10, 10]), &[Some(damped(0.3))], STIFF, Some(1.0));
    let slots = 2 * 2 * 2 * 1024; // 22 x 12 x 12 grid points in blocks of 16 x 8 x 8.
    let particles = lattice.len();
    let with = steady((lattice.clone(), assembly.clone()));
    let without = steady((lattice.clone(), Assembly { volume: None, ..assembly.clone() }));
    let more = (with.bytes_per_particle() - without.bytes_per_particle()) * particles as f64;
    // As assembled, both; to be stepped, the modulus: the viscosity is in proportion.
    let expected = 8.0 * particles as f64 + 4.0 * slots as f64;
    assert!((more - expected).abs() < 1.0, "{more} bytes for modulus and viscosity, not {expected}");

    // Cells of modulus 0 leave every bit as it is, whatever their viscosity.
    let zero = VolumeTerm { modulus: vec![0.0; particles], viscosity: assembly.volume.clone().unwrap().viscosity };
    let mut zero = World::new(lattice, Assembly { volume: Some(zero), ..assembly }, without.dt());
    let mut without = without;
    for world in [&mut zero, &mut without] {
        shake(world, 0.1, 0.05, 12);
        for _ in 0..5 {
            world.step().unwrap();
        }
    }
    assert_eq!(displacements(&zero), displacements(&without));
}

#[test]
#[should_panic(expected = "needs damped springs")]
fn viscosity_without_damped_springs_is_refused() {
    let (lattice, mut assembly) = with_volume(&block([3, 3, 3]), &[Some(TISSUE)], STIFF, None);
    assembly.volume.as_mut().unwrap().viscosity = Some(vec![1.0; lattice.len()]);
    let _ = World::new(lattice, assembly, 1e-5);
}
