//! Which organ each grid point belongs to, and where between two points the borders lie.

use std::ops::Range;

use rayon::prelude::*;

use super::face::OUTSIDE;
use crate::geometry::GridShape;
use crate::lattice::{Lattice, NO_PARTICLE};
use crate::surface::marching_cubes::sweep::CLEARANCE;

/// The skin keeps this far from zero at points that organs only fill together.
const LEAST: f32 = 1e-3;

/// What an organ has of a point, by how far its field lies above that of none of it: less than the first counts as noise, more than the
/// second in full.
const SHARE: [f32; 2] = [0.1, 0.5];

/// Fields below this are those of none of the organ; they are not all -1, since a constant keeps the volume of each organ.
const NONE: f32 = -0.75;

/// How much of an organ there is where its field is so far above that of none of it.
fn share(above: f32) -> f32 {
    if above >= SHARE[1] { above } else { ((above - SHARE[0]) * SHARE[1] / (SHARE[1] - SHARE[0])).max(0.0) }
}

/// The field where there is none of an organ: the median of all that is near it.
fn none_of(values: &[f32]) -> f32 {
    let mut low: Vec<f32> = values.par_iter().copied().map(held).filter(|&value| value < NONE).collect();
    if low.is_empty() {
        return -1.0;
    }
    let middle = low.len() / 2;
    *low.select_nth_unstable_by(middle, f32::total_cmp).1
}

/// The field of one organ on a part of a grid: from about -1 (none of it) to +1 (nothing else), above zero inside.
#[derive(Debug, Clone)]
pub struct OrganField {
    /// First grid point of the part.
    pub low: [usize; 3],
    /// Points of the part along each axis.
    pub shape: GridShape,
    /// Values, x fastest; held within -2 and 2, NaN is -1. Beyond the part the field is -1.
    pub values: Vec<f32>,
}

impl OrganField {
    fn value(&self, ijk: [usize; 3]) -> f32 {
        let at = [0, 1, 2].map(|axis| ijk[axis].wrapping_sub(self.low[axis]));
        let within = (0..3).all(|axis| at[axis] < self.shape.dims()[axis]);
        if within { held(self.values[self.shape.linear(at)]) } else { -1.0 }
    }
}

fn held(value: f32) -> f32 {
    if value.is_nan() { -1.0 } else { value.clamp(-2.0, 2.0) }
}

/// A grid divided among organs: every point is the organ's whose field is largest there, or [`OUTSIDE`].
///
/// Walls lie where the fields of two organs are equal, skins where the fields of all together leave half.
#[derive(Debug, Clone)]
pub struct Partition {
    shape: GridShape,
    labels: Vec<u8>,
    /// Above zero in tissue of any organ.
    skin: Vec<f32>,
    fields: Vec<OrganField>,
}

impl Partition {
    /// Divides a grid.
    ///
    /// - `fields`: one per organ; the earlier organ has a point where two are equal.
    /// - `full`: whether organs fill all there is at a point: then it is tissue also where no single field is above zero.
    ///
    /// # Panics
    /// If there are more than 255 fields, a field has not one value per point of its part, or its part leaves the grid.
    pub fn new(shape: GridShape, fields: Vec<OrganField>, full: impl Fn(usize) -> bool + Sync) -> Self {
        assert!(fields.len() <= usize::from(OUTSIDE), "organs are numbered by a byte");
        let mut best = vec![(-2.0_f32, OUTSIDE); shape.len()];
        let mut shares = vec![0.0_f32; shape.len()];
        let mut none = Vec::with_capacity(fields.len());
        let layer = shape.nx * shape.ny;
        for (organ, field) in fields.iter().enumerate() {
            let OrganField { low, shape: part, values } = field;
            assert_eq!(values.len(), part.len(), "one value per point");
            assert!((0..3).all(|axis| low[axis] + part.dims()[axis] <= shape.dims()[axis]), "a part of the grid");
            let nothing = none_of(values);
            none.push(nothing);
            let layers = best.par_chunks_mut(layer.max(1)).zip(shares.par_chunks_mut(layer.max(1)));
            layers.enumerate().skip(low[2]).take(part.nz).for_each(|(k, (best, shares))| {
                for j in 0..part.ny {
                    let from = part.linear([0, j, k - low[2]]);
                    let to = (low[1] + j) * shape.nx + low[0];
                    for (i, &value) in values[from..from + part.nx].iter().enumerate() {
                        let value = held(value);
                        shares[to + i] += share(value - nothing);
                        if value > best[to + i].0 {
                            best[to + i] = (value, organ as u8);
                        }
                    }
                }
            });
        }
        let (labels, skin) = (0..shape.len())
            .into_par_iter()
            .map(|point| {
                let (value, organ) = best[point];
                // The leading field, and what the others have there.
                let others = none.get(usize::from(organ)).map_or(0.0, |nothing| shares[point] - share(value - nothing));
                let together = value + others.max(0.0);
                let inside = value > 0.0 || (together > 0.0 && organ != OUTSIDE && full(point));
                if inside { (organ, together.max(value).max(LEAST)) } else { (OUTSIDE, together.min(value)) }
            })
            .unzip();
        Self { shape, labels, skin, fields }
    }

    /// The same, ended by planes across the axes: what of it lies beyond is outside.
    ///
    /// - `within`: points along each axis on the inner side of both planes.
    /// - `beyond`: for each axis how much farther the first point beyond is from the plane than the last one within, at either end.
    pub fn ended(mut self, within: [Range<usize>; 3], beyond: [[f32; 2]; 3]) -> Self {
        let shape = self.shape;
        let inner = |point: usize| {
            let ijk = shape.ijk(point);
            let mut ratio = None;
            let nearest = [0, 1, 2].map(|axis| {
                let Range { start, end } = within[axis];
                let held = ijk[axis].clamp(start, end.max(start + 1) - 1);
                if held != ijk[axis] {
                    ratio = Some(beyond[axis][usize::from(ijk[axis] > held)]);
                }
                held
            });
            ratio.map(|ratio| (shape.linear(nearest), ratio))
        };
        let whole = std::mem::take(&mut self.skin);
        let ended = |point: usize| inner(point).map_or(whole[point], |(near, ratio)| -(whole[near].abs() * ratio));
        self.skin = (0..whole.len()).into_par_iter().map(ended).collect();
        self.labels.par_iter_mut().enumerate().filter(|(point, _)| inner(*point).is_some()).for_each(|(_, label)| {
            *label = OUTSIDE;
        });
        self
    }

    /// Divides the grid of a lattice by fields on all of it, one per organ, see [`crate::surface::field`].
    ///
    /// # Panics
    /// As [`Partition::new`].
    pub fn of_lattice(lattice: &Lattice, fields: Vec<Vec<f32>>) -> Self {
        let shape = lattice.grid.shape;
        let fields = fields.into_iter().map(|values| OrganField { low: [0; 3], shape, values }).collect();
        let mut partition = Self::new(shape, fields, |_| false);
        for (label, &particle) in partition.labels.iter_mut().zip(&lattice.particle_at) {
            if particle == NO_PARTICLE {
                *label = OUTSIDE;
            }
        }
        partition
    }

    /// Number of organs, with or without tissue.
    pub fn organs(&self) -> usize {
        self.fields.len()
    }

    /// Organ of each grid point, or [`OUTSIDE`].
    pub fn labels(&self) -> &[u8] {
        &self.labels
    }

    pub(super) fn shape(&self) -> GridShape {
        self.shape
    }

    pub(super) fn skin(&self) -> &[f32] {
        &self.skin
    }

    /// Where the wall between the organs of two points lies, as a fraction of the way from the first.
    pub(super) fn wall(&self, from: usize, to: usize) -> f32 {
        let organs = [self.labels[from], self.labels[to]].map(usize::from);
        let lead = |point: usize, own: usize, other: usize| {
            let ijk = self.shape.ijk(point);
            (self.fields[own].value(ijk) - self.fields[other].value(ijk)).max(0.0)
        };
        let (near, far) = (lead(from, organs[0], organs[1]), lead(to, organs[1], organs[0]));
        let t = near / (near + far);
        if t.is_finite() { t.clamp(CLEARANCE, 1.0 - CLEARANCE) } else { 0.5 }
    }

    /// The part of the grid that begins at a point, which may lie before the first; outside beyond the grid.
    pub(super) fn part(&self, first: [i64; 3], shape: GridShape) -> Self {
        let of = |point: usize| {
            let ijk = shape.ijk(point);
            let at = [0, 1, 2].map(|axis| first[axis] + ijk[axis] as i64);
            let within = (0..3).all(|axis| at[axis] >= 0 && at[axis] < self.shape.dims()[axis] as i64);
            within.then(|| self.shape.linear(at.map(|i| i as usize)))
        };
        let pick = |point: usize| of(point).map_or((OUTSIDE, -1.0), |at| (self.labels[at], self.skin[at]));
        let (labels, skin) = (0..shape.len()).into_par_iter().map(pick).unzip();
        let cut = |field: &OrganField| {
            let low = [0, 1, 2].map(|axis| (field.low[axis] as i64 - first[axis]).max(0));
            let end = [0, 1, 2].map(|axis| {
                let end = (field.low[axis] + field.shape.dims()[axis]) as i64 - first[axis];
                end.clamp(low[axis], shape.dims()[axis] as i64)
            });
            let dims = [0, 1, 2].map(|axis| (end[axis] - low[axis]) as usize);
            let part = GridShape::new(dims[0], dims[1], dims[2]);
            let value = |point: usize| {
                let ijk = part.ijk(point);
                field.value([0, 1, 2].map(|axis| (ijk[axis] as i64 + low[axis] + first[axis]) as usize))
            };
            let values = (0..part.len()).into_par_iter().map(value).collect();
            OrganField { low: low.map(|i| i as usize), shape: part, values }
        };
        Self { shape, labels, skin, fields: self.fields.iter().map(cut).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(values: &[f32]) -> OrganField {
        OrganField { low: [0; 3], shape: GridShape::new(values.len(), 1, 1), values: values.to_vec() }
    }

    #[test]
    fn the_largest_field_has_a_point_and_equal_fields_make_a_wall() {
        let shape = GridShape::new(4, 1, 1);
        let fields = vec![row(&[1.0, 0.5, -0.1, -1.0]), row(&[-1.0, -0.3, 0.1, -0.9])];
        let partition = Partition::new(shape, fields, |_| false);
        assert_eq!(partition.labels(), [0, 0, 1, OUTSIDE]);
        assert!((partition.wall(1, 2) - 0.8).abs() < 1e-6, "leads of 0.8 and 0.2");
        assert!((partition.wall(2, 1) - 0.2).abs() < 1e-6);
        assert!((partition.skin()[1] - 1.1).abs() < 1e-6, "0.5 of the one, and 0.6 of the other");
    }

    #[test]
    fn no_air_between_organs_that_fill_all_there_is() {
        let shape = GridShape::new(3, 1, 1);
        let fields = || vec![row(&[0.9, -0.02, -1.0]), row(&[-1.0, -0.03, 0.9])];
        assert_eq!(Partition::new(shape, fields(), |_| false).labels(), [0, OUTSIDE, 1]);
        assert_eq!(Partition::new(shape, fields(), |_| true).labels(), [0, 0, 1]);
    }

    #[test]
    fn an_organ_that_goes_on_is_ended_in_a_plane() {
        let shape = GridShape::new(4, 1, 1);
        let partition = Partition::new(shape, vec![row(&[0.2, 0.9, 0.8, 0.7])], |_| false);
        let ended = partition.ended([1..3, 0..1, 0..1], [[3.0, 1.0], [1.0; 2], [1.0; 2]]);
        assert_eq!(ended.labels(), [OUTSIDE, 0, 0, OUTSIDE]);
        let skin = ended.skin();
        assert!((skin[1] / (skin[1] - skin[0]) - 0.25).abs() < 1e-6, "a quarter of the way out: {skin:?}");
        assert!((skin[2] / (skin[2] - skin[3]) - 0.5).abs() < 1e-6, "{skin:?}");
    }

    #[test]
    fn a_part_has_the_values_of_the_whole() {
        let shape = GridShape::new(5, 1, 1);
        let whole = Partition::new(
            shape,
            vec![
                row(&[-0.5, 0.5, 0.3, -0.5, -1.0]),
                OrganField { low: [2, 0, 0], shape: GridShape::new(3, 1, 1), values: vec![-0.2, 0.4, 0.2] },
            ],
            |_| false,
        );
        assert_eq!(whole.labels(), [OUTSIDE, 0, 0, 1, 1]);
        let part = whole.part([-1, 0, 0], GridShape::new(6, 1, 1));
        assert_eq!(part.labels(), [OUTSIDE, OUTSIDE, 0, 0, 1, 1]);
        assert_eq!(part.wall(3, 4), whole.wall(2, 3));
        let part = whole.part([1, 0, 0], GridShape::new(3, 1, 1));
        assert_eq!(part.labels(), [0, 0, 1]);
        assert_eq!(part.wall(1, 2), whole.wall(2, 3));
    }
}
