//! Reads glTF back: enough to check what was written, and the plain meshes of other programs.
//!
//! Triangles, animations of scale in steps (as visibility) and of morph targets are read, floats or quantised; sparse
//! accessors, buffers that are no file beside the JSON, skins and other animation are refused or, where they change no rest
//! shape, passed over.

mod animation;
mod primitive;
mod source;

use std::collections::{BTreeMap, HashSet};
use std::path::Path;

use gltf_json::{Index, Node, Root};

use self::animation::Track;
use self::primitive::SMALLEST_VERTEX;
use self::source::Source;
use crate::geometry::{Matrix4, Vector3};
use crate::io::mesh_error::ReadMeshError;
use crate::surface::mesh::OrganMesh;

/// A glTF file opened for reading; frames are read one at a time.
pub struct GltfReader {
    source: Source,
    root: Root,
    /// Scale of each node that is shown and hidden.
    shown: BTreeMap<usize, Track>,
    /// Weights of each node whose mesh changes its shape.
    weights: BTreeMap<usize, Track>,
    /// When something comes into sight or has a new shape [s]; empty for a file that does not animate.
    times: Vec<f32>,
}

impl GltfReader {
    /// Opens a file, by its extension as JSON (`.gltf`) or GLB, and reads all but its meshes.
    ///
    /// # Errors
    /// If the file cannot be read, is no glTF of version 2, ends early, or its chunks or animation contradict themselves.
    pub fn open(path: &Path) -> Result<Self, ReadMeshError> {
        let (source, root) = Source::open(path)?;
        let mut reader = Self { source, root, shown: BTreeMap::new(), weights: BTreeMap::new(), times: Vec::new() };
        reader.read_animations()?;
        Ok(reader)
    }

    /// Number of frames; 1 for a file that does not animate.
    pub fn frames(&self) -> usize {
        self.times.len().max(1)
    }

    /// When a frame comes into sight [s]; `None` for a file that does not animate, or past the last frame.
    pub fn time(&self, frame: usize) -> Option<f64> {
        self.times.get(frame).map(|&time| f64::from(time))
    }

    /// The meshes in sight in a frame, in the shape they have then, RAS+ [mm], in the order of the scene; a mesh of several primitives is joined.
    ///
    /// # Errors
    /// If there is no such frame, the file cannot be read, contradicts itself, or holds what this reader does not handle.
    pub fn read_frame(&mut self, frame: usize) -> Result<Vec<OrganMesh>, ReadMeshError> {
        if frame >= self.frames() {
            return Err(self.source.malformed(format!("it has {} frames, not a frame {frame}", self.frames())));
        }
        let time = self.times.get(frame).copied();
        let scene = self.root.scene.unwrap_or_else(|| Index::new(0));
        let Some(scene) = self.root.get(scene) else {
            return Err(self.source.malformed("it has no scene"));
        };
        let mut waiting: Vec<(Index<Node>, Matrix4)> =
            scene.nodes.iter().rev().map(|&node| (node, Matrix4::identity())).collect();
        let (mut seen, mut organs, mut vertices) = (HashSet::new(), Vec::new(), 0);
        while let Some((index, parent)) = waiting.pop() {
            let Some(node) = self.root.get(index).cloned() else {
                return Err(self.source.malformed(format!("node {} does not exist", index.value())));
            };
            if !seen.insert(index.value()) {
                return Err(self.source.malformed(format!("node {} is in the scene twice", index.value())));
            }
            let Some(local) = self.transform(index, &node, time) else { continue };
            let world = parent * local;
            if let Some(mesh) = node.mesh {
                let weights = self.weights(index, &node, time);
                let organ = self.organ(mesh, &node, &world, weights)?;
                vertices += organ.mesh.positions.len() as u64;
                // Meshes shown many times would take more memory than the file has bytes.
                if SMALLEST_VERTEX * vertices > self.source.bytes() {
                    return Err(self
                        .source
                        .unsupported("a mesh shown several times at once", "write a mesh for each node"));
                }
                organs.push(organ);
            }
            waiting.extend(node.children.iter().flatten().rev().map(|&child| (child, world)));
        }
        Ok(organs)
    }

    /// A node's own transform, or `None` when it is hidden at this time.
    fn transform(&self, index: Index<Node>, node: &Node, time: Option<f32>) -> Option<Matrix4> {
        let scale = self.scale(index, node, time);
        if scale == [0.0; 3] {
            return None;
        }
        if let Some(matrix) = node.matrix {
            return Some(Matrix4::from_column_slice(&matrix.map(f64::from)));
        }
        let [x, y, z, w] = node.rotation.unwrap_or_default().0.map(f64::from);
        let rotation = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
        let translation = Vector3::from(node.translation.unwrap_or_default().map(f64::from));
        Some(
            Matrix4::new_translation(&translation)
                * rotation.to_homogeneous()
                * Matrix4::new_nonuniform_scaling(&Vector3::from(scale.map(f64::from))),
        )
    }
}
