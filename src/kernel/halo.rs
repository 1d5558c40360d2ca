//! One block and the layer of grid points around it, copied together so that the hot loop has no borders.

use crate::lattice::layout::{BLOCK, BLOCK_LEN, NO_BLOCK};

/// Values in a row of the halo buffer: a block's row and one neighbour at each end.
pub const HALO_ROW: usize = BLOCK[0] + 2;
/// Rows of the halo buffer.
pub const HALO_ROWS: usize = (BLOCK[1] + 2) * (BLOCK[2] + 2);
/// Values in a halo buffer.
pub const HALO_LEN: usize = HALO_ROW * HALO_ROWS;

/// A block of one field with its halo.
pub type Halo = [f32; HALO_LEN];

/// Start of the halo row at (y, z) of the block, each from -1 to the block's size; lane 0 sits one behind the start.
#[inline(always)]
pub fn halo_row(y: isize, z: isize) -> usize {
    ((z + 1) as usize * (BLOCK[1] + 2) + (y + 1) as usize) * HALO_ROW
}

/// Copies a block and the layer around it. Grid points of missing blocks read 0.
///
/// - `field`: block order, see [`crate::lattice::layout::BlockLayout`].
/// - `neighbours`: the 27 blocks around, itself at 13.
///
/// # Panics
/// Never: the buffer has as many rows as are copied.
pub fn gather(field: &[f32], neighbours: &[u32; 27], halo: &mut Halo) {
    let row_of = |block: u32, y: usize, z: usize| -> Option<&[f32]> {
        (block != NO_BLOCK).then(|| {
            let start = block as usize * BLOCK_LEN + (z * BLOCK[1] + y) * BLOCK[0];
            &field[start..start + BLOCK[0]]
        })
    };
    let mut rows = halo.as_chunks_mut::<HALO_ROW>().0.iter_mut();
    for z in 0..BLOCK[2] + 2 {
        let (block_z, local_z) = wrap(z, BLOCK[2]);
        for y in 0..BLOCK[1] + 2 {
            let (block_y, local_y) = wrap(y, BLOCK[1]);
            let row = rows.next().expect("as many rows as the loops visit");
            let middle = (block_z * 3 + block_y) * 3 + 1;
            row[0] = row_of(neighbours[middle - 1], local_y, local_z).map_or(0.0, |r| r[BLOCK[0] - 1]);
            match row_of(neighbours[middle], local_y, local_z) {
                Some(r) => row[1..=BLOCK[0]].copy_from_slice(r),
                None => row[1..=BLOCK[0]].fill(0.0),
            }
            row[HALO_ROW - 1] = row_of(neighbours[middle + 1], local_y, local_z).map_or(0.0, |r| r[0]);
        }
    }
}

/// Which of three blocks (0, 1, 2) a halo index lies in, and where inside it.
fn wrap(halo_index: usize, size: usize) -> (usize, usize) {
    match halo_index {
        0 => (0, size - 1),
        at if at <= size => (1, at - 1),
        _ => (2, 0),
    }
}
