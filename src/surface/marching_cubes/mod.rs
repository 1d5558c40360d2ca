//! Marching cubes that knows which springs were severed.
//!
//! The surface crosses a cell edge between an inside and an outside point, and twice, once per side, where a cut went through.
//! What joins the crossings on a face is decided by the springs of that face alone, so that the two cells at the face
//! agree and the surface is closed and manifold by construction, whatever was severed. Cells without a dead spring come
//! from a table of 256 cases that the same rules filled.
//!
//! Not guaranteed: that triangles keep apart in space. Around a clean blade about one triangle in 400 touches another
//! one of the opposite lip (by a few hundredths of a cell); the lips of a ragged cut may pass through each other.
//!
//! # Source
//! Lorensen and Cline, Marching cubes: a high resolution 3D surface construction algorithm, 1987 (the idea); Schroeder,
//! Maynard and Geveci, Flying edges, 2015 (counting along rows). The rules for severed springs are this project's.

pub(crate) mod bits;
pub(crate) mod cell;
pub(crate) mod cube;
pub(crate) mod face;
pub(crate) mod sweep;
pub(crate) mod table;

use super::SurfaceError;
use super::mesh::TriangleMesh;
use super::normals::{Layers, Sheet, vertex_normals};
use super::seam::Seam;
use crate::geometry::{Affine, GridShape};
use bits::InsideBits;
use sweep::{LayeredTriangles, Numbering};

/// The surface of a field without a lattice: where `values` (shape `[nz, ny, nx]`, x fastest) pass through zero.
///
/// Points above zero are inside; everything beyond the grid is outside, half a cell from the border points. NaN is outside.
/// The mesh is closed, manifold and looks outward (counter-clockwise in RAS+, whatever the handedness of `affine`);
/// diagonal neighbours on a face are joined. Positions are RAS+ \[mm\], normals are area-weighted.
///
/// # Errors
/// If the number of values is not the number of grid points, or the mesh would need more than 2^32 vertices or triangles.
pub fn marching_cubes(shape: GridShape, affine: &Affine, values: &[f32]) -> Result<TriangleMesh, SurfaceError> {
    if values.len() != shape.len() {
        return Err(SurfaceError::FieldLength { found: values.len(), expected: shape.len(), shape });
    }
    let surface = PlainSurface::new(shape, values, affine.determinant() < 0.0)?;
    let (axes, origin) = (affine.linear(), affine.origin().coords);
    let positions = surface.positions(values, |index| {
        let place = axes * nalgebra::Vector3::from(index) + origin;
        [place.x as f32, place.y as f32, place.z as f32]
    });
    let triangles = surface.drawn.triangles;
    let layers = Layers { vertices: &surface.numbering.layers, triangles: &surface.drawn.layers };
    let normals = vertex_normals(&positions, &triangles, layers, |_| Sheet::Skin);
    Ok(TriangleMesh { positions, triangles, normals, ..TriangleMesh::default() })
}

/// Positions and triangles of a surface.
pub(crate) type Triangles = (Vec<[f32; 3]>, Vec<[u32; 3]>);

/// The surface of a field in the indices of its grid, without normals.
pub(crate) fn surface_in_cells(shape: GridShape, values: &[f32]) -> Result<Triangles, SurfaceError> {
    let surface = PlainSurface::new(shape, values, false)?;
    Ok((surface.positions(values, |index| index.map(|i| i as f32)), surface.drawn.triangles))
}

/// The surface of a field before its vertices have places.
struct PlainSurface {
    bits: InsideBits,
    numbering: Numbering,
    drawn: LayeredTriangles,
}

impl PlainSurface {
    fn new(shape: GridShape, values: &[f32], flip: bool) -> Result<Self, SurfaceError> {
        let seam = Seam::none();
        let bits = InsideBits::new(shape, values, None);
        let numbering = Numbering::new(&bits, &seam)?;
        let drawn = sweep::triangles(&bits, &seam, &numbering, flip)?;
        Ok(Self { bits, numbering, drawn })
    }

    /// Places of the vertices, from their fractional grid indices.
    fn positions(&self, values: &[f32], place: impl Fn([f64; 3]) -> [f32; 3] + Sync) -> Vec<[f32; 3]> {
        sweep::crossing_values(&self.bits, values, &self.numbering, |crossing| {
            let mut index = crossing.low.map(|i| i as f64 - 1.0);
            let t = f64::from(crossing.t);
            index[crossing.axis] += if crossing.upward { t } else { 1.0 - t };
            place(index)
        })
    }
}
