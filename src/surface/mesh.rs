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
}

/// A mesh with the name and look of the organ it bounds.
#[derive(Debug, Clone, PartialEq)]
pub struct OrganMesh {
    /// Name of the organ, from the scene.
    pub name: String,
    /// Linear RGB in 0..=1, for formats with materials.
    pub color: [f32; 3],
    /// The surface.
    pub mesh: TriangleMesh,
}
