//! Boxes in lattice axes [m].

use super::blade::Piece;
use crate::geometry::Vector3;

/// A box in lattice axes [m].
#[derive(Debug, Clone, Copy)]
pub(super) struct Bounds {
    pub(super) min: Vector3,
    pub(super) max: Vector3,
}

impl Bounds {
    pub(super) const EMPTY: Self =
        Self { min: Vector3::new(f64::MAX, f64::MAX, f64::MAX), max: Vector3::new(f64::MIN, f64::MIN, f64::MIN) };

    pub(super) fn include(&mut self, point: Vector3) {
        self.min = self.min.inf(&point);
        self.max = self.max.sup(&point);
    }

    pub(super) fn joined(self, other: Self) -> Self {
        Self { min: self.min.inf(&other.min), max: self.max.sup(&other.max) }
    }

    /// Distance of a point from the box [m]; 0 inside.
    pub(super) fn distance(&self, point: Vector3) -> f64 {
        (self.min - point).sup(&(point - self.max)).sup(&Vector3::zeros()).norm()
    }

    pub(super) fn meets(&self, other: &Self) -> bool {
        (0..3).all(|axis| self.min[axis] <= other.max[axis] && other.min[axis] <= self.max[axis])
    }

    pub(super) fn of(piece: &Piece, margin: f64) -> Self {
        let mut bounds = Self::EMPTY;
        let corner = piece.origin.coords;
        for point in [corner, corner + piece.side, corner + piece.stroke, corner + piece.side + piece.stroke] {
            bounds.include(point);
        }
        Self { min: bounds.min.add_scalar(-margin), max: bounds.max.add_scalar(margin) }
    }
}
