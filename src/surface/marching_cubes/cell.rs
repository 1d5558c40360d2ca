//! The surface inside one cell: contours of its six faces, closed into loops, then triangulated.
//!
//! ```text
//! for each face: for each contour from -> to:     next[from] = to, through a crack-front or rim vertex where there is one
//! while a crossing is left: follow next[] round   one loop
//! for each loop: the triangulation of least total squared diagonal length without a diagonal that lies in a face or leads from
//!                the inner of a cut to the skin, which would cut off its rim;
//!                a fan round the loop's centre where no such triangulation exists
//! ```
//! A diagonal inside a face could be drawn by the neighbour too, and the edge would then have four triangles; that is
//! why those are excluded. The choice depends on topology alone, and the two lips of a cut have the same nominal
//! places, so mirrored lips get mirrored diagonals and do not pass through each other.

use super::cube::{EDGE_FACES, EDGES, RING_EDGES, RINGS, corner_offset};
use super::face::{Between, Face, FaceCrossing};

/// The corners of a cell and the springs between them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Cell {
    /// Inside corners, one bit each.
    pub(crate) inside: u8,
    /// Living springs along the edges; read only where both ends are inside.
    pub(crate) alive: u16,
    /// Living springs along the face diagonals: bits `2 face` (ring corners 0-2) and `2 face + 1` (1-3).
    pub(crate) diagonals: u16,
    /// Edges that carry the two lips of a cut.
    pub(crate) cut: u16,
    pub(crate) rims: Rims,
}

/// Which crossings and rims of a cell lie where a cut meets the skin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Rims {
    /// Edges whose crossing of the skin does.
    pub(crate) crossings: u16,
    /// Rims that do not, but lie in the face of the cut behind it: bits `8 face + 2 ring_edge + ring_end`.
    pub(crate) behind: u64,
}

impl Rims {
    /// No cut meets the skin but at the rims themselves.
    pub(crate) const NONE: Self = Self { crossings: 0, behind: 0 };
}

/// A place in a cell where the surface has a vertex.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Site {
    /// Crossing of an edge between inside and outside.
    Skin { edge: u8 },
    /// One lip of a cut edge, on the side of its lower (0) or upper (1) end.
    Lip { edge: u8, end: u8 },
    /// Where a blade that came through a ring edge ended in a face.
    Front { face: u8, ring_edge: u8 },
    /// Where the cut meets the skin in a face, on one side of the blade: the ring edge of the lip and its end on the ring.
    Rim { face: u8, ring_edge: u8, ring_end: u8 },
    /// Centre of a loop.
    Centre { index: u8 },
}

const LIPS: u8 = 12;
const FRONTS: u8 = LIPS + 24;
const RIMS: u8 = FRONTS + 24;
const CENTRES: u8 = RIMS + 48;

impl Site {
    /// The site as a small number, for tables.
    pub(crate) const fn code(self) -> u8 {
        match self {
            Site::Skin { edge } => edge,
            Site::Lip { edge, end } => LIPS + 2 * edge + end,
            Site::Front { face, ring_edge } => FRONTS + 4 * face + ring_edge,
            Site::Rim { face, ring_edge, ring_end } => RIMS + 8 * face + 2 * ring_edge + ring_end,
            Site::Centre { index } => CENTRES + index,
        }
    }

    /// The inverse of [`Site::code`].
    pub(crate) const fn from_code(code: u8) -> Self {
        if code < LIPS {
            Site::Skin { edge: code }
        } else if code < FRONTS {
            Site::Lip { edge: (code - LIPS) / 2, end: (code - LIPS) % 2 }
        } else if code < RIMS {
            Site::Front { face: (code - FRONTS) / 4, ring_edge: (code - FRONTS) % 4 }
        } else if code < CENTRES {
            let rim = code - RIMS;
            Site::Rim { face: rim / 8, ring_edge: rim % 8 / 2, ring_end: rim % 2 }
        } else {
            Site::Centre { index: code - CENTRES }
        }
    }

    /// The cell faces it lies on, one bit each.
    const fn faces(self) -> u8 {
        match self {
            Site::Skin { edge } | Site::Lip { edge, .. } => EDGE_FACES[edge as usize],
            Site::Front { face, .. } | Site::Rim { face, .. } => 1 << face,
            Site::Centre { .. } => 0,
        }
    }

    /// Nominal place in quarters of a cell; the two sides of a cut have the same.
    const fn nominal(self) -> [i32; 3] {
        let (edge, inward) = match self {
            Site::Skin { edge } | Site::Lip { edge, .. } => return middle(edge),
            Site::Front { face, ring_edge } => (RING_EDGES[face as usize][ring_edge as usize], (face, ring_edge, 1)),
            Site::Rim { face, ring_edge, .. } => (RING_EDGES[face as usize][ring_edge as usize], (face, ring_edge, 2)),
            Site::Centre { .. } => return [2, 2, 2],
        };
        let (face, ring_edge, quarters) = inward;
        let opposite = middle(RING_EDGES[face as usize][(ring_edge as usize + 2) % 4]);
        let mut place = middle(edge);
        let mut axis = 0;
        while axis < 3 {
            place[axis] += (opposite[axis] - place[axis]) * quarters / 4;
            axis += 1;
        }
        place
    }

    /// A key that the two sides of a cut share.
    const fn unsided(self) -> u8 {
        match self {
            Site::Lip { edge, .. } => Site::Lip { edge, end: 0 }.code(),
            Site::Rim { face, ring_edge, .. } => Site::Rim { face, ring_edge, ring_end: 0 }.code(),
            _ => self.code(),
        }
    }
}

/// Middle of an edge in quarters of a cell.
const fn middle(edge: u8) -> [i32; 3] {
    let [low, high] = EDGES[edge as usize];
    let (low, high) = (corner_offset(low), corner_offset(high));
    let mut place = [0; 3];
    let mut axis = 0;
    while axis < 3 {
        place[axis] = 2 * (low[axis] + high[axis]) as i32;
        axis += 1;
    }
    place
}

/// The triangles of one cell, as codes of [`Site`], counter-clockwise seen from outside the tissue in a right-handed grid.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Patch {
    pub(crate) triangles: Vec<[u8; 3]>,
    /// Loops that needed a centre vertex, in the order of [`Site::Centre`].
    pub(crate) centres: Vec<Vec<u8>>,
}

impl Cell {
    /// A cell without any dead spring.
    pub(crate) const fn intact(inside: u8) -> Self {
        Self { inside, alive: 0xfff, diagonals: 0xfff, cut: 0, rims: Rims::NONE }
    }

    /// What the given face of this cell knows.
    pub(crate) fn face(&self, face: u8) -> Face {
        let mut result = Face { inside: 0, alive: 0, diagonals: (self.diagonals >> (2 * face) & 3) as u8, cut: 0 };
        for m in 0..4 {
            let edge = RING_EDGES[usize::from(face)][m];
            result.inside |= (self.inside >> RINGS[usize::from(face)][m] & 1) << m;
            result.alive |= ((self.alive >> edge & 1) << m) as u8;
            result.cut |= ((self.cut >> edge & 1) << m) as u8;
        }
        result
    }

    /// The surface inside this cell.
    pub(crate) fn patch(&self) -> Patch {
        let mut patch = Patch::default();
        let mut next = self.successors();
        for start in 0..CENTRES {
            if next[usize::from(start)] == NONE {
                continue;
            }
            let mut ring = Vec::with_capacity(12);
            let mut at = start;
            while next[usize::from(at)] != NONE {
                ring.push(at);
                at = std::mem::replace(&mut next[usize::from(at)], NONE);
            }
            debug_assert_eq!(at, start, "contours close");
            patch.add_loop(ring, self.rims);
        }
        patch
    }

    /// For each site its successor round the loop it is on, or [`NONE`].
    fn successors(&self) -> [u8; CENTRES as usize] {
        let mut next = [NONE; CENTRES as usize];
        for face in 0..6 {
            let seen_from_outside = face % 2 == 1;
            let state = self.face(face);
            for contour in state.contours() {
                let from = self.site(face, contour.from).code();
                let to = self.site(face, contour.to).code();
                // The ring is counter-clockwise seen from +axis; the surface looks out of the tissue, so its border in
                // a face runs the other way round.
                let (first, last) = if seen_from_outside { (to, from) } else { (from, to) };
                let between = state.between(contour).map(|between| match between {
                    Between::Front { edge } => Site::Front { face, ring_edge: edge },
                    Between::Rim { lip, .. } => {
                        Site::Rim { face, ring_edge: lip.edge, ring_end: u8::from(lip.corner != lip.edge) }
                    }
                });
                match between {
                    Some(site) => {
                        next[usize::from(first)] = site.code();
                        next[usize::from(site.code())] = last;
                    }
                    None => next[usize::from(first)] = last,
                }
            }
        }
        next
    }

    /// The site of a crossing on a face.
    fn site(&self, face: u8, crossing: FaceCrossing) -> Site {
        let edge = RING_EDGES[usize::from(face)][usize::from(crossing.edge)];
        let corner = RINGS[usize::from(face)][usize::from(crossing.corner)];
        let [low, high] = EDGES[usize::from(edge)];
        if self.inside >> low & self.inside >> high & 1 == 1 {
            Site::Lip { edge, end: u8::from(corner == high) }
        } else {
            Site::Skin { edge }
        }
    }
}

const NONE: u8 = u8::MAX;

/// Cost of a triangulation that would put a diagonal into a face.
const FORBIDDEN: u64 = u64::MAX;

/// Cost of a diagonal from the inner of a cut to the skin, which cuts off the rim between them: more than any length, and not taken.
const ACROSS_THE_RIM: u64 = 1 << 56;
/// Cost of a triangle between three places of the rim, which may be in line.
const ALONG_THE_RIM: u64 = 1 << 50;

/// What a site of a loop belongs to.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Part {
    Skin,
    Face,
    Rim,
}

fn parts(ring: &[u8], rims: Rims) -> Vec<Part> {
    let site = |at: usize| Site::from_code(ring[at % ring.len()]);
    let is_face = |at: usize| match site(at) {
        Site::Lip { .. } => true,
        Site::Rim { face, ring_edge, ring_end } => rims.behind >> (8 * face + 2 * ring_edge + ring_end) & 1 == 1,
        _ => false,
    };
    let part = |at: usize| match site(at) {
        Site::Lip { .. } | Site::Front { .. } => Part::Face,
        Site::Rim { .. } if is_face(at) => Part::Face,
        Site::Rim { .. } => Part::Rim,
        // Beside a lip the skin begins.
        Site::Skin { edge } if rims.crossings >> edge & 1 == 1 || is_face(at + ring.len() - 1) || is_face(at + 1) => {
            Part::Rim
        }
        _ => Part::Skin,
    };
    (0..ring.len()).map(part).collect()
}

/// Squared nominal length of a diagonal, with a tie-break that does not depend on where a loop starts.
fn diagonal_cost(one: u8, two: u8) -> u64 {
    let (one, two) = (Site::from_code(one), Site::from_code(two));
    if one.faces() & two.faces() != 0 {
        return FORBIDDEN;
    }
    let (a, b) = (one.nominal(), two.nominal());
    let squared: i32 = (0..3).map(|axis| (a[axis] - b[axis]).pow(2)).sum();
    let (low, high) = (one.unsided().min(two.unsided()), one.unsided().max(two.unsided()));
    // Fibonacci hashing of the pair: any fixed, well spread number will do.
    let spread = (u64::from(low) * 256 + u64::from(high)).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32;
    ((squared as u64) << 40) + spread
}

impl Patch {
    /// Fills a loop of sites.
    pub(crate) fn add_loop(&mut self, ring: Vec<u8>, rims: Rims) {
        debug_assert!(ring.len() >= 3, "a loop with {} vertices", ring.len());
        if !self.triangulate(&ring, rims) {
            let centre = Site::Centre { index: self.centres.len() as u8 }.code();
            for (at, &site) in ring.iter().enumerate() {
                self.triangles.push([site, ring[(at + 1) % ring.len()], centre]);
            }
            self.centres.push(ring);
        }
    }

    /// The cheapest triangulation of a polygon by dynamic programming over its sub-polygons; false when every one has a
    /// forbidden diagonal, or one across the rim.
    fn triangulate(&mut self, ring: &[u8], rims: Rims) -> bool {
        let n = ring.len();
        if n == 3 {
            self.triangles.push([ring[0], ring[1], ring[2]]);
            return true;
        }
        let parts = parts(ring, rims);
        let diagonal = |i: usize, j: usize| {
            let across = matches!((parts[i], parts[j]), (Part::Face, Part::Skin) | (Part::Skin, Part::Face));
            diagonal_cost(ring[i], ring[j]).saturating_add(if across { ACROSS_THE_RIM } else { 0 })
        };
        let triangle = |corners: [usize; 3]| {
            if corners.iter().all(|&corner| parts[corner] == Part::Rim) { ALONG_THE_RIM } else { 0 }
        };
        // cost[i * n + j], apex[i * n + j]: best for the sub-polygon i..=j, the side i-j included.
        let mut cost = vec![0_u64; n * n];
        let mut apex = vec![0_u8; n * n];
        for width in 2..n {
            for i in 0..n - width {
                let j = i + width;
                let side = if width == n - 1 { 0 } else { diagonal(i, j) };
                let mut best = FORBIDDEN;
                if side != FORBIDDEN {
                    for k in i + 1..j {
                        let inner = cost[i * n + k].saturating_add(cost[k * n + j]);
                        let total = inner.saturating_add(side).saturating_add(triangle([i, k, j]));
                        if total < best {
                            best = total;
                            apex[i * n + j] = k as u8;
                        }
                    }
                }
                cost[i * n + j] = best;
            }
        }
        if cost[n - 1] >= ACROSS_THE_RIM {
            return false;
        }
        let mut open = vec![(0, n - 1)];
        while let Some((i, j)) = open.pop() {
            if j - i < 2 {
                continue;
            }
            let k = usize::from(apex[i * n + j]);
            self.triangles.push([ring[i], ring[k], ring[j]]);
            open.extend([(i, k), (k, j)]);
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_and_sites_are_inverse() {
        for code in 0..CENTRES + 4 {
            assert_eq!(Site::from_code(code).code(), code);
        }
    }

    #[test]
    fn one_inside_corner_gives_a_triangle_that_looks_away_from_it() {
        let patch = Cell::intact(1).patch();
        assert_eq!(patch.triangles.len(), 1);
        let [a, b, c] = patch.triangles[0].map(|code| {
            let place = Site::from_code(code).nominal();
            nalgebra::Vector3::new(place[0], place[1], place[2])
        });
        assert!((b - a).cross(&(c - a)).sum() > 0);
    }

    /// A blade through the middle of a cell: two flat lips, and the same diagonal in both.
    #[test]
    fn the_lips_of_a_cut_mirror_each_other() {
        let across = 0b1111; // the four edges along x
        let mut diagonals = 0xfff;
        for face in [2, 3, 4, 5] {
            diagonals &= !(3 << (2 * face));
        }
        let patch = Cell { inside: 0xff, alive: 0xfff & !across, diagonals, cut: across, rims: Rims::NONE }.patch();
        assert_eq!(patch.triangles.len(), 4);
        let mut sides = [Vec::new(), Vec::new()];
        for triangle in &patch.triangles {
            let ends = triangle.map(|code| match Site::from_code(code) {
                Site::Lip { end, .. } => end,
                other => panic!("{other:?} on a clean cut"),
            });
            assert!(ends[0] == ends[1] && ends[1] == ends[2], "a triangle joins both lips");
            let mut edges = triangle.map(|code| Site::from_code(code).unsided());
            edges.sort_unstable();
            sides[usize::from(ends[0])].push(edges);
        }
        let [mut low, mut high] = sides;
        low.sort_unstable();
        high.sort_unstable();
        assert_eq!(low, high);
    }
}
