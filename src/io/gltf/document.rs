//! A glTF document under construction: the JSON in memory, the buffer where a [`Buffer`] takes it.
//!
//! The buffer follows the JSON in a GLB, but the JSON is known last. What comes frame by frame is spooled and copied once at the end: in
//! memory or, where it is long, in a nameless temporary file of the target folder, so that nothing is left behind whatever happens. What
//! is there at once is gone through twice instead, for the JSON and for the bytes.

use std::collections::BTreeMap;
use std::io::{self, BufWriter, Seek, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use gltf_json::accessor::{ComponentType, GenericComponentType, Type};
use gltf_json::animation::{Animation, Channel, Interpolation, Property, Sampler};
use gltf_json::buffer::{Stride, Target};
use gltf_json::extras::RawValue;
use gltf_json::mesh::Mode;
use gltf_json::validation::Checked::Valid;
use gltf_json::validation::USize64;
use gltf_json::{Accessor, Index, Material, Mesh, Node, Root, Scene, animation, buffer, mesh};
use tempfile::SpooledTempFile;

use super::container::Container;
use super::material::material;
use super::vertices::{Placing, Precision, largest_size, one_label};
use crate::io::atomic;
use crate::io::encode::{push_f32, write_records};
use crate::io::mesh_error::{WriteMeshError, check_organ};
use crate::surface::mesh::OrganMesh;

/// Bytes of a buffer that stay in memory: one mesh of a million triangles.
const IN_MEMORY: usize = 64 << 20;
/// Lengths in a GLB are 32-bit.
const LIMIT: u64 = u32::MAX as u64;
/// Vertices from which triangles need 32-bit indices: 65535 marks a restart in 16-bit ones.
const SHORT_INDICES: usize = 65_535;
const SPACE: &str = r#"{"unit":"metre","axes":"+X patient left, +Y head, +Z front","patient_space":"RAS+ mm = (-1000 x, 1000 z, 1000 y)","attributes":"_LABEL, or extras.label of a mesh with but one; _DISPLACEMENT m, from rest; _HU HU; _STRAIN 1; _SPEED m/s"}"#;

/// Where the bytes of the buffer go.
pub(super) trait Buffer {
    /// What takes them; `None` where they are only counted.
    fn out(&mut self) -> Option<&mut (dyn Write + Send)>;
}

/// To be copied into the file.
pub(super) struct Spool(BufWriter<SpooledTempFile>);

impl Buffer for Spool {
    fn out(&mut self) -> Option<&mut (dyn Write + Send)> {
        Some(&mut self.0)
    }
}

struct Counted;

impl Buffer for Counted {
    fn out(&mut self) -> Option<&mut (dyn Write + Send)> {
        None
    }
}

struct File<'a>(&'a mut (dyn Write + Send));

impl Buffer for File<'_> {
    fn out(&mut self) -> Option<&mut (dyn Write + Send)> {
        Some(self.0)
    }
}

/// See the module.
pub(super) struct DocumentWriter<B = Spool> {
    path: PathBuf,
    container: Container,
    precision: Precision,
    root: Root,
    buffer: B,
    /// Bytes in it.
    bytes: u64,
    /// The most a file may hold; smaller in tests.
    limit: u64,
    indices: BTreeMap<String, (Vec<[u32; 3]>, Index<Accessor>)>,
    /// Materials by organ, and whether its vertices bring their own colours.
    materials: BTreeMap<(String, bool), Index<Material>>,
    /// What positions are stored relative to, glTF axes [m]; zero unless nodes add it again.
    origin: [f32; 3],
    /// The most organ meshes given at once, with triangles or not.
    offered: usize,
    /// A write failed half-way: the buffer cannot be trusted.
    torn: bool,
}

/// Writes organ meshes that are all there: a node, a mesh and a material for each that has triangles.
///
/// # Errors
/// As [`super::write_gltf`].
pub(super) fn write_organs(path: &Path, organs: &[OrganMesh], precision: Precision) -> Result<(), WriteMeshError> {
    let mut counted = DocumentWriter::new(path, precision, Counted);
    let nodes = counted.push_organs(organs, |organ| organ.name.clone())?;
    let json = counted.json(nodes, None)?;
    let write = |out: &mut (dyn Write + Send)| {
        let written = DocumentWriter::new(path, precision, File(out)).push_meshes(organs, |_| String::new());
        written.map(drop)
    };
    counted.container.write(path, &json, counted.bytes, write).map_err(WriteMeshError::io(path))
}

impl DocumentWriter {
    /// One that spools.
    ///
    /// # Errors
    /// If the folder of `path` cannot be made.
    pub(super) fn create(path: &Path, precision: Precision) -> Result<Self, WriteMeshError> {
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        atomic::make_folder(folder).map_err(WriteMeshError::io(path))?;
        let spool = tempfile::spooled_tempfile_in(IN_MEMORY, folder);
        Ok(Self::new(path, precision, Spool(BufWriter::with_capacity(1 << 20, spool))))
    }

    /// Writes the file: the scene's nodes, and the animation if there is one.
    pub(super) fn finish(
        mut self,
        nodes: Vec<Index<Node>>,
        animation: Option<Animation>,
    ) -> Result<(), WriteMeshError> {
        let json = self.json(nodes, animation)?;
        let Self { path, buffer: Spool(spool), bytes, container, .. } = self;
        let write = |out: &mut (dyn Write + Send)| {
            let mut spool = spool.into_inner().map_err(io::IntoInnerError::into_error)?;
            spool.rewind()?;
            io::copy(&mut spool, out).map(drop)
        };
        container.write(&path, &json, bytes, write).map_err(WriteMeshError::io(&path))
    }
}

impl<B: Buffer> DocumentWriter<B> {
    fn new(path: &Path, precision: Precision, buffer: B) -> Self {
        let mut root = Root::default();
        root.asset.generator = Some(format!("yawara {}", env!("CARGO_PKG_VERSION")));
        if precision == Precision::Quantized {
            root.extensions_used.push("KHR_mesh_quantization".to_owned());
            root.extensions_required.push("KHR_mesh_quantization".to_owned());
        }
        Self {
            path: path.to_path_buf(),
            container: Container::of(path),
            precision,
            root,
            buffer,
            bytes: 0,
            limit: LIMIT,
            indices: BTreeMap::new(),
            materials: BTreeMap::new(),
            origin: [0.0; 3],
            offered: 0,
            torn: false,
        }
    }

    #[cfg(test)]
    pub(super) fn set_limit(&mut self, limit: u64) {
        self.limit = limit;
    }

    /// Stores later positions relative to this place, glTF axes [m]; their nodes must add it as a translation.
    pub(super) fn set_origin(&mut self, origin: [f32; 3]) {
        self.origin = origin;
    }

    pub(super) fn origin(&self) -> [f32; 3] {
        self.origin
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn root(&mut self) -> &mut Root {
        &mut self.root
    }

    /// Refuses meshes that no writer takes, or that have no room in the file.
    pub(super) fn check(&mut self, organs: &[OrganMesh]) -> Result<(), WriteMeshError> {
        organs.iter().try_for_each(|organ| check_organ(&self.path, organ))?;
        self.check_size(organs.iter().map(|organ| largest_size(&organ.mesh)).sum())?;
        self.offered = self.offered.max(organs.len());
        Ok(())
    }

    /// Adds a mesh and a node for every organ that has triangles.
    ///
    /// Nothing is added when a mesh is refused; after an input or output error, the document is torn.
    pub(super) fn push_organs(
        &mut self,
        organs: &[OrganMesh],
        node_name: impl Fn(&OrganMesh) -> String,
    ) -> Result<Vec<Index<Node>>, WriteMeshError> {
        self.check(organs)?;
        self.push_meshes(organs, node_name).map_err(|source| self.tear(source))
    }

    fn push_meshes(
        &mut self,
        organs: &[OrganMesh],
        node_name: impl Fn(&OrganMesh) -> String,
    ) -> io::Result<Vec<Index<Node>>> {
        let mut nodes = Vec::new();
        for organ in organs.iter().filter(|organ| !organ.mesh.triangles.is_empty()) {
            let (mesh, placing) = self.push_mesh(organ)?;
            let mut node = node(node_name(organ), Some(mesh), None);
            if let Some(Placing { translation, scale }) = placing {
                node.translation = Some(translation);
                node.scale = Some([scale; 3]);
            }
            nodes.push(self.root.push(node));
        }
        Ok(nodes)
    }

    /// Remembers that the buffer is not whole.
    pub(super) fn tear(&mut self, source: io::Error) -> WriteMeshError {
        self.torn = true;
        WriteMeshError::Io { path: self.path.clone(), source }
    }

    fn check_size(&self, more: u64) -> Result<(), WriteMeshError> {
        let found = self.bytes.saturating_add(more);
        if found <= self.limit {
            return Ok(());
        }
        Err(WriteMeshError::TooLarge {
            path: self.path.clone(),
            format: "one glTF file",
            what: "bytes",
            found,
            limit: self.limit,
            advice: "write fewer frames or a coarser surface, or one file per frame with {frame} in its name",
        })
    }

    fn push_mesh(&mut self, organ: &OrganMesh) -> io::Result<(Index<Mesh>, Option<Placing>)> {
        let (attributes, placing) = self.push_vertices(&organ.mesh, self.origin, self.precision)?;
        let mesh = self.push_primitive(organ, attributes, None)?;
        Ok((mesh, placing))
    }

    /// Adds the mesh of an organ with attributes that are there already.
    pub(super) fn push_primitive(
        &mut self,
        organ: &OrganMesh,
        attributes: super::vertices::Attributes,
        targets: Option<Vec<mesh::MorphTarget>>,
    ) -> io::Result<Index<Mesh>> {
        let (material, indices) = (self.push_material(organ), self.push_indices(organ)?);
        let extras = one_label(&organ.mesh).map(|label| RawValue::from_string(format!(r#"{{"label":{label}}}"#)));
        let extras = extras.transpose().map_err(io::Error::from)?;
        let (extensions, weights) = (None, None);
        let primitive = mesh::Primitive {
            attributes,
            extensions: None,
            extras: None,
            indices: Some(indices),
            material: Some(material),
            mode: Valid(Mode::Triangles),
            targets,
        };
        let name = Some(organ.name.clone());
        Ok(self.root.push(Mesh { extensions, extras, name, primitives: vec![primitive], weights }))
    }

    /// The organ's material, made once.
    fn push_material(&mut self, organ: &OrganMesh) -> Index<Material> {
        let key = (organ.name.clone(), !organ.mesh.colors.is_empty());
        let root = &mut self.root;
        *self.materials.entry(key).or_insert_with(|| {
            let material = material(organ);
            let used = material.extensions.iter().flat_map(|extensions| extensions.others.keys());
            for extension in used {
                if !root.extensions_used.contains(extension) {
                    root.extensions_used.push(extension.clone());
                }
            }
            root.push(material)
        })
    }

    /// The organ's triangles, written again only when they changed.
    fn push_indices(&mut self, organ: &OrganMesh) -> io::Result<Index<Accessor>> {
        let triangles = &organ.mesh.triangles;
        if let Some((last, indices)) = self.indices.get(&organ.name)
            && last == triangles
        {
            return Ok(*indices);
        }
        let target = Some(Target::ElementArrayBuffer);
        let (component, view) = if organ.mesh.positions.len() < SHORT_INDICES {
            let view = self.view(triangles.len(), target, None, |range, bytes| {
                for corners in &triangles[range] {
                    bytes.extend_from_slice(corners.map(|corner| (corner as u16).to_le_bytes()).as_flattened());
                }
            });
            (ComponentType::U16, view?)
        } else {
            let view = self.view(triangles.len(), target, None, |range, bytes| {
                for corners in &triangles[range] {
                    bytes.extend_from_slice(corners.map(u32::to_le_bytes).as_flattened());
                }
            });
            (ComponentType::U32, view?)
        };
        let indices = self.root.push(accessor(view, component, Type::Scalar, 3 * triangles.len()));
        self.indices.insert(organ.name.clone(), (triangles.clone(), indices));
        Ok(indices)
    }

    /// Adds an accessor of vectors for vertices, with their bounds where the standard wants them.
    pub(super) fn vectors(
        &mut self,
        count: usize,
        bounds: Option<[[f32; 3]; 2]>,
        vector: impl Fn(usize) -> [f32; 3] + Sync,
    ) -> io::Result<Index<Accessor>> {
        let view = self.view(count, Some(Target::ArrayBuffer), None, |range, bytes| {
            range.for_each(|vertex| push_f32(bytes, vector(vertex)));
        })?;
        let mut accessor = accessor(view, ComponentType::F32, Type::Vec3, count);
        if let Some([low, high]) = bounds {
            accessor.min = Some(low.to_vec().into());
            accessor.max = Some(high.to_vec().into());
        }
        Ok(self.root.push(accessor))
    }

    /// Adds records, all of one size, at a multiple of four bytes, where every kind of number may begin.
    pub(super) fn view(
        &mut self,
        count: usize,
        target: Option<Target>,
        stride: Option<usize>,
        encode: impl Fn(Range<usize>, &mut Vec<u8>) + Sync,
    ) -> io::Result<Index<buffer::View>> {
        let padding = self.bytes.next_multiple_of(4) - self.bytes;
        let start = self.bytes + padding;
        let mut record = Vec::new();
        encode(0..count.min(1), &mut record);
        let length = (record.len() * count) as u64;
        if let Some(out) = self.buffer.out() {
            out.write_all(&[0; 4][..padding as usize])?;
            write_records(out, count, &encode)?;
        }
        self.bytes = start + length;
        Ok(self.root.push(buffer::View {
            buffer: Index::new(0),
            byte_length: USize64(length),
            byte_offset: Some(USize64(start)),
            byte_stride: stride.map(Stride),
            name: None,
            target: target.map(Valid),
            extensions: None,
            extras: None,
        }))
    }

    /// Adds a channel of an animation: growing key times [s], and `output`, which adds the accessor of what holds at them.
    pub(super) fn channel(
        &mut self,
        animation: &mut Animation,
        node: Index<Node>,
        property: Property,
        interpolation: Interpolation,
        times: &[f32],
        output: impl FnOnce(&mut Self) -> io::Result<Index<Accessor>>,
    ) -> io::Result<()> {
        let view = self.view(times.len(), None, None, |range, bytes| {
            times[range].iter().for_each(|&time| push_f32(bytes, [time]));
        })?;
        let mut input = accessor(view, ComponentType::F32, Type::Scalar, times.len());
        input.min = times.first().map(|&first| vec![first].into());
        input.max = times.last().map(|&last| vec![last].into());
        let (input, output) = (self.root.push(input), output(self)?);
        let (extensions, extras) = (None, None);
        let sampler = Index::new(animation.samplers.len() as u32);
        animation.samplers.push(Sampler { extensions, extras, input, interpolation: Valid(interpolation), output });
        let target = animation::Target { extensions: None, extras: None, node, path: Valid(property) };
        animation.channels.push(Channel { sampler, target, extensions: None, extras: None });
        Ok(())
    }

    /// Adds the channel that shows and hides a node: its scale is the key's number until the next key.
    pub(super) fn visibility(
        &mut self,
        animation: &mut Animation,
        node: Index<Node>,
        keys: &[(f32, f32)],
    ) -> io::Result<()> {
        let (times, scales): (Vec<f32>, Vec<f32>) = keys.iter().copied().unzip();
        self.channel(animation, node, Property::Scale, Interpolation::Step, &times, |document| {
            let view = document.view(scales.len(), None, None, |range, bytes| {
                scales[range].iter().for_each(|&scale| push_f32(bytes, [scale; 3]));
            })?;
            Ok(document.root.push(accessor(view, ComponentType::F32, Type::Vec3, scales.len())))
        })
    }

    /// The JSON of the whole: the scene's nodes, and the animation if there is one.
    fn json(&mut self, nodes: Vec<Index<Node>>, animation: Option<Animation>) -> Result<Vec<u8>, WriteMeshError> {
        if self.torn {
            return Err(WriteMeshError::Unfinished { path: self.path.clone() });
        }
        if self.root.meshes.is_empty() {
            return Err(WriteMeshError::Empty { path: self.path.clone(), organs: self.offered });
        }
        self.root.animations.extend(animation);
        self.root.buffers.push(buffer(self.bytes, self.container.buffer_uri(&self.path)));
        let extras = RawValue::from_string(SPACE.to_string()).map_err(io::Error::from);
        let extras = Some(extras.map_err(WriteMeshError::io(&self.path))?);
        let scene = self.root.push(Scene { extensions: None, extras, name: Some("yawara".to_string()), nodes });
        self.root.scene = Some(scene);
        let json = self.root.to_vec().map_err(io::Error::from).map_err(WriteMeshError::io(&self.path))?;
        // Headers and padding of a GLB.
        self.check_size(json.len() as u64 + 40)?;
        Ok(json)
    }
}

fn buffer(bytes: u64, uri: Option<String>) -> gltf_json::Buffer {
    gltf_json::Buffer { byte_length: USize64(bytes), name: None, uri, extensions: None, extras: None }
}

pub(super) fn node(name: String, mesh: Option<Index<Mesh>>, children: Option<Vec<Index<Node>>>) -> Node {
    Node { name: Some(name), mesh, children, ..Node::default() }
}

pub(super) fn animation() -> Animation {
    let (channels, samplers) = (Vec::new(), Vec::new());
    Animation { extensions: None, extras: None, channels, name: Some("run".to_string()), samplers }
}

pub(super) fn accessor(view: Index<buffer::View>, component: ComponentType, type_: Type, count: usize) -> Accessor {
    Accessor {
        buffer_view: Some(view),
        byte_offset: None,
        count: USize64::from(count),
        component_type: Valid(GenericComponentType(component)),
        extensions: None,
        extras: None,
        type_: Valid(type_),
        min: None,
        max: None,
        name: None,
        normalized: false,
        sparse: None,
    }
}
