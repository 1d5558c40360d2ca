//! One constant per spring in block order, for what judges a world from outside its step.

use crate::kernel::halo::{Halo, gather_rows};
use crate::lattice::layout::BlockLayout;
use crate::material::SpringConstants;

/// [`SpringConstants`] with per-particle and per-cell values moved to their slots.
#[derive(Debug, Clone)]
pub(super) enum SlotConstants {
    Uniform(f32),
    MeanOfEnds(Vec<f32>),
    SumOfCells { cell: Vec<f32>, weight: [f32; 3] },
}

impl SlotConstants {
    pub(super) fn new(layout: &BlockLayout, constants: &SpringConstants) -> Self {
        match constants {
            SpringConstants::Uniform(value) => Self::Uniform(*value),
            SpringConstants::MeanOfEnds(values) => Self::MeanOfEnds(to_slots(layout, values)),
            SpringConstants::SumOfCells { cell, weight } => {
                Self::SumOfCells { cell: to_slots(layout, cell), weight: *weight }
            }
        }
    }

    /// One value per slot; none of a uniform constant.
    pub(super) fn values(&self) -> &[f32] {
        match self {
            Self::Uniform(_) => &[],
            Self::MeanOfEnds(values) | Self::SumOfCells { cell: values, .. } => values,
        }
    }

    /// What a cell of value 1 gives to a spring of each family; `None` for means of ends.
    pub(super) fn weight(&self) -> Option<[f32; 3]> {
        match self {
            Self::SumOfCells { weight, .. } => Some(*weight),
            Self::Uniform(_) | Self::MeanOfEnds(_) => None,
        }
    }

    /// Copies some rows of what a block needs into a halo buffer, see [`gather_rows`].
    pub(super) fn gather(&self, neighbours: &[u32; 27], rows: u128, halo: &mut Halo) {
        match self {
            Self::Uniform(_) => {}
            Self::MeanOfEnds(values) | Self::SumOfCells { cell: values, .. } => {
                gather_rows(values, neighbours, rows, halo)
            }
        }
    }
}

/// Moves one value per particle to its slot; 0 elsewhere.
pub(super) fn to_slots(layout: &BlockLayout, values: &[f32]) -> Vec<f32> {
    let mut slots = vec![0.0; layout.slots()];
    for (&slot, &value) in layout.slot.iter().zip(values) {
        slots[slot as usize] = value;
    }
    slots
}

/// `values` over `of`, where that is the same number wherever `of` is above zero, and `values` are zero elsewhere.
pub(super) fn proportion(values: &[f32], of: &[f32]) -> Option<f32> {
    let (&value, &whole) = values.iter().zip(of).find(|(_, of)| **of > 0.0)?;
    let ratio = f64::from(value) / f64::from(whole);
    let same = |(&value, &of): (&f32, &f32)| {
        let expected = ratio * f64::from(of.max(0.0));
        (f64::from(value) - expected).abs() <= PROPORTION_ROUNDING * expected
    };
    values.iter().zip(of).all(same).then_some(ratio as f32)
}

/// Two quotients of numbers that were rounded to f32.
const PROPORTION_ROUNDING: f64 = 2.5e-7;

/// Calls a kernel with the law of a block, gathered before.
macro_rules! with_law {
    ($constants:expr, $halo:expr, |$law:ident| $call:expr) => {
        match $constants {
            SlotConstants::Uniform(value) => {
                let $law = crate::kernel::laws::Uniform { by_family: [*value; 3] };
                $call
            }
            SlotConstants::MeanOfEnds(_) => {
                let $law = crate::kernel::laws::MeanOfEnds { particle: $halo };
                $call
            }
            SlotConstants::SumOfCells { weight, .. } => {
                let $law = crate::kernel::laws::SumOfCells { cell: $halo, weight: *weight };
                $call
            }
        }
    };
}
pub(super) use with_law;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_proportion_is_one_number_for_all() {
        let of: Vec<f32> = (0..1000).map(|i| if i % 7 == 0 { 0.0 } else { 1e3 * (i as f32).sqrt() }).collect();
        let time = 3.7e-4;
        let mut values: Vec<f32> = of.iter().map(|&of| (f64::from(of) * time) as f32).collect();
        let found = proportion(&values, &of).unwrap();
        assert!((f64::from(found) / time - 1.0).abs() < 1e-6);
        values[500] *= 1.000_001;
        assert_eq!(proportion(&values, &of), None, "one is another");
        assert_eq!(proportion(&[1.0, 1.0], &[1.0, 0.0]), None, "something of nothing");
        assert_eq!(proportion(&[0.0, 2.0, 0.0], &[-5.0, 1.0, 0.0]), Some(2.0), "what is negative has none");
        assert_eq!(proportion(&[0.0], &[0.0]), None);
    }
}
