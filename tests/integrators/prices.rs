//! What the integrators cost, and where which pays. Measurements, run by name:
//!
//! ```text
//! RAYON_NUM_THREADS=1 cargo test --test integrators price -- --ignored --nocapture --test-threads 1
//! ```

use std::time::Instant;

use super::*;
use yawara::dynamics::integrator::{Mechanics, PreciseLattice};
use yawara::dynamics::stable_dt::{Limits, SAFETY};

/// Milliseconds that something takes, the least of five.
fn milliseconds(mut work: impl FnMut()) -> f64 {
    let once = |work: &mut dyn FnMut()| {
        let started = Instant::now();
        work();
        started.elapsed().as_secs_f64() * 1e3
    };
    work();
    (0..5).map(|_| once(&mut work)).fold(f64::INFINITY, f64::min)
}

#[test]
#[ignore = "a measurement"]
fn price_of_an_evaluation_in_f64() {
    for (name, damping, nu) in [("springs", 0.0, 0.25), ("and dampers", 0.2, 0.25), ("and volume", 0.2, 0.4)] {
        let body = TissueBody { poissons_ratio: nu, damping: Damping::Ratio(damping), ..TISSUE };
        let mut world = world(tissue_lattice(&block([36, 36, 36]), &[Some(body)]));
        shake(&mut world, 0.02, 0.01, 3);
        let mut lattice = PreciseLattice::of(&world);
        let slots = lattice.mass().len();
        let zeros = || [0, 1, 2].map(|_| vec![0.0; slots]);
        let (u, v, mut a) = (zeros(), zeros(), zeros());
        let one = milliseconds(|| lattice.accelerations(0.0, &u, &v, &mut a));
        let plain = milliseconds(|| world.step().unwrap());
        println!("{} particles, {name}: {one:.2} ms in f64; a plain step in f32 {plain:.2} ms", world.lattice().len());
    }
}

#[test]
#[ignore = "a measurement"]
fn price_of_a_step() {
    let body = TissueBody { poissons_ratio: 0.4, damping: Damping::Ratio(0.2), ..TISSUE };
    for method in MOVING {
        let mut world = world(tissue_lattice(&block([60, 60, 60]), &[Some(body)]));
        world.set_dt(0.5 * world.dt());
        shake(&mut world, 0.01, 0.01, 3);
        world.set_integrator(Integrator { tolerance: 1e-7, ..Integrator::new(method) });
        let one = milliseconds(|| world.step().unwrap());
        println!("{} particles, {}: {one:.2} ms a step", world.lattice().len(), method.name());
    }
}

/// A block on its foot, pushed slowly from above, with a hard kernel of some contrast.
fn kernel(contrast: f64, cells: usize) -> (World, Handle) {
    let body = TissueBody { poissons_ratio: 0.3, damping: Damping::Ratio(0.3), ..TISSUE };
    let hard = TissueBody { youngs_modulus: contrast * body.youngs_modulus, ..body };
    let middle = cells / 2;
    let map = organ_map([cells, cells, cells], |ijk| u8::from(ijk.iter().all(|&i| i.abs_diff(middle) < 2)));
    let (lattice, assembly) = tissue_lattice(&map, &[Some(body), Some(hard)]);
    let mut world = World::new(lattice, assembly, 1.0);
    let height = |p: u32| world.lattice().ijk(p)[2];
    let (low, high) =
        (particles(&world).into_iter().map(height).min(), particles(&world).into_iter().map(height).max());
    let at = |z: Option<usize>| particles(&world).into_iter().filter(|&p| Some(height(p)) == z).collect::<Vec<_>>();
    let (foot, head) = (at(low), at(high));
    world.hold(&foot);
    world.set_drag(20.0);
    let grab = world.grab(&head);
    (world, grab)
}

/// The head goes aside by 4 mm and down by 2 in 0.2 s, and a quarter of it back in 0.1: little enough for one shape to be settled.
fn lead(world: &mut World, grab: Handle, time: f64) {
    let share = if time < 0.2 { time / 0.2 } else { 1.0 - 2.5 * (time - 0.2) };
    world.move_grab(grab, Vector3::new(4.0, 0.0, -2.0) * share);
}

const SLOW: f64 = 0.3;

#[test]
#[ignore = "a measurement"]
fn price_of_the_same_error_where_stiff_and_soft_meet() {
    for contrast in [1.0, 1e4, 1e6] {
        let drive = |integrator: Integrator, steps: u64| {
            let (mut world, grab) = kernel(contrast, 7);
            world.set_integrator(integrator);
            let dt = SLOW / steps as f64;
            world.set_dt(dt);
            let started = Instant::now();
            for step in 1..=steps {
                lead(&mut world, grab, step as f64 * dt);
                world.step().unwrap();
            }
            (displacements(&world), started.elapsed().as_secs_f64(), world.effort())
        };
        let (world, _) = kernel(contrast, 7);
        let limits = Limits::at_rest(world.lattice(), world.topology(), world.assembly());
        let sharp = limits.sharpen(world.lattice(), world.topology(), world.assembly(), 1e5).sharp;
        let least = (SLOW / (SAFETY * sharp)).ceil() as u64;
        let (plain, seconds, _) = drive(Integrator::new(Method::SymplecticEuler), least);
        // The plain step's own error is 0.1 % and less: where twice as many steps take minutes, it is the reference.
        let reference: Vec<Vector3> = if least < 100_000 {
            let (finer, ..) = drive(Integrator::new(Method::SymplecticEuler), 2 * least);
            finer.iter().zip(&plain).map(|(finer, plain)| 2.0 * finer - plain).collect()
        } else {
            plain.clone()
        };
        let size = reference.iter().map(Vector3::norm).fold(0.0, f64::max);
        let error = |found: &[Vector3]| {
            1e2 * found.iter().zip(&reference).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max) / size
        };
        println!("contrast {contrast:e}: plain step, {least} steps: {seconds:.2} s, error {:.3} %", error(&plain));
        for steps in [15, 60, 240] {
            let (found, seconds, effort) = drive(Integrator::new(Method::BackwardEuler), steps);
            println!("    backward Euler, {steps} steps: {seconds:.2} s, error {:.3} %, {effort:?}", error(&found));
        }
        let (found, seconds, _) = drive(Integrator::new(Method::QuasiStatic), 30);
        println!("    quasi-static, 30 steps: {seconds:.2} s, error {:.3} %", error(&found));
    }
}

/// A beam under its weight, settled: Newton's iteration against the plain step with the drag that settles soonest.
#[test]
#[ignore = "a measurement"]
fn price_of_a_settled_shape() {
    for cells in [[12, 6, 6], [40, 10, 10]] {
        let body = TissueBody { youngs_modulus: 4e4, poissons_ratio: 0.4, damping: Damping::Ratio(0.1), ..TISSUE };
        let make = || {
            let mut world = world(tissue_lattice(&block(cells), &[Some(body)]));
            world.set_gravity(Vector3::new(0.0, 0.0, -2.0));
            let low = particles(&world).into_iter().map(|p| world.lattice().ijk(p)[0]).min().unwrap();
            let foot: Vec<u32> = particles(&world).into_iter().filter(|&p| world.lattice().ijk(p)[0] == low).collect();
            world.hold(&foot);
            world
        };
        let mut settled = make();
        settled.set_integrator(Integrator::new(Method::QuasiStatic));
        let started = Instant::now();
        settled.step().unwrap();
        let newton = started.elapsed().as_secs_f64();
        let goal = displacements(&settled);
        let size = goal.iter().map(Vector3::norm).fold(0.0, f64::max);
        // The slowest swing, from the sag: w^2 is about g / sag, up to a factor near 1.5 for a beam.
        let slowest = (1.5 * 2.0 / size).sqrt();
        let mut relaxed = make();
        relaxed.set_drag(2.0 * slowest);
        let started = Instant::now();
        let mut apart = 1.0;
        while apart > 1e-3 && relaxed.steps() < 400_000 {
            for _ in 0..200 {
                relaxed.step().unwrap();
            }
            let found = displacements(&relaxed);
            apart = found.iter().zip(&goal).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max) / size;
        }
        let relaxation = started.elapsed().as_secs_f64();
        println!(
            "{} particles, sag {:.1} mm: Newton {newton:.3} s ({:?}); dynamic relaxation to {apart:.1e} {relaxation:.3} s \
             ({} steps)",
            goal.len(),
            size * 1e3,
            settled.effort(),
            relaxed.steps()
        );
    }
}
