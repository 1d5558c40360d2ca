//! Regular grids: how many voxels or particles along each axis, and where they are.

use super::{Affine, Point3};

/// Number of points along each axis of a grid; linear indices run x fastest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct GridShape {
    /// Points along the first index.
    pub nx: usize,
    /// Points along the second index.
    pub ny: usize,
    /// Points along the third index.
    pub nz: usize,
}

impl GridShape {
    /// A shape from its three counts.
    pub const fn new(nx: usize, ny: usize, nz: usize) -> Self {
        Self { nx, ny, nz }
    }

    /// Number of points. The shapes the library builds never overflow: sizes from files are checked by their readers.
    pub const fn len(self) -> usize {
        self.nx * self.ny * self.nz
    }

    /// True when there is no point.
    pub const fn is_empty(self) -> bool {
        self.nx == 0 || self.ny == 0 || self.nz == 0
    }

    /// Linear index of (i, j, k), x fastest.
    pub const fn linear(self, [i, j, k]: [usize; 3]) -> usize {
        (k * self.ny + j) * self.nx + i
    }

    /// (i, j, k) of a linear index.
    pub const fn ijk(self, linear: usize) -> [usize; 3] {
        [linear % self.nx, linear / self.nx % self.ny, linear / (self.nx * self.ny)]
    }

    /// Linear index of `ijk + offset`, or `None` when that lies outside the grid.
    pub fn neighbour(self, ijk: [usize; 3], offset: [i32; 3]) -> Option<usize> {
        let mut at = [0; 3];
        for axis in 0..3 {
            let moved = ijk[axis] as i64 + i64::from(offset[axis]);
            if moved < 0 || moved >= self.dims()[axis] as i64 {
                return None;
            }
            at[axis] = moved as usize;
        }
        Some(self.linear(at))
    }

    /// The three counts as an array [nx, ny, nz].
    pub const fn dims(self) -> [usize; 3] {
        [self.nx, self.ny, self.nz]
    }
}

impl std::fmt::Display for GridShape {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}x{}x{}", self.nx, self.ny, self.nz)
    }
}

/// A grid of points in patient space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// Number of points along each axis.
    pub shape: GridShape,
    /// Index (i, j, k) to RAS+ [mm]; integer indices are voxel centres.
    pub affine: Affine,
}

impl Grid {
    /// Place of the point with this linear index, RAS+ [mm].
    pub fn place(&self, linear: usize) -> Point3 {
        let [i, j, k] = self.shape.ijk(linear);
        self.affine.apply(Point3::new(i as f64, j as f64, k as f64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_and_ijk_are_inverse() {
        let shape = GridShape::new(3, 4, 5);
        for linear in 0..shape.len() {
            assert_eq!(shape.linear(shape.ijk(linear)), linear);
        }
    }

    #[test]
    fn neighbours_stop_at_the_border() {
        let shape = GridShape::new(3, 3, 3);
        assert_eq!(shape.neighbour([1, 1, 1], [1, 1, 1]), Some(26));
        assert_eq!(shape.neighbour([0, 1, 1], [-1, 0, 0]), None);
        assert_eq!(shape.neighbour([2, 1, 1], [1, 0, 0]), None);
    }
}
