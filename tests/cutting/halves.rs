//! What a cut may change: springs, and nothing else.

use yawara::cut::Blade;
use yawara::dynamics::World;
use yawara::dynamics::measure::balance;
use yawara::dynamics::stable_dt::stable_dt;
use yawara::geometry::{Point3, Vector3};
use yawara::material::paper::PaperBody;
use yawara::material::tissue::{Damping, TissueBody};

use crate::oracle::living;
use crate::support::*;

/// A blade through the whole lattice between the layers `i` and `i + 1`, far beyond its ends.
fn across(world: &World, i: f64) -> Blade {
    let h = world.lattice().pitch;
    let edge = vec![Point3::new((i + 0.5) * h, -1.0, -1.0), Point3::new((i + 0.5) * h, -1.0, 1.0)];
    Blade::new(edge, &[Vector3::zeros(), Vector3::y() * 2.0])
}

fn worlds() -> Vec<(&'static str, World)> {
    let damped = PaperBody { damping: 1e-3, ..PAPER };
    let tissue = TissueBody { damping: Damping::Ratio(0.3), ..TISSUE };
    let stiff = TissueBody { youngs_modulus: 5e4, ..tissue };
    vec![
        ("paper", world(paper_lattice(&block([24, 9, 9]), &[Some(PAPER)]))),
        ("damped paper", world(paper_lattice(&blob([20, 9, 9], 0.8, 1), &[Some(damped), Some(damped)]))),
        ("tissue", world(tissue_lattice(&block([20, 8, 8]), &[Some(TISSUE)]))),
        ("damped tissue of two organs", world(tissue_lattice(&blob([20, 8, 8], 0.7, 2), &[Some(tissue), Some(stiff)]))),
    ]
}

#[test]
fn a_cut_touches_neither_places_nor_velocities_and_adds_no_energy() {
    for (name, mut world) in worlds() {
        shake(&mut world, 0.1, 0.2, 3);
        for i in 2..18 {
            let (before, places, speeds) = (balance(&world), displacements(&world), velocities(&world));
            let bound = stable_dt(world.lattice(), world.topology(), world.assembly());
            let blade = across(&world, f64::from(i));
            let count = world.cut(&blade.sweep(0.0, blade.path_length()));
            assert!(count > 50, "{name}: {count}");
            assert_eq!(world.cut(&blade.sweep(0.0, blade.path_length())), 0, "{name}: cutting twice");
            assert_eq!((places, speeds), (displacements(&world), velocities(&world)), "{name}");
            let after = balance(&world);
            assert_eq!((before.momentum, before.kinetic), (after.momentum, after.kinetic), "{name}");
            assert!(after.elastic < before.elastic, "{name}: {} to {} J", before.elastic, after.elastic);
            assert!(stable_dt(world.lattice(), world.topology(), world.assembly()) >= bound, "{name}");
        }
        // The pieces go on: momentum stays while they fly apart.
        let before = balance(&world);
        let scale: f64 =
            particles(&world).iter().map(|&p| f64::from(world.mass()[p as usize]) * world.velocity(p).norm()).sum();
        for _ in 0..200 {
            world.step().unwrap();
        }
        assert!((balance(&world).momentum - before.momentum).norm() < 1e-6 * scale, "{name}");
    }
}

/// Two worlds that differ beyond a cut only are the same on this side of it, bit for bit.
#[test]
fn separated_halves_do_not_feel_each_other() {
    for (name, mut rest) in worlds() {
        // The cut runs through blocks (16 grid points long), not along their border.
        let cut = 7;
        let blade = across(&rest, f64::from(cut));
        rest.cut(&blade.sweep(0.0, blade.path_length()));
        let near: Vec<u32> =
            particles(&rest).into_iter().filter(|&p| rest.lattice().ijk(p)[0] <= cut as usize).collect();
        assert!(living(&rest).iter().all(|&(_, a, b)| near.contains(&(a as u32)) == near.contains(&(b as u32))));
        shake(&mut rest, 0.1, 0.1, 4);
        let mut other = rest.clone();
        let far: Vec<u32> = particles(&rest).into_iter().filter(|p| !near.contains(p)).collect();
        let mut random = Random::new(5);
        for &p in &far {
            // Through the near half and beyond.
            other.set_displacement(p, Vector3::new(-0.02, 0.0, 0.0) + random.vector() * 3e-4);
            other.set_velocity(p, random.vector() * 0.3);
        }
        other.hold(&far[..far.len() / 2]);
        for _ in 0..100 {
            rest.step().unwrap();
            other.step().unwrap();
        }
        for &p in &near {
            assert_eq!(rest.displacement(p), other.displacement(p), "{name}: particle {p}");
            assert_eq!(rest.velocity(p), other.velocity(p), "{name}: particle {p}");
        }
    }
}

/// In model `paper` a half is the lattice of its own voxels.
#[test]
fn a_cut_off_half_moves_as_if_it_had_been_made_alone() {
    let mut whole = world(paper_lattice(&block([20, 8, 8]), &[Some(PAPER)]));
    let blade = across(&whole, 7.0);
    whole.cut(&blade.sweep(0.0, blade.path_length()));
    let half = paper_lattice(&block([7, 8, 8]), &[Some(PAPER)]);
    let mut half = World::new(half.0, half.1, whole.dt());
    shake(&mut half, 0.1, 0.1, 6);
    let twin = |p: u32| whole.lattice().particle_at[whole.lattice().grid.shape.linear(half.lattice().ijk(p))];
    let twins: Vec<u32> = particles(&half).into_iter().map(twin).collect();
    for (p, &twin) in particles(&half).into_iter().zip(&twins) {
        whole.set_displacement(twin, half.displacement(p));
        whole.set_velocity(twin, half.velocity(p));
    }
    for _ in 0..200 {
        whole.step().unwrap();
        half.step().unwrap();
    }
    for (p, &twin) in particles(&half).into_iter().zip(&twins) {
        assert_eq!(whole.displacement(twin), half.displacement(p), "particle {p}");
    }
}
