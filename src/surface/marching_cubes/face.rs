//! The contour of the surface on one face between two cells.
//!
//! Both cells at a face read the same four corners, four edges and two diagonals, so they draw the same contour; that
//! is what keeps the surface closed whatever was severed. The connectivity of the lattice decides the ambiguous
//! faces of marching cubes: inside corners that a surviving spring of this face joins stay together.

/// What one face knows: four corners in ring order, the edge `m` between the corners `m` and `m + 1`, the diagonals
/// 0-2 and 1-3.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Face {
    /// Inside corners, one bit each.
    pub(crate) inside: u8,
    /// Edges whose spring is alive, one bit each; read only where both ends are inside.
    pub(crate) alive: u8,
    /// Diagonals whose spring is alive: bit 0 for 0-2, bit 1 for 1-3.
    pub(crate) diagonals: u8,
    /// Edges that carry the two lips of a cut, one bit each.
    pub(crate) cut: u8,
}

/// A crossing on a ring edge, seen from the inside corner it belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct FaceCrossing {
    /// Ring edge.
    pub(crate) edge: u8,
    /// Ring corner on the inside.
    pub(crate) corner: u8,
}

/// One piece of contour, with the inside on its left seen from `+axis`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Contour {
    pub(crate) from: FaceCrossing,
    pub(crate) to: FaceCrossing,
}

/// A vertex inside the face, on the way from one end of a contour to the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Between {
    /// Both ends sit on one edge: the blade that came through it ended in this face.
    Front {
        /// Ring edge the blade came through.
        edge: u8,
    },
    /// A cut meets the skin beside one corner.
    Rim {
        /// The crossing on the cut edge.
        lip: FaceCrossing,
        /// The crossing between inside and outside.
        skin: FaceCrossing,
    },
}

/// Component of a corner that is outside.
pub(crate) const OUTSIDE: u8 = u8::MAX;

impl Face {
    fn is_inside(self, corner: usize) -> bool {
        self.inside >> (corner % 4) & 1 == 1
    }

    /// Component of each corner when inside corners are joined by the surviving springs of this face alone.
    ///
    /// Two crossing diagonals without any edge would join 0-2 through 1-3; no planar contour does that, so both are
    /// left out.
    pub(crate) fn components(self) -> [u8; 4] {
        let mut component = [OUTSIDE; 4];
        for (corner, own) in component.iter_mut().enumerate() {
            if self.is_inside(corner) {
                *own = corner as u8;
            }
        }
        let mut join = |one: usize, two: usize| {
            let (from, to) = (component[two], component[one]);
            if from != OUTSIDE && to != OUTSIDE {
                component.iter_mut().filter(|c| **c == from).for_each(|c| *c = to);
            }
        };
        for edge in 0..4 {
            if self.alive >> edge & 1 == 1 {
                join(edge, (edge + 1) % 4);
            }
        }
        let only_diagonals = self.inside == 0b1111 && self.alive & 0b1111 == 0 && self.diagonals == 0b11;
        if !only_diagonals {
            for diagonal in 0..2 {
                if self.diagonals >> diagonal & 1 == 1 {
                    join(diagonal, diagonal + 2);
                }
            }
        }
        component
    }

    /// The pieces of contour, at most four: from the crossing where the ring leaves a run of joined inside corners to the
    /// one where it enters the next run of the same component.
    pub(crate) fn contours(self) -> impl Iterator<Item = Contour> {
        let component = self.components();
        let crossed = move |edge: usize| {
            let ends = (self.is_inside(edge), self.is_inside(edge + 1));
            ends.0 != ends.1 || (ends.0 && self.cut >> (edge % 4) & 1 == 1)
        };
        (0..4).filter(move |&edge| self.is_inside(edge) && crossed(edge)).map(move |exit| {
            let entry = (exit..exit + 4)
                .find(|&edge| component[(edge + 1) % 4] == component[exit] && crossed(edge))
                .expect("a run that is left is also entered");
            Contour {
                from: FaceCrossing { edge: exit as u8, corner: exit as u8 },
                to: FaceCrossing { edge: (entry % 4) as u8, corner: ((entry + 1) % 4) as u8 },
            }
        })
    }
}

impl Face {
    /// The extra vertex of a contour, if it has one: it depends on this face alone, so both cells agree.
    ///
    /// Without the rim vertex every cut would leave a groove one pitch wide and half a pitch deep along the skin.
    pub(crate) fn between(self, contour: Contour) -> Option<Between> {
        let Contour { from, to } = contour;
        if from.edge == to.edge {
            return Some(Between::Front { edge: from.edge });
        }
        let (lip, skin) = self.lip_and_skin(contour)?;
        (lip.corner == skin.corner).then_some(Between::Rim { lip, skin })
    }

    /// The two ends of a contour that leads from a lip to the skin.
    pub(crate) fn lip_and_skin(self, Contour { from, to }: Contour) -> Option<(FaceCrossing, FaceCrossing)> {
        let is_lip = |c: FaceCrossing| self.is_inside(usize::from(c.edge)) && self.is_inside(usize::from(c.edge) + 1);
        match (is_lip(from), is_lip(to)) {
            (true, false) => Some((from, to)),
            (false, true) => Some((to, from)),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHOLE: Face = Face { inside: 0b1111, alive: 0b1111, diagonals: 0b11, cut: 0 };

    #[test]
    fn diagonal_springs_decide_the_ambiguous_face() {
        let linked = Face { inside: 0b0101, ..WHOLE };
        let ends = |face: Face| face.contours().map(|c| (c.from.edge, c.to.edge)).collect::<Vec<_>>();
        assert_eq!(ends(linked), [(0, 1), (2, 3)], "joined: the contours go round the outside corners");
        let severed = Face { diagonals: 0b10, ..linked };
        assert_eq!(ends(severed), [(0, 3), (2, 1)], "apart: the contours go round the inside corners");
    }

    #[test]
    fn a_single_cut_edge_ends_in_the_face() {
        let face = Face { alive: 0b1110, cut: 0b0001, ..WHOLE };
        let contours: Vec<_> = face.contours().collect();
        assert_eq!(contours.len(), 1);
        assert_eq!(face.between(contours[0]), Some(Between::Front { edge: 0 }));
    }

    #[test]
    fn a_cut_meets_the_skin_in_two_rims() {
        let face = Face { inside: 0b0011, alive: 0b1110, cut: 0b0001, ..WHOLE };
        let rims: Vec<_> = face.contours().filter_map(|c| face.between(c)).collect();
        assert_eq!(rims.len(), 2, "{rims:?}");
        assert!(rims.iter().all(|r| matches!(r, Between::Rim { lip, .. } if lip.edge == 0)));
    }

    #[test]
    fn crossing_diagonals_alone_do_not_join() {
        let face = Face { alive: 0, ..WHOLE };
        assert_eq!(face.components(), [0, 1, 2, 3]);
        assert_eq!(Face { alive: 0, diagonals: 0b01, ..WHOLE }.components(), [0, 1, 0, 3]);
    }

    /// Every crossing starts one piece and ends one piece, for every state in which dead edges that part their ends are cut.
    #[test]
    fn every_crossing_is_left_once_and_reached_once() {
        let mut states = 0;
        for bits in 0..1_u32 << 14 {
            let face = Face {
                inside: (bits & 15) as u8,
                alive: (bits >> 4 & 15) as u8,
                diagonals: (bits >> 8 & 3) as u8,
                cut: (bits >> 10 & 15) as u8,
            };
            let component = face.components();
            let sound = (0..4).all(|m| {
                let both = face.is_inside(m) && face.is_inside(m + 1);
                let cut = face.cut >> m & 1 == 1;
                let parted = component[m] != component[(m + 1) % 4];
                // Only a dead edge is cut, and it must be where this face parts its ends.
                if both { !(cut && face.alive >> m & 1 == 1) && (cut || !parted) } else { !cut }
            });
            if !sound {
                continue;
            }
            states += 1;
            let mut from: Vec<_> = face.contours().map(|c| (c.from.edge, c.from.corner)).collect();
            let mut to: Vec<_> = face.contours().map(|c| (c.to.edge, c.to.corner)).collect();
            let expected = (0..4)
                .map(|m| match (face.is_inside(m), face.is_inside(m + 1)) {
                    (true, true) => 2 * usize::from(face.cut >> m & 1),
                    (false, false) => 0,
                    _ => 1,
                })
                .sum::<usize>();
            assert_eq!(from.len() + to.len(), expected);
            for list in [&mut from, &mut to] {
                let before = list.len();
                list.sort_unstable();
                list.dedup();
                assert_eq!(list.len(), before);
            }
        }
        assert!(states > 500, "{states}");
    }
}
