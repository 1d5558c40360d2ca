//! Triangle meshes as they are handed to the writers.

/// A triangle mesh in patient space.
///
/// Attributes are per vertex and either empty or as long as `positions`. Triangles run counter-clockwise seen from
/// outside (right-hand rule in RAS+).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TriangleMesh {
    /// Vertices, RAS+ [mm]. Shape `[vertices, 3]`.
    pub positions: Vec<[f32; 3]>,
    /// Corners of each triangle. Shape `[triangles, 3]`.
    pub triangles: Vec<[u32; 3]>,
    /// Unit normals, outward. Shape `[vertices, 3]` or empty.
    pub normals: Vec<[f32; 3]>,
    /// Label of the tissue under each vertex. Shape `[vertices]` or empty.
    pub labels: Vec<u16>,
    /// Displacement from rest, RAS+ [mm]. Shape `[vertices, 3]` or empty.
    pub displacements: Vec<[f32; 3]>,
    /// The CT at the rest place of each vertex [HU]. Shape `[vertices]` or empty.
    pub hu: Vec<f32>,
    /// Equivalent strain of the tissue under each vertex, without unit. Shape `[vertices]` or empty.
    pub strains: Vec<f32>,
    /// Speed of each vertex [mm/s]. Shape `[vertices]` or empty.
    pub speeds: Vec<f32>,
    /// Linear RGB in 0..=1, which takes the place of the organ's colour. Shape `[vertices, 3]` or empty.
    pub colors: Vec<[f32; 3]>,
}

/// How the surface of an organ takes light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Finish {
    /// Soft tissue under a film of liquid: a sharp highlight over a soft body.
    #[default]
    Wet,
    /// Bone: pale and dull.
    Dry,
}

/// A mesh with the name and look of the organ it bounds.
#[derive(Debug, Clone, PartialEq)]
pub struct OrganMesh {
    /// Name of the organ, from the scene.
    pub name: String,
    /// Linear RGB in 0..=1, for formats with materials.
    pub color: [f32; 3],
    /// How it takes light, for formats with materials.
    pub finish: Finish,
    /// The surface.
    pub mesh: TriangleMesh,
}
