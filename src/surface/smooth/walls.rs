//! Walls between organs that touch: drawn by a rule symmetric in both.

use rayon::prelude::*;

use super::mask::relaxed;
use super::{Voxels, filter::filtered};

/// What other organs allow an organ's field to be.
pub(super) struct Walls {
    /// Upper bound of the field; empty when there are no other organs.
    bound: Vec<f32>,
    /// From 0 at a wall to 1 two voxels away; empty when there are no other organs.
    freedom: Vec<f32>,
}

impl Walls {
    /// The bound is half the difference of the organ's and the others' fields: swap the two, and it changes its sign only. `own` is the organ's field.
    pub(super) fn new(voxels: Voxels, own: &[f32], smooth: f32) -> Self {
        let Voxels { shape, foreign, .. } = voxels;
        if !foreign.contains(&true) {
            return Self { bound: Vec::new(), freedom: Vec::new() };
        }
        let others = relaxed(shape, foreign, smooth);
        let bound = own.par_iter().zip(&others).map(|(own, other)| 0.5 * (own - other)).collect();
        // The filter turns each flag into a share of about a voxel's reach; four times that is 1 wherever a foreign voxel is near.
        let near: Vec<f32> = foreign.par_iter().map(|&foreign| if foreign { 1.0 } else { 0.0 }).collect();
        let near = filtered(shape, &near, &[6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0], 0.0);
        let freedom = near.par_iter().map(|near| (1.0 - 4.0 * near).max(0.0)).collect();
        Self { bound, freedom }
    }

    /// A value of the field, no larger than the walls allow.
    pub(super) fn bounded(&self, at: usize, value: f32) -> f32 {
        self.bound.get(at).map_or(value, |&bound| value.min(bound))
    }

    /// How much the surface may move by what this organ alone decides: 0 at walls, 1 away from them.
    pub(super) fn freedom(&self, at: usize) -> f32 {
        self.freedom.get(at).copied().unwrap_or(1.0)
    }
}
