//! Observed orders against a reference that another program confirms.

use super::*;
use yawara::dynamics::timeline::Timeline;
use yawara::geometry::Point3;
use yawara::lattice::region::Region;
use yawara::material::paper::PaperBody;
use yawara::scene::resolved::{Action, Operation};

/// Simulated time [s].
const DURATION: f64 = 6e-3;

fn places(world: &World) -> Vec<Vector3> {
    world.precise_displacements().unwrap_or_else(|| displacements(world))
}

/// Places at the end of the beam's motion after so many steps.
fn beam_after(damping: f64, integrator: Integrator, steps: u32) -> Vec<Vector3> {
    let mut beam = Beam::new(damping, integrator, DURATION / f64::from(steps));
    (0..steps).for_each(|_| beam.step());
    places(&beam.world)
}

/// By extrapolation from two step sizes, of an order that is known.
fn extrapolated(order: i32, coarse: &[Vector3], fine: &[Vector3]) -> Vec<Vector3> {
    let gain = 2.0_f64.powi(order) - 1.0;
    fine.iter().zip(coarse).map(|(fine, coarse)| fine + (fine - coarse) / gain).collect()
}

/// Slope of the errors over halved steps, by least squares.
fn slope(errors: &[f64]) -> f64 {
    let n = errors.len() as f64;
    let (mean_x, mean_y) = ((n - 1.0) / 2.0, errors.iter().map(|e| e.log2()).sum::<f64>() / n);
    let parts = errors.iter().enumerate().map(|(i, e)| (i as f64 - mean_x, e.log2() - mean_y));
    let (xy, xx) = parts.fold((0.0, 0.0), |(xy, xx), (x, y)| (xy + x * y, xx + x * x));
    -xy / xx
}

/// scipy's DOP853 on forces written anew, see `fixtures/integrators/dop853.py`.
#[test]
fn the_reference_is_what_another_program_finds() {
    let expected: Vec<[f64; 6]> = include_str!("../../fixtures/integrators/dop853.txt")
        .lines()
        .map(|line| {
            let numbers: Vec<f64> = line.split_whitespace().map(|number| number.parse().unwrap()).collect();
            numbers.try_into().unwrap()
        })
        .collect();
    for (damping, first) in [(0.0, 0), (2e-3, 3)] {
        let steps = 1024;
        let run = |steps: u32| {
            let body = PaperBody { stiffness: 10.0, damping, mass: 3e-5 };
            let (lattice, assembly) = paper_lattice(&block([3, 3, 3]), &[Some(body)]);
            let mut world = World::new(lattice, assembly, DURATION / f64::from(steps));
            for particle in particles(&world) {
                let n = i64::from(particle);
                let part = |axis: i64| ((7 * n * n + 3 * n + 5 * axis) % 11 - 5) as f64 / 5.0 * 0.05 * 0.003;
                world.set_displacement(particle, Vector3::new(part(0), part(1), part(2)));
            }
            world.set_integrator(precise(Method::Rk4));
            (0..steps).for_each(|_| world.step().unwrap());
            places(&world)
        };
        let found = extrapolated(4, &run(steps), &run(2 * steps));
        assert_eq!(found.len(), expected.len());
        let worst = found
            .iter()
            .zip(&expected)
            .map(|(found, row)| (found - Vector3::from_row_slice(&row[first..first + 3])).norm())
            .fold(0.0, f64::max);
        println!("damping {damping}: differs from DOP853 by {worst:.1e} m in motions of 1e-4 m");
        // DOP853 was asked for 1e-12 per step.
        assert!(worst < 1e-14, "damping {damping}: {worst:e}");
    }
}

#[test]
fn every_order_is_what_theory_says() {
    for damping in [0.0, 0.3] {
        let run = |steps| beam_after(damping, precise(Method::Rk4), steps);
        let reference = extrapolated(4, &run(2048), &run(4096));
        for (method, order, first) in [
            (Method::SymplecticEuler, 1.0, 128),
            (Method::Verlet, 2.0, 64),
            (Method::BogackiShampine, 3.0, 64),
            (Method::Rk4, 4.0, 64),
            (Method::BackwardEuler, 1.0, 128),
        ] {
            let after = |k: u32| difference(&beam_after(damping, precise(method), first << k), &reference);
            let errors: Vec<f64> = (0..5).map(after).collect();
            let observed = slope(&errors);
            println!("damping {damping}, {}: errors {errors:?}, order {observed:.3}", method.name());
            assert!((observed - order).abs() < 0.1, "{method:?}, damping {damping}: order {observed} from {errors:?}");
        }
    }
}

#[test]
fn worlds_in_f32_follow_those_in_f64() {
    for damping in [0.0, 0.3] {
        for method in [Method::Verlet, Method::Rk4, Method::BogackiShampine, Method::BackwardEuler] {
            let tolerance = if method == Method::BogackiShampine { 1.0 } else { 1e-12 };
            let single = Integrator { tolerance, ..Integrator::new(method) };
            let wide = Integrator { precision: Precision::Double, ..single };
            let (found, expected) = (beam_after(damping, single, 100), beam_after(damping, wide, 100));
            let size = expected.iter().map(Vector3::norm).fold(0.0, f64::max);
            let apart = difference(&found, &expected) / size;
            println!("damping {damping}, {}: f32 differs by {apart:.1e}", method.name());
            // 100 steps round places by 6e-8 each, and forces a few times that.
            assert!(apart < 5e-6, "{method:?}, damping {damping}: {apart:e}");
        }
    }
}

/// A tolerance is what each step keeps to: a tenth of it, about a tenth of the error.
#[test]
fn a_tolerance_is_kept() {
    let run = |steps| beam_after(0.0, precise(Method::Rk4), steps);
    let reference = extrapolated(4, &run(1024), &run(2048));
    let mut errors = Vec::new();
    for tolerance in [1e-8, 1e-9, 1e-10, 1e-11] {
        let integrator = Integrator { tolerance, ..precise(Method::BogackiShampine) };
        let found = beam_after(0.0, integrator, 12);
        errors.push(difference(&found, &reference));
    }
    println!("errors {errors:?}");
    assert!(errors.windows(2).all(|pair| (4.0..25.0).contains(&(pair[0] / pair[1]))), "{errors:?}");
    assert!(errors[0] < 100.0 * 1e-8, "{errors:?}");
}

/// A load that grows over time acts at every stage as it is then; this one is full at the end of a step.
#[test]
fn orders_are_kept_under_loads_that_grow() {
    let run = |method: Method, steps: u32| {
        let mut beam = Beam::new(0.3, precise(method), DURATION / f64::from(steps));
        let everywhere = Region::Box { min: Point3::new(-1e3, -1e3, -1e3), max: Point3::new(1e3, 1e3, 1e3) };
        let force = Vector3::new(0.0, 0.3, 0.3);
        let action = Action::Force { region: everywhere, force, ramp: 0.5 * DURATION };
        let operation = Operation { name: "ramp".into(), from: 0.0, until: f64::INFINITY, action };
        let mut timeline = Timeline::new(&[operation], beam.world.lattice()).unwrap();
        for _ in 0..steps {
            timeline.advance(&mut beam.world);
            beam.step();
        }
        places(&beam.world)
    };
    let reference = extrapolated(4, &run(Method::Rk4, 1024), &run(Method::Rk4, 2048));
    for (method, order) in [(Method::Verlet, 2.0), (Method::BogackiShampine, 3.0), (Method::Rk4, 4.0)] {
        let errors: Vec<f64> = (0..5).map(|k| difference(&run(method, 32 << k), &reference)).collect();
        let observed = slope(&errors);
        println!("{}: order {observed:.3} under a ramp", method.name());
        assert!((observed - order).abs() < 0.1, "{method:?}: order {observed} from {errors:?}");
    }
}
