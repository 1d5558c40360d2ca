//! Rows of a block and of its halo, and where in them the neighbours are.

use super::halo::{HALO_ROW, Halo, halo_row};
use crate::lattice::layout::{BLOCK, BLOCK_LEN};
use crate::lattice::neighbours::OFFSETS;

/// Particles of a row.
pub const LANES: usize = BLOCK[0];
/// One value per particle of a row.
pub type Lanes = [f32; LANES];

/// Which of the nine rows around (x fastest taken out) holds the neighbour in direction `d`.
pub(super) const fn row_of(d: usize) -> usize {
    ((OFFSETS[d][2] + 1) * 3 + OFFSETS[d][1] + 1) as usize
}

/// Column of the neighbour of lane 0 in its halo row.
pub(super) const fn column_of(d: usize) -> usize {
    (OFFSETS[d][0] + 1) as usize
}

/// Values from the first to the last of the nine rows around a row.
const AROUND: usize = halo_row(1, 1) + HALO_ROW - halo_row(-1, -1);

/// The nine rows of a halo around a row of its block, y fastest. One window instead of nine: every load of the loop is then
/// a constant away from one address.
#[derive(Clone, Copy)]
pub struct Around<'a>(&'a [f32; AROUND]);

impl std::ops::Index<usize> for Around<'_> {
    type Output = [f32; HALO_ROW];
    #[inline(always)]
    fn index(&self, place: usize) -> &[f32; HALO_ROW] {
        let start = halo_row((place % 3) as isize - 1, (place / 3) as isize - 1);
        self.0[start..start + HALO_ROW].try_into().expect("a row's length")
    }
}

#[inline(always)]
pub(super) fn rows_around(halo: &Halo, y: usize, z: usize) -> Around<'_> {
    let start = halo_row(y as isize - 1, z as isize - 1);
    Around(halo[start..start + AROUND].try_into().expect("nine rows' length"))
}

#[inline(always)]
pub(super) fn row_of_block<T>(block: &[T; BLOCK_LEN], y: usize, z: usize) -> &[T; LANES] {
    let start = (z * BLOCK[1] + y) * LANES;
    block[start..start + LANES].try_into().expect("a row's length")
}

#[inline(always)]
pub(super) fn row_of_block_mut<T>(block: &mut [T; BLOCK_LEN], y: usize, z: usize) -> &mut [T; LANES] {
    let start = (z * BLOCK[1] + y) * LANES;
    (&mut block[start..start + LANES]).try_into().expect("a row's length")
}
