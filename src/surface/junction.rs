//! Vertices inside a face: where a blade ended (crack front) and where a cut meets the skin (rim).
//!
//! Fronts lie where nothing else in their face can cross the way to them. Rims lie where blade and skin meet, in their face if that
//! is there, else near it: the skin goes on a little beyond the last inside point on either side of the blade. Only places are
//! chosen here; which vertices there are and how they are joined is decided before.

use super::marching_cubes::face::Face;
use super::marching_cubes::sweep::CLEARANCE;
use super::seam::point_of_key;
use crate::geometry::GridShape;

/// How far each lip of a cut stands back from the blade, as a fraction of its spring. At rest the two lips would otherwise
/// coincide, and readers that weld vertices by place would close the cut.
pub(crate) const LIP_SHIFT: f32 = 0.001;

/// Places on a blade are kept this far from other places, and lips this far from the ends of their edge [pitches]. As far as crossings
/// of the skin are, they would lie off the blade by so much that the two faces of a cut pass through each other.
pub(crate) const LIP_CLEARANCE: f32 = 0.002;

/// The least distance of a rim from the edge to the outside of its corner [pitches]: less than that of any lip, roundings included.
const BESIDE: f32 = LIP_CLEARANCE / 2.0;

/// Where a crack front lies behind its edge, as a fraction of the face: by the number of dead diagonals, since the blade
/// has passed each diagonal it severed.
pub(crate) const FRONT_DEPTH: [f32; 3] = [0.3, 0.5, 0.7];

/// How far from a known place of the skin blade and skin may meet [pitches]: the skin goes on a little beyond the last particle on its side of the
/// blade, but how is not known for long.
const FARTHEST: f32 = 1.5;

/// How far apart the two sides of a blade may lie where they run along each other [pitches].
const ALONGSIDE: f32 = 10.0 * LIP_SHIFT;

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
    /// Steps along the cut edge, along the edge to the outside, and up along the third axis, from the corner.
    pub(crate) at: [f32; 3],
    /// The same without what is known of blade and skin beyond the corner: where it goes when there is no room for it.
    pub(crate) plain: [f32; 3],
    /// Whether it has been put between its neighbours to make room.
    pub(crate) gave_way: bool,
    /// Whether it lies in the face of the cut, behind where that meets the skin: the blade has passed the corner's own edge.
    pub(crate) behind: bool,
}

/// A crossing of the skin beside a cut, drawn along the skin to where the blade meets it.
///
/// A face with three corners inside has a rim on one side of the blade only. On the other the way from the lip leads straight to a
/// crossing of the edge that faces the cut one: left where it is, the rim would have a tooth there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RimCrossing {
    /// The edge it crosses, as in [`super::seam::edge_key`].
    pub(crate) edge: u64,
    /// Whether the outside lies at its upper end.
    pub(crate) upward: bool,
    /// The axis across that edge, and whether the cut edge lies upward.
    pub(crate) across: u8,
    pub(crate) across_upward: bool,
    /// Steps along its edge, across, and up along the third axis, from the inside end.
    pub(crate) at: [f32; 3],
    /// Steps along its edge of where it was.
    pub(crate) plain: f32,
    /// Whether it has been put between its neighbours to make room.
    pub(crate) gave_way: bool,
}

impl RimPlace {
    /// Squared distance from where it goes when there is no room for it [pitches].
    pub(crate) fn moved(&self) -> f32 {
        squared_distance(self.at, self.plain)
    }

    /// Makes room: goes where it is put, the first time, or else where it has room for certain.
    ///
    /// - `between`: steps along the grid axes from its corner.
    pub(crate) fn give_way(&mut self, cut_axis: u8, between: Option<[f32; 3]>) {
        let aside = 3 - cut_axis - self.skin_axis;
        let own = |steps: [f32; 3]| {
            let along = |axis: u8, upward: bool| signed(steps[usize::from(axis)], upward);
            [along(cut_axis, self.end == 0), along(self.skin_axis, self.skin_upward), along(aside, true)]
        };
        self.at = between.filter(|_| !self.gave_way).map_or(self.plain, own);
        self.gave_way = true;
    }
}

impl RimCrossing {
    /// The axes along its edge, across, and aside, each with whether steps are counted upward.
    fn axes(&self) -> [(usize, bool); 3] {
        let (axis, across) = ((self.edge % 3) as usize, usize::from(self.across));
        [(axis, self.upward), (across, self.across_upward), (3 - axis - across, true)]
    }

    /// The grid point at its inside end.
    pub(crate) fn inside(&self, shape: GridShape) -> [i64; 3] {
        let mut inside = point_of_key(shape, self.edge / 3).map(|i| i - 1);
        inside[(self.edge % 3) as usize] += i64::from(!self.upward);
        inside
    }

    /// Signed steps from the inside end, along the axis of its edge, across, and along the third.
    pub(crate) fn steps(&self) -> [(usize, f32); 3] {
        let axes = self.axes();
        [0, 1, 2].map(|n| (axes[n].0, signed(self.at[n], axes[n].1)))
    }

    /// Squared distance from where it was [pitches].
    pub(crate) fn moved(&self) -> f32 {
        squared_distance(self.at, [self.plain, 0.0, 0.0])
    }

    /// Makes room: goes where it is put, the first time. False if it is to be a crossing like any other.
    ///
    /// - `between`: steps along the grid axes from the inside end.
    pub(crate) fn give_way(&mut self, between: Option<[f32; 3]>) -> bool {
        let Some(steps) = between.filter(|_| !self.gave_way) else { return false };
        self.at = self.axes().map(|(axis, upward)| signed(steps[axis], upward));
        self.gave_way = true;
        true
    }
}

/// Steps along an axis that are counted upward or downward.
pub(crate) fn signed(t: f32, upward: bool) -> f32 {
    if upward { t } else { -t }
}

fn squared_distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    let way = [0, 1, 2].map(|n| a[n] - b[n]);
    dot(way, way)
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
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Beyond {
    /// That corner is outside.
    Nothing,
    /// Tissue with contours of its own round that corner.
    Corner,
    /// A sheet from the other lip to the edge facing the cut edge, which it meets at this fraction from the rim's side.
    Sheet(f32),
}

/// A blade near an inside point, where `normal . (x, y, z) = offset`, not negative: steps from the point along an edge, across it in
/// a face, and aside.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NearBlade {
    pub(crate) normal: [f32; 3],
    pub(crate) offset: f32,
}

impl NearBlade {
    /// Whether a sheet from the lip on the other side to the edge facing the cut edge runs along the blade.
    pub(crate) fn runs_along(&self, sheet: f32) -> bool {
        self.past([sheet, 1.0, 0.0]).abs() <= ALONGSIDE
    }

    /// How far a place lies beyond the blade, by the length of the normal.
    pub(crate) fn past(&self, place: [f32; 3]) -> f32 {
        dot(self.normal, place) - self.offset
    }

    /// Where it meets the skin in the face, between the two places where the skin enters the face.
    pub(crate) fn meets(&self, skin: [[f32; 2]; 2]) -> Option<[f32; 3]> {
        let past = skin.map(|[x, y]| self.past([x, y, 0.0]));
        let share = past[0] / (past[0] - past[1]);
        if !(0.0..=1.0).contains(&share) {
            return None;
        }
        // Both places are vertices of their own.
        let share = share.clamp(LIP_CLEARANCE, 1.0 - LIP_CLEARANCE);
        let at = |n: usize| skin[0][n] + share * (skin[1][n] - skin[0][n]);
        Some([at(0).max(BESIDE), at(1), 0.0])
    }

    /// Where it meets the skin nearest to a place of the skin with its normal.
    pub(crate) fn meets_near(&self, place: [f32; 3], normal: [f32; 3]) -> Option<[f32; 3]> {
        let share = dot(self.normal, normal) / dot(normal, normal);
        let way = [0, 1, 2].map(|n| self.normal[n] - share * normal[n]);
        let far = -self.past(place) / dot(self.normal, way);
        let step = way.map(|c| c * far);
        let at = [0, 1, 2].map(|n| place[n] + step[n]);
        (dot(step, step) <= FARTHEST * FARTHEST && at[0] >= BESIDE).then_some(at)
    }
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Whether the blade passes the edge to the outside, seen from a rim's corner, before it reaches the height of the skin.
pub(crate) fn passes_corner(lip: f32, skin: f32, slope: f32) -> bool {
    lip + slope * skin < BESIDE
}

/// Place of a rim, as fractions of the cut edge and of the edge to the outside from their corner: where blade and skin meet,
/// drawn back towards the straight way between lip and skin as far as needed to stay clear of what lies beyond.
///
/// - `skin`: where the skin crosses the edge to the outside, before the blade; `met`: where blade and skin meet, if they do.
pub(crate) fn rim_at(
    lips: [f32; 2],
    end: u8,
    skin: f32,
    slope: f32,
    met: Option<[f32; 3]>,
    beyond: Beyond,
) -> [f32; 3] {
    let (lip, other) = (lips[usize::from(end)], 1.0 - lips[usize::from(end ^ 1)]);
    let [x, y, z] = met.unwrap_or_else(|| {
        // The blade at the height of the skin. Where it has passed the corner's own edge by then, the rim lies where it does so;
        // where it has passed the far edge, the skin ends there.
        let at = (lip + slope * skin).min(1.0 - CLEARANCE - 2.0 * LIP_SHIFT);
        if at >= BESIDE {
            return [at, skin, 0.0];
        }
        [BESIDE, ((BESIDE - lip) / slope).clamp(CLEARANCE.min(skin), skin), 0.0]
    });
    // A line the rim stays on the near side of: through (from, 0) and (to, 1).
    let (from, to) = match beyond {
        Beyond::Nothing => return [x, y, z],
        Beyond::Corner => (1.0, 0.0),
        Beyond::Sheet(to) => (other, to),
    };
    let distance = |x: f32, y: f32| x - (from + y * (to - from));
    let (middle, full) = (distance(lip / 2.0, skin / 2.0), distance(x, y));
    let reach = if full <= -LIP_SHIFT { 1.0 } else { (-middle / 2.0) / (full - middle) };
    let reach = reach.clamp(0.0, 1.0);
    [lip / 2.0 + reach * (x - lip / 2.0), skin / 2.0 + reach * (y - skin / 2.0), reach * z]
}
