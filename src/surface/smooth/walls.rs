//! Walls between organs that touch: drawn by a rule symmetric in both.

use rayon::prelude::*;

use super::mask::relaxed;
use super::{Voxels, filter::filtered};

/// Inverse of the room, as a share of a voxel, from which on a border is no wall. At 2, kidneys show terraces beside the liver.
const ROOM: f32 = 8.0;

/// What other organs allow an organ's field to be.
pub(super) struct Walls {
    /// The field that walls want, and its upper bound everywhere; empty when there are no other organs.
    bound: Vec<f32>,
    /// From 0, where there is room between the organs, to 1, where they fill all there is.
    closed: Vec<f32>,
    /// From 0 at a wall to 1 two voxels away; empty when there are no other organs.
    freedom: Vec<f32>,
}

impl Walls {
    /// The bound is half the difference of the organ's and the others' fields: swap the two, and it changes its sign only. `own` is the organ's field.
    pub(super) fn new(voxels: Voxels, own: &[f32], smooth: f32) -> Self {
        let Voxels { shape, foreign, .. } = voxels;
        if !foreign.contains(&true) {
            return Self { bound: Vec::new(), closed: Vec::new(), freedom: Vec::new() };
        }
        let others = relaxed(shape, foreign, smooth);
        let bound = own.par_iter().zip(&others).map(|(own, other)| 0.5 * (own - other)).collect();
        // Where two organs fill all there is, their fields cancel.
        let room = own.par_iter().zip(&others).map(|(own, other)| -0.5 * (own + other));
        let closed = room.map(|room| (1.0 - ROOM * room.abs()).max(0.0)).collect();
        // Beside a single foreign voxel the filtered flag is 0.035, of which this makes 1.
        let near: Vec<f32> = foreign.par_iter().map(|&foreign| if foreign { 1.0 } else { 0.0 }).collect();
        let near = filtered(shape, &near, &[6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0], 0.0);
        let freedom = near.par_iter().map(|near| (1.0 - 32.0 * near).max(0.0)).collect();
        Self { bound, closed, freedom }
    }

    /// A value of the field where it is free, no larger than the walls allow, and that of the wall where it is not.
    ///
    /// Where there is room between both only the bound holds: taken for the field itself, it draws terraces there.
    pub(super) fn bounded(&self, at: usize, value: f32) -> f32 {
        let Some(&bound) = self.bound.get(at) else { return value };
        let value = value.min(bound);
        value + (1.0 - self.freedom[at]) * self.closed[at] * (bound - value)
    }

    /// How much the surface may move by what this organ alone decides: 0 at walls, 1 away from them.
    pub(super) fn freedom(&self, at: usize) -> f32 {
        self.freedom.get(at).copied().unwrap_or(1.0)
    }
}
