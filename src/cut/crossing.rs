//! Which springs the edge of a blade passes through.

use rayon::prelude::*;

use super::blade::{Piece, Sweep};
use super::bounds::Bounds;
use super::tissue::{Part, Tissue, slots_of};
use crate::geometry::Vector3;
use crate::lattice::Topology;
use crate::lattice::layout::{BLOCK, BLOCK_LEN};
use crate::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS, OFFSETS};

/// How far beside its place a piece of edge is tested [pitches]: a particle exactly in the plane of a cut then has a side,
/// the same for all its springs, whatever rounding does. Far above rounding (1e-10 for volumes 10 km away), far below
/// anything that is seen.
const BESIDE: f64 = 1e-6;
/// How far a piece reaches beyond its ends and its way [pitches]: pieces moved aside by [`BESIDE`] in different
/// directions still overlap where edge or path bends, up to bends of 150 degrees.
const BEYOND: f64 = 4e-6;
/// Directions have a positive side by their product with this one, which is not in any plane of simple numbers.
const POSITIVE: Vector3 = Vector3::new(1.0, std::f64::consts::SQRT_2, 1.732_050_807_568_877_2);

/// A living spring that a blade goes through.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Crossing {
    /// The end with the lower particle number.
    pub(crate) particle: u32,
    /// Forward direction from that end.
    pub(crate) direction: u8,
    /// Where: 0 at `particle`, 1 at the other end.
    pub(crate) at: f32,
}

/// Finds every living spring that the edge passes through while the particles move along straight lines from where they
/// were to where they are, in order of particle and direction.
///
/// A particle exactly in the plane of a cut keeps the springs of one side: it counts to the side on which a normal of the
/// plane has a positive product with (1, sqrt 2, sqrt 3), whichever way the blade goes. Blocks that are far from the sweep
/// are only asked how far their particles are displaced. A spring passed several times is reported once, by the first piece.
pub(crate) fn crossings(tissue: &Tissue<'_>, topology: &Topology, sweep: &Sweep) -> Vec<Crossing> {
    let &Tissue { lattice, layout, .. } = tissue;
    let margin = 2.0 * BEYOND * lattice.pitch;
    let pieces: Vec<(Bounds, &Piece)> = sweep.pieces.iter().map(|piece| (Bounds::of(piece, margin), piece)).collect();

    // Springs reach over one pitch.
    let parts = pieces.iter().enumerate().map(|(number, (bounds, _))| (number, tissue.parts_near(bounds, [1.0, 1.0])));
    let mut near: Vec<(usize, usize, Part)> =
        parts.flat_map(|(number, parts)| parts.into_iter().map(move |(block, part)| (block, number, part))).collect();
    near.sort_unstable_by_key(|&(block, number, _)| (block, number));
    let blocks: Vec<&[(usize, usize, Part)]> = near.chunk_by(|a, b| a.0 == b.0).collect();

    let mut found: Vec<Crossing> = blocks
        .into_par_iter()
        .flat_map_iter(|near| {
            let mut found = Vec::new();
            let block = near[0].0;
            let part = near[1..].iter().fold(near[0].2.clone(), |a, (.., b)| {
                [0, 1, 2].map(|d| a[d].start.min(b[d].start)..a[d].end.max(b[d].end))
            });
            let ways = Ways::new(tissue, block, &part);
            let near: Vec<Near<'_>> =
                near.iter().map(|&(_, number, _)| Near::new(pieces[number], &ways, margin)).collect();
            for slot in slots_of(&part) {
                let Some(particle) = layout.particle_of_slot(lattice, block * BLOCK_LEN + slot) else { continue };
                let alive = topology.alive()[particle as usize];
                let own = ways.of_slot(slot);
                for direction in (FIRST_FORWARD..NEIGHBOURS).filter(|d| alive >> d & 1 == 1) {
                    let other = ways.beside(own, OFFSETS[direction]);
                    let meets = near.iter().find_map(|near| near.passes(&ways, own, other, lattice.pitch));
                    if let Some(at) = meets {
                        found.push(Crossing { particle, direction: direction as u8, at: at as f32 });
                    }
                }
            }
            found
        })
        .collect();
    found.sort_unstable_by_key(|crossing| (crossing.particle, crossing.direction));
    found
}

/// Where the particles of a part of a block and those around it begin and end, lattice axes [m].
struct Ways {
    part: Part,
    /// Grid points along x and y, one more at each end than the part has.
    size: [usize; 2],
    places: Vec<[Vector3; 2]>,
}

impl Ways {
    fn new(tissue: &Tissue<'_>, block: usize, part: &Part) -> Self {
        let [x, y, z] = part.clone().map(|range| range.start as i64 - 1..range.end as i64 + 1);
        let size = [x.end - x.start, y.end - y.start].map(|size| size as usize);
        let mut places = Vec::with_capacity(size[0] * size[1] * (z.end - z.start) as usize);
        for k in z {
            for j in y.clone() {
                places.extend(x.clone().map(|i| tissue.places(block, [i, j, k])));
            }
        }
        Self { part: part.clone(), size, places }
    }

    /// Number of the particle in a slot of the part.
    fn of_slot(&self, slot: usize) -> usize {
        let row = slot / BLOCK[0];
        let at = [slot % BLOCK[0], row % BLOCK[1], row / BLOCK[1]];
        let [x, y, z] = [0, 1, 2].map(|axis| at[axis] + 1 - self.part[axis].start);
        (z * self.size[1] + y) * self.size[0] + x
    }

    /// Number of the one beside it.
    fn beside(&self, number: usize, offset: [i32; 3]) -> usize {
        let [x, y, z] = offset.map(|step| step as isize);
        let [row, plane] = [self.size[0] as isize, (self.size[0] * self.size[1]) as isize];
        number.wrapping_add_signed(z * plane + y * row + x)
    }

    fn of(&self, number: usize) -> [Vector3; 2] {
        self.places[number]
    }
}

/// A piece of edge near a block, and what tells cheaply that most springs are not met: a spring that is met ends on both
/// sides of the swept plane, at one moment or between two.
struct Near<'a> {
    piece: &'a Piece,
    bounds: Bounds,
    /// Lowest and highest place of each particle over the swept plane [m].
    heights: Vec<[f64; 2]>,
    /// How far beside the plane the edge may be [m].
    margin: f64,
}

impl<'a> Near<'a> {
    fn new((bounds, piece): (Bounds, &'a Piece), ways: &Ways, margin: f64) -> Self {
        let normal = piece.positive_normal();
        // Without a plane nothing is told apart: everything lies in it.
        let heights = ways.places.iter().map(|places| {
            let [first, last] = places.map(|place| normal.dot(&(place - piece.origin.coords)));
            [first.min(last), first.max(last)]
        });
        Self { piece, bounds, heights: heights.collect(), margin }
    }

    /// [`Piece::passes`] for the spring between two particles.
    fn passes(&self, ways: &Ways, a: usize, b: usize, pitch: f64) -> Option<f64> {
        let ([low_a, high_a], [low_b, high_b]) = (self.heights[a], self.heights[b]);
        if low_a.min(low_b) > self.margin || high_a.max(high_b) < -self.margin {
            return None;
        }
        let (a, b) = (ways.of(a), ways.of(b));
        let spring = Bounds { min: a[0].inf(&a[1]).inf(&b[0]).inf(&b[1]), max: a[0].sup(&a[1]).sup(&b[0]).sup(&b[1]) };
        if !self.bounds.meets(&spring) {
            return None;
        }
        self.piece.passes(a, b, pitch)
    }
}

impl Piece {
    /// Where the piece of edge passes through a spring whose ends move: 0 at `a`, 1 at `b`.
    ///
    /// - `a`, `b` [m]: places of the ends when the sweep begins and ends; `pitch` [m] sets the size of a border.
    ///
    /// Seen along the edge, the edge is a point and the spring a segment; the point lies on the segment's line when their
    /// triangle has no area. Both ends move linearly, so the area is quadratic in time.
    fn passes(&self, a: [Vector3; 2], b: [Vector3; 2], pitch: f64) -> Option<f64> {
        let [start, end] = self.during;
        let foot = self.origin.coords - self.positive_normal() * (BESIDE * pitch);
        // Relative to the edge: places when it sets out, and how they move until it arrives.
        let place = |p: [Vector3; 2]| p[0] + (p[1] - p[0]) * start - foot;
        let motion = |p: [Vector3; 2]| (p[1] - p[0]) * (end - start) - self.stroke;
        let (place_a, place_b, motion_a, motion_b) = (place(a), place(b), motion(a), motion(b));

        let length = self.side.norm();
        let along = self.side / length;
        let across = |v: Vector3| v - along * along.dot(&v);
        let speed = across(motion_a).norm().max(across(motion_b).norm());
        let beyond = BEYOND * pitch;
        if speed < 1e-6 * beyond {
            return None;
        }
        let area = |a: &Vector3, b: &Vector3| along.dot(&a.cross(b));
        let times = roots(
            area(&motion_a, &motion_b),
            area(&place_a, &motion_b) + area(&motion_a, &place_b),
            area(&place_a, &place_b),
        );
        times.into_iter().filter(|time| (-beyond / speed..=1.0 + beyond / speed).contains(time)).find_map(|time| {
            let (a, b) = (place_a + motion_a * time, place_b + motion_b * time);
            let spring = across(b - a);
            // A spring along the edge has no inside to pass through.
            if spring.norm_squared() <= 1e-18 * (b - a).norm_squared() {
                return None;
            }
            let at = -a.dot(&spring) / spring.norm_squared();
            let height = along.dot(&(a + (b - a) * at));
            ((0.0..=1.0).contains(&at) && (-beyond..=length + beyond).contains(&height)).then_some(at)
        })
    }

    /// Unit normal of the swept plane towards its positive side; 0 for a piece that slides along itself or stays.
    fn positive_normal(&self) -> Vector3 {
        let normal = self.side.cross(&self.stroke);
        if normal.norm() <= 1e-9 * self.side.norm() * self.stroke.norm() {
            return Vector3::zeros();
        }
        normal.normalize() * normal.dot(&POSITIVE).signum()
    }
}

/// Real roots of `a t^2 + b t + c`, ascending; NaN or infinite where there is none.
fn roots(a: f64, b: f64, c: f64) -> [f64; 2] {
    // The sum that does not cancel; NaN for a negative discriminant.
    let q = -0.5 * (b + (b * b - 4.0 * a * c).sqrt().copysign(b));
    let (first, second) = (q / a, c / q);
    if first <= second { [first, second] } else { [second, first] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point3;

    const PIECE: Piece = Piece {
        origin: Point3::new(0.0, 0.0, 0.0),
        side: Vector3::new(2.0, 0.0, 0.0),
        stroke: Vector3::new(1.0, 3.0, 0.0),
        during: [0.0, 1.0],
    };

    fn passes(piece: Piece, a: Vector3, b: Vector3) -> Option<f64> {
        piece.passes([a; 2], [b; 2], 1.0)
    }

    #[test]
    fn crossings_are_found_inside_only() {
        let through = |x: f64, y: f64| passes(PIECE, Vector3::new(x, y, -1.0), Vector3::new(x, y, 3.0));
        for (x, y) in [(1.0, 1.0), (2.9, 3.0)] {
            assert!((through(x, y).unwrap() - 0.25).abs() < 1e-6);
        }
        assert_eq!(through(0.1, 1.0), None);
        assert_eq!(through(1.0, 3.1), None);
        assert_eq!(through(1.0, -0.1), None);
    }

    #[test]
    fn a_particle_on_the_plane_keeps_the_springs_of_its_positive_side() {
        let on = Vector3::new(1.0, 1.0, 0.0);
        for piece in [PIECE, Piece { side: -PIECE.side, origin: Point3::new(2.0, 0.0, 0.0), ..PIECE }] {
            assert_eq!(passes(piece, on, Vector3::new(1.0, 1.0, 1.0)), None);
            assert!(passes(piece, on, Vector3::new(1.0, 1.0, -1.0)).unwrap() < 2e-6);
            assert!(passes(piece, Vector3::new(1.0, 1.0, -1.0), on).unwrap() > 1.0 - 2e-6);
        }
    }

    #[test]
    fn only_relative_motion_counts() {
        let moved = |a: Vector3, by: Vector3| [a, a + by];
        let (a, b) = (Vector3::new(1.0, 1.0, -1.0), Vector3::new(1.0, 1.0, 1.0));
        let away = PIECE.stroke;
        assert_eq!(PIECE.passes(moved(a, away), moved(b, away), 1.0), None, "the tissue runs ahead of the blade");
        let still = Piece { stroke: Vector3::zeros(), ..PIECE };
        assert_eq!(passes(still, a, b), None);
        assert_eq!(still.passes(moved(a, -away), moved(b, -away), 1.0), Some(0.5), "a still blade in moving tissue");
        let sliding = Piece { stroke: 0.1 * PIECE.side, ..PIECE };
        assert_eq!(passes(sliding, a, b), None);
        assert!(sliding.passes(moved(a, -away), moved(b, -away), 1.0).is_some());
        // One end stands, the other swings over.
        let swing =
            still.passes([a - away, a - away], [Vector3::new(0.0, -2.0, 1.0), Vector3::new(2.0, 9.0, 1.0)], 1.0);
        assert!(swing.is_some());
    }

    #[test]
    fn roots_survive_every_degenerate_case() {
        assert_eq!(roots(1.0, -3.0, 2.0), [1.0, 2.0]);
        assert_eq!(roots(-1.0, 3.0, -2.0), [1.0, 2.0]);
        assert!(roots(0.0, 2.0, -1.0).contains(&0.5));
        assert!(roots(1e-30, -2.0, 1.0).contains(&0.5));
        assert!(roots(1.0, 0.0, 1.0).iter().all(|t| t.is_nan()));
        assert!(roots(0.0, 0.0, 0.0).iter().all(|t| t.is_nan()));
        assert!(roots(0.0, 0.0, 1.0).iter().all(|t| !t.is_finite()));
        assert!(roots(1.0, 0.0, -4.0).iter().all(|t| t.abs() == 2.0));
    }
}
