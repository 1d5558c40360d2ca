//! AVX2 with FMA: eight lanes.
//!
//! The estimate `vrsqrtps` differs between makers and is too coarse for one Newton step, and two cost as much as a square
//! root and a division: these are used.
#![allow(unsafe_code)]

use std::arch::x86_64::{
    __m256, __m256i, _CMP_GT_OQ, _CMP_LT_OQ, _mm256_add_ps, _mm256_and_ps, _mm256_andnot_ps, _mm256_blendv_ps,
    _mm256_castsi256_ps, _mm256_cmp_ps, _mm256_div_ps, _mm256_fmadd_ps, _mm256_fnmadd_ps, _mm256_loadu_ps,
    _mm256_loadu_si256, _mm256_max_ps, _mm256_min_ps, _mm256_movemask_ps, _mm256_mul_ps, _mm256_set1_epi32,
    _mm256_set1_ps, _mm256_setzero_ps, _mm256_sllv_epi32, _mm256_sqrt_ps, _mm256_srai_epi32, _mm256_storeu_ps,
    _mm256_sub_ps,
};

use super::{Vector, operators};

const LANES: usize = 8;

/// Eight lanes.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct Avx2(__m256);

operators!(Avx2: Add add _mm256_add_ps, Sub sub _mm256_sub_ps, Mul mul _mm256_mul_ps, Div div _mm256_div_ps);

// SAFETY of every block below: registers of this type exist only in functions compiled for AVX2 and FMA (chosen in
// `kernel::dispatch`), and addresses are those of slices as long as the register.
impl Vector for Avx2 {
    const LANES: usize = LANES;

    #[inline(always)]
    fn splat(value: f32) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm256_set1_ps(value) })
    }

    #[inline(always)]
    fn load(values: &[f32], at: usize) -> Self {
        let values = &values[at..at + LANES];
        // SAFETY: see above.
        Self(unsafe { _mm256_loadu_ps(values.as_ptr()) })
    }

    #[inline(always)]
    fn store(self, values: &mut [f32], at: usize) {
        let values = &mut values[at..at + LANES];
        // SAFETY: see above.
        unsafe { _mm256_storeu_ps(values.as_mut_ptr(), self.0) }
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm256_fmadd_ps(self.0, factor.0, term.0) })
    }

    #[inline(always)]
    fn negative_mul_add(self, factor: Self, term: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm256_fnmadd_ps(self.0, factor.0, term.0) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm256_max_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm256_min_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm256_sqrt_ps(self.0) })
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
        unsafe { Self(_mm256_and_ps(self.0, _mm256_cmp_ps::<_CMP_GT_OQ>(sign.0, _mm256_setzero_ps()))) }
    }

    #[inline(always)]
    fn all_within(self, limit: f32) -> bool {
        // SAFETY: see above.
        unsafe { _mm256_movemask_ps(within(self.0, limit)) == 0xff }
    }

    #[inline(always)]
    fn where_within(self, key: Self, limit: f32, other: Self) -> Self {
        // SAFETY: see above.
        unsafe { Self(_mm256_blendv_ps(other.0, self.0, within(key.0, limit))) }
    }

    #[inline(always)]
    fn keep(self, words: &[u32], at: usize, bit: u32) -> Self {
        let words = &words[at..at + LANES];
        // SAFETY: see above. The bit becomes the sign, and the sign a mask.
        unsafe {
            let words = _mm256_loadu_si256(words.as_ptr().cast::<__m256i>());
            let sign = _mm256_sllv_epi32(words, _mm256_set1_epi32(31 - bit as i32));
            Self(_mm256_and_ps(self.0, _mm256_castsi256_ps(_mm256_srai_epi32::<31>(sign))))
        }
    }
}

/// All ones in the lanes whose magnitude is below `limit`.
#[inline]
#[target_feature(enable = "avx2,fma")]
fn within(values: __m256, limit: f32) -> __m256 {
    let magnitude = _mm256_andnot_ps(_mm256_set1_ps(-0.0), values);
    _mm256_cmp_ps::<_CMP_LT_OQ>(magnitude, _mm256_set1_ps(limit))
}
