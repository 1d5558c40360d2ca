//! Numbers that look random but are the same everywhere.
#![allow(dead_code, unreachable_pub)]

use yawara::geometry::Vector3;

/// A small generator (SplitMix64, Steele, Lea and Flood 2014) so that the tests need no seed from outside.
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in 0..1.
    pub fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub fn below(&mut self, count: usize) -> usize {
        (self.unit() * count as f64) as usize
    }

    /// Each part in -1..1.
    pub fn vector(&mut self) -> Vector3 {
        Vector3::from_fn(|_, _| 2.0 * self.unit() - 1.0)
    }
}
