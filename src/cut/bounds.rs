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
        for axis in 0..3 {
            self.min[axis] = smaller(self.min[axis], point[axis]);
            self.max[axis] = larger(self.max[axis], point[axis]);
        }
    }

    /// Takes in the least and the most along each axis.
    pub(super) fn include_displaced(&mut self, block: &[[f32; 2]; 3]) {
        for (axis, [low, high]) in block.iter().enumerate() {
            self.min[axis] = smaller(self.min[axis], f64::from(*low));
            self.max[axis] = larger(self.max[axis], f64::from(*high));
        }
    }

    /// Takes in another box.
    pub(super) fn join(&mut self, other: &Self) {
        for axis in 0..3 {
            self.min[axis] = smaller(self.min[axis], other.min[axis]);
            self.max[axis] = larger(self.max[axis], other.max[axis]);
        }
    }

    /// The box with so much more on every side [m].
    pub(super) fn grown(&self, by: f64) -> Self {
        Self { min: self.min.add_scalar(-by), max: self.max.add_scalar(by) }
    }

    pub(super) fn holds(&self, point: Vector3) -> bool {
        (0..3).all(|axis| self.min[axis] <= point[axis] && point[axis] <= self.max[axis])
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
        bounds.grown(margin)
    }
}

/// One instruction, unlike [`f64::min`], which has NaN to care for.
fn smaller(a: f64, b: f64) -> f64 {
    if b < a { b } else { a }
}

fn larger(a: f64, b: f64) -> f64 {
    if b > a { b } else { a }
}
