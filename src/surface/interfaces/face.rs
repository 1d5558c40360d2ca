//! How the walls between organs run across one face between two cells.
//!
//! ```text
//! ring      the four corners and the gaps on cut edges, as arcs of one label each, with a crossing between two arcs
//! join      two arcs of one label become one region; what is left on either side is treated on its own. In this order:
//!           an organ that a living diagonal joins; outside with outside; an organ with itself, the earlier organ first
//! left      two arcs: a contour between their two crossings. Three or more, of as many labels: a node that all
//!           crossings of this part lead to
//! ```
//! No region is joined across another, so contours never cross. Both cells at a face see the same ring and draw the same. At
//! a node every label occurs once, so each organ's border passes it once.
//!
//! # Source
//! Wu and Sullivan, Multiple material marching cubes algorithm, 2003: nodes of faces and cells. Which regions join, and gaps,
//! are this library's.

/// Label of what no organ fills: air, the gap of a cut, organs that are not there.
pub const OUTSIDE: u8 = u8::MAX;

/// What one face knows: four corners in ring order, the edge `m` between the corners `m` and `m + 1`, the diagonals
/// 0-2 and 1-3.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Face {
    pub(super) labels: [u8; 4],
    /// Edges with a gap between their ends, both tissue; one bit each.
    pub(super) gaps: u8,
    /// Diagonals that join two corners of one organ: bit 0 for 0-2, bit 1 for 1-3.
    pub(super) diagonals: u8,
}

/// Where two arcs meet on a ring edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Crossing {
    /// Ring edge.
    pub(super) edge: u8,
    /// Ring corner whose side of a gap this is; `None` where there is no gap.
    pub(super) lip: Option<u8>,
}

/// A piece of the ring of one label, and where it ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Arc {
    pub(super) label: u8,
    /// Ring corners of it and of the arcs it is joined with, one bit each.
    corners: u8,
    pub(super) exit: Crossing,
}

/// A vertex inside the face between the two ends of a contour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Between {
    /// A blade came through this ring edge and ended in the face.
    Front { edge: u8 },
    /// A gap meets the skin beside one corner: ring edge of the gap, and that corner.
    Rim { edge: u8, corner: u8 },
}

impl Face {
    fn label(&self, corner: usize) -> u8 {
        self.labels[corner % 4]
    }

    /// The parts of the face that share nothing but regions: arcs in ring order, two or more of them, no label twice.
    pub(super) fn junctions(&self) -> Vec<Vec<Arc>> {
        let mut parts = Vec::new();
        let arcs = self.arcs();
        if !arcs.is_empty() {
            self.part(arcs, &mut parts);
        }
        parts
    }

    fn arcs(&self) -> Vec<Arc> {
        let mut arcs: Vec<Arc> = Vec::with_capacity(8);
        let mut corners = 1_u8;
        for edge in 0..4_u8 {
            let (here, there) = (self.label(edge.into()), self.label(usize::from(edge) + 1));
            let next = (edge + 1) % 4;
            if self.gaps >> edge & 1 == 1 {
                arcs.push(Arc { label: here, corners, exit: Crossing { edge, lip: Some(edge) } });
                arcs.push(Arc { label: OUTSIDE, corners: 0, exit: Crossing { edge, lip: Some(next) } });
                corners = 0;
            } else if here != there {
                arcs.push(Arc { label: here, corners, exit: Crossing { edge, lip: None } });
                corners = 0;
            }
            corners |= 1 << next;
        }
        // The last arc is the beginning of the first.
        if let Some(first) = arcs.first_mut() {
            first.corners |= corners;
        }
        arcs
    }

    fn part(&self, arcs: Vec<Arc>, parts: &mut Vec<Vec<Arc>>) {
        let Some((one, two)) = self.join(&arcs) else {
            parts.push(arcs);
            return;
        };
        let corners = arcs[one].corners | arcs[two].corners;
        let mut within = arcs[one..two].to_vec();
        let mut around: Vec<Arc> = arcs[two..].iter().chain(&arcs[..one]).copied().collect();
        within[0].corners = corners;
        around[0].corners = corners;
        self.part(within, parts);
        self.part(around, parts);
    }

    /// The two arcs to be joined first.
    fn join(&self, arcs: &[Arc]) -> Option<(usize, usize)> {
        if arcs.len() < 4 {
            // All of them touch, so no two are of one label.
            return None;
        }
        let pairs = (0..arcs.len()).flat_map(|one| (one + 1..arcs.len()).map(move |two| (one, two)));
        let rank = |&(one, two): &(usize, usize)| {
            let (one, two) = (&arcs[one], &arcs[two]);
            let joins = |diagonal: u8| {
                let (low, high) = (1 << diagonal, 4 << diagonal);
                let between = |a: &Arc, b: &Arc| a.corners & low != 0 && b.corners & high != 0;
                self.diagonals >> diagonal & 1 == 1 && (between(one, two) || between(two, one))
            };
            match one.label {
                OUTSIDE => 1,
                _ if joins(0) || joins(1) => 0,
                _ => 2,
            }
        };
        pairs
            .filter(|&(one, two)| arcs[one].label == arcs[two].label)
            .min_by_key(|pair| (rank(pair), arcs[pair.0].label))
    }

    /// The extra vertex of a contour, if it has one.
    pub(super) fn between(&self, one: Crossing, two: Crossing) -> Option<Between> {
        if one.edge == two.edge {
            return Some(Between::Front { edge: one.edge });
        }
        let rim = |lip: Crossing, skin: Crossing| {
            let (corner, edge) = (lip.lip?, usize::from(skin.edge));
            let tissue = if self.label(edge) == OUTSIDE { (edge + 1) % 4 } else { edge };
            (skin.lip.is_none() && tissue == usize::from(corner)).then_some(Between::Rim { edge: lip.edge, corner })
        };
        rim(one, two).or_else(|| rim(two, one))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: u8 = 0;
    const B: u8 = 1;
    const C: u8 = 2;

    fn labels(part: &[Arc]) -> Vec<u8> {
        let mut labels: Vec<u8> = part.iter().map(|arc| arc.label).collect();
        labels.sort_unstable();
        labels
    }

    fn parts(labels_: [u8; 4], gaps: u8, diagonals: u8) -> Vec<Vec<u8>> {
        let face = Face { labels: labels_, gaps, diagonals };
        let mut parts: Vec<Vec<u8>> = face.junctions().iter().map(|part| labels(part)).collect();
        parts.sort_unstable();
        parts
    }

    #[test]
    fn walls_skins_and_nodes() {
        assert!(parts([A, A, A, A], 0, 0b11).is_empty());
        assert_eq!(parts([A, A, B, B], 0, 0), [[A, B]]);
        assert_eq!(parts([A, B, OUTSIDE, OUTSIDE], 0, 0), [[A, B, OUTSIDE]], "a wall meets the skin");
        assert_eq!(parts([A, B, C, OUTSIDE], 0, 0), [[A, B, C, OUTSIDE]]);
    }

    #[test]
    fn springs_then_organ_order_decide_ambiguous_faces() {
        let joined = |diagonals: u8| {
            let face = Face { labels: [A, B, A, B], gaps: 0, diagonals };
            let edges = |part: &Vec<Arc>| part.iter().map(|arc| arc.exit.edge).collect::<Vec<_>>();
            face.junctions().iter().map(edges).collect::<Vec<_>>()
        };
        let round_b = joined(0b01);
        assert_eq!(round_b, [[0, 1], [2, 3]], "A is joined: a contour round each corner of B");
        assert_eq!(joined(0b11), round_b, "both could be: the earlier organ is");
        assert_eq!(joined(0b00), round_b, "none would be: the earlier organ is");
        assert_ne!(joined(0b10), round_b);
        assert_eq!(parts([A, OUTSIDE, A, B], 0, 0b01), [[A, B], [A, OUTSIDE]]);
        assert_eq!(parts([A, OUTSIDE, A, B], 0, 0), parts([A, OUTSIDE, A, B], 0, 0b01), "held together by B");
        assert_eq!(parts([A, OUTSIDE, B, OUTSIDE], 0, 0), [[A, OUTSIDE], [B, OUTSIDE]], "air joins before walls form");
    }

    #[test]
    fn a_cut_along_a_wall_ends_where_three_regions_meet() {
        assert_eq!(parts([A, B, B, A], 0b0001, 0), [[A, B, OUTSIDE]]);
        assert_eq!(parts([A, B, B, A], 0b0101, 0), [[A, OUTSIDE], [B, OUTSIDE]], "right through");
        assert_eq!(parts([A, A, B, B], 0b0001, 0), [[A, B], [A, OUTSIDE]], "a crack in A behind which A goes on");
    }

    /// Every state of labels, gaps and diagonals: each crossing belongs to one part, and no part names a label twice.
    #[test]
    fn every_face_is_divided_properly() {
        let mut states = 0;
        for code in 0..4_u32.pow(4) << 6 {
            let label = |m: u32| [A, B, C, OUTSIDE][(code >> (6 + 2 * m) & 3) as usize];
            let labels = [0, 1, 2, 3].map(label);
            let same = |d: usize| labels[d] == labels[d + 2] && labels[d] != OUTSIDE;
            let diagonals = (code & 3) as u8;
            let gaps = (code >> 2 & 15) as u8;
            let tissue = |m: usize| labels[m % 4] != OUTSIDE;
            if (0..2).any(|d| diagonals >> d & 1 == 1 && !same(d))
                || (0..4).any(|m| gaps >> m & 1 == 1 && !(tissue(m) && tissue(m + 1)))
            {
                continue;
            }
            states += 1;
            let face = Face { labels, gaps, diagonals };
            let expected: usize = (0..4)
                .map(|m| match gaps >> m & 1 {
                    1 => 2,
                    _ => usize::from(labels[m] != labels[(m + 1) % 4]),
                })
                .sum();
            let parts = face.junctions();
            let mut crossings: Vec<(u8, Option<u8>)> =
                parts.iter().flatten().map(|arc| (arc.exit.edge, arc.exit.lip)).collect();
            assert_eq!(crossings.len(), expected, "{face:?}");
            crossings.sort_unstable();
            crossings.dedup();
            assert_eq!(crossings.len(), expected, "{face:?}");
            for part in &parts {
                let mut of_part: Vec<u8> = part.iter().map(|arc| arc.label).collect();
                assert!(of_part.len() >= 2);
                of_part.sort_unstable();
                of_part.dedup();
                assert_eq!(of_part.len(), part.len(), "{face:?}: {part:?}");
            }
            assert!(parts.iter().filter(|part| part.len() > 2).count() <= 2, "{face:?}");
        }
        assert!(states > 2000, "{states}");
    }
}
