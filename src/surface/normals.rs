//! Vertex normals from the triangles around each vertex.
//!
//! A vertex sums the area-weighted normals of its triangles. Cut faces stay crisp without splitting vertices (the
//! mesh stays closed by index): a skin vertex listens to triangles that are skin throughout, a seam vertex to triangles
//! that are seam throughout, and only a vertex without such a triangle listens to the mixed ones. Vertices on the rim,
//! where the cut meets the skin, belong to both sides: triangles on either side count as pure, and the vertex itself
//! takes the normal of the skin. Shading then turns within the one row of triangles behind the rim.

use rayon::prelude::*;

use super::marching_cubes::sweep::split_layers;

/// Where the layers of a mesh begin: the triangles of layer `k` use the vertices of layers `k` and `k + 1` only.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Layers<'a> {
    /// First vertex of each layer, and the end.
    pub(crate) vertices: &'a [u32],
    /// First triangle of each layer, and the end; one layer fewer than there are layers of vertices.
    pub(crate) triangles: &'a [u32],
}

/// Which sheets of the surface a vertex belongs to: one bit for the skin, one for the faces of a cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u8)]
pub enum Sheet {
    /// Between tissue and outside.
    #[default]
    Skin = 0b01,
    /// On a face of a cut.
    Seam = 0b10,
    /// Where the two meet.
    Rim = 0b11,
}

/// Layers of vertices that one task takes: a triangle on the border of two tasks is computed by both.
const LAYERS_PER_TASK: usize = 8;

/// Weight of a triangle with skin and seam corners: it decides only where nothing else does.
const MIXED_WEIGHT: f32 = 1.0 / 1_048_576.0;

/// Unit normals, outward. A vertex without area around it gets (0, 0, 0).
///
/// Each vertex adds its triangles in their order in the mesh, so the bits do not depend on the thread count.
pub(crate) fn vertex_normals(
    positions: &[[f32; 3]],
    triangles: &[[u32; 3]],
    layers: Layers<'_>,
    sheet: impl Fn(usize) -> Sheet + Sync,
) -> Vec<[f32; 3]> {
    let mut normals = vec![[0.0_f32; 3]; positions.len()];
    let count = layers.vertices.len() - 1;
    let borders: Vec<u32> =
        (0..count).step_by(LAYERS_PER_TASK).chain([count]).map(|layer| layers.vertices[layer]).collect();
    split_layers(&mut normals, &borders).into_par_iter().enumerate().for_each(|(task, part)| {
        let first_layer = task * LAYERS_PER_TASK;
        let end_layer = (first_layer + LAYERS_PER_TASK).min(layers.triangles.len() - 1);
        let from = layers.triangles[first_layer.saturating_sub(1).min(end_layer)] as usize;
        let to = layers.triangles[end_layer] as usize;
        let base = borders[task];
        for triangle in &triangles[from..to] {
            let [a, b, c] = triangle.map(|v| positions[v as usize]);
            let normal = cross(sub(b, a), sub(c, a));
            let sheets = triangle.map(|v| sheet(v as usize));
            let shared = sheets.iter().fold(0b11, |shared, &sheet| shared & sheet as u8);
            for (&vertex, sheet) in triangle.iter().zip(sheets) {
                let listens_to = if sheet == Sheet::Rim { Sheet::Skin } else { sheet };
                let weight = if shared & listens_to as u8 != 0 { 1.0 } else { MIXED_WEIGHT };
                if let Some(sum) = part.get_mut(vertex.wrapping_sub(base) as usize) {
                    for axis in 0..3 {
                        sum[axis] += weight * normal[axis];
                    }
                }
            }
        }
        part.iter_mut().for_each(|normal| *normal = unit(*normal));
    });
    normals
}

fn sub(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(v: [f32; 3]) -> [f32; 3] {
    // In f64: the square of a sliver's area leaves the range of f32.
    let length = v.iter().map(|&c| f64::from(c).powi(2)).sum::<f64>().sqrt();
    if length > 0.0 { v.map(|c| (f64::from(c) / length) as f32) } else { [0.0; 3] }
}
