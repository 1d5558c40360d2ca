//! What the sheets of the surface allow: which edges may shrink, and to where.

use super::collapse::Worker;
use crate::surface::normals::Sheet;

/// Where the one vertex that is left of an edge may lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Target {
    /// Anywhere.
    Free,
    /// At either end.
    Ends,
    /// At the end of the half-edge.
    End,
    /// At its start.
    Start,
}

impl Worker<'_> {
    pub(super) fn sheet(&self, vertex: u32) -> Sheet {
        self.sheets.get(vertex as usize).copied().unwrap_or_default()
    }

    fn organ(&self, vertex: u32) -> u8 {
        self.organs.get(vertex as usize).copied().unwrap_or_default()
    }

    /// Whether an edge runs along a rim: both ends do, and its two triangles are not on the same side of it.
    pub(super) fn along_rim(&self, half: u32) -> bool {
        let halves = &self.halves;
        let across = [half, halves.twin(half)].map(|side| self.sheet(halves.apex(side)));
        let ends = [halves.from(half), halves.to(half)].map(|vertex| self.sheet(vertex));
        ends == [Sheet::Rim; 2] && (across[0] != across[1] || across[0] == Sheet::Rim)
    }

    /// Whether a rim goes through the vertex and neither ends nor branches there.
    fn on_one_rim(&self, vertex: u32) -> bool {
        self.halves.ring(vertex).filter(|&half| self.along_rim(half)).count() == 2
    }

    /// Where an edge may shrink to; `None` when it must stay.
    pub(super) fn target(&self, half: u32) -> Option<Target> {
        let (from, to) = (self.halves.from(half), self.halves.to(half));
        if self.organ(from) != self.organ(to) {
            return None;
        }
        match (self.sheet(from), self.sheet(to)) {
            (Sheet::Skin, Sheet::Skin) => Some(Target::Free),
            (Sheet::Seam, Sheet::Seam) => Some(Target::Ends),
            (Sheet::Rim, Sheet::Rim) => {
                if !self.along_rim(half) || self.halves_share_a_rim(half) {
                    return None;
                }
                match (self.on_one_rim(from), self.on_one_rim(to)) {
                    (true, true) => Some(Target::Ends),
                    (true, false) => Some(Target::End),
                    (false, true) => Some(Target::Start),
                    (false, false) => None,
                }
            }
            (Sheet::Rim, _) => Some(Target::Start),
            (_, Sheet::Rim) => Some(Target::End),
            _ => None,
        }
    }

    /// Whether the triangle beside an edge of a rim lies within the rim: shrinking the edge would lay one rim on another.
    fn halves_share_a_rim(&self, half: u32) -> bool {
        let halves = &self.halves;
        [half, halves.twin(half)].into_iter().any(|side| self.sheet(halves.apex(side)) == Sheet::Rim)
    }

    /// Whether an edge may turn: no rim runs along it, and it would not join skin to the face of a cut or organ to organ.
    pub(super) fn may_turn(&self, half: u32) -> bool {
        let halves = &self.halves;
        let across = [half, halves.twin(half)].map(|side| halves.apex(side));
        let [one, two] = across.map(|vertex| self.sheet(vertex));
        let inner = one as u8 & two as u8 != 0 && !(one == Sheet::Rim && two == Sheet::Rim);
        let organs = [halves.from(half), halves.to(half), across[0], across[1]].map(|vertex| self.organ(vertex));
        inner && !self.along_rim(half) && organs.iter().all(|&organ| organ == organs[0])
    }
}
