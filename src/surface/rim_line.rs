//! The rim of a cut as a line: where a place on it would lie half-way between its neighbours.

use rayon::prelude::*;

use super::embed::Embedding;
use super::normals::Sheet;
use crate::geometry::CellMap;

/// For some rims, by their numbers, the middle between the two places of the rim beside each, RAS+ \[mm\]; those without two such places
/// have none.
pub(super) fn between(embedding: &Embedding, triangles: &[[u32; 3]], asked: &[bool]) -> CellMap<u32, [f64; 3]> {
    let rim_of = |vertex: u32| embedding.vertices[vertex as usize].rim();
    let in_face = |vertex: u32| embedding.vertices[vertex as usize].shown_on() == Sheet::Seam;
    let is_asked = |vertex: &u32| rim_of(*vertex).is_some_and(|rim| asked[rim as usize]);
    let around: Vec<&[u32; 3]> = triangles.par_iter().filter(|triangle| triangle.iter().any(is_asked)).collect();
    // Of every edge from an asked place to one that is not in the face of the cut: how many triangles it has, and how many of them have
    // their third corner in that face.
    let mut edges = CellMap::<[u32; 2], [u32; 2]>::default();
    for &&[a, b, c] in &around {
        for (from, to, third) in [(a, b, c), (b, c, a), (c, a, b), (b, a, c), (c, b, a), (a, c, b)] {
            if is_asked(&from) && !in_face(to) {
                let count = edges.entry([from, to]).or_default();
                *count = [count[0] + 1, count[1] + u32::from(in_face(third))];
            }
        }
    }
    // The rim runs where the face of the cut ends.
    let mut beside = CellMap::<u32, Vec<u32>>::default();
    for ([from, to], count) in edges {
        if count == [2, 1] {
            beside.entry(from).or_default().push(to);
        }
    }
    let middle = |(vertex, beside): (u32, Vec<u32>)| {
        let &[one, other] = &beside[..] else { return None };
        let [one, other] = [one, other].map(|vertex| embedding.vertices[vertex as usize].rest);
        Some((rim_of(vertex)?, [0, 1, 2].map(|axis| 0.5 * (one[axis] + other[axis]))))
    };
    beside.into_iter().filter_map(middle).collect()
}
