//! Which springs a swept surface crosses.

use rayon::prelude::*;

use super::blade::{Parallelogram, Sweep};
use crate::geometry::{Point3, Vector3};
use crate::lattice::layout::{BLOCK, BLOCK_LEN, BlockLayout, NO_BLOCK};
use crate::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS};
use crate::lattice::{Lattice, Topology};

/// How far outside a piece, relative to its size, still counts as inside: neighbouring pieces share their borders, and a
/// spring through a border must not slip between them by rounding.
const BORDER: f64 = 1e-9;

/// A living spring that a blade goes through.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// The end with the lower particle number.
    pub particle: u32,
    /// Forward direction from that end.
    pub direction: u8,
    /// Where: 0 at `particle`, 1 at the other end.
    pub at: f32,
}

/// A box in lattice axes [m].
#[derive(Debug, Clone, Copy)]
struct Bounds {
    min: Vector3,
    max: Vector3,
}

impl Bounds {
    const EMPTY: Self =
        Self { min: Vector3::new(f64::MAX, f64::MAX, f64::MAX), max: Vector3::new(f64::MIN, f64::MIN, f64::MIN) };

    fn include(&mut self, point: Vector3) {
        self.min = self.min.inf(&point);
        self.max = self.max.sup(&point);
    }

    fn joined(self, other: Self) -> Self {
        Self { min: self.min.inf(&other.min), max: self.max.sup(&other.max) }
    }

    fn meets(&self, other: &Self) -> bool {
        (0..3).all(|axis| self.min[axis] <= other.max[axis] && other.min[axis] <= self.max[axis])
    }

    fn of(piece: &Parallelogram) -> Self {
        let mut bounds = Self::EMPTY;
        let corner = piece.origin.coords;
        for point in [corner, corner + piece.side, corner + piece.stroke, corner + piece.side + piece.stroke] {
            bounds.include(point);
        }
        // Room for the border tolerance.
        let margin = 1e-6 * (bounds.max - bounds.min).norm();
        Self { min: bounds.min.add_scalar(-margin), max: bounds.max.add_scalar(margin) }
    }
}

/// Finds every living spring that the sweep crosses at the particles' present places, in order of particle and direction.
///
/// - `displacement` x, y, z [m]: block order, lattice axes.
///
/// A spring crosses a piece when its ends lie on different sides of the piece's plane (a particle exactly on the plane
/// counts to its positive side, so it keeps the springs of one side) and the crossing point lies in the piece. Blocks that
/// are far from the sweep are only asked for their bounds. A spring crossed by several pieces is reported once, by the
/// first.
///
/// # Panics
/// Never: a living spring has two ends.
pub fn crossings(
    lattice: &Lattice,
    layout: &BlockLayout,
    topology: &Topology,
    displacement: &[Vec<f32>; 3],
    sweep: &Sweep,
) -> Vec<Crossing> {
    if sweep.pieces.is_empty() {
        return Vec::new();
    }
    let place = |particle: u32| {
        let slot = layout.slot[particle as usize] as usize;
        let ijk = lattice.ijk(particle);
        Point3::from([0, 1, 2].map(|axis| ijk[axis] as f64 * lattice.pitch + f64::from(displacement[axis][slot])))
    };
    let particles_of = |block: usize| {
        (block * BLOCK_LEN..(block + 1) * BLOCK_LEN).filter_map(move |slot| layout.particle_of_slot(lattice, slot))
    };
    let bounds: Vec<Bounds> = (0..layout.blocks.len())
        .into_par_iter()
        .map(|block| block_bounds(lattice, layout, displacement, block))
        .collect();
    let pieces: Vec<(Bounds, &Parallelogram)> = sweep.pieces.iter().map(|piece| (Bounds::of(piece), piece)).collect();

    let mut found: Vec<Crossing> = (0..layout.blocks.len())
        .into_par_iter()
        .flat_map_iter(|block| {
            // A spring can end in a neighbouring block.
            let reach = layout.neighbours[block]
                .iter()
                .filter(|&&neighbour| neighbour != NO_BLOCK)
                .fold(Bounds::EMPTY, |reach, &neighbour| reach.joined(bounds[neighbour as usize]));
            let near: Vec<&Parallelogram> =
                pieces.iter().filter(|(piece, _)| piece.meets(&reach)).map(|&(_, piece)| piece).collect();
            let mut found = Vec::new();
            if near.is_empty() {
                return found;
            }
            for particle in particles_of(block) {
                let alive = topology.alive()[particle as usize];
                let start = place(particle);
                for direction in (FIRST_FORWARD..NEIGHBOURS).filter(|d| alive >> d & 1 == 1) {
                    let other = lattice.neighbour(particle, direction).expect("a living spring has two ends");
                    let end = place(other);
                    if let Some(at) = near.iter().find_map(|piece| piece.crossed_by(start, end)) {
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

/// Bounds of a block's particles: its box at rest, widened by the smallest and largest displacement in it.
fn block_bounds(lattice: &Lattice, layout: &BlockLayout, displacement: &[Vec<f32>; 3], block: usize) -> Bounds {
    let mut bounds = Bounds::EMPTY;
    for axis in 0..3 {
        let slots = &displacement[axis][block * BLOCK_LEN..(block + 1) * BLOCK_LEN];
        let low = slots.iter().copied().fold(f32::MAX, f32::min);
        let high = slots.iter().copied().fold(f32::MIN, f32::max);
        let first = f64::from(layout.blocks[block][axis]) * BLOCK[axis] as f64;
        bounds.min[axis] = first * lattice.pitch + f64::from(low);
        bounds.max[axis] = (first + (BLOCK[axis] - 1) as f64) * lattice.pitch + f64::from(high);
    }
    bounds
}

impl Parallelogram {
    /// Where the segment from `start` to `end` goes through the piece: 0 at `start`, 1 at `end`.
    pub fn crossed_by(&self, start: Point3, end: Point3) -> Option<f64> {
        let normal = self.side.cross(&self.stroke);
        let (above, below) = (normal.dot(&(start - self.origin)), normal.dot(&(end - self.origin)));
        if (above >= 0.0) == (below >= 0.0) {
            return None;
        }
        let at = above / (above - below);
        let hit = start + (end - start) * at - self.origin;
        // Coordinates of the hit along side and stroke.
        let scale = normal.norm_squared();
        let a = hit.cross(&self.stroke).dot(&normal) / scale;
        let b = self.side.cross(&hit).dot(&normal) / scale;
        let inside = |x: f64| (-BORDER..=1.0 + BORDER).contains(&x);
        (inside(a) && inside(b)).then_some(at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PIECE: Parallelogram = Parallelogram {
        origin: Point3::new(0.0, 0.0, 0.0),
        side: Vector3::new(2.0, 0.0, 0.0),
        stroke: Vector3::new(1.0, 3.0, 0.0),
    };

    #[test]
    fn crossings_are_found_inside_only() {
        let through = |x: f64, y: f64| PIECE.crossed_by(Point3::new(x, y, -1.0), Point3::new(x, y, 3.0));
        assert_eq!(through(1.0, 1.0), Some(0.25));
        assert_eq!(through(2.9, 3.0), Some(0.25));
        assert_eq!(through(0.1, 1.0), None);
        assert_eq!(through(1.0, 3.1), None);
        assert_eq!(through(1.0, -0.1), None);
    }

    #[test]
    fn a_particle_on_the_plane_keeps_the_springs_of_one_side() {
        let on = Point3::new(1.0, 1.0, 0.0);
        assert_eq!(PIECE.crossed_by(on, Point3::new(1.0, 1.0, 1.0)), None);
        assert_eq!(PIECE.crossed_by(on, Point3::new(1.0, 1.0, -1.0)), Some(0.0));
        assert_eq!(PIECE.crossed_by(Point3::new(1.0, 1.0, -1.0), on), Some(1.0));
    }
}
