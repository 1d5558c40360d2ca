//! The stiffness matrix at rest times a vector, one block at a time.

use multiversion::multiversion;

use super::halo::{HALO_LEN, Halo, halo_row};
use super::laws::{Alive, SpringConstant};
use super::rows::{LANES, column_of, row_of, row_of_block_mut, rows_around};
use crate::lattice::layout::{BLOCK, BLOCK_LEN};
use crate::lattice::neighbours::{OFFSETS, family};

/// Writes `K u` of one block for springs of constants `stiffness` and cells of volume modulus `modulus`.
///
/// - `u` x, y, z with halo; `out` x, y, z.
/// - `modulus`: of the cell above each grid point, with halo, 0 where a spring of the cell is severed; `None` when all are.
/// - `cells`: buffer for the rate of volume of each cell.
///
/// # Accuracy
/// f32, each row within 1e-5 of its largest entry times the vector.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw+avx2+fma", "x86_64+avx2+fma"), dispatcher = "direct")]
pub fn apply<K: SpringConstant, A: Alive>(
    stiffness: K,
    alive: A,
    modulus: Option<&Halo>,
    pitch: f32,
    u: [&Halo; 3],
    cells: &mut Halo,
    out: [&mut [f32; BLOCK_LEN]; 3],
) {
    if let Some(modulus) = modulus {
        volume_rates(modulus, pitch, u, cells);
    }
    let [out_x, out_y, out_z] = out;
    for z in 0..BLOCK[2] {
        for y in 0..BLOCK[1] {
            let around = u.map(|halo| rows_around(halo, y, z));
            let stiffness = stiffness.row(y, z);
            let alive = alive.row(y, z);
            let mut sum = [[0.0_f32; LANES]; 3];
            // No spring, and so no whole cell.
            if !A::any(&alive) {
                *row_of_block_mut(out_x, y, z) = sum[0];
                *row_of_block_mut(out_y, y, z) = sum[1];
                *row_of_block_mut(out_z, y, z) = sum[2];
                continue;
            }
            for lane in 0..LANES {
                let mut force = [0.0_f32; 3];
                macro_rules! springs { ($($d:literal)*) => { $( {
                    const OFFSET: [f32; 3] = [OFFSETS[$d][0] as f32, OFFSETS[$d][1] as f32, OFFSETS[$d][2] as f32];
                    const SHARE: f32 = 1.0 / family($d) as f32;
                    let mut along = 0.0_f32;
                    for axis in 0..3 {
                        if OFFSET[axis] != 0.0 {
                            let far = around[axis][const { row_of($d) }][lane + const { column_of($d) }];
                            along += OFFSET[axis] * (around[axis][4][lane + 1] - far);
                        }
                    }
                    let pull = A::keep::<$d>(&alive, lane, K::of::<$d>(&stiffness, lane)) * SHARE * along;
                    for axis in 0..3 {
                        if OFFSET[axis] != 0.0 {
                            force[axis] += OFFSET[axis] * pull;
                        }
                    }
                } )* } }
                springs!(0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25);
                for axis in 0..3 {
                    sum[axis][lane] = force[axis];
                }
            }
            if modulus.is_some() {
                let rates = rows_around(cells, y, z);
                for lane in 0..LANES {
                    for octant in 0..8 {
                        let side = [octant & 1, octant >> 1 & 1, octant >> 2];
                        let rate = rates[side[2] * 3 + side[1]][lane + side[0]];
                        for axis in 0..3 {
                            // A particle is a lower corner of the cell above it.
                            sum[axis][lane] += if side[axis] == 1 { -rate } else { rate };
                        }
                    }
                }
            }
            *row_of_block_mut(out_x, y, z) = sum[0];
            *row_of_block_mut(out_y, y, z) = sum[1];
            *row_of_block_mut(out_z, y, z) = sum[2];
        }
    }
}

/// `lambda h^3 g (sum g . u)` of every cell that touches the block, without the sign of its corner.
#[inline(always)]
fn volume_rates(modulus: &Halo, pitch: f32, u: [&Halo; 3], cells: &mut Halo) {
    // h^3 over (4 h)^2.
    let scale = pitch / 16.0;
    for z in -1..BLOCK[2] as isize {
        for y in -1..BLOCK[1] as isize {
            let own = halo_row(y, z);
            if modulus[own..=own + LANES].iter().all(|&modulus| modulus == 0.0) {
                cells[own..=own + LANES].fill(0.0);
                continue;
            }
            let rows = [own, halo_row(y + 1, z), halo_row(y, z + 1), halo_row(y + 1, z + 1)];
            for lane in 0..=LANES {
                let mut rate = 0.0_f32;
                for corner in 0..8 {
                    let side = [corner & 1, corner >> 1 & 1, corner >> 2];
                    let place = rows[side[2] * 2 + side[1]] + lane + side[0];
                    for axis in 0..3 {
                        rate += if side[axis] == 1 { u[axis][place] } else { -u[axis][place] };
                    }
                }
                cells[own + lane] = scale * modulus[own + lane] * rate;
            }
        }
    }
}

/// A halo of zeros.
pub const NO_CELLS: Halo = [0.0; HALO_LEN];
