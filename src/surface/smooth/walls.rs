//! Walls between organs that touch: drawn by a rule symmetric in both.

use rayon::prelude::*;

use super::mask::relaxed;
use super::{Voxels, filter::filtered};

/// What other organs allow an organ's field to be.
pub(super) struct Walls {
    /// The field that walls want, and its upper bound everywhere; empty when there are no other organs.
    bound: Vec<f32>,
    /// Voxels of any organ.
    filled: Vec<bool>,
    /// From 0 at a wall to 1 two voxels away; empty when there are no other organs.
    freedom: Vec<f32>,
}

impl Walls {
    /// The bound is half the difference of the organ's and the others' fields: swap the two, and it changes its sign only. `own` is the organ's field.
    pub(super) fn new(voxels: Voxels, own: &[f32], smooth: f32) -> Self {
        let Voxels { shape, organ, foreign } = voxels;
        if !foreign.contains(&true) {
            return Self { bound: Vec::new(), filled: Vec::new(), freedom: Vec::new() };
        }
        let others = relaxed(shape, foreign, smooth);
        let bound = own.par_iter().zip(&others).map(|(own, other)| 0.5 * (own - other)).collect();
        let filled = organ.par_iter().zip(foreign).map(|(organ, foreign)| organ | foreign).collect();
        // Beside a single foreign voxel the filtered flag is 0.035, of which this makes 1.
        let near: Vec<f32> = foreign.par_iter().map(|&foreign| if foreign { 1.0 } else { 0.0 }).collect();
        let near = filtered(shape, &near, &[6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0], 0.0);
        let freedom = near.par_iter().map(|near| (1.0 - 32.0 * near).max(0.0)).collect();
        Self { bound, filled, freedom }
    }

    /// A value of the field where it is free, no larger than the walls allow, and that of the wall where it is not.
    ///
    /// Outside of both, beside the rim of a wall, only the bound holds: there a wall has no place of its own.
    pub(super) fn bounded(&self, at: usize, value: f32) -> f32 {
        let Some(&bound) = self.bound.get(at) else { return value };
        let value = value.min(bound);
        if self.filled[at] { bound + self.freedom[at] * (value - bound) } else { value }
    }

    /// How much the surface may move by what this organ alone decides: 0 at walls, 1 away from them.
    pub(super) fn freedom(&self, at: usize) -> f32 {
        self.freedom.get(at).copied().unwrap_or(1.0)
    }
}
