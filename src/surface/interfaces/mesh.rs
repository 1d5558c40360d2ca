//! The borders of organs in one frame, as meshes: closed round one organ, or wall by wall.

use rayon::prelude::*;

use super::MultiSurface;
use super::face::OUTSIDE;
use crate::surface::mesh::TriangleMesh;
use crate::surface::normals::{Layers, Sheet, vertex_normals};

/// The borders of all organs in a frame.
#[derive(Debug, Clone)]
pub struct MultiMesh<'a> {
    pub(super) surface: &'a MultiSurface,
    /// Vertices, RAS+ \[mm\]. Shape `[vertices, 3]`.
    pub positions: Vec<[f32; 3]>,
    /// Displacements from rest, RAS+ \[mm\]. Shape `[vertices, 3]`.
    pub displacements: Vec<[f32; 3]>,
}

/// The border between two organs, or an organ and the outside.
#[derive(Debug, Clone, PartialEq)]
pub struct Interface {
    /// Organ behind its triangles.
    pub inside: u8,
    /// Organ in front of them, or [`OUTSIDE`].
    pub outside: u8,
    /// Open where other borders go on: vertices there have the same places, bit for bit.
    pub mesh: TriangleMesh,
    /// Whether each vertex lies on a face of a cut (its rim included).
    pub on_cut: Vec<bool>,
}

impl MultiMesh<'_> {
    /// The closed border of an organ, looking outward; empty when there is nothing of it.
    ///
    /// Its vertices have the places of those of its neighbours, bit for bit, but where the organ touches itself in a point: there it has
    /// one vertex for each side, a little back from the point, so that importers which weld by place leave them apart.
    pub fn organ_mesh(&self, organ: u8) -> TriangleMesh {
        let of_organ = self.surface.triangles.iter().zip(&self.surface.sides).filter_map(|(&triangle, sides)| {
            let [a, b, c] = triangle;
            match sides.iter().position(|&side| side == organ)? {
                0 => Some(([a, b, c], sides[1])),
                _ => Some(([a, c, b], sides[0])),
            }
        });
        let (mut triangles, beyond): (Vec<[u32; 3]>, Vec<u8>) = of_organ.unzip();
        // Walls shade like the faces of a cut: apart from the skin.
        let mut bits = vec![0_u8; self.positions.len()];
        for (triangle, &beyond) in triangles.iter().zip(&beyond) {
            for &corner in triangle {
                let corner = corner as usize;
                bits[corner] |= if beyond == OUTSIDE { self.surface.sheets[corner] as u8 } else { Sheet::Seam as u8 };
            }
        }
        let (mut vertices, mut of) = compacted(self.positions.len(), &mut triangles);
        let fans = self.part_touching(&mut vertices, &mut of, &mut triangles);
        let sheets: Vec<Sheet> = vertices.iter().map(|&vertex| sheet_of(bits[vertex as usize])).collect();
        let mut mesh = self.mesh_of(&vertices, triangles);
        fans.iter().for_each(|fan| stand_back(&mut mesh, fan));
        mesh.normals = normals(&mesh, |vertex| sheets[vertex]);
        mesh
    }

    /// Every border once, in the order of the organs.
    pub fn interfaces(&self) -> Vec<Interface> {
        let surface = self.surface;
        let mut pairs = surface.sides.clone();
        pairs.par_sort_unstable();
        pairs.dedup();
        let of_skin = self.skin_normals();
        let interface = |&[inside, outside]: &[u8; 2]| {
            let own = surface.triangles.iter().zip(&surface.sides).filter(|(_, sides)| **sides == [inside, outside]);
            let mut triangles: Vec<[u32; 3]> = own.map(|(triangle, _)| *triangle).collect();
            let (vertices, _) = compacted(self.positions.len(), &mut triangles);
            let mut mesh = self.mesh_of(&vertices, triangles);
            let skin = outside == OUTSIDE;
            mesh.normals = match skin {
                true => vertices.iter().map(|&vertex| of_skin[vertex as usize]).collect(),
                false => normals(&mesh, |_| Sheet::Skin),
            };
            let on_cut =
                vertices.iter().map(|&vertex| skin && surface.sheets[vertex as usize] != Sheet::Skin).collect();
            Interface { inside, outside, mesh, on_cut }
        };
        pairs.par_iter().map(interface).collect()
    }

    /// Unit normals of all that borders on the outside, across walls that end there; zero elsewhere.
    fn skin_normals(&self) -> Vec<[f32; 3]> {
        let surface = self.surface;
        let skin = surface.triangles.iter().zip(&surface.sides).filter(|(_, sides)| sides[1] == OUTSIDE);
        let mut triangles: Vec<[u32; 3]> = skin.map(|(triangle, _)| *triangle).collect();
        let (vertices, _) = compacted(self.positions.len(), &mut triangles);
        let mesh = self.mesh_of(&vertices, triangles);
        let mut all = vec![[0.0; 3]; self.positions.len()];
        let own = normals(&mesh, |vertex| surface.sheets[vertices[vertex] as usize]);
        vertices.iter().zip(own).for_each(|(&vertex, normal)| all[vertex as usize] = normal);
        all
    }

    fn mesh_of(&self, vertices: &[u32], triangles: Vec<[u32; 3]>) -> TriangleMesh {
        let pick = |values: &[[f32; 3]]| vertices.iter().map(|&vertex| values[vertex as usize]).collect();
        TriangleMesh {
            positions: pick(&self.positions),
            displacements: pick(&self.displacements),
            triangles,
            ..TriangleMesh::default()
        }
    }

    /// Gives every side its own vertex where an organ touches itself, and tells the triangles around each of these, by number and
    /// corner.
    ///
    /// - `vertices`: number in the whole of each vertex; `of`: the inverse; both as [`compacted`] gives them.
    fn part_touching(
        &self,
        vertices: &mut Vec<u32>,
        of: &mut [u32],
        triangles: &mut [[u32; 3]],
    ) -> Vec<Vec<(u32, usize)>> {
        let mut parted = Vec::new();
        let cones: Vec<u32> =
            self.surface.cones.iter().map(|&cone| of[cone as usize]).filter(|&cone| cone != UNUSED).collect();
        if cones.is_empty() {
            return parted;
        }
        let mut slot = vec![UNUSED; vertices.len()];
        (0..).zip(&cones).for_each(|(at, &cone)| slot[cone as usize] = at);
        // Triangle and corner, cone by cone; the corners of a triangle in one cell name one centre only.
        let mut around: Vec<Vec<(u32, usize)>> = vec![Vec::new(); cones.len()];
        for (number, triangle) in (0..).zip(triangles.iter()) {
            for (corner, &vertex) in triangle.iter().enumerate() {
                if slot[vertex as usize] != UNUSED {
                    around[slot[vertex as usize] as usize].push((number, corner));
                }
            }
        }
        for (cone, mut left) in cones.into_iter().zip(around) {
            // Fans: from one triangle on, the one whose first corner after the centre is the last corner of this one.
            let mut fans = Vec::new();
            while let Some(start) = left.pop() {
                let corner_after = |(number, corner): (u32, usize), step: usize, triangles: &[[u32; 3]]| {
                    triangles[number as usize][(corner + step) % 3]
                };
                let mut fan = vec![start];
                let mut open = corner_after(start, 2, triangles);
                while let Some(at) = left.iter().position(|&other| corner_after(other, 1, triangles) == open) {
                    let next = left.swap_remove(at);
                    open = corner_after(next, 2, triangles);
                    fan.push(next);
                }
                if !fans.is_empty() {
                    let own = vertices.len() as u32;
                    vertices.push(vertices[cone as usize]);
                    fan.iter().for_each(|&(number, corner)| triangles[number as usize][corner] = own);
                }
                fans.push(fan);
            }
            if fans.len() > 1 {
                parted.append(&mut fans);
            }
        }
        parted
    }
}

/// How far the sides of an organ that touches itself stand back from the point, as a fraction of the way to what is around it.
const STAND_BACK: f32 = 0.004;

/// Draws the vertex that a fan of triangles has in common towards the middle of the fan's border.
///
/// - `fan`: number of each triangle, and which of its corners that vertex is.
fn stand_back(mesh: &mut TriangleMesh, fan: &[(u32, usize)]) {
    let around = |&(number, corner): &(u32, usize)| mesh.triangles[number as usize][(corner + 1) % 3] as usize;
    let (number, corner) = fan[0];
    let vertex = mesh.triangles[number as usize][corner] as usize;
    for axis in 0..3 {
        let sum: f32 = fan.iter().map(|at| mesh.positions[around(at)][axis] - mesh.positions[vertex][axis]).sum();
        mesh.positions[vertex][axis] += STAND_BACK * sum / fan.len() as f32;
    }
}

const UNUSED: u32 = u32::MAX;

/// Numbers the vertices that triangles use, in their order: the old number of each new one, and the new number of each old one.
fn compacted(count: usize, triangles: &mut [[u32; 3]]) -> (Vec<u32>, Vec<u32>) {
    let mut new = vec![UNUSED; count];
    triangles.iter().flatten().for_each(|&vertex| new[vertex as usize] = 0);
    let mut vertices = Vec::new();
    for (vertex, number) in new.iter_mut().enumerate().filter(|(_, number)| **number != UNUSED) {
        *number = vertices.len() as u32;
        vertices.push(vertex as u32);
    }
    triangles.iter_mut().flatten().for_each(|vertex| *vertex = new[*vertex as usize]);
    (vertices, new)
}

fn sheet_of(bits: u8) -> Sheet {
    match bits {
        0b10 => Sheet::Seam,
        0b11 => Sheet::Rim,
        _ => Sheet::Skin,
    }
}

fn normals(mesh: &TriangleMesh, sheet: impl Fn(usize) -> Sheet + Sync) -> Vec<[f32; 3]> {
    let (vertices, triangles) = (mesh.positions.len() as u32, mesh.triangles.len() as u32);
    let layers = Layers { vertices: &[0, vertices, vertices], triangles: &[0, triangles], turned: &[] };
    vertex_normals(&mesh.positions, &mesh.triangles, layers, sheet)
}
