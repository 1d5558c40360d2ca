//! One mesh per file: the same numbers come back, the same bytes go out.

use std::fs;
use std::path::Path;

use yawara::io::gltf::{Precision, quantization_error_mm, write_gltf};
use yawara::io::mesh_error::WriteMeshError;
use yawara::io::mesh_format::MeshFormat;
use yawara::io::{ply, stl};
use yawara::surface::mesh::{Finish, OrganMesh, TriangleMesh};

use crate::{blob, entries, signed_volume};

const FORMATS: [(MeshFormat, &str); 7] = [
    (MeshFormat::Stl, "m.stl"),
    (MeshFormat::StlAscii, "a.stl"),
    (MeshFormat::Ply, "m.ply"),
    (MeshFormat::Glb, "m.glb"),
    (MeshFormat::Gltf, "j.gltf"),
    (MeshFormat::Obj, "o.obj"),
    (MeshFormat::Vtp, "v.vtp"),
];
/// Metres in single precision: half a unit in the last place on the way there and back.
const GLB_RELATIVE: f32 = 2.5e-7;

fn organs() -> Vec<OrganMesh> {
    let mut kidney = blob("kidney, \"left\"\n\u{e9}", [-80.0, 15.0, 640.0], 5);
    kidney.color = [0.4, 0.2, 0.9];
    vec![blob("liver", [60.0, -20.0, 700.0], 9), kidney]
}

/// The organs as one mesh, in file order.
fn joined(organs: &[OrganMesh]) -> TriangleMesh {
    let mut whole = TriangleMesh::default();
    for OrganMesh { mesh, .. } in organs {
        let first = whole.positions.len() as u32;
        whole.triangles.extend(mesh.triangles.iter().map(|t| t.map(|corner| corner + first)));
        whole.positions.extend(&mesh.positions);
        whole.normals.extend(&mesh.normals);
        whole.labels.extend(&mesh.labels);
        whole.displacements.extend(&mesh.displacements);
        whole.hu.extend(&mesh.hu);
        whole.strains.extend(&mesh.strains);
        whole.speeds.extend(&mesh.speeds);
        whole.colors.extend(&mesh.colors);
    }
    whole
}

/// True when linear colours differ by no more than half a byte of sRGB.
fn same_in_srgb(found: &[[f32; 3]], expected: &[[f32; 3]]) -> bool {
    let encode = |x: f32| if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    let near = |(a, b): (&f32, &f32)| (encode(*a) - encode(*b)).abs() <= 0.501 / 255.0;
    found.len() == expected.len() && found.iter().flatten().zip(expected.iter().flatten()).all(near)
}

/// Corners of each triangle, which is all an STL file holds.
fn corners(mesh: &TriangleMesh) -> Vec<[[f32; 3]; 3]> {
    mesh.triangles.iter().map(|t| t.map(|corner| mesh.positions[corner as usize])).collect()
}

fn write(format: MeshFormat, path: &Path, organs: &[OrganMesh]) {
    format.write(path, organs).unwrap_or_else(|error| panic!("{error}"));
}

#[test]
fn stl_gives_back_every_corner_and_joins_vertices() {
    let folder = tempfile::tempdir().unwrap();
    let expected = joined(&organs());
    for (format, name) in &FORMATS[..2] {
        let path = folder.path().join(name);
        write(*format, &path, &organs());
        let found = stl::read_stl(&path).unwrap();
        assert_eq!(corners(&found), corners(&expected), "{format}");
        assert_eq!(found.positions.len(), expected.positions.len(), "{format}: vertices joined");
    }
    let bytes = fs::read(folder.path().join("m.stl")).unwrap();
    assert!(bytes.starts_with(stl::HEADER.as_bytes()));
    assert_eq!(bytes.len(), 84 + 50 * expected.triangles.len());
    let text = fs::read_to_string(folder.path().join("a.stl")).unwrap();
    assert!(text.starts_with("solid yawara, unit mm") && text.contains("RAS+"));
    assert_eq!(text.matches("\nfacet normal ").count(), expected.triangles.len());
}

#[test]
fn stl_facet_normals_point_outward() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.stl");
    let organ = blob("liver", [0.0; 3], 9);
    write(MeshFormat::Stl, &path, std::slice::from_ref(&organ));
    let mut file = fs::File::open(&path).unwrap();
    let facets: Vec<_> = stl_io::create_stl_reader(&mut file).unwrap().map(Result::unwrap).collect();
    assert_eq!(facets.len(), organ.mesh.triangles.len());
    for facet in facets {
        let outward: f32 = (0..3).map(|axis| facet.normal.0[axis] * facet.vertices[0].0[axis]).sum();
        assert!(outward > 0.0, "{facet:?}");
    }
}

#[test]
fn stl_of_other_programs_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("other.stl");
    // Two solids, no name, tabs and Windows line ends.
    let solid = "solid\r\nfacet normal 0 0 1\r\n\touter loop\r\n\t\tvertex 0 0 0\r\n\t\tvertex 1 0 0\r\n\t\tvertex 0 1 0\r\n\
                 \tendloop\r\nendfacet\r\nendsolid\r\n";
    fs::write(&path, [solid, &solid.replace("vertex 0 0 0", "vertex 0 0 5")].concat()).unwrap();
    let mesh = stl::read_stl(&path).unwrap();
    assert_eq!((mesh.triangles.len(), mesh.positions.len()), (2, 4));
    // A binary file whose header begins like an ASCII one.
    write(MeshFormat::Stl, &path, &organs());
    let mut bytes = fs::read(&path).unwrap();
    bytes[..6].copy_from_slice(b"solid ");
    fs::write(&path, bytes).unwrap();
    assert_eq!(corners(&stl::read_stl(&path).unwrap()), corners(&joined(&organs())));
}

#[test]
fn ply_gives_back_everything_exactly() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.ply");
    write(MeshFormat::Ply, &path, &organs());
    let (mut found, mut expected) = (ply::read_ply(&path).unwrap(), joined(&organs()));
    assert!(same_in_srgb(&found.colors, &expected.colors));
    (found.colors, expected.colors) = Default::default();
    assert_eq!(found, expected);
    let bytes = fs::read(&path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap();
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    assert!(header.is_ascii() && header.contains("comment unit mm; patient space RAS+"), "{header}");
    assert!(header.contains(r#"organ "kidney, \"left\"\n\u{e9}": 42 vertices from 146"#), "{header}");
    for line in ["float hu", "float strain", "float speed", "uchar red", "uchar green", "uchar blue"] {
        assert!(header.contains(&format!("property {line}\n")), "{header}");
    }
    for note in ["displacement: from rest, mm", "hu: CT", "strain: equivalent", "speed: mm/s", "blue: sRGB"] {
        assert!(header.contains(note), "{header}");
    }
    assert!(header.contains("property ushort label") && header.contains("property list uchar int vertex_indices"));
}

#[test]
fn ply_leaves_out_what_an_organ_lacks() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.ply");
    let mut organs = organs();
    organs[1].mesh.labels.clear();
    organs[0].mesh.normals.clear();
    organs[1].mesh.colors.clear();
    organs[1].mesh.speeds.clear();
    write(MeshFormat::Ply, &path, &organs);
    let found = ply::read_ply(&path).unwrap();
    assert!(found.labels.is_empty() && found.normals.is_empty() && found.speeds.is_empty() && found.colors.is_empty());
    assert_eq!(found.hu, joined(&organs).hu);
    assert_eq!(found.displacements, joined(&organs).displacements);
}

#[test]
fn ply_of_other_programs_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("other.ply");
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\n\
                property uchar red\nproperty int label\nelement edge 1\nproperty int vertex1\nelement face 1\n\
                property list uchar uint vertex_index\nend_header\n0 0 0 255 7\n1 0 0 255 8\n0 1.5 0 255 9\n3\n3 0 1 2\n";
    fs::write(&path, text).unwrap();
    let mesh = ply::read_ply(&path).unwrap();
    assert_eq!((mesh.positions[2], mesh.labels, mesh.triangles), ([0.0, 1.5, 0.0], vec![7, 8, 9], vec![[0, 1, 2]]));
    for (from, to, part) in [
        ("3 0 1 2", "4 0 1 2 0", "4 corners"),
        ("3 0 1 2", "3 0 1 9", "vertex 9 of 3"),
        ("1.5 0 255 9", "1.5 0 255 70000", "label"),
        ("double z", "double w", "no property 'z'"),
        ("vertex 3", "vertex 999999999", "row 3 of 999999999"),
        ("element edge 1\nproperty int vertex1", "element edge 99999999999", "'edge' has no properties"),
    ] {
        fs::write(&path, text.replace(from, to)).unwrap();
        let message = ply::read_ply(&path).unwrap_err().to_string();
        assert!(message.contains("other.ply") && message.contains(part), "{message}");
    }
}

#[test]
fn glb_gives_back_organs_within_single_precision() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.glb");
    write(MeshFormat::Glb, &path, &organs());
    let found = MeshFormat::Glb.read(&path).unwrap();
    assert_eq!(found.len(), 2);
    for (found, expected) in found.iter().zip(organs()) {
        assert_eq!((&found.name, found.finish), (&expected.name, expected.finish));
        assert_eq!(found.mesh.triangles, expected.mesh.triangles);
        assert_eq!(found.mesh.labels, expected.mesh.labels);
        assert_eq!((&found.mesh.hu, &found.mesh.strains), (&expected.mesh.hu, &expected.mesh.strains));
        assert!(near(&found.mesh.positions, &expected.mesh.positions, GLB_RELATIVE, 0.0));
        assert!(near(&found.mesh.displacements, &expected.mesh.displacements, GLB_RELATIVE, 0.0));
        assert!(near(&found.mesh.normals, &expected.mesh.normals, 1e-6, 0.0));
        // 16-bit shares.
        assert!(near(&found.mesh.colors, &expected.mesh.colors, 0.0, 0.51 / 65_535.0));
        let speeds = |mesh: &TriangleMesh| mesh.speeds.iter().map(|&speed| [speed; 3]).collect::<Vec<_>>();
        assert!(near(&speeds(&found.mesh), &speeds(&expected.mesh), GLB_RELATIVE, 0.0));
    }
}

/// Blender 5.0 reads a mesh with several attributes of its own on some of its starts only.
#[test]
fn a_label_that_all_vertices_have_is_written_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.glb");
    let mut organs = organs();
    organs[1].mesh.labels.fill(7);
    write(MeshFormat::Glb, &path, &organs);
    let (json, _) = chunks(&path);
    let labels = |n: usize| json["meshes"][n]["primitives"][0]["attributes"].get("_LABEL");
    assert!(labels(0).is_some() && labels(1).is_none());
    assert_eq!((json["meshes"][0].get("extras"), &json["meshes"][1]["extras"]["label"]), (None, &serde_json::json!(7)));
    let found = MeshFormat::Glb.read(&path).unwrap();
    assert_eq!([&found[0].mesh.labels, &found[1].mesh.labels], [&organs[0].mesh.labels, &organs[1].mesh.labels]);
}

/// True when all parts are within a relative or an absolute distance.
pub(crate) fn near(found: &[[f32; 3]], expected: &[[f32; 3]], relative: f32, absolute: f32) -> bool {
    let close = |(a, b): (&f32, &f32)| (a - b).abs() <= absolute.max(relative * b.abs());
    found.len() == expected.len() && found.iter().flatten().zip(expected.iter().flatten()).all(close)
}

#[test]
fn the_organ_colour_is_the_materials_when_vertices_have_none() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.glb");
    let mut organs = organs();
    organs[1].mesh.colors.clear();
    organs[1].finish = Finish::Dry;
    write(MeshFormat::Glb, &path, &organs);
    let found = MeshFormat::Glb.read(&path).unwrap();
    assert_eq!((found[0].color, found[0].finish), ([1.0; 3], Finish::Wet), "vertex colours are multiplied with white");
    assert_eq!((found[1].color, found[1].finish), (organs[1].color, Finish::Dry));
    let (json, _) = chunks(&path);
    assert_eq!(json["materials"][0]["extensions"]["KHR_materials_ior"]["ior"], 1.38);
    assert!(json["materials"][1].get("extensions").is_none());
    let rough = |n: usize| json["materials"][n]["pbrMetallicRoughness"]["roughnessFactor"].as_f64().unwrap();
    assert!(rough(0) < 0.5 && rough(1) > 0.8);
}

#[test]
fn quantised_positions_keep_their_bound() {
    let folder = tempfile::tempdir().unwrap();
    let (plain, path) = (folder.path().join("plain.glb"), folder.path().join("m.glb"));
    let mut organs = organs();
    // A plate: no extent along one axis.
    organs[1].mesh.positions.iter_mut().for_each(|position| position[1] = 15.0);
    let bound = quantization_error_mm(&organs);
    assert!((4e-4..7e-4).contains(&bound), "a ball of 66 mm in 65535 steps: {bound}");
    write_gltf(&plain, &organs, Precision::Float).unwrap();
    write_gltf(&path, &organs, Precision::Quantized).unwrap();
    let found = MeshFormat::Glb.read(&path).unwrap();
    for (found, expected) in found.iter().zip(&organs) {
        let (found, expected) = (&found.mesh, &expected.mesh);
        assert!(near(&found.positions, &expected.positions, GLB_RELATIVE, 1.001 * bound as f32 + 1e-4));
        assert!(!near(&found.positions, &expected.positions, GLB_RELATIVE, 0.5 * bound as f32), "it is quantised");
        assert!(near(&found.displacements, &expected.displacements, 3e-7, 1e-6), "lengths are those of the organ");
        let cosine = |(a, b): (&[f32; 3], &[f32; 3])| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
        let least = found.normals.iter().zip(&expected.normals).map(cosine).fold(1.0, f32::min);
        assert!(least > 0.4_f32.to_radians().cos() - 1e-6, "{least}");
        assert_eq!((&found.triangles, &found.labels), (&expected.triangles, &expected.labels));
    }
    let (json, _) = chunks(&path);
    assert_eq!(json["extensionsRequired"], serde_json::json!(["KHR_mesh_quantization"]));
    let size = |path: &Path| fs::metadata(path).unwrap().len();
    assert!(size(&path) < size(&plain));
}

#[test]
fn json_and_buffer_are_two_files_that_belong_together() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("my organs #1.gltf");
    write(MeshFormat::Gltf, &path, &organs());
    assert_eq!(entries(folder.path()), ["my organs #1.bin", "my organs #1.gltf"]);
    let glb = folder.path().join("m.glb");
    write(MeshFormat::Glb, &glb, &organs());
    assert_eq!(MeshFormat::Gltf.read(&path).unwrap(), MeshFormat::Glb.read(&glb).unwrap());
    let json: serde_json::Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    assert_eq!(json["buffers"][0]["uri"], "my%20organs%20%231.bin");
    // The buffer cut short, gone, and elsewhere.
    let buffer = path.with_extension("bin");
    let bytes = fs::read(&buffer).unwrap();
    fs::write(&buffer, &bytes[..bytes.len() - 1]).unwrap();
    let message = || MeshFormat::Gltf.read(&path).unwrap_err().to_string();
    assert!(message().contains(&format!("its buffer has {} bytes", bytes.len())), "{}", message());
    fs::remove_file(&buffer).unwrap();
    assert!(message().contains("my organs #1.bin: could not read"), "{}", message());
    let text = serde_json::to_string(&json).unwrap().replace("my%20organs%20%231.bin", "..%2Fother.bin");
    fs::write(&path, text).unwrap();
    assert!(message().contains("no file of the same folder"), "{}", message());
}

/// The JSON of a GLB, and its binary chunk.
pub(crate) fn chunks(path: &Path) -> (serde_json::Value, Vec<u8>) {
    let bytes = fs::read(path).unwrap();
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!((word(8), word(12) % 4, bytes.len() % 4), (bytes.len(), 0, 0));
    let (json, binary) = (20..20 + word(12), 28 + word(12)..);
    assert_eq!(word(json.end), bytes.len() - binary.start);
    (serde_json::from_slice(&bytes[json]).unwrap(), bytes[binary].to_vec())
}

fn floats(bytes: &[u8]) -> Vec<[f32; 3]> {
    let words: Vec<f32> = bytes.chunks(4).map(|word| f32::from_le_bytes(word.try_into().unwrap())).collect();
    words.chunks(3).map(|v| v.try_into().unwrap()).collect()
}

#[test]
fn glb_views_are_aligned_bounded_and_face_outward_in_gltf_space() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.glb");
    write(MeshFormat::Glb, &path, &organs());
    let (json, binary) = chunks(&path);
    let number = |value: &serde_json::Value| value.as_u64().unwrap() as usize;
    assert!(json["buffers"][0]["byteLength"].as_u64().unwrap() <= binary.len() as u64);
    let view = |accessor: &serde_json::Value| {
        let view = &json["bufferViews"][number(&accessor["bufferView"])];
        let (start, length) = (number(&view["byteOffset"]), number(&view["byteLength"]));
        assert_eq!(start % 4, 0);
        &binary[start..start + length]
    };
    assert_eq!(json["meshes"].as_array().unwrap().len(), 2);
    for (mesh, organ) in json["meshes"].as_array().unwrap().iter().zip(organs()) {
        let primitive = &mesh["primitives"][0];
        let accessor = &json["accessors"][number(&primitive["attributes"]["POSITION"])];
        let positions = floats(view(accessor));
        for axis in 0..3 {
            let all = positions.iter().map(|p| p[axis]);
            let bound = |name: &str| accessor[name][axis].as_f64().unwrap() as f32;
            assert_eq!(bound("min"), all.clone().reduce(f32::min).unwrap());
            assert_eq!(bound("max"), all.reduce(f32::max).unwrap());
        }
        let accessor = &json["accessors"][number(&primitive["indices"])];
        assert_eq!(accessor["componentType"], 5123, "few vertices take 16-bit indices");
        let shorts = view(accessor).chunks(2).map(|s| u32::from(u16::from_le_bytes(s.try_into().unwrap())));
        let triangles: Vec<[u32; 3]> = shorts.collect::<Vec<_>>().chunks(3).map(|t| t.try_into().unwrap()).collect();
        let (there, here) =
            (signed_volume(&positions, &triangles), signed_volume(&organ.mesh.positions, &organ.mesh.triangles));
        assert!(here > 0.0 && (there * 1e9 / here - 1.0).abs() < 1e-4, "{there} m3, {here} mm3");
        // Highest in patient space is highest on screen; the patient's right is at the viewer's left.
        let extreme = |values: &[[f32; 3]], axis: usize| {
            (0..values.len()).max_by(|&a, &b| values[a][axis].total_cmp(&values[b][axis]))
        };
        assert_eq!(extreme(&positions, 1), extreme(&organ.mesh.positions, 2));
        assert_eq!(extreme(&positions, 2), extreme(&organ.mesh.positions, 1));
        let most_right = extreme(&organ.mesh.positions, 0).unwrap();
        assert!(positions.iter().all(|p| p[0] >= positions[most_right][0]));
    }
    assert_eq!(json["scenes"][0]["extras"]["unit"], "metre");
    let material = &json["materials"][0];
    assert_eq!(json["asset"]["version"], "2.0");
    assert_eq!(
        (material["name"].as_str(), material["pbrMetallicRoughness"]["metallicFactor"].as_f64()),
        (Some("liver"), Some(0.0))
    );
    assert_ne!(material["doubleSided"], true);
}

#[test]
fn many_vertices_take_long_indices() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.glb");
    let organ = blob("liver", [0.0; 3], 184);
    assert!(organ.mesh.positions.len() > 65_535);
    write(MeshFormat::Glb, &path, std::slice::from_ref(&organ));
    let (json, _) = chunks(&path);
    let indices = json["meshes"][0]["primitives"][0]["indices"].as_u64().unwrap() as usize;
    assert_eq!(json["accessors"][indices]["componentType"], 5125);
    assert_eq!(MeshFormat::Glb.read(&path).unwrap()[0].mesh.triangles, organ.mesh.triangles);
}

#[test]
fn the_same_meshes_give_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    for (format, name) in FORMATS {
        let path = folder.path().join(name);
        write(format, &path, &organs());
        let first = fs::read(&path).unwrap();
        write(format, &path, &organs());
        assert_eq!(first, fs::read(&path).unwrap(), "{format}");
    }
    let expected = ["a.stl", "j.bin", "j.gltf", "m.glb", "m.ply", "m.stl", "o.mtl", "o.obj", "v.vtp"];
    assert_eq!(entries(folder.path()), expected);
}

#[test]
fn refused_meshes_leave_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let mut bad = organs();
    bad[1].mesh.positions[3][2] = f32::NAN;
    let mut empty = organs();
    empty.iter_mut().for_each(|organ| organ.mesh.triangles.clear());
    for (format, name) in FORMATS {
        let path = folder.path().join(name);
        assert!(matches!(format.write(&path, &bad), Err(WriteMeshError::NotFinite { at: 3, .. })), "{format}");
        assert!(matches!(format.write(&path, &empty), Err(WriteMeshError::Empty { organs: 2, .. })), "{format}");
        assert!(entries(folder.path()).is_empty(), "{format}");
    }
    for (format, name) in FORMATS {
        // A folder stands where the file should be.
        let path = folder.path().join(name);
        fs::create_dir(&path).unwrap();
        let message = format.write(&path, &organs()).unwrap_err().to_string();
        assert!(message.contains("could not write"), "{message}");
    }
}

#[test]
fn the_thread_count_changes_no_byte() {
    let folder = tempfile::tempdir().unwrap();
    // More vertices and triangles than one chunk.
    let organs = [blob("liver", [60.0, -20.0, 700.0], 150)];
    for (format, name) in FORMATS {
        let bytes = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let path = folder.path().join(name);
            pool.install(|| write(format, &path, &organs));
            fs::read(&path).unwrap()
        };
        assert!(bytes(1) == bytes(3), "{format}");
    }
}
