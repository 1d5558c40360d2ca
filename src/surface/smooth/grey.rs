//! A surface through the grey values, where they tell the organ from what is around it.

use rayon::prelude::*;

use super::filter::{curvature, filtered};
use super::mask::{cores, floors, kept_volume, relaxed};
use super::walls::Walls;
use super::{AHEAD, FLOOR, Voxels, held};
use crate::geometry::GridShape;

/// Light smoothing along an axis: two passes of the binomial filter, which take noise to a seventh.
const HU_TAPS: [f32; 3] = [6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0];

/// Second moment of all that blurs a border: [`HU_TAPS`], and the averaging of a CT over each voxel (1/12); and the share by which
/// differences over two voxels fall short of the curvature of a border this sharp (measured: 0.85, on balls of 6 to 14 voxels).
const BLUR: f32 = (1.0 + 1.0 / 12.0) / 0.85;

/// Least slope, per voxel, of the values between -1 and 1, at which their curvature is taken.
const FLAT: f32 = 0.2;

/// Weights of the neighbourhood in which the HU of organ and surroundings are estimated: four binomial passes, twice over
/// (standard deviation 2 voxels).
const LOCAL_TAPS: [f32; 5] = [70.0 / 256.0, 56.0 / 256.0, 28.0 / 256.0, 8.0 / 256.0, 1.0 / 256.0];

/// Contrast over noise below which grey values count for nothing, and above which they count in full.
///
/// Liver against bowel or muscle has 1 to 2 and would be drawn by noise; liver against fat has 5 and more.
const CONTRAST: [f32; 2] = [2.5, 5.0];

/// Share of the neighbourhood that must be organ, and surroundings, for their HU to count in full.
const ENOUGH: f32 = 0.1;

/// The field of an organ, above zero inside, through the grey values of a CT.
///
/// The border lies half-way between the HU of the organ and that of its surroundings, both estimated within a few voxels, from
/// voxels clear of the border. Where their contrast is weak against the noise, where the organ is thin, near other organs and
/// where HU are not finite, the field passes over into that of [`from_mask`](super::from_mask).
///
/// The surface leaves the mask by a voxel at most, and only where neither a part nor a gap is so thin that it could vanish.
///
/// # Panics
/// If the slices do not fit the grid.
///
/// # Accuracy
/// From the voxel averages of a ball of 8 voxels: rms 0.02 voxel; 0.06 with noise of a tenth of the contrast.
pub fn from_grey(voxels: Voxels, hu: &[f32], smooth: f32) -> Vec<f32> {
    voxels.check();
    assert_eq!(hu.len(), voxels.shape.len(), "one HU per voxel");
    let Voxels { shape, organ, .. } = voxels;
    let relaxed = relaxed(shape, organ, smooth);
    let walls = Walls::new(voxels, &relaxed, smooth);
    let mut field = kept_volume(voxels, &relaxed, &walls);
    let cores = cores(shape, organ);
    let grey = Grey::new(voxels, hu, &cores);
    field.par_iter_mut().enumerate().for_each(|(at, value)| {
        let weight = grey.weight[at] * walls.freedom(at);
        *value = walls.bounded(at, *value + weight * (grey.value[at] - *value));
    });
    let sides = sides(shape, organ, &cores, &field);
    let floors = floors(shape, organ);
    field.par_iter_mut().enumerate().for_each(|(at, value)| {
        let floor = if sides[at] == organ[at] { floors[at] } else { FLOOR };
        *value = held(*value, sides[at], floor);
    });
    field
}

/// What the grey values say.
struct Grey {
    /// HU between -1 (surroundings) and +1 (organ).
    value: Vec<f32>,
    /// How much that counts, from 0 to 1.
    weight: Vec<f32>,
}

impl Grey {
    fn new(voxels: Voxels, hu: &[f32], cores: &[bool]) -> Self {
        let Voxels { shape, organ, foreign } = voxels;
        let known: Vec<f32> = hu.par_iter().map(|hu| f32::from(hu.is_finite())).collect();
        // Sums of squares keep their digits when the organ is near zero.
        let inside =
            || organ.iter().zip(hu).filter(|(organ, hu)| **organ && hu.is_finite()).map(|(_, &hu)| f64::from(hu));
        let middle = (inside().sum::<f64>() / inside().count().max(1) as f64) as f32;
        let hu: Vec<f32> = hu.par_iter().map(|hu| if hu.is_finite() { hu - middle } else { 0.0 }).collect();
        let is_foreign = |at: usize| foreign.get(at).copied().unwrap_or(false);
        let members = |own: bool| -> Vec<f32> {
            let is_member = |at: usize| organ[at] == own && cores[at] && known[at] > 0.0 && !is_foreign(at);
            (0..hu.len()).into_par_iter().map(|at| f32::from(is_member(at))).collect()
        };
        let inside = Local::new(shape, &members(true), &hu);
        let outside = Local::new(shape, &members(false), &hu);
        let smooth = filtered(shape, &hu, &HU_TAPS, 0.0);
        let known = filtered(shape, &known, &LOCAL_TAPS, 1.0);
        let judge = |at: usize| {
            let contrast = inside.mean[at] - outside.mean[at];
            if contrast == 0.0 || known[at] < 0.999 {
                return (0.0, 0.0);
            }
            let noise = (0.5 * (inside.variance[at] + outside.variance[at])).sqrt();
            let clear = smoothstep((contrast.abs() / noise - CONTRAST[0]) / (CONTRAST[1] - CONTRAST[0]));
            let enough = smoothstep(inside.share[at].min(outside.share[at]) / ENOUGH);
            let value = 2.0 * (smooth[at] - 0.5 * (inside.mean[at] + outside.mean[at])) / contrast;
            (value.clamp(-2.0, 2.0), clear * enough)
        };
        let (mut value, weight): (Vec<f32>, Vec<f32>) = (0..hu.len()).into_par_iter().map(judge).unzip();
        let bent = curvature(shape, &value, FLAT);
        value.par_iter_mut().zip(bent).for_each(|(value, bent)| *value = (*value - 0.5 * BLUR * bent).clamp(-1.0, 1.0));
        Self { value, weight }
    }
}

/// HU of some voxels around each voxel.
struct Local {
    share: Vec<f32>,
    mean: Vec<f32>,
    variance: Vec<f32>,
}

impl Local {
    fn new(shape: GridShape, members: &[f32], hu: &[f32]) -> Self {
        let gather = |values: Vec<f32>| filtered(shape, &filtered(shape, &values, &LOCAL_TAPS, 0.0), &LOCAL_TAPS, 0.0);
        let weighted =
            |power: i32| gather(members.iter().zip(hu).map(|(member, hu)| member * hu.powi(power)).collect());
        let share = gather(members.to_vec());
        let (sum, squares) = (weighted(1), weighted(2));
        let ratio = |sum: f32, share: f32| if share > 1e-6 { sum / share } else { 0.0 };
        let mean: Vec<f32> = sum.par_iter().zip(&share).map(|(&sum, &share)| ratio(sum, share)).collect();
        let spread = |at: usize| (ratio(squares[at], share[at]) - mean[at] * mean[at]).max(0.0);
        let variance = (0..hu.len()).into_par_iter().map(spread).collect();
        Self { share, mean, variance }
    }
}

fn smoothstep(t: f32) -> f32 {
    // NaN (no contrast, no noise) counts as nothing.
    let t = if t.is_nan() { 0.0 } else { t.clamp(0.0, 1.0) };
    t * t * (3.0 - 2.0 * t)
}

/// The side of every voxel: that of the field next to the core of both sides, else that of the mask.
///
/// A voxel changes sides only beside a core voxel of the side it goes to *and* of the side it leaves, so neither thin parts nor
/// narrow gaps are lost.
fn sides(shape: GridShape, organ: &[bool], cores: &[bool], field: &[f32]) -> Vec<bool> {
    let beside = |at: usize, own: bool| {
        let ijk = shape.ijk(at);
        AHEAD.iter().filter_map(|&offset| shape.neighbour(ijk, offset)).any(|other| cores[other] && organ[other] == own)
    };
    (0..field.len())
        .into_par_iter()
        .map(|at| {
            let inside = field[at] > 0.0;
            let may_change = inside != organ[at] && !cores[at] && beside(at, organ[at]);
            if may_change { inside } else { organ[at] }
        })
        .collect()
}
