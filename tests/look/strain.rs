//! Equivalent strain against the strain of homogeneous deformations.

use yawara::geometry::{Affine, Matrix3, Vector3};
use yawara::lattice::build::build;
use yawara::lattice::cells::build_cells;
use yawara::lattice::{Lattice, Topology};
use yawara::look::particles::at_rest;
use yawara::look::rest::RestSurface;
use yawara::look::strain::equivalent_strains;

use crate::support::{Random, blob, block, block_placed};
use crate::{cut_after_layer, deformed, middle, moved, on_threads, surface};

/// What the rounding of displacements to f32 leaves: 30 mm, 3 mm apart.
const ROUNDING: f32 = 3e-6;

fn lattices() -> Vec<(&'static str, Lattice)> {
    let turn = nalgebra::Rotation3::from_euler_angles(0.3, -0.2, 0.5).into_inner();
    // Left-handed and oblique, as many a CT is.
    let axes = turn * Matrix3::from_diagonal(&Vector3::new(-3.0, 3.0, 3.0));
    let oblique = block_placed(Affine::from_parts(axes, Vector3::new(40.0, -7.0, 11.0)).unwrap(), [7, 6, 5]);
    vec![
        ("paper", build(&block([7, 6, 5])).unwrap()),
        ("tissue", build_cells(&block([7, 6, 5]), None).unwrap()),
        ("oblique tissue", build_cells(&oblique, None).unwrap()),
        ("ragged tissue", build_cells(&blob([7, 6, 5], 0.7, 5), None).unwrap()),
        // Sheets and chains, most of whose particles have no whole cell.
        ("a sheet", build(&block([7, 6, 1])).unwrap()),
    ]
}

fn strains_of(lattice: &Lattice, gradient: Matrix3) -> Vec<f32> {
    equivalent_strains(lattice, &Topology::new(lattice), &deformed(lattice, gradient, middle(lattice)))
}

/// By hand from E = (F^T F - 1) / 2.
fn expected(gradient: Matrix3) -> f32 {
    let e = (gradient.transpose() * gradient - Matrix3::identity()) * 0.5;
    let deviator = e - Matrix3::identity() * (e.trace() / 3.0);
    (deviator.norm_squared() * 2.0 / 3.0).sqrt() as f32
}

#[test]
fn a_rigid_motion_strains_nothing() {
    for (name, lattice) in lattices() {
        for angles in [[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.4, -1.2, 2.9]] {
            let turn = nalgebra::Rotation3::from_euler_angles(angles[0], angles[1], angles[2]).into_inner();
            let most = strains_of(&lattice, turn).into_iter().fold(0.0, f32::max);
            assert!(most < ROUNDING, "{name} turned by {angles:?}: {most}");
        }
    }
}

#[test]
fn homogeneous_deformations_have_the_strain_of_the_formula() {
    let stretch = Matrix3::from_diagonal(&Vector3::new(1.3, 1.0, 0.9));
    let shear = Matrix3::new(1.0, 0.2, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);
    let turn: Matrix3 = nalgebra::Rotation3::from_euler_angles(0.5, 0.7, -1.0).into_inner();
    for (name, lattice) in lattices().into_iter().take(4) {
        for gradient in [stretch, shear, turn * stretch, turn * shear * turn.transpose(), Matrix3::identity() * 1.2] {
            let expected = expected(gradient);
            for (particle, strain) in strains_of(&lattice, gradient).into_iter().enumerate() {
                // A lone particle of the blob has nothing to tell its strain by.
                let alone = lattice.springs[particle] == 0;
                assert!(alone || (strain - expected).abs() < ROUNDING, "{name}, {particle}: {strain}, {expected}");
            }
        }
    }
    // A small elongation of incompressible tissue is its own equivalent, and simple shear by g is g / sqrt(3).
    let bar = Matrix3::from_diagonal(&Vector3::new(1.001, 1.001_f64.powf(-0.5), 1.001_f64.powf(-0.5)));
    assert!((expected(bar) - 1e-3).abs() < 2e-6);
    let slight = Matrix3::new(1.0, 1e-3, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);
    assert!((expected(slight) - 1e-3 / 3.0_f32.sqrt()).abs() < 1e-6);
}

#[test]
fn an_open_cut_is_no_stretch_and_each_lip_shows_its_own_side() {
    for (name, lattice) in lattices().into_iter().take(2) {
        let topology = cut_after_layer(&lattice, 3);
        let wall = lattice.grid.affine.apply([3.5, 0.0, 0.0].into()).x;
        let stretch = Matrix3::from_diagonal(&Vector3::new(1.0, 1.25, 1.0));
        let apart = moved(&lattice, |place| {
            if place.x > wall {
                (stretch - Matrix3::identity()) * (place - middle(&lattice)) + Vector3::x() * 20.0
            } else {
                Vector3::zeros()
            }
        });
        let strains = equivalent_strains(&lattice, &topology, &apart);
        let stretched = expected(stretch);
        for (particle, &strain) in strains.iter().enumerate() {
            let right = lattice.rest_place(particle as u32).x > wall;
            let expected = if right { stretched } else { 0.0 };
            assert!((strain - expected).abs() < ROUNDING, "{name}, {particle}: {strain}");
        }
        let (mesh, on_cut) = surface(&lattice, &topology, &apart);
        let values: Vec<[f32; 1]> = strains.into_iter().map(|strain| [strain]).collect();
        let shown = at_rest(&lattice, &values, &RestSurface::new(&mesh, &on_cut, 0.0));
        let mut lips = [0, 0];
        for vertex in (0..shown.len()).filter(|&v| on_cut[v]) {
            let right = mesh.displacements[vertex][0] > 10.0;
            lips[usize::from(right)] += 1;
            let expected = if right { stretched } else { 0.0 };
            assert!((shown[vertex][0] - expected).abs() < ROUNDING, "{name}, vertex {vertex}: {:?}", shown[vertex]);
        }
        assert!(lips[0] > 10 && lips[1] > 10, "{name}: {lips:?}");
    }
}

#[test]
fn wild_displacements_give_finite_numbers_and_threads_do_not_matter() {
    let mut random = Random::new(7);
    for (name, lattice) in lattices() {
        let wild: Vec<[f32; 3]> =
            (0..lattice.len()).map(|_| (random.vector() * 50.0).map(|c| c as f32).into()).collect();
        let topology = Topology::new(&lattice);
        let [one, two, four] = on_threads(|| equivalent_strains(&lattice, &topology, &wild));
        assert!(one == two && two == four, "{name}");
        assert!(one.iter().all(|strain| strain.is_finite() && *strain >= 0.0), "{name}");
    }
}

#[test]
fn a_linear_field_is_exact_between_particles() {
    let lattice = build_cells(&block([7, 6, 5]), None).unwrap();
    let values = moved(&lattice, |place| Vector3::new(place.x, place.y - 2.0 * place.z, 1.0));
    let topology = Topology::new(&lattice);
    let (mesh, on_cut) = surface(&lattice, &topology, &vec![[0.0; 3]; lattice.len()]);
    let shown = at_rest(&lattice, &values, &RestSurface::new(&mesh, &on_cut, 0.0));
    // The corners of the block; a smoothed surface bulges a little beyond, where the values at its border hold.
    let (low, high) = (lattice.rest_place(0), lattice.rest_place(lattice.len() as u32 - 1));
    let held = |place: &[f32; 3]| [0, 1, 2].map(|axis| place[axis].clamp(low[axis] as f32, high[axis] as f32));
    for (value, [x, y, z]) in shown.iter().zip(mesh.positions.iter().map(held)) {
        let difference = [value[0] - x, value[1] - (y - 2.0 * z), value[2] - 1.0];
        assert!(difference.iter().all(|d| d.abs() < 1e-4), "{value:?} at {x} {y} {z}");
    }
}
