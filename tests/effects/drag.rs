//! Drag against closed forms.

use std::path::Path;

use yawara::dynamics::World;
use yawara::dynamics::measure::balance;
use yawara::dynamics::reference_world::ReferenceWorld;
use yawara::dynamics::stable_dt::stable_dt;
use yawara::geometry::Vector3;
use yawara::lattice::Topology;
use yawara::material::paper::PaperBody;
use yawara::material::tissue::{Damping, TissueBody};
use yawara::run::label_lookup::Files;
use yawara::scene;

use crate::parts::{bone, tissue_bone};
use crate::support::*;

fn soft() -> World {
    world(tissue_lattice(&block([5, 4, 3]), &[Some(TISSUE)]))
}

#[test]
fn what_is_free_decays_exactly() {
    for rate in [0.5, 40.0] {
        let mut world = soft();
        let start = Vector3::new(0.3, -0.2, 0.1);
        particles(&world).into_iter().for_each(|particle| world.set_velocity(particle, start));
        world.set_drag(rate);
        for _ in 0..2000 {
            world.step().unwrap();
        }
        let time = world.time();
        let kept = (-rate * time).exp();
        // Rounded to f32 once a step: at random, 2000^0.5 * 3e-8 of the velocity then.
        let error = particles(&world).iter().map(|&p| (world.velocity(p) / kept - start).norm()).fold(0.0, f64::max);
        println!("rate {rate}: {kept:.4} left, off by {:e}", error / start.norm());
        assert!(error < 1e-5 * start.norm(), "rate {rate}: {error:e}");
        // The places are those of the velocities: the sum of a geometric series.
        let q = (-rate * world.dt()).exp();
        let way = start * (world.dt() * q * (1.0 - kept) / (1.0 - q));
        assert!((world.displacement(0) - way).norm() < 2e-5 * way.norm(), "rate {rate}: {:?}", world.displacement(0));
    }
}

#[test]
fn a_rigid_body_decays_with_its_spin() {
    let mut world = bone([6, 4, 2], 1e-3);
    world.set_rigid_motion(0, Vector3::new(0.1, 0.2, -0.3), Vector3::new(0.3, 30.0, 0.1));
    world.set_drag(2.0);
    let before = balance(&world);
    let spin = world.rigid_bodies()[0].angular_momentum();
    for _ in 0..1000 {
        world.step().unwrap();
    }
    let kept = (-2.0_f64).exp();
    let (after, body) = (balance(&world), &world.rigid_bodies()[0]);
    assert!((after.momentum - before.momentum * kept).norm() < 1e-12 * before.momentum.norm());
    // About the centre, in space: it tumbles meanwhile, which changes nothing.
    assert!((body.angular_momentum() - spin * kept).norm() < 1e-12 * spin.norm());
    assert!((body.orientation() - nalgebra::Matrix3::identity()).norm() > 0.1, "it turned");
}

#[test]
fn a_fall_ends_at_gravity_over_rate() {
    let gravity = Vector3::new(0.0, 1.0, -9.81);
    let rate = 30.0;
    for (name, mut world) in [("soft", soft()), ("rigid", bone([5, 4, 3], 2e-4))] {
        world.set_gravity(gravity);
        world.set_drag(rate);
        let steps = (20.0 / rate / world.dt()) as usize;
        for _ in 0..steps {
            world.step().unwrap();
        }
        let q = (-rate * world.dt()).exp();
        let (exact, ideal) = (gravity * (world.dt() * q / (1.0 - q)), gravity / rate);
        let found = world.velocity(0);
        let (off, from_ideal) = ((found - exact).norm() / exact.norm(), (found - ideal).norm() / ideal.norm());
        println!("{name}: off by {off:e} of the step's own end, {from_ideal:e} of g / rate");
        assert!(off < 1e-5, "{name}: {off:e}");
        assert!(from_ideal < 0.51 * rate * world.dt(), "{name}: {from_ideal:e}");
    }
}

/// Two particles and a spring, `x'' + rate x' + w^2 x = 0`, at a step so short that only the drag could bend the envelope.
#[test]
fn a_swing_dies_down_in_its_analytic_envelope() {
    let pair = PaperBody { damping: 0.0, ..PAPER };
    let (lattice, assembly) = paper_lattice(&block([2, 1, 1]), &[Some(pair)]);
    let w = (2.0 * pair.stiffness / pair.mass).sqrt();
    for share in [0.02, 0.3] {
        let rate = share * w;
        let turn = (w * w - 0.25 * rate * rate).sqrt();
        let mut world = World::new(lattice.clone(), assembly.clone(), 2e-4 / w);
        world.set_drag(rate);
        let start = 0.05 * world.lattice().pitch;
        world.set_displacement(0, Vector3::new(-0.5 * start, 0.0, 0.0));
        world.set_displacement(1, Vector3::new(0.5 * start, 0.0, 0.0));
        let mut worst = 0.0_f64;
        for _ in 0..(3.0 * std::f64::consts::TAU / 2e-4) as usize {
            world.step().unwrap();
            let t = world.time();
            let stretch = world.displacement(1).x - world.displacement(0).x;
            let expected = start * (-0.5 * rate * t).exp() * ((turn * t).cos() + 0.5 * rate / turn * (turn * t).sin());
            worst = worst.max((stretch - expected).abs() / start);
        }
        println!("rate {share} w: off by {worst:e} of the first stretch");
        assert!(worst < 1e-3, "rate {share} w: {worst:e}");
    }
}

/// A block that hangs from its top comes to the same shape with dampers alone and with drag alone.
#[test]
fn the_rest_shape_under_a_load_is_unchanged() {
    let hang = |damping: f64, rate: f64| {
        let body = TissueBody { damping: Damping::Ratio(damping), ..TISSUE };
        let mut world = world(tissue_lattice(&block([4, 4, 8]), &[Some(body)]));
        let top: Vec<u32> = particles(&world).into_iter().filter(|&p| world.lattice().ijk(p)[2] == 9).collect();
        assert_eq!(top.len(), 25);
        world.hold(&top);
        world.set_gravity(Vector3::new(0.0, 0.0, -9.81));
        world.set_drag(rate);
        // Some forty times as long as the slowest swing takes to die down.
        (0..5000).for_each(|_| world.step().unwrap());
        displacements(&world)
    };
    let dampers = hang(1.0, 0.0);
    let sag = dampers.iter().map(Vector3::norm).fold(0.0, f64::max);
    // Twice the angular frequency of the slowest swing, a quarter of a wave over the block's length.
    let rate = std::f64::consts::PI * (TISSUE.youngs_modulus / TISSUE.density).sqrt() / 0.024;
    for rate in [0.3 * rate, rate] {
        let off = hang(0.0, rate).iter().zip(&dampers).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max) / sag;
        println!("rate {rate:.0} /s: off by {off:e} of a sag of {sag:e} m");
        assert!(off < 1e-4, "rate {rate}: {off:e}");
    }
}

#[test]
fn what_is_told_where_to_go_goes_there() {
    let mut world = soft();
    let side = |world: &World, i: usize| -> Vec<u32> {
        particles(world).into_iter().filter(|&p| world.lattice().ijk(p)[0] == i).collect()
    };
    let (held, grabbed) = (side(&world, 1), side(&world, 6));
    assert!(!held.is_empty() && !grabbed.is_empty());
    world.hold(&held);
    let grab = world.grab(&grabbed);
    world.set_drag(200.0);
    for step in 1..=50 {
        world.move_grab(grab, Vector3::new(0.01 * f64::from(step), 0.0, 0.0));
        world.step().unwrap();
    }
    let axes = world.to_lattice_axes(Vector3::new(5e-4, 0.0, 0.0));
    assert!(grabbed.iter().all(|&p| (world.displacement(p) - axes).norm() < 1e-9));
    assert!(held.iter().all(|&p| world.displacement(p) == Vector3::zeros()));
    // What it covered in a step is known exactly, drag or not.
    let fastest = particles(&world).iter().map(|&p| world.velocity(p).norm()).fold(0.0, f64::max);
    assert!((world.longest_move() / (fastest * world.dt()) - 1.0).abs() < 1e-6);
}

#[test]
fn the_fast_world_is_its_twin() {
    let damped = TissueBody { damping: Damping::Ratio(0.2), ..TISSUE };
    let mut world = world(tissue_lattice(&blob([9, 8, 7], 0.7, 3), &[Some(damped), Some(TISSUE)]));
    shake(&mut world, 0.05, 0.1, 4);
    world.set_gravity(Vector3::new(0.0, 0.0, -9.81));
    world.set_drag(0.05 / world.dt());
    let mut twin = ReferenceWorld::of(&world);
    for _ in 0..40 {
        world.step().unwrap();
        twin.step().unwrap();
    }
    let fastest = twin.velocity().iter().map(Vector3::norm).fold(0.0, f64::max);
    let off = velocities(&world).iter().zip(twin.velocity()).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    assert!(off < 1e-4 * fastest, "{:e}", off / fastest);
}

/// A rate of 50 a step stops everything where it is; a small one leaves the step next to its limit stable.
#[test]
fn no_rate_makes_a_step_unstable() {
    let (lattice, assembly) = tissue_lattice(&block([6, 5, 4]), &[Some(TISSUE)]);
    let limit = stable_dt(&lattice, &Topology::new(&lattice), &assembly);
    for turns in [1e-3, 0.1, 1.0, 50.0] {
        let mut world = World::new(lattice.clone(), assembly.clone(), 0.99 * limit);
        shake(&mut world, 0.02, 0.0, 5);
        world.set_drag(turns / world.dt());
        let start = balance(&world).elastic;
        for _ in 0..3000 {
            world.step().unwrap();
        }
        let end = balance(&world);
        assert!(end.kinetic + end.elastic <= start, "{turns}: {} of {start}", end.kinetic + end.elastic);
    }
}

#[test]
fn threads_change_no_bit_and_no_drag_is_no_drag() {
    let damped = TissueBody { damping: Damping::Ratio(0.2), ..TISSUE };
    let start = world(tissue_bone(&organ_map([20, 11, 12], |[i, ..]| u8::from(i > 12)), damped));
    let run = |threads: usize, rate: Option<f64>| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut world = start.clone();
            shake(&mut world, 0.01, 0.1, 6);
            if let Some(rate) = rate {
                world.set_drag(rate);
            }
            (0..20).for_each(|_| world.step().unwrap());
            (displacements(&world), velocities(&world))
        })
    };
    let one = run(1, Some(100.0));
    assert!(one == run(2, Some(100.0)) && one == run(4, Some(100.0)));
    assert!(run(1, None) == run(2, Some(0.0)) && one != run(1, None));
}

#[test]
fn a_scene_gives_the_rate() {
    let text = "[volume]\nphantom = \"cube\"\nspacing = 6\n[[organ]]\nname = \"cube\"\nlabel = \"cube\"\nmaterial = \"liver\"\n\
                [time]\nduration = 0.1\n[gravity]\nacceleration = [0, 0, -9.81]\n";
    let parse = |text: &str| scene::parse(text, Path::new("s.toml"), Path::new("/"), &Files).unwrap().0;
    assert_eq!(parse(text).drag, None);
    let scene = parse(&format!("{text}[drag]\nrate = 2.5\n"));
    assert_eq!(scene.drag, Some(2.5));
    let inputs = yawara::run::inputs::load(&scene).unwrap();
    let mut world = yawara::run::prepare::prepare(&scene, &inputs).unwrap().into_world(&scene);
    particles(&world).into_iter().for_each(|p| world.set_velocity(p, Vector3::new(0.0, 0.0, 1.0)));
    world.step().unwrap();
    let expected = (1.0 - 9.81 * world.dt()) * (-2.5 * world.dt()).exp();
    assert!((world.velocity(0).z - expected).abs() < 1e-6);
}
