//! How far each integrator may step, and how a scene chooses.

use std::path::Path;

use super::*;
use yawara::dynamics::measure::balance;
use yawara::run::inputs;
use yawara::run::label_lookup::Files;
use yawara::run::prepare::{PrepareError, Schedule, prepare};
use yawara::scene;

/// Kinetic and elastic energy after so many steps over that at the start, of a block shaken by so little that it is linear.
fn grown(method: Method, damping: f64, drag: f64, share: f64) -> f64 {
    let body = TissueBody { poissons_ratio: 0.4, damping: Damping::Ratio(damping), ..TISSUE };
    let (lattice, assembly) = tissue_lattice(&block([5, 4, 4]), &[Some(body)]);
    let topology = yawara::lattice::Topology::new(&lattice);
    let limit = {
        let (limits, sharpen) = method.limits(&lattice, &topology, &assembly, drag);
        sharpen(limits, 1e5).sharp
    };
    let mut world = World::new(lattice, assembly, share * limit);
    world.set_drag(drag);
    world.set_integrator(Integrator { tolerance: 1.0, precision: Precision::Double, ..Integrator::new(method) });
    shake(&mut world, 1e-6, 0.0, 11);
    let energy = |world: &World| balance(world).kinetic + balance(world).elastic;
    let begun = energy(&world);
    let mut worst = 0.0_f64;
    for step in 0..1500 {
        if world.step().is_err() {
            return f64::INFINITY;
        }
        if step % 50 == 0 {
            worst = worst.max(energy(&world) / begun);
        }
    }
    worst
}

#[test]
fn limits_hold_and_are_not_far_from_true() {
    for method in [Method::Verlet, Method::Rk4, Method::BogackiShampine] {
        for (damping, drag) in [(0.0, 0.0), (0.1, 0.0), (0.6, 0.0), (0.1, 300.0)] {
            let within = grown(method, damping, drag, 0.97);
            // Next to its limit Verlet's method keeps another energy, which may differ a lot.
            assert!(within < 100.0, "{method:?}, damping {damping}, drag {drag}: {within:e} at 0.97 of the limit");
            // The half discs of the others leave room with dampers.
            let beyond = if damping > 0.0 && method != Method::Verlet { 2.6 } else { 1.06 };
            let beyond = grown(method, damping, drag, beyond);
            assert!(beyond > 1e3, "{method:?}, damping {damping}, drag {drag}: {beyond:e} beyond the limit");
        }
    }
}

fn scheduled(time: &str) -> Result<Schedule, PrepareError> {
    let text = format!(
        "[volume]\nphantom = \"cube\"\nspacing = 9.0\n[[organ]]\nname = \"cube\"\nlabel = 1\nyoungs_modulus = 5e3\n\
         density = 1000\ndamping_ratio = 0.2\n[drag]\nrate = 2.0\n[time]\nduration = 0.2\nframes = 10\n{time}\n\
         [[fix]]\nregion = {{ half_space = {{ point = [0, 0, 0], normal = [0, 0, -1] }} }}\n"
    );
    let (scene, _) = scene::parse(&text, Path::new("s.toml"), Path::new("/"), &Files).unwrap_or_else(|e| panic!("{e}"));
    let inputs = inputs::load(&scene).unwrap();
    prepare(&scene, &inputs).map(|prepared| prepared.schedule)
}

#[test]
fn a_scene_may_leave_its_step_out() {
    let plain = scheduled("").unwrap();
    for (method, least, most) in [
        (Method::Verlet, 0.5, 1.01),
        (Method::Rk4, 1.1, 1.5),
        (Method::BogackiShampine, 0.7, 1.0),
        (Method::BackwardEuler, 5.0, 20.1),
        (Method::QuasiStatic, 0.02 / plain.dt * 0.99, 0.02 / plain.dt * 1.01),
    ] {
        let key = format!("integrator = \"{}\"", method.name());
        let schedule = scheduled(&key).unwrap();
        let ratio = schedule.dt / plain.dt;
        println!("{}: {:.3e} s, {ratio:.2} of the plain step, {} steps", method.name(), schedule.dt, schedule.steps);
        assert!((least..=most).contains(&ratio), "{method:?}: {ratio}");
        assert_eq!(schedule.steps % 10, 0, "{method:?}");
        let long = scheduled(&format!("{key}\ndt = 0.02"));
        if method.is_stable_at_any_step() {
            assert_eq!(long.unwrap().dt, 0.02, "{method:?}");
            continue;
        }
        let Err(PrepareError::UnstableStep { suggested, .. }) = long else { panic!("{method:?} accepted 0.02 s") };
        assert_eq!(scheduled(&format!("{key}\ndt = {suggested:e}")).unwrap().dt, suggested, "{method:?}");
    }
}
