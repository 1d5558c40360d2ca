//! How far neighbours alternate between parting and meeting from one step to the next, one block at a time: what an
//! unstable step looks like.

use multiversion::multiversion;

use super::halo::Halo;
use super::rows::{LANES, Lanes, column_of, row_of, row_of_block, rows_around};
use crate::lattice::layout::{BLOCK, BLOCK_LEN};

/// Sums over springs of squared relative velocities [m^2/s^2].
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Alternation {
    /// Of the difference of two steps: what changes.
    pub difference: f64,
    /// Of their sum: what stays.
    pub sum: f64,
}

/// Adds up `|w - w'|^2` and `|w + w'|^2` over the springs that start in a block, each once, with `w` and `w'` the velocities
/// of their ends relative to each other now and a step earlier.
///
/// - `now`, `before`: velocity x, y, z with halo [m/s]; `alive`: living springs, one bit per direction.
///
/// Rounded like a sum of 1664 terms in f32; same bits on every instruction set.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw+avx2+fma", "x86_64+avx2+fma"), dispatcher = "direct")]
pub fn alternation(now: [&Halo; 3], before: [&Halo; 3], alive: &[u32; BLOCK_LEN]) -> Alternation {
    let [mut differences, mut sums]: [Lanes; 2] = [[0.0; LANES]; 2];
    for z in 0..BLOCK[2] {
        for y in 0..BLOCK[1] {
            let alive = row_of_block(alive, y, z);
            if alive.iter().all(|&springs| springs == 0) {
                continue;
            }
            let (now, before) = (now.map(|halo| rows_around(halo, y, z)), before.map(|halo| rows_around(halo, y, z)));
            for lane in 0..LANES {
                let [mut difference, mut sum] = [0.0_f32; 2];
                macro_rules! forward_springs { ($($d:literal)*) => { $( {
                    let [mut changing, mut staying] = [0.0_f32; 2];
                    for axis in 0..3 {
                        let (row, column) = (const { row_of($d) }, lane + const { column_of($d) });
                        let w = now[axis][row][column] - now[axis][4][lane + 1];
                        let earlier = before[axis][row][column] - before[axis][4][lane + 1];
                        changing += (w - earlier) * (w - earlier);
                        staying += (w + earlier) * (w + earlier);
                    }
                    let living = ((alive[lane] >> $d) & 1).wrapping_neg();
                    difference += f32::from_bits(changing.to_bits() & living);
                    sum += f32::from_bits(staying.to_bits() & living);
                } )* } }
                forward_springs!(13 14 15 16 17 18 19 20 21 22 23 24 25);
                differences[lane] += difference;
                sums[lane] += sum;
            }
        }
    }
    let total = |lanes: Lanes| lanes.into_iter().map(f64::from).sum();
    Alternation { difference: total(differences), sum: total(sums) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::halo::halo_row;
    use crate::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS, OFFSETS};

    /// Every spring by hand, in f64.
    #[test]
    fn the_sums_are_those_over_all_springs() {
        let mut state = 1_u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        let at = |[x, y, z]: [isize; 3]| halo_row(y, z) + (x + 1) as usize;
        for _ in 0..20 {
            let mut velocity = || -> [Halo; 3] { std::array::from_fn(|_| std::array::from_fn(|_| 5.0 + random())) };
            let (now, before) = (velocity(), velocity());
            let mut alive = [0_u32; BLOCK_LEN];
            let mut expected = Alternation::default();
            for (slot, alive) in alive.iter_mut().enumerate() {
                let [x, y, z] = [slot % BLOCK[0], slot / BLOCK[0] % BLOCK[1], slot / BLOCK[0] / BLOCK[1]];
                let own = [x, y, z].map(|n| n as isize);
                for d in (0..NEIGHBOURS).filter(|_| random() < 0.3) {
                    *alive |= 1 << d;
                    // The other half belongs to the other end.
                    if d < FIRST_FORWARD {
                        continue;
                    }
                    let other = [0, 1, 2].map(|axis| own[axis] + OFFSETS[d][axis] as isize);
                    for axis in 0..3 {
                        let relative = |of: &[Halo; 3]| f64::from(of[axis][at(other)]) - f64::from(of[axis][at(own)]);
                        expected.difference += (relative(&now) - relative(&before)).powi(2);
                        expected.sum += (relative(&now) + relative(&before)).powi(2);
                    }
                }
            }
            let found = alternation(now.each_ref(), before.each_ref(), &alive);
            assert!((found.difference / expected.difference - 1.0).abs() < 1e-5, "{found:?}, {expected:?}");
            assert!((found.sum / expected.sum - 1.0).abs() < 1e-5, "{found:?}, {expected:?}");
            assert!(expected.difference > 100.0 && expected.difference != expected.sum);
        }
    }
}
