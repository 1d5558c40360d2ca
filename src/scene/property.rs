//! A property of an organ's material: the same everywhere, or different from voxel to voxel.

use std::path::PathBuf;

use serde::{Deserialize, Deserializer, Serialize};

/// The properties that may differ from voxel to voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PropertyKind {
    /// Young's modulus [Pa].
    YoungsModulus,
    /// Density [kg/m^3].
    Density,
}

impl PropertyKind {
    /// Both.
    pub const ALL: [Self; 2] = [Self::YoungsModulus, Self::Density];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::YoungsModulus => "Young's modulus",
            Self::Density => "density",
        }
    }

    /// Its name in the middle of a sentence that has said it in full.
    pub fn noun(self) -> &'static str {
        match self {
            Self::YoungsModulus => "modulus",
            Self::Density => "density",
        }
    }

    /// Its key in a scene.
    pub fn key(self) -> &'static str {
        match self {
            Self::YoungsModulus => "youngs_modulus",
            Self::Density => "density",
        }
    }

    /// The unit of its values, as messages write it.
    pub fn unit(self) -> &'static str {
        match self {
            Self::YoungsModulus => "Pa",
            Self::Density => "kg/m3",
        }
    }
}

/// A property of an organ, in the unit of its [`PropertyKind`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Property {
    /// The same everywhere.
    Constant(f64),
    /// From the CT number: points `[HU, value]` by ascending HU, at least two; straight between them, constant beyond the
    /// ends.
    FromHu(Vec<[f64; 2]>),
    /// From a volume of values on the grid of the image or labels.
    FromFile(PathBuf),
}

impl Property {
    /// The value of a voxel with this CT number; `None` when only a file knows. A CT number that is not a number counts as
    /// the lowest.
    pub fn at_hu(&self, hu: f64) -> Option<f64> {
        match self {
            Self::Constant(value) => Some(*value),
            Self::FromHu(points) => {
                // How many points lie below: the value is between the last of them and the next.
                let next = points.iter().take_while(|point| point[0] < hu).count();
                let Some(&[hu_above, above]) = points.get(next) else { return points.last().map(|point| point[1]) };
                let Some(&[hu_below, below]) = next.checked_sub(1).and_then(|last| points.get(last)) else {
                    return Some(above);
                };
                let t = (hu - hu_below) / (hu_above - hu_below);
                // Exact at both ends and between them in between.
                Some(below * (1.0 - t) + above * t)
            }
            Self::FromFile(_) => None,
        }
    }

    /// The value of every voxel; `None` where they differ.
    pub fn constant(&self) -> Option<f64> {
        match self {
            Self::Constant(value) => Some(*value),
            Self::FromHu(_) | Self::FromFile(_) => None,
        }
    }
}

/// Runs from before densities could vary have a number in their place.
#[derive(Deserialize)]
#[serde(untagged)]
enum Kept {
    Number(f64),
    Property(Property),
}

impl From<Kept> for Property {
    fn from(kept: Kept) -> Self {
        match kept {
            Kept::Number(value) => Self::Constant(value),
            Kept::Property(property) => property,
        }
    }
}

/// A property, or a bare number.
pub(super) fn kept<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Property, D::Error> {
    Kept::deserialize(deserializer).map(Property::from)
}

/// The same, or nothing.
pub(super) fn kept_or_none<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Property>, D::Error> {
    Option::<Kept>::deserialize(deserializer).map(|kept| kept.map(Property::from))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_is_straight_between_its_points_and_constant_beyond() {
        let map = Property::FromHu(vec![[-100.0, 2e3], [0.0, 5e3], [100.0, 2e4]]);
        let expected = [
            (-1e9, 2e3),
            (-100.0, 2e3),
            (-50.0, 3.5e3),
            (0.0, 5e3),
            (20.0, 8e3),
            (100.0, 2e4),
            (3e3, 2e4),
            (f64::NEG_INFINITY, 2e3),
            (f64::INFINITY, 2e4),
            (f64::NAN, 2e3),
        ];
        for (hu, value) in expected {
            assert_eq!(map.at_hu(hu), Some(value), "{hu} HU");
        }
        assert_eq!(map.constant(), None);
        assert_eq!(Property::Constant(7.0).at_hu(40.0), Some(7.0));
        assert_eq!(Property::Constant(7.0).constant(), Some(7.0));
        assert_eq!(Property::FromFile("e.nii".into()).at_hu(40.0), None);
    }

    proptest::proptest! {
        #[test]
        fn a_map_never_leaves_the_values_around(hu in -2e3..4e3, low in 1.0..1e6, high in 1.0..1e11) {
            let map = Property::FromHu(vec![[-1e3, low], [40.0, high], [41.0, low]]);
            let value = map.at_hu(hu).unwrap();
            let (least, most) = (low.min(high), low.max(high));
            proptest::prop_assert!(value >= least * (1.0 - 1e-15) && value <= most * (1.0 + 1e-15), "{}", value);
        }
    }
}
