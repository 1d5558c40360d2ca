//! Colour maps: values from 0 to 1 to linear RGB.

/// A colour map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Colormap {
    /// Black to white.
    Grey,
    /// Placeholder until merge.
    Viridis,
}

impl Colormap {
    /// Linear RGB.
    pub fn rgb(self, t: f32) -> [f32; 3] {
        [t.clamp(0.0, 1.0); 3]
    }
}

impl std::fmt::Display for Colormap {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(if *self == Self::Grey { "grey" } else { "viridis" })
    }
}

impl std::str::FromStr for Colormap {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "grey" => Ok(Self::Grey),
            "viridis" => Ok(Self::Viridis),
            _ => Err(format!("no {text}")),
        }
    }
}

/// sRGB decoded.
pub fn srgb8_to_linear(byte: u8) -> f32 {
    let value = f64::from(byte) / 255.0;
    (if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }) as f32
}
