//! A smooth surface from a binary mask, held by its voxels and keeping their volume.

use rayon::prelude::*;

use super::filter::filtered;
use super::walls::Walls;
use super::{AHEAD, FLOOR, Voxels, held};
use crate::geometry::GridShape;
use crate::surface::field::{volume_in_cells, volume_keeping_shift};

/// Passes of the filter at a smoothing of 1.
const PASSES: f32 = 8.0;

/// One pass along an axis: 2b - b^2 of the binomial filter b = (1 2 1)/4, flat to the fourth order of the wave number, so that
/// curved parts hardly shrink.
///
/// # Source
/// Tukey, Exploratory data analysis, 1977 ("twicing").
pub(super) const TAPS: [f32; 3] = [10.0 / 16.0, 4.0 / 16.0, -1.0 / 16.0];

/// Smallest magnitude where a part, or a gap, is one or two voxels thick: it keeps about its thickness.
const THIN_FLOOR: f32 = 0.15;

/// The field of a binary mask, above zero inside: a smooth surface that separates the voxels of the organ from all others.
///
/// Starting from +-1, a filter that leaves low frequencies alone and the sides of the voxels take turns: the surface becomes as smooth as the
/// voxels allow, and stays within the grid edges between organ and others. A small constant then brings its volume to that of the
/// voxels. `smooth` is 0 for none and 1 for the usual amount.
///
/// Walls to foreign organs are drawn by a rule symmetric in both, before any shift, so two organs get the same wall; where three meet, walls agree
/// within the one voxel that all are held in.
///
/// # Panics
/// If the slices do not fit the grid.
///
/// # Source
/// Whitaker, Reducing aliasing artifacts in iso-surfaces of binary volumes, 2000. Differs: a filter of fourth order in place of
/// mean curvature flow, which shrinks.
pub fn from_mask(voxels: Voxels, smooth: f32) -> Vec<f32> {
    voxels.check();
    let relaxed = relaxed(voxels.shape, voxels.organ, smooth);
    let walls = Walls::new(voxels, &relaxed, smooth);
    kept_volume(voxels, &relaxed, &walls)
}

/// The field of a mask before walls and shift.
pub(super) fn relaxed(shape: GridShape, mask: &[bool], smooth: f32) -> Vec<f32> {
    let mut field: Vec<f32> = mask.par_iter().map(|&inside| if inside { 1.0 } else { -1.0 }).collect();
    let passes = (smooth.clamp(0.0, 10.0) * PASSES).round() as usize;
    if passes == 0 {
        return field;
    }
    let floors = floors(shape, mask);
    for _ in 0..passes {
        field = filtered(shape, &field, &TAPS, -1.0);
        hold(&mut field, mask, &floors);
    }
    field
}

fn hold(field: &mut [f32], mask: &[bool], floors: &[f32]) {
    field.par_iter_mut().zip(mask).zip(floors).for_each(|((value, &inside), &floor)| {
        *value = held(*value, inside, floor);
    });
}

/// Adds the constant that keeps the volume, away from walls.
pub(super) fn kept_volume(voxels: Voxels, relaxed: &[f32], walls: &Walls) -> Vec<f32> {
    let floors = floors(voxels.shape, voxels.organ);
    let shifted = |shift: f32| {
        let mut field: Vec<f32> = relaxed
            .par_iter()
            .enumerate()
            .map(|(at, value)| walls.bounded(at, value + shift * walls.freedom(at)))
            .collect();
        hold(&mut field, voxels.organ, &floors);
        field
    };
    let volume = voxels.organ.iter().filter(|&&inside| inside).count() as f64;
    if volume == 0.0 {
        return shifted(0.0);
    }
    shifted(volume_keeping_shift(|shift| volume_in_cells(voxels.shape, &shifted(shift)) / volume - 1.0))
}

/// Voxels all of whose face neighbours are on their side; the border of the grid does not count.
pub(super) fn cores(shape: GridShape, mask: &[bool]) -> Vec<bool> {
    let neighbours = |at: usize| {
        let ijk = shape.ijk(at);
        AHEAD.iter().filter_map(move |&offset| shape.neighbour(ijk, offset))
    };
    (0..mask.len()).into_par_iter().map(|at| neighbours(at).all(|other| mask[other] == mask[at])).collect()
}

/// Smallest magnitude at each voxel, see [`THIN_FLOOR`].
pub(super) fn floors(shape: GridShape, mask: &[bool]) -> Vec<f32> {
    let cores = cores(shape, mask);
    let all = || (-1..=1).flat_map(|k| (-1..=1).flat_map(move |j| (-1..=1).map(move |i| [i, j, k])));
    (0..mask.len())
        .into_par_iter()
        .map(|at| {
            let ijk = shape.ijk(at);
            let has_core = cores[at]
                || all()
                    .filter_map(|offset| shape.neighbour(ijk, offset))
                    .any(|other| cores[other] && mask[other] == mask[at]);
            if has_core { FLOOR } else { THIN_FLOOR }
        })
        .collect()
}
