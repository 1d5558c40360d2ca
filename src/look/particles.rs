//! Values of particles on a surface: trilinear between the particles, at the rest places of the vertices.

use rayon::prelude::*;

use super::rest::RestSurface;
use crate::geometry::Vector3;
use crate::lattice::{Lattice, NO_PARTICLE};

/// Vertices per parallel task.
const VERTICES_PER_TASK: usize = 1 << 12;
/// How far around a vertex without particles at the corners of its cell one is looked for, in pitches.
const SEARCH: i64 = 2;
/// How far behind a cut face a particle may lie and still belong to its tissue, in pitches: rounding, no more.
const BEHIND: f64 = 1e-3;

/// Values of particles at the rest places of vertices.
///
/// Corners of the surrounding cell that hold no particle are left out; so are, on a face of a cut, those behind the face,
/// for they belong to the other lip. A vertex outside all tissue takes the nearest particle within two pitches, and 0 when
/// there is none.
///
/// - `values`: shape `[particles, N]`; the result has shape `[vertices, N]`.
///
/// # Panics
/// If there is not one value per particle.
pub fn at_rest<const N: usize>(lattice: &Lattice, values: &[[f32; N]], surface: &RestSurface) -> Vec<[f32; N]> {
    assert_eq!(values.len(), lattice.len(), "one value per particle");
    let affine = &lattice.grid.affine;
    let value = |vertex: usize| {
        let index = affine.index_of(surface.places()[vertex]).coords;
        // The axes of a lattice are orthogonal and equally long: directions keep their angles.
        let inward = affine.index_vector_of(surface.inward()[vertex]).try_normalize(0.0).unwrap_or_default();
        let near = |corner: [i64; 3]| Vector3::from(corner.map(|i| i as f64)) - index;
        let in_front = |corner: [i64; 3]| near(corner).dot(&inward) >= -BEHIND;
        let one_side = surface.on_cut()[vertex].then(|| mean(lattice, values, index, in_front)).flatten();
        one_side.or_else(|| mean(lattice, values, index, |_| true)).unwrap_or_else(|| {
            let middle = index.map(|i| i.round() as i64);
            let reach = || -SEARCH..=SEARCH;
            let around = reach().flat_map(|k| reach().flat_map(move |j| reach().map(move |i| [i, j, k])));
            around
                .map(|offset| [0, 1, 2].map(|axis| middle[axis] + offset[axis]))
                .filter_map(|at| Some((near(at).norm_squared(), particle(lattice, at)?)))
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .map_or([0.0; N], |(_, particle)| values[particle])
        })
    };
    (0..surface.len()).into_par_iter().with_min_len(VERTICES_PER_TASK).map(value).collect()
}

/// Trilinear mean over those corners of the surrounding cell that hold a particle and count; `None` when none does.
fn mean<const N: usize>(
    lattice: &Lattice,
    values: &[[f32; N]],
    index: Vector3,
    counts: impl Fn([i64; 3]) -> bool,
) -> Option<[f32; N]> {
    let low = index.map(|i| i.floor() as i64);
    let (mut sum, mut total) = ([0.0_f64; N], 0.0_f64);
    for corner in 0..8 {
        let (mut at, mut weight) = ([0; 3], 1.0);
        for axis in 0..3 {
            let upper = corner >> axis & 1;
            at[axis] = low[axis] + upper;
            let share = index[axis] - low[axis] as f64;
            weight *= if upper == 1 { share } else { 1.0 - share };
        }
        if weight <= 0.0 || !counts(at) {
            continue;
        }
        let Some(particle) = particle(lattice, at) else { continue };
        total += weight;
        sum.iter_mut().zip(values[particle]).for_each(|(sum, value)| *sum += weight * f64::from(value));
    }
    (total > 0.0).then(|| sum.map(|sum| (sum / total) as f32))
}

fn particle(lattice: &Lattice, ijk: [i64; 3]) -> Option<usize> {
    let shape = lattice.grid.shape;
    let within = (0..3).all(|axis| ijk[axis] >= 0 && ijk[axis] < shape.dims()[axis] as i64);
    let particle = within.then(|| lattice.particle_at[shape.linear(ijk.map(|i| i as usize))])?;
    (particle != NO_PARTICLE).then_some(particle as usize)
}
