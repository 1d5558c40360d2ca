//! The 256 cells without a dead spring, worked out once by the general rules.

use std::sync::LazyLock;

use super::cell::Cell;

/// Triangles of each pattern of inside corners, as edge numbers, counter-clockwise seen from outside the tissue.
pub(crate) struct CaseTable {
    /// Where the triangles of a case begin and end in `triangles`.
    ranges: [[u16; 2]; 256],
    triangles: Vec<[u8; 3]>,
}

impl CaseTable {
    /// Triangles of a case.
    #[inline]
    pub(crate) fn triangles(&self, inside: u8) -> &[[u8; 3]] {
        let [from, to] = self.ranges[usize::from(inside)];
        &self.triangles[usize::from(from)..usize::from(to)]
    }
}

/// The table; the first use builds it (microseconds).
pub(crate) static CASES: LazyLock<CaseTable> = LazyLock::new(|| {
    let mut table = CaseTable { ranges: [[0; 2]; 256], triangles: Vec::new() };
    for inside in 0..=255_u8 {
        let patch = Cell::intact(inside).patch();
        // Holds for all 256 (test below), so that a case needs no vertex of its own.
        assert!(patch.centres.is_empty(), "case {inside:#010b} needs a centre");
        let from = table.triangles.len() as u16;
        table.triangles.extend(patch.triangles);
        table.ranges[usize::from(inside)] = [from, table.triangles.len() as u16];
    }
    table
});

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_case_needs_a_centre_and_every_crossing_is_used() {
        let needy: Vec<u8> = (0..=255).filter(|&inside| !Cell::intact(inside).patch().centres.is_empty()).collect();
        assert!(needy.is_empty(), "{needy:?}");
    }
}
