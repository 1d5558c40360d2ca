//! The integrators: their orders, what they conserve, how far they may step, and where each pays.

#[path = "../support/mod.rs"]
mod support;

mod implicit;
mod orders;

use support::*;
use yawara::dynamics::World;
use yawara::dynamics::integrator::{Integrator, Method, Precision};
use yawara::dynamics::measure::balance;
use yawara::geometry::Vector3;
use yawara::material::tissue::{Damping, TissueBody};

/// All methods but the plain step.
pub const OTHERS: [Method; 5] =
    [Method::Verlet, Method::Rk4, Method::BogackiShampine, Method::BackwardEuler, Method::QuasiStatic];

/// A small beam of tissue with a volume term, held at one end and grabbed at the other, under gravity, drag and a force.
pub fn beam(damping: f64, integrator: Integrator, dt: f64) -> World {
    let body = TissueBody { poissons_ratio: 0.4, damping: Damping::Ratio(damping), ..TISSUE };
    let (lattice, assembly) = tissue_lattice(&block([5, 2, 3]), &[Some(body)]);
    let mut world = World::new(lattice, assembly, dt);
    world.set_integrator(integrator);
    world.set_gravity(Vector3::new(0.0, -3.0, -9.81));
    if damping > 0.0 {
        world.set_drag(3.0);
    }
    let end = |x: usize| {
        let lattice = world.lattice();
        particles(&world).into_iter().filter(|&p| lattice.ijk(p)[0] == x).collect::<Vec<_>>()
    };
    let last = particles(&world).iter().map(|&p| world.lattice().ijk(p)[0]).max().unwrap();
    let first = particles(&world).iter().map(|&p| world.lattice().ijk(p)[0]).min().unwrap();
    let (held, middle, _) = (end(first), end(first + 2), end(last));
    world.hold(&held);
    let push = world.push(&middle);
    world.set_force(push, Vector3::new(2e-3, 4e-3, 0.0));
    world
}

/// An integrator in f64 with a tolerance below all that is measured.
pub fn precise(method: Method) -> Integrator {
    Integrator { tolerance: 1e-14, precision: Precision::Double, ..Integrator::new(method) }
}

/// Largest difference of two lists of vectors.
pub fn largest_difference(a: &[Vector3], b: &[Vector3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

#[test]
fn momentum_is_kept_by_all() {
    for method in [Method::Verlet, Method::Rk4, Method::BogackiShampine, Method::BackwardEuler] {
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
            // f32 velocities are rounded once per step and stage; f64 ones when they are read. What Newton's iteration
            // leaves is below its tolerance.
            assert!(linear < 1e-6, "{method:?} {precision:?}: momentum changed by {linear:e} of the particles' total");
            let angular = (after.angular_momentum - before.angular_momentum).norm() / (scale * arm);
            println!("{method:?} {precision:?}: linear {linear:.1e} angular {angular:.1e}");
        }
    }
}
