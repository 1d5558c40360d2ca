//! A whole run in one file, a mesh per organ and cut epoch whose frames are morph targets, written frame by frame.
//!
//! Between frames vertices move straight from place to place, so playback is smooth at any rate. Where an organ's triangles
//! change (a blade went through), a new mesh takes its place; so it does after [`MOST_TARGETS`] frames, because viewers keep
//! all targets of a mesh in one texture and each key of the animation holds a weight for each target.
//!
//! A target moves places and normals. What else a vertex has is that of the mesh's first frame: labels, HU and colours;
//! displacements, strains and speeds, which are those of one moment, are left out.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;

use gltf_json::accessor::{ComponentType, Type};
use gltf_json::animation::{Interpolation, Property};
use gltf_json::mesh::MorphTarget;
use gltf_json::{Animation, Index, Mesh, Node};

use super::document::{self, DocumentWriter, accessor, node};
use super::step_animation::{check_time, middle};
use super::vertices::{Precision, bounds, place, unit_normal};
use crate::io::encode::push_f32;
use crate::io::mesh_error::WriteMeshError;
use crate::surface::mesh::{OrganMesh, TriangleMesh};

/// Targets of one mesh.
const MOST_TARGETS: usize = 63;

/// Writes an animation frame by frame; the file appears at [`finish`](MorphAnimationWriter::finish), whole, or never.
///
/// Memory holds one copy of each organ's first mesh of its epoch and the JSON (about 1 kB per frame and organ), not the frames.
/// The last frame is shown as long as the one before.
pub struct MorphAnimationWriter {
    document: DocumentWriter,
    times: Vec<f64>,
    /// What each organ is shown by now.
    current: BTreeMap<String, Current>,
    epochs: Vec<Epoch>,
    /// Middle of the first frame, glTF axes [m], to which hidden meshes shrink.
    middle: Option<[f32; 3]>,
}

/// The mesh that later frames of an organ are targets of, as stored.
struct Current {
    epoch: usize,
    triangles: Vec<[u32; 3]>,
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
}

/// A mesh and its frames.
struct Epoch {
    node: Index<Node>,
    mesh: Index<Mesh>,
    /// Its first frame, which is the mesh itself.
    first: usize,
    /// Later frames, each a target.
    targets: usize,
    /// The frame that no longer shows it.
    hidden: Option<usize>,
}

impl MorphAnimationWriter {
    /// Begins an animation that will be at `path`.
    ///
    /// # Errors
    /// If no temporary file can be made in the folder of `path`.
    pub fn create(path: &Path) -> Result<Self, WriteMeshError> {
        let (times, epochs) = (Vec::new(), Vec::new());
        let document = DocumentWriter::create(path, Precision::Float)?;
        Ok(Self { document, times, current: BTreeMap::new(), epochs, middle: None })
    }

    /// Adds a frame at a time [s]. An organ is known by its name; one without triangles is left out of the frame.
    ///
    /// # Errors
    /// As [`StepAnimationWriter::push_frame`](super::StepAnimationWriter::push_frame).
    pub fn push_frame(&mut self, time: f64, organs: &[OrganMesh]) -> Result<(), WriteMeshError> {
        let frame = self.times.len();
        check_time(self.document.path(), frame, time, self.times.last().copied())?;
        self.document.check(organs)?;
        if self.middle.is_none() {
            self.middle = middle(organs);
            self.document.set_origin(self.middle.unwrap_or_default());
        }
        let filled = || organs.iter().filter(|organ| !organ.mesh.triangles.is_empty());
        let (epochs, current) = (&mut self.epochs, &mut self.current);
        current.retain(|name, current| {
            let stays = filled().any(|organ| organ.name == *name);
            if !stays {
                epochs[current.epoch].hidden = Some(frame);
            }
            stays
        });
        for organ in filled() {
            self.push_organ(frame, organ).map_err(|source| self.document.tear(source))?;
        }
        self.times.push(time);
        Ok(())
    }

    /// Frames so far.
    pub fn len(&self) -> usize {
        self.times.len()
    }

    /// True before the first frame.
    pub fn is_empty(&self) -> bool {
        self.times.is_empty()
    }

    /// Writes the file.
    ///
    /// # Errors
    /// If no frame has a triangle, a frame could not be written whole, the file would exceed 4 GiB, or it cannot be written.
    pub fn finish(mut self) -> Result<(), WriteMeshError> {
        let nodes = self.epochs.iter().map(|epoch| epoch.node).collect();
        let animation = if self.times.len() > 1 {
            Some(self.animation().map_err(|source| self.document.tear(source))?)
        } else {
            None
        };
        // An organ that never moves and is always there has no channel, and an animation without channels is not allowed.
        self.document.finish(nodes, animation.filter(|animation| !animation.channels.is_empty()))
    }

    fn push_organ(&mut self, frame: usize, organ: &OrganMesh) -> io::Result<()> {
        let mesh = &organ.mesh;
        let Some(current) = self.current.get(&organ.name).filter(|current| current.goes_on_as(mesh)) else {
            if let Some(current) = self.current.get(&organ.name) {
                self.epochs[current.epoch].hidden = Some(frame);
            }
            return self.begin(frame, organ);
        };
        let origin = self.document.origin();
        let (count, base) = (mesh.positions.len(), &current.positions);
        let moved = |vertex: usize| difference(place(mesh.positions[vertex], origin), base[vertex]);
        let positions = self.document.vectors(count, bounds(count, moved), moved)?;
        let base = &current.normals;
        let turned = |vertex: usize| difference(unit_normal(mesh.normals[vertex]), base[vertex]);
        let normals = if base.is_empty() { None } else { Some(self.document.vectors(count, None, turned)?) };
        let epoch = &mut self.epochs[current.epoch];
        epoch.targets += 1;
        let target = MorphTarget { positions: Some(positions), normals, tangents: None };
        let primitive = &mut self.document.root().meshes[epoch.mesh.value()].primitives[0];
        primitive.targets.get_or_insert_default().push(target);
        if epoch.targets == MOST_TARGETS {
            epoch.hidden = Some(frame);
            return self.begin(frame, organ);
        }
        Ok(())
    }

    /// Adds a mesh that an organ is shown by from a frame on.
    fn begin(&mut self, frame: usize, organ: &OrganMesh) -> io::Result<()> {
        let origin = self.document.origin();
        let OrganMesh { name, mesh, .. } = organ;
        let lasting =
            TriangleMesh { displacements: Vec::new(), strains: Vec::new(), speeds: Vec::new(), ..mesh.clone() };
        let (attributes, _) = self.document.push_vertices(&lasting, origin, Precision::Float)?;
        let index = self.document.push_primitive(organ, attributes, None)?;
        let mut shown = node(format!("{name} from frame {frame}"), Some(index), None);
        shown.translation = self.middle;
        if frame > 0 {
            shown.scale = Some([0.0; 3]);
        }
        let node = self.document.root().push(shown);
        let current = Current {
            epoch: self.epochs.len(),
            triangles: mesh.triangles.clone(),
            positions: mesh.positions.iter().map(|&position| place(position, origin)).collect(),
            normals: mesh.normals.iter().map(|&normal| unit_normal(normal)).collect(),
        };
        self.current.insert(name.clone(), current);
        self.epochs.push(Epoch { node, mesh: index, first: frame, targets: 0, hidden: None });
        Ok(())
    }

    fn animation(&mut self) -> io::Result<Animation> {
        let times: Vec<f32> = self.times.iter().map(|&time| time as f32).collect();
        let last = times.len() - 1;
        let end = times[last] + (times[last] - times[last - 1]);
        let mut animation = document::animation();
        for &Epoch { node, first, targets, hidden, .. } in &self.epochs {
            if targets > 0 {
                let mut keys = times[first..=first + targets].to_vec();
                if first + targets == last {
                    keys.push(end);
                }
                let interpolation = Interpolation::Linear;
                let property = Property::MorphTargetWeights;
                self.document.channel(&mut animation, node, property, interpolation, &keys, |document| {
                    let count = keys.len();
                    let view = document.view(count, None, None, |range, bytes| {
                        for key in range {
                            let shown = key.min(targets);
                            (1..=targets).for_each(|target| push_f32(bytes, [f32::from(target == shown)]));
                        }
                    })?;
                    let weights = accessor(view, ComponentType::F32, Type::Scalar, count * targets);
                    Ok(document.root().push(weights))
                })?;
            }
            let mut keys = vec![(times[first], 1.0)];
            if first > 0 {
                keys.insert(0, (times[0], 0.0));
            }
            match hidden {
                Some(frame) => keys.push((times[frame], 0.0)),
                // The last frame lasts.
                None if first > 0 => keys.push((end, 1.0)),
                None => {}
            }
            if keys.len() > 1 {
                self.document.visibility(&mut animation, node, &keys)?;
            }
        }
        Ok(animation)
    }
}

impl Current {
    /// True when a mesh has the same triangles and can be a target.
    fn goes_on_as(&self, mesh: &TriangleMesh) -> bool {
        self.positions.len() == mesh.positions.len()
            && self.normals.len() == mesh.normals.len()
            && self.triangles == mesh.triangles
    }
}

fn difference(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [0, 1, 2].map(|axis| a[axis] - b[axis])
}
