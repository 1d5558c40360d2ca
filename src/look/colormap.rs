//! Colour maps: from a value in 0..=1 to linear RGB, and the sRGB transfer function.
//!
//! | map | for | source |
//! |---|---|---|
//! | `grey` | anything, in print | even steps of sRGB |
//! | `viridis`, `inferno` | amounts from nothing upwards | Smith and van der Walt, matplotlib (2015), CC0 |
//! | `coolwarm` | values on both sides of a middle | Moreland, *Diverging color maps for scientific visualization* (2009) |
//!
//! Equal steps of value look like equal steps of colour, whatever map is chosen. Labels have no order: [`label_color`].

use std::fmt;
use std::str::FromStr;

/// The colour of what is not a number: magenta, which no map holds.
pub const NAN_COLOR: [f32; 3] = [1.0, 0.0, 1.0];

/// `0xrrggbb` (sRGB) at even steps; straight between them within 2 of 255 of the original's 256 colours.
const VIRIDIS: [u32; 33] = [
    0x440154, 0x470d60, 0x48186a, 0x482374, 0x472d7b, 0x453681, 0x424086, 0x3f4989, 0x3b528b, 0x375a8d, 0x33638d,
    0x2f6a8e, 0x2c728e, 0x297a8e, 0x26818e, 0x23898e, 0x21908c, 0x1f988b, 0x1f9f88, 0x21a685, 0x28ae80, 0x31b57b,
    0x3ebc74, 0x4cc26c, 0x5dc963, 0x6ece58, 0x82d34c, 0x96d83f, 0xabdc32, 0xc0df24, 0xd5e21a, 0xeae51a, 0xfde725,
];
/// As [`VIRIDIS`].
const INFERNO: [u32; 33] = [
    0x000004, 0x040312, 0x0b0724, 0x150b37, 0x210c4a, 0x2e0a5a, 0x3c0965, 0x4a0c6b, 0x57106d, 0x63146e, 0x70196e,
    0x7d1e6d, 0x89226a, 0x962766, 0xa32b61, 0xaf315c, 0xbb3755, 0xc63e4d, 0xd14644, 0xdb4f3b, 0xe35932, 0xeb6528,
    0xf1711e, 0xf67f14, 0xf98d0a, 0xfb9c06, 0xfcab0f, 0xfbba1f, 0xf9ca32, 0xf5d949, 0xf2e865, 0xf3f586, 0xfcffa4,
];
/// Ends of `coolwarm` (sRGB), section 3.3 of the paper.
const COOL: u32 = 0x3b_4c_c0;
const WARM: u32 = 0xb4_04_26;

/// A colour map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Colormap {
    /// Black to white, by even steps of sRGB.
    Grey,
    /// Dark blue over green to yellow.
    #[default]
    Viridis,
    /// Black over red to pale yellow.
    Inferno,
    /// Blue over light grey to red.
    CoolWarm,
}

impl Colormap {
    /// Every map.
    pub const ALL: [Self; 4] = [Self::Grey, Self::Viridis, Self::Inferno, Self::CoolWarm];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Grey => "grey",
            Self::Viridis => "viridis",
            Self::Inferno => "inferno",
            Self::CoolWarm => "coolwarm",
        }
    }

    /// Linear RGB in 0..=1 of a value; values beyond 0..=1 take the end's colour, NaN is [`NAN_COLOR`].
    pub fn rgb(self, t: f32) -> [f32; 3] {
        if t.is_nan() {
            return NAN_COLOR;
        }
        let t = f64::from(t.clamp(0.0, 1.0));
        match self {
            Self::Grey => [decoded(t) as f32; 3],
            Self::Viridis => between(&VIRIDIS, t),
            Self::Inferno => between(&INFERNO, t),
            Self::CoolWarm => cool_warm(t),
        }
    }
}

impl fmt::Display for Colormap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A name that no colour map has.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("no colour map is called `{found}`; there are {}", Colormap::ALL.map(Colormap::name).join(", "))]
pub struct UnknownColormap {
    /// The name.
    pub found: String,
}

impl FromStr for Colormap {
    type Err = UnknownColormap;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        let known = Self::ALL.into_iter().find(|map| map.name() == name);
        known.ok_or_else(|| UnknownColormap { found: name.to_owned() })
    }
}

/// The colour of a label, linear RGB in 0..=1: hues of successive labels lie far apart, and a label always has the same.
pub fn label_color(label: u16) -> [f32; 3] {
    // Multiples of the golden ratio spread over the circle evenly, however many there are.
    let hue = (f64::from(label) * 0.618_033_988_75).fract() * 6.0;
    let channel = |shift: f64| {
        let distance = ((hue + shift).rem_euclid(6.0) - 3.0).abs() - 1.0;
        (0.15 + 0.7 * distance.clamp(0.0, 1.0)) as f32
    };
    [channel(0.0), channel(4.0), channel(2.0)]
}

/// A part of a linear colour as sRGB (IEC 61966-2-1), rounded; beyond 0..=1 the nearest end, NaN is 0.
pub fn linear_to_srgb8(linear: f32) -> u8 {
    (255.0 * encoded(f64::from(linear))).round() as u8
}

/// A part of an sRGB colour (IEC 61966-2-1) as linear, in 0..=1.
pub fn srgb8_to_linear(byte: u8) -> f32 {
    decoded(f64::from(byte) / 255.0) as f32
}

fn encoded(linear: f64) -> f64 {
    let c = linear.clamp(0.0, 1.0);
    if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 }
}

fn decoded(srgb: f64) -> f64 {
    if srgb <= 0.04045 { srgb / 12.92 } else { ((srgb + 0.055) / 1.055).powf(2.4) }
}

/// Parts of `0xrrggbb` in 0..=1.
fn parts(hex: u32) -> [f64; 3] {
    [hex >> 16, hex >> 8, hex].map(|part| f64::from(part & 0xff) / 255.0)
}

/// Straight in sRGB between the entries of a table, as the maps are defined.
fn between(table: &[u32; 33], t: f64) -> [f32; 3] {
    let at = t * 32.0;
    let low = (at as usize).min(31);
    let (from, to, share) = (parts(table[low]), parts(table[low + 1]), at - low as f64);
    [0, 1, 2].map(|c| decoded(from[c] + share * (to[c] - from[c])) as f32)
}

/// Moreland's diverging map: both halves run straight in Msh, the polar form of CIE L*a*b*, to a common white of magnitude
/// 88, with the hue turned on the way so that saturation and lightness change evenly (section 3.2 and appendix A).
fn cool_warm(t: f64) -> [f32; 3] {
    let end = if t < 0.5 { COOL } else { WARM };
    let [magnitude, saturation, hue] = msh(parts(end).map(decoded));
    let white = WHITE.max(magnitude);
    let spin = hue_of_white(magnitude, saturation, hue, white);
    // 0 at the end, 1 at the white.
    let share = 1.0 - (2.0 * t - 1.0).abs();
    let mix = |from: f64, to: f64| from + share * (to - from);
    let rgb = from_msh([mix(magnitude, white), mix(saturation, 0.0), mix(hue, spin)]);
    rgb.map(|c| c.clamp(0.0, 1.0) as f32)
}

/// Magnitude of the white in the middle.
const WHITE: f64 = 88.0;

/// The hue with which a colour of this magnitude fades into an unsaturated one (appendix A, `AdjustHue`).
fn hue_of_white(magnitude: f64, saturation: f64, hue: f64, white: f64) -> f64 {
    if magnitude >= white - 0.1 {
        return hue;
    }
    let spin = saturation * (white * white - magnitude * magnitude).sqrt() / (magnitude * saturation.sin());
    // Away from purple.
    if hue > -std::f64::consts::FRAC_PI_3 { hue + spin } else { hue - spin }
}

/// Tristimulus values of the white of sRGB, D65.
const D65: [f64; 3] = [0.950_47, 1.0, 1.088_83];

/// Linear RGB to Msh, by CIE XYZ and L*a*b*.
fn msh([r, g, b]: [f64; 3]) -> [f64; 3] {
    let xyz = [
        0.412_456_4 * r + 0.357_576_1 * g + 0.180_437_5 * b,
        0.212_672_9 * r + 0.715_152_2 * g + 0.072_175_0 * b,
        0.019_333_9 * r + 0.119_192_0 * g + 0.950_304_1 * b,
    ];
    let f = |value: f64| if value > EPSILON { value.cbrt() } else { (KAPPA * value + 16.0) / 116.0 };
    let [x, y, z] = [0, 1, 2].map(|axis| f(xyz[axis] / D65[axis]));
    let (lightness, a, b) = (116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z));
    let magnitude = (lightness * lightness + a * a + b * b).sqrt();
    // Black has no direction; its saturation does not matter.
    [magnitude, (lightness / magnitude.max(f64::MIN_POSITIVE)).acos(), b.atan2(a)]
}

/// Msh to linear RGB; parts may leave 0..=1.
fn from_msh([magnitude, saturation, hue]: [f64; 3]) -> [f64; 3] {
    let lightness = magnitude * saturation.cos();
    let (a, b) = (magnitude * saturation.sin() * hue.cos(), magnitude * saturation.sin() * hue.sin());
    let y = (lightness + 16.0) / 116.0;
    let f = |value: f64| if value.powi(3) > EPSILON { value.powi(3) } else { (116.0 * value - 16.0) / KAPPA };
    let [x, y, z] = [D65[0] * f(y + a / 500.0), D65[1] * f(y), D65[2] * f(y - b / 200.0)];
    [
        3.240_454_2 * x - 1.537_138_5 * y - 0.498_531_4 * z,
        -0.969_266_0 * x + 1.876_010_8 * y + 0.041_556_0 * z,
        0.055_643_4 * x - 0.204_025_9 * y + 1.057_225_2 * z,
    ]
}

/// Where the cube root of L*a*b* gives way to a straight line (CIE 15).
const EPSILON: f64 = 216.0 / 24389.0;
const KAPPA: f64 = 24389.0 / 27.0;

#[cfg(test)]
mod tests {
    use super::*;

    fn srgb(map: Colormap, t: f32) -> [u8; 3] {
        map.rgb(t).map(linear_to_srgb8)
    }

    /// L* of CIE L*a*b*.
    fn lightness(rgb: [f32; 3]) -> f64 {
        let [magnitude, saturation, _] = msh(rgb.map(f64::from));
        magnitude * saturation.cos()
    }

    #[test]
    fn maps_have_the_published_colours() {
        // matplotlib 3.10, entries 0, 37, 100, 200 and 255 of 256.
        let viridis = [[68, 1, 84], [70, 51, 127], [42, 118, 142], [112, 207, 87], [253, 231, 37]];
        let inferno = [[0, 0, 4], [41, 11, 85], [144, 37, 104], [251, 157, 7], [252, 255, 164]];
        for (map, expected) in [(Colormap::Viridis, viridis), (Colormap::Inferno, inferno)] {
            for (at, expected) in [0.0, 37.0, 100.0, 200.0, 255.0].into_iter().zip(expected) {
                let found = srgb(map, at / 255.0);
                assert!((0..3).all(|c| found[c].abs_diff(expected[c]) <= 2), "{map} {at}: {found:?} {expected:?}");
            }
        }
        // The paper's table of 33 colours, its first, ninth, middle and last.
        for (t, expected) in
            [(0.0, [59, 76, 192]), (0.25, [141, 176, 254]), (0.5, [221, 221, 221]), (1.0, [180, 4, 38])]
        {
            let found = srgb(Colormap::CoolWarm, t);
            assert!((0..3).all(|c| found[c].abs_diff(expected[c]) <= 1), "{t}: {found:?} {expected:?}");
        }
        assert_eq!(srgb(Colormap::Grey, 0.5), [128; 3]);
    }

    #[test]
    fn lightness_rises_evenly_or_to_the_middle() {
        for map in Colormap::ALL {
            let light: Vec<f64> = (0..=100).map(|at| lightness(map.rgb(at as f32 / 100.0))).collect();
            for (at, pair) in light.windows(2).enumerate() {
                let rises = map != Colormap::CoolWarm || at < 50;
                assert!((pair[1] > pair[0]) == rises, "{map} at {at} %: {pair:?}");
            }
        }
    }

    #[test]
    fn values_beyond_are_held_and_no_number_is_magenta() {
        for map in Colormap::ALL {
            assert_eq!(map.rgb(-3.0), map.rgb(0.0));
            assert_eq!(map.rgb(f32::INFINITY), map.rgb(1.0));
            assert_eq!(map.rgb(f32::NAN), NAN_COLOR);
            let inside = |t: f32| map.rgb(t).iter().all(|part| (0.0..=1.0).contains(part));
            assert!((0..=1000).all(|at| inside(at as f32 / 1000.0)), "{map}");
            assert_eq!(map.name().parse(), Ok(map));
        }
        let message = "jet".parse::<Colormap>().unwrap_err().to_string();
        assert!(message.contains("`jet`") && message.contains("viridis, inferno"), "{message}");
    }

    #[test]
    fn srgb_goes_and_comes_back() {
        assert!((0..=255).all(|byte| linear_to_srgb8(srgb8_to_linear(byte)) == byte));
        // 128 of 255, decoded by hand.
        assert!((srgb8_to_linear(128) - 0.215_860_5).abs() < 1e-6);
        assert_eq!([-1.0, 2.0, f32::NAN].map(linear_to_srgb8), [0, 255, 0]);
    }

    #[test]
    fn neighbouring_labels_differ() {
        for label in 0..500 {
            let (a, b) = (label_color(label), label_color(label + 1));
            assert!((0..3).map(|c| (a[c] - b[c]).abs()).sum::<f32>() > 0.3, "{label}: {a:?} {b:?}");
        }
    }
}
