//! Reads GLB back: enough to check what was written, and the plain meshes of other programs.
//!
//! Triangles with float positions, and scale animations in steps (as visibility) are read; sparse accessors, external buffers,
//! skins, morph targets and other animation are refused or, where they change no rest shape, passed over.

use std::collections::{BTreeMap, HashSet};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use gltf_json::accessor::{ComponentType, Type};
use gltf_json::animation::{Interpolation, Property};
use gltf_json::mesh::{Mode, Semantic};
use gltf_json::validation::Checked;
use gltf_json::{Accessor, Index, Node, Root, mesh};

use super::{CHUNK_BIN, CHUNK_JSON, FORMAT, MAGIC, VERSION, from_gltf};
use crate::geometry::{Matrix3, Matrix4, Point3, Vector3};
use crate::io::mesh_error::ReadMeshError;
use crate::surface::mesh::{Finish, OrganMesh, TriangleMesh};

/// A GLB opened for reading; frames are read one at a time.
pub struct GlbReader {
    path: PathBuf,
    file: File,
    root: Root,
    /// First byte of the binary chunk in the file, and how many.
    binary: (u64, u64),
    /// Key times [s] and scales of each node that is shown and hidden.
    shown: BTreeMap<usize, Vec<(f32, f32)>>,
    /// When something comes into sight [s]; empty for a file that does not animate.
    times: Vec<f32>,
}

impl GlbReader {
    /// Opens a file and reads all but its meshes.
    ///
    /// # Errors
    /// If the file cannot be read, is no GLB of version 2, ends early, or its chunks or animation contradict themselves.
    pub fn open(path: &Path) -> Result<Self, ReadMeshError> {
        let io = ReadMeshError::io(path);
        let malformed = |what: String| ReadMeshError::malformed(path, FORMAT, what);
        let mut file = File::open(path).map_err(&io)?;
        let length = file.metadata().map_err(&io)?.len();
        let mut words = |at: u64, what: &str| -> Result<[u32; 5], ReadMeshError> {
            let mut bytes = [0; 20];
            if length < at + 20 {
                return Err(malformed(format!("{what} ends at byte {}, the file has {length}", at + 20)));
            }
            file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(&mut bytes)).map_err(&io)?;
            Ok([0, 4, 8, 12, 16].map(|at| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])))
        };
        let [magic, version, total, json_length, json_type] = words(0, "the header")?;
        if magic != MAGIC || version != VERSION {
            return Err(malformed(format!(
                "it begins with {magic:#x}, version {version}; GLB is {MAGIC:#x}, version {VERSION}"
            )));
        }
        if u64::from(total) > length {
            return Err(malformed(format!("its header says {total} bytes, the file has {length}")));
        }
        let json_end = 20 + u64::from(json_length);
        if json_type != CHUNK_JSON || json_end > u64::from(total) {
            return Err(malformed(format!(
                "the first chunk (type {json_type:#x}, {json_length} bytes) is no JSON chunk inside it"
            )));
        }
        let mut binary = (json_end, 0);
        if u64::from(total) >= json_end + 8 {
            // The two words of the chunk's header are the last of these five.
            let [.., bin_length, bin_type] = words(json_end - 12, "the binary chunk's header")?;
            let start = json_end + 8;
            if bin_type == CHUNK_BIN {
                if start + u64::from(bin_length) > u64::from(total) {
                    return Err(malformed(format!("the binary chunk of {bin_length} bytes ends after the file")));
                }
                binary = (start, u64::from(bin_length));
            }
        }
        let mut json = vec![0; json_length as usize];
        file.seek(SeekFrom::Start(20)).and_then(|_| file.read_exact(&mut json)).map_err(&io)?;
        let root = Root::from_slice(&json).map_err(|error| malformed(format!("its JSON: {error}")))?;
        let path = path.to_path_buf();
        let mut reader = Self { path, file, root, binary, shown: BTreeMap::new(), times: Vec::new() };
        reader.read_visibility()?;
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

    /// The meshes in sight in a frame, RAS+ [mm], in the order of the scene; a mesh of several primitives is joined.
    ///
    /// # Errors
    /// If there is no such frame, the file cannot be read, contradicts itself, or holds what this reader does not handle.
    pub fn read_frame(&mut self, frame: usize) -> Result<Vec<OrganMesh>, ReadMeshError> {
        if frame >= self.frames() {
            return Err(self.malformed(format!("it has {} frames, not a frame {frame}", self.frames())));
        }
        let time = self.times.get(frame).copied();
        let scene = self.root.scene.unwrap_or_else(|| Index::new(0));
        let Some(scene) = self.root.get(scene) else {
            return Err(self.malformed("it has no scene"));
        };
        let mut waiting: Vec<(Index<Node>, Matrix4)> =
            scene.nodes.iter().rev().map(|&node| (node, Matrix4::identity())).collect();
        let (mut seen, mut organs, mut vertices) = (HashSet::new(), Vec::new(), 0);
        while let Some((index, parent)) = waiting.pop() {
            let Some(node) = self.root.get(index).cloned() else {
                return Err(self.malformed(format!("node {} does not exist", index.value())));
            };
            if !seen.insert(index.value()) {
                return Err(self.malformed(format!("node {} is in the scene twice", index.value())));
            }
            let Some(local) = self.transform(index, &node, time) else { continue };
            let world = parent * local;
            if let Some(mesh) = node.mesh {
                let organ = self.organ(mesh, &node, &world)?;
                vertices += organ.mesh.positions.len() as u64;
                // Meshes shown many times would take more memory than the file has bytes.
                if 12 * vertices > self.binary.1 {
                    return Err(self.unsupported("a mesh shown several times at once", "write a mesh for each node"));
                }
                organs.push(organ);
            }
            waiting.extend(node.children.iter().flatten().rev().map(|&child| (child, world)));
        }
        Ok(organs)
    }

    fn malformed(&self, what: impl Into<String>) -> ReadMeshError {
        ReadMeshError::malformed(&self.path, FORMAT, what)
    }

    fn unsupported(&self, what: impl Into<String>, advice: &'static str) -> ReadMeshError {
        ReadMeshError::Unsupported { path: self.path.clone(), what: what.into(), advice }
    }

    /// Collects the scale animations that show and hide nodes.
    fn read_visibility(&mut self) -> Result<(), ReadMeshError> {
        let mut keys = 0;
        for animation in self.root.animations.clone() {
            for channel in &animation.channels {
                if !matches!(channel.target.path, Checked::Valid(Property::Scale)) {
                    continue;
                }
                let Some(sampler) = animation.samplers.get(channel.sampler.value()) else {
                    return Err(self.malformed(format!("an animation has no sampler {}", channel.sampler.value())));
                };
                if !matches!(sampler.interpolation, Checked::Valid(Interpolation::Step)) {
                    continue;
                }
                let times = self.numbers::<1>(sampler.input, Type::Scalar)?;
                let scales = self.numbers::<3>(sampler.output, Type::Vec3)?;
                keys += times.len() as u64;
                if times.len() != scales.len() || times.is_empty() || 4 * keys > self.binary.1 {
                    return Err(self.malformed(format!(
                        "an animation has {} times for {} scales",
                        times.len(),
                        scales.len()
                    )));
                }
                let pairs: Vec<_> = times.iter().zip(&scales).map(|(&[time], scale)| (time, scale[0])).collect();
                let mut before = 0.0;
                for &(time, scale) in &pairs {
                    if !time.is_finite() || !scale.is_finite() {
                        return Err(self.malformed(format!("an animation has the key {time} s, scale {scale}")));
                    }
                    if scale > 0.0 && before <= 0.0 {
                        self.times.push(time);
                    }
                    before = scale;
                }
                self.shown.insert(channel.target.node.value(), pairs);
            }
        }
        self.times.sort_by(f32::total_cmp);
        self.times.dedup();
        Ok(())
    }

    /// A node's own transform, or `None` when it is hidden at this time.
    fn transform(&self, index: Index<Node>, node: &Node, time: Option<f32>) -> Option<Matrix4> {
        let mut scale = node.scale.unwrap_or([1.0; 3]);
        if let (Some(time), Some(keys)) = (time, self.shown.get(&index.value())) {
            let after = keys.partition_point(|&(key, _)| key <= time);
            scale = [keys[after.saturating_sub(1)].1; 3];
        }
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

    fn organ(
        &mut self,
        index: Index<gltf_json::Mesh>,
        node: &Node,
        world: &Matrix4,
    ) -> Result<OrganMesh, ReadMeshError> {
        let Some(found) = self.root.get(index).cloned() else {
            return Err(self.malformed(format!("mesh {} does not exist", index.value())));
        };
        let name = found.name.or_else(|| node.name.clone()).unwrap_or_else(|| format!("mesh {}", index.value()));
        let mut organ = OrganMesh { name, color: [1.0; 3], finish: Finish::default(), mesh: TriangleMesh::default() };
        let (mut bare, mut unlabelled, mut unmoved) = (false, false, false);
        for primitive in &found.primitives {
            if let Some(material) = primitive.material.and_then(|material| self.root.get(material)) {
                let [color @ .., _] = material.pbr_metallic_roughness.base_color_factor.0;
                organ.color = color;
            }
            let part = self.primitive(primitive, world)?;
            let first = organ.mesh.positions.len() as u64;
            if first + part.positions.len() as u64 > self.binary.1 / 12 {
                return Err(
                    self.unsupported("vertices shared by several primitives", "write vertices for each primitive")
                );
            }
            bare |= part.normals.is_empty();
            unlabelled |= part.labels.is_empty();
            unmoved |= part.displacements.is_empty();
            let whole = &mut organ.mesh;
            whole.positions.extend(part.positions);
            whole.normals.extend(part.normals);
            whole.labels.extend(part.labels);
            whole.displacements.extend(part.displacements);
            // Below 2^32: the binary chunk is, at 12 bytes each.
            whole.triangles.extend(part.triangles.iter().map(|corners| corners.map(|corner| corner + first as u32)));
        }
        // An attribute that one primitive lacks cannot be kept for the others.
        for (missing, attribute) in [(bare, &mut organ.mesh.normals), (unmoved, &mut organ.mesh.displacements)] {
            if missing {
                attribute.clear();
            }
        }
        if unlabelled {
            organ.mesh.labels.clear();
        }
        Ok(organ)
    }

    fn primitive(&mut self, primitive: &mesh::Primitive, world: &Matrix4) -> Result<TriangleMesh, ReadMeshError> {
        if !matches!(primitive.mode, Checked::Valid(Mode::Triangles)) {
            return Err(self.unsupported(format!("primitive mode {:?}", primitive.mode), "export triangles"));
        }
        let attribute = |semantic: Semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
        let custom = |name: &str| attribute(Semantic::Extras(name.to_string()));
        let linear: Matrix3 = world.fixed_view::<3, 3>(0, 0).into_owned();
        let mirrored = linear.determinant() < 0.0;
        let to_mm = |v: Vector3| from_gltf((v * 1000.0).into()).map(|x| x as f32);

        let Some(positions) = attribute(Semantic::Positions) else {
            return Err(self.malformed("a primitive has no POSITION"));
        };
        let place = |p: [f32; 3]| to_mm(world.transform_point(&Point3::from(p.map(f64::from))).coords);
        let positions: Vec<_> = self.numbers::<3>(positions, Type::Vec3)?.into_iter().map(place).collect();
        if let Some((at, found)) = positions.iter().enumerate().find(|(_, p)| !p.iter().all(|x| x.is_finite())) {
            return Err(self.malformed(format!("vertex {at} is at {found:?} mm, which is not finite")));
        }
        let corners: Vec<u32> = match primitive.indices {
            Some(indices) => self.integers(indices)?,
            None => (0..positions.len() as u32).collect(),
        };
        if let Some(&found) = corners.iter().find(|&&corner| corner as usize >= positions.len()) {
            return Err(self.malformed(format!("a triangle uses vertex {found} of {}", positions.len())));
        }
        if !corners.len().is_multiple_of(3) {
            return Err(self.malformed(format!("{} corners do not make whole triangles", corners.len())));
        }
        let turn = |&[a, b, c]: &[u32; 3]| if mirrored { [a, c, b] } else { [a, b, c] };
        let triangles = corners.as_chunks::<3>().0.iter().map(turn).collect();

        let mut mesh = TriangleMesh { positions, triangles, ..TriangleMesh::default() };
        if let Some(normals) = attribute(Semantic::Normals) {
            let cofactor = linear.try_inverse().unwrap_or_else(Matrix3::identity).transpose();
            let turned = |n: [f32; 3]| {
                let normal = (cofactor * Vector3::from(n.map(f64::from))).try_normalize(0.0).unwrap_or_default();
                from_gltf(normal.into()).map(|x| x as f32)
            };
            mesh.normals = self.numbers::<3>(normals, Type::Vec3)?.into_iter().map(turned).collect();
        }
        if let Some(displacements) = custom("DISPLACEMENT") {
            let moved = |d: [f32; 3]| to_mm(linear * Vector3::from(d.map(f64::from)));
            mesh.displacements = self.numbers::<3>(displacements, Type::Vec3)?.into_iter().map(moved).collect();
        }
        if let Some(labels) = custom("LABEL") {
            let labels = self.integers(labels)?.into_iter().map(u16::try_from).collect::<Result<_, _>>();
            mesh.labels = labels.map_err(|_| self.malformed("a _LABEL is above 65535"))?;
        }
        let expected = mesh.positions.len();
        for (what, found) in
            [("NORMAL", mesh.normals.len()), ("_DISPLACEMENT", mesh.displacements.len()), ("_LABEL", mesh.labels.len())]
        {
            if found != 0 && found != expected {
                return Err(self.malformed(format!("{found} {what} for {expected} vertices")));
            }
        }
        Ok(mesh)
    }

    /// Reads the floats of an accessor, `N` per element.
    fn numbers<const N: usize>(
        &mut self,
        accessor: Index<Accessor>,
        type_: Type,
    ) -> Result<Vec<[f32; N]>, ReadMeshError> {
        let (component, bytes, stride, count) = self.accessor(accessor, type_, N)?;
        if component != ComponentType::F32 {
            return Err(self.unsupported(format!("accessor {} of {component:?}", accessor.value()), "export floats"));
        }
        let number = |at: usize| f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        Ok((0..count).map(|element| std::array::from_fn(|part| number(element * stride + 4 * part))).collect())
    }

    /// Reads the unsigned integers of an accessor.
    fn integers(&mut self, accessor: Index<Accessor>) -> Result<Vec<u32>, ReadMeshError> {
        let (component, bytes, stride, count) = self.accessor(accessor, Type::Scalar, 1)?;
        let starts = (0..count).map(|element| element * stride);
        match component {
            ComponentType::U8 => Ok(starts.map(|at| u32::from(bytes[at])).collect()),
            ComponentType::U16 => {
                Ok(starts.map(|at| u32::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]))).collect())
            }
            ComponentType::U32 => Ok(starts
                .map(|at| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]))
                .collect()),
            _ => {
                Err(self.malformed(format!("accessor {} holds {component:?}, not unsigned integers", accessor.value())))
            }
        }
    }

    /// The bytes of an accessor, checked against its view and the binary chunk: component, bytes, stride, count.
    fn accessor(
        &mut self,
        index: Index<Accessor>,
        type_: Type,
        parts: usize,
    ) -> Result<(ComponentType, Vec<u8>, usize, usize), ReadMeshError> {
        let name = format!("accessor {}", index.value());
        let Some(accessor) = self.root.get(index) else {
            return Err(self.malformed(format!("{name} does not exist")));
        };
        let (Checked::Valid(component), Checked::Valid(found)) = (accessor.component_type, accessor.type_) else {
            return Err(self.malformed(format!("{name} has an unknown type")));
        };
        if found != type_ {
            return Err(self.malformed(format!("{name} holds {found:?}, not {type_:?}")));
        }
        let Some(view) = accessor.buffer_view.filter(|_| accessor.sparse.is_none()) else {
            return Err(self.unsupported(format!("{name} without plain data (sparse)"), "export plain accessors"));
        };
        let Some(view) = self.root.get(view) else {
            return Err(self.malformed(format!("{name} points to a view that does not exist")));
        };
        if view.buffer.value() != 0 || self.root.buffers.first().is_some_and(|buffer| buffer.uri.is_some()) {
            return Err(self.unsupported(format!("{name} in another file"), "export one GLB that holds its own data"));
        }
        let component = component.0;
        let size = (component.size() * parts) as u64;
        let stride = view.byte_stride.map_or(size, |stride| stride.0 as u64);
        let count = accessor.count.0;
        let start = accessor.byte_offset.map_or(0, |offset| offset.0);
        let span = count.checked_sub(1).map_or(Some(0), |last| last.checked_mul(stride)?.checked_add(size));
        let inside = span.and_then(|span| span.checked_add(start)).is_some_and(|end| end <= view.byte_length.0);
        let view_start = view.byte_offset.map_or(0, |offset| offset.0);
        let view_inside = view_start.checked_add(view.byte_length.0).is_some_and(|end| end <= self.binary.1);
        let (true, true, Some(span)) = (inside && stride >= size, view_inside, span) else {
            return Err(self.malformed(format!(
                "{name} ({count} elements of {size} bytes, {stride} apart) reaches outside the {} bytes of the binary chunk",
                self.binary.1
            )));
        };
        let mut bytes = vec![0; span as usize];
        let at = SeekFrom::Start(self.binary.0 + view_start + start);
        let read = self.file.seek(at).and_then(|_| self.file.read_exact(&mut bytes));
        read.map_err(ReadMeshError::io(&self.path))?;
        Ok((component, bytes, stride as usize, count as usize))
    }
}
