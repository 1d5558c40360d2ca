//! Reads PLY: what was written, and the triangles of other programs.

use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::path::Path;

use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{
    BeginList, ElementDef, Encoding, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType,
};

use super::FORMAT;
use crate::io::mesh_error::ReadMeshError;
use crate::scene::color::linear;
use crate::surface::mesh::TriangleMesh;

/// One row of the vertex element.
#[derive(Default)]
struct Vertex {
    position: [f32; 3],
    normal: [f32; 3],
    label: u16,
    displacement: [f32; 3],
    hu: f32,
    strain: f32,
    speed: f32,
    /// sRGB.
    color: [u8; 3],
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
            "hu" => &mut self.hu,
            "strain" => &mut self.strain,
            "speed" => &mut self.speed,
            _ => return None,
        })
    }

    fn is_finite(&self) -> bool {
        let vectors = [self.position, self.normal, self.displacement, [self.hu, self.strain, self.speed]];
        vectors.iter().flatten().all(|x| x.is_finite())
    }
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self::default()
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

    fn set_uchar(&mut self, name: &str, value: u8) -> PropertyAccessResult {
        match COLOR.iter().position(|color| *color == name) {
            Some(place) => self.color[place] = value,
            None => return self.set_property(name, Property::UChar(value)),
        }
        PropertyAccessResult::Set
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
}

/// Colours are bytes, in sRGB, as other programs take them to be.
const COLOR: [&str; 3] = ["red", "green", "blue"];

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

/// Reads ASCII or binary PLY with triangles: positions, and the vertex properties of [`write_ply`](super::write_ply) where
/// present.
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
    let [normals, labels, displacements] = ["nx", "label", "displacement_x"].map(has);
    let [hu, strain, speed] = ["hu", "strain", "speed"].map(has);
    let byte = |name: &&str| {
        let property = vertex.properties.get(*name).map(|property| &property.data_type);
        property == Some(&PropertyType::Scalar(ScalarType::UChar))
    };
    let colored = COLOR.iter().all(byte);
    let mut mesh = TriangleMesh::default();
    for element in header.elements.values() {
        if element.properties.is_empty() && element.count > 0 {
            return Err(malformed(format!("element '{}' has no properties", element.name)));
        }
        match element.name.as_str() {
            "vertex" => rows(&mut input, header.encoding, element, |row: Vertex, at| {
                if !row.is_finite() {
                    return Err(format!("vertex {at} at {:?} has a number that is not finite", row.position));
                }
                mesh.positions.push(row.position);
                if normals {
                    mesh.normals.push(row.normal);
                }
                if labels {
                    mesh.labels.push(row.label);
                }
                if displacements {
                    mesh.displacements.push(row.displacement);
                }
                let numbers = [
                    (hu, &mut mesh.hu, row.hu),
                    (strain, &mut mesh.strains, row.strain),
                    (speed, &mut mesh.speeds, row.speed),
                ];
                for (_, list, value) in numbers.into_iter().filter(|(there, ..)| *there) {
                    list.push(value);
                }
                if colored {
                    mesh.colors.push(row.color.map(linear));
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
