//! glTF 2.0: what web viewers, Blender and game engines open. One binary file (`.glb`), or JSON (`.gltf`) with its buffer
//! beside it (`.bin`).
//!
//! Patient space, RAS+ [mm], becomes glTF's metres with +Y up and +Z to the viewer by one rotation, so that nothing is
//! mirrored: head is +Y, front is +Z, left is +X. A patient who faces the viewer stands upright, as in a mirrorless photograph.
//! Each organ is a mesh with its name and a material by its finish; colours of vertices are `COLOR_0` (linear), and what
//! else a vertex has travels as custom attributes: `_LABEL`, `_DISPLACEMENT` [m], `_HU` [HU], `_STRAIN`, `_SPEED` [m/s].
//! A mesh whose vertices have one label holds it once, as `extras.label`: Blender 5.0's importer keeps custom attributes in a set
//! without an order, and stops on some of its starts when there are two of different width.
//!
//! An animation is, in steps, one mesh per frame and organ, shown by step changes of its node's scale between 0 and 1, which
//! the standard names as the way to animate visibility (glTF 2.0, section 3.5.2, on zero scale): every viewer that was tried
//! shows it right. As morph targets ([`MorphAnimationWriter`]) playback is smooth, and the file smaller where frames between
//! cuts are many; three.js and Blender show them right, f3d does not.
//!
//! Not guaranteed: millimetres come back within single precision (relative 2e-7), because metres are stored.

mod container;
mod document;
mod material;
mod morph_animation;
mod read;
mod step_animation;
mod vertices;

use std::path::Path;

pub use morph_animation::MorphAnimationWriter;
pub use read::GltfReader;
pub use step_animation::StepAnimationWriter;
pub use vertices::{Precision, quantization_error_mm};

use super::mesh_error::{WriteMeshError, check_organs};
use crate::surface::mesh::OrganMesh;

const FORMAT: &str = "glTF";
const MAGIC: u32 = u32::from_le_bytes(*b"glTF");
const VERSION: u32 = 2;
const CHUNK_JSON: u32 = u32::from_le_bytes(*b"JSON");
const CHUNK_BIN: u32 = u32::from_le_bytes(*b"BIN\0");

/// Turns a direction from patient axes (right, front, head) to glTF axes (left, head, front).
fn to_gltf([x, y, z]: [f64; 3]) -> [f64; 3] {
    [-x, z, y]
}

/// Turns a direction back: [`to_gltf`] is a half turn, hence its own inverse.
fn from_gltf(direction: [f64; 3]) -> [f64; 3] {
    to_gltf(direction)
}

/// Writes organ meshes: a node, a mesh and a material for each organ that has triangles; as JSON and a buffer when the
/// path ends in `.gltf`, else as GLB.
///
/// # Errors
/// If the meshes are inconsistent, not finite or empty, exceed the 4 GiB a GLB can hold, or a file cannot be written.
pub fn write_gltf(path: &Path, organs: &[OrganMesh], precision: Precision) -> Result<(), WriteMeshError> {
    check_organs(path, organs)?;
    document::write_organs(path, organs, precision)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Matrix3;

    #[test]
    fn the_axes_turn_without_mirroring() {
        let columns = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|axis| to_gltf(axis).into());
        let turn = Matrix3::from_columns(&columns);
        assert_eq!(turn.determinant(), 1.0);
        assert_eq!(to_gltf([0.0, 0.0, 1.0]), [0.0, 1.0, 0.0], "head is up");
        assert_eq!(to_gltf([0.0, 1.0, 0.0]), [0.0, 0.0, 1.0], "front is toward the viewer");
        assert_eq!(to_gltf([-1.0, 0.0, 0.0]), [1.0, 0.0, 0.0], "left is +X");
        assert_eq!(from_gltf(to_gltf([1.0, 2.0, 3.0])), [1.0, 2.0, 3.0]);
    }
}
