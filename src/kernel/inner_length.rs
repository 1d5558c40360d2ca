//! Springs that hold a part of their lengthening back, one block at a time.
//!
//! Every spring has an inner lengthening `q` [m] of its own: what has flowed in the damper of a Maxwell branch, or what has
//! yielded for good. With `e = l - L` the spring's lengthening,
//!
//! ```text
//! relaxation    dq/dt = (e - q) / tau                                adds the tension  k1 (e - q)
//! plasticity    dq/dt = (|e - q| - e_y) sign(e - q) / tau, beyond    takes the tension  k q
//! ```
//!
//! A spring's `q` is kept at the end where it starts, direction by direction. First every block moves on its own, then its
//! particles feel their 26 springs, those of the neighbours included: both ends compute the same tension from the same
//! numbers. Steps in `q` are of backward Euler, which no time constant can upset.

use multiversion::multiversion;

use super::halo::Halo;
use super::laws::SpringConstant;
use super::rows::{Around, LANES, column_of, row_of, row_of_block, row_of_block_mut, rows_around};
use super::spring::SHORTEST_SQUARED;
use crate::lattice::layout::{BLOCK, BLOCK_LEN};
use crate::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS, OFFSETS, family, opposite};

/// Springs that start at a particle.
pub const STARTING: usize = NEIGHBOURS - FIRST_FORWARD;

/// Longest a spring can become for good, over its length [m/m], and shortest, below it.
pub const MOST_YIELDED: f32 = 0.5;

/// Numbers of a step.
#[derive(Debug, Clone, Copy)]
pub struct InnerStep {
    /// Distance of neighbouring particles [m].
    pub pitch: f32,
    /// Rest length of face, face-diagonal and body-diagonal springs [m].
    pub rest_length: [f32; 3],
    /// Time step [s].
    pub dt: f32,
}

impl InnerStep {
    /// - `pitch` [m], `dt` [s].
    pub fn new(pitch: f64, dt: f64) -> Self {
        let along = |axes: f64| (axes.sqrt() * pitch) as f32;
        Self { pitch: pitch as f32, rest_length: [along(1.0), along(2.0), along(3.0)], dt: dt as f32 }
    }
}

/// Which of the two a spring does.
pub trait Flow: Default + Send + Sync {
    /// Whether a spring that holds nothing back has no tension.
    const ONLY_WHAT_IS_HELD: bool;
    /// What has flowed after a step. `e`, `q` [m], `k` [N/m], `rate` [N/(m s)], `threshold` [N/m], `rest` [m].
    fn next(e: f32, q: f32, k: f32, rate: f32, threshold: f32, step: (f32, f32)) -> f32;
    /// Tension that comes of it [N].
    fn tension(e: f32, q: f32, k: f32) -> f32;
}

/// A Maxwell branch.
#[derive(Debug, Clone, Copy, Default)]
pub struct Relaxing;
/// Yielding beyond a strain.
#[derive(Debug, Clone, Copy, Default)]
pub struct Yielding;

impl Flow for Relaxing {
    const ONLY_WHAT_IS_HELD: bool = false;
    #[inline(always)]
    fn next(e: f32, q: f32, k: f32, rate: f32, _: f32, (dt, _): (f32, f32)) -> f32 {
        // (q + x e) / (1 + x) with x = dt / tau = dt rate / k.
        let next = q + (e - q) * (dt * rate / (k + dt * rate));
        if k > 0.0 { next } else { 0.0 }
    }
    #[inline(always)]
    fn tension(e: f32, q: f32, k: f32) -> f32 {
        k * (e - q)
    }
}

impl Flow for Yielding {
    const ONLY_WHAT_IS_HELD: bool = true;
    #[inline(always)]
    fn next(e: f32, q: f32, k: f32, rate: f32, threshold: f32, (dt, rest): (f32, f32)) -> f32 {
        let elastic = e - q;
        let beyond = elastic.abs() - threshold * rest / k;
        // 1 - 1 / (1 + x): 1 where the rate is infinite.
        let share = 1.0 - k / (k + dt * rate);
        let flown = if beyond > 0.0 { beyond * share } else { 0.0 };
        let next = if elastic > 0.0 { q + flown } else { q - flown };
        let most = MOST_YIELDED * rest;
        let next = if next > most { most } else { next };
        if next < -most { -most } else { next }
    }
    #[inline(always)]
    fn tension(_: f32, q: f32, k: f32) -> f32 {
        -(k * q)
    }
}

/// The inner lengthening of the springs that start at each particle of a block, direction by direction [m].
pub type InnerLengths = [[f32; BLOCK_LEN]; STARTING];

/// The vector along the spring in direction `D` of a lane, its length, and what that exceeds the rest length by, without
/// cancellation: `(l^2 - L^2) / (l + L)` [m].
#[inline(always)]
fn lengthening<const D: usize>(displacement: &[Around<'_>; 3], lane: usize, step: &InnerStep) -> ([f32; 3], f32, f32) {
    let (mut d, mut squared, mut change) = ([0.0; 3], 0.0, 0.0);
    for axis in 0..3 {
        let rows = &displacement[axis];
        let moved = rows[const { row_of(D) }][lane + const { column_of(D) }] - rows[4][lane + 1];
        let rest = const { OFFSETS[D] }[axis] as f32 * step.pitch;
        d[axis] = moved + rest;
        squared += d[axis] * d[axis];
        change += moved * (d[axis] + rest);
    }
    let length = if squared > SHORTEST_SQUARED { squared } else { SHORTEST_SQUARED }.sqrt();
    (d, length, change / (length + step.rest_length[const { family(D) } - 1]))
}

/// What a block's springs are computed from.
#[derive(Clone, Copy)]
pub struct InnerState<'a> {
    /// The numbers of the step.
    pub step: InnerStep,
    /// Displacement x, y, z with halo [m].
    pub displacement: [&'a Halo; 3],
    /// Living springs of each slot, one bit per direction.
    pub alive: &'a [u32; BLOCK_LEN],
}

/// Lets the springs that start in a block flow for one step. Those of severed springs have no meaning.
///
/// - `stiffness` [N/m], `rate` [N/(m s)], `threshold` [N/m; read by [`Yielding`]].
///
/// Returns whether any of them holds anything back.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw+avx2+fma", "x86_64+avx2+fma"), dispatcher = "direct")]
pub fn flow<F: Flow, K: SpringConstant>(
    _: F,
    stiffness: K,
    rate: K,
    threshold: K,
    state: InnerState<'_>,
    inner: &mut InnerLengths,
) -> bool {
    let InnerState { step, displacement, .. } = state;
    let mut most = [0.0_f32; LANES];
    for z in 0..BLOCK[2] {
        for y in 0..BLOCK[1] {
            let around = displacement.map(|halo| rows_around(halo, y, z));
            let (stiffness, rate, threshold) = (stiffness.row(y, z), rate.row(y, z), threshold.row(y, z));
            // Copied out and back, so that the loop below reads and writes what cannot overlap.
            let mut rows = [[0.0_f32; LANES]; STARTING];
            for (row, inner) in rows.iter_mut().zip(&*inner) {
                *row = *row_of_block(inner, y, z);
            }
            for lane in 0..LANES {
                let mut largest = most[lane];
                macro_rules! springs { ($($d:literal)*) => { $( {
                    let (_, _, e) = lengthening::<$d>(&around, lane, &step);
                    let of_step = (step.dt, step.rest_length[const { family($d) } - 1]);
                    let (k, rate) = (K::of::<$d>(&stiffness, lane), K::of::<$d>(&rate, lane));
                    let own = &mut rows[$d - FIRST_FORWARD][lane];
                    let next = F::next(e, *own, k, rate, K::of::<$d>(&threshold, lane), of_step);
                    *own = next;
                    largest = if next.abs() > largest { next.abs() } else { largest };
                } )* } }
                springs!(13 14 15 16 17 18 19 20 21 22 23 24 25);
                most[lane] = largest;
            }
            for (row, inner) in rows.iter().zip(&mut *inner) {
                *row_of_block_mut(inner, y, z) = *row;
            }
        }
    }
    most.iter().any(|&most| most > 0.0)
}

/// Adds the forces of the inner lengthenings to those on a block's particles [N].
///
/// - `inner`: of the springs that start at each particle, with halo.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw+avx2+fma", "x86_64+avx2+fma"), dispatcher = "direct")]
pub fn add_inner_forces<F: Flow, K: SpringConstant>(
    _: F,
    stiffness: K,
    state: InnerState<'_>,
    inner: &[Halo; STARTING],
    force: &mut [[f32; BLOCK_LEN]; 3],
) {
    let InnerState { step, displacement, alive } = state;
    for z in 0..BLOCK[2] {
        for y in 0..BLOCK[1] {
            let around = displacement.map(|halo| rows_around(halo, y, z));
            let stiffness = stiffness.row(y, z);
            let alive = row_of_block(alive, y, z);
            let held_back = inner.each_ref().map(|halo| rows_around(halo, y, z));
            let mut sum = [[0.0_f32; LANES]; 3];
            for lane in 0..LANES {
                let mut own = [0.0_f32; 3];
                macro_rules! springs { ($($d:literal)*) => { $( {
                    // Kept at this end, or at the other.
                    const STARTS_HERE: bool = $d >= FIRST_FORWARD;
                    const KEPT: usize = if STARTS_HERE { $d } else { opposite($d) } - FIRST_FORWARD;
                    let (d, length, e) = lengthening::<$d>(&around, lane, &step);
                    let held_back = &held_back[KEPT];
                    let q = if STARTS_HERE {
                        held_back[4][lane + 1]
                    } else {
                        held_back[const { row_of($d) }][lane + const { column_of($d) }]
                    };
                    let factor = F::tension(e, q, K::of::<$d>(&stiffness, lane)) / length;
                    // A dead spring may lead anywhere, and to what is not a number.
                    let living = ((alive[lane] >> $d) & 1).wrapping_neg();
                    for axis in 0..3 {
                        own[axis] += f32::from_bits((factor * d[axis]).to_bits() & living);
                    }
                } )* } }
                springs!(0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25);
                (sum[0][lane], sum[1][lane], sum[2][lane]) = (own[0], own[1], own[2]);
            }
            for (sum, force) in sum.iter().zip(force.iter_mut()) {
                for (own, sum) in row_of_block_mut(force, y, z).iter_mut().zip(sum) {
                    *own += sum;
                }
            }
        }
    }
}

/// Whether any living spring that starts in a block is lengthened, beyond what it has yielded, so far that its tension exceeds
/// what it bears.
///
/// - `bears`: stiffness times strain [N/m]; `inner` [m]: what has yielded, if anything does.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw+avx2+fma", "x86_64+avx2+fma"), dispatcher = "direct")]
pub fn overstretched<K: SpringConstant>(
    stiffness: K,
    bears: K,
    state: InnerState<'_>,
    inner: Option<&InnerLengths>,
    found: &mut [u32; BLOCK_LEN],
) -> bool {
    let InnerState { step, displacement, alive } = state;
    let mut any = 0;
    for z in 0..BLOCK[2] {
        for y in 0..BLOCK[1] {
            let around = displacement.map(|halo| rows_around(halo, y, z));
            let (stiffness, bears) = (stiffness.row(y, z), bears.row(y, z));
            let alive = row_of_block(alive, y, z);
            let yielded = inner.map(|inner| inner.each_ref().map(|inner| row_of_block(inner, y, z)));
            let mut bits = [0_u32; LANES];
            for lane in 0..LANES {
                let mut own = 0;
                macro_rules! springs { ($($d:literal)*) => { $( {
                    let (_, _, e) = lengthening::<$d>(&around, lane, &step);
                    let elastic = e - yielded.map_or(0.0, |rows| rows[$d - FIRST_FORWARD][lane]);
                    let rest = step.rest_length[const { family($d) } - 1];
                    let tears = K::of::<$d>(&stiffness, lane) * elastic > K::of::<$d>(&bears, lane) * rest;
                    own |= (u32::from(tears) << $d) & alive[lane];
                } )* } }
                springs!(13 14 15 16 17 18 19 20 21 22 23 24 25);
                bits[lane] = own;
            }
            any |= bits.iter().fold(0, |all, &bits| all | bits);
            *row_of_block_mut(found, y, z) = bits;
        }
    }
    any != 0
}
