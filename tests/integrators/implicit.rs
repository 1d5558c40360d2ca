//! Implicit methods at steps that no other takes.

use super::*;

#[test]
fn long_steps() {
    for factor in [1.0, 10.0, 100.0, 1000.0] {
        let mut world = beam(0.1, Integrator::new(Method::BackwardEuler), 3e-4 * factor);
        for _ in 0..20 {
            world.step().unwrap();
        }
        println!("{factor}: {:?} {:?}", world.effort(), world.displacement(60));
    }
    let mut world = beam(0.1, Integrator::new(Method::QuasiStatic), 1.0);
    world.step().unwrap();
    println!("{:?} {:?}", world.effort(), world.displacement(60));
}
