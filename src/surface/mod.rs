//! From the lattice to a surface: extraction, carrying, checking.
//!
//! ```text
//! field       a value per grid point, above zero in tissue
//! extract     once per cut epoch: crossings -> triangles, and for each vertex the particles that carry it
//! carry       once per frame: displacements of the particles -> a TriangleMesh
//! fine        the same from the CT at its own resolution, carried by a coarser lattice
//! interfaces  all organs at once, their walls drawn once and shared
//! sharp_edges two vertices where one serves both sides of a sharp edge
//! check       is a mesh closed, manifold, oriented; its area, volume and parts
//! ```
//! [`marching_cubes()`] is the same machinery for a plain field without a lattice.

mod blade;
pub mod care;
pub mod check;
mod embed;
mod extract;
pub mod field;
pub mod field_normals;
pub mod fine;
mod gaps;
pub(crate) mod gradient;
pub(crate) mod hinged;
pub mod interfaces;
mod junction;
mod marching_cubes;
pub mod mesh;
mod normals;
mod rim;
mod rim_edges;
mod rim_line;
mod seam;
pub mod sharp_edges;
pub mod smooth;
pub mod weld;

pub use extract::Surface;
pub use marching_cubes::marching_cubes;
pub use normals::Sheet;

use crate::geometry::GridShape;

/// Why a surface could not be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SurfaceError {
    /// The field does not fit the grid.
    #[error(
        "the field has {found} values, but a grid of {shape} points needs {expected}: sample it on the lattice's grid"
    )]
    FieldLength {
        /// Values given.
        found: usize,
        /// Values needed.
        expected: usize,
        /// Grid points along each axis.
        shape: GridShape,
    },
    /// Vertex numbers are 32 bits wide.
    #[error("the surface needs more than {} vertices or triangles; crop the volume or take a coarser pitch", u32::MAX)]
    TooManyVertices,
    /// Fewer or better triangles cannot be had.
    #[error(transparent)]
    Care(#[from] care::CareError),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_name_what_was_found_and_what_to_do() {
        let error = SurfaceError::FieldLength { found: 7, expected: 24, shape: GridShape::new(2, 3, 4) };
        let text = error.to_string();
        assert!(text.contains('7') && text.contains("24") && text.contains("2x3x4"), "{text}");
        assert!(SurfaceError::TooManyVertices.to_string().contains("coarser"));
    }
}
