//! The lattice drawn voxel by voxel.

use yawara::geometry::Affine;
use yawara::lattice::neighbours::direction_of;
use yawara::lattice::{Lattice, SeveredSpring, Topology};
use yawara::render::camera::Direction;
use yawara::render::cubes::cubes;
use yawara::surface::check::check;
use yawara::surface::mesh::TriangleMesh;
use yawara::surface::weld::{soup, weld};

use crate::bodies::{RED, coverage, organ, picture};
use crate::support::{PAPER, TISSUE, block, block_placed, organ_map, paper_lattice, tissue_lattice};

fn still(lattice: &Lattice) -> Vec<[f32; 3]> {
    vec![[0.0; 3]; lattice.len()]
}

/// Faces of a mesh of cubes, and the volume it encloses [mm^3].
fn measured(mesh: &TriangleMesh) -> (usize, f64) {
    let report = check(&weld(&soup(mesh), 0.0));
    assert!(report.is_closed() && report.is_oriented(), "{report:?}");
    (mesh.triangles.len() / 2, report.volume_ml() * 1e3)
}

#[test]
fn blocks_have_their_outer_faces_and_their_volume() {
    // 3 x 4 x 5 voxels of 3 mm: 60 voxels, 2 (12 + 15 + 20) faces.
    let (paper, _) = paper_lattice(&block([3, 4, 5]), &[Some(PAPER)]);
    let (tissue, _) = tissue_lattice(&block([3, 4, 5]), &[Some(TISSUE)]);
    let turned = Affine::from_spacing([-3.0, 3.0, 3.0], [0.0; 3]).unwrap();
    let (mirrored, _) = paper_lattice(&block_placed(turned, [3, 4, 5]), &[Some(PAPER)]);
    for lattice in [&paper, &tissue, &mirrored] {
        let mesh = cubes(lattice, &Topology::new(lattice), &still(lattice), 0);
        let (faces, volume) = measured(&mesh);
        assert_eq!(faces, 94);
        assert!((volume - 60.0 * 27.0).abs() < 1e-3, "{volume}");
        assert!(coverage(&picture(&[organ(RED, mesh)], Direction::THREE_QUARTER)) > 5000.0);
    }
}

#[test]
fn organs_are_closed_each_by_itself() {
    let map = organ_map([4, 3, 3], |[i, ..]| u8::from(i >= 1));
    for lattice in [paper_lattice(&map, &[Some(PAPER); 2]).0, tissue_lattice(&map, &[Some(TISSUE); 2]).0] {
        let topology = Topology::new(&lattice);
        let of = |organ: u8| measured(&cubes(&lattice, &topology, &still(&lattice), organ));
        assert_eq!((of(0).0, of(1).0), (2 * (9 + 3 + 3), 6 * 9));
    }
}

#[test]
fn cells_that_a_blade_went_through_are_left_out() {
    let (lattice, _) = tissue_lattice(&block([3, 3, 3]), &[Some(TISSUE)]);
    let mut topology = Topology::new(&lattice);
    // An edge of the lattice inside the block belongs to four cells.
    let direction = direction_of([1, 0, 0]);
    let inner = (0..lattice.len() as u32)
        .find(|&particle| {
            lattice.cells_of_spring(particle, direction).filter(|&c| lattice.cell(c).is_some()).count() == 4
        })
        .unwrap();
    assert!(
        topology.sever(&lattice, SeveredSpring { particle: inner, direction: direction as u8, at: 0.5, time: 0.0 })
    );
    let mesh = cubes(&lattice, &topology, &still(&lattice), 0);
    let (_, volume) = measured(&mesh);
    assert!((volume - 23.0 * 27.0).abs() < 1e-3, "{volume}");
}

#[test]
fn particles_part_where_a_spring_is_severed_or_stretched() {
    let (lattice, _) = paper_lattice(&block([2, 1, 1]), &[Some(PAPER)]);
    let faces = |topology: &Topology, apart: f32| {
        let mut displacements = still(&lattice);
        displacements[1] = [apart, 0.0, 0.0];
        cubes(&lattice, topology, &displacements, 0).triangles.len() / 2
    };
    let whole = Topology::new(&lattice);
    assert_eq!([0.0, 0.03, 0.3].map(|apart| faces(&whole, apart)), [10, 10, 12]);
    let mut severed = Topology::new(&lattice);
    let direction = direction_of([1, 0, 0]) as u8;
    assert!(severed.sever(&lattice, SeveredSpring { particle: 0, direction, at: 0.5, time: 0.0 }));
    assert_eq!(faces(&severed, 0.0), 12);
}
