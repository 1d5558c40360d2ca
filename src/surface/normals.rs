//! Vertex normals from the triangles around each vertex.
//!
//! A vertex sums the area-weighted normals of its triangles. Cut faces stay crisp without splitting vertices (the
//! mesh stays closed by index): a skin vertex listens to triangles that are skin throughout, a seam vertex to triangles
//! that have no skin corner. Vertices on the rim, where the cut meets the skin, take the normal of the skin, so they listen to
//! triangles with two skin corners: those with one may lie on either side. A rim vertex without such a triangle takes the normals of
//! its neighbours on the skin and on the rest of the rim. Only a vertex without any of these listens to other triangles. Shading then
//! turns within the one row of triangles behind the rim.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::marching_cubes::sweep::split_layers;
use crate::geometry::CellSet;

/// Where the layers of a mesh begin: the triangles of layer `k` use the vertices of layers `k` and `k + 1` only, but for a few.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Layers<'a> {
    /// First vertex of each layer, and the end.
    pub(crate) vertices: &'a [u32],
    /// First triangle of each layer, and the end; one layer fewer than there are layers of vertices.
    pub(crate) triangles: &'a [u32],
    /// Triangles that may use others, ascending.
    pub(crate) turned: &'a [u32],
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

/// Weight of a skin vertex's triangle that may lie on the other side of a rim, and of any that does: they decide only where nothing
/// else does.
const DOUBTFUL_WEIGHT: f32 = 1.0 / 1_024.0;
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
    let on_rim = split_layers(&mut normals, &borders).into_par_iter().enumerate().flat_map_iter(|(task, part)| {
        let first_layer = task * LAYERS_PER_TASK;
        let end_layer = (first_layer + LAYERS_PER_TASK).min(layers.triangles.len() - 1);
        let from = layers.triangles[first_layer.saturating_sub(1).min(end_layer)] as usize;
        let to = layers.triangles[end_layer] as usize;
        let base = borders[task];
        // Those of the border belong to the task before.
        let own = layers.triangles[first_layer.min(end_layer)] as usize;
        let mut on_rim = Vec::new();
        let elsewhere =
            layers.turned.iter().map(|&number| number as usize).filter(|number| !(from..to).contains(number));
        for number in (from..to).chain(elsewhere) {
            let triangle = &triangles[number];
            let [a, b, c] = triangle.map(|v| positions[v as usize]);
            let normal = cross(sub(b, a), sub(c, a));
            let sheets = triangle.map(|v| sheet(v as usize));
            let [skin, seam] = [Sheet::Skin, Sheet::Seam].map(|kind| sheets.iter().filter(|&&s| s == kind).count());
            if skin + seam < 3 && (own..to).contains(&number) {
                on_rim.push(*triangle);
            }
            for (&vertex, sheet) in triangle.iter().zip(sheets) {
                let weight = match sheet {
                    Sheet::Skin if skin == 3 => 1.0,
                    Sheet::Seam if skin == 0 => 1.0,
                    Sheet::Rim if skin == 2 => 1.0,
                    Sheet::Skin if seam == 0 => DOUBTFUL_WEIGHT,
                    _ => MIXED_WEIGHT,
                };
                if let Some(sum) = part.get_mut(vertex.wrapping_sub(base) as usize) {
                    for axis in 0..3 {
                        sum[axis] += weight * normal[axis];
                    }
                }
            }
        }
        part.iter_mut().for_each(|normal| *normal = unit(*normal));
        on_rim
    });
    let on_rim: Vec<[u32; 3]> = on_rim.collect();
    borrow_on_rims(&mut normals, &on_rim, &sheet);
    normals
}

/// Gives rim vertices without a triangle of the skin the mean normal of their neighbours on the skin and on the rest of the rim.
///
/// - `on_rim`: the triangles with a corner on the rim.
fn borrow_on_rims(normals: &mut [[f32; 3]], on_rim: &[[u32; 3]], sheet: impl Fn(usize) -> Sheet) {
    let is = |vertex: u32, kind: Sheet| sheet(vertex as usize) == kind;
    let of_skin = on_rim.iter().filter(|triangle| triangle.iter().filter(|&&v| is(v, Sheet::Skin)).count() == 2);
    let known: CellSet<u32> = of_skin.flatten().copied().collect();
    let mut sums: BTreeMap<u32, [f32; 3]> = BTreeMap::new();
    for triangle in on_rim {
        for &vertex in triangle.iter().filter(|&&v| is(v, Sheet::Rim) && !known.contains(&v)) {
            let sum = sums.entry(vertex).or_default();
            for &near in triangle.iter().filter(|&&v| is(v, Sheet::Skin) || known.contains(&v)) {
                (0..3).for_each(|axis| sum[axis] += normals[near as usize][axis]);
            }
        }
    }
    for (vertex, sum) in sums.into_iter().filter(|(_, sum)| *sum != [0.0; 3]) {
        normals[vertex as usize] = unit(sum);
    }
}

pub(super) fn sub(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(super) fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(super) fn unit(v: [f32; 3]) -> [f32; 3] {
    // In f64: the square of a sliver's area leaves the range of f32.
    let length = v.iter().map(|&c| f64::from(c).powi(2)).sum::<f64>().sqrt();
    if length > 0.0 { v.map(|c| (f64::from(c) / length) as f32) } else { [0.0; 3] }
}
