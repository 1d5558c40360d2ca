//! The CT on a surface: what a cut face shows of the inside ("solid texture"), and what colours the skin.
//!
//! Vertices are sampled where they were at rest, so the picture moves with the tissue. On the skin a voxel holds organ and
//! surroundings at once, which would tint the skin with fat or air; so the skin is sampled [`SKIN_DEPTH`] voxels inside, and a
//! cut face, in place everywhere else, is drawn inwards within that distance of its rim.

use rayon::prelude::*;

use super::rest::RestSurface;
use crate::geometry::{Point3, Vector3};
use crate::volume::CtVolume;

/// How far inside the skin is sampled, in voxels along the normal. Half a voxel leaves the partial volume of the border
/// voxel itself; one and a half is clear of the blur of a CT's reconstruction as well.
pub const SKIN_DEPTH: f64 = 1.5;

/// Vertices per parallel task.
const VERTICES_PER_TASK: usize = 1 << 12;

/// Farthest from the skin that a sample is moved by it \[mm\]: the reach a [`RestSurface`] needs for [`hu_at_rest`].
pub fn skin_reach(ct: &CtVolume) -> f64 {
    SKIN_DEPTH * ct.grid().affine.spacing().into_iter().fold(0.0, f64::max)
}

/// The CT at the rest place of each vertex \[HU\], trilinear; see the head of this module. Beyond the volume the value of its
/// border holds.
///
/// Parallel, the same bits at any number of threads.
pub fn hu_at_rest(ct: &CtVolume, surface: &RestSurface) -> Vec<f32> {
    let affine = &ct.grid().affine;
    let dims = ct.shape().dims();
    let sample = |vertex: usize| {
        let near = surface.near_skin()[vertex];
        let mut index = affine.index_of(surface.places()[vertex]);
        if near.distance.is_finite() {
            // One step in index space along the normal is 1 / |its index vector| long.
            let step: Vector3 = affine.index_vector_of(near.inward);
            let depth = SKIN_DEPTH / step.norm() - f64::from(near.distance);
            if depth > 0.0 {
                index += step * depth;
            }
        }
        let within = Point3::from([0, 1, 2].map(|axis| index[axis].clamp(-0.5, dims[axis] as f64 - 0.5)));
        ct.sample_index(within, f32::NAN)
    };
    (0..surface.len()).into_par_iter().with_min_len(VERTICES_PER_TASK).map(sample).collect()
}
