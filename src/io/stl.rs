//! STL files: triangles without connection, in the unit and space of the file's reader's choice.
//!
//! Ours hold patient millimetres, RAS+, and say so in the header (or the solid's name), which no program relies on.
//! All organs go into one file, one after the other; names, colours, labels and displacements are lost, and vertices are
//! written once per triangle. Reading joins vertices at exactly the same place again, so surfaces that touch in
//! a vertex (two organs, say) come back joined there.

use std::collections::HashMap;
use std::fs;
use std::io::{self, Cursor, Write};
use std::path::Path;

use super::atomic;
use super::encode::{push_f32, push_numbers, write_records};
use super::mesh_error::{ReadMeshError, WriteMeshError, check_organs};
use crate::surface::mesh::{OrganMesh, TriangleMesh};

/// What the 80-byte header of our binary files says. It must not begin with "solid": that marks ASCII files.
pub const HEADER: &str = "yawara binary STL, unit mm, patient space RAS+ (x right, y front, z head)";
const HEADER_BYTES: u64 = 80;
const FACET_BYTES: u64 = 50;
/// Name of the one solid in our ASCII files.
const SOLID: &str = "yawara, unit mm, patient space RAS+";
const FORMAT: &str = "STL";

/// Writes binary STL [mm, RAS+]: 84 bytes and 50 per triangle.
///
/// Facet normals are those of the triangles (zero for a triangle without area).
///
/// # Errors
/// If the meshes are inconsistent, not finite or empty, hold more than 2^32 - 1 triangles, or the file cannot be written.
pub fn write_stl(path: &Path, organs: &[OrganMesh]) -> Result<(), WriteMeshError> {
    check_organs(path, organs)?;
    let total: usize = organs.iter().map(|organ| organ.mesh.triangles.len()).sum();
    let total = u32::try_from(total).map_err(|_| WriteMeshError::TooLarge {
        path: path.to_path_buf(),
        format: "binary STL",
        what: "triangles",
        found: total as u64,
        limit: u64::from(u32::MAX),
        advice: "write PLY, or one organ at a time",
    })?;
    atomic::write_file(path, |writer| {
        let mut header = [0; HEADER_BYTES as usize];
        header[..HEADER.len()].copy_from_slice(HEADER.as_bytes());
        writer.write_all(&header)?;
        writer.write_all(&total.to_le_bytes())?;
        organs.iter().try_for_each(|organ| write_facets(writer, &organ.mesh))
    })
    .map_err(WriteMeshError::io(path))
}

/// Facets as binary records: normal, three corners, and an attribute count that nobody uses.
fn write_facets(out: &mut (impl Write + Send), mesh: &TriangleMesh) -> io::Result<()> {
    write_records(out, mesh.triangles.len(), &|range, bytes| {
        for corners in &mesh.triangles[range] {
            let corners = corners.map(|corner| mesh.positions[corner as usize]);
            push_f32(bytes, facet_normal(corners));
            corners.into_iter().for_each(|corner| push_f32(bytes, corner));
            bytes.extend_from_slice(&[0; 2]);
        }
    })
}

/// Writes ASCII STL [mm, RAS+]: one solid, about 260 bytes per triangle, every number exact.
///
/// # Errors
/// If the meshes are inconsistent, not finite or empty, or the file cannot be written.
pub fn write_stl_ascii(path: &Path, organs: &[OrganMesh]) -> Result<(), WriteMeshError> {
    check_organs(path, organs)?;
    atomic::write_file(path, |writer| {
        writeln!(writer, "solid {SOLID}")?;
        for OrganMesh { mesh, .. } in organs {
            write_records(writer, mesh.triangles.len(), &|range, text| {
                mesh.triangles[range].iter().for_each(|corners| push_facet_text(text, mesh, corners));
            })?;
        }
        writeln!(writer, "endsolid {SOLID}")
    })
    .map_err(WriteMeshError::io(path))
}

fn push_facet_text(text: &mut Vec<u8>, mesh: &TriangleMesh, corners: &[u32; 3]) {
    let corners = corners.map(|corner| mesh.positions[corner as usize]);
    text.extend_from_slice(b"facet normal");
    push_numbers(text, facet_normal(corners));
    text.extend_from_slice(b"\nouter loop");
    for corner in corners {
        text.extend_from_slice(b"\nvertex");
        push_numbers(text, corner);
    }
    text.extend_from_slice(b"\nendloop\nendfacet\n");
}

fn facet_normal(corners: [[f32; 3]; 3]) -> [f32; 3] {
    let [a, b, c] = corners.map(|corner| nalgebra::Vector3::from(corner.map(f64::from)));
    let normal = (b - a).cross(&(c - a));
    let length = normal.norm();
    if length > 0.0 { (normal / length).map(|x| x as f32).into() } else { [0.0; 3] }
}

/// Reads binary or ASCII STL; vertices at exactly the same place become one.
///
/// A file is binary when its length fits its triangle count, whatever its header says; otherwise ASCII when it begins
/// with "solid". Solids of an ASCII file are joined. The facet normals of the file are not kept.
///
/// # Errors
/// If the file cannot be read, is shorter than its triangle count says, is no STL, or holds NaN or infinite coordinates.
pub fn read_stl(path: &Path) -> Result<TriangleMesh, ReadMeshError> {
    let mut bytes = fs::read(path).map_err(ReadMeshError::io(path))?;
    let malformed = |what: String| ReadMeshError::malformed(path, FORMAT, what);
    let count = bytes.get(80..84).and_then(|count| count.try_into().ok()).map(u32::from_le_bytes);
    let promised = count.map(|count| (count, HEADER_BYTES + 4 + FACET_BYTES * u64::from(count)));
    let found = bytes.len() as u64;
    let fits = promised.is_some_and(|(_, length)| length == found);
    let mut mesh = Welded::default();
    if !fits && bytes.starts_with(b"solid") {
        for solid in solids(&bytes) {
            // stl_io wants a space after "solid"; a solid without a name has none.
            let facets = solid.trim_ascii_start().splitn(2, |&byte| byte == b'\n').nth(1).unwrap_or_default();
            mesh.add(&[b"solid one\n", facets].concat()).map_err(|error| malformed(error.to_string()))?;
        }
        return Ok(mesh.mesh);
    }
    match promised {
        None => return Err(malformed(format!("{found} bytes, but a binary header alone has 84"))),
        Some((count, length)) if found < length => {
            return Err(malformed(format!("{count} triangles need {length} bytes, the file has {found}")));
        }
        Some(_) => {}
    }
    // stl_io takes a header that begins with "solid" for ASCII.
    bytes[0] = 0;
    mesh.add(&bytes).map_err(|error| malformed(error.to_string()))?;
    Ok(mesh.mesh)
}

/// Splits an ASCII file after each `endsolid` line: stl_io stops at the first.
fn solids(bytes: &[u8]) -> Vec<&[u8]> {
    let (mut found, mut start, mut at) = (Vec::new(), 0, 0);
    for line in bytes.split_inclusive(|&byte| byte == b'\n') {
        at += line.len();
        if line.trim_ascii_start().starts_with(b"endsolid") {
            found.push(&bytes[start..at]);
            start = at;
        }
    }
    if !bytes[start..].trim_ascii().is_empty() {
        found.push(&bytes[start..]);
    }
    found
}

/// A mesh under construction, with the vertex at each place.
#[derive(Default)]
struct Welded {
    mesh: TriangleMesh,
    vertex_at: HashMap<[u32; 3], u32>,
}

impl Welded {
    fn add(&mut self, stl: &[u8]) -> io::Result<()> {
        let mut cursor = Cursor::new(stl);
        for facet in stl_io::create_stl_reader(&mut cursor)? {
            let facet = facet?;
            let mut corners = [0; 3];
            for (corner, vertex) in corners.iter_mut().zip(facet.vertices) {
                *corner = self.vertex(vertex.0)?;
            }
            self.mesh.triangles.push(corners);
        }
        Ok(())
    }

    fn vertex(&mut self, place: [f32; 3]) -> io::Result<u32> {
        if !place.iter().all(|x| x.is_finite()) {
            let triangle = self.mesh.triangles.len();
            return Err(io::Error::other(format!(
                "triangle {triangle} has a corner at {place:?}, which is not finite"
            )));
        }
        // Adding zero turns -0 into 0: the same place, other bits.
        let key = place.map(|x| (x + 0.0).to_bits());
        if let Some(&vertex) = self.vertex_at.get(&key) {
            return Ok(vertex);
        }
        let vertex =
            u32::try_from(self.mesh.positions.len()).map_err(|_| io::Error::other("more than 2^32 vertices"))?;
        self.mesh.positions.push(place);
        self.vertex_at.insert(key, vertex);
        Ok(vertex)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_header_fits_and_is_not_taken_for_ascii() {
        assert!(HEADER.len() as u64 <= HEADER_BYTES && !HEADER.starts_with("solid"));
    }

    #[test]
    fn facet_normals_follow_the_right_hand_rule() {
        let corners = [[0.0; 3], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0]];
        assert_eq!(facet_normal(corners), [0.0, 0.0, 1.0]);
        assert_eq!(facet_normal([corners[0], corners[1], corners[1]]), [0.0; 3]);
    }

    #[test]
    fn a_file_is_split_after_each_solid() {
        let text = b"solid a\nendsolid a\n  \nsolid b\n endsolid b\n\n";
        assert_eq!(solids(text).len(), 2);
        assert_eq!(solids(b"solid a\nfacet").len(), 1);
    }
}
