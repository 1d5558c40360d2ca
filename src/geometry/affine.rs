//! The map from voxel indices to patient space.

use super::{Matrix3, Matrix4, Point3, Vector3};

/// Why a 4 x 4 matrix cannot map voxels to patient space.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AffineError {
    /// An entry is NaN or infinite.
    #[error("entry ({row}, {column}) of the affine is {found}, not a finite number")]
    NotFinite {
        /// Row, from 0.
        row: usize,
        /// Column, from 0.
        column: usize,
        /// The value found.
        found: f64,
    },
    /// The three axes do not span space.
    #[error("the affine is singular (determinant {determinant:e} mm^3): its three voxel axes do not span space")]
    Singular {
        /// Determinant of the upper 3 x 3 part [mm^3].
        determinant: f64,
    },
}

/// An invertible map from voxel indices (i, j, k) to patient space, RAS+ [mm].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Affine {
    linear: Matrix3,
    translation: Vector3,
    inverse: Matrix3,
}

impl Affine {
    /// Takes the upper three rows of a homogeneous matrix [mm].
    ///
    /// # Errors
    /// If an entry is not finite, or the three axes do not span space (relative to their lengths).
    pub fn new(matrix: &Matrix4) -> Result<Self, AffineError> {
        for row in 0..3 {
            for column in 0..4 {
                let found = matrix[(row, column)];
                if !found.is_finite() {
                    return Err(AffineError::NotFinite { row, column, found });
                }
            }
        }
        Self::from_parts(matrix.fixed_view::<3, 3>(0, 0).into_owned(), matrix.fixed_view::<3, 1>(0, 3).into_owned())
    }

    /// Axes as columns [mm per voxel] and the place of voxel (0, 0, 0) [mm].
    ///
    /// # Errors
    /// As [`Affine::new`].
    pub fn from_parts(linear: Matrix3, translation: Vector3) -> Result<Self, AffineError> {
        let determinant = linear.determinant();
        let lengths = linear.column(0).norm() * linear.column(1).norm() * linear.column(2).norm();
        // 1e-6 of the volume of the box with the same edges: far below any real shear, far above rounding.
        let spans = determinant.is_finite() && determinant.abs() > 1e-6 * lengths;
        match linear.try_inverse() {
            Some(inverse) if spans && translation.iter().all(|t| t.is_finite()) => {
                Ok(Self { linear, translation, inverse })
            }
            _ => Err(AffineError::Singular { determinant }),
        }
    }

    /// Axes along x, y, z with the given voxel spacing [mm] and the place of voxel (0, 0, 0) [mm].
    ///
    /// # Errors
    /// If a spacing is zero or not finite.
    pub fn from_spacing(spacing: [f64; 3], origin: [f64; 3]) -> Result<Self, AffineError> {
        Self::from_parts(Matrix3::from_diagonal(&Vector3::from(spacing)), Vector3::from(origin))
    }

    /// Place of a (fractional) voxel index, RAS+ [mm].
    pub fn apply(&self, index: Point3) -> Point3 {
        Point3::from(self.linear * index.coords + self.translation)
    }

    /// Displacement of an index difference, RAS+ [mm].
    pub fn apply_vector(&self, index: Vector3) -> Vector3 {
        self.linear * index
    }

    /// Fractional voxel index of a place in RAS+ [mm].
    pub fn index_of(&self, place: Point3) -> Point3 {
        Point3::from(self.inverse * (place.coords - self.translation))
    }

    /// Index difference of a displacement in RAS+ [mm].
    pub fn index_vector_of(&self, displacement: Vector3) -> Vector3 {
        self.inverse * displacement
    }

    /// Axes as columns [mm per voxel].
    pub fn linear(&self) -> Matrix3 {
        self.linear
    }

    /// Place of voxel (0, 0, 0), RAS+ [mm].
    pub fn origin(&self) -> Point3 {
        Point3::from(self.translation)
    }

    /// Length of each voxel axis [mm].
    pub fn spacing(&self) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.linear.column(axis).norm())
    }

    /// Signed volume of a voxel [mm^3]; negative when the voxel axes are left-handed in patient space.
    pub fn determinant(&self) -> f64 {
        self.linear.determinant()
    }

    /// The homogeneous 4 x 4 matrix [mm].
    pub fn matrix(&self) -> Matrix4 {
        let mut matrix = self.linear.to_homogeneous();
        matrix.fixed_view_mut::<3, 1>(0, 3).copy_from(&self.translation);
        matrix
    }

    /// The same map with voxel (0, 0, 0) moved to the given (fractional) index: what a crop needs.
    pub fn shifted(&self, index: Vector3) -> Self {
        Self { translation: self.translation + self.linear * index, ..*self }
    }

    /// The direction in which i, j and k increase, as letters: `RAS`, `LPS`, ... An oblique axis takes its largest part.
    pub fn axis_codes(&self) -> String {
        const LETTERS: [[char; 2]; 3] = [['L', 'R'], ['P', 'A'], ['I', 'S']];
        (0..3)
            .map(|axis| {
                let column = self.linear.column(axis);
                let world = column.iamax();
                LETTERS[world][usize::from(column[world] > 0.0)]
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn index_and_place_are_inverse() {
        let turn = nalgebra::Rotation3::from_euler_angles(0.1, -0.2, 0.3).into_inner();
        let affine = Affine::from_parts(turn * 1.5, Vector3::new(-100.0, 20.0, 3.0)).unwrap();
        let index = Point3::new(3.25, -7.0, 11.5);
        assert!((affine.index_of(affine.apply(index)) - index).norm() < 1e-12);
        assert!(affine.spacing().iter().all(|s| (s - 1.5).abs() < 1e-12));
        assert_eq!(affine.axis_codes(), "RAS");
    }

    #[test]
    fn shifting_moves_the_first_voxel() {
        let affine = Affine::from_spacing([-2.0, 3.0, 4.0], [1.0, 1.0, 1.0]).unwrap();
        let cropped = affine.shifted(Vector3::new(1.0, 2.0, 3.0));
        assert_eq!(cropped.origin(), affine.apply(Point3::new(1.0, 2.0, 3.0)));
        assert_eq!(cropped.axis_codes(), "LAS");
        assert!(cropped.determinant() < 0.0);
    }

    #[test]
    fn flat_and_nan_maps_are_refused() {
        assert!(matches!(Affine::from_spacing([1.0, 0.0, 1.0], [0.0; 3]), Err(AffineError::Singular { .. })));
        let mut matrix = Matrix4::identity();
        matrix[(1, 3)] = f64::NAN;
        let error = Affine::new(&matrix).unwrap_err();
        assert!(error.to_string().contains("(1, 3)"), "{error}");
    }
}
