//! NEON: four lanes, which every 64-bit ARM machine has.
//!
//! Its estimates of inverse roots are of 8 bits and would need two Newton steps: square roots and divisions are used.
#![allow(unsafe_code)]

use std::arch::aarch64::{
    float32x4_t, uint32x4_t, vabsq_f32, vaddq_f32, vandq_u32, vbslq_f32, vcgtq_f32, vcltq_f32, vdivq_f32, vdupq_n_f32,
    vdupq_n_u32, vfmaq_f32, vfmsq_f32, vld1q_f32, vld1q_u32, vminvq_u32, vmulq_f32, vreinterpretq_f32_u32,
    vreinterpretq_u32_f32, vsqrtq_f32, vst1q_f32, vsubq_f32, vtstq_u32,
};

use super::{Vector, operators};

const LANES: usize = 4;

/// Four lanes.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct Neon(float32x4_t);

operators!(Neon: Add add vaddq_f32, Sub sub vsubq_f32, Mul mul vmulq_f32, Div div vdivq_f32);

impl Neon {
    #[inline(always)]
    fn masked(self, mask: uint32x4_t) -> Self {
        // SAFETY: NEON belongs to the architecture.
        Self(unsafe { vreinterpretq_f32_u32(vandq_u32(vreinterpretq_u32_f32(self.0), mask)) })
    }

    /// All ones in the lanes whose magnitude is below `limit`.
    #[inline(always)]
    fn within(self, limit: f32) -> uint32x4_t {
        // SAFETY: NEON belongs to the architecture.
        unsafe { vcltq_f32(vabsq_f32(self.0), vdupq_n_f32(limit)) }
    }
}

// SAFETY of every block below: NEON belongs to the architecture, and addresses are those of slices as long as the register.
impl Vector for Neon {
    const LANES: usize = LANES;

    #[inline(always)]
    fn splat(value: f32) -> Self {
        // SAFETY: see above.
        Self(unsafe { vdupq_n_f32(value) })
    }

    #[inline(always)]
    fn load(values: &[f32], at: usize) -> Self {
        let values = &values[at..at + LANES];
        // SAFETY: see above.
        Self(unsafe { vld1q_f32(values.as_ptr()) })
    }

    #[inline(always)]
    fn store(self, values: &mut [f32], at: usize) {
        let values = &mut values[at..at + LANES];
        // SAFETY: see above.
        unsafe { vst1q_f32(values.as_mut_ptr(), self.0) }
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { vfmaq_f32(term.0, self.0, factor.0) })
    }

    #[inline(always)]
    fn negative_mul_add(self, factor: Self, term: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { vfmsq_f32(term.0, self.0, factor.0) })
    }

    /// By comparison: the instruction would pass on what is not a number.
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { vbslq_f32(vcgtq_f32(self.0, other.0), self.0, other.0) })
    }

    /// By comparison: the instruction would pass on what is not a number.
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { vbslq_f32(vcltq_f32(self.0, other.0), self.0, other.0) })
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: see above.
        Self(unsafe { vsqrtq_f32(self.0) })
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
        // SAFETY: see above.
        self.masked(unsafe { vcgtq_f32(sign.0, vdupq_n_f32(0.0)) })
    }

    #[inline(always)]
    fn all_within(self, limit: f32) -> bool {
        // SAFETY: see above.
        unsafe { vminvq_u32(self.within(limit)) != 0 }
    }

    #[inline(always)]
    fn where_within(self, key: Self, limit: f32, other: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { vbslq_f32(key.within(limit), self.0, other.0) })
    }

    #[inline(always)]
    fn keep(self, words: &[u32], at: usize, bit: u32) -> Self {
        let words = &words[at..at + LANES];
        // SAFETY: see above.
        self.masked(unsafe { vtstq_u32(vld1q_u32(words.as_ptr()), vdupq_n_u32(1 << bit)) })
    }
}
