//! From CT numbers to the colours of tissue: a transfer function per organ.
//!
//! ```text
//!  HU   ... air ... fat | low                 middle               high | ... bone ...
//!  look   dark   yellow | darker than the     the organ's colour   its  | ivory
//!                       | organ               at its median        highlight (vessels, cortex)
//! ```
//! Between `low` and `high`, the window, an organ runs through three shades. Where a scene gives no window, it follows from
//! the organ's own voxels: their median and their spread, so that a CT with and one without contrast agent both use the
//! colours, and the noise of the scanner stays a fraction of the range. Colours are joined straight in Oklab (Ottosson, A
//! perceptual color space for image processing, 2020), where equal steps look equal.

use crate::geometry::{Matrix3, Vector3};

use super::colormap::srgb8_to_linear;

/// Colours along CT numbers, straight between the points in Oklab and constant beyond the ends.
#[derive(Debug, Clone, PartialEq)]
pub struct TransferFunction {
    /// CT number \[HU\], ascending, and Oklab colour.
    points: Vec<(f32, Vector3)>,
}

impl TransferFunction {
    /// From CT numbers \[HU\] and linear RGB colours in 0..=1, in any order; of equal CT numbers the first counts.
    ///
    /// # Panics
    /// If there is no point or a CT number is not finite (scenes are checked before).
    pub fn new(points: &[(f32, [f32; 3])]) -> Self {
        assert!(!points.is_empty() && points.iter().all(|(hu, _)| hu.is_finite()), "finite points");
        let mut points: Vec<(f32, Vector3)> = points.iter().map(|&(hu, color)| (hu, to_oklab(color))).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points.dedup_by_key(|point| point.0);
        Self { points }
    }

    /// Linear RGB in 0..=1 of a CT number \[HU\]; NaN counts as the lowest.
    pub fn rgb(&self, hu: f32) -> [f32; 3] {
        let next = self.points.partition_point(|point| point.0 < hu);
        let color = match (next.checked_sub(1).map(|last| self.points[last]), self.points.get(next)) {
            (Some((below, from)), Some(&(above, to))) => {
                from.lerp(&to, (f64::from(hu) - f64::from(below)) / (f64::from(above) - f64::from(below)))
            }
            (Some((_, end)), None) => end,
            (None, _) => self.points[0].1,
        };
        to_linear(color)
    }
}

/// Where the CT numbers of an organ lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HuSpread {
    /// Median \[HU\].
    pub median: f32,
    /// Standard deviation of a normal distribution with the same quartiles \[HU\]: what lies far out does not count.
    pub deviation: f32,
}

impl HuSpread {
    /// Of some values \[HU\]; those that are not finite do not count. `None` when none is left.
    pub fn of(values: impl IntoIterator<Item = f32>) -> Option<Self> {
        let mut values: Vec<f32> = values.into_iter().filter(|value| value.is_finite()).collect();
        let last = values.len().checked_sub(1)?;
        let mut quantile = |quarter: usize| *values.select_nth_unstable_by(last * quarter / 4, f32::total_cmp).1;
        let [low, median, high] = [1, 2, 3].map(&mut quantile);
        // Quartiles of a normal distribution lie 0.6745 standard deviations from its median.
        Some(Self { median, deviation: (high - low) / (2.0 * 0.6745) })
    }
}

/// Darker than the organ, by this factor of Oklab lightness.
const LOW_LIGHTNESS: f64 = 0.55;
/// The window reaches from so many deviations below the median to so many above.
const WINDOW: [f32; 2] = [3.0, 4.5];
/// Deviations that a default window takes at least and at most \[HU\]. Below, the noise of a good scanner would fill it;
/// above lie organs with contents of every kind, such as bowel with gas.
const DEVIATION: [f32; 2] = [9.0, 40.0];
/// The same for bone and lung, whose CT numbers are wide for good reason.
const WIDE_DEVIATION: [f32; 2] = [30.0, 150.0];

/// A tissue: part of its name, colour of what is brighter in a CT than the rest of it, and whether its values are wide.
struct Highlight {
    part: &'static str,
    srgb: [u8; 3],
    wide: bool,
}

const fn highlight(part: &'static str, srgb: [u8; 3], wide: bool) -> Highlight {
    Highlight { part, srgb, wide }
}

/// The first match counts. Vessels are brighter than liver and kidney once they carry contrast agent; in lung they are
/// the only thing brighter than air, and red.
const HIGHLIGHTS: [Highlight; 16] = [
    highlight("gallbladder", [0xb8, 0xc8, 0x70], false),
    highlight("liver", [0xf2, 0xb4, 0x9c], false),
    highlight("kidney", [0xf0, 0xb4, 0xa0], false),
    highlight("spleen", [0xd9, 0x96, 0xa0], false),
    highlight("pancreas", [0xf7, 0xe0, 0xb8], false),
    highlight("lung", [0x8a, 0x2a, 0x2a], true),
    highlight("fat", [0xf4, 0xe8, 0xc4], false),
    highlight("muscle", [0xd9, 0x8c, 0x80], false),
    highlight("heart", [0xf0, 0xa8, 0x98], false),
    highlight("vessel", [0xe8, 0xa0, 0x90], false),
    highlight("aorta", [0xf0, 0xb0, 0x9c], false),
    highlight("rib", [0xff, 0xfa, 0xee], true),
    highlight("spine", [0xff, 0xfa, 0xee], true),
    highlight("vertebra", [0xff, 0xfa, 0xee], true),
    highlight("bone", [0xff, 0xfa, 0xee], true),
    highlight("femur", [0xff, 0xfa, 0xee], true),
];
/// The highlight of tissues without a name of theirs.
const PALE: [u8; 3] = [0xf2, 0xe6, 0xdc];

const AIR: (f32, [u8; 3]) = (-300.0, [0x1c, 0x12, 0x12]);
const FAT: (f32, [u8; 3]) = (-100.0, [0xe3, 0xc8, 0x78]);
const BONE: (f32, [u8; 3]) = (400.0, [0xf0, 0xe6, 0xcc]);
/// A fixed tissue is left out when it is nearer to the window than this \[HU\].
const GAP: f32 = 30.0;

/// The window that suits an organ \[HU\].
pub fn window_of(name: &str, spread: HuSpread) -> [f32; 2] {
    let [least, most] = if highlight_of(name).is_some_and(|h| h.wide) { WIDE_DEVIATION } else { DEVIATION };
    let deviation = spread.deviation.clamp(least, most);
    [spread.median - WINDOW[0] * deviation, spread.median + WINDOW[1] * deviation]
}

/// How much of the contrast of the CT the skin of an organ shows: it is seen through a capsule of its own colour.
const CAPSULE_CONTRAST: f32 = 0.35;

/// The skin of an organ: CT numbers as they look through its capsule.
///
/// Bare, the noise of the scanner would mottle the skin, and a border drawn half a voxel too far out would let fat and air
/// shine through.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Capsule {
    /// Median of the organ \[HU\].
    pub median: f32,
    /// What the organ itself has \[HU\]: beyond is something else.
    pub window: [f32; 2],
}

impl Capsule {
    /// The CT number whose colour stands for `hu` on the skin \[HU\].
    pub fn hu(self, hu: f32) -> f32 {
        let [low, high] = self.window;
        (self.median + CAPSULE_CONTRAST * (hu.clamp(low, high) - self.median)).clamp(low, high)
    }
}

/// The colours of an organ over a window.
///
/// - `color`: its own, linear RGB in 0..=1, taken two fifths of the way up the window (at the median of a default one).
/// - `window` \[HU\]: lowest and highest CT number.
pub fn tissue_colors(name: &str, color: [f32; 3], window: [f32; 2]) -> TransferFunction {
    let [low, high] = window;
    let middle = low + (high - low) * WINDOW[0] / (WINDOW[0] + WINDOW[1]);
    let lab = to_oklab(color);
    let dark = to_linear(lab * LOW_LIGHTNESS);
    let bright = highlight_of(name).map_or(PALE, |h| h.srgb).map(srgb8_to_linear);
    let mut points = vec![(low, dark), (middle, color), (high, bright)];
    let fixed = |(hu, srgb): (f32, [u8; 3])| (hu, srgb.map(srgb8_to_linear));
    points.extend([AIR, FAT].into_iter().filter(|tissue| tissue.0 < low - GAP).map(fixed));
    points.extend([BONE].into_iter().filter(|tissue| tissue.0 > high + GAP).map(fixed));
    TransferFunction::new(&points)
}

fn highlight_of(name: &str) -> Option<&'static Highlight> {
    let name = name.to_lowercase();
    HIGHLIGHTS.iter().find(|highlight| name.contains(highlight.part))
}

/// Rows of the two matrices of Oklab, for linear sRGB: to cone responses, and from their cube roots to L, a, b.
const CONES: [[f64; 3]; 3] = [
    [0.412_221_470_8, 0.536_332_536_3, 0.051_445_992_9],
    [0.211_903_498_2, 0.680_699_545_1, 0.107_396_956_6],
    [0.088_302_461_9, 0.281_718_837_6, 0.629_978_700_5],
];
const LAB: [[f64; 3]; 3] = [
    [0.210_454_255_3, 0.793_617_785_0, -0.004_072_046_8],
    [1.977_998_495_1, -2.428_592_205_0, 0.450_593_709_9],
    [0.025_904_037_1, 0.782_771_766_2, -0.808_675_766_0],
];
const FROM_LAB: [[f64; 3]; 3] = [
    [1.0, 0.396_337_777_4, 0.215_803_757_3],
    [1.0, -0.105_561_345_8, -0.063_854_172_8],
    [1.0, -0.089_484_177_5, -1.291_485_548_0],
];
const FROM_CONES: [[f64; 3]; 3] = [
    [4.076_741_662_1, -3.307_711_591_3, 0.230_969_929_2],
    [-1.268_438_004_6, 2.609_757_401_1, -0.341_319_396_5],
    [-0.004_196_086_3, -0.703_418_614_7, 1.707_614_701_0],
];

fn matrix(rows: &[[f64; 3]; 3]) -> Matrix3 {
    Matrix3::from_fn(|row, column| rows[row][column])
}

fn to_oklab(color: [f32; 3]) -> Vector3 {
    matrix(&LAB) * (matrix(&CONES) * Vector3::from(color.map(f64::from))).map(f64::cbrt)
}

fn to_linear(lab: Vector3) -> [f32; 3] {
    let rgb = matrix(&FROM_CONES) * (matrix(&FROM_LAB) * lab).map(|cone| cone.powi(3));
    // Mixtures of two colours may leave the screen's range by a little.
    [0, 1, 2].map(|channel| rgb[channel].clamp(0.0, 1.0) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn oklab_of_known_colours_and_back() {
        for (rgb, lab) in [([1.0, 1.0, 1.0], [1.0, 0.0, 0.0]), ([1.0, 0.0, 0.0], [0.628, 0.225, 0.126])] {
            assert!((to_oklab(rgb) - Vector3::from(lab)).norm() < 1e-3, "{rgb:?}");
        }
        for rgb in [[0.0, 0.0, 0.0], [0.3, 0.01, 0.9], [1.0, 1.0, 1.0], [0.2, 0.5, 0.1]] {
            let back = to_linear(to_oklab(rgb));
            assert!(rgb.iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-5), "{rgb:?} {back:?}");
        }
    }

    #[test]
    fn quartiles_tell_the_spread_and_outliers_do_not() {
        let values = (0..1001).map(|n| n as f32 / 10.0).chain([f32::NAN, f32::INFINITY]);
        let spread = HuSpread::of(values).unwrap();
        assert_eq!(spread.median, 50.0);
        assert!((spread.deviation - 50.0 / 1.349).abs() < 0.01, "{spread:?}");
        assert_eq!(HuSpread::of([f32::NAN]), None);
        assert_eq!(HuSpread::of([7.0]), Some(HuSpread { median: 7.0, deviation: 0.0 }));
    }
}
