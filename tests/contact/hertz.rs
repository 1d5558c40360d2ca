//! A ball pressed into tissue against Hertz.

use yawara::dynamics::effects::contact::Shape;
use yawara::geometry::{Affine, Grid, GridShape};
use yawara::lattice::build::OrganMap;
use yawara::volume::Volume;

use super::*;

/// Edge and height of the slab, radius of the ball, how deep it is pressed [mm].
const WIDE: f64 = 84.0;
const HIGH: f64 = 42.0;
const RADIUS: f64 = 24.0;
const DEPTH: f64 = 1.5;

/// A slab whose surface lies at z = 0 and whose middle is the origin.
fn slab(spacing: f64) -> OrganMap {
    let [wide, high] = [WIDE, HIGH].map(|length| (length / spacing).round() as usize);
    let shape = GridShape::new(wide, wide, high);
    let corner = [-WIDE / 2.0, -WIDE / 2.0, -HIGH].map(|low| low + 0.5 * spacing);
    let affine = Affine::from_spacing([spacing; 3], corner).unwrap();
    Volume::from_vec(Grid { shape, affine }, vec![0; shape.len()])
}

/// Force on the ball at rest [N].
fn pressed(spacing: f64) -> f64 {
    let mut world = world(tissue_lattice(&slab(spacing), &[Some(DAMPED)]));
    let lattice = world.lattice();
    let border = |p: &u32| {
        let place = lattice.rest_place(*p);
        place.z < -HIGH + 0.1 || place.x.abs().max(place.y.abs()) > WIDE / 2.0 - 0.1
    };
    let glued: Vec<u32> = particles(&world).into_iter().filter(border).collect();
    world.hold(&glued);
    let ball = world.add_obstacle("ball", Shape::sphere(Point3::new(0.0, 0.0, RADIUS), RADIUS), 0.0);
    let (press, rest) = (0.1, 0.15);
    while world.time() < press + rest {
        let share = ((world.time() + world.dt()) / press).min(1.0);
        world.move_obstacle(ball, Vector3::new(0.0, 0.0, -DEPTH * share));
        world.step().unwrap();
    }
    let force = world.tool_force(ball);
    assert!(force.xy().norm() < 1e-3 * force.z, "{force}");
    force.z
}

/// Hertz for a half space, `F = 4/3 E / (1 - nu^2) sqrt(R) d^1.5`, with the slab's finite height after Dimitriadis et al.,
/// "Determination of elastic moduli of thin layers of soft material using the atomic force microscope", 2002, eq. 12 (glued
/// to its ground).
fn expected() -> f64 {
    let (nu, e) = (0.25_f64, TISSUE.youngs_modulus);
    let [radius, depth, high] = [RADIUS, DEPTH, HIGH].map(|length| length * 1e-3);
    let hertz = 4.0 / 3.0 * e / (1.0 - nu * nu) * radius.sqrt() * depth.powf(1.5);
    let alpha = -(1.2876 - 1.4678 * nu + 1.3442 * nu * nu) / (1.0 - nu);
    let beta = (0.6387 - 1.0277 * nu + 1.5164 * nu * nu) / (1.0 - nu);
    let pi = std::f64::consts::PI;
    let chi = (radius * depth).sqrt() / high;
    hertz
        * (1.0 - 2.0 * alpha / pi * chi + 4.0 * alpha.powi(2) / pi.powi(2) * chi.powi(2)
            - 8.0 / pi.powi(3) * (alpha.powi(3) + 4.0 * pi.powi(2) / 15.0 * beta) * chi.powi(3))
}

#[test]
fn a_pressed_ball_feels_what_hertz_says() {
    let expected = expected();
    let found = [3.0, 2.0].map(pressed);
    let errors = found.map(|force| force / expected - 1.0);
    println!("Hertz {expected:.5} N; at 3 and 2 mm {found:.5?} N, {errors:.4?}");
    // The ball touches a circle of 6 mm: two and three cells to its radius.
    assert!(errors[0].abs() < 0.06 && errors[1].abs() < 0.04, "{errors:?}");
}
