//! Vertices at rest: where each was before anything moved, and which way is into the organ there.
//!
//! A mesh carries places and displacements, so rest is their difference. What lies between tissue and outside is the skin,
//! and vertices on faces of a cut are flagged by whoever made the mesh. Rims, where a face of a cut meets the skin, are
//! flagged too and known by the triangles of both kinds around them.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::geometry::{Point3, Vector3};
use crate::surface::mesh::TriangleMesh;

/// A surface at rest.
#[derive(Debug, Clone)]
pub struct RestSurface {
    /// Rest place of each vertex, RAS+ \[mm\].
    places: Vec<Point3>,
    /// Unit vector into the tissue on the vertex's own side, RAS+; zero where no triangle says.
    inward: Vec<Vector3>,
    /// True on faces of a cut, rims included.
    on_cut: Vec<bool>,
    /// The skin nearest to each vertex.
    skin: Vec<NearSkin>,
}

/// The skin as seen from a vertex.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct NearSkin {
    /// Way to it along the surface \[mm\]: 0 on the skin and on rims, infinite beyond the reach.
    pub(super) distance: f32,
    /// Unit vector into the organ there, RAS+; zero when the distance is infinite.
    pub(super) inward: Vector3,
}

const FAR: NearSkin = NearSkin { distance: f32::INFINITY, inward: Vector3::new(0.0, 0.0, 0.0) };

impl RestSurface {
    /// Takes a carried mesh back to rest.
    ///
    /// - `on_cut`: true for vertices on faces of a cut, rims included; false on the skin.
    /// - `reach` \[mm\]: how far from the skin the faces of a cut know of it.
    ///
    /// O(triangles).
    ///
    /// # Panics
    /// If the mesh has no displacements, or there is not one flag per vertex.
    pub fn new(mesh: &TriangleMesh, on_cut: &[bool], reach: f64) -> Self {
        assert_eq!(mesh.displacements.len(), mesh.positions.len(), "one displacement per vertex");
        assert_eq!(on_cut.len(), mesh.positions.len(), "one flag per vertex");
        let places: Vec<Point3> = mesh
            .positions
            .iter()
            .zip(&mesh.displacements)
            .map(|(place, moved)| Point3::from([0, 1, 2].map(|axis| f64::from(place[axis]) - f64::from(moved[axis]))))
            .collect();
        let mut skin = vec![Vector3::zeros(); places.len()];
        let mut cut = vec![Vector3::zeros(); places.len()];
        let mut cut_triangles = Vec::new();
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|corner| places[corner as usize]);
            let inward = (c - a).cross(&(b - a));
            // A row of triangles behind the rim may have corners of both kinds: it belongs to the skin.
            let sum = if triangle.iter().all(|&corner| on_cut[corner as usize]) {
                cut_triangles.push(*triangle);
                &mut cut
            } else {
                &mut skin
            };
            triangle.iter().for_each(|&corner| sum[corner as usize] += inward);
        }
        let unit = |sum: &mut Vector3| *sum = sum.try_normalize(0.0).unwrap_or_default();
        skin.iter_mut().for_each(unit);
        cut.iter_mut().for_each(unit);
        let from_skin = distances(&places, &cut_triangles, &skin, reach as f32);
        let inward =
            cut.iter().zip(&skin).map(|(cut, skin)| if *cut == Vector3::zeros() { *skin } else { *cut }).collect();
        Self { places, inward, on_cut: on_cut.to_vec(), skin: from_skin }
    }

    /// Number of vertices.
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// True when there is no vertex.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// Rest places, RAS+ \[mm\].
    pub fn places(&self) -> &[Point3] {
        &self.places
    }

    /// Unit vectors into the tissue on each vertex's own side, RAS+; zero where no triangle says.
    pub(super) fn inward(&self) -> &[Vector3] {
        &self.inward
    }

    pub(super) fn on_cut(&self) -> &[bool] {
        &self.on_cut
    }

    pub(super) fn near_skin(&self) -> &[NearSkin] {
        &self.skin
    }
}

/// Distance of each vertex from the skin along the edges of the faces of a cut: Dijkstra's algorithm from the rims.
fn distances(places: &[Point3], cut: &[[u32; 3]], skin: &[Vector3], reach: f32) -> Vec<NearSkin> {
    let on_skin =
        |inward: &Vector3| if *inward == Vector3::zeros() { FAR } else { NearSkin { distance: 0.0, inward: *inward } };
    let mut near: Vec<NearSkin> = skin.iter().map(on_skin).collect();
    let mut edges: Vec<[u32; 2]> =
        cut.iter().flat_map(|&[a, b, c]| [[a, b], [b, a], [b, c], [c, b], [c, a], [a, c]]).collect();
    edges.sort_unstable();
    edges.dedup();
    // Distances are not negative, so their bits are ordered as they are; equal ones go by vertex.
    let mut open: BinaryHeap<Reverse<(u32, u32)>> = edges
        .chunk_by(|a, b| a[0] == b[0])
        .map(|of| of[0][0])
        .filter(|&v| near[v as usize].distance == 0.0)
        .map(|v| Reverse((0, v)))
        .collect();
    while let Some(Reverse((bits, vertex))) = open.pop() {
        let here = near[vertex as usize];
        if here.distance.to_bits() != bits {
            continue;
        }
        let first = edges.partition_point(|edge| edge[0] < vertex);
        for &[_, other] in edges[first..].iter().take_while(|edge| edge[0] == vertex) {
            let length = (places[other as usize] - places[vertex as usize]).norm() as f32;
            let distance = here.distance + length;
            if distance <= reach && distance < near[other as usize].distance {
                near[other as usize] = NearSkin { distance, inward: here.inward };
                open.push(Reverse((distance.to_bits(), other)));
            }
        }
    }
    near
}
