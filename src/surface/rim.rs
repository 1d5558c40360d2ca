//! Rims that have no room: where a place on the rim would make a triangle flat, pass through another, or meet another vertex.
//!
//! What the blade left joined decides the triangles, before the rim is placed: a straight rim can have three of its vertices in one
//! triangle, two vertices can want the same place, and where blades cross or end the skin of one side can reach over to the other.
//! Of each such conflict one rim gives way ([`make_room`]): it goes half-way between its neighbours on the rim, which mostly are where blade and
//! skin meet, and if that does not help, to where it is without what is known of its blade. Then all are looked at again: a
//! vertex that gives way often makes room for the others.

use rayon::prelude::*;

use super::embed::{Embedding, Vertex};
use super::junction::{RimCrossing, RimPlace};
use super::normals::Sheet;
use super::rim_line::between;
use super::seam::SeamEdge;
use crate::geometry::{CellMap, Vector3};
use crate::lattice::Lattice;

/// Smallest area of a triangle at a rim [squared pitches]: a tenth of that of the smallest one between crossings of the skin, which are
/// kept clear of the ends of their edges.
pub(super) const SMALLEST: f64 = 2e-5;

/// Rims that crowd the surface together: of one triangle, of an edge and the triangle it passes through, or of one place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Conflict([u32; 5]);

/// No rim.
const NONE: u32 = u32::MAX;

impl Conflict {
    fn of(vertices: impl IntoIterator<Item = Option<u32>>) -> Self {
        let mut rims = [NONE; 5];
        rims.iter_mut().zip(vertices.into_iter().flatten()).for_each(|(place, rim)| *place = rim);
        Self(rims)
    }

    /// Their numbers in the embedding.
    pub(super) fn rims(&self) -> impl Iterator<Item = usize> + use<> {
        self.0.into_iter().filter(|&rim| rim != NONE).map(|rim| rim as usize)
    }
}

/// The rims of an embedding that crowd the surface.
///
/// - `pitch_mm`: of its lattice \[mm\].
pub(super) fn crowded(embedding: &Embedding, triangles: &[[u32; 3]], pitch_mm: f64) -> Vec<Conflict> {
    if embedding.rims.is_empty() {
        return Vec::new();
    }
    let vertex = |number: u32| &embedding.vertices[number as usize];
    let flat = |triangle: &&[u32; 3]| -> bool {
        let corners = triangle.map(vertex);
        corners.iter().any(|corner| corner.rim().is_some()) && area(corners) < SMALLEST * pitch_mm.powi(2)
    };
    let mut found: Vec<Conflict> = triangles
        .par_iter()
        .filter(flat)
        .map(|triangle| Conflict::of(triangle.map(|corner| vertex(corner).rim())))
        .collect();
    found.extend(piercing(embedding, triangles, pitch_mm));
    let mut places = CellMap::<[u32; 3], &Vertex>::default();
    for vertex in embedding.vertices.iter().filter(|vertex| vertex.sheet != Sheet::Skin || vertex.rim().is_some()) {
        // As files hold it: what welds vertices by place must not join these.
        if let Some(other) = places.insert(vertex.rest.map(|c| (c as f32 + 0.0).to_bits()), vertex) {
            found.push(Conflict::of([vertex, other].map(Vertex::rim)));
        }
    }
    found
}

/// Of the rims in each conflict lets one give way: that of most conflicts, then that which moved farthest. False when there was none that
/// could.
pub(super) fn make_room(
    conflicts: &[Conflict],
    (lattice, embedding, triangles): (&Lattice, &Embedding, &[[u32; 3]]),
    edges: &mut [SeamEdge],
    rim_crossings: &mut Vec<RimCrossing>,
) -> bool {
    // By their numbers in an embedding.
    let rims = || edges.iter().flat_map(|edge| &edge.rims);
    let moved: Vec<f32> = rim_crossings.iter().map(RimCrossing::moved).chain(rims().map(RimPlace::moved)).collect();
    let mut count = vec![0_u32; moved.len()];
    let movable = |conflict: &Conflict| conflict.rims().filter(|&rim| moved[rim] > 0.0);
    conflicts.iter().flat_map(movable).for_each(|rim| count[rim] += 1);
    let order = |&a: &usize, &b: &usize| count[a].cmp(&count[b]).then(moved[a].total_cmp(&moved[b])).then(a.cmp(&b));
    let mut yields = vec![false; moved.len()];
    for rim in conflicts.iter().filter_map(|conflict| movable(conflict).max_by(order)) {
        yields[rim] = true;
    }
    let between = between(embedding, triangles, &yields);
    let mut yielding = (0_u32..).zip(yields);
    // Steps from a grid point to between the neighbours of a rim.
    let steps = |rim: u32, from: [i64; 3]| {
        let index = lattice.grid.affine.index_of((*between.get(&rim)?).into());
        Some([0, 1, 2].map(|axis| (index[axis] - from[axis] as f64) as f32))
    };
    rim_crossings.retain_mut(|crossing| match yielding.next() {
        Some((rim, true)) => {
            let inside = crossing.inside(lattice.grid.shape);
            crossing.give_way(steps(rim, inside))
        }
        _ => true,
    });
    for edge in edges {
        let (low, axis) = (edge.low.map(|i| i64::from(i) - 1), edge.axis);
        for (rim, (number, _)) in edge.rims.iter_mut().zip(&mut yielding).filter(|(_, (_, yields))| *yields) {
            let mut corner = low;
            corner[usize::from(axis)] += i64::from(rim.end);
            rim.give_way(axis, steps(number, corner));
        }
    }
    conflicts.iter().any(|conflict| movable(conflict).next().is_some())
}

/// Area [mm^2] between places rounded as files hold them.
pub(super) fn area(corners: [&Vertex; 3]) -> f64 {
    let [a, b, c] = corners.map(|corner| Vector3::from(corner.rest.map(|c| f64::from(c as f32))));
    (b - a).cross(&(c - a)).norm() / 2.0
}

/// Rims of triangles that pass through others: of an edge and a triangle without a common vertex, one of them at a rim.
fn piercing(embedding: &Embedding, triangles: &[[u32; 3]], pitch_mm: f64) -> Vec<Conflict> {
    let at = |number: u32| Vector3::from(embedding.vertices[number as usize].rest);
    let rim = |corner: &u32| embedding.vertices[*corner as usize].rim();
    let at_rim = |corners: &[u32]| corners.iter().any(|corner| rim(corner).is_some());
    let place = |number: u32| at(number) / pitch_mm;
    let mut near = CellMap::<[i32; 3], Vec<u32>>::default();
    for triangle in triangles.iter().filter(|triangle| at_rim(*triangle)) {
        for cell in Room::of(&triangle.map(place)).cells() {
            near.entry(cell).or_default();
        }
    }
    let beside: Vec<(&[u32; 3], Room)> = triangles
        .par_iter()
        .map(|triangle| (triangle, Room::of(&triangle.map(place))))
        .filter(|(_, room)| room.cells().any(|cell| near.contains_key(&cell)))
        .collect();
    for (number, (_, room)) in (0..).zip(&beside) {
        for cell in room.cells() {
            if let Some(list) = near.get_mut(&cell) {
                list.push(number);
            }
        }
    }
    let found = beside.par_iter().flat_map_iter(|&(&[a, b, c], _)| {
        let mut found = Vec::new();
        // The other triangle at an edge looks at it too.
        for [one, two] in [[a, b], [b, c], [c, a]].into_iter().filter(|[one, two]| one < two) {
            let (edge, edge_at_rim) = (Room::of(&[one, two].map(place)), at_rim(&[one, two]));
            for cell in edge.cells() {
                for (other, room) in near.get(&cell).into_iter().flatten().map(|&other| &beside[other as usize]) {
                    if edge.meet_first_in(room, cell)
                        && !other.contains(&one)
                        && !other.contains(&two)
                        && (edge_at_rim || at_rim(*other))
                        && pierces(at(one), at(two), other.map(at))
                    {
                        found.push(Conflict::of([one, two].iter().chain(*other).map(rim)));
                    }
                }
            }
        }
        found
    });
    found.collect()
}

/// Box round some places [pitches], and its first and last cell.
struct Room {
    low: [f64; 3],
    high: [f64; 3],
    first: [i32; 3],
    last: [i32; 3],
}

impl Room {
    fn of(places: &[Vector3]) -> Self {
        let (low, high) = places.iter().fold((places[0], places[0]), |(low, high), c| (low.inf(c), high.sup(c)));
        let [first, last] = [low, high].map(|corner| corner.map(|c| c.floor() as i32).into());
        Self { low: low.into(), high: high.into(), first, last }
    }

    fn cells(&self) -> impl Iterator<Item = [i32; 3]> + use<> {
        let ([west, south, bottom], [east, north, top]) = (self.first, self.last);
        (bottom..=top).flat_map(move |z| (south..=north).flat_map(move |y| (west..=east).map(move |x| [x, y, z])))
    }

    /// Whether two boxes have a place in common and `cell` is the first of their cells in common: each pair is met once.
    fn meet_first_in(&self, other: &Self, cell: [i32; 3]) -> bool {
        let axes = [0, 1, 2];
        axes.iter().all(|&axis| self.low[axis] <= other.high[axis] && other.low[axis] <= self.high[axis])
            && axes.iter().all(|&axis| self.first[axis].max(other.first[axis]) == cell[axis])
    }
}

/// Whether a segment passes through the inside of a triangle, by the signs of five volumes.
fn pierces(a: Vector3, b: Vector3, [p, q, r]: [Vector3; 3]) -> bool {
    let volume = |a: Vector3, b: Vector3, c: Vector3, d: Vector3| (b - a).cross(&(c - a)).dot(&(d - a));
    // Most segments end on the side where they begin.
    if volume(p, q, r, a) * volume(p, q, r, b) >= 0.0 {
        return false;
    }
    let around = [volume(a, b, p, q), volume(a, b, q, r), volume(a, b, r, p)];
    around.iter().all(|volume| *volume > 0.0) || around.iter().all(|volume| *volume < 0.0)
}
