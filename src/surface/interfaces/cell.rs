//! The walls inside one cell: contours of its six faces, closed into sheets.
//!
//! ```text
//! sides of sheets        every contour of a face, directed, with the labels on its two sides
//! connected, no node     loops of one pair of labels: triangulated as a surface of one organ is
//! connected, with nodes  a cone over all of its sides from one centre: the lines where sheets meet run from the nodes
//!                        of the faces to the centre
//! ```
//! Along every edge of the complex each label occurs on two sheets or none, so the border of each organ is closed, and a
//! manifold but for centres: one region of an organ may touch another there.

use super::face::{Between, Crossing, Face, OUTSIDE};
use crate::surface::marching_cubes::cell::{Patch, Rims, Site};
use crate::surface::marching_cubes::cube::{EDGES, RING_EDGES, RINGS};

/// Codes of [`Site`], then those of nodes: face and place among its nodes.
pub(super) const NODES: u8 = 192;
const CODES: usize = NODES as usize + 12;

/// The corners of a cell, and what joins or parts them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Cell {
    pub(super) labels: [u8; 8],
    /// Edges with a gap between their ends.
    pub(super) gaps: u16,
    /// Living springs along the face diagonals: bits `2 face` (ring corners 0-2) and `2 face + 1` (1-3).
    pub(super) diagonals: u16,
    pub(super) rims: Rims,
}

/// What is drawn in a cell.
#[derive(Debug, Default)]
pub(super) struct CellPatch {
    /// Corners counter-clockwise seen from the second of the two labels, which is the larger one.
    pub(super) triangles: Vec<([u8; 3], [u8; 2])>,
    /// Nodes of the three lower faces.
    pub(super) nodes: Vec<Node>,
    /// Centres, with the sites they are the mean of.
    pub(super) centres: Vec<(u8, Vec<u8>)>,
    /// Centres that sheets of more than two labels meet in.
    pub(super) cones: Vec<u8>,
}

/// A vertex where three or more labels meet in a face.
#[derive(Debug)]
pub(super) struct Node {
    pub(super) code: u8,
    /// Labels in ring order, and the crossing after each.
    pub(super) arcs: Vec<(u8, u8)>,
    /// How many of the face's diagonals no spring spans any more.
    pub(super) dead_diagonals: usize,
}

/// A side of a sheet in a face of the cell.
#[derive(Debug, Clone, Copy)]
struct Side {
    from: u8,
    to: u8,
    labels: [u8; 2],
}

impl Cell {
    fn face(&self, face: u8) -> Face {
        let at = usize::from(face);
        let labels = RINGS[at].map(|corner| self.labels[usize::from(corner)]);
        let gaps = (0..4).fold(0, |gaps, m| gaps | ((self.gaps >> RING_EDGES[at][m] & 1) << m) as u8);
        let same = |d: usize| u8::from(labels[d] == labels[d + 2] && labels[d] != OUTSIDE) << d;
        let mut diagonals = (self.diagonals >> (2 * face)) as u8 & (same(0) | same(1));
        if gaps == 0b1111 && diagonals == 0b11 {
            // Two crossing diagonals and no edge: no planar region joins both pairs.
            diagonals = 0;
        }
        Face { labels, gaps, diagonals }
    }

    pub(super) fn patch(&self) -> CellPatch {
        let mut patch = CellPatch::default();
        let sides = self.sides(&mut patch);
        let mut up: [u8; CODES] = std::array::from_fn(|code| code as u8);
        for side in &sides {
            let (one, two) = (find(&mut up, side.from), find(&mut up, side.to));
            up[usize::from(one.max(two))] = one.min(two);
        }
        let mut cone = [false; CODES];
        for code in NODES..CODES as u8 {
            let root = find(&mut up, code);
            cone[usize::from(root)] |= root != code;
        }
        let mut next = [None; CODES];
        let mut cones: Vec<(u8, Vec<Side>)> = Vec::new();
        for side in sides {
            let root = find(&mut up, side.from);
            if !cone[usize::from(root)] {
                next[usize::from(side.from)] = Some((side.to, side.labels));
            } else if let Some((_, sides)) = cones.iter_mut().find(|cone| cone.0 == root) {
                sides.push(side);
            } else {
                cones.push((root, vec![side]));
            }
        }
        let mut loops = Patch::default();
        for start in 0..NODES {
            let Some((_, labels)) = next[usize::from(start)] else { continue };
            let mut ring = Vec::with_capacity(12);
            let mut at = start;
            while let Some((to, _)) = next[usize::from(at)].take() {
                ring.push(at);
                at = to;
            }
            debug_assert_eq!(at, start, "contours close");
            let first = loops.triangles.len();
            loops.add_loop(ring, self.rims);
            patch.triangles.extend(loops.triangles[first..].iter().map(|&triangle| (triangle, labels)));
        }
        let centre = |index: usize| Site::Centre { index: index as u8 }.code();
        patch.centres.extend(loops.centres.into_iter().enumerate().map(|(index, ring)| (centre(index), ring)));
        for (_, sides) in cones {
            let apex = centre(patch.centres.len());
            patch.triangles.extend(sides.iter().map(|side| ([side.from, side.to, apex], side.labels)));
            patch.centres.push((apex, middle_of(&sides)));
            patch.cones.push(apex);
        }
        patch
    }

    /// The sides of all sheets; notes the nodes of the lower faces.
    fn sides(&self, patch: &mut CellPatch) -> Vec<Side> {
        let mut sides = Vec::with_capacity(24);
        for face in 0..6_u8 {
            let state = self.face(face);
            let seen_from_outside = face % 2 == 1;
            let site = |crossing: Crossing| site_of(face, crossing).code();
            // From `from` to `to` with `left` on the left seen from +axis. Sheets look from the smaller label to the larger one, and
            // their border runs the other way round seen from outside the cell.
            let mut add = |from: u8, to: u8, left: u8, right: u8| {
                let (from, to) = if seen_from_outside == (left < right) { (to, from) } else { (from, to) };
                sides.push(Side { from, to, labels: [left.min(right), left.max(right)] });
            };
            let mut nodes = 0;
            for arcs in state.junctions() {
                if let [one, two] = arcs[..] {
                    let (from, to) = (site(one.exit), site(two.exit));
                    let between = state.between(one.exit, two.exit).map(|between| match between {
                        Between::Front { edge } => Site::Front { face, ring_edge: edge },
                        Between::Rim { edge, corner } => {
                            Site::Rim { face, ring_edge: edge, ring_end: u8::from(corner != edge) }
                        }
                    });
                    match between {
                        Some(middle) => {
                            add(from, middle.code(), one.label, two.label);
                            add(middle.code(), to, one.label, two.label);
                        }
                        None => add(from, to, one.label, two.label),
                    }
                    continue;
                }
                let code = NODES + 2 * face + nodes;
                nodes += 1;
                for (at, arc) in arcs.iter().enumerate() {
                    add(site(arc.exit), code, arc.label, arcs[(at + 1) % arcs.len()].label);
                }
                if !seen_from_outside {
                    let arcs = arcs.iter().map(|arc| (arc.label, site(arc.exit))).collect();
                    let dead_diagonals = 2 - (self.diagonals >> (2 * face) & 3).count_ones() as usize;
                    patch.nodes.push(Node { code, arcs, dead_diagonals });
                }
            }
        }
        sides
    }
}

fn site_of(face: u8, crossing: Crossing) -> Site {
    let edge = RING_EDGES[usize::from(face)][usize::from(crossing.edge)];
    match crossing.lip {
        Some(corner) => {
            let corner = RINGS[usize::from(face)][usize::from(corner)];
            Site::Lip { edge, end: u8::from(corner == EDGES[usize::from(edge)][1]) }
        }
        None => Site::Skin { edge },
    }
}

/// What the centre of a cone is the mean of: the nodes at the skin, so that walls leave no groove in it; else all nodes; and where those
/// lie in a single face, everything.
fn middle_of(sides: &[Side]) -> Vec<u8> {
    let distinct = |wanted: &dyn Fn(&Side) -> bool, least: u8| {
        let mut codes: Vec<u8> =
            sides.iter().filter(|side| wanted(side)).flat_map(|side| [side.from, side.to]).collect();
        codes.retain(|&code| code >= least);
        codes.sort_unstable();
        codes.dedup();
        codes
    };
    let spans = |nodes: &Vec<u8>| nodes.iter().any(|&code| (code - NODES) / 2 != (nodes[0] - NODES) / 2);
    let at_skin = distinct(&|side| side.labels[1] == OUTSIDE, NODES);
    if spans(&at_skin) {
        return at_skin;
    }
    let nodes = distinct(&|_| true, NODES);
    if spans(&nodes) { nodes } else { distinct(&|_| true, 0) }
}

fn find(up: &mut [u8; CODES], mut at: u8) -> u8 {
    while up[usize::from(at)] != at {
        up[usize::from(at)] = up[usize::from(up[usize::from(at)])];
        at = up[usize::from(at)];
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    /// Every edge inside the cell has as many sheets on which a label is inside as sheets on which it is outside.
    fn assert_closed_inside(cell: &Cell) {
        let patch = cell.patch();
        let sides = cell.sides(&mut CellPatch::default());
        let mut balance: HashMap<(u8, u8, u8), i32> = HashMap::new();
        let mut count = |from: u8, to: u8, labels: [u8; 2], times: i32| {
            for (label, sign) in [(labels[0], 1), (labels[1], -1)] {
                *balance.entry((from.min(to), from.max(to), label)).or_default() +=
                    times * sign * if from < to { 1 } else { -1 };
            }
        };
        for (t, labels) in &patch.triangles {
            assert!(labels[0] < labels[1]);
            (0..3).for_each(|c| count(t[c], t[(c + 1) % 3], *labels, 1));
        }
        sides.iter().for_each(|side| count(side.from, side.to, side.labels, -1));
        assert!(balance.values().all(|&sum| sum == 0), "{cell:?}");
    }

    #[test]
    fn sheets_end_on_the_faces_alone() {
        let mut state = 7_u32;
        let mut random = |below: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) % below
        };
        for _ in 0..20_000 {
            let organs = 1 + random(4);
            let labels: [u8; 8] = std::array::from_fn(|_| match random(organs + 1) {
                0 => OUTSIDE,
                label => label as u8 - 1,
            });
            let tissue = |corner: u8| labels[usize::from(corner)] != OUTSIDE;
            let gaps = (0..12_usize)
                .filter(|&edge| EDGES[edge].iter().all(|&corner| tissue(corner)) && random(3) == 0)
                .fold(0, |gaps, edge| gaps | 1 << edge);
            assert_closed_inside(&Cell { labels, gaps, diagonals: random(4096) as u16, rims: Rims::NONE });
        }
    }

    #[test]
    fn a_wall_that_meets_the_skin_has_one_centre_between_its_two_nodes() {
        let labels = std::array::from_fn(|corner| if corner & 4 != 0 { OUTSIDE } else { (corner & 1) as u8 });
        let patch = Cell { labels, gaps: 0, diagonals: 0xfff, rims: Rims::NONE }.patch();
        assert_eq!(patch.cones.len(), 1);
        assert_eq!(patch.centres.len(), 1);
        assert_eq!(patch.centres[0].1, [NODES + 4, NODES + 6], "the faces across y");
        let mut pairs: Vec<[u8; 2]> = patch.triangles.iter().map(|triangle| triangle.1).collect();
        pairs.sort_unstable();
        pairs.dedup();
        assert_eq!(pairs, [[0, 1], [0, OUTSIDE], [1, OUTSIDE]]);
    }
}
