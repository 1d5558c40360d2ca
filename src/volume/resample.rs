//! The same volume on another grid.
//!
//! A target voxel takes what its box covers, so a coarser grid loses no thin wall and no volume, and a finer one is
//! interpolated:
//! - Axes parallel and in the same order: each axis has its own weights, the exact overlap of source voxels with the target
//!   voxel. For a CT the target voxel counts as at least one source voxel wide, which makes it trilinear interpolation on
//!   finer grids and box averaging on coarser ones, and the same at ratio 1. Fractions of labels are exact.
//! - Oblique or swapped axes: the target voxel is divided into equal cells no larger than a source voxel (labels: half a
//!   source voxel, and at least [`LABEL_CELLS`] along each axis), which are sampled at their centres.
//!
//! Sums are f64 in fixed order: the same bits at any thread count.

use rayon::prelude::*;

use super::sample::is_inside;
use super::{CtVolume, LabelVolume, Volume};
use crate::geometry::{Affine, Grid, GridShape, Matrix3, Point3, Vector3};

/// Largest number of voxels that [`grid_with_spacing`] makes: 8 GiB of f32.
const MAX_VOXELS: f64 = 2_147_483_648.0;
/// Axes count as parallel when no voxel of the target moves by more than this across them [source voxels].
const PARALLEL_TOLERANCE: f64 = 1e-3;
/// Overlaps below this [source voxels] are rounding, not coverage.
const ROUNDING: f64 = 1e-9;
/// Least number of cells along each axis for labels on oblique grids: 64 samples resolve a fraction to about 0.02.
const LABEL_CELLS: usize = 4;

/// Why a grid cannot be resampled to a spacing.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ResampleError {
    /// Not a length.
    #[error("spacing [{axis}] is {found} mm, expected a finite length above 0; give the spacing in mm")]
    Spacing {
        /// Voxel axis, from 0.
        axis: usize,
        /// The value found [mm].
        found: f64,
    },
    /// More voxels than would fit in memory.
    #[error(
        "a spacing of {spacing:?} mm needs {found:.3e} voxels, expected at most {MAX_VOXELS:.3e}; use a coarser spacing \
         or crop first"
    )]
    TooFine {
        /// The spacing asked for [mm].
        spacing: [f64; 3],
        /// Voxels it needs.
        found: f64,
    },
}

/// A grid with another spacing [mm] over the same box: same axes, same first corner, enough voxels to reach the last.
///
/// # Errors
/// If a spacing is no length, or the grid would have more than 2^31 voxels.
pub fn grid_with_spacing(source: &Grid, spacing: [f64; 3]) -> Result<Grid, ResampleError> {
    let mut ratio = Vector3::zeros();
    let mut counts = [0.0; 3];
    for (axis, (wanted, present)) in spacing.into_iter().zip(source.affine.spacing()).enumerate() {
        ratio[axis] = wanted / present;
        counts[axis] = (source.shape.dims()[axis] as f64 / ratio[axis] - 1e-6).ceil().max(1.0);
        // The ratio must be invertible, too: 1e-320 mm is above 0 and still no spacing.
        if !(wanted.is_finite() && wanted > 0.0 && ratio[axis] > 0.0 && counts[axis].is_finite()) {
            return Err(ResampleError::Spacing { axis, found: wanted });
        }
    }
    let found = counts[0] * counts[1] * counts[2];
    if found > MAX_VOXELS {
        return Err(ResampleError::TooFine { spacing, found });
    }
    // The corner of the first voxel, index -0.5, stays where it is.
    let shifted = source.affine.shifted(ratio * 0.5 - Vector3::repeat(0.5));
    let linear = source.affine.linear() * Matrix3::from_diagonal(&ratio);
    let affine = Affine::from_parts(linear, shifted.origin().coords)
        .map_err(|_| ResampleError::Spacing { axis: ratio.imin(), found: spacing[ratio.imin()] })?;
    let [nx, ny, nz] = counts.map(|count| count as usize);
    Ok(Grid { shape: GridShape::new(nx, ny, nz), affine })
}

/// A CT on another grid: interpolated where the grid is finer, averaged where it is coarser.
///
/// A target voxel that lies across the border of the source takes the part inside; one wholly beyond gets `outside`.
pub fn resample_ct(ct: &CtVolume, target: &Grid, outside: f32) -> CtVolume {
    let map = IndexMap::new(ct.grid(), target);
    let values = ct.as_slice();
    match map.overlaps(ct.shape(), target.shape, 1.0) {
        Some([x, y, z]) => fill(target, |[i, j, k]| {
            if !(x[i].reaches_source && y[j].reaches_source && z[k].reaches_source) {
                return outside;
            }
            let (mut sum, mut covered) = (0.0, 0.0);
            for (source_k, weight_k) in z[k].taps() {
                for (source_j, weight_j) in y[j].taps() {
                    let row = ct.shape().linear([0, source_j, source_k]);
                    for (source_i, weight_i) in x[i].taps() {
                        let weight = weight_i * weight_j * weight_k;
                        sum += weight * f64::from(values[row + source_i]);
                        covered += weight;
                    }
                }
            }
            if covered > 0.0 { (sum / covered) as f32 } else { outside }
        }),
        None => {
            let cells = map.cells(1.0, 1);
            fill(target, |ijk| {
                let (mut sum, mut count) = (0.0, 0.0);
                cells.for_each(&map, ijk, |index| {
                    if is_inside(ct.shape(), index) {
                        sum += f64::from(ct.sample_index(index, outside));
                        count += 1.0;
                    }
                });
                if count > 0.0 { (sum / count) as f32 } else { outside }
            })
        }
    }
}

/// The fraction (0 to 1) of each target voxel that the selected labels cover; beyond the source there is no label.
///
/// # Accuracy
/// Parallel axes: exact to f32 rounding, so the covered volume is that of the source. Oblique: see the module.
pub fn label_fraction(labels: &LabelVolume, target: &Grid, selected: impl Fn(u16) -> bool + Sync) -> Volume<f32> {
    let coverage = Coverage::new(labels, target);
    fill(target, |ijk| {
        let mut fraction: f64 = 0.0;
        coverage.for_each(ijk, |label, weight| {
            if selected(label) {
                fraction += weight;
            }
        });
        fraction.min(1.0) as f32
    })
}

/// What fills each target voxel: the label other than background that covers most of it (the lower number on a tie, 0 where
/// there is none), and the fraction (0 to 1) that all labels other than background cover together.
///
/// # Accuracy
/// As [`label_fraction`].
pub fn label_shares(labels: &LabelVolume, target: &Grid) -> (LabelVolume, Volume<f32>) {
    let coverage = Coverage::new(labels, target);
    let both = fill(target, |ijk| {
        let mut found: Vec<(u16, f64)> = Vec::with_capacity(4);
        coverage.for_each(ijk, |label, weight| match found.iter_mut().find(|(known, _)| *known == label) {
            _ if label == 0 => {}
            Some((_, total)) => *total += weight,
            None => found.push((label, weight)),
        });
        found.sort_unstable_by_key(|(label, _)| *label);
        let largest = found.iter().fold(
            (0, 0.0),
            |best, &(label, weight)| {
                if weight > best.1 + ROUNDING { (label, weight) } else { best }
            },
        );
        let total: f64 = found.iter().map(|(_, weight)| weight).sum();
        (largest.0, total.min(1.0) as f32)
    });
    let (labels, fractions) = both.as_slice().iter().copied().unzip();
    (Volume::from_vec(*target, labels), Volume::from_vec(*target, fractions))
}

/// The label that covers most of each target voxel; on a tie the lower number, but any organ before background.
///
/// Beyond the source there is background. Ratios such as 2/3 and 2 put source borders in the middle of target voxels: many
/// ties, so organs grow by up to half a target voxel. Where volume matters take [`label_fraction`].
pub fn resample_labels(labels: &LabelVolume, target: &Grid) -> LabelVolume {
    let coverage = Coverage::new(labels, target);
    fill(target, |ijk| {
        // Few labels meet in one voxel: a list is faster than a map, and its first element is the common case.
        let mut found: Vec<(u16, f64)> = Vec::with_capacity(4);
        let mut covered = 0.0;
        coverage.for_each(ijk, |label, weight| {
            covered += weight;
            match found.iter_mut().find(|(known, _)| *known == label) {
                Some((_, total)) => *total += weight,
                None => found.push((label, weight)),
            }
        });
        let background: f64 = found.iter().filter(|(label, _)| *label == 0).map(|(_, weight)| weight).sum();
        let mut best = (0, background + (1.0 - covered).max(0.0) - ROUNDING);
        found.sort_unstable_by_key(|(label, _)| *label);
        for (label, weight) in found.into_iter().filter(|(label, _)| *label != 0) {
            // An organ that comes later must be clearly larger; the first must only match the background.
            let needed = if best.0 == 0 { best.1 } else { best.1 + ROUNDING };
            if weight > needed {
                best = (label, weight);
            }
        }
        best.0
    })
}

/// Calls `value` for every voxel of a grid, rows in parallel.
fn fill<V: Clone + Default + Send>(grid: &Grid, value: impl Fn([usize; 3]) -> V + Sync) -> Volume<V> {
    let GridShape { nx, ny, .. } = grid.shape;
    let mut values = vec![V::default(); grid.shape.len()];
    values.par_chunks_mut(nx.max(1)).enumerate().for_each(|(row, out)| {
        for (i, out) in out.iter_mut().enumerate() {
            *out = value([i, row % ny, row / ny]);
        }
    });
    Volume::from_vec(*grid, values)
}

/// Target voxel index to source voxel index.
struct IndexMap {
    linear: Matrix3,
    origin: Vector3,
}

impl IndexMap {
    fn new(source: &Grid, target: &Grid) -> Self {
        let column = |axis: usize| source.affine.index_vector_of(target.affine.linear().column(axis).into_owned());
        Self {
            linear: Matrix3::from_columns(&[column(0), column(1), column(2)]),
            origin: source.affine.index_of(target.affine.origin()).coords,
        }
    }

    fn source_index(&self, [i, j, k]: [usize; 3]) -> Point3 {
        Point3::from(self.linear * Vector3::new(i as f64, j as f64, k as f64) + self.origin)
    }

    /// The weights along each axis when the axes are parallel; `None` when they are not.
    ///
    /// `least_width`: how wide a target voxel counts at least [source voxels].
    fn overlaps(&self, source: GridShape, target: GridShape, least_width: f64) -> Option<[Vec<Overlap>; 3]> {
        let reach = Vector3::from(target.dims().map(|n| n as f64));
        for axis in 0..3 {
            let across: f64 = (0..3)
                .filter(|other| *other != axis)
                .map(|other| (self.linear[(axis, other)] * reach[other]).abs())
                .sum();
            if across > PARALLEL_TOLERANCE {
                return None;
            }
        }
        Some(std::array::from_fn(|axis| {
            let (step, start) = (self.linear[(axis, axis)], self.origin[axis]);
            let overlap =
                |n: usize| Overlap::new(start + step * n as f64, step.abs(), least_width, source.dims()[axis]);
            (0..target.dims()[axis]).map(overlap).collect()
        }))
    }

    /// Equal cells of a target voxel, `per_voxel` of them to a source voxel along each axis and at least `least`.
    fn cells(&self, per_voxel: f64, least: usize) -> Cells {
        Cells(std::array::from_fn(|axis| {
            let across = self.linear.column(axis).norm() * per_voxel;
            ((across - 1e-6).ceil() as usize).max(least)
        }))
    }
}

/// The source voxels that one target voxel covers along one axis, and how much of it each covers.
struct Overlap {
    first: usize,
    /// Parts of the target voxel's width; they sum to 1 unless it reaches beyond the source.
    weights: Vec<f64>,
    /// False when the target voxel, at its true width, lies wholly beyond the source.
    reaches_source: bool,
}

impl Overlap {
    fn new(centre: f64, true_width: f64, least_width: f64, count: usize) -> Self {
        let width = true_width.max(least_width);
        let (low, high) = (centre - width / 2.0, centre + width / 2.0);
        // Voxel n spans n - 0.5 to n + 0.5; the casts saturate at 0, and an empty range gives no weights.
        let first = (low + 0.5 + ROUNDING).floor().max(0.0) as usize;
        let end = ((high + 0.5 - ROUNDING).ceil().max(0.0) as usize).min(count);
        let weight = |n: usize| ((high.min(n as f64 + 0.5) - low.max(n as f64 - 0.5)) / width).max(0.0);
        let (below, above) = (centre - true_width / 2.0, centre + true_width / 2.0);
        let reaches_source = below < count as f64 - 0.5 - ROUNDING && above > ROUNDING - 0.5;
        Self { first, weights: (first..end).map(weight).collect(), reaches_source }
    }

    fn taps(&self) -> impl Iterator<Item = (usize, f64)> {
        (self.first..).zip(self.weights.iter().copied())
    }
}

/// Number of cells of a target voxel along each axis.
struct Cells([usize; 3]);

impl Cells {
    fn count(&self) -> usize {
        self.0.iter().product()
    }

    /// Calls `visit` with the source index of every cell's centre.
    fn for_each(&self, map: &IndexMap, ijk: [usize; 3], mut visit: impl FnMut(Point3)) {
        let centre = map.source_index(ijk);
        let offset = |axis: usize, n: usize| (n as f64 + 0.5) / self.0[axis] as f64 - 0.5;
        for c in 0..self.0[2] {
            for b in 0..self.0[1] {
                for a in 0..self.0[0] {
                    visit(centre + map.linear * Vector3::new(offset(0, a), offset(1, b), offset(2, c)));
                }
            }
        }
    }
}

/// Which labels cover a target voxel, and how much of it.
struct Coverage<'a> {
    labels: &'a LabelVolume,
    map: IndexMap,
    overlaps: Option<[Vec<Overlap>; 3]>,
    cells: Cells,
}

impl<'a> Coverage<'a> {
    fn new(labels: &'a LabelVolume, target: &Grid) -> Self {
        let map = IndexMap::new(labels.grid(), target);
        let overlaps = map.overlaps(labels.shape(), target.shape, 0.0);
        let cells = map.cells(2.0, LABEL_CELLS);
        Self { labels, map, overlaps, cells }
    }

    /// Calls `visit` with labels and the fractions they cover (a label may come several times); what lies beyond the source
    /// is left out.
    fn for_each(&self, ijk: [usize; 3], mut visit: impl FnMut(u16, f64)) {
        let (values, shape) = (self.labels.as_slice(), self.labels.shape());
        if let Some([x, y, z]) = &self.overlaps {
            for (k, weight_k) in z[ijk[2]].taps() {
                for (j, weight_j) in y[ijk[1]].taps() {
                    let row = shape.linear([0, j, k]);
                    for (i, weight_i) in x[ijk[0]].taps() {
                        visit(values[row + i], weight_i * weight_j * weight_k);
                    }
                }
            }
        } else {
            let weight = 1.0 / self.cells.count() as f64;
            self.cells.for_each(&self.map, ijk, |index| {
                if is_inside(shape, index) {
                    visit(self.labels.label_at_index(index, 0), weight);
                }
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(shape: [usize; 3], spacing: [f64; 3], origin: [f64; 3]) -> Grid {
        let [nx, ny, nz] = shape;
        Grid { shape: GridShape::new(nx, ny, nz), affine: Affine::from_spacing(spacing, origin).unwrap() }
    }

    fn ball(grid: Grid, centre: Point3, radius: f64) -> LabelVolume {
        let inside = |n: usize| u16::from((grid.place(n) - centre).norm() < radius);
        LabelVolume::from_vec(grid, (0..grid.shape.len()).map(inside).collect())
    }

    fn volume_of(fraction: &Volume<f32>) -> f64 {
        let voxel = fraction.grid().affine.determinant().abs();
        fraction.as_slice().iter().map(|part| f64::from(*part)).sum::<f64>() * voxel
    }

    #[test]
    fn another_spacing_covers_the_same_box() {
        let source = grid([10, 12, 7], [-1.5, 1.5, 3.0], [4.0, 5.0, 6.0]);
        let coarse = grid_with_spacing(&source, [3.0, 2.0, 3.0]).unwrap();
        assert_eq!(coarse.shape, GridShape::new(5, 9, 7));
        let corner = Point3::new(-0.5, -0.5, -0.5);
        assert!((coarse.affine.apply(corner) - source.affine.apply(corner)).norm() < 1e-12);
        assert_eq!(grid_with_spacing(&source, [1.5, 1.5, 3.0]).unwrap(), source);
        let bad = grid_with_spacing(&source, [1.0, 0.0, 1.0]).unwrap_err().to_string();
        assert!(bad.contains("[1] is 0 mm"), "{bad}");
        assert!(grid_with_spacing(&source, [1.0, f64::NAN, 1.0]).is_err());
        assert!(grid_with_spacing(&source, [1e-320, 1.0, 1.0]).is_err());
        assert!(matches!(grid_with_spacing(&source, [1e-4; 3]), Err(ResampleError::TooFine { .. })));
    }

    #[test]
    fn the_same_grid_changes_nothing() {
        let source = grid([5, 4, 3], [1.0, 2.0, 3.0], [7.0, 8.0, 9.0]);
        let ct = CtVolume::from_vec(source, (0..60).map(|n| (n * n % 37) as f32 - 20.0).collect());
        assert_eq!(resample_ct(&ct, &source, 0.0), ct);
        let labels = LabelVolume::from_vec(source, (0..60).map(|n| n % 5).collect());
        assert_eq!(resample_labels(&labels, &source), labels);
    }

    #[test]
    fn a_finer_grid_is_trilinear_and_a_coarser_one_an_average() {
        let source = grid([8, 8, 8], [1.0; 3], [0.0; 3]);
        let ct = CtVolume::from_vec(source, (0..512).map(|n| (n * 7919 % 1009) as f32).collect());
        let fine = grid_with_spacing(&source, [0.4; 3]).unwrap();
        let found = resample_ct(&ct, &fine, 0.0);
        for (n, value) in found.as_slice().iter().enumerate() {
            assert!((value - ct.sample(fine.place(n), 0.0)).abs() < 1e-3, "voxel {n}");
        }
        let coarse = grid_with_spacing(&source, [2.0; 3]).unwrap();
        let found = resample_ct(&ct, &coarse, 0.0);
        let first: f32 = [0, 1, 8, 9, 64, 65, 72, 73].iter().map(|n| ct.as_slice()[*n] / 8.0).sum();
        assert!((found.as_slice()[0] - first).abs() < 1e-3);
        // The mean survives coarsening, even by a ratio that is no whole number of voxels.
        let uneven = grid([5, 5, 5], [1.6; 3], [0.3; 3]);
        let mean = |volume: &CtVolume| volume.statistics().mean();
        assert!((mean(&resample_ct(&ct, &uneven, 0.0)) - mean(&ct)).abs() < 1e-3);
    }

    #[test]
    fn fractions_keep_the_volume_exactly_on_parallel_grids() {
        let source = grid([40, 40, 40], [-1.0, 1.0, 1.0], [20.0, -20.0, -20.0]);
        let labels = ball(source, Point3::new(0.3, -0.4, 0.2), 13.7);
        let voxels = labels.as_slice().iter().filter(|label| **label == 1).count() as f64;
        for spacing in [0.7, 1.0, 2.0, 2.7] {
            let target = grid_with_spacing(&source, [spacing; 3]).unwrap();
            let found = volume_of(&label_fraction(&labels, &target, |label| label == 1));
            assert!((found / voxels - 1.0).abs() < 1e-6, "{spacing} mm: {found} is not {voxels}");
        }
    }

    #[test]
    fn fractions_keep_the_volume_nearly_on_oblique_grids() {
        let source = grid([40, 40, 40], [1.0; 3], [-20.0; 3]);
        let labels = ball(source, Point3::new(0.3, -0.4, 0.2), 13.7);
        let voxels = labels.as_slice().iter().filter(|label| **label == 1).count() as f64;
        let turn = nalgebra::Rotation3::from_euler_angles(0.4, -0.3, 0.8).into_inner();
        for spacing in [0.8, 2.2] {
            let count = (60.0 / spacing) as usize;
            let axes = turn * spacing;
            let first = Vector3::repeat(0.0) - axes * Vector3::repeat(count as f64 / 2.0);
            let affine = Affine::from_parts(axes, first).unwrap();
            let target = Grid { shape: GridShape::new(count, count, count), affine };
            let found = volume_of(&label_fraction(&labels, &target, |label| label == 1));
            assert!((found / voxels - 1.0).abs() < 2e-3, "{spacing} mm: {found} is not {voxels}");
        }
    }

    #[test]
    fn an_oblique_ct_keeps_a_linear_field() {
        let source = grid([20, 20, 20], [1.0; 3], [-10.0; 3]);
        let value = |p: Point3| 2.0 * p.x - p.y + 3.0 * p.z;
        let ct = CtVolume::from_vec(source, (0..8000).map(|n| value(source.place(n)) as f32).collect());
        let turn = nalgebra::Rotation3::from_euler_angles(0.4, -0.3, 0.8).into_inner();
        for spacing in [0.5, 1.7] {
            let affine = Affine::from_parts(turn * spacing, Vector3::repeat(-1.0)).unwrap();
            let target = Grid { shape: GridShape::new(4, 4, 4), affine };
            let found = resample_ct(&ct, &target, 0.0);
            for (n, found) in found.as_slice().iter().enumerate() {
                let expected = value(target.place(n));
                assert!(
                    (f64::from(*found) - expected).abs() < 1e-3,
                    "{spacing} mm, voxel {n}: {found}, not {expected}"
                );
            }
        }
    }

    #[test]
    fn swapped_axes_are_followed() {
        let source = grid([4, 5, 6], [1.0; 3], [0.0; 3]);
        let labels = LabelVolume::from_vec(source, (1..=120).collect());
        // Target i runs along source k, j along i, k along j.
        let linear = Matrix3::new(0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0);
        let affine = Affine::from_parts(linear, Vector3::zeros()).unwrap();
        let target = Grid { shape: GridShape::new(6, 4, 5), affine };
        let found = resample_labels(&labels, &target);
        for (n, label) in found.as_slice().iter().enumerate() {
            let [i, j, k] = target.shape.ijk(n);
            assert_eq!(*label, labels.as_slice()[source.shape.linear([j, k, i])]);
        }
    }

    #[test]
    fn the_majority_wins_and_ties_are_settled() {
        let source = grid([8, 1, 1], [1.0; 3], [0.0; 3]);
        let coarse = grid_with_spacing(&source, [4.0, 1.0, 1.0]).unwrap();
        let majority = |values: [u16; 8]| {
            resample_labels(&LabelVolume::from_vec(source, values.to_vec()), &coarse).as_slice().to_vec()
        };
        assert_eq!(majority([3, 3, 3, 5, 0, 0, 0, 5]), [3, 0]);
        assert_eq!(majority([5, 3, 3, 5, 0, 5, 5, 0]), [3, 5]);
        assert_eq!(majority([7, 5, 5, 0, 9, 0, 9, 9]), [5, 9]);
    }

    #[test]
    fn beyond_the_source_there_is_nothing() {
        let source = grid([4, 4, 4], [1.0; 3], [0.0; 3]);
        let target = grid([4, 1, 1], [2.0, 1.0, 1.0], [-2.0, 0.0, 0.0]);
        let labels = LabelVolume::from_vec(source, vec![1; 64]);
        // Target voxels span -3..-1, -1..1, 1..3, 3..5 of the source's -0.5..3.5.
        assert_eq!(label_fraction(&labels, &target, |label| label == 1).as_slice(), [0.0, 0.75, 1.0, 0.25]);
        assert_eq!(resample_labels(&labels, &target).as_slice(), [0, 1, 1, 0]);
        let ct = CtVolume::from_vec(source, vec![40.0; 64]);
        assert_eq!(resample_ct(&ct, &target, -1024.0).as_slice(), [-1024.0, 40.0, 40.0, 40.0]);
    }
}
