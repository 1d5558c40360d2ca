//! Writes PLY.

use std::io::{self, Write};
use std::path::Path;

use super::FORMAT;
use crate::io::atomic;
use crate::io::encode::{push_f32, write_records};
use crate::io::mesh_error::{WriteMeshError, check_organs};
use crate::plot::canvas::srgb;
use crate::surface::mesh::{OrganMesh, TriangleMesh};

/// Writes binary little-endian PLY [mm, RAS+].
///
/// Vertex properties: `x y z` [mm], `nx ny nz`, `label` (ushort), `displacement_x displacement_y displacement_z` [mm],
/// `hu` [HU], `strain`, `speed` [mm/s], `red green blue` (uchar, sRGB); faces: `vertex_indices` (uchar count, int indices).
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
    let attributes = attributes(organs);
    atomic::write_file(path, |out| {
        out.write_all(header(organs, vertices, &attributes).as_bytes())?;
        organs.iter().try_for_each(|organ| write_vertices(out, &organ.mesh, &attributes))?;
        let mut first = 0;
        organs.iter().try_for_each(|organ| {
            write_faces(out, &organ.mesh, first)?;
            first += organ.mesh.positions.len() as u32;
            Ok(())
        })
    })
    .map_err(WriteMeshError::io(path))
}

/// A part of a vertex beside its place.
struct Attribute {
    /// Properties as the header names them.
    properties: &'static [&'static str],
    /// What a comment says of its unit.
    note: Option<&'static str>,
    there: fn(&TriangleMesh) -> bool,
    push: fn(&TriangleMesh, usize, &mut Vec<u8>),
}

/// In the order of the file.
const ATTRIBUTES: [Attribute; 7] = [
    Attribute {
        properties: &["float nx", "float ny", "float nz"],
        note: None,
        there: |mesh| !mesh.normals.is_empty(),
        push: |mesh, vertex, bytes| push_f32(bytes, mesh.normals[vertex]),
    },
    Attribute {
        properties: &["ushort label"],
        note: None,
        there: |mesh| !mesh.labels.is_empty(),
        push: |mesh, vertex, bytes| bytes.extend_from_slice(&mesh.labels[vertex].to_le_bytes()),
    },
    Attribute {
        properties: &["float displacement_x", "float displacement_y", "float displacement_z"],
        note: Some("displacement: from rest, mm"),
        there: |mesh| !mesh.displacements.is_empty(),
        push: |mesh, vertex, bytes| push_f32(bytes, mesh.displacements[vertex]),
    },
    Attribute {
        properties: &["float hu"],
        note: Some("hu: CT at the rest place of the vertex, HU"),
        there: |mesh| !mesh.hu.is_empty(),
        push: |mesh, vertex, bytes| push_f32(bytes, [mesh.hu[vertex]]),
    },
    Attribute {
        properties: &["float strain"],
        note: Some("strain: equivalent strain, without unit"),
        there: |mesh| !mesh.strains.is_empty(),
        push: |mesh, vertex, bytes| push_f32(bytes, [mesh.strains[vertex]]),
    },
    Attribute {
        properties: &["float speed"],
        note: Some("speed: mm/s"),
        there: |mesh| !mesh.speeds.is_empty(),
        push: |mesh, vertex, bytes| push_f32(bytes, [mesh.speeds[vertex]]),
    },
    Attribute {
        properties: &["uchar red", "uchar green", "uchar blue"],
        note: Some("red green blue: sRGB"),
        there: |mesh| !mesh.colors.is_empty(),
        push: |mesh, vertex, bytes| bytes.extend_from_slice(&srgb(mesh.colors[vertex])),
    },
];

/// The attributes that all organs with vertices have.
fn attributes(organs: &[OrganMesh]) -> Vec<&'static Attribute> {
    let filled = || organs.iter().map(|organ| &organ.mesh).filter(|mesh| !mesh.positions.is_empty());
    ATTRIBUTES.iter().filter(|attribute| filled().all(attribute.there)).collect()
}

fn header(organs: &[OrganMesh], vertices: usize, attributes: &[&Attribute]) -> String {
    let mut lines = vec![
        FORMAT.to_lowercase(),
        "format binary_little_endian 1.0".to_owned(),
        format!("comment written by yawara {}", env!("CARGO_PKG_VERSION")),
        "comment unit mm; patient space RAS+: x to the patient's right, y to the front, z to the head".to_owned(),
    ];
    lines.extend(attributes.iter().filter_map(|attribute| attribute.note).map(|note| format!("comment {note}")));
    let (mut first_vertex, mut first_face) = (0, 0);
    for OrganMesh { name, mesh, .. } in organs {
        let (vertices, faces) = (mesh.positions.len(), mesh.triangles.len());
        // Comments are ASCII and one line long; names need not be.
        let name = name.escape_default();
        lines.push(format!(
            "comment organ \"{name}\": {vertices} vertices from {first_vertex}, {faces} faces from {first_face}"
        ));
        first_vertex += vertices;
        first_face += faces;
    }
    lines.push(format!("element vertex {vertices}"));
    let properties = attributes.iter().flat_map(|attribute| attribute.properties);
    lines.extend(["float x", "float y", "float z"].iter().chain(properties).map(|name| format!("property {name}")));
    lines.push(format!("element face {first_face}"));
    lines.push("property list uchar int vertex_indices\nend_header\n".to_owned());
    lines.join("\n")
}

fn write_vertices(out: &mut (impl Write + Send), mesh: &TriangleMesh, attributes: &[&Attribute]) -> io::Result<()> {
    write_records(out, mesh.positions.len(), &|range, bytes| {
        for vertex in range {
            push_f32(bytes, mesh.positions[vertex]);
            attributes.iter().for_each(|attribute| (attribute.push)(mesh, vertex, bytes));
        }
    })
}

/// - `first`: number of the mesh's first vertex in the file.
fn write_faces(out: &mut (impl Write + Send), mesh: &TriangleMesh, first: u32) -> io::Result<()> {
    write_records(out, mesh.triangles.len(), &|range, bytes| {
        for corners in &mesh.triangles[range] {
            // Checked before the file was opened: the last vertex fits an int.
            bytes.push(3);
            bytes.extend_from_slice(corners.map(|corner| (corner + first).to_le_bytes()).as_flattened());
        }
    })
}
