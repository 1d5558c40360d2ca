//! What each integrator keeps: momentum, energy, and the same bits.

use super::*;
use yawara::dynamics::measure::balance;
use yawara::geometry::Point3;
use yawara::lattice::region::Region;

fn energy(world: &World) -> f64 {
    let balance = balance(world);
    balance.kinetic + balance.elastic
}

#[test]
fn momentum_is_kept_by_all() {
    for method in MOVING {
        for precision in [Precision::Single, Precision::Double] {
            let body = TissueBody { poissons_ratio: 0.35, damping: Damping::Ratio(0.3), ..TISSUE };
            let mut world = world(tissue_lattice(&blob([8, 8, 8], 0.6, 2), &[Some(body), Some(body)]));
            world.set_integrator(Integrator { precision, tolerance: 1e-10, method });
            world.set_dt(0.4 * world.dt());
            shake(&mut world, 0.1, 0.2, 3);
            let before = balance(&world);
            let scale: f64 =
                particles(&world).iter().map(|&p| f64::from(world.mass()[p as usize]) * world.velocity(p).norm()).sum();
            let arm = rest_places(&world).iter().map(Vector3::norm).fold(0.0, f64::max);
            for _ in 0..60 {
                world.step().unwrap();
            }
            let after = balance(&world);
            let linear = (after.momentum - before.momentum).norm() / scale;
            let angular = (after.angular_momentum - before.angular_momentum).norm() / (scale * arm);
            println!("{} {precision:?}: momentum {linear:.1e}, angular momentum {angular:.1e}", method.name());
            // Velocities are rounded once per step and stage, or when they are read.
            assert!(linear < 1e-7, "{method:?} {precision:?}: momentum changed by {linear:e} of the particles' total");
            // Backward Euler takes angular momentum from what turns.
            let allowed = if method == Method::BackwardEuler { 1e-3 } else { 1e-6 };
            assert!(angular < allowed, "{method:?} {precision:?}: angular momentum changed by {angular:e}");
        }
    }
}

#[test]
fn verlet_keeps_energy_within_bounds_for_ten_thousand_steps() {
    let mut world = world(tissue_lattice(&block([4, 3, 3]), &[Some(TISSUE)]));
    world.set_integrator(Integrator::new(Method::Verlet));
    world.set_dt(0.5 * world.dt());
    shake(&mut world, 0.03, 0.0, 5);
    let begun = energy(&world);
    let mut means = Vec::new();
    for _ in 0..10 {
        let mut sum = 0.0;
        for _ in 0..1000 {
            world.step().unwrap();
            let now = energy(&world);
            assert!((now / begun - 1.0).abs() < 0.2, "step {}: {now:e} J from {begun:e} J", world.steps());
            sum += now;
        }
        means.push(sum / 1000.0 / begun);
    }
    println!("mean energy of every thousand steps: {means:.4?}");
    let drift = (means[9] / means[0] - 1.0).abs();
    assert!(drift < 3e-3, "{drift:e}");
}

#[test]
fn backward_euler_only_loses_energy() {
    for factor in [0.3, 3.0, 30.0] {
        let body = TissueBody { poissons_ratio: 0.4, damping: Damping::Ratio(0.05), ..TISSUE };
        let mut world = world(tissue_lattice(&block([5, 4, 3]), &[Some(body)]));
        world.set_integrator(Integrator { tolerance: 1e-12, ..Integrator::new(Method::BackwardEuler) });
        world.set_dt(factor * world.dt());
        shake(&mut world, 0.05, 0.1, 5);
        let begun = energy(&world);
        let mut before = begun;
        for _ in 0..100 {
            world.step().unwrap();
            let now = energy(&world);
            // Read from places in f32.
            assert!(now <= before * (1.0 + 1e-6) + 1e-10 * begun, "{factor}: {now:e} J after {before:e} J");
            before = now;
        }
        assert!(before < 0.9 * begun, "{factor}: it loses something, {before:e} of {begun:e} J");
    }
}

#[test]
fn the_same_bits_at_any_number_of_threads() {
    let all = MOVING.into_iter().chain([Method::QuasiStatic]);
    for (method, precision) in all.flat_map(|method| [(method, Precision::Single), (method, Precision::Double)]) {
        let run = |threads: usize| {
            among(threads, || {
                let body = TissueBody { poissons_ratio: 0.4, damping: Damping::Ratio(0.2), ..TISSUE };
                let hard = TissueBody { youngs_modulus: 2e4, ..body };
                let map = organ_map([20, 12, 9], |[i, j, _]| u8::from(i + j > 12));
                let mut world = world(tissue_lattice(&map, &[Some(body), Some(hard)]));
                world.set_integrator(Integrator { precision, tolerance: 1e-7, method });
                world.set_gravity(Vector3::new(0.0, 0.0, -9.81));
                let low = world.lattice().rest_place(0);
                let normal = Vector3::new(0.0, 0.0, -1.0);
                let foot = Region::HalfSpace { point: Point3::new(low.x, low.y, low.z + 7.0), normal };
                let foot = foot.select(world.lattice());
                world.hold(&foot);
                for _ in 0..3 {
                    world.step().unwrap();
                }
                displacements(&world)
            })
        };
        let one = run(1);
        assert!(one.iter().any(|u| u.norm() > 0.0), "{method:?}: it moves");
        for threads in [2, 4] {
            assert!(run(threads) == one, "{method:?} {precision:?}: {threads} threads differ");
        }
    }
}
