//! Pictures of meshes, drawn here: no graphics card, the same bits at any number of threads.
//!
//! ```text
//! camera     a direction, what must be in the picture, and the projection
//! drawing    organ meshes checked and projected
//! raster     bins of triangles; per tile a buffer of depths and triangles, eight samples in every pixel
//! light      the colour of a point: three lights, the sky, a wet or a dry surface, lines
//! occlusion  darkens creases, from the depths of the finished picture
//! finish     outlines of sections, background, tone and sRGB
//! annotate   letters of the sides and a scale bar
//! cubes      the lattice as the paper draws it, voxel by voxel
//! normals    for meshes that bring none
//! ```
//! Everything opaque; no shadows. A triangle within a thousandth of the framed size of the eye, or a million pixels off
//! the picture, is left out: neither happens to what a camera frames.

pub mod annotate;
pub mod camera;
pub mod cubes;
mod drawing;
mod finish;
mod light;
pub mod normals;
mod occlusion;
mod raster;

use image::RgbaImage;

use crate::geometry::{Point3, Vector3};
use crate::surface::mesh::OrganMesh;
use camera::Camera;
use drawing::Drawing;

/// Why a picture cannot be drawn.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// Nothing to see.
    #[error("nothing to draw: no mesh has a triangle; check that the organs asked for have voxels in this frame")]
    Empty,
    /// The picture's size.
    #[error(
        "a picture of {width} x {height} pixels cannot be drawn; expected sides from 16 to 8192 and at most 7680 x 4320 in all"
    )]
    Size {
        /// Pixels per row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// A number of the camera.
    #[error("{what} is {found}, expected {expected}")]
    Camera {
        /// Which number.
        what: &'static str,
        /// Its value.
        found: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// A clip plane without direction.
    #[error(
        "the clip plane has point {point:?} and normal {normal:?}; expected finite numbers and a normal that is not zero"
    )]
    ClipPlane {
        /// Its point [mm].
        point: [f64; 3],
        /// Its normal.
        normal: [f64; 3],
    },
    /// NaN or infinite.
    #[error("`{organ}`: {what} {at} is {found:?}, not finite; the state that gave it diverged, or the file is damaged")]
    NotFinite {
        /// The mesh.
        organ: String,
        /// Which of its arrays.
        what: &'static str,
        /// Which entry, from 0.
        at: usize,
        /// What it holds.
        found: [f32; 3],
    },
    /// Arrays that do not fit each other.
    #[error("`{organ}`: {found} {what}, expected {expected}; the mesh is not whole")]
    Mismatch {
        /// The mesh.
        organ: String,
        /// What does not fit.
        what: &'static str,
        /// What there is.
        found: usize,
        /// What there must be.
        expected: usize,
    },
    /// A triangle names a vertex that does not exist.
    #[error("`{organ}`: triangle {triangle} uses vertex {found}, but there are {vertices}; the mesh is not whole")]
    VertexIndex {
        /// The mesh.
        organ: String,
        /// Which triangle, from 0.
        triangle: usize,
        /// The vertex it names.
        found: u32,
        /// Vertices of the mesh.
        vertices: usize,
    },
    /// More than the picture's buffers can number.
    #[error("{found} {what} are more than can be drawn at once ({limit}); draw fewer organs")]
    TooMany {
        /// What there is too much of.
        what: &'static str,
        /// How many.
        found: usize,
        /// The most there may be.
        limit: usize,
    },
}

/// What lies behind the organs.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub enum Background {
    /// A light grey that darkens a little downwards.
    #[default]
    Gradient,
    /// One colour, linear RGB in 0..=1.
    Plain([f32; 3]),
    /// Nothing: the picture has an alpha channel.
    Transparent,
}

/// Which edges of triangles are drawn as lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Lines {
    /// None.
    #[default]
    None,
    /// All: a wireframe on the lit surface, which hides what is behind it.
    Triangles,
    /// Those round each pair of triangles (a, b, c), (a, c, d): the faces of [`cubes`].
    Quads,
}

/// A plane that opens what is drawn: the side of the normal is taken away, and the cut through a closed mesh is filled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClipPlane {
    /// A point on it, RAS+ [mm].
    pub point: [f64; 3],
    /// Towards what is taken away, RAS+; of any length but zero.
    pub normal: [f64; 3],
}

/// How a picture looks.
#[derive(Debug, Clone, PartialEq)]
pub struct Look {
    /// What lies behind.
    pub background: Background,
    /// Lines on the surfaces.
    pub lines: Lines,
    /// Whether creases and contacts are darkened.
    pub occlusion: bool,
    /// Opens what is drawn.
    pub clip: Option<ClipPlane>,
}

impl Default for Look {
    fn default() -> Self {
        Self { background: Background::default(), lines: Lines::default(), occlusion: true, clip: None }
    }
}

/// Draws organ meshes.
///
/// Per-vertex `colors` win over the organ's `color`. Vertices without normal are shaded flat (see [`normals::creased`]).
/// With a clip plane each closed mesh is filled where the plane goes through it, ray by ray; along rays where a mesh is
/// open, its inside is seen instead. Back faces are drawn darker.
///
/// # Errors
/// If there is nothing to draw, a mesh is not whole or not finite, or the plane has no direction.
pub fn render(organs: &[OrganMesh], camera: &Camera, look: &Look) -> Result<RgbaImage, RenderError> {
    let plane = look.clip.map(|clip| checked(&clip, camera)).transpose()?;
    let drawing = Drawing::new(organs, camera, plane.as_ref())?;
    let mut pixels = raster::draw(&drawing, camera, plane.as_ref(), look.lines);
    if look.occlusion {
        occlusion::darken(&mut pixels, camera);
    }
    if plane.is_some() {
        finish::outline(&mut pixels, camera.size());
    }
    Ok(finish::develop(&pixels, camera.size(), look.background))
}

fn checked(&ClipPlane { point, normal }: &ClipPlane, camera: &Camera) -> Result<camera::ViewPlane, RenderError> {
    let direction = Vector3::from(normal);
    let usable = point.iter().all(|x| x.is_finite()) && direction.norm().is_normal();
    if usable {
        Ok(camera.view_plane(Point3::from(point), direction))
    } else {
        Err(RenderError::ClipPlane { point, normal })
    }
}
