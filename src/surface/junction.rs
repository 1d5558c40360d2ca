//! Vertices inside a face: where a blade ended (crack front) and where a cut meets the skin (rim).
//!
//! Both lie where nothing else in their face can cross the way to them, so that a clean blade leaves clean lips.

use super::marching_cubes::face::Face;
use super::marching_cubes::sweep::CLEARANCE;

/// How far each lip of a cut stands back from the blade, as a fraction of its spring. At rest the two lips would otherwise
/// coincide, and readers that weld vertices by place would close the cut.
pub(crate) const LIP_SHIFT: f32 = 0.001;

/// Where a crack front lies behind its edge, as a fraction of the face: by the number of dead diagonals, since the blade
/// has passed each diagonal it severed.
pub(crate) const FRONT_DEPTH: [f32; 3] = [0.3, 0.5, 0.7];

/// A crack front as a combination of the corners of its face that hold together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FrontPlace {
    /// Particles; one of weight zero where only three hold together.
    pub(crate) particles: [u32; 4],
    /// Weights, not negative, of sum 1.
    pub(crate) weights: [f32; 4],
}

/// A rim in the coordinates of its corner: along the cut edge, then along the edge to the outside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RimPlace {
    /// End of the seam edge it belongs to: 0 lower, 1 upper.
    pub(crate) end: u8,
    /// Axis of the edge to the outside, and whether the outside lies upward.
    pub(crate) skin_axis: u8,
    /// True when the outside end is the upper one.
    pub(crate) skin_upward: bool,
    /// Fractions of the cut edge and of the edge to the outside, from the corner.
    pub(crate) at: [f32; 2],
}

/// A crack front behind ring edge `m`, the blade at the fraction `at` of it from ring corner `m`.
pub(crate) fn front_place(face: Face, particles: [Option<u32>; 4], m: usize, at: f32) -> FrontPlace {
    let component = face.components();
    let joined = |corner: usize| component[corner % 4] == component[m];
    let alone = face.inside == 0b1111 && face.cut.count_ones() == 1;
    // Elsewhere in this face another crack or the skin may come close: within the triangle of the edge and the middle
    // of the face none of them can cross the way from the edge to the front.
    let (depth, margin) = if alone {
        (FRONT_DEPTH[2 - (face.diagonals & 0b11).count_ones() as usize], 0.1)
    } else {
        (FRONT_DEPTH[0], FRONT_DEPTH[0] + 0.05)
    };
    let u = at.clamp(margin, 1.0 - margin);
    // Weights of the ring corners m, m + 1, m + 2, m + 3, at (0, 0), (1, 0), (1, 1), (0, 1).
    let weights = match (joined(m + 2), joined(m + 3)) {
        (true, true) => [(1.0 - u) * (1.0 - depth), u * (1.0 - depth), u * depth, (1.0 - u) * depth],
        (true, false) => [1.0 - u, u - depth, depth, 0.0],
        _ => [1.0 - u - depth, u, 0.0, depth],
    };
    let own = particles[m].unwrap_or(0);
    FrontPlace { particles: [0, 1, 2, 3].map(|step| particles[(m + step) % 4].unwrap_or(own)), weights }
}

/// What a rim must not run into at the corner opposite its own.
pub(crate) enum Beyond {
    /// That corner is outside.
    Nothing,
    /// Tissue with contours of its own round that corner.
    Corner,
    /// A sheet from the other lip to the edge facing the cut edge, which it meets at this fraction from the rim's side.
    Sheet(f32),
}

/// Place of a rim, as fractions of the cut edge and of the edge to the outside from their corner: where blade and skin would meet,
/// drawn back towards the straight way between lip and skin as far as needed to stay clear of what lies beyond.
pub(crate) fn rim_at(lips: [f32; 2], end: u8, skin: f32, slope: f32, beyond: Beyond) -> [f32; 2] {
    let (lip, other) = (lips[usize::from(end)], 1.0 - lips[usize::from(end ^ 1)]);
    // Distance of the blade from this corner at the height of the skin. Where it has passed the corner's own edge by then, the rim
    // lies where it does so; where it has passed the far edge, the skin ends there.
    let slope = if end == 0 { slope } else { -slope };
    let mut meeting = (lip + slope * skin).min(1.0 - CLEARANCE - 2.0 * LIP_SHIFT);
    let mut skin = skin;
    if meeting < CLEARANCE {
        skin = ((CLEARANCE - lip) / slope).clamp(CLEARANCE.min(skin), skin);
        meeting = CLEARANCE;
    }
    // A line the rim stays on the near side of: through (from, 0) and (to, 1).
    let (from, to) = match beyond {
        Beyond::Nothing => return [meeting, skin],
        Beyond::Corner => (1.0, 0.0),
        Beyond::Sheet(to) => (other, to),
    };
    let distance = |x: f32, y: f32| x - (from + y * (to - from));
    let (middle, full) = (distance(lip / 2.0, skin / 2.0), distance(meeting, skin));
    let reach = if full <= middle / 2.0 { 1.0 } else { (-middle / 2.0) / (full - middle) };
    let reach = reach.clamp(0.0, 1.0);
    [lip / 2.0 + reach * (meeting - lip / 2.0), skin * (0.5 + 0.5 * reach)]
}
