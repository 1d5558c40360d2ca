//! Blocks that sleep: what is spared, and what it costs in accuracy, against the same world stepped in full.

use std::path::Path;

use yawara::dynamics::World;
use yawara::dynamics::effects::sleep::Sleep;
use yawara::dynamics::measure::balance;
use yawara::dynamics::timeline::Timeline;
use yawara::geometry::Vector3;
use yawara::lattice::SeveredSpring;
use yawara::lattice::neighbours::FIRST_FORWARD;
use yawara::material::tissue::{Damping, TissueBody};
use yawara::run::inputs;
use yawara::run::label_lookup::Files;
use yawara::run::prepare::prepare;
use yawara::scene;

use crate::support::*;

const DAMPED: TissueBody = TissueBody { damping: Damping::Ratio(0.1), ..TISSUE };

/// A bar of tissue along x, several blocks long, held at its first layer; the particles of the last.
fn bar(length: usize, body: TissueBody) -> (World, Vec<u32>) {
    let mut world = world(tissue_lattice(&block([length, 7, 7]), &[Some(body)]));
    let x = |&particle: &u32| world.lattice().ijk(particle)[0];
    let all = particles(&world);
    let ends = [all.iter().map(x).min(), all.iter().map(x).max()];
    let [held, last] =
        ends.map(|end| all.iter().copied().filter(|particle| Some(x(particle)) == end).collect::<Vec<_>>());
    assert_eq!(held.len(), 64);
    world.hold(&held);
    // Bending of so long a bar, its slowest motion, dies down as soon as it can.
    world.set_drag(32.0 / length as f64 / world.slowest_wave());
    (world, last)
}

/// Of [`organ_map`].
const PITCH_MM: f64 = 3.0;

fn sleep(pitches: f64, window: f64) -> Option<Sleep> {
    Some(Sleep { tolerance: pitches * 1e-3 * PITCH_MM, window })
}

fn farthest(a: &World, b: &World) -> f64 {
    let apart = displacements(a).into_iter().zip(displacements(b)).map(|(a, b)| (a - b).norm());
    apart.fold(0.0, f64::max) / a.lattice().pitch
}

fn same_bits(a: &World, b: &World) -> bool {
    displacements(a) == displacements(b) && velocities(a) == velocities(b)
}

fn spared(world: &World) -> f64 {
    let (_, counts) = world.sleep().unwrap();
    counts.left_out as f64 / counts.of as f64
}

/// Moves the end of a bar along it by so many pitches in a quarter of the time, and watches it come to rest.
fn pull(world: &mut World, end: &[u32], pitches: f64, time: f64, mut each: impl FnMut(&World)) {
    let handle = world.grab(end);
    let steps = (time / world.dt()) as usize;
    for step in 1..=steps {
        let share = (4.0 * step as f64 / steps as f64).min(1.0);
        world.move_grab(handle, Vector3::new(1.0, 0.1, 0.0) * (share * pitches * PITCH_MM));
        world.step().unwrap();
        each(world);
    }
}

#[test]
fn what_nothing_reaches_sleeps_and_no_bit_changes() {
    for body in [TISSUE, TissueBody { damping: Damping::Ratio(0.0), ..TISSUE }] {
        let (mut full, end) = bar(127, body);
        let mut spare = full.clone();
        // Whatever moves at all is noticed.
        spare.set_sleep(sleep(1e-300, 1e3));
        let time = 150.0 * full.dt();
        pull(&mut full, &end, 2.0, time, |_| ());
        pull(&mut spare, &end, 2.0, time, |_| ());
        assert!(same_bits(&full, &spare));
        assert!(spared(&spare) > 0.3, "{}", spared(&spare));
    }
}

#[test]
#[ignore = "takes as long as all others of this file together"]
fn errors_stay_near_the_tolerance() {
    let (full, end) = bar(63, DAMPED);
    let window = full.slowest_wave();
    let mut states = Vec::new();
    let time = 32.0 * full.slowest_wave();
    let mut reference = full.clone();
    let every = (time / full.dt()) as usize / 40;
    pull(&mut reference, &end, 8.0, time, |world| {
        if world.steps().is_multiple_of(every as u64) {
            states.push(world.clone());
        }
    });
    println!("a bar of 63 cells pulled by 8 pitches, {} steps:", reference.steps());
    for tolerance in [0.1, 0.01, 0.001] {
        let mut world = full.clone();
        world.set_sleep(sleep(tolerance, window));
        let (mut worst, mut state) = (0.0_f64, states.iter());
        pull(&mut world, &end, 8.0, time, |world| {
            if world.steps().is_multiple_of(every as u64) {
                worst = worst.max(farthest(world, state.next().unwrap()));
            }
        });
        println!(
            "tolerance {tolerance} pitches: {:.1} % left out, off by at most {worst:.2e} pitches",
            100.0 * spared(&world)
        );
        assert!(worst < tolerance, "{worst}");
        assert!(spared(&world) > 0.01);
    }
}

#[test]
fn what_comes_to_rest_sleeps_and_wakes_again() {
    let (mut world, end) = bar(47, DAMPED);
    world.set_sleep(sleep(0.01, world.slowest_wave()));
    world.set_gravity(Vector3::new(0.0, 0.0, -0.5));
    let all_asleep = |world: &World| world.sleep().is_some_and(|(_, counts)| counts.asleep == counts.blocks);
    let rest = |world: &mut World| {
        let until = world.time() + 200.0 * world.slowest_wave();
        while world.time() < until && !all_asleep(world) {
            world.step().unwrap();
        }
        assert!(all_asleep(world), "{:?}", world.sleep());
        let (before, energy) = (displacements(world), balance(world));
        world.step().unwrap();
        assert_eq!(displacements(world), before);
        assert_eq!(energy.kinetic, 0.0);
    };
    let mut full = world.clone();
    full.set_sleep(None);
    rest(&mut world);
    while full.time() < world.time() {
        full.step().unwrap();
    }
    let off = farthest(&world, &full);
    println!("at rest after {:.2} s, {off:.1e} pitches from the world stepped in full", world.time());
    assert!(off < 0.01, "{off}");
    let awake = |world: &mut World| {
        world.step().unwrap();
        let (_, counts) = world.sleep().unwrap();
        counts.blocks - counts.asleep
    };
    // Each of these wakes some blocks, and only where it happens.
    let particle = end[0];
    let force = world.push(&[particle]);
    world.set_force(force, Vector3::new(0.0, 1e-4, 0.0));
    let few = awake(&mut world);
    assert!(few > 0 && few < world.sleep().unwrap().1.blocks, "{few}");
    world.release(force);
    rest(&mut world);
    let middle = particles(&world).into_iter().find(|&p| world.lattice().ijk(p) == [20, 4, 4]).unwrap();
    let spring = SeveredSpring { particle: middle, direction: FIRST_FORWARD as u8, at: 0.5, time: 0.0 };
    assert_eq!(world.sever([spring]), 1);
    assert!(awake(&mut world) > 0);
    rest(&mut world);
    world.set_displacement(middle, world.displacement(middle) + Vector3::new(1e-4, 0.0, 0.0));
    assert!(awake(&mut world) > 0);
    rest(&mut world);
    let hold = world.hold(&[middle]);
    rest(&mut world);
    world.release(hold);
    rest(&mut world);
    world.set_gravity(Vector3::new(0.0, 0.0, 0.5));
    assert_eq!(awake(&mut world), world.sleep().unwrap().1.blocks);
    let handle = world.grab(&end);
    world.move_grab(handle, Vector3::new(0.0, 0.1, 0.0));
    assert!(awake(&mut world) > 0);
}

#[test]
fn a_slow_pull_is_followed() {
    // By less than half of the tolerance in a window, for as long as it takes to go twenty times the tolerance.
    let (mut reference, end) = bar(31, DAMPED);
    let window = 0.25 * reference.slowest_wave();
    let mut world = reference.clone();
    world.set_sleep(sleep(0.1, window));
    pull(&mut reference, &end, 2.0, 200.0 * window, |_| ());
    pull(&mut world, &end, 2.0, 200.0 * window, |_| ());
    let off = farthest(&world, &reference);
    println!("off by {off:.1e} pitches, {:.1} % left out", 100.0 * spared(&world));
    assert!(off < 0.1, "{off}");
}

#[test]
fn the_same_blocks_sleep_at_any_thread_count() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let (mut world, end) = bar(63, DAMPED);
            world.set_sleep(sleep(0.05, 0.5 * world.slowest_wave()));
            let time = 20.0 * world.slowest_wave();
            pull(&mut world, &end, 3.0, time, |_| ());
            world
        })
    };
    let one = run(1);
    assert!(spared(&one) > 0.05 && spared(&one) < 0.95, "{}", spared(&one));
    for threads in [2, 3] {
        let other = run(threads);
        assert!(same_bits(&one, &other));
        assert_eq!(one.sleep(), other.sleep());
    }
}

#[test]
fn what_a_tool_touches_wakes_and_is_pressed_as_in_full() {
    let text = |sleep: &str| {
        format!(
            "[volume]\nphantom = \"cube\"\nspacing = 1.5\n[[organ]]\nname = \"cube\"\nlabel = \"cube\"\nyoungs_modulus = 5e3\n\
             density = 1060\ndamping_ratio = 0.3\n[time]\nduration = 0.1\nframes = 1\n[drag]\nrate = 40\n\
             [[plane]]\npoint = [0, 0, -30]\nnormal = [0, 0, 1]\n\
             [[tool]]\nshape = {{ sphere = {{ center = [0, 0, 46], radius = 15 }} }}\npath = [[0, 0, 0], [0, 0, -6]]\nfrom = 0.01\n\
             to = 0.06\nfriction = 0.2\n{sleep}"
        )
    };
    let run = |sleep: &str| {
        let (scene, _) = scene::parse(&text(sleep), Path::new("tool"), Path::new(""), &Files).unwrap();
        let prepared = prepare(&scene, &inputs::load(&scene).unwrap()).unwrap();
        let mut timeline = Timeline::new(&scene.operations, &prepared.lattice).unwrap();
        let mut world = prepared.into_world(&scene);
        let mut asleep = Vec::new();
        while world.time() < 0.1 {
            timeline.advance(&mut world);
            world.step().unwrap();
            asleep.push(world.sleep().map_or(0, |(_, counts)| counts.asleep));
        }
        (world, asleep)
    };
    let (full, _) = run("");
    let (world, asleep) = run("[sleep]\ntolerance = 0.015");
    let (_, counts) = world.sleep().unwrap();
    // Nothing moves before the ball comes; then the middle of the top wakes first.
    assert_eq!(asleep[0], counts.blocks);
    assert!(asleep.iter().any(|&asleep| asleep > 0 && asleep < counts.blocks), "{asleep:?}");
    let deepest = displacements(&full).iter().map(|u| u.norm()).fold(0.0, f64::max);
    let off = farthest(&world, &full);
    println!("pressed by {:.1} mm; off by {off:.1e} pitches, {:.1} % left out", 1e3 * deepest, 100.0 * spared(&world));
    assert!(deepest > 4e-3 && off < 0.01 && spared(&world) > 0.1, "{deepest} {off}");
}

#[test]
fn a_scene_says_when_blocks_sleep() {
    let scene = |top: &str, tables: &str| {
        let text = format!(
            "{top}\n[volume]\nphantom = \"cube\"\n[[organ]]\nname = \"cube\"\nlabel = \"cube\"\nyoungs_modulus = 5e3\ndensity = 1060\n\
             [time]\nduration = 0.1\n{tables}\n"
        );
        scene::parse(&text, Path::new("sleep"), Path::new(""), &Files)
    };
    let sleep_of = |top: &str, tables: &str| scene(top, tables).unwrap().0.sleep;
    assert_eq!(sleep_of("", ""), None);
    assert_eq!(sleep_of("sleep = false", ""), None);
    assert_eq!(sleep_of("sleep = true", "").unwrap().tolerance, None);
    let asked = sleep_of("", "[sleep]\ntolerance = 0.05\nwindow = 0.2").unwrap();
    assert_eq!((asked.tolerance, asked.window), (Some(5e-5), Some(0.2)));
    for (top, tables, part) in [
        ("", "[sleep]\ntolerance = 0", "sleep.tolerance: found 0, expected a finite number above 0 mm"),
        ("", "[sleep]\nwindow = -1", "sleep.window: found -1, expected a finite number above 0 s"),
        ("", "[sleep]\nwidnow = 1", "unknown key `widnow`"),
        ("sleep = true", "integrator = \"verlet\"", "and `sleep` exclude each other"),
    ] {
        let error = scene(top, tables).unwrap_err().to_string();
        assert!(error.contains(part), "{top} {tables}: {error}");
    }
}
