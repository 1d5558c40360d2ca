//! Inside or outside, one bit per grid point, with a layer of outside all round.
//!
//! Padded indices run from 0 to `n + 1` along each axis; grid point `i` has the padded index `i + 1`.

use rayon::prelude::*;

use crate::geometry::GridShape;
use crate::lattice::NO_PARTICLE;

/// Inside bits of a padded grid, row by row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct InsideBits {
    /// Shape of the grid without its padding.
    pub(crate) shape: GridShape,
    /// Words per row.
    pub(crate) words: usize,
    bits: Vec<u64>,
}

impl InsideBits {
    /// A point is inside when its value is above zero (so NaN is outside) and, where there is a lattice, it holds a particle.
    pub(crate) fn new(shape: GridShape, values: &[f32], particle_at: Option<&[u32]>) -> Self {
        let GridShape { nx, ny, nz } = shape;
        let words = (nx + 2).div_ceil(64);
        let mut bits = vec![0; words * (ny + 2) * (nz + 2)];
        bits.par_chunks_mut(words * (ny + 2)).enumerate().for_each(|(k, layer)| {
            if k == 0 || k == nz + 1 {
                return;
            }
            for (j, row) in layer.chunks_mut(words).enumerate().skip(1).take(ny) {
                let from = ((k - 1) * ny + j - 1) * nx;
                let particles = particle_at.map(|p| &p[from..from + nx]);
                fill_row(row, &values[from..from + nx], particles);
            }
        });
        Self { shape, words, bits }
    }

    /// The words of a row, by padded indices.
    #[inline]
    pub(crate) fn row(&self, j: usize, k: usize) -> &[u64] {
        let from = (k * (self.shape.ny + 2) + j) * self.words;
        &self.bits[from..from + self.words]
    }

    /// Whether a point is inside, by padded indices.
    #[inline]
    pub(crate) fn get(&self, [i, j, k]: [usize; 3]) -> bool {
        self.row(j, k)[i / 64] >> (i % 64) & 1 == 1
    }
}

/// Word `w` of a row moved down by one place, so that bit `i` holds the bit of point `i + 1`.
#[inline]
pub(crate) fn next_point(row: &[u64], w: usize) -> u64 {
    row[w] >> 1 | row.get(w + 1).map_or(0, |next| next << 63)
}

fn fill_row(row: &mut [u64], values: &[f32], particles: Option<&[u32]>) {
    for (w, chunk) in values.chunks(64).enumerate() {
        let mut flags = [0_u8; 64];
        for (flag, value) in flags.iter_mut().zip(chunk) {
            *flag = u8::from(*value > 0.0);
        }
        if let Some(particles) = particles {
            for (flag, particle) in flags.iter_mut().zip(&particles[64 * w..]) {
                *flag &= u8::from(*particle != NO_PARTICLE);
            }
        }
        let mut mask = 0;
        for (byte, eight) in flags.as_chunks::<8>().0.iter().enumerate() {
            // Eight 0/1 bytes gathered into eight bits: each byte is multiplied into its place of the top byte.
            mask |= (u64::from_le_bytes(*eight).wrapping_mul(0x0102_0408_1020_4080) >> 56) << (8 * byte);
        }
        row[w] |= mask << 1;
        if mask >> 63 == 1 {
            row[w + 1] |= 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_follow_the_values_across_word_borders() {
        for nx in [1, 5, 61, 62, 63, 64, 65, 127, 130] {
            let shape = GridShape::new(nx, 2, 3);
            let mut values: Vec<f32> = (0..shape.len()).map(|i| if i * 7 % 11 < 5 { 0.5 } else { -0.5 }).collect();
            values[0] = f32::NAN;
            values[1] = 0.0;
            let bits = InsideBits::new(shape, &values, None);
            for k in 0..5 {
                for j in 0..4 {
                    for i in 0..nx + 2 {
                        let padded = i == 0 || j == 0 || k == 0 || i > nx || j > 2 || k > 3;
                        let expected = !padded && values[shape.linear([i - 1, j - 1, k - 1])] > 0.0;
                        assert_eq!(bits.get([i, j, k]), expected, "{nx}: {i} {j} {k}");
                    }
                }
            }
        }
    }
}
