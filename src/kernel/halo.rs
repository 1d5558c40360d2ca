//! One block and the layer of grid points around it, copied together so that the hot loop has no borders.

use bytemuck::{Pod, cast_slice};
use multiversion::multiversion;

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
pub const fn halo_row(y: isize, z: isize) -> usize {
    ((z + 1) as usize * (BLOCK[1] + 2) + (y + 1) as usize) * HALO_ROW
}

/// Every row of a halo, see [`gather_rows`].
pub const ALL_ROWS: u128 = (1 << HALO_ROWS) - 1;

/// Along an axis, of the block before, itself and the one after: the first of its layers in a halo, how many, and where they go.
const fn layers(size: usize) -> [[usize; 3]; 3] {
    [[size - 1, 1, 0], [0, size, 1], [0, 1, size + 1]]
}
const LAYERS: [[[usize; 3]; 3]; 2] = [layers(BLOCK[1]), layers(BLOCK[2])];

/// What missing blocks hold, in any type of field.
static EMPTY: [u64; BLOCK_LEN] = [0; BLOCK_LEN];

/// Copies a block and the layer around it. Grid points of missing blocks read as 0.
///
/// - `field`: block order, see [`crate::lattice::layout::BlockLayout`].
/// - `neighbours`: the 27 blocks around, itself at 13.
///
/// # Panics
/// If `field` does not hold a block that `neighbours` names.
pub fn gather<T: Pod>(field: &[T], neighbours: &[u32; 27], halo: &mut [T; HALO_LEN]) {
    gather_rows(field, neighbours, ALL_ROWS, halo);
}

/// [`gather`] for some rows only, the others read as 0: organs leave half of their blocks' rows empty.
///
/// - `rows`: one bit per row, see [`crate::lattice::layout::BlockLayout::rows`].
///
/// # Panics
/// If `field` does not hold a block that `neighbours` names.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw+avx2+fma", "x86_64+avx2+fma"), dispatcher = "direct")]
pub fn gather_rows<T: Pod>(field: &[T], neighbours: &[u32; 27], rows: u128, halo: &mut [T; HALO_LEN]) {
    let blocks = field.as_chunks::<BLOCK_LEN>().0;
    let empty: &[T; BLOCK_LEN] = cast_slice(&EMPTY).first_chunk().expect("no field is wider");
    let rows_of = |place: usize| match neighbours[place] {
        NO_BLOCK => empty.as_chunks::<{ BLOCK[0] }>().0,
        block => blocks[block as usize].as_chunks().0,
    };
    let halo = halo.as_chunks_mut::<HALO_ROW>().0;
    // Plain loops and whole arrays: without calls that only an optimiser across units takes out.
    for block_z in 0..3 {
        for block_y in 0..3 {
            let place = (block_z * 3 + block_y) * 3;
            let (before, own, after) = (rows_of(place), rows_of(place + 1), rows_of(place + 2));
            let ([from_y, count_y, to_y], [from_z, count_z, to_z]) = (LAYERS[0][block_y], LAYERS[1][block_z]);
            for z in 0..count_z {
                for y in 0..count_y {
                    let row = (to_z + z) * (BLOCK[1] + 2) + to_y + y;
                    let to = &mut halo[row];
                    if rows >> row & 1 == 0 {
                        *to = [T::zeroed(); HALO_ROW];
                        continue;
                    }
                    let from = (from_z + z) * BLOCK[1] + from_y + y;
                    to[0] = before[from][BLOCK[0] - 1];
                    *to[1..].first_chunk_mut().expect("a row of the block") = own[from];
                    to[HALO_ROW - 1] = after[from][0];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Affine, Grid, GridShape};
    use crate::lattice::build::{NO_ORGAN, build};
    use crate::lattice::layout::BlockLayout;
    use crate::volume::Volume;

    /// Every halo of a ragged lattice against the grid, point by point.
    #[test]
    fn a_halo_is_what_lies_around_its_block() {
        let shape = GridShape::new(40, 19, 27);
        let grid = Grid { shape, affine: Affine::from_spacing([1.0; 3], [0.0; 3]).unwrap() };
        let hole = |[i, j, k]: [usize; 3]| i > 14 && j > 5 && k > 6 && i < 34 && j < 17 && k < 26;
        let organs = (0..shape.len()).map(|l| if hole(shape.ijk(l)) { NO_ORGAN } else { 0 }).collect();
        let lattice = build(&Volume::from_vec(grid, organs)).unwrap();
        let layout = BlockLayout::new(&lattice);
        let mut field = vec![0.0; layout.slots()];
        for (particle, &slot) in layout.slot.iter().enumerate() {
            field[slot as usize] = lattice.points[particle] as f32 + 1.0;
        }
        let mut halo = [f32::NAN; HALO_LEN];
        let (mut compared, mut left_out) = (0, 0);
        for (block, corner) in (0..layout.blocks.len()).map(|block| (block, layout.corner(block))) {
            gather(&field, &layout.neighbours[block], &mut halo);
            let mut some = [f32::NAN; HALO_LEN];
            gather_rows(&field, &layout.neighbours[block], layout.rows[block], &mut some);
            let own = |y: isize, z: isize| {
                let inside = (0..BLOCK[1] as isize).contains(&y) && (0..BLOCK[2] as isize).contains(&z);
                inside && halo[halo_row(y, z)..][1..=BLOCK[0]].iter().any(|&value| value != 0.0)
            };
            for z in -1..=BLOCK[2] as isize {
                for y in -1..=BLOCK[1] as isize {
                    let row = halo_row(y, z)..halo_row(y, z) + HALO_ROW;
                    let matters = (-1..=1).any(|dz| (-1..=1).any(|dy| own(y + dy, z + dz)));
                    let expected = if matters { &halo[row.clone()] } else { &[0.0; HALO_ROW] };
                    assert_eq!(&some[row], expected, "block {block}, row {y}, {z}");
                    left_out += usize::from(!matters);
                    for x in -1..=BLOCK[0] as isize {
                        let at = [x, y, z];
                        let point = [0, 1, 2].map(|a| corner[a] as isize + at[a]);
                        let dims = lattice.grid.shape.dims();
                        let inside = (0..3).all(|a| point[a] >= 0 && point[a] < dims[a] as isize);
                        let expected = if inside {
                            let linear = lattice.grid.shape.linear(point.map(|p| p as usize));
                            if lattice.particle_at[linear] == u32::MAX { 0.0 } else { linear as f32 + 1.0 }
                        } else {
                            0.0
                        };
                        assert_eq!(halo[halo_row(y, z) + (x + 1) as usize], expected, "block {block} at {at:?}");
                        compared += 1;
                    }
                }
            }
        }
        assert!(compared > 20_000 && left_out > 100, "{compared}, {left_out}");
    }
}
