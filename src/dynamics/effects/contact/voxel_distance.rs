//! From the voxels of rigid organs to sampled distances.
//!
//! Samples stand in the middle of the lattice's voxels (in model `tissue` the cells, in model `paper` the particles), so that
//! half way between a voxel of bone and one of none lies the surface, even where bone is one voxel thin. Steps of voxels are
//! smoothed over half a pitch; soft particles at rest are outside, whatever they are joined to.

use rayon::prelude::*;

use super::distance_field::DistanceField;
use crate::geometry::{GridShape, Vector3};
use crate::lattice::Lattice;

/// Empty voxels around the bones.
const MARGIN: usize = 2;

/// Samples the distance to the voxels of some organs, in lattice axes; `None` without any.
pub(super) fn rigid_field(lattice: &Lattice, organs: &[usize]) -> Option<DistanceField> {
    let among = |organ: u8| organs.contains(&usize::from(organ)) && organ != crate::lattice::FRINGE;
    let of = if lattice.has_cells() { &lattice.cell_organ } else { &lattice.organ };
    let voxels: Vec<[usize; 3]> =
        (0..lattice.len() as u32).filter(|&p| among(of[p as usize])).map(|p| lattice.ijk(p)).collect();
    let first = *voxels.first()?;
    let fold = |pick: fn(usize, usize) -> usize| {
        voxels.iter().fold(first, |a, b| [0, 1, 2].map(|axis| pick(a[axis], b[axis])))
    };
    let (min, max) = (fold(usize::min), fold(usize::max));
    let [nx, ny, nz] = [0, 1, 2].map(|axis| max[axis] - min[axis] + 1 + 2 * MARGIN);
    let shape = GridShape::new(nx, ny, nz);
    let mut solid = vec![false; shape.len()];
    for ijk in voxels {
        solid[shape.linear([0, 1, 2].map(|axis| ijk[axis] - min[axis] + MARGIN))] = true;
    }
    let h = lattice.pitch;
    let [outside, inside] = [true, false].map(|wanted| to_nearest(&solid, shape, wanted));
    let half = |squared: f32| f64::from(squared).sqrt() - 0.5;
    let values = outside
        .iter()
        .zip(&inside)
        .zip(&solid)
        .map(|((&outside, &inside), &solid)| (h * if solid { -half(inside) } else { half(outside) }) as f32);
    let corner = Vector3::from(min.map(|index| index as f64 - MARGIN as f64));
    let middle = Vector3::repeat(if lattice.has_cells() { 0.5 } else { 0.0 });
    let values = values.collect();
    Some(DistanceField { origin: (corner + middle) * h, spacing: h, shape, values, in_lattice_axes: true })
}

/// Squared distance of every voxel to the nearest that is solid (or is not) [voxels^2]: lower envelopes of parabolas, axis by
/// axis (Felzenszwalb and Huttenlocher, "Distance transforms of sampled functions", 2012).
fn to_nearest(solid: &[bool], shape: GridShape, wanted: bool) -> Vec<f32> {
    let far = shape.dims().iter().map(|&n| (n * n) as f32).sum::<f32>();
    let mut squared: Vec<f32> = solid.iter().map(|&solid| if solid == wanted { 0.0 } else { far }).collect();
    let dims = shape.dims();
    for axis in 0..3 {
        let (stride, length) = ([1, dims[0], dims[0] * dims[1]][axis], dims[axis]);
        let starts: Vec<usize> = (0..shape.len()).filter(|&point| shape.ijk(point)[axis] == 0).collect();
        let lines: Vec<Vec<f32>> = starts
            .par_iter()
            .map(|&start| envelope(&(0..length).map(|i| squared[start + i * stride]).collect::<Vec<_>>()))
            .collect();
        for (start, line) in starts.into_iter().zip(lines) {
            for (i, value) in line.into_iter().enumerate() {
                squared[start + i * stride] = value;
            }
        }
    }
    squared
}

/// `min over q of (p - q)^2 + f(q)` for every `p`.
fn envelope(f: &[f32]) -> Vec<f32> {
    // Parabolas that are lowest somewhere, and where each begins to be.
    let mut lowest: Vec<(usize, f64)> = Vec::new();
    for q in 0..f.len() {
        let meets = |other: usize| {
            let [q2, o2] = [q, other].map(|x| (x * x) as f64);
            ((f64::from(f[q]) + q2) - (f64::from(f[other]) + o2)) / (2.0 * (q as f64 - other as f64))
        };
        let mut begins = f64::NEG_INFINITY;
        while let Some(&(other, since)) = lowest.last() {
            begins = meets(other);
            if begins > since {
                break;
            }
            lowest.pop();
            begins = f64::NEG_INFINITY;
        }
        lowest.push((q, begins));
    }
    let mut at = 0;
    (0..f.len())
        .map(|p| {
            while lowest.get(at + 1).is_some_and(|&(_, begins)| begins < p as f64) {
                at += 1;
            }
            let q = lowest[at].0;
            let way = p as f32 - q as f32;
            way * way + f[q]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splitmix::{GOLDEN, mix};

    #[test]
    fn distances_agree_with_brute_force() {
        for (seed, [nx, ny, nz]) in [(1, [7, 6, 9]), (2, [1, 12, 5]), (3, [4, 4, 4])] {
            let shape = GridShape::new(nx, ny, nz);
            let solid: Vec<bool> = (0..shape.len() as u64)
                .map(|n| mix(GOLDEN.wrapping_mul(seed * 1000 + n + 1)).is_multiple_of(9))
                .collect();
            for wanted in [true, false] {
                let found = to_nearest(&solid, shape, wanted);
                for p in 0..shape.len() {
                    let from = shape.ijk(p);
                    let squared = |q: usize| {
                        let to = shape.ijk(q);
                        (0..3).map(|axis| (from[axis].abs_diff(to[axis])).pow(2)).sum::<usize>()
                    };
                    let expected = (0..shape.len()).filter(|&q| solid[q] == wanted).map(squared).min().unwrap();
                    assert_eq!(found[p], expected as f32, "{from:?}");
                }
            }
        }
    }
}
