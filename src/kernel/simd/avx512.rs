//! AVX-512: sixteen lanes, a row of a block.
#![allow(unsafe_code)]

use std::arch::x86_64::{
    __m512, __m512i, _CMP_GT_OQ, _CMP_LT_OQ, _mm512_abs_ps, _mm512_add_ps, _mm512_cmp_ps_mask, _mm512_div_ps,
    _mm512_fmadd_ps, _mm512_fnmadd_ps, _mm512_loadu_ps, _mm512_loadu_si512, _mm512_mask_mov_ps, _mm512_maskz_mov_ps,
    _mm512_max_ps, _mm512_min_ps, _mm512_mul_ps, _mm512_rcp14_ps, _mm512_rsqrt14_ps, _mm512_set1_epi32, _mm512_set1_ps,
    _mm512_setzero_ps, _mm512_sqrt_ps, _mm512_storeu_ps, _mm512_sub_ps, _mm512_test_epi32_mask,
};

use super::{Vector, operators};

const LANES: usize = 16;

/// Sixteen lanes.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct Avx512(__m512);

operators!(Avx512: Add add _mm512_add_ps, Sub sub _mm512_sub_ps, Mul mul _mm512_mul_ps, Div div _mm512_div_ps);

// SAFETY of every block below: registers of this type exist only in functions compiled for AVX-512 (chosen in
// `kernel::dispatch`), and addresses are those of slices as long as the register.
impl Vector for Avx512 {
    const LANES: usize = LANES;

    #[inline(always)]
    fn splat(value: f32) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm512_set1_ps(value) })
    }

    #[inline(always)]
    fn load(values: &[f32], at: usize) -> Self {
        let values = &values[at..at + LANES];
        // SAFETY: see above.
        Self(unsafe { _mm512_loadu_ps(values.as_ptr()) })
    }

    #[inline(always)]
    fn store(self, values: &mut [f32], at: usize) {
        let values = &mut values[at..at + LANES];
        // SAFETY: see above.
        unsafe { _mm512_storeu_ps(values.as_mut_ptr(), self.0) }
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm512_fmadd_ps(self.0, factor.0, term.0) })
    }

    #[inline(always)]
    fn negative_mul_add(self, factor: Self, term: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm512_fnmadd_ps(self.0, factor.0, term.0) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm512_max_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm512_min_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm512_sqrt_ps(self.0) })
    }

    /// An estimate of 14 bits and one step of Newton's method: error 6e-9 before rounding.
    #[inline(always)]
    fn inverse_sqrt(self) -> Self {
        // SAFETY: see above.
        let estimate = Self(unsafe { _mm512_rsqrt14_ps(self.0) });
        let half = Self::splat(0.5) * estimate;
        half * (self * estimate).negative_mul_add(estimate, Self::splat(3.0))
    }

    /// An estimate of 14 bits and one step of Newton's method: error 4e-9 before rounding.
    #[inline(always)]
    fn inverse(self) -> Self {
        // SAFETY: see above.
        let estimate = Self(unsafe { _mm512_rcp14_ps(self.0) });
        estimate * self.negative_mul_add(estimate, Self::splat(2.0))
    }

    #[inline(always)]
    fn where_positive(self, sign: Self) -> Self {
        // SAFETY: see above.
        unsafe { Self(_mm512_maskz_mov_ps(_mm512_cmp_ps_mask::<_CMP_GT_OQ>(sign.0, _mm512_setzero_ps()), self.0)) }
    }

    #[inline(always)]
    fn all_within(self, limit: f32) -> bool {
        // SAFETY: see above.
        unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(_mm512_abs_ps(self.0), _mm512_set1_ps(limit)) == u16::MAX }
    }

    #[inline(always)]
    fn where_within(self, key: Self, limit: f32, other: Self) -> Self {
        // SAFETY: see above.
        unsafe {
            let within = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(_mm512_abs_ps(key.0), _mm512_set1_ps(limit));
            Self(_mm512_mask_mov_ps(other.0, within, self.0))
        }
    }

    #[inline(always)]
    fn keep(self, words: &[u32], at: usize, bit: u32) -> Self {
        let words = &words[at..at + LANES];
        // SAFETY: see above.
        unsafe {
            let words = _mm512_loadu_si512(words.as_ptr().cast::<__m512i>());
            let has = _mm512_test_epi32_mask(words, _mm512_set1_epi32(1 << bit));
            Self(_mm512_maskz_mov_ps(has, self.0))
        }
    }
}
