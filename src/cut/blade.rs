//! The blade and the surface it sweeps.

use crate::geometry::{Point3, Vector3};

/// A blade: an edge that moves along a path without turning.
#[derive(Debug, Clone, PartialEq)]
pub struct Blade {
    edge: Vec<Point3>,
    /// Offsets of the edge, with the length of path up to each.
    path: Vec<(f64, Vector3)>,
}

/// A flat piece of swept surface: the points `origin + a side + b stroke` with a, b in 0..=1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parallelogram {
    /// A corner.
    pub origin: Point3,
    /// Along the edge.
    pub side: Vector3,
    /// Along the path.
    pub stroke: Vector3,
}

/// The surface swept in one step, in the frame of the lattice [m]: x, y, z along its axes from its first grid point.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Sweep {
    /// Its flat pieces.
    pub pieces: Vec<Parallelogram>,
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

    /// What the edge sweeps while it moves from `from` to `to`, both as lengths of path.
    pub fn sweep(&self, from: f64, to: f64) -> Sweep {
        let mut pieces = Vec::new();
        for leg in self.path.windows(2) {
            let ((start, a), (end, b)) = (leg[0], leg[1]);
            let (low, high) = (from.max(start), to.min(end));
            if low >= high {
                continue;
            }
            let direction = (b - a) / (end - start);
            let first = a + direction * (low - start);
            let stroke = direction * (high - low);
            for ends in self.edge.windows(2) {
                let side = ends[1] - ends[0];
                // A piece of edge that slides along itself sweeps no surface.
                if side.cross(&stroke).norm() > 1e-9 * side.norm() * stroke.norm() {
                    pieces.push(Parallelogram { origin: ends[0] + first, side, stroke });
                }
            }
        }
        Sweep { pieces }
    }
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
    }

    #[test]
    fn an_edge_that_slides_along_itself_sweeps_nothing() {
        let edge = vec![Point3::origin(), Point3::new(1.0, 0.0, 0.0)];
        let blade = Blade::new(edge, &[Vector3::zeros(), Vector3::new(5.0, 0.0, 0.0)]);
        assert!(blade.sweep(0.0, 5.0).pieces.is_empty());
    }
}
