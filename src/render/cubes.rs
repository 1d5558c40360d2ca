//! The lattice as Hattori and Kaneko draw it: voxel by voxel.
//!
//! Model `tissue`: a voxel is a cell, drawn with its eight corners where the particles are. Model `paper`: a voxel is a
//! particle, drawn as a cube of one pitch around it that keeps its direction. Where a blade went, cells are torn apart with
//! corners on both sides, so every cell with a severed spring is left out and the cut is a gap; particles keep their cubes,
//! which part as the lips do.

use crate::geometry::Vector3;
use crate::lattice::neighbours::direction_of;
use crate::lattice::{Lattice, Topology};
use crate::surface::mesh::TriangleMesh;

/// Cells with less tissue than this are not drawn: the surface, too, passes where half of the surroundings is tissue.
const LEAST_FILL: f32 = 0.5;
/// Joined particles whose places differ from rest by less than this hide the faces between them [pitches].
const LEAST_GAP: f32 = 0.02;

/// The voxels of an organ at displaced places [mm]: a quad for each face that no voxel of the same organ covers, as triangle pairs
/// (a, b, c), (a, c, d) with vertices and normals of their own.
///
/// # Panics
/// If there is not one displacement for each particle.
pub fn cubes(lattice: &Lattice, topology: &Topology, displacements_mm: &[[f32; 3]], organ: u8) -> TriangleMesh {
    assert_eq!(displacements_mm.len(), lattice.len(), "one displacement for each particle");
    let place = |particle: u32| {
        lattice.rest_place(particle).coords + Vector3::from(displacements_mm[particle as usize].map(f64::from))
    };
    let shown: Vec<bool> = (0..lattice.len() as u32)
        .map(|particle| {
            let at = particle as usize;
            if !lattice.has_cells() {
                return lattice.organ[at] == organ;
            }
            lattice.cell_organ[at] == organ
                && lattice.cell_fill[at] >= LEAST_FILL
                && topology.whole_cell(lattice, particle).is_some()
        })
        .collect();
    let moved_with = |one: u32, other: u32, direction: usize| {
        let [a, b] = [one, other].map(|particle| displacements_mm[particle as usize]);
        let gap = f64::from(LEAST_GAP) * lattice.pitch * 1e3;
        topology.alive()[one as usize] >> direction & 1 == 1
            && (0..3).all(|axis| f64::from((a[axis] - b[axis]).abs()) < gap)
    };
    let half = 0.5 * lattice.grid.affine.linear();
    let mut mesh = TriangleMesh::default();
    for particle in (0..lattice.len() as u32).filter(|&particle| shown[particle as usize]) {
        let corners: [Vector3; 8] = match lattice.cell(particle) {
            Some(corners) => corners.map(place),
            None => {
                let middle = place(particle);
                let sign = |corner: usize, axis: usize| if corner >> axis & 1 == 1 { 1.0 } else { -1.0 };
                std::array::from_fn(|corner| middle + half * Vector3::from_fn(|axis, _| sign(corner, axis)))
            }
        };
        for axis in 0..3 {
            for side in 0..2_usize {
                let mut offset = [0; 3];
                offset[axis] = 2 * side as i32 - 1;
                let direction = direction_of(offset);
                let hidden = lattice.neighbour(particle, direction).is_some_and(|other| {
                    shown[other as usize] && (lattice.has_cells() || moved_with(particle, other, direction))
                });
                if !hidden {
                    add_face(&mut mesh, lattice, &corners, axis, side);
                }
            }
        }
    }
    mesh
}

/// Adds one face of a voxel, seen from outside.
fn add_face(mesh: &mut TriangleMesh, lattice: &Lattice, corners: &[Vector3; 8], axis: usize, side: usize) {
    let (b, c) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
    let base = side << axis;
    let mut quad = [base, base | b, base | b | c, base | c].map(|corner| corners[corner]);
    // Counter-clockwise from outside on the far side of a right-handed lattice; the other way round for each change.
    if (side == 0) != (lattice.grid.affine.determinant() < 0.0) {
        quad.reverse();
    }
    let normal = (quad[2] - quad[0]).cross(&(quad[3] - quad[1]));
    let normal = normal.try_normalize(0.0).unwrap_or_default();
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(quad.map(|corner| [0, 1, 2].map(|i| corner[i] as f32)));
    mesh.normals.extend([[0, 1, 2].map(|i| normal[i] as f32); 4]);
    mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
}
