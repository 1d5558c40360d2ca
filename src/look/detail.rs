//! Fine detail that no CT resolves: lobules, fibres, mottle. Decoration, not data, and off unless asked for.
//!
//! A value is a function of the rest place alone, so detail moves with the tissue and is the same in every frame, at every
//! resolution and on both lips of a cut. What is finer than the vertices of a mesh can show is faded out rather than left to
//! turn into speckle: lobules need edges below a millimetre, mottle shows at 3 mm.
//!
//! Sources: cells after Worley, A cellular texture basis function, SIGGRAPH 1996; value noise with the fade of Perlin,
//! Improving noise, SIGGRAPH 2002. Lobules of the human liver are one to two millimetres across.

use crate::geometry::{Point3, Vector3};
use crate::phantom::noise::bits_at;

/// Largest change of linear colour at full strength, relative.
pub const AMPLITUDE: f32 = 0.12;

/// What the tissue is made of at its finest.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Grain {
    /// Cells with pale borders, so far apart \[mm\].
    Lobules(f64),
    /// Strands along the body's axis, so thick \[mm\] and ten times as long.
    Fibres(f64),
    /// Even noise of this size \[mm\].
    Mottle(f64),
}

/// Procedural detail of a tissue.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detail {
    fine: Grain,
}

/// Parts of names, with what is fine in that tissue. The first match counts.
const BY_NAME: [(&str, Grain); 12] = [
    ("gallbladder", Grain::Mottle(1.5)),
    ("liver", Grain::Lobules(1.5)),
    ("pancreas", Grain::Lobules(3.0)),
    ("fat", Grain::Lobules(4.0)),
    ("lung", Grain::Lobules(4.0)),
    ("muscle", Grain::Fibres(0.8)),
    ("gluteus", Grain::Fibres(0.8)),
    ("iliopsoas", Grain::Fibres(0.8)),
    ("autochthon", Grain::Fibres(0.8)),
    ("heart", Grain::Fibres(0.8)),
    ("bone", Grain::Lobules(1.2)),
    ("vertebra", Grain::Lobules(1.2)),
];

/// What every tissue has besides.
const MOTTLE: Grain = Grain::Mottle(5.0);
/// A feature is left out when it is smaller than this many edges of the mesh, and whole from the second number on.
const EDGES_PER_FEATURE: [f64; 2] = [1.2, 2.5];
/// Streams of the noise.
const SEEDS: [u64; 2] = [0x6c69_7665_7231, 0x6d6f_7474_6c65];

impl Detail {
    /// What suits an organ of this name.
    pub fn of_organ(name: &str) -> Self {
        let name = name.to_lowercase();
        let found = BY_NAME.iter().find(|(part, _)| name.contains(part));
        Self { fine: found.map_or(Grain::Mottle(2.0), |&(_, grain)| grain) }
    }

    /// The detail at a rest place, RAS+ \[mm\]; -1 to 1.
    ///
    /// - `edge` \[mm\]: how far apart neighbouring samples are; what is finer than that is left out.
    pub fn at(&self, rest: Point3, edge: f64) -> f32 {
        let shown = |size: f64| {
            let [least, most] = EDGES_PER_FEATURE;
            fade(((size / edge - least) / (most - least)).clamp(0.0, 1.0))
        };
        let part = |grain: Grain, stream: usize| match shown(grain.size()) {
            0.0 => 0.0,
            shown => shown * grain.value(rest.coords, SEEDS[stream]),
        };
        (0.6 * part(self.fine, 0) + 0.4 * part(MOTTLE, 1)) as f32
    }
}

impl Grain {
    fn size(self) -> f64 {
        let (Self::Lobules(size) | Self::Fibres(size) | Self::Mottle(size)) = self;
        size
    }

    /// The value at a place \[mm\]; -1 to 1.
    fn value(self, place: Vector3, seed: u64) -> f64 {
        match self {
            Self::Lobules(size) => lobules(place / size, seed),
            Self::Fibres(size) => smooth_noise(place.component_div(&Vector3::new(size, size, 10.0 * size)), seed),
            Self::Mottle(size) => smooth_noise(place / size, seed),
        }
    }
}

/// Cells around jittered points: 1 on the wall between two cells, down to -1 inside.
fn lobules(place: Vector3, seed: u64) -> f64 {
    let low = place.map(|x| x.floor() as i64);
    let (mut nearest, mut second) = (f64::INFINITY, f64::INFINITY);
    for neighbour in 0..27_i64 {
        let cell = [low.x + neighbour % 3 - 1, low.y + neighbour / 3 % 3 - 1, low.z + neighbour / 9 - 1];
        let bits = bits_at(seed, cell);
        let jitter = |axis: u32| (bits >> (21 * axis) & 0x1f_ffff) as f64 / 2_097_152.0;
        let point = Vector3::from_fn(|axis, _| cell[axis] as f64 + jitter(axis as u32));
        let distance = (point - place).norm();
        (nearest, second) = (nearest.min(distance), second.min(distance.max(nearest)));
    }
    1.0 - 2.0 * ((second - nearest) / 0.35).min(1.0)
}

/// Values of grid points, -1 to 1, with a smooth passage between them.
fn smooth_noise(place: Vector3, seed: u64) -> f64 {
    let low = place.map(f64::floor);
    let share = (place - low).map(fade);
    let mut sum = 0.0;
    for corner in 0..8_usize {
        let upper = [corner & 1, corner >> 1 & 1, corner >> 2];
        let weight: f64 = (0..3).map(|axis| if upper[axis] == 1 { share[axis] } else { 1.0 - share[axis] }).product();
        let at = [0, 1, 2].map(|axis| low[axis] as i64 + upper[axis] as i64);
        sum += weight * ((bits_at(seed, at) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0);
    }
    sum
}

fn fade(t: f64) -> f64 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}
