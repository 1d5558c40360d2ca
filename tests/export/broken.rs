//! Files cut short or with bytes changed are refused with an error, never with a panic.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use proptest::prelude::*;
use yawara::io::gltf::{GltfReader, MorphAnimationWriter, Precision, StepAnimationWriter, write_gltf};
use yawara::io::mesh_error::ReadMeshError;
use yawara::io::mesh_format::MeshFormat;

use crate::blob;

/// One small file of each kind.
static FILES: LazyLock<Vec<(&str, MeshFormat, Vec<u8>)>> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m");
    let organs = [blob("liver", [1.0, 2.0, 3.0], 3), blob("kidney", [100.0, 2.0, 3.0], 2)];
    let formats = [MeshFormat::Stl, MeshFormat::StlAscii, MeshFormat::Ply, MeshFormat::Glb];
    let mut files: Vec<_> = formats
        .into_iter()
        .zip(["b.stl", "a.stl", "m.ply", "m.glb"])
        .map(|(format, name)| {
            format.write(&path, &organs).unwrap();
            (name, format, fs::read(&path).unwrap())
        })
        .collect();
    let mut writer = StepAnimationWriter::create(&path, Precision::Float).unwrap();
    (0..3).for_each(|at| writer.push_frame(f64::from(at), &organs[at as usize % 2..]).unwrap());
    writer.finish().unwrap();
    files.push(("run.glb", MeshFormat::Glb, fs::read(&path).unwrap()));
    write_gltf(&path, &organs, Precision::Quantized).unwrap();
    files.push(("quantised.glb", MeshFormat::Glb, fs::read(&path).unwrap()));
    let mut writer = MorphAnimationWriter::create(&path).unwrap();
    (0..3).for_each(|at| writer.push_frame(f64::from(at), &organs[at as usize / 2..]).unwrap());
    writer.finish().unwrap();
    files.push(("morph.glb", MeshFormat::Glb, fs::read(&path).unwrap()));
    files
});

fn read(format: MeshFormat, path: &Path) -> Result<(), ReadMeshError> {
    if format == MeshFormat::Glb {
        let mut reader = GltfReader::open(path)?;
        return (0..reader.frames()).try_for_each(|frame| reader.read_frame(frame).map(drop));
    }
    format.read(path).map(drop)
}

fn put(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    fs::write(&path, bytes).unwrap();
    path
}

#[test]
fn whole_files_are_read() {
    let folder = tempfile::tempdir().unwrap();
    for (name, format, bytes) in FILES.iter() {
        read(*format, &put(folder.path(), name, bytes)).unwrap();
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn files_cut_short_are_refused(file in 0..7usize, share in 0.0..1.0f64) {
        let (name, format, bytes) = &FILES[file];
        let mut end = (bytes.len() as f64 * share) as usize;
        if *format == MeshFormat::StlAscii {
            // Without its last line the file is incomplete; within that line nothing is lost.
            let last = bytes.windows(8).rposition(|w| w == b"endsolid").unwrap();
            end = end.min(last);
        }
        let folder = tempfile::tempdir().unwrap();
        let error = read(*format, &put(folder.path(), name, &bytes[..end])).expect_err("cut short");
        prop_assert!(error.to_string().contains(name), "{error}");
    }

    #[test]
    fn changed_bytes_never_panic(file in 0..7usize, changes in prop::collection::vec((0.0..1.0f64, any::<u8>()), 1..6)) {
        let (name, format, bytes) = &FILES[file];
        let mut bytes = bytes.clone();
        for (share, byte) in changes {
            let at = (bytes.len() as f64 * share) as usize;
            bytes[at] = byte;
        }
        let folder = tempfile::tempdir().unwrap();
        if let Err(error) = read(*format, &put(folder.path(), name, &bytes)) {
            prop_assert!(error.to_string().contains(name), "{error}");
        }
    }

    #[test]
    fn changed_numbers_in_glb_json_never_panic(file in 3..7usize, which in 0.0..1.0f64, number in prop::sample::select(
        vec!["0", "1", "7", "65535", "4294967295", "18446744073709551615", "-1", "1e30", "null", "[]"])) {
        let (name, format, bytes) = &FILES[file];
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let text = std::str::from_utf8(&bytes[20..20 + length]).unwrap();
        let digit = |c: char| c.is_ascii_digit() || c == '-' || c == '.';
        let starts: Vec<usize> = (1..text.len())
            .filter(|&at| text[at..].starts_with(digit) && text[..at].ends_with([':', '[', ',']))
            .collect();
        let start = starts[(which * starts.len() as f64) as usize];
        let end = start + text[start..].find(|c| !digit(c)).unwrap();
        let mut json = format!("{}{number}{}", &text[..start], text[end..].trim_end());
        while json.len() % 4 != 0 {
            json.push(' ');
        }
        let mut changed = bytes[..12].to_vec();
        changed.extend((json.len() as u32).to_le_bytes());
        changed.extend(b"JSON");
        changed.extend(json.as_bytes());
        changed.extend(&bytes[20 + length..]);
        let total = changed.len() as u32;
        changed[8..12].copy_from_slice(&total.to_le_bytes());
        let folder = tempfile::tempdir().unwrap();
        if let Err(error) = read(*format, &put(folder.path(), name, &changed)) {
            prop_assert!(error.to_string().contains(name), "{error}");
        }
    }
}

#[test]
fn missing_files_are_named() {
    for (name, format, _) in FILES.iter() {
        let message = read(*format, Path::new("no/such/folder").join(name).as_path()).unwrap_err().to_string();
        assert!(message.contains(name) && message.contains("could not read"), "{message}");
    }
}

#[test]
fn lying_counts_do_not_reserve_memory() {
    let folder = tempfile::tempdir().unwrap();
    let mut stl = vec![0; 84];
    stl[80..].copy_from_slice(&u32::MAX.to_le_bytes());
    let message = read(MeshFormat::Stl, &put(folder.path(), "huge.stl", &stl)).unwrap_err().to_string();
    assert!(message.contains("4294967295 triangles need 214748364834 bytes, the file has 84"), "{message}");
    let mut glb = b"glTF\x02\0\0\0\xff\xff\xff\xff\xff\xff\xff\x7fJSON".to_vec();
    let message = read(MeshFormat::Glb, &put(folder.path(), "huge.glb", &glb)).unwrap_err().to_string();
    assert!(message.contains("4294967295 bytes, the file has 20"), "{message}");
    glb[8..12].copy_from_slice(&20u32.to_le_bytes());
    let message = read(MeshFormat::Glb, &put(folder.path(), "huge.glb", &glb)).unwrap_err().to_string();
    assert!(message.contains("no JSON chunk"), "{message}");
    let ply = "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
               element face 18446744073709551615\nproperty list uint int vertex_indices\nend_header\n0123456789ab\u{7f}\u{7f}\u{7f}\u{7f}";
    let message = read(MeshFormat::Ply, &put(folder.path(), "huge.ply", ply.as_bytes())).unwrap_err().to_string();
    assert!(message.contains("row 0 of 18446744073709551615"), "{message}");
}
