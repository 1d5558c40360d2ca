//! The blade and the surface it sweeps.

use crate::geometry::{Point3, Vector3};

/// A blade: an edge that moves along a path without turning.
#[derive(Debug, Clone, PartialEq)]
pub struct Blade {
    edge: Vec<Point3>,
    /// Offsets of the edge, with the length of path up to each.
    path: Vec<(f64, Vector3)>,
}

/// A piece of edge on its way along a straight piece of path: the points `origin + a side + b stroke` with a, b in 0..=1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// One end of the piece of edge when it sets out.
    pub origin: Point3,
    /// From there to its other end.
    pub side: Vector3,
    /// How far it is carried.
    pub stroke: Vector3,
    /// Shares of the sweep's time at which it sets out and arrives.
    pub during: [f64; 2],
}

/// What the edge does in one go, in the frame of the lattice [m]: x, y, z along its axes from its first grid point.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Sweep {
    /// Its pieces, in the order of time.
    pub pieces: Vec<Piece>,
}

impl Blade {
    /// A blade from the points of its edge and the offsets it is moved by, both in one frame and unit.
    ///
    /// # Panics
    /// If the edge or the path has fewer than two points (scenes are checked when they are resolved).
    pub fn new(edge: Vec<Point3>, offsets: &[Vector3]) -> Self {
        assert!(edge.len() >= 2 && offsets.len() >= 2, "an edge and a path have at least two points");
        let mut length = 0.0;
        let mut path = vec![(0.0, offsets[0])];
        for pair in offsets.windows(2) {
            length += (pair[1] - pair[0]).norm();
            path.push((length, pair[1]));
        }
        Self { edge, path }
    }

    /// Length of the path.
    pub fn path_length(&self) -> f64 {
        self.path[self.path.len() - 1].0
    }

    /// What the edge does while it moves at constant speed from `from` to `to`, both as lengths of path. An edge that
    /// stays where it is (`to` not beyond `from`) still is an edge that tissue can move through.
    pub fn sweep(&self, from: f64, to: f64) -> Sweep {
        let mut pieces = Vec::new();
        let mut carry = |first: Vector3, stroke: Vector3, during: [f64; 2]| {
            for ends in self.edge.windows(2).filter(|ends| ends[0] != ends[1]) {
                pieces.push(Piece { origin: ends[0] + first, side: ends[1] - ends[0], stroke, during });
            }
        };
        if to <= from {
            carry(self.offset(from), Vector3::zeros(), [0.0, 1.0]);
            return Sweep { pieces };
        }
        for leg in self.path.windows(2) {
            let (low, high) = (from.max(leg[0].0), to.min(leg[1].0));
            if low < high {
                let first = on_leg(leg, low);
                carry(first, on_leg(leg, high) - first, [low, high].map(|at| (at - from) / (to - from)));
            }
        }
        Sweep { pieces }
    }

    /// Offset of the edge at a length of path.
    fn offset(&self, at: f64) -> Vector3 {
        let leg = self.path.windows(2).find(|leg| leg[0].0 < leg[1].0 && at <= leg[1].0);
        leg.map_or(self.path[self.path.len() - 1].1, |leg| on_leg(leg, at))
    }
}

/// Offset at a length of path on a leg whose length is not 0.
fn on_leg(leg: &[(f64, Vector3)], at: f64) -> Vector3 {
    let ((start, a), (end, b)) = (leg[0], leg[1]);
    a + (b - a) * ((at - start) / (end - start)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn blade() -> Blade {
        let edge = vec![Point3::new(0.0, 0.0, 0.0), Point3::new(0.0, 0.0, 1.0), Point3::new(0.0, 1.0, 2.0)];
        Blade::new(edge, &[Vector3::zeros(), Vector3::new(2.0, 0.0, 0.0), Vector3::new(2.0, 2.0, 0.0)])
    }

    #[test]
    fn sweeps_follow_the_bends_of_edge_and_path() {
        let blade = blade();
        assert_eq!(blade.path_length(), 4.0);
        let sweep = blade.sweep(1.0, 3.0);
        assert_eq!(sweep.pieces.len(), 4);
        assert_eq!(sweep.pieces[0].origin, Point3::new(1.0, 0.0, 0.0));
        assert_eq!(sweep.pieces[0].stroke, Vector3::new(1.0, 0.0, 0.0));
        assert_eq!(sweep.pieces[2].origin, Point3::new(2.0, 0.0, 0.0));
        assert_eq!(sweep.pieces[2].stroke, Vector3::new(0.0, 1.0, 0.0));
        assert_eq!(sweep.pieces[0].during, [0.0, 0.5]);
        assert_eq!(sweep.pieces[3].during, [0.5, 1.0]);
    }

    #[test]
    fn an_edge_that_stays_is_still_there() {
        let sweep = blade().sweep(2.5, 2.5);
        assert_eq!(sweep.pieces.len(), 2);
        assert_eq!(sweep.pieces[0].origin, Point3::new(2.0, 0.5, 0.0));
        assert_eq!(sweep.pieces[0].stroke, Vector3::zeros());
    }
}
