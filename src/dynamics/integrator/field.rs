//! One vector for every slot, and sums of such fields, in f32 or f64.

use std::ops::{Add, Mul};

use rayon::prelude::*;

use crate::lattice::layout::BLOCK_LEN;

/// Slots one task works through.
const CHUNK: usize = 16 * BLOCK_LEN;

/// x, y and z of every slot, in block order. Shape `[3, slots]`.
pub type Field<R> = [Vec<R>; 3];

/// Numbers a state is kept in.
pub trait Real:
    Copy + Default + Send + Sync + PartialEq + std::fmt::Debug + Add<Output = Self> + Mul<Output = Self> + 'static
{
    /// The nearest such number.
    fn of(value: f64) -> Self;
    /// The same number in f64.
    fn wide(self) -> f64;
}

impl Real for f32 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value as Self
    }
    #[inline(always)]
    fn wide(self) -> f64 {
        self.into()
    }
}

impl Real for f64 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn wide(self) -> f64 {
        self
    }
}

/// A field of zeros.
pub(super) fn zeros<R: Real>(slots: usize) -> Field<R> {
    [0, 1, 2].map(|_| vec![R::default(); slots])
}

/// Makes a buffer as long as it is needed; its values are to be overwritten.
pub(super) fn fit<R: Real>(buffer: &mut Field<R>, slots: usize) {
    for axis in buffer {
        axis.resize(slots, R::default());
    }
}

/// `out = base + sum of factor times field`.
pub(super) fn combine<R: Real, const N: usize>(out: &mut Field<R>, base: &Field<R>, terms: [(f64, &Field<R>); N]) {
    for axis in 0..3 {
        let terms = terms.map(|(factor, field)| (R::of(factor), field[axis].as_slice()));
        let chunks = out[axis].par_chunks_mut(CHUNK).zip(base[axis].par_chunks(CHUNK)).enumerate();
        chunks.for_each(|(chunk, (out, base))| {
            let own = terms.map(|(factor, field)| (factor, &field[chunk * CHUNK..][..out.len()]));
            for slot in 0..out.len() {
                out[slot] = base[slot] + sum(&own, slot);
            }
        });
    }
}

/// `out = out + sum of factor times field`.
pub(super) fn add<R: Real, const N: usize>(out: &mut Field<R>, terms: [(f64, &Field<R>); N]) {
    for axis in 0..3 {
        let terms = terms.map(|(factor, field)| (R::of(factor), field[axis].as_slice()));
        out[axis].par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, out)| {
            let own = terms.map(|(factor, field)| (factor, &field[chunk * CHUNK..][..out.len()]));
            for slot in 0..out.len() {
                out[slot] = out[slot] + sum(&own, slot);
            }
        });
    }
}

#[inline(always)]
fn sum<R: Real, const N: usize>(terms: &[(R, &[R]); N], slot: usize) -> R {
    let mut sum = R::default();
    for (factor, field) in terms {
        sum = sum + *factor * field[slot];
    }
    sum
}

/// The largest length of any slot's vector, of a sum of fields each with a factor.
pub(super) fn largest<R: Real, const N: usize>(terms: [(f64, &Field<R>); N]) -> f64 {
    let slots = terms[0].1[0].len();
    let squared = |slot: usize| -> f64 {
        let along = |axis: usize| terms.iter().map(|(factor, field)| factor * field[axis][slot].wide()).sum::<f64>();
        (0..3).map(|axis| along(axis).powi(2)).sum()
    };
    // The largest is the same in any order; what is not a number is taken for infinite.
    let larger = |a: f64, b: f64| a.max(if b.is_nan() { f64::INFINITY } else { b });
    let of_chunk = |chunk: usize| {
        (chunk * CHUNK..slots.min((chunk + 1) * CHUNK)).fold(0.0, |most, slot| larger(most, squared(slot)))
    };
    (0..slots.div_ceil(CHUNK)).into_par_iter().map(of_chunk).reduce(|| 0.0, larger).sqrt()
}

/// Scalar product, summed block by block and then in order: the same bits at any number of threads.
pub(super) fn product(a: &Field<f64>, b: &Field<f64>) -> f64 {
    let blocks = a[0].len().div_ceil(BLOCK_LEN);
    let of_block = |block: usize| -> f64 {
        let slots = block * BLOCK_LEN..(block + 1) * BLOCK_LEN;
        let along = |axis: usize| -> f64 {
            let (a, b) = (&a[axis][slots.clone()], &b[axis][slots.clone()]);
            let mut lanes = [0.0; 16];
            for (a, b) in a.as_chunks::<16>().0.iter().zip(b.as_chunks::<16>().0) {
                for lane in 0..16 {
                    lanes[lane] += a[lane] * b[lane];
                }
            }
            lanes.iter().sum()
        };
        along(0) + along(1) + along(2)
    };
    (0..blocks).into_par_iter().map(of_block).collect::<Vec<f64>>().into_iter().sum()
}
