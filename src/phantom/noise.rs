//! Numbers that depend on a seed and a place only, so threads and their order cannot change them.

use crate::geometry::{Point3, Vector3};
use crate::splitmix::{GOLDEN, SplitMix, mix};

/// A stream of random numbers (SplitMix64).
pub(super) struct Stream(SplitMix);

impl Stream {
    /// The stream numbered `purpose` of a seed; streams of one seed do not overlap in practice.
    pub(super) fn new(seed: u64, purpose: u64) -> Self {
        Self(SplitMix::new(mix(mix(seed.wrapping_add(GOLDEN)) ^ purpose.wrapping_mul(GOLDEN))))
    }

    /// Uniform in [low, high).
    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.unit()
    }

    /// A direction, uniform on the sphere.
    pub(super) fn direction(&mut self) -> Vector3 {
        let z = self.between(-1.0, 1.0);
        let turn = self.between(0.0, std::f64::consts::TAU);
        let r = (1.0 - z * z).max(0.0).sqrt();
        Vector3::new(r * turn.cos(), r * turn.sin(), z)
    }
}

/// A smooth random field: a few plane waves. What makes a surface organic rather than geometric.
pub(super) struct Lumps {
    waves: Vec<(Vector3, f64)>,
    amplitude: f64,
}

impl Lumps {
    /// Waves of about `length` [mm]; the field stays within `amplitude` of zero.
    pub(super) fn new(stream: &mut Stream, length: f64, amplitude: f64) -> Self {
        const WAVES: usize = 5;
        let waves = (0..WAVES)
            .map(|_| {
                let number = std::f64::consts::TAU / (length * stream.between(0.75, 1.5));
                (stream.direction() * number, stream.between(0.0, std::f64::consts::TAU))
            })
            .collect();
        Self { waves, amplitude: amplitude / WAVES as f64 }
    }

    /// The field at a place.
    pub(super) fn at(&self, p: Point3) -> f64 {
        self.waves.iter().map(|(wave, phase)| (wave.dot(&p.coords) + phase).sin()).sum::<f64>() * self.amplitude
    }
}

/// 64 random bits of a grid point, the same for the same seed and point.
pub(crate) fn bits_at(seed: u64, [i, j, k]: [i64; 3]) -> u64 {
    let place = (i as u64) ^ (j as u64).rotate_left(21) ^ (k as u64).rotate_left(42);
    mix(seed ^ mix(place.wrapping_add(GOLDEN)))
}

/// Unit-variance value of one voxel: the sum of four uniform parts of a hash, close to a normal distribution.
fn white(seed: u64, ijk: [i64; 3]) -> f32 {
    let bits = bits_at(seed, ijk);
    let sum = (0..4).map(|part| ((bits >> (16 * part)) & 0xffff) as f32).sum::<f32>();
    // Each part has mean 32767.5 and variance 65536^2 / 12.
    (sum - 4.0 * 32767.5) / (65536.0 / 3.0_f32.sqrt())
}

/// Unit-variance noise of slice `k`, smoothed within the slice by the weights 1 2 1 along x and y, as the
/// reconstruction kernel of a CT does. Shape `[ny, nx]`; voxel (i, j) of the slice has index `(i + i0, j + j0)`.
pub(super) fn slice_noise(seed: u64, nx: usize, ny: usize, k: i64, [i0, j0]: [i64; 2]) -> Vec<f32> {
    let wide = nx + 2;
    let mut along_x = Vec::with_capacity(nx * (ny + 2));
    let mut row = vec![0.0_f32; wide];
    for j in 0..ny + 2 {
        for (i, value) in row.iter_mut().enumerate() {
            *value = white(seed, [i as i64 - 1 + i0, j as i64 - 1 + j0, k]);
        }
        along_x.extend(row.windows(3).map(|w| w[0] + 2.0 * w[1] + w[2]));
    }
    // 1 2 1 has a sum of squares of 6 along each axis.
    (0..nx * ny).map(|at| (along_x[at] + 2.0 * along_x[at + nx] + along_x[at + 2 * nx]) / 6.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_unit_variance_and_the_kernels_correlation() {
        let (nx, ny) = (300, 300);
        let noise = slice_noise(7, nx, ny, 3, [-150, -150]);
        let n = (nx * ny) as f64;
        let mean = noise.iter().map(|&v| f64::from(v)).sum::<f64>() / n;
        let variance = noise.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>() / n;
        let beside = noise.windows(2).map(|w| f64::from(w[0] * w[1])).sum::<f64>() / n;
        // 90 000 values of which about 1 in 7 is independent: standard errors near 0.01.
        assert!(mean.abs() < 0.03, "mean {mean}");
        assert!((variance - 1.0).abs() < 0.05, "variance {variance}");
        assert!((beside - 4.0 / 6.0).abs() < 0.05, "correlation {beside}");
    }

    #[test]
    fn noise_belongs_to_the_voxel_not_to_the_slice_window() {
        let whole = slice_noise(1, 20, 20, 0, [0, 0]);
        let part = slice_noise(1, 5, 5, 0, [4, 6]);
        assert_eq!(part[7], whole[(6 + 1) * 20 + 4 + 2]);
        assert_ne!(whole, slice_noise(2, 20, 20, 0, [0, 0]));
        assert_ne!(whole, slice_noise(1, 20, 20, 1, [0, 0]));
    }
}
