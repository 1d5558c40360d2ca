//! Lanes as an array: for machines without a set of their own here, left to the compiler.

use std::array::from_fn;
use std::ops::{Add, Div, Mul, Sub};

use super::Vector;

const LANES: usize = 4;

/// Four lanes.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct Plain([f32; LANES]);

macro_rules! operators {
    ($($operator:ident $method:ident $sign:tt),*) => { $(
        impl $operator for Plain {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(from_fn(|lane| self.0[lane] $sign other.0[lane]))
            }
        }
    )* };
}
operators!(Add add +, Sub sub -, Mul mul *, Div div /);

impl Vector for Plain {
    const LANES: usize = LANES;

    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; LANES])
    }

    #[inline(always)]
    fn load(values: &[f32], at: usize) -> Self {
        Self(values[at..at + LANES].try_into().expect("as many as lanes"))
    }

    #[inline(always)]
    fn store(self, values: &mut [f32], at: usize) {
        values[at..at + LANES].copy_from_slice(&self.0);
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        self * factor + term
    }

    #[inline(always)]
    fn negative_mul_add(self, factor: Self, term: Self) -> Self {
        term - self * factor
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(from_fn(|lane| if self.0[lane] > other.0[lane] { self.0[lane] } else { other.0[lane] }))
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(from_fn(|lane| if self.0[lane] < other.0[lane] { self.0[lane] } else { other.0[lane] }))
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.map(f32::sqrt))
    }

    #[inline(always)]
    fn inverse_sqrt(self) -> Self {
        Self::splat(1.0) / self.sqrt()
    }

    #[inline(always)]
    fn inverse(self) -> Self {
        Self::splat(1.0) / self
    }

    #[inline(always)]
    fn where_positive(self, sign: Self) -> Self {
        Self(from_fn(|lane| if sign.0[lane] > 0.0 { self.0[lane] } else { 0.0 }))
    }

    #[inline(always)]
    fn all_within(self, limit: f32) -> bool {
        self.0.iter().all(|value| value.abs() < limit)
    }

    #[inline(always)]
    fn where_within(self, key: Self, limit: f32, other: Self) -> Self {
        Self(from_fn(|lane| if key.0[lane].abs() < limit { self.0[lane] } else { other.0[lane] }))
    }

    #[inline(always)]
    fn keep(self, words: &[u32], at: usize, bit: u32) -> Self {
        let words: [u32; LANES] = words[at..at + LANES].try_into().expect("as many as lanes");
        // All ones or all zeros: an AND instead of a branch.
        Self(from_fn(|lane| f32::from_bits(self.0[lane].to_bits() & ((words[lane] >> bit) & 1).wrapping_neg())))
    }
}
