//! How fast neighbours part, one block at a time: what tells when a shape may have changed.

use multiversion::multiversion;

use super::halo::{Halo, halo_row};
use super::rows::{LANES, Lanes, column_of, row_of, row_of_block, rows_around};
use super::simd::Vector;
use crate::lattice::layout::{BLOCK, BLOCK_LEN};

/// Beyond every velocity that means anything, and its square is still a number [m/s].
const BEYOND: f32 = 1e18;

/// Smallest and largest value of each component: `[component][smallest, largest]`.
type Ranges<V> = [[V; 2]; 3];

/// The largest squared difference of velocities within any cell whose lowest corner is in the block [m^2/s^2].
///
/// The cells that touch a block are its own and those of the seven blocks below: no spring of a block's particles parts faster
/// than the largest of these eight says, and at most a few times slower.
///
/// - `velocity` x, y, z with halo [m/s]; `present`: 1 where a particle counts, else 0.
///
/// Exact in f32 up to the rounding of the squares.
#[inline(always)]
pub(super) fn widest_cell<V: Vector>(velocity: [&Halo; 3], present: &Halo) -> f32 {
    let mut widest = V::splat(0.0);
    for at in (0..LANES).step_by(V::LANES) {
        let mut below = [[[V::splat(0.0); 2]; 3]; BLOCK[1]];
        for z in 0..=BLOCK[2] as isize {
            let mut before = along_x::<V>(velocity, present, halo_row(0, z) + 1 + at);
            for y in 0..BLOCK[1] {
                let row = along_x::<V>(velocity, present, halo_row(y as isize + 1, z) + 1 + at);
                let face = joined(before, row);
                if z > 0 {
                    let mut squared = V::splat(0.0);
                    for [low, high] in joined(face, below[y]) {
                        // Empty cells have it the wrong way round.
                        let width = (high - low).max(V::splat(0.0));
                        squared = squared + width * width;
                    }
                    widest = squared.max(widest);
                }
                below[y] = face;
                before = row;
            }
        }
    }
    let mut lanes = [0.0; LANES];
    widest.store(&mut lanes, 0);
    lanes.into_iter().fold(0.0, larger)
}

/// Ranges over each two neighbours of a halo row, from `start` on.
#[inline(always)]
fn along_x<V: Vector>(velocity: [&Halo; 3], present: &Halo, start: usize) -> Ranges<V> {
    let beyond = V::splat(BEYOND);
    let away = beyond - V::load(present, start) * beyond;
    let away_next = beyond - V::load(present, start + 1) * beyond;
    let mut ranges = [[beyond; 2]; 3];
    for component in 0..3 {
        let (own, next) = (V::load(velocity[component], start), V::load(velocity[component], start + 1));
        ranges[component] = [(own + away).min(next + away_next), (own - away).max(next - away_next)];
    }
    ranges
}

#[inline(always)]
fn joined<V: Vector>(a: Ranges<V>, b: Ranges<V>) -> Ranges<V> {
    let mut out = a;
    for component in 0..3 {
        out[component] = [a[component][0].min(b[component][0]), a[component][1].max(b[component][1])];
    }
    out
}

/// One instruction, unlike [`f32::max`], which has NaN to care for.
#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The largest squared velocity of a particle of the block relative to one it is joined to [m^2/s^2].
///
/// - `velocity` x, y, z with halo [m/s]; `alive`: living springs, one bit per direction.
///
/// Same bits on every instruction set.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw+avx2+fma", "x86_64+avx2+fma"), dispatcher = "direct")]
pub fn fastest_spring(velocity: [&Halo; 3], alive: &[u32; BLOCK_LEN]) -> f32 {
    let mut fastest: Lanes = [0.0; LANES];
    for z in 0..BLOCK[2] {
        for y in 0..BLOCK[1] {
            let around = velocity.map(|halo| rows_around(halo, y, z));
            let alive = row_of_block(alive, y, z);
            if alive.iter().all(|&springs| springs == 0) {
                continue;
            }
            for lane in 0..LANES {
                let mut most = fastest[lane];
                macro_rules! springs { ($($d:literal)*) => { $( {
                    let mut squared = 0.0_f32;
                    for rows in &around {
                        let w = rows[const { row_of($d) }][lane + const { column_of($d) }] - rows[4][lane + 1];
                        squared += w * w;
                    }
                    let living = f32::from_bits(squared.to_bits() & ((alive[lane] >> $d) & 1).wrapping_neg());
                    most = larger(most, living);
                } )* } }
                springs!(0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25);
                fastest[lane] = most;
            }
        }
    }
    fastest.into_iter().fold(0.0, larger)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::dispatch::{InstructionSet, widest_cell_of_block};
    use crate::kernel::halo::HALO_LEN;
    use crate::lattice::neighbours::{NEIGHBOURS, OFFSETS};

    /// Every cell and every spring by hand; half of the grid points are empty.
    #[test]
    fn the_fastest_pair_is_found() {
        let mut state = 1_u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        let at = |[x, y, z]: [isize; 3]| halo_row(y, z) + (x + 1) as usize;
        for _ in 0..20 {
            let velocity: [Halo; 3] = std::array::from_fn(|_| std::array::from_fn(|_| 5.0 + random()));
            let present: Halo = std::array::from_fn(|_| if random() < 0.5 { 1.0 } else { 0.0 });
            let mut alive = [0_u32; BLOCK_LEN];
            let [mut widest, mut fastest] = [0.0_f32; 2];
            let dims = BLOCK.map(|n| n as isize);
            for z in 0..dims[2] {
                for y in 0..dims[1] {
                    for x in 0..dims[0] {
                        let corners = (0..8).map(|c| at([x + (c & 1), y + (c >> 1 & 1), z + (c >> 2)]));
                        let corners: Vec<usize> = corners.filter(|&place| present[place] > 0.0).collect();
                        let width = |values: &Halo| {
                            let all = || corners.iter().map(|&place| values[place]);
                            (all().fold(f32::MIN, f32::max) - all().fold(f32::MAX, f32::min)).max(0.0)
                        };
                        widest = widest.max(velocity.iter().map(|values| width(values).powi(2)).sum());
                        if present[at([x, y, z])] == 0.0 {
                            continue;
                        }
                        for d in 0..NEIGHBOURS {
                            let [i, j, k] = OFFSETS[d].map(|o| o as isize);
                            let (own, other) = (at([x, y, z]), at([x + i, y + j, z + k]));
                            if present[other] > 0.0 && random() < 0.1 {
                                alive[((z * dims[1] + y) * dims[0] + x) as usize] |= 1 << d;
                                let parted = velocity.iter().map(|values| (values[other] - values[own]).powi(2));
                                fastest = fastest.max(parted.sum());
                            }
                        }
                    }
                }
            }
            let velocity = velocity.each_ref();
            for set in InstructionSet::ALL.into_iter().filter(|set| set.available()) {
                assert_eq!(widest_cell_of_block(set, velocity, &present), widest);
            }
            assert_eq!(fastest_spring(velocity, &alive), fastest);
            assert!(0.0 < fastest && fastest < widest && widest < 3.0);
        }
        let best = InstructionSet::best();
        assert_eq!(widest_cell_of_block(best, [&[1.0; HALO_LEN]; 3], &[0.0; HALO_LEN]), 0.0);
    }
}
