//! What is in a volume: extremes and mean of a CT, size and place of every label.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::{CtVolume, LabelVolume, VoxelBox};
use crate::geometry::GridShape;

/// Values summed at a time. Fixed, so that the sum does not depend on the number of threads.
const CHUNK: usize = 1 << 16;

/// Extremes and mean of the values of a CT.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Statistics {
    /// Lowest value.
    pub min: f32,
    /// Highest value.
    pub max: f32,
    /// Sum of all values, in f64.
    pub sum: f64,
    /// Number of values.
    pub count: u64,
}

impl Statistics {
    /// Mean value; NaN of nothing.
    pub fn mean(&self) -> f64 {
        self.sum / self.count as f64
    }
}

impl CtVolume {
    /// Extremes, sum and count of all values; the same bits at any thread count.
    pub fn statistics(&self) -> Statistics {
        let nothing = Statistics { min: f32::INFINITY, max: f32::NEG_INFINITY, sum: 0.0, count: 0 };
        let of_chunk = |chunk: &[f32]| {
            chunk.iter().fold(nothing, |so_far, value| Statistics {
                min: so_far.min.min(*value),
                max: so_far.max.max(*value),
                sum: so_far.sum + f64::from(*value),
                count: so_far.count + 1,
            })
        };
        let chunks: Vec<Statistics> = self.as_slice().par_chunks(CHUNK).map(of_chunk).collect();
        chunks.iter().fold(nothing, |a, b| Statistics {
            min: a.min.min(b.min),
            max: a.max.max(b.max),
            sum: a.sum + b.sum,
            count: a.count + b.count,
        })
    }
}

/// Size and place of one label.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LabelSummary {
    /// The label; never 0.
    pub label: u16,
    /// Its voxels.
    pub voxels: u64,
    /// The smallest box around them.
    pub bounds: VoxelBox,
    /// For each axis, whether it touches the low and the high border of the volume: then the organ is likely cut off.
    pub touches: [[bool; 2]; 3],
}

impl LabelSummary {
    /// True when the label touches any border of the volume.
    pub fn touches_border(&self) -> bool {
        self.touches.iter().flatten().any(|touches| *touches)
    }
}

impl LabelVolume {
    /// Every label but 0, by number. One pass over the voxels.
    pub fn label_summaries(&self) -> Vec<LabelSummary> {
        let GridShape { nx, ny, .. } = self.shape();
        type Found = BTreeMap<u16, (u64, VoxelBox)>;
        let add = |found: &mut Found, label: u16, (voxels, bounds): (u64, VoxelBox)| {
            let known = found.entry(label).or_insert((0, bounds));
            *known = (known.0 + voxels, known.1.union(&bounds));
        };
        let of_slice = |k: usize, slice: &[u16]| {
            let mut found = Found::new();
            for (j, row) in slice.chunks(nx).enumerate() {
                let mut start = 0;
                while start < row.len() {
                    // Whole runs of one label: the map is touched once per run, not once per voxel.
                    let label = row[start];
                    let length = row.iter().skip(start).take_while(|other| **other == label).count();
                    if label != 0 {
                        let run = VoxelBox { min: [start, j, k], max: [start + length - 1, j, k] };
                        add(&mut found, label, (length as u64, run));
                    }
                    start += length;
                }
            }
            found
        };
        let slices = self.as_slice().par_chunks((nx * ny).max(1)).enumerate();
        // Counts and boxes are integers: the order of merging does not matter.
        let found = slices.map(|(k, slice)| of_slice(k, slice)).reduce(Found::new, |mut all, part| {
            part.into_iter().for_each(|(label, voxels)| add(&mut all, label, voxels));
            all
        });
        let summary = |(label, (voxels, bounds)): (u16, (u64, VoxelBox))| LabelSummary {
            label,
            voxels,
            bounds,
            touches: bounds.touches(self.shape()),
        };
        found.into_iter().map(summary).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Affine, Grid};

    fn grid(nx: usize, ny: usize, nz: usize) -> Grid {
        Grid { shape: GridShape::new(nx, ny, nz), affine: Affine::from_spacing([1.0; 3], [0.0; 3]).unwrap() }
    }

    #[test]
    fn statistics_are_those_of_the_values_and_the_same_on_any_number_of_threads() {
        let grid = grid(100, 100, 20);
        let values: Vec<f32> = (0..grid.shape.len()).map(|n| (n as f32 * 0.37).sin() * 1000.0).collect();
        let plain: f64 = values.iter().map(|value| f64::from(*value)).sum();
        let volume = CtVolume::from_vec(grid, values);
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| volume.statistics())
        };
        let found = on(1);
        assert_eq!(found.count, 200_000);
        assert!((found.sum - plain).abs() < 1e-6, "{} is not {plain}", found.sum);
        assert!(found.max > 999.0 && found.max <= 1000.0 && found.min < -999.0);
        for threads in [2, 3, 7] {
            assert_eq!(on(threads).sum.to_bits(), found.sum.to_bits());
        }
    }

    #[test]
    fn labels_are_counted_boxed_and_checked_against_the_border() {
        let grid = grid(6, 4, 3);
        let mut values = vec![0; grid.shape.len()];
        for ijk in [[1, 1, 1], [2, 1, 1], [4, 2, 1]] {
            values[grid.shape.linear(ijk)] = 300;
        }
        values[grid.shape.linear([5, 0, 2])] = 2;
        let found = LabelVolume::from_vec(grid, values).label_summaries();
        assert_eq!(found.len(), 2);
        assert_eq!((found[0].label, found[0].voxels), (2, 1));
        assert_eq!(found[0].touches, [[false, true], [true, false], [false, true]]);
        assert_eq!((found[1].label, found[1].voxels), (300, 3));
        assert_eq!(found[1].bounds, VoxelBox { min: [1, 1, 1], max: [4, 2, 1] });
        assert!(!found[1].touches_border());
    }
}
