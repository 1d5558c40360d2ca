//! A step that is too long, with dampers that keep the motion within bounds: caught, and nothing else taken for it.

use super::guard::{guarded, sharp};
use super::support::{TISSUE, block, displacements, organ_map, particles, rest_places, shake, tissue_lattice};
use yawara::dynamics::reference_world::ReferenceWorld;
use yawara::dynamics::{StepError, World};
use yawara::geometry::Vector3;
use yawara::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS};
use yawara::lattice::{Lattice, SeveredSpring};
use yawara::material::Assembly;
use yawara::material::tissue::{Damping, TissueBody};

/// A soft block of two and more step blocks with a stiff organ in one corner, which sets the limit.
fn soft_with_a_stiff_corner(damping: f64) -> (Lattice, Assembly) {
    let map = organ_map([24, 9, 9], |ijk| u8::from(ijk.iter().all(|&i| i < 3)));
    let body = |youngs_modulus| Some(TissueBody { youngs_modulus, damping: Damping::Ratio(damping), ..TISSUE });
    tissue_lattice(&map, &[body(1e3), body(1e5)])
}

#[test]
fn a_step_that_is_too_long_is_caught_where_it_is() {
    for damping in [0.1, 0.5] {
        let (mut world, limits) = sharp(soft_with_a_stiff_corner(damping));
        world.set_dt(1.02 * limits.sharp);
        shake(&mut world, 1e-3, 0.0, 4);
        let mut twin = ReferenceWorld::of(&world);
        let caught = |name: &str, step: &mut dyn FnMut() -> Result<(), StepError>| {
            let error = (0..3000).find_map(|_| step().err()).unwrap_or_else(|| panic!("{name}: not caught"));
            let StepError::Alternates { place, moves, cause, .. } = &error else { panic!("{name}: {error}") };
            assert!(cause.contains("times the stable one"), "{name}: {error}");
            assert!(*moves > 1e-4, "{name}: {error}");
            // Three voxels of 3 mm from the corner at (-10, 5, 20) mm, and the layer around.
            let inside = [place.x + 10.0, place.y - 5.0, place.z - 20.0].iter().all(|x| (-3.0..=12.0).contains(x));
            assert!(inside, "{name}: {error}");
        };
        caught("f32", &mut || world.step());
        caught("f64", &mut || twin.step());
        let bound = 10.0 * world.lattice().pitch;
        assert!(displacements(&world).iter().all(|u| u.norm() < bound), "the last state is kept");
    }
}

/// Severs every spring between the layers before and from `layer` on, along x.
fn cut_across(world: &mut World, layer: usize) {
    let (lattice, mut parted) = (world.lattice(), Vec::new());
    for particle in particles(world) {
        for direction in FIRST_FORWARD..NEIGHBOURS {
            let far = lattice.neighbour(particle, direction);
            let before = |p: u32| lattice.ijk(p)[0] < layer;
            if far.is_some_and(|far| before(far) != before(particle)) {
                parted.push(SeveredSpring { particle, direction: direction as u8, at: 0.5, time: world.time() });
            }
        }
    }
    assert!(world.sever(parted) > 100);
}

/// Shaken, spinning, pulled to and fro, cut, with weak and strong dampers, at the step that a scene gets.
#[test]
fn motion_that_the_step_resolves_is_left_alone() {
    for (seed, damping) in [1e-3, 0.02, 0.2, 1.0, 3.0].into_iter().enumerate() {
        for poissons_ratio in [0.1, 0.25, 0.45] {
            let name = format!("damping ratio {damping}, Poisson's ratio {poissons_ratio}");
            let body = TissueBody { poissons_ratio, damping: Damping::Ratio(damping), ..TISSUE };
            let (mut world, limits) = sharp(tissue_lattice(&block([8, 5, 4]), &[Some(body)]));
            shake(&mut world, 0.02, 0.0, seed as u64);
            for (p, rest) in particles(&world).into_iter().zip(rest_places(&world)) {
                world.set_velocity(p, Vector3::new(4.0, 8.0, 2.0).cross(&rest));
            }
            let tool: Vec<u32> = particles(&world).into_iter().filter(|&p| world.lattice().ijk(p)[0] == 1).collect();
            let mut grab = None;
            let counts = guarded(&mut world, limits, 300, |world| match world.steps() {
                500 => cut_across(world, 5),
                1000 => grab = Some(world.grab(&tool)),
                1001..1400 => {
                    let at = 0.5 * world.lattice().pitch * ((world.steps() - 1000) as f64 * 0.1).sin();
                    world.move_grab(grab.expect("grabbed before"), Vector3::new(0.0, at * 1e3, 0.0));
                }
                1400 => world.release(grab.expect("grabbed before")),
                _ => {}
            });
            let steps = counts.unwrap_or_else(|error| panic!("{name}: {error}")).steps;
            assert!(steps >= 3000, "{name}: {steps}");
        }
    }
}
