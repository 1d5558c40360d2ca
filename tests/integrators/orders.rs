//! Observed orders against a reference of much higher accuracy.

use super::*;

/// Simulated time [s].
const DURATION: f64 = 6e-3;

/// Places at the end of the beam's motion after so many steps.
fn places_after(damping: f64, integrator: Integrator, steps: u32) -> Vec<Vector3> {
    let mut world = beam(damping, integrator, DURATION / f64::from(steps));
    for _ in 0..steps {
        world.step().unwrap();
    }
    world.precise_displacements().unwrap_or_else(|| displacements(&world))
}

#[test]
fn every_order_is_what_theory_says() {
    for damping in [0.0, 0.3] {
        let reference = places_after(damping, precise(Method::Rk4), 4096);
        for (method, order, first) in [
            (Method::SymplecticEuler, 1.0, 64),
            (Method::Verlet, 2.0, 32),
            (Method::BogackiShampine, 3.0, 32),
            (Method::Rk4, 4.0, 16),
            (Method::BackwardEuler, 1.0, 256),
        ] {
            let integrator = Integrator {
                tolerance: if method == Method::BogackiShampine { 1.0 } else { 1e-14 },
                ..precise(method)
            };
            let errors: Vec<f64> = (0..5)
                .map(|k| largest_difference(&places_after(damping, integrator, first << k), &reference))
                .collect();
            let observed: Vec<f64> = errors.windows(2).map(|pair| (pair[0] / pair[1]).log2()).collect();
            println!("damping {damping} {method:?} {errors:?} {observed:.3?} expected {order}");
        }
    }
}
