//! The vessels of the liver: two trees of tapering branches, portal and hepatic veins, grown inside a given shape.
//!
//! A branch splits in two by Murray's law (r^3 = r1^3 + r2^3; C. D. Murray, "The physiological principle of minimum
//! work", 1926). Of several random directions a branch takes the one that keeps it inside and farthest from what has
//! grown, so that the trees spread through the organ and keep apart. Growth is breadth first: big branches take their
//! room before small ones. Branches end below [`THINNEST`].

use std::collections::VecDeque;

use super::noise::Stream;
use super::sdf::{FAR, capsule};
use crate::geometry::{Point3, Vector3};

/// Radius below which vessels are not drawn [mm].
const THINNEST: f64 = 0.9;
/// Distance a vessel keeps from the surface of the organ, besides its radius [mm].
const MARGIN: f64 = 2.5;
/// Directions tried for each branch.
const TRIES: usize = 14;
/// Edge of the bins that speed up the look-up [mm].
const BIN: f64 = 10.0;
/// How far from a vessel its distance is known; beyond, it is [`FAR`] [mm].
const REACH: f64 = 8.0;

/// Where a tree enters the organ.
pub(super) struct Root {
    /// First point, RAS+ [mm].
    pub(super) start: Point3,
    /// Points the trunk passes before it branches, RAS+ [mm].
    pub(super) trunk: Vec<Point3>,
    /// Radius at the start [mm].
    pub(super) radius: f64,
}

/// A tapering piece of vessel.
#[derive(Debug, Clone, Copy)]
struct Segment {
    from: Point3,
    to: Point3,
    radii: [f64; 2],
}

impl Segment {
    fn distance(&self, p: Point3) -> f64 {
        capsule(p, self.from, self.to, self.radii[0], self.radii[1])
    }
}

struct Tip {
    at: Point3,
    heading: Vector3,
    radius: f64,
}

/// All vessels, binned for quick distances.
pub(super) struct Vessels {
    segments: Vec<Segment>,
    low: Point3,
    bins: [usize; 3],
    members: Vec<Vec<u32>>,
}

impl Vessels {
    /// Grows one tree from each root inside `organ` (a signed distance).
    pub(super) fn grow(stream: &mut Stream, roots: &[Root], organ: impl Fn(Point3) -> f64) -> Self {
        let mut segments: Vec<Segment> = Vec::new();
        let mut tips = VecDeque::new();
        for root in roots {
            let mut at = root.start;
            let mut heading = Vector3::zeros();
            let mut radius = root.radius;
            for &next in &root.trunk {
                let thinner = radius * 0.93;
                segments.push(Segment { from: at, to: next, radii: [radius, thinner] });
                heading = (next - at).normalize();
                (at, radius) = (next, thinner);
            }
            tips.push_back(Tip { at, heading, radius });
        }
        while let Some(tip) = tips.pop_front() {
            let share = stream.between(0.35, 0.6);
            let radii = [tip.radius * share.cbrt(), tip.radius * (1.0 - share).cbrt()];
            let first_new = segments.len();
            for radius in radii.into_iter().filter(|&r| r >= THINNEST) {
                let Some(to) = best_end(stream, &tip, radius, &segments[..], first_new, &organ) else { continue };
                let thinner = radius * 0.94;
                segments.push(Segment { from: tip.at, to, radii: [radius.min(tip.radius), thinner] });
                tips.push_back(Tip { at: to, heading: (to - tip.at).normalize(), radius: thinner });
            }
        }
        Self::binned(segments)
    }

    fn binned(segments: Vec<Segment>) -> Self {
        let (mut low, mut high) = (Point3::from([FAR; 3]), Point3::from([-FAR; 3]));
        for segment in &segments {
            low = low.inf(&segment.from).inf(&segment.to);
            high = high.sup(&segment.from).sup(&segment.to);
        }
        let reach = |s: &Segment| s.radii[0].max(s.radii[1]) + REACH;
        let widest = segments.iter().map(reach).fold(0.0, f64::max);
        low -= Vector3::repeat(widest);
        high += Vector3::repeat(widest);
        let bins = [0, 1, 2].map(|axis| ((high[axis] - low[axis]) / BIN).ceil().max(1.0) as usize);
        let mut members = vec![Vec::new(); bins.iter().product()];
        for (number, segment) in segments.iter().enumerate() {
            let (a, b) = (segment.from.inf(&segment.to), segment.from.sup(&segment.to));
            let first = [0, 1, 2].map(|x| ((a[x] - reach(segment) - low[x]) / BIN).max(0.0) as usize);
            let last = [0, 1, 2].map(|x| (((b[x] + reach(segment) - low[x]) / BIN) as usize).min(bins[x] - 1));
            for k in first[2]..=last[2] {
                for j in first[1]..=last[1] {
                    for i in first[0]..=last[0] {
                        members[(k * bins[1] + j) * bins[0] + i].push(number as u32);
                    }
                }
            }
        }
        Self { segments, low, bins, members }
    }

    /// Distance to the nearest vessel, exact up to [`REACH`].
    pub(super) fn distance(&self, p: Point3) -> f64 {
        let mut bin = [0; 3];
        for axis in 0..3 {
            let at = (p[axis] - self.low[axis]) / BIN;
            if at < 0.0 || at >= self.bins[axis] as f64 {
                return FAR;
            }
            bin[axis] = at as usize;
        }
        self.members[(bin[2] * self.bins[1] + bin[1]) * self.bins[0] + bin[0]]
            .iter()
            .map(|&number| self.segments[number as usize].distance(p))
            .fold(FAR, f64::min)
    }
}

/// The best end for a branch of this radius, or `None` when no direction stays inside the organ.
fn best_end(
    stream: &mut Stream,
    tip: &Tip,
    radius: f64,
    segments: &[Segment],
    siblings_from: usize,
    organ: &impl Fn(Point3) -> f64,
) -> Option<Point3> {
    let length = radius * stream.between(3.0, 4.5) + 4.0;
    let mut best: Option<(f64, Point3)> = None;
    for _ in 0..TRIES {
        let heading = (tip.heading + stream.direction() * 0.85).normalize();
        let to = tip.at + heading * length;
        let room = -organ(to) - radius - MARGIN;
        if room < 0.0 || -organ(tip.at + heading * (0.5 * length)) < radius + MARGIN {
            continue;
        }
        // Its own parent and uncles touch the tip; siblings count fully, so that a fork opens.
        let clearance = segments
            .iter()
            .enumerate()
            .filter(|(number, s)| *number >= siblings_from || (s.to - tip.at).norm() > 1e-9)
            .map(|(_, s)| s.distance(to))
            .fold(FAR, f64::min)
            .min(2.0 * room + 4.0);
        if best.is_none_or(|(most, _)| clearance > most) {
            best = Some((clearance, to));
        }
    }
    best.filter(|&(clearance, _)| clearance > 0.5 * radius + 0.5).map(|(_, to)| to)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tree_fills_a_ball_and_stays_inside() {
        let ball = |p: Point3| p.coords.norm() - 60.0;
        let root =
            || Root { start: Point3::new(0.0, 0.0, -50.0), trunk: vec![Point3::new(0.0, 0.0, -30.0)], radius: 6.0 };
        let vessels = Vessels::grow(&mut Stream::new(3, 9), &[root()], ball);
        assert!(vessels.segments.len() > 60, "{} segments", vessels.segments.len());
        let mut octants = [0; 8];
        for segment in &vessels.segments[1..] {
            assert!(ball(segment.to) < -segment.radii[1], "{segment:?}");
            let side = |v: f64| usize::from(v > 0.0);
            octants[side(segment.to.x) + 2 * side(segment.to.y) + 4 * side(segment.to.z)] += 1;
        }
        // One tree of one seed: it spreads through most of the ball, not along a line.
        assert!(octants.iter().filter(|&&n| n > 2).count() >= 6, "{octants:?}");
        // The bins give what a search over all segments gives.
        let mut stream = Stream::new(4, 0);
        for _ in 0..2000 {
            let p = Point3::from(stream.direction() * stream.between(0.0, 60.0));
            let all = vessels.segments.iter().map(|s| s.distance(p)).fold(FAR, f64::min);
            let found = vessels.distance(p);
            assert!(found == all || (all > REACH && found >= all), "{found} against {all}");
        }
        let again = Vessels::grow(&mut Stream::new(3, 9), &[root()], ball);
        assert_eq!(again.segments.len(), vessels.segments.len());
        assert_eq!(again.segments.last().unwrap().to, vessels.segments.last().unwrap().to);
    }
}
