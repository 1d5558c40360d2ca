//! A closed triangle mesh as half-edges: who is next to whom, and the two changes that keep it closed and manifold.
//!
//! Half-edge `3 t + c` runs from corner `c` of triangle `t` to the next one. `twin` runs the other way in the neighbour.

use rayon::prelude::*;

use super::CareError;

/// No vertex: the half-edges of a triangle that is gone.
pub(super) const NONE: u32 = u32::MAX;

/// Topology of a closed manifold mesh.
#[derive(Debug, Clone)]
pub(super) struct Halves {
    /// Vertex each half-edge starts from.
    from: Vec<u32>,
    twin: Vec<u32>,
    /// One half-edge out of each vertex; [`NONE`] for vertices no triangle uses.
    out: Vec<u32>,
    /// Triangles left.
    pub(super) triangles: usize,
}

/// The next half-edge of the same triangle.
#[inline]
pub(super) fn next(half: u32) -> u32 {
    if half % 3 == 2 { half - 2 } else { half + 1 }
}

/// The one before.
#[inline]
pub(super) fn prev(half: u32) -> u32 {
    if half.is_multiple_of(3) { half + 2 } else { half - 1 }
}

impl Halves {
    /// Pairs the half-edges of a mesh.
    pub(super) fn new(vertices: usize, triangles: &[[u32; 3]]) -> Result<Self, CareError> {
        if triangles.len() >= (u32::MAX / 3) as usize {
            return Err(CareError::TooManyTriangles { found: triangles.len() });
        }
        for (triangle, corners) in triangles.iter().enumerate() {
            let [a, b, c] = *corners;
            if corners.iter().any(|&v| v as usize >= vertices) || a == b || b == c || c == a {
                return Err(CareError::BadTriangle { triangle, corners: *corners, vertices });
            }
        }
        let from: Vec<u32> = triangles.as_flattened().to_vec();
        let mut keyed: Vec<([u32; 2], u32)> = (0..from.len() as u32)
            .into_par_iter()
            .map(|half| {
                let (a, b) = (from[half as usize], from[next(half) as usize]);
                ([a.min(b), a.max(b)], half)
            })
            .collect();
        keyed.par_sort_unstable();
        let mut twin = vec![NONE; from.len()];
        for edge in keyed.chunk_by(|one, two| one.0 == two.0) {
            match *edge {
                [(_, one), (_, two)] if from[one as usize] != from[two as usize] => {
                    twin[one as usize] = two;
                    twin[two as usize] = one;
                }
                _ => return Err(CareError::NotClosed { edge: edge[0].0, triangles: edge.len() }),
            }
        }
        let (mut out, mut corners) = (vec![NONE; vertices], vec![0_u32; vertices]);
        for (half, &vertex) in (0..).zip(&from) {
            out[vertex as usize] = half;
            corners[vertex as usize] += 1;
        }
        let halves = Self { from, twin, out, triangles: triangles.len() };
        let torn =
            |&vertex: &u32| halves.used(vertex) && halves.ring(vertex).count() as u32 != corners[vertex as usize];
        match (0..vertices as u32).into_par_iter().find_first(torn) {
            Some(vertex) => Err(CareError::NotManifold { vertex }),
            None => Ok(halves),
        }
    }

    /// Number of half-edges, those of triangles that are gone included.
    pub(super) fn len(&self) -> u32 {
        self.from.len() as u32
    }

    #[inline]
    pub(super) fn from(&self, half: u32) -> u32 {
        self.from[half as usize]
    }

    #[inline]
    pub(super) fn to(&self, half: u32) -> u32 {
        self.from[next(half) as usize]
    }

    #[inline]
    pub(super) fn twin(&self, half: u32) -> u32 {
        self.twin[half as usize]
    }

    /// The corner across the edge in the triangle of a half-edge.
    #[inline]
    pub(super) fn apex(&self, half: u32) -> u32 {
        self.from[prev(half) as usize]
    }

    /// Whether the triangle of a half-edge is still there.
    #[inline]
    pub(super) fn lives(&self, half: u32) -> bool {
        self.from(half) != NONE
    }

    /// Whether a triangle uses the vertex.
    #[inline]
    pub(super) fn used(&self, vertex: u32) -> bool {
        self.out[vertex as usize] != NONE
    }

    /// Corners of a triangle; the first is [`NONE`] when it is gone.
    #[inline]
    pub(super) fn corners(&self, triangle: u32) -> [u32; 3] {
        let first = 3 * triangle as usize;
        [self.from[first], self.from[first + 1], self.from[first + 2]]
    }

    /// Half-edges out of a vertex, clockwise from outside.
    #[inline]
    pub(super) fn ring(&self, vertex: u32) -> impl Iterator<Item = u32> + '_ {
        let first = self.out[vertex as usize];
        std::iter::successors(Some(first), move |&half| {
            let after = self.twin(prev(half));
            (after != first).then_some(after)
        })
    }

    /// Whether a vertex has three neighbours and no more.
    fn has_three(&self, vertex: u32) -> bool {
        self.ring(vertex).take(4).count() == 3
    }

    /// Whether the edge may shrink to a point without changing the topology: its ends share the two vertices across
    /// it and no others, and neither of these is left with two neighbours (the link condition of Dey et al., 1999).
    pub(super) fn may_collapse(&self, half: u32) -> bool {
        let (a, b) = (self.from(half), self.to(half));
        let (c, d) = (self.apex(half), self.apex(self.twin(half)));
        let shared = self.ring(a).filter(|&one| self.ring(b).any(|two| self.to(one) == self.to(two))).count();
        shared == 2 && !self.has_three(c) && !self.has_three(d)
    }

    /// Shrinks an edge: its start is gone, its end takes over. The two triangles at it are gone as well.
    pub(super) fn collapse(&mut self, half: u32) {
        let other = self.twin(half);
        let (gone, kept) = (self.from(half), self.to(half));
        let mut at = half;
        loop {
            self.from[at as usize] = kept;
            at = self.twin(prev(at));
            if at == half {
                break;
            }
        }
        for side in [half, other] {
            let (one, two) = (self.twin(next(side)), self.twin(prev(side)));
            self.link(one, two);
            // Of the two half-edges of the edge that is left, one starts at the far corner and one at the kept vertex.
            for half in [one, two] {
                let start = self.from(half) as usize;
                self.out[start] = half;
            }
        }
        for side in [half, other] {
            for dead in [side, next(side), prev(side)] {
                self.from[dead as usize] = NONE;
            }
        }
        self.out[gone as usize] = NONE;
        self.triangles -= 2;
    }

    /// Whether the edge may turn to join the two vertices across it: they are not joined yet, and its ends have neighbours to spare.
    pub(super) fn may_flip(&self, half: u32) -> bool {
        let (c, d) = (self.apex(half), self.apex(self.twin(half)));
        c != d
            && !self.has_three(self.from(half))
            && !self.has_three(self.to(half))
            && !self.ring(c).any(|out| self.to(out) == d)
    }

    /// Turns an edge: (a, b, c) and (b, a, d) become (d, c, a) and (c, d, b).
    pub(super) fn flip(&mut self, half: u32) {
        let other = self.twin(half);
        let (a, b) = (self.from(half), self.to(half));
        let (c, d) = (self.apex(half), self.apex(other));
        let [bc, ca] = [next(half), prev(half)].map(|side| self.twin(side));
        let [ad, db] = [next(other), prev(other)].map(|side| self.twin(side));
        let corners =
            [half, next(half), prev(half), other, next(other), prev(other)].into_iter().zip([d, c, a, c, d, b]);
        for (side, vertex) in corners {
            self.from[side as usize] = vertex;
            self.out[vertex as usize] = side;
        }
        self.link(next(half), ca);
        self.link(prev(half), ad);
        self.link(next(other), db);
        self.link(prev(other), bc);
    }

    fn link(&mut self, one: u32, two: u32) {
        self.twin[one as usize] = two;
        self.twin[two as usize] = one;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OCTAHEDRON: [[u32; 3]; 8] =
        [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];

    fn triangles(halves: &Halves) -> Vec<[u32; 3]> {
        (0..halves.len() / 3).map(|t| halves.corners(t)).filter(|t| t[0] != NONE).collect()
    }

    #[test]
    fn an_octahedron_shrinks_to_a_tetrahedron_and_no_further() {
        let mut halves = Halves::new(6, &OCTAHEDRON).unwrap();
        for left in [6, 4] {
            let half = (0..halves.len()).find(|&h| halves.lives(h) && halves.may_collapse(h)).unwrap();
            halves.collapse(half);
            assert_eq!(halves.triangles, left);
            // Built afresh, the mesh is as closed as the one that was changed in place.
            Halves::new(6, &triangles(&halves)).unwrap();
        }
        assert!(!(0..halves.len()).any(|h| halves.lives(h) && halves.may_collapse(h)));
    }

    #[test]
    fn a_flip_keeps_the_mesh_closed_and_joins_what_was_apart() {
        let mut halves = Halves::new(6, &OCTAHEDRON).unwrap();
        let half = (0..halves.len()).find(|&h| halves.may_flip(h)).unwrap();
        let (c, d) = (halves.apex(half), halves.apex(halves.twin(half)));
        halves.flip(half);
        assert_eq!([halves.to(half), halves.from(half)], [c, d]);
        let again = Halves::new(6, &triangles(&halves)).unwrap();
        assert!(again.ring(c).any(|out| again.to(out) == d));
        // Turning back needs the edge that is now missing; no edge may double one that is there.
        assert!((0..halves.len()).all(|h| {
            let (c, d) = (halves.apex(h), halves.apex(halves.twin(h)));
            !halves.may_flip(h) || !halves.ring(c).any(|out| halves.to(out) == d)
        }));
    }

    #[test]
    fn meshes_that_are_not_closed_are_refused() {
        assert!(matches!(Halves::new(6, &OCTAHEDRON[1..]), Err(CareError::NotClosed { triangles: 1, .. })));
        let mut turned = OCTAHEDRON;
        turned[0].swap(0, 1);
        assert!(matches!(Halves::new(6, &turned), Err(CareError::NotClosed { triangles: 2, .. })));
        assert!(matches!(Halves::new(5, &OCTAHEDRON), Err(CareError::BadTriangle { vertices: 5, .. })));
        // Two bodies that share vertex 5.
        let second = OCTAHEDRON.map(|t| t.map(|v| if v == 4 { 5 } else { v + 6 }));
        let both = [OCTAHEDRON, second].concat();
        assert!(matches!(Halves::new(12, &both), Err(CareError::NotManifold { vertex: 5 })));
    }
}
