//! Operations in their order: who acts on a particle, from when, until when.

use yawara::dynamics::World;
use yawara::dynamics::timeline::{Event, Timeline, What};
use yawara::geometry::{Point3, Vector3};
use yawara::lattice::region::Region;
use yawara::material::tissue::{Damping, TissueBody};
use yawara::scene::resolved::{Action, Operation};

use crate::support::*;

const ENDLESS: f64 = f64::INFINITY;

fn bar() -> World {
    world(tissue_lattice(&block([12, 5, 5]), &[Some(TissueBody { damping: Damping::Ratio(0.3), ..TISSUE })]))
}

/// Particles whose grid index i lies in a range.
fn layers(world: &World, from: usize, to: usize) -> Region {
    let place = |i: f64| world.lattice().grid.affine.apply(Point3::new(i, 0.0, 0.0)).x;
    Region::Box {
        min: Point3::new(place(from as f64) - 0.1, -1e3, -1e3),
        max: Point3::new(place(to as f64) + 0.1, 1e3, 1e3),
    }
}

fn operation(name: &str, from: f64, until: f64, action: Action) -> Operation {
    Operation { name: name.into(), from, until, action }
}

fn fix(region: Region) -> Action {
    Action::Fix { region }
}

fn grab(region: Region, offset: Vector3, arrive: f64) -> Action {
    Action::Grab { region, path: vec![Vector3::zeros(), offset], arrive }
}

/// Runs a number of steps as a run does, then ends the time line; `watch` sees the world after every step.
fn run(world: &mut World, operations: &[Operation], steps: usize, mut watch: impl FnMut(&World)) -> Vec<Event> {
    let mut timeline = Timeline::new(operations, world.lattice()).unwrap();
    let mut events = Vec::new();
    for _ in 0..steps {
        events.extend(timeline.advance(world));
        world.step().unwrap();
        watch(world);
    }
    events.extend(timeline.finish(world));
    events
}

#[test]
fn events_come_in_order_and_at_their_times() {
    let mut world = bar();
    let dt = world.dt();
    let far = Point3::new(1e3, 1e3, 1e3);
    let operations = [
        operation("at once", 0.0, ENDLESS, fix(layers(&world, 1, 2))),
        operation(
            "pushed",
            10.0 * dt,
            30.0 * dt,
            Action::Force { region: layers(&world, 12, 13), force: Vector3::new(0.0, 1e-3, 0.0), ramp: 5.0 * dt },
        ),
        operation(
            "missed",
            12.0 * dt,
            20.0 * dt,
            Action::Cut { blade: vec![far, far + Vector3::x()], path: vec![Vector3::zeros(), Vector3::y()] },
        ),
        operation("short", 14.2 * dt, 14.4 * dt, fix(layers(&world, 5, 5))),
        operation("beyond the end", 35.0 * dt, 1e3, fix(layers(&world, 6, 6))),
        operation("too late", 50.0 * dt, ENDLESS, fix(layers(&world, 6, 6))),
    ];
    let events = run(&mut world, &operations, 40, |_| {});
    let told: Vec<(u64, &str, What)> =
        events.iter().map(|e| ((e.time / dt).round() as u64, e.operation.as_str(), e.what)).collect();
    // Layers of the lattice hold 6 x 6 particles: the corners of 5 x 5 voxels.
    assert_eq!(
        told,
        [
            (0, "at once", What::Began(72)),
            (10, "pushed", What::Began(72)),
            (12, "missed", What::Began(0)),
            (15, "short", What::Began(36)),
            (15, "short", What::Ended),
            (20, "missed", What::Severed(0)),
            (30, "pushed", What::Ended),
            (35, "beyond the end", What::Began(36)),
            (40, "at once", What::Ended),
            (40, "beyond the end", What::Ended),
            (40, "too late", What::NeverBegan),
        ]
    );
}

#[test]
fn a_ramp_grows_from_nothing_to_the_whole_force() {
    let mut world = bar();
    let (dt, force) = (world.dt(), Vector3::new(2e-3, -1e-3, 3e-3));
    let everything = layers(&world, 0, 99);
    let mass: f64 = world.mass().iter().map(|&m| f64::from(m)).sum();
    let push = Action::Force { region: everything, force, ramp: 20.0 * dt };
    let mut momentum = vec![Vector3::zeros()];
    run(&mut world, &[operation("push", 5.0 * dt, 45.0 * dt, push)], 60, |world| {
        momentum
            .push(particles(world).into_iter().map(|p| world.velocity(p) * f64::from(world.mass()[p as usize])).sum());
    });
    for (step, pair) in momentum.windows(2).enumerate() {
        let share = if (5..45).contains(&step) { ((step as f64 - 5.0) / 20.0).min(1.0) } else { 0.0 };
        let expected = force * dt * share;
        assert!((pair[1] - pair[0] - expected).norm() < 1e-4 * force.norm() * dt, "step {step}, total mass {mass} kg");
    }
}

/// Held and grabbed at once: the hold wins; when it ends the grab has its way again, without a gap in either's end.
#[test]
fn holds_win_over_grabs_and_each_ends_for_itself() {
    let mut world = bar();
    let dt = world.dt();
    let offset = Vector3::new(0.0, 0.3, 0.0);
    let operations = [
        operation("first hold", 0.0, 40.0 * dt, fix(layers(&world, 0, 3))),
        operation("second hold", 0.0, 80.0 * dt, fix(layers(&world, 2, 5))),
        operation("grab", 20.0 * dt, 120.0 * dt, grab(layers(&world, 3, 6), offset, 60.0 * dt)),
    ];
    let number = |world: &World, i: usize| world.lattice().particle_at[world.lattice().grid.shape.linear([i, 3, 3])];
    let probes = [1, 2, 3, 5, 6].map(|i| number(&world, i));
    let mut places = vec![[Vector3::zeros(); 5]];
    run(&mut world, &operations, 160, |world| places.push(probes.map(|p| world.displacement(p) * 1e3)));
    let still = |probe: usize, steps: std::ops::RangeInclusive<usize>| {
        steps.clone().all(|n| places[n][probe] == places[*steps.start()][probe])
    };
    let at_goal = |n: usize, probe: usize| (places[n][probe] - offset).norm() < 1e-5;
    assert!(still(0, 0..=40) && !still(0, 40..=100), "let go with the first hold");
    assert!(still(1, 0..=80) && !still(1, 80..=120), "the second hold still holds what the first let go");
    assert!(still(2, 0..=80) && at_goal(81, 2) && still(2, 81..=120), "grabbed while held, follows when let go");
    assert!(still(3, 0..=80) && at_goal(81, 3) && at_goal(120, 3));
    assert!(still(4, 0..=20) && at_goal(60, 4) && at_goal(120, 4) && !at_goal(150, 4), "grabbed only");
    for (n, place) in places.iter().enumerate().take(61).skip(20) {
        let share = (n as f64 - 20.0) / 40.0;
        assert!((place[4] - offset * share).norm() < 1e-5, "step {n} of the grab");
    }
}

#[test]
fn a_force_on_what_is_held_moves_nothing() {
    let mut world = bar();
    let held = layers(&world, 0, 6);
    let operations = [
        operation("hold", 0.0, ENDLESS, fix(held)),
        operation(
            "push",
            0.0,
            ENDLESS,
            Action::Force { region: layers(&world, 1, 5), force: Vector3::new(0.0, 0.0, 1e3), ramp: 0.0 },
        ),
    ];
    run(&mut world, &operations, 100, |_| {});
    assert!(displacements(&world).iter().all(|u| *u == Vector3::zeros()));
}

#[test]
fn a_region_without_particles_is_refused_by_name() {
    let world = bar();
    let nowhere = Region::Sphere { center: Point3::new(1e3, 0.0, 0.0), radius: 1.0 };
    let error = Timeline::new(&[operation("lost", 0.0, ENDLESS, fix(nowhere))], world.lattice()).unwrap_err();
    let text = error.to_string();
    assert!(text.contains("`lost`") && text.contains("(-11.5, 3.5, 18.5)"), "{text}");
}

/// Cut, pulled and pushed at the same time: the same bits at any number of threads and with or without the fast body.
#[test]
fn a_scripted_run_gives_the_same_bits_at_any_number_of_threads() {
    let damped = TissueBody { damping: Damping::Ratio(0.2), ..TISSUE };
    let start = world(tissue_lattice(&blob([40, 18, 17], 0.97, 7), &[Some(damped), Some(damped)]));
    let dt = start.dt();
    let middle = start.lattice().grid.affine.apply(Point3::new(20.3, 9.0, 18.0));
    let operations = [
        operation("fix", 0.0, ENDLESS, fix(layers(&start, 0, 2))),
        operation(
            "push",
            5.0 * dt,
            50.0 * dt,
            Action::Force { region: layers(&start, 15, 25), force: Vector3::new(0.0, 0.02, 0.02), ramp: 10.0 * dt },
        ),
        operation(
            "cut",
            10.0 * dt,
            60.0 * dt,
            Action::Cut {
                blade: vec![
                    middle - Vector3::y() * 40.0,
                    middle + Vector3::new(2.0, 0.0, 3.0),
                    middle + Vector3::y() * 40.0,
                ],
                path: vec![Vector3::z() * 5.0, Vector3::z() * -20.0, Vector3::new(3.0, 0.0, -40.0)],
            },
        ),
        operation("pull", 0.0, 70.0 * dt, grab(layers(&start, 38, 40), Vector3::new(2.0, 0.0, 1.0), 50.0 * dt)),
    ];
    let go = |threads: usize, general: bool| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut world = start.clone();
            if general {
                world.forget_alike_blocks();
            }
            let events = run(&mut world, &operations, 80, |_| {});
            let hash = world.displacements_mm().iter().flatten().fold(0xcbf2_9ce4_8422_2325_u64, |hash, x| {
                x.to_bits().to_le_bytes().iter().fold(hash, |h, &b| (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3))
            });
            (hash, events, world.topology().severed().to_vec())
        })
    };
    let one = go(1, false);
    assert!(one.2.len() > 1000, "{} springs severed", one.2.len());
    assert!(one.2.windows(2).any(|pair| pair[1].time > pair[0].time), "the cut takes its time");
    for (threads, general) in [(2, false), (4, false), (1, true)] {
        assert!(one == go(threads, general), "{threads} threads, general body: {general}");
    }
}
