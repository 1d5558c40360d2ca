//! Colours of organs: from sRGB as users write it to the linear RGB that surfaces carry.

/// Colours for organs whose name says nothing: muted, of similar lightness, and apart from each other in hue.
const PALETTE: [&str; 8] = ["#b5654a", "#7d9c6b", "#6b8fb3", "#c9a558", "#96709e", "#5f9e9a", "#b57a8e", "#8a8a6f"];

/// Parts of names, with the colour of that tissue. The first match counts.
const BY_NAME: [(&str, &str); 22] = [
    ("gallbladder", "#5f7f3f"),
    ("urinary_bladder", "#d2a679"),
    ("liver", "#8c3b2e"),
    ("kidney", "#a0524a"),
    ("spleen", "#7a3a4a"),
    ("pancreas", "#d8a878"),
    ("stomach", "#d09a8a"),
    ("colon", "#c58f7a"),
    ("bowel", "#cf9f86"),
    ("heart", "#a8322f"),
    ("lung", "#d9a5a0"),
    ("aorta", "#c03a32"),
    ("vein", "#4a5f9a"),
    ("vena", "#4a5f9a"),
    ("vessel", "#7a4060"),
    ("rib", "#e6dcc3"),
    ("spine", "#e6dcc3"),
    ("vertebra", "#e6dcc3"),
    ("bone", "#e6dcc3"),
    ("fat", "#e3c878"),
    ("skin", "#d9a98c"),
    ("muscle", "#94453f"),
];

/// Reads `#rrggbb` (sRGB) as linear RGB in 0..=1.
pub(crate) fn parse(text: &str) -> Option<[f32; 3]> {
    let digits = text.strip_prefix('#')?;
    if digits.len() != 6 || !digits.bytes().all(|digit| digit.is_ascii_hexdigit()) {
        return None;
    }
    let bits = u32::from_str_radix(digits, 16).ok()?;
    Some([bits >> 16, bits >> 8, bits].map(|byte| linear((byte & 0xff) as u8)))
}

/// The colour of an organ that gives none: by its name, else by its place in the list.
pub(super) fn default_for(name: &str, index: usize) -> [f32; 3] {
    let name = name.to_lowercase();
    let by_name = BY_NAME.iter().find(|(part, _)| name.contains(part)).map(|&(_, color)| color);
    parse(by_name.unwrap_or(PALETTE[index % PALETTE.len()])).unwrap_or([0.5; 3])
}

/// The transfer function of IEC 61966-2-1 (sRGB), decoded.
pub(crate) fn linear(byte: u8) -> f32 {
    let value = f64::from(byte) / 255.0;
    let linear = if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) };
    linear as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_is_decoded() {
        assert_eq!(parse("#000000"), Some([0.0; 3]));
        assert_eq!(parse("#ffFFff"), Some([1.0; 3]));
        let [red, green, blue] = parse("#80bc0a").unwrap();
        // 128, 188 and 10 of 255, decoded by hand; the last lies on the straight part.
        for (got, expected) in [(red, 0.215_860_5), (green, 0.502_886_5), (blue, 10.0 / 255.0 / 12.92)] {
            assert!((got - expected).abs() < 1e-6, "{got} {expected}");
        }
        for bad in ["8c3b2e", "#8c3b2", "#8c3b2ef", "#+c3b2e", "red", "#8ç3b2"] {
            assert_eq!(parse(bad), None, "{bad}");
        }
    }

    #[test]
    fn every_default_is_a_colour() {
        for color in PALETTE.iter().chain(BY_NAME.iter().map(|(_, color)| color)) {
            assert!(parse(color).is_some(), "{color}");
        }
        assert_eq!(default_for("Liver_left", 3), parse("#8c3b2e").unwrap());
        assert_ne!(default_for("a", 0), default_for("a", 1));
        assert_eq!(default_for("a", 0), default_for("a", 8));
    }
}
