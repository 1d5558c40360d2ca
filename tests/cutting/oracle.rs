//! Which springs a blade must sever, by brute force in f64: all springs, all pieces, and the margin around a border
//! inside which either answer is right.

use std::collections::BTreeSet;

use yawara::dynamics::World;
use yawara::geometry::Vector3;
use yawara::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS};

/// A spring: its lower particle and a forward direction.
pub(crate) type Spring = (u32, usize);

/// What one piece of edge sweeps along one leg of a path.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Quad {
    pub(crate) corner: Vector3,
    pub(crate) side: Vector3,
    pub(crate) stroke: Vector3,
}

/// Springs that a blade must sever, and springs that it may: the second differ from the first by border cases only.
#[derive(Debug, Default)]
pub(crate) struct Expected {
    pub(crate) must: BTreeSet<Spring>,
    pub(crate) may: BTreeSet<Spring>,
}

impl Expected {
    /// Panics with the springs that are wrong.
    pub(crate) fn check(&self, severed: &BTreeSet<Spring>, what: &str) {
        let missed: Vec<_> = self.must.difference(severed).collect();
        let invented: Vec<_> = severed.difference(&self.may).collect();
        assert!(
            missed.is_empty() && invented.is_empty(),
            "{what}: of {} springs {} are missed, for example {:?}; {} too many, for example {:?}",
            self.must.len(),
            missed.len(),
            missed.first(),
            invented.len(),
            invented.first()
        );
    }
}

pub(crate) fn quads(edge: &[Vector3], path: &[Vector3]) -> Vec<Quad> {
    let mut quads = Vec::new();
    for leg in path.windows(2) {
        for ends in edge.windows(2) {
            quads.push(Quad { corner: ends[0] + leg[0], side: ends[1] - ends[0], stroke: leg[1] - leg[0] });
        }
    }
    quads
}

/// Every living spring with the numbers of its ends.
pub(crate) fn living(world: &World) -> Vec<(Spring, usize, usize)> {
    let lattice = world.lattice();
    let mut springs = Vec::new();
    for particle in 0..lattice.len() as u32 {
        for direction in FIRST_FORWARD..NEIGHBOURS {
            if world.topology().alive()[particle as usize] >> direction & 1 == 1 {
                let other = lattice.neighbour(particle, direction).unwrap();
                springs.push(((particle, direction), particle as usize, other as usize));
            }
        }
    }
    springs
}

/// All springs of a world against all quads; `places` and `margin` in the unit of the quads.
pub(crate) fn brute_force(world: &World, places: &[Vector3], quads: &[Quad], margin: f64) -> Expected {
    let mut expected = Expected::default();
    for (spring, a, b) in living(world) {
        let (a, b) = (places[a], places[b]);
        let longer = (b - a).normalize() * margin;
        // Springs that run along a quad meet it far away when it is moved a little.
        let aside = |quad: &Quad| [0.0, margin, -margin].map(|by| quad.moved(quad.normal() * by));
        if quads.iter().any(|q| aside(q).iter().all(|q| q.grown(-margin).is_met_by(a + longer, b - longer))) {
            expected.must.insert(spring);
        }
        if quads.iter().any(|q| aside(q).iter().any(|q| q.grown(margin).is_met_by(a - longer, b + longer))) {
            expected.may.insert(spring);
        }
    }
    expected
}

impl Quad {
    fn normal(&self) -> Vector3 {
        self.side.cross(&self.stroke).normalize()
    }

    fn moved(&self, by: Vector3) -> Self {
        Self { corner: self.corner + by, ..*self }
    }

    fn grown(&self, margin: f64) -> Self {
        let (s, t) = (self.side.normalize() * margin, self.stroke.normalize() * margin);
        Self { corner: self.corner - s - t, side: self.side + 2.0 * s, stroke: self.stroke + 2.0 * t }
    }

    /// The segment from `a` to `b` meets one of the two triangles of the quad.
    fn is_met_by(&self, a: Vector3, b: Vector3) -> bool {
        let [p, q, r, s] =
            [self.corner, self.corner + self.side, self.corner + self.side + self.stroke, self.corner + self.stroke];
        segment_meets_triangle(a, b, [p, q, r]) || segment_meets_triangle(a, b, [p, r, s])
    }
}

/// By signs of volumes: the ends on different sides, and the line through the triangle on one side of its three edges.
fn segment_meets_triangle(a: Vector3, b: Vector3, [p, q, r]: [Vector3; 3]) -> bool {
    let volume = |a: Vector3, b: Vector3, c: Vector3, d: Vector3| (b - a).dot(&(c - a).cross(&(d - a)));
    let apart = (volume(a, p, q, r) > 0.0) != (volume(b, p, q, r) > 0.0);
    let around = [volume(a, b, p, q), volume(a, b, q, r), volume(a, b, r, p)];
    apart && (around.iter().all(|&v| v >= 0.0) || around.iter().all(|&v| v <= 0.0))
}

/// The springs a world has lost so far.
pub(crate) fn severed(world: &World) -> BTreeSet<Spring> {
    world.topology().severed().iter().map(|s| (s.particle, usize::from(s.direction))).collect()
}

/// Springs that a straight edge passes through while places move along straight lines from `before` to `after` and the
/// edge from `edge` to `edge + stroke`, by cutting the time into `parts`.
///
/// A spring is passed when the edge lies on one side of it before a part and on the other side after it, as seen along
/// the edge, and near enough in between.
pub(crate) fn passed(
    world: &World,
    before: &[Vector3],
    after: &[Vector3],
    edge: [Vector3; 2],
    stroke: Vector3,
    parts: u32,
    margin: f64,
) -> Expected {
    let side = edge[1] - edge[0];
    let along = side.normalize();
    // Two axes across the edge.
    let p = along.cross(&if along.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() }).normalize();
    let q = along.cross(&p);
    let mut expected = Expected::default();
    for (spring, a, b) in living(world) {
        let at = |share: f64| {
            let foot = edge[0] + stroke * share;
            let place = |i: usize| before[i] + (after[i] - before[i]) * share - foot;
            (place(a), place(b))
        };
        let area = |(a, b): (Vector3, Vector3)| a.dot(&p) * b.dot(&q) - a.dot(&q) * b.dot(&p);
        let mut last = area(at(0.0));
        for part in 1..=parts {
            let now = area(at(f64::from(part) / f64::from(parts)));
            if (now > 0.0) != (last > 0.0) {
                // Where the two lines come closest in the middle of the part.
                let (start, end) = at((f64::from(part) - 0.5) / f64::from(parts));
                let across = (end - start) - along * along.dot(&(end - start));
                let share = -start.dot(&across) / across.norm_squared();
                let height = (start + (end - start) * share).dot(&along);
                let inside = |margin: f64| {
                    let m = margin / across.norm();
                    (-m..=1.0 + m).contains(&share) && (-margin..=side.norm() + margin).contains(&height)
                };
                if inside(-margin) {
                    expected.must.insert(spring);
                }
                if inside(margin) {
                    expected.may.insert(spring);
                }
            }
            last = now;
        }
    }
    expected
}
