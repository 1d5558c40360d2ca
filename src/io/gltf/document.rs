//! A GLB under construction: the JSON in memory, the binary chunk in a nameless temporary file of the target folder.
//!
//! The binary chunk follows the JSON in the file, but the JSON is known last; so bytes are spooled and copied once at the end.
//! The temporary file has no name, so nothing is left behind whatever happens.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

use gltf_json::accessor::{ComponentType, GenericComponentType, Type};
use gltf_json::buffer::{Stride, Target};
use gltf_json::extras::RawValue;
use gltf_json::material::{PbrBaseColorFactor, StrengthFactor};
use gltf_json::mesh::{Mode, Semantic};
use gltf_json::validation::Checked::Valid;
use gltf_json::validation::USize64;
use gltf_json::{Accessor, Animation, Buffer, Index, Material, Mesh, Node, Root, Scene, buffer, mesh};

use super::{CHUNK_BIN, CHUNK_JSON, MAGIC, VERSION, to_gltf};
use crate::io::atomic;
use crate::io::mesh_error::{WriteMeshError, check_organ};
use crate::surface::mesh::{OrganMesh, TriangleMesh};

/// Lengths in a GLB are 32-bit.
const LIMIT: u64 = u32::MAX as u64;
/// Vertices from which triangles need 32-bit indices: 65535 marks a restart in 16-bit ones.
const SHORT_INDICES: usize = 65_535;
/// Neither wet nor dull: what reads as tissue in viewers with plain lights.
const ROUGHNESS: f32 = 0.5;
const SPACE: &str = r#"{"unit":"metre","axes":"+X patient left, +Y head, +Z front","patient_space":"RAS+ mm = (-1000 x, 1000 z, 1000 y)"}"#;

/// See the module.
pub(super) struct DocumentWriter {
    path: PathBuf,
    root: Root,
    spool: BufWriter<File>,
    /// Bytes spooled.
    bytes: u64,
    /// The most a file may hold; smaller in tests.
    limit: u64,
    organs: BTreeMap<String, OrganState>,
    /// What positions are stored relative to, glTF axes [m]; zero unless nodes add it again.
    origin: [f32; 3],
    /// The most organ meshes given at once, with triangles or not.
    offered: usize,
    /// A write failed half-way: the spool cannot be trusted.
    torn: bool,
}

/// What later frames of an organ share with earlier ones.
struct OrganState {
    material: Index<Material>,
    triangles: Vec<[u32; 3]>,
    indices: Option<Index<Accessor>>,
}

impl DocumentWriter {
    pub(super) fn create(path: &Path) -> Result<Self, WriteMeshError> {
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let spool = atomic::make_folder(folder).and_then(|()| tempfile::tempfile_in(folder));
        let spool = BufWriter::with_capacity(1 << 20, spool.map_err(WriteMeshError::io(path))?);
        let mut root = Root::default();
        root.asset.generator = Some(format!("yawara {}", env!("CARGO_PKG_VERSION")));
        let (path, organs) = (path.to_path_buf(), BTreeMap::new());
        Ok(Self { path, root, spool, bytes: 0, limit: LIMIT, organs, origin: [0.0; 3], offered: 0, torn: false })
    }

    #[cfg(test)]
    pub(super) fn set_limit(&mut self, limit: u64) {
        self.limit = limit;
    }

    /// Stores later positions relative to this place, glTF axes [m]; their nodes must add it as a translation.
    pub(super) fn set_origin(&mut self, origin: [f32; 3]) {
        self.origin = origin;
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn root(&mut self) -> &mut Root {
        &mut self.root
    }

    /// Adds a mesh and a node for every organ that has triangles.
    ///
    /// Nothing is added when a mesh is refused; after an input or output error, the document is torn.
    pub(super) fn push_organs(
        &mut self,
        organs: &[OrganMesh],
        node_name: impl Fn(&OrganMesh) -> String,
    ) -> Result<Vec<Index<Node>>, WriteMeshError> {
        organs.iter().try_for_each(|organ| check_organ(&self.path, organ))?;
        self.check_size(organs.iter().map(|organ| largest_size(&organ.mesh)).sum())?;
        self.offered = self.offered.max(organs.len());
        let mut nodes = Vec::new();
        for organ in organs.iter().filter(|organ| !organ.mesh.triangles.is_empty()) {
            let mesh = self.push_mesh(organ).map_err(|source| self.tear(source))?;
            nodes.push(self.root.push(node(node_name(organ), Some(mesh), None)));
        }
        Ok(nodes)
    }

    /// Remembers that the spool is not whole.
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
            format: "one GLB",
            what: "bytes",
            found,
            limit: self.limit,
            advice: "write fewer frames or a coarser surface, or one file per frame with {frame} in its name",
        })
    }

    fn push_mesh(&mut self, organ: &OrganMesh) -> io::Result<Index<Mesh>> {
        let OrganMesh { name, mesh, .. } = organ;
        let to_metres = |v: &[f32; 3]| to_gltf(v.map(|x| f64::from(x) / 1000.0)).map(|x| x as f32);
        let mut attributes = BTreeMap::new();
        let origin = self.origin.map(f64::from);
        let from_origin = |v: &[f32; 3]| {
            let place = to_gltf(v.map(|x| f64::from(x) / 1000.0));
            [0, 1, 2].map(|axis| (place[axis] - origin[axis]) as f32)
        };
        let positions: Vec<[f32; 3]> = mesh.positions.iter().map(from_origin).collect();
        attributes.insert(Valid(Semantic::Positions), self.vectors(&positions, true)?);
        if !mesh.normals.is_empty() {
            let normals: Vec<[f32; 3]> = mesh.normals.iter().map(unit_normal).collect();
            attributes.insert(Valid(Semantic::Normals), self.vectors(&normals, false)?);
        }
        if !mesh.displacements.is_empty() {
            let displacements: Vec<[f32; 3]> = mesh.displacements.iter().map(to_metres).collect();
            let semantic = Semantic::Extras("DISPLACEMENT".to_string());
            attributes.insert(Valid(semantic), self.vectors(&displacements, false)?);
        }
        if !mesh.labels.is_empty() {
            // Vertex attributes start at multiples of four bytes, so a 16-bit label takes four.
            let labels = mesh.labels.iter().map(|label| u32::from(*label).to_le_bytes());
            let view = self.view(labels, Some(Target::ArrayBuffer), Some(Stride(4)))?;
            let accessor = accessor(view, ComponentType::U16, Type::Scalar, mesh.labels.len());
            attributes.insert(Valid(Semantic::Extras("LABEL".to_string())), self.root.push(accessor));
        }
        let (material, indices) = self.material_and_indices(organ)?;
        let primitive = mesh::Primitive {
            attributes,
            extensions: None,
            extras: None,
            indices: Some(indices),
            material: Some(material),
            mode: Valid(Mode::Triangles),
            targets: None,
        };
        let (extensions, extras, weights) = (None, None, None);
        Ok(self.root.push(Mesh { extensions, extras, name: Some(name.clone()), primitives: vec![primitive], weights }))
    }

    /// The organ's material, made once, and its triangles, written again only when they changed.
    fn material_and_indices(&mut self, organ: &OrganMesh) -> io::Result<(Index<Material>, Index<Accessor>)> {
        let triangles = &organ.mesh.triangles;
        if let Some(OrganState { material, triangles: last, indices: Some(indices) }) = self.organs.get(&organ.name)
            && last == triangles
        {
            return Ok((*material, *indices));
        }
        let count = 3 * triangles.len();
        let corners = triangles.iter().flatten();
        let indices = if organ.mesh.positions.len() < SHORT_INDICES {
            let shorts = corners.map(|&corner| (corner as u16).to_le_bytes());
            let view = self.view(shorts, Some(Target::ElementArrayBuffer), None)?;
            accessor(view, ComponentType::U16, Type::Scalar, count)
        } else {
            let view = self.view(corners.map(|corner| corner.to_le_bytes()), Some(Target::ElementArrayBuffer), None)?;
            accessor(view, ComponentType::U32, Type::Scalar, count)
        };
        let indices = self.root.push(indices);
        let root = &mut self.root;
        let state = self.organs.entry(organ.name.clone()).or_insert_with(|| OrganState {
            material: root.push(material(organ)),
            triangles: Vec::new(),
            indices: None,
        });
        state.triangles.clone_from(triangles);
        state.indices = Some(indices);
        Ok((state.material, indices))
    }

    /// Adds an accessor of vectors for vertices, with their bounds where the standard wants them.
    fn vectors(&mut self, vectors: &[[f32; 3]], bounds: bool) -> io::Result<Index<Accessor>> {
        let bytes = vectors.iter().flatten().map(|x| x.to_le_bytes());
        let view = self.view(bytes, Some(Target::ArrayBuffer), None)?;
        let mut accessor = accessor(view, ComponentType::F32, Type::Vec3, vectors.len());
        if bounds {
            let fold = |f: fn(f32, f32) -> f32| {
                vectors.iter().copied().reduce(|a, b| [f(a[0], b[0]), f(a[1], b[1]), f(a[2], b[2])])
            };
            accessor.min = fold(f32::min).map(|v| v.to_vec().into());
            accessor.max = fold(f32::max).map(|v| v.to_vec().into());
        }
        Ok(self.root.push(accessor))
    }

    /// Adds the key times of an animation [s].
    pub(super) fn times(&mut self, times: &[f32]) -> io::Result<Index<Accessor>> {
        let view = self.view(times.iter().map(|time| time.to_le_bytes()), None, None)?;
        let mut accessor = accessor(view, ComponentType::F32, Type::Scalar, times.len());
        accessor.min = times.first().map(|&first| vec![first].into());
        accessor.max = times.last().map(|&last| vec![last].into());
        Ok(self.root.push(accessor))
    }

    /// Adds the key scales of an animation.
    pub(super) fn scales(&mut self, scales: &[f32]) -> io::Result<Index<Accessor>> {
        let bytes = scales.iter().flat_map(|scale| [scale.to_le_bytes(); 3]);
        let view = self.view(bytes, None, None)?;
        Ok(self.root.push(accessor(view, ComponentType::F32, Type::Vec3, scales.len())))
    }

    /// Spools items at a multiple of four bytes, where every kind of number may begin.
    fn view<const N: usize>(
        &mut self,
        items: impl Iterator<Item = [u8; N]>,
        target: Option<Target>,
        byte_stride: Option<Stride>,
    ) -> io::Result<Index<buffer::View>> {
        let padding = self.bytes.next_multiple_of(4) - self.bytes;
        self.spool.write_all(&[0; 4][..padding as usize])?;
        let start = self.bytes + padding;
        self.bytes = start;
        for item in items {
            self.spool.write_all(&item)?;
            self.bytes += N as u64;
        }
        Ok(self.root.push(buffer::View {
            buffer: Index::new(0),
            byte_length: USize64(self.bytes - start),
            byte_offset: Some(USize64(start)),
            byte_stride,
            name: None,
            target: target.map(Valid),
            extensions: None,
            extras: None,
        }))
    }

    /// Writes the file: the scene's nodes, and the animation if there is one.
    pub(super) fn finish(
        mut self,
        nodes: Vec<Index<Node>>,
        animation: Option<Animation>,
    ) -> Result<(), WriteMeshError> {
        if self.torn {
            return Err(WriteMeshError::Unfinished { path: self.path });
        }
        if self.root.meshes.is_empty() {
            return Err(WriteMeshError::Empty { path: self.path, organs: self.offered });
        }
        self.root.animations.extend(animation);
        self.root.buffers.push(Buffer {
            byte_length: USize64(self.bytes),
            name: None,
            uri: None,
            extensions: None,
            extras: None,
        });
        let extras = RawValue::from_string(SPACE.to_string()).map_err(io::Error::from);
        let extras = Some(extras.map_err(WriteMeshError::io(&self.path))?);
        let scene = self.root.push(Scene { extensions: None, extras, name: Some("yawara".to_string()), nodes });
        self.root.scene = Some(scene);
        let json = self.root.to_vec().map_err(io::Error::from).map_err(WriteMeshError::io(&self.path))?;
        let json_length = json.len().next_multiple_of(4);
        let bin_length = self.bytes.next_multiple_of(4);
        let headers = 12 + 8 + 8;
        self.check_size(headers + json_length as u64 + (bin_length - self.bytes))?;
        let total = headers + json_length as u64 + bin_length;

        let Self { path, spool, .. } = self;
        let copy = |writer: &mut BufWriter<File>| -> io::Result<()> {
            let mut spool = spool.into_inner().map_err(io::IntoInnerError::into_error)?;
            spool.rewind()?;
            // The size check above keeps all three within 32 bits.
            for word in [MAGIC, VERSION, total as u32, json_length as u32, CHUNK_JSON] {
                writer.write_all(&word.to_le_bytes())?;
            }
            writer.write_all(&json)?;
            writer.write_all(&b"   "[..json_length - json.len()])?;
            writer.write_all(&(bin_length as u32).to_le_bytes())?;
            writer.write_all(&CHUNK_BIN.to_le_bytes())?;
            let copied = io::copy(&mut spool, writer)?;
            writer.write_all(&[0; 3][..(bin_length - copied) as usize])
        };
        atomic::write_file(&path, copy).map_err(WriteMeshError::io(&path))
    }
}

/// The most bytes a mesh can take in the binary chunk.
fn largest_size(mesh: &TriangleMesh) -> u64 {
    let vectors = mesh.positions.len() + mesh.normals.len() + mesh.displacements.len() + mesh.triangles.len();
    12 * vectors as u64 + 4 * mesh.labels.len() as u64
}

/// The normal in glTF axes at unit length, which the standard demands; one without length points up.
fn unit_normal(normal: &[f32; 3]) -> [f32; 3] {
    let turned = nalgebra::Vector3::from(to_gltf(normal.map(f64::from)));
    let length = turned.norm();
    if length > 0.0 { (turned / length).map(|x| x as f32).into() } else { [0.0, 1.0, 0.0] }
}

fn material(organ: &OrganMesh) -> Material {
    let [r, g, b] = organ.color.map(|c| c.clamp(0.0, 1.0));
    let mut material = Material { name: Some(organ.name.clone()), ..Material::default() };
    material.pbr_metallic_roughness.base_color_factor = PbrBaseColorFactor([r, g, b, 1.0]);
    material.pbr_metallic_roughness.metallic_factor = StrengthFactor(0.0);
    material.pbr_metallic_roughness.roughness_factor = StrengthFactor(ROUGHNESS);
    material
}

pub(super) fn node(name: String, mesh: Option<Index<Mesh>>, children: Option<Vec<Index<Node>>>) -> Node {
    Node { name: Some(name), mesh, children, ..Node::default() }
}

fn accessor(view: Index<buffer::View>, component: ComponentType, type_: Type, count: usize) -> Accessor {
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
