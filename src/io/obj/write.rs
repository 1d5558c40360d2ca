//! Writes OBJ and its materials.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use crate::io::atomic;
use crate::io::encode::{push_integer, push_numbers, write_records};
use crate::io::mesh_error::{WriteMeshError, check_organs};
use crate::plot::canvas::srgb;
use crate::surface::mesh::{Finish, OrganMesh, TriangleMesh};

/// Writes OBJ [mm, RAS+] and, beside it, its materials with the extension `mtl`, first.
///
/// Numbers are the shortest that read back exactly. Colours are written when every organ with vertices has them.
///
/// # Errors
/// If the meshes are inconsistent, not finite or empty, or a file cannot be written.
pub fn write_obj(path: &Path, organs: &[OrganMesh]) -> Result<(), WriteMeshError> {
    check_organs(path, organs)?;
    let names = object_names(organs);
    let library = library(path);
    atomic::write_file(&library, |out| out.write_all(materials(organs, &names).as_bytes()))
        .map_err(WriteMeshError::io(&library))?;
    let meshes = || organs.iter().map(|organ| &organ.mesh).filter(|mesh| !mesh.positions.is_empty());
    let colored = meshes().all(|mesh| !mesh.colors.is_empty());
    atomic::write_file(path, |out| {
        writeln!(out, "# written by yawara {}", env!("CARGO_PKG_VERSION"))?;
        writeln!(out, "# unit mm; patient space RAS+: x to the patient's right, y to the front, z to the head")?;
        if colored {
            writeln!(out, "# after the coordinates of a vertex: red green blue, sRGB")?;
        }
        writeln!(out, "mtllib {}", library.file_name().unwrap_or_default().to_string_lossy())?;
        let (mut first, mut first_normal) = (1, 1);
        for (OrganMesh { mesh, .. }, name) in organs.iter().zip(&names) {
            writeln!(out, "o {name}\ng {name}\nusemtl {name}")?;
            write_mesh(out, mesh, colored, first, first_normal)?;
            first += mesh.positions.len() as u64;
            first_normal += mesh.normals.len() as u64;
        }
        Ok(())
    })
    .map_err(WriteMeshError::io(path))
}

/// - `first`, `first_normal`: numbers in the file, from 1, of the mesh's first vertex and normal.
fn write_mesh(
    out: &mut (impl Write + Send),
    mesh: &TriangleMesh,
    colored: bool,
    first: u64,
    first_normal: u64,
) -> io::Result<()> {
    let shades: Vec<String> = (0..=u8::MAX).map(|byte| format!(" {:.4}", f32::from(byte) / 255.0)).collect();
    write_records(out, mesh.positions.len(), &|range, text| {
        for vertex in range {
            text.push(b'v');
            push_numbers(text, mesh.positions[vertex]);
            if colored {
                srgb(mesh.colors[vertex])
                    .iter()
                    .for_each(|&byte| text.extend_from_slice(shades[usize::from(byte)].as_bytes()));
            }
            text.push(b'\n');
        }
    })?;
    write_records(out, mesh.normals.len(), &|range, text| {
        for &normal in &mesh.normals[range] {
            text.extend_from_slice(b"vn");
            push_numbers(text, normal);
            text.push(b'\n');
        }
    })?;
    let bare = mesh.normals.is_empty();
    write_records(out, mesh.triangles.len(), &|range, text| {
        for corners in &mesh.triangles[range] {
            text.push(b'f');
            for corner in corners.map(u64::from) {
                text.push(b' ');
                push_integer(text, first + corner);
                if !bare {
                    text.extend_from_slice(b"//");
                    push_integer(text, first_normal + corner);
                }
            }
            text.push(b'\n');
        }
    })
}

/// The material file: beside the mesh, without blanks in its name, at which some readers stop.
fn library(path: &Path) -> PathBuf {
    let name = path.with_extension("mtl").file_name().unwrap_or_default().to_string_lossy().into_owned();
    path.with_file_name(name.replace(char::is_whitespace, "_"))
}

/// Names of the organs without blanks and control characters, each its own.
fn object_names(organs: &[OrganMesh]) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for (number, organ) in organs.iter().enumerate() {
        let mut name = organ.name.replace(|c: char| c.is_whitespace() || c.is_control(), "_");
        if name.is_empty() || names.contains(&name) {
            name.push_str(&format!("_{number}"));
        }
        names.push(name);
    }
    names
}

fn materials(organs: &[OrganMesh], names: &[String]) -> String {
    let mut text = format!("# written by yawara {}; colours in sRGB\n", env!("CARGO_PKG_VERSION"));
    for (organ, name) in organs.iter().zip(names) {
        let [r, g, b] = srgb(organ.color).map(|byte| f32::from(byte) / 255.0);
        // Specular share and exponent of the old shading model; roughness (Pr) and metal (Pm) of the new.
        let (specular, exponent, roughness) = match organ.finish {
            Finish::Wet => (0.3, 80, 0.4),
            Finish::Dry => (0.02, 5, 0.85),
        };
        text.push_str(&format!(
            "newmtl {name}\nKd {r:.4} {g:.4} {b:.4}\nKs {specular} {specular} {specular}\nNs {exponent}\nPr {roughness}\nPm 0\n\
             illum 2\n"
        ));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_words_and_each_its_own() {
        let organ = |name: &str| OrganMesh {
            name: name.into(),
            color: [0.0; 3],
            finish: Finish::Dry,
            mesh: TriangleMesh::default(),
        };
        let names = object_names(&["left kidney", "left_kidney", "", "fígado\n"].map(organ));
        assert_eq!(names, ["left_kidney", "left_kidney_1", "_2", "fígado_"]);
        assert_eq!(library(Path::new("a b/my liver.obj")), Path::new("a b/my_liver.mtl"));
    }
}
