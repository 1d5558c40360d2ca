//! PLY files: vertices with normals, labels and displacements, and triangles by index.
//!
//! Ours are binary little endian, in patient millimetres, RAS+, and say so in their comments. All organs go into one file,
//! one after the other; a comment per organ tells which vertices and triangles are its own. An attribute is written
//! when every organ with vertices has it.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Write};
use std::path::Path;

use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{
    Addable, BeginList, ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyDef,
    PropertyType, ScalarType,
};
use ply_rs_bw::writer::Writer;

use super::atomic;
use super::mesh_error::{ReadMeshError, WriteMeshError, check_organs};
use crate::surface::mesh::{OrganMesh, TriangleMesh};

const FORMAT: &str = "PLY";

/// Writes binary little-endian PLY [mm, RAS+].
///
/// Vertex properties: `x y z` [mm], `nx ny nz`, `label` (ushort), `displacement_x displacement_y displacement_z` [mm];
/// faces: `vertex_indices` (uchar count, int indices).
///
/// # Errors
/// If the meshes are inconsistent, not finite or empty, hold more than 2^31 - 1 vertices, or the file cannot be written.
pub fn write_ply(path: &Path, organs: &[OrganMesh]) -> Result<(), WriteMeshError> {
    check_organs(path, organs)?;
    let vertices: usize = organs.iter().map(|organ| organ.mesh.positions.len()).sum();
    if i32::try_from(vertices).is_err() {
        return Err(WriteMeshError::TooLarge {
            path: path.to_path_buf(),
            format: "PLY with int indices",
            what: "vertices",
            found: vertices as u64,
            limit: i32::MAX as u64,
            advice: "write one organ at a time",
        });
    }
    let header = header(organs, vertices);
    atomic::write_file(path, |writer| write_elements(writer, &header, organs)).map_err(WriteMeshError::io(path))
}

fn header(organs: &[OrganMesh], vertices: usize) -> Header {
    let filled = || organs.iter().map(|organ| &organ.mesh).filter(|mesh| !mesh.positions.is_empty());
    let float = |name: &&str| PropertyDef::new((*name).to_string(), PropertyType::Scalar(ScalarType::Float));
    let mut vertex = ElementDef::new("vertex".to_string());
    vertex.count = vertices;
    ["x", "y", "z"].iter().map(float).for_each(|p| vertex.properties.add(p));
    if filled().all(|mesh| !mesh.normals.is_empty()) {
        ["nx", "ny", "nz"].iter().map(float).for_each(|p| vertex.properties.add(p));
    }
    if filled().all(|mesh| !mesh.labels.is_empty()) {
        vertex.properties.add(PropertyDef::new("label".to_string(), PropertyType::Scalar(ScalarType::UShort)));
    }
    if filled().all(|mesh| !mesh.displacements.is_empty()) {
        let names = ["displacement_x", "displacement_y", "displacement_z"];
        names.iter().map(float).for_each(|p| vertex.properties.add(p));
    }
    let mut face = ElementDef::new("face".to_string());
    face.count = organs.iter().map(|organ| organ.mesh.triangles.len()).sum();
    let indices = PropertyType::List(ScalarType::UChar, ScalarType::Int);
    face.properties.add(PropertyDef::new("vertex_indices".to_string(), indices));

    let mut header = Header::new();
    header.encoding = Encoding::BinaryLittleEndian;
    header.comments = vec![
        format!("written by yawara {}", env!("CARGO_PKG_VERSION")),
        "unit mm; patient space RAS+: x to the patient's right, y to the front, z to the head".to_string(),
        "displacement: from rest, mm".to_string(),
    ];
    let (mut first_vertex, mut first_face) = (0, 0);
    for OrganMesh { name, mesh, .. } in organs {
        let (vertices, faces) = (mesh.positions.len(), mesh.triangles.len());
        // Comments are ASCII and one line long; names need not be.
        let name = name.escape_default();
        header.comments.push(format!(
            "organ \"{name}\": {vertices} vertices from {first_vertex}, {faces} faces from {first_face}"
        ));
        first_vertex += vertices;
        first_face += faces;
    }
    header.elements.add(vertex);
    header.elements.add(face);
    header
}

fn write_elements(out: &mut impl Write, header: &Header, organs: &[OrganMesh]) -> io::Result<()> {
    let (vertices, faces) = (Writer::<Vertex>::new(), Writer::<Triangle>::new());
    vertices.write_header(out, header)?;
    let meshes = || organs.iter().map(|organ| &organ.mesh);
    for mesh in meshes() {
        for (vertex, &position) in mesh.positions.iter().enumerate() {
            let row = Vertex {
                position,
                normal: mesh.normals.get(vertex).copied().unwrap_or_default(),
                label: mesh.labels.get(vertex).copied().unwrap_or_default(),
                displacement: mesh.displacements.get(vertex).copied().unwrap_or_default(),
            };
            vertices.write_little_endian_element(out, &row, &header.elements["vertex"])?;
        }
    }
    let mut first = 0;
    for mesh in meshes() {
        for corners in &mesh.triangles {
            // Checked before the file was opened: the last vertex fits an int.
            let row = Triangle(corners.map(|corner| (corner + first) as i32));
            faces.write_little_endian_element(out, &row, &header.elements["face"])?;
        }
        first += mesh.positions.len() as u32;
    }
    Ok(())
}

/// One row of the vertex element.
struct Vertex {
    position: [f32; 3],
    normal: [f32; 3],
    label: u16,
    displacement: [f32; 3],
}

impl Vertex {
    /// The number a property name stands for, if it is a known float.
    fn float(&mut self, name: &str) -> Option<&mut f32> {
        Some(match name {
            "x" => &mut self.position[0],
            "y" => &mut self.position[1],
            "z" => &mut self.position[2],
            "nx" => &mut self.normal[0],
            "ny" => &mut self.normal[1],
            "nz" => &mut self.normal[2],
            "displacement_x" => &mut self.displacement[0],
            "displacement_y" => &mut self.displacement[1],
            "displacement_z" => &mut self.displacement[2],
            _ => return None,
        })
    }
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self { position: [0.0; 3], normal: [0.0; 3], label: 0, displacement: [0.0; 3] }
    }

    fn set_float(&mut self, name: &str, value: f32) -> PropertyAccessResult {
        match self.float(name) {
            Some(place) => *place = value,
            None => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }

    fn set_ushort(&mut self, name: &str, value: u16) -> PropertyAccessResult {
        self.set_property(name, Property::UShort(value))
    }

    /// What other programs may write in place of our types.
    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if name == "label" {
            let label = match property {
                Property::Char(value) => u16::try_from(value).ok(),
                Property::UChar(value) => Some(value.into()),
                Property::Short(value) => u16::try_from(value).ok(),
                Property::UShort(value) => Some(value),
                Property::Int(value) => u16::try_from(value).ok(),
                Property::UInt(value) => u16::try_from(value).ok(),
                _ => None,
            };
            let Some(label) = label else { return PropertyAccessResult::UnsupportedType };
            self.label = label;
            return PropertyAccessResult::Set;
        }
        match (self.float(name), property.to_f32_lossy()) {
            (None, _) => PropertyAccessResult::Ignored,
            (Some(_), None) => PropertyAccessResult::UnsupportedType,
            (Some(place), Some(value)) => {
                *place = value;
                PropertyAccessResult::Set
            }
        }
    }

    fn get_float(&self, name: &str) -> Option<f32> {
        Some(match name {
            "x" => self.position[0],
            "y" => self.position[1],
            "z" => self.position[2],
            "nx" => self.normal[0],
            "ny" => self.normal[1],
            "nz" => self.normal[2],
            "displacement_x" => self.displacement[0],
            "displacement_y" => self.displacement[1],
            "displacement_z" => self.displacement[2],
            _ => return None,
        })
    }

    fn get_ushort(&self, name: &str) -> Option<u16> {
        (name == "label").then_some(self.label)
    }
}

/// One row of the face element, as written.
struct Triangle([i32; 3]);

impl PropertyAccess for Triangle {
    fn new() -> Self {
        Self([0; 3])
    }

    fn get_list_int(&self, name: &str) -> Option<&[i32]> {
        (name == "vertex_indices").then_some(&self.0)
    }
}

/// One row of the face element, as read: of any number of corners.
#[derive(Default)]
struct Face {
    indices: Vec<i32>,
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self::default()
    }

    fn begin_list_int(&mut self, name: &str, _len: usize) -> BeginList<'_, i32> {
        if is_corner_list(name) { BeginList::Fill(&mut self.indices) } else { BeginList::UseSetter }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if !is_corner_list(name) {
            return PropertyAccessResult::Ignored;
        }
        let Some(indices) = property.to_u32_list() else { return PropertyAccessResult::UnsupportedType };
        // An index above i32::MAX turns negative and is refused with the triangle's number.
        self.indices = indices.into_iter().map(|index| index as i32).collect();
        PropertyAccessResult::Set
    }
}

/// Both names are in use.
fn is_corner_list(name: &str) -> bool {
    matches!(name, "vertex_indices" | "vertex_index")
}

/// An element this reader steps over.
struct Skipped;

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Self
    }
}

/// Reads ASCII or binary PLY with triangles: positions, and normals, labels and displacements where present.
///
/// Numbers of any type are taken; other properties and elements are stepped over.
///
/// # Errors
/// If the file cannot be read, ends early, is no PLY, has faces with other than three corners, corners outside the vertices,
/// or coordinates that are NaN or infinite.
pub fn read_ply(path: &Path) -> Result<TriangleMesh, ReadMeshError> {
    let mut reader = Reader::new(BufReader::with_capacity(1 << 20, File::open(path).map_err(ReadMeshError::io(path))?));
    let malformed = |what: String| ReadMeshError::malformed(path, FORMAT, what);
    let header = Parser::<Skipped>::new().read_header(&mut reader).map_err(|error| malformed(error.to_string()))?;
    let mut input = reader.into_inner();

    let vertex = header.elements.get("vertex").ok_or_else(|| malformed("no element 'vertex'".into()))?;
    if let Some(missing) = ["x", "y", "z"].iter().find(|axis| !vertex.properties.contains_key(**axis)) {
        return Err(malformed(format!("vertices have no property '{missing}'")));
    }
    let has = |name: &str| vertex.properties.contains_key(name);
    let mut mesh = TriangleMesh::default();
    for element in header.elements.values() {
        if element.properties.is_empty() && element.count > 0 {
            return Err(malformed(format!("element '{}' has no properties", element.name)));
        }
        match element.name.as_str() {
            "vertex" => rows(&mut input, header.encoding, element, |row: Vertex, at| {
                let finite = [row.position, row.normal, row.displacement].iter().flatten().all(|x| x.is_finite());
                if !finite {
                    return Err(format!("vertex {at} at {:?} has a coordinate that is not finite", row.position));
                }
                mesh.positions.push(row.position);
                if has("nx") {
                    mesh.normals.push(row.normal);
                }
                if has("label") {
                    mesh.labels.push(row.label);
                }
                if has("displacement_x") {
                    mesh.displacements.push(row.displacement);
                }
                Ok(())
            }),
            "face" => rows(&mut input, header.encoding, element, |row: Face, at| {
                let corners: [i32; 3] = row.indices.as_slice().try_into().map_err(|_| {
                    format!("face {at} has {} corners, only triangles are read (triangulate it)", row.indices.len())
                })?;
                match corners.iter().find(|&&corner| corner < 0 || corner as usize >= vertex.count) {
                    Some(corner) => Err(format!("face {at} uses vertex {corner} of {}", vertex.count)),
                    None => {
                        mesh.triangles.push(corners.map(|corner| corner as u32));
                        Ok(())
                    }
                }
            }),
            _ => rows(&mut input, header.encoding, element, |_: Skipped, _| Ok(())),
        }
        .map_err(malformed)?;
    }
    Ok(mesh)
}

/// Reads the rows of one element, one at a time: memory follows what the file holds, not what its header promises.
fn rows<E: PropertyAccess>(
    input: &mut impl BufRead,
    encoding: Encoding,
    element: &ElementDef,
    mut row: impl FnMut(E, usize) -> Result<(), String>,
) -> Result<(), String> {
    let parser = Parser::<E>::new();
    let mut line = String::new();
    for at in 0..element.count {
        let read = match encoding {
            Encoding::BinaryLittleEndian => parser.read_little_endian_element(input, element),
            Encoding::BinaryBigEndian => parser.read_big_endian_element(input, element),
            Encoding::Ascii => {
                line.clear();
                match input.read_line(&mut line) {
                    Ok(0) => Err(io::Error::from(io::ErrorKind::UnexpectedEof).into()),
                    Ok(_) => parser.read_ascii_element(&line, element),
                    Err(error) => Err(error.into()),
                }
            }
        };
        let read =
            read.map_err(|error| format!("element '{}', row {at} of {}: {error}", element.name, element.count))?;
        row(read, at)?;
    }
    Ok(())
}
