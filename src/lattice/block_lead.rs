//! Where blocks begin, so that few of them hold a ragged organ.
//!
//! Blocks are laid from some grid points before the first particle on. What a block costs a step is copied with its halo,
//! and computed row by row, whether the row is full or not; both are counted for beginnings a quarter of a row apart.

use super::layout::BLOCK;

/// Beginnings are this many grid points apart.
const APART: usize = 4;
/// A block costs as much as this many rows: copying nine fields with their halo, measured with organs and dampers.
const ROWS_PER_BLOCK: usize = 13;

/// How many grid points the first block begins before the first particle along each axis; the least of the best.
///
/// - `extent`: grid points from the first to the last particle along each axis; `points`: particles, from the first on.
pub(super) fn best_lead(extent: [usize; 3], points: impl Iterator<Item = [usize; 3]>) -> [usize; 3] {
    let quarters = extent[0].div_ceil(APART);
    let mut full = vec![false; quarters * extent[1] * extent[2]];
    for [x, y, z] in points {
        full[(z * extent[1] + y) * quarters + x / APART] = true;
    }
    let leads = |axis: usize| (0..BLOCK[axis]).step_by(APART);
    let mut best = (usize::MAX, [0; 3]);
    for x in leads(0) {
        let row_blocks = (extent[0] + x).div_ceil(BLOCK[0]);
        // Rows that hold a particle, each as a bit of its y and z.
        let mut rows = vec![false; row_blocks * extent[1] * extent[2]];
        for (line, quarters) in full.chunks_exact(quarters.max(1)).enumerate() {
            for (quarter, _) in quarters.iter().enumerate().filter(|(_, full)| **full) {
                rows[line * row_blocks + (quarter * APART + x) / BLOCK[0]] = true;
            }
        }
        let filled = rows.iter().filter(|filled| **filled).count();
        for z in leads(2) {
            for y in leads(1) {
                let layers = |axis: usize, lead: usize| (extent[axis] + lead).div_ceil(BLOCK[axis]);
                let mut blocks = vec![false; row_blocks * layers(1, y) * layers(2, z)];
                for (row, _) in rows.iter().enumerate().filter(|(_, filled)| **filled) {
                    let (block, line) = (row % row_blocks, row / row_blocks);
                    let [along, up] = [(line % extent[1] + y) / BLOCK[1], (line / extent[1] + z) / BLOCK[2]];
                    blocks[(up * layers(1, y) + along) * row_blocks + block] = true;
                }
                let cost = filled + ROWS_PER_BLOCK * blocks.iter().filter(|filled| **filled).count();
                if cost < best.0 {
                    best = (cost, [x, y, z]);
                }
            }
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lead_of(extent: [usize; 3], holds: impl Fn([usize; 3]) -> bool) -> [usize; 3] {
        let [x, y, z] = extent;
        let all = (0..z).flat_map(|k| (0..y).flat_map(move |j| (0..x).map(move |i| [i, j, k])));
        best_lead(extent, all.filter(|&point| holds(point)))
    }

    #[test]
    fn a_body_as_wide_as_some_blocks_fills_them() {
        assert_eq!(lead_of([32, 16, 24], |_| true), [0, 0, 0]);
        assert_eq!(lead_of([1, 1, 1], |_| true), [0, 0, 0]);
    }

    /// A thin tip before a body that fills blocks of its own.
    #[test]
    fn blocks_begin_where_the_body_does() {
        let tip_along = |axis: usize, length: usize| {
            let mut extent = BLOCK.map(|size| 4 * size);
            extent[axis] += length;
            let middle = [0, 1, 2].map(|a| extent[a] / 2);
            lead_of(extent, move |at| at[axis] >= length || (0..3).all(|a| a == axis || at[a] == middle[a]))
        };
        assert_eq!(tip_along(0, 4), [12, 0, 0]);
        assert_eq!(tip_along(1, 4), [0, 4, 0]);
        assert_eq!(tip_along(2, 4), [0, 0, 4]);
    }
}
