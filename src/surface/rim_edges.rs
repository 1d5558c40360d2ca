//! Edges across the rim of a cut, turned so that they lie along it.
//!
//! Triangles are drawn before the places on the rim are known. Where a way leads straight from the inner of a cut to a crossing of the skin, and
//! that crossing lies off the rim after all, their edge leads across the rim, with a pit beside it. The other diagonal of the two
//! triangles at such an edge leads from rim to rim.

use rayon::prelude::*;

use super::embed::{Embedding, Vertex};
use super::normals::Sheet;
use super::rim::{Conflict, SMALLEST, area, crowded};
use crate::geometry::{CellMap, CellSet, Vector3};

/// A place that may be on the rim lies in a pit when it is so far behind the edge that would pass it by [pitches].
const PIT: f64 = 0.5;

/// Two triangles whose common edge is turned.
struct Turn {
    /// Their numbers.
    numbers: [usize; 2],
    before: [[u32; 3]; 2],
    after: [[u32; 3]; 2],
    /// The new edge.
    edge: [u32; 2],
    /// Where the old one ended in the face of the cut.
    face: u32,
}

/// Turns the edges that lead across the rim, where there is room. The numbers of the triangles beside them, ascending.
///
/// - `alike`: whether two triangles, by their numbers, may change places.
/// - `known`: conflicts that there were before.
/// - `pitch_mm`: of the lattice \[mm\].
pub(super) fn turn(
    embedding: &mut Embedding,
    triangles: &mut [[u32; 3]],
    alike: impl Fn(usize, usize) -> bool + Sync,
    known: &[Conflict],
    pitch_mm: f64,
) -> Vec<u32> {
    if embedding.rims.is_empty() {
        return Vec::new();
    }
    let mut turns = turns(embedding, triangles, alike, pitch_mm);
    for turn in &turns {
        turn.numbers.into_iter().zip(turn.after).for_each(|(number, corners)| triangles[number] = corners);
    }
    while !turns.is_empty() {
        let conflicts = crowded(embedding, triangles, pitch_mm);
        let new: CellSet<usize> =
            conflicts.iter().filter(|conflict| !known.contains(conflict)).flat_map(Conflict::rims).collect();
        let is_in_conflict = |turn: &Turn| {
            let mut rims =
                turn.after.as_flattened().iter().filter_map(|&corner| embedding.vertices[corner as usize].rim());
            rims.any(|rim| new.contains(&(rim as usize)))
        };
        let (back, stay): (Vec<Turn>, Vec<Turn>) = turns.into_iter().partition(is_in_conflict);
        turns = stay;
        for turn in &back {
            turn.numbers.into_iter().zip(turn.before).for_each(|(number, corners)| triangles[number] = corners);
        }
        if back.is_empty() {
            break;
        }
    }
    // What was to be on the rim is behind it now.
    for turn in &turns {
        embedding.vertices[turn.face as usize].sheet = Sheet::Seam;
    }
    let mut turned: Vec<u32> = turns.iter().flat_map(|turn| turn.numbers.map(|number| number as u32)).collect();
    turned.sort_unstable();
    turned
}

fn turns(
    embedding: &Embedding,
    triangles: &[[u32; 3]],
    alike: impl Fn(usize, usize) -> bool + Sync,
    pitch_mm: f64,
) -> Vec<Turn> {
    let vertex = |number: u32| &embedding.vertices[number as usize];
    let part = |number: u32| Part::of(embedding, number);
    // Of each edge across the rim, from skin to face, the triangles beside it, each with its third corner, and whether it has the edge in
    // that direction.
    let mut across = CellMap::<[u32; 2], Vec<(usize, u32, bool)>>::default();
    let crossing = triangles.par_iter().enumerate().flat_map_iter(|(number, &[a, b, c])| {
        let edges = [(a, b, c), (b, c, a), (c, a, b)].into_iter();
        edges.filter_map(move |(from, to, third)| match (part(from), part(to), part(third)) {
            (Part::Skin, Part::Face | Part::Plain, Part::Rim) | (Part::Plain, Part::Face, Part::Rim) => {
                Some(([from, to], (number, third, true)))
            }
            (Part::Face | Part::Plain, Part::Skin, Part::Rim) | (Part::Face, Part::Plain, Part::Rim) => {
                Some(([to, from], (number, third, false)))
            }
            _ => None,
        })
    });
    for (edge, side) in crossing.collect::<Vec<_>>() {
        across.entry(edge).or_default().push(side);
    }
    let mut quads: Vec<_> = across.into_iter().filter(|(_, sides)| sides.len() == 2).collect();
    quads.sort_unstable_by_key(|(edge, _)| *edge);
    let behind = |number: u32, edge: [u32; 2]| {
        let [from, to] = edge.map(|end| Vector3::from(vertex(end).rest));
        let way = to - from;
        way.cross(&(Vector3::from(vertex(number).rest) - from)).norm() / way.norm()
    };
    let [skins, faces] = [0, 1].map(|end| quads.iter().map(|(edge, _)| edge[end]).collect());
    let out_of_skin = normals_of(embedding, triangles, &skins, Part::Face);
    let out_of_face = normals_of(embedding, triangles, &faces, Part::Skin);
    let turns: Vec<Turn> = quads
        .par_iter()
        .filter_map(|([skin, face], sides)| {
            // Counter-clockwise: skin, b, face, a.
            let [a, b] = [true, false].map(|way| sides.iter().find(|side| side.2 == way));
            let (&(one, a, _), &(two, b, _)) = (a?, b?);
            let after = [[a, *skin, b], [b, *face, a]];
            let has_room = after.iter().all(|corners| area(corners.map(vertex)) > SMALLEST * pitch_mm.powi(2));
            let [above, below] = after.map(|corners| normal(corners.map(vertex)));
            let looks_out = above.dot(&out_of_skin[skin]) > 0.0 && below.dot(&out_of_face[face]) > 0.0;
            let is_deep = part(*face) == Part::Face || behind(*face, [a, b]) > PIT * pitch_mm;
            (a != b && has_room && looks_out && is_deep && alike(one, two)).then(|| {
                let before = [triangles[one], triangles[two]];
                Turn { numbers: [one, two], before, after, edge: [a.min(b), a.max(b)], face: *face }
            })
        })
        .collect();
    let wanted: CellSet<[u32; 2]> = turns.iter().map(|turn| turn.edge).collect();
    let there = triangles.par_iter().flat_map_iter(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
    let there = there.map(|[a, b]| [a.min(b), a.max(b)]).filter(|edge| wanted.contains(edge));
    let mut taken: CellSet<[u32; 2]> = if wanted.is_empty() { CellSet::default() } else { there.collect() };
    let mut turned = CellSet::<usize>::default();
    let mut kept = Vec::with_capacity(turns.len());
    for turn in turns {
        if turn.numbers.iter().all(|number| !turned.contains(number)) && taken.insert(turn.edge) {
            turned.extend(turn.numbers);
            kept.push(turn);
        }
    }
    kept
}

/// Where a vertex lies.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Part {
    Skin,
    Face,
    Rim,
    /// A place on the rim that is not known to be: it may lie in the face, or on the skin.
    Plain,
}

impl Part {
    fn of(embedding: &Embedding, number: u32) -> Self {
        let vertex = &embedding.vertices[number as usize];
        match vertex.shown_on() {
            Sheet::Skin => Self::Skin,
            Sheet::Seam => Self::Face,
            Sheet::Rim if vertex.rim().is_some_and(|rim| embedding.rims[rim as usize].is_plain) => Self::Plain,
            Sheet::Rim => Self::Rim,
        }
    }
}

/// Which way the surface looks round some vertices, by the triangles that have no corner in the other part.
fn normals_of(
    embedding: &Embedding,
    triangles: &[[u32; 3]],
    vertices: &CellSet<u32>,
    other: Part,
) -> CellMap<u32, Vector3> {
    let mut sums: CellMap<u32, Vector3> = vertices.iter().map(|&vertex| (vertex, Vector3::zeros())).collect();
    let around = triangles.par_iter().filter(|triangle| {
        triangle.iter().any(|corner| vertices.contains(corner))
            && triangle.iter().all(|&corner| Part::of(embedding, corner) != other)
    });
    for triangle in around.collect::<Vec<_>>() {
        let normal = normal(triangle.map(|corner| &embedding.vertices[corner as usize]));
        for corner in triangle {
            if let Some(sum) = sums.get_mut(corner) {
                *sum += normal;
            }
        }
    }
    sums
}

/// Twice the area long.
fn normal(corners: [&Vertex; 3]) -> Vector3 {
    let [a, b, c] = corners.map(|corner| Vector3::from(corner.rest));
    (b - a).cross(&(c - a))
}
