//! Published maps from CT numbers to density, by name.

/// A map from CT numbers to density.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DensityMap {
    /// Its name in scenes: lower case, words joined by `_`.
    pub name: &'static str,
    /// Points `[HU, kg/m^3]` by ascending HU; straight between them, constant beyond the ends.
    pub points: &'static [[f64; 2]],
    /// What to know before taking it.
    pub note: &'static str,
    /// Where it is from.
    pub source: &'static str,
}

/// All maps, by name.
pub fn density_maps() -> &'static [DensityMap] {
    MAPS
}

/// The map of a name, in any letter case.
pub fn density_map(name: &str) -> Option<&'static DensityMap> {
    MAPS.iter().find(|map| map.name.eq_ignore_ascii_case(name))
}

const MAPS: &[DensityMap] = &[DensityMap {
    name: "schneider_2000",
    // The ends of its straight pieces, in g/cm3 per HU/1000: air to fat, 1.018 + 0.893 H up to 14 HU, 1.03 up to 23 HU,
    // 1.003 + 1.169 H up to 100 HU, 1.017 + 0.592 H above, up to the densest bone it was made for.
    points: &[
        [-1000.0, 1.21],
        [-98.0, 930.486],
        [14.0, 1030.0],
        [23.0, 1030.0],
        [100.0, 1119.9],
        [101.0, 1076.792],
        [1600.0, 1964.2],
    ],
    note: "For CT without contrast medium: iodine raises the CT number and not the density, so a liver at 110 HU is no bone. \
           Soft tissue and the mixtures of marrow and bone lie on two lines that do not meet at 100 HU, hence the step down \
           there. Scanners differ by a few per cent; metal lies beyond the end.",
    source: "W. Schneider, Bortfeld and Schlegel, Correlation between CT numbers and tissue parameters needed for Monte Carlo \
             simulations of clinical dose distributions, Phys. Med. Biol. 45 (2000) 459, Eqs. (19), (21) and (23)",
}];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::library::tissue;

    #[test]
    fn points_ascend_and_are_densities() {
        for map in density_maps() {
            assert!(map.points.windows(2).all(|pair| pair[0][0] < pair[1][0]), "{}", map.name);
            assert!(map.points.iter().all(|point| point[1] > 0.0 && point[1] < 8000.0), "{}", map.name);
            assert!(map.source.contains("(20") || map.source.contains("(19"), "{}", map.name);
            assert_eq!(density_map(&map.name.to_uppercase()), Some(map));
        }
        assert_eq!(density_map("schneider"), None);
    }

    /// CT numbers of tissues without contrast medium, as textbooks give them, against densities of the library.
    #[test]
    fn tissues_come_out_as_the_library_has_them() {
        let map = crate::scene::resolved::Property::FromHu(density_map("schneider_2000").unwrap().points.to_vec());
        for (hu, name) in [(-90.0, "fat"), (55.0, "liver"), (50.0, "muscle"), (30.0, "kidney"), (1500.0, "bone")] {
            let (found, expected) = (map.at_hu(hu).unwrap(), tissue(name).unwrap().density);
            assert!((found / expected - 1.0).abs() < 0.03, "{name}: {found} at {hu} HU, {expected}");
        }
        // Lung at -740 HU holds a quarter of tissue.
        assert!((map.at_hu(-740.0).unwrap() - 269.0).abs() < 5.0);
    }
}
