//! Lanes of f32 for the hot loop: one trait, one file per instruction set.
//!
//! The loop is written once over [`Vector`] and compiled for each. A register's type may only be used inside a function
//! compiled for its instruction set; [`super::dispatch`] is where that is chosen, and the only place that may do so.

#[cfg(target_arch = "x86_64")]
pub(super) mod avx2;
#[cfg(target_arch = "x86_64")]
pub(super) mod avx512;
#[cfg(target_arch = "aarch64")]
pub(super) mod neon;
pub(super) mod plain;

use std::ops::{Add, Div, Mul, Sub};

/// A register of f32 lanes.
///
/// Additions, multiplications, divisions and square roots round as IEEE 754 says, on every instruction set.
pub trait Vector: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> {
    /// Number of lanes; divides [`super::rows::LANES`].
    const LANES: usize;
    /// The same value in every lane.
    fn splat(value: f32) -> Self;
    /// The values from `at` on.
    ///
    /// # Panics
    /// If there are too few.
    fn load(values: &[f32], at: usize) -> Self;
    /// Writes the lanes from `at` on.
    ///
    /// # Panics
    /// If there is too little room.
    fn store(self, values: &mut [f32], at: usize);
    /// `self * factor + term`, rounded once where the instruction set can.
    fn mul_add(self, factor: Self, term: Self) -> Self;
    /// `term - self * factor`, rounded once where the instruction set can.
    fn negative_mul_add(self, factor: Self, term: Self) -> Self;
    /// The larger of two; `other` where one is not a number.
    fn max(self, other: Self) -> Self;
    /// The smaller of two; `other` where one is not a number.
    fn min(self, other: Self) -> Self;
    /// Square root, correctly rounded.
    fn sqrt(self) -> Self;
    /// `1 / sqrt(self)` within 2e-7 of its size, for positive numbers; always the same for the same number.
    fn inverse_sqrt(self) -> Self;
    /// `1 / self` within 2e-7 of its size; always the same for the same number.
    fn inverse(self) -> Self;
    /// The lanes where `sign` is above 0, 0 in the others.
    fn where_positive(self, sign: Self) -> Self;
    /// Whether the magnitudes of all lanes are below `limit`; not where one is not a number.
    fn all_within(self, limit: f32) -> bool;
    /// The lanes where the magnitude of `key` is below `limit`, those of `other` in the rest.
    fn where_within(self, key: Self, limit: f32, other: Self) -> Self;
    /// The lanes whose word has the bit, 0 in the others.
    ///
    /// - `words`: one per lane, from `at` on.
    ///
    /// # Panics
    /// If there are too few.
    fn keep(self, words: &[u32], at: usize, bit: u32) -> Self;
}

/// Asks for the cache line of a value that will be needed soon.
#[inline(always)]
#[allow(unsafe_code)]
pub fn fetch<T>(values: &[T], at: usize) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T1, _mm_prefetch};
        let value = std::ptr::from_ref(&values[at]);
        // SAFETY: the address is that of a value; nothing is read or written by asking.
        unsafe { _mm_prefetch::<_MM_HINT_T1>(value.cast()) }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = &values[at];
}

/// Implements the four operators of a register type by its intrinsics.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
macro_rules! operators {
    ($register:ident: $($operator:ident $method:ident $intrinsic:ident),*) => { $(
        impl std::ops::$operator for $register {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: registers of this type exist only in functions compiled for their instruction set.
                Self(unsafe { $intrinsic(self.0, other.0) })
            }
        }
    )* };
}
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
use operators;

#[cfg(test)]
mod tests {
    use super::*;
    #[cfg(target_arch = "x86_64")]
    use crate::kernel::dispatch::InstructionSet;

    /// Every operation, lane by lane, against the same in plain f32 or f64.
    #[inline(always)]
    fn operations_agree<V: Vector>(fused: bool) -> usize {
        let mut state = 1_u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            // Any size from 1e-30 to 1e15.
            10_f64.powf(45.0 * f64::from(state >> 8) / f64::from(1 << 24) - 30.0) as f32
        };
        let mut compared = 0;
        for _ in 0..2000 {
            let mut values = || -> [f32; 16] { std::array::from_fn(|_| random()) };
            let [a, b, c] = [values(), values(), values()];
            let words: [u32; 16] = values().map(f32::to_bits);
            let get = |result: V| {
                let mut out = [0.0; 17];
                result.store(&mut out, 1);
                out
            };
            let [va, vb, vc] = [&a, &b, &c].map(|values| V::load(values, 0));
            let minus = V::splat(0.0) - va;
            let results = [
                get(va + vb),
                get(va - vb),
                get(va * vb),
                get(va / vb),
                get(va.sqrt()),
                get(va.max(vb)),
                get(va.min(vb)),
                get(va.mul_add(vb, vc)),
                get(va.negative_mul_add(vb, vc)),
                get(va.where_positive(vb) + va.where_positive(minus)),
                get(va.where_within(minus, b[0], vc)),
                get(va.keep(&words, 0, 3)),
            ];
            let lanes = &a[..V::LANES];
            assert_eq!(minus.all_within(b[0]), lanes.iter().all(|&a| a < b[0]));
            let odd = V::load(&[&lanes[1..], &[f32::NAN]].concat(), 0);
            assert!(minus.all_within(f32::INFINITY) && !odd.all_within(f32::INFINITY));
            let [inverse_sqrt, inverse] = [get(va.inverse_sqrt()), get(va.inverse())];
            for lane in 0..V::LANES {
                let limit = b[0];
                let (a, b, c) = (a[lane], b[lane], c[lane]);
                let (product_sum, difference) =
                    if fused { (a.mul_add(b, c), (-a).mul_add(b, c)) } else { (a * b + c, c - a * b) };
                let kept = if words[lane] >> 3 & 1 == 1 { a } else { 0.0 };
                let chosen = if a < limit { a } else { c };
                let expected = [
                    a + b,
                    a - b,
                    a * b,
                    a / b,
                    a.sqrt(),
                    a.max(b),
                    a.min(b),
                    product_sum,
                    difference,
                    a,
                    chosen,
                    kept,
                ];
                assert_eq!(results.map(|result| result[lane + 1].to_bits()), expected.map(f32::to_bits));
                let off = |found: f32, exact: f64| (f64::from(found) / exact - 1.0).abs();
                assert!(off(inverse_sqrt[lane + 1], 1.0 / f64::from(a).sqrt()) < 2e-7, "{a:e}");
                assert!(off(inverse[lane + 1], 1.0 / f64::from(a)) < 2e-7, "{a:e}");
                compared += 1;
            }
        }
        compared
    }

    #[test]
    #[allow(unsafe_code)]
    fn every_instruction_set_computes_the_same() {
        assert_eq!(operations_agree::<plain::Plain>(false), 8_000);
        #[cfg(target_arch = "aarch64")]
        assert_eq!(operations_agree::<neon::Neon>(true), 8_000);
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = "avx2,fma")]
            fn of_avx2() -> usize {
                operations_agree::<avx2::Avx2>(true)
            }
            #[target_feature(enable = "avx2,fma,avx512f,avx512vl,avx512dq,avx512bw")]
            fn of_avx512() -> usize {
                operations_agree::<avx512::Avx512>(true)
            }
            if InstructionSet::Avx2.available() {
                // SAFETY: the machine has it.
                assert_eq!(unsafe { of_avx2() }, 16_000);
            }
            if InstructionSet::Avx512.available() {
                // SAFETY: the machine has it.
                assert_eq!(unsafe { of_avx512() }, 32_000);
            }
        }
    }
}
