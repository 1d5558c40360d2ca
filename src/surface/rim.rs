//! Rims that have no room: where a place on the rim would make a triangle flat, pass through another, or meet another vertex.
//!
//! What the blade left joined decides the triangles, before the rim is placed: a straight rim can have three of its vertices in one
//! triangle, two vertices can want the same place, and where blades cross or end the skin of one side can reach over to the other.
//! These stay where they are without what is known of their blade.

use std::collections::HashMap;

use rayon::prelude::*;

use super::embed::{Carrier, Embedding, Vertex};
use super::normals::Sheet;
use crate::geometry::Vector3;

/// Smallest area of a triangle at a rim [squared pitches]: a tenth of that of the smallest one between the places that crossings,
/// kept clear of the ends of their edges, can have.
const SMALLEST: f64 = 2e-5;

/// Numbers of the rims of an embedding that crowd the surface, ascending.
///
/// - `pitch_mm`: of its lattice \[mm\].
pub(super) fn crowded(embedding: &Embedding, triangles: &[[u32; 3]], pitch_mm: f64) -> Vec<u32> {
    if embedding.rims.is_empty() {
        return Vec::new();
    }
    let vertex = |number: u32| &embedding.vertices[number as usize];
    let flat = |triangle: &&[u32; 3]| -> bool {
        let corners = triangle.map(vertex);
        corners.iter().any(|corner| rim_of(corner).is_some()) && area(corners) < SMALLEST * pitch_mm.powi(2)
    };
    let mut found: Vec<u32> = triangles
        .par_iter()
        .filter(flat)
        .flat_map_iter(|triangle| triangle.map(|corner| rim_of(vertex(corner))).into_iter().flatten())
        .collect();
    found.extend(piercing(embedding, triangles, pitch_mm));
    let mut places: HashMap<[u32; 3], &Vertex> = HashMap::new();
    for vertex in embedding.vertices.iter().filter(|vertex| vertex.sheet != Sheet::Skin || rim_of(vertex).is_some()) {
        // As files hold it: what welds vertices by place must not join these.
        if let Some(other) = places.insert(vertex.rest.map(|c| (c as f32).to_bits()), vertex) {
            found.extend([vertex, other].into_iter().filter_map(rim_of));
        }
    }
    found.par_sort_unstable();
    found.dedup();
    found
}

fn rim_of(vertex: &Vertex) -> Option<u32> {
    match vertex.carrier {
        Carrier::Rim { index } => Some(index),
        _ => None,
    }
}

/// Area [mm^2] between places rounded as files hold them.
fn area(corners: [&Vertex; 3]) -> f64 {
    let [a, b, c] = corners.map(|corner| Vector3::from(corner.rest.map(|c| f64::from(c as f32))));
    (b - a).cross(&(c - a)).norm() / 2.0
}

/// Rims of triangles that pass through others: of an edge and a triangle without a common vertex, one of them at a rim.
fn piercing(embedding: &Embedding, triangles: &[[u32; 3]], pitch_mm: f64) -> Vec<u32> {
    let at = |number: u32| Vector3::from(embedding.vertices[number as usize].rest);
    let rims = |corners: &[u32]| -> Vec<u32> {
        corners.iter().filter_map(|&corner| rim_of(&embedding.vertices[corner as usize])).collect()
    };
    let cells = |corners: &[u32]| {
        let bound = |pick: fn(f64, f64) -> f64| {
            let first = at(corners[0]);
            let bound = corners[1..].iter().fold(first, |bound, &corner| bound.zip_map(&at(corner), pick));
            bound.map(|c| (c / pitch_mm).floor() as i64)
        };
        let (low, high) = (bound(f64::min), bound(f64::max));
        (low.z..=high.z).flat_map(move |z| (low.y..=high.y).flat_map(move |y| (low.x..=high.x).map(move |x| [x, y, z])))
    };
    let mut near: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    for triangle in triangles.iter().filter(|triangle| !rims(*triangle).is_empty()) {
        for cell in cells(triangle) {
            near.entry(cell).or_default();
        }
    }
    let beside: Vec<u32> = (0..triangles.len() as u32)
        .into_par_iter()
        .filter(|&number| cells(&triangles[number as usize]).any(|cell| near.contains_key(&cell)))
        .collect();
    for &number in &beside {
        for cell in cells(&triangles[number as usize]) {
            if let Some(list) = near.get_mut(&cell) {
                list.push(number);
            }
        }
    }
    let found = beside.par_iter().flat_map_iter(|&number| {
        let triangle = triangles[number as usize];
        let mut found = Vec::new();
        for (one, two) in [(triangle[0], triangle[1]), (triangle[1], triangle[2]), (triangle[2], triangle[0])] {
            // The other triangle at the edge looks at it too.
            let others = cells(&[one, two]).filter_map(|cell| near.get(&cell)).flatten();
            for &other in others.filter(|_| one < two) {
                let corners = triangles[other as usize];
                if corners.contains(&one) || corners.contains(&two) {
                    continue;
                }
                let involved = rims(&[one, two, corners[0], corners[1], corners[2]]);
                if !involved.is_empty() && pierces(at(one), at(two), corners.map(at)) {
                    found.extend(involved);
                }
            }
        }
        found
    });
    found.collect()
}

/// Whether a segment passes through the inside of a triangle, by the signs of five volumes.
fn pierces(a: Vector3, b: Vector3, [p, q, r]: [Vector3; 3]) -> bool {
    let volume = |a: Vector3, b: Vector3, c: Vector3, d: Vector3| (b - a).cross(&(c - a)).dot(&(d - a));
    let (above, below) = (volume(p, q, r, a), volume(p, q, r, b));
    let around = [volume(a, b, p, q), volume(a, b, q, r), volume(a, b, r, p)];
    above * below < 0.0 && (around.iter().all(|volume| *volume > 0.0) || around.iter().all(|volume| *volume < 0.0))
}
