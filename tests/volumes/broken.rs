//! `fixtures/bad`: small files, each with one fault, each refused with one named error.
//!
//! `UPDATE_GOLDEN=1` rewrites the files and their table in `fixtures/README.md`; otherwise both are compared with what the
//! reader says.

use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};
use yawara::io::nifti::{ReadVolumeError, read_ct, read_info, read_labels};

use crate::builder::{Nifti, gzip};
use crate::support::{assert_says, variant};

/// One broken file.
struct Case {
    file: &'static str,
    bytes: Vec<u8>,
    fault: &'static str,
    error: &'static str,
    /// What the message must hold beside the file's name: field, value found, value expected.
    says: &'static [&'static str],
}

const fn nan() -> f64 {
    f64::NAN
}

fn sound() -> Nifti {
    Nifti::new([4, 3, 2])
}

fn with(change: impl FnOnce(&mut Nifti)) -> Vec<u8> {
    let mut nifti = sound();
    change(&mut nifti);
    nifti.file()
}

fn with_dims(dim: [i64; 8]) -> Vec<u8> {
    with(|n| n.dim = dim)
}

fn with_qform(change: impl FnOnce(&mut Nifti)) -> Vec<u8> {
    with(|n| {
        (n.sform_code, n.qform_code) = (0, 1);
        change(n);
    })
}

fn cut(mut bytes: Vec<u8>, length: usize) -> Vec<u8> {
    bytes.truncate(length);
    bytes
}

fn label(value: f64, datatype: (i16, i16)) -> Vec<u8> {
    let mut nifti = sound().typed(datatype);
    nifti.values[17] = value;
    nifti.file()
}

fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    let mut case = |file, bytes, fault, error, says| cases.push(Case { file, bytes, fault, error, says });

    case("empty.nii", vec![], "no byte at all", "ShortHeader", &["0 bytes", "348"]);
    case("header_short.nii", cut(sound().file(), 200), "ends within the header", "ShortHeader", &["200", "348"]);
    case(
        "header_short_v2.nii",
        cut(sound().two().file(), 400),
        "ends within a NIfTI-2 header",
        "ShortHeader",
        &["400", "540"],
    );
    case(
        "magic_unknown.nii",
        {
            let mut bytes = sound().file();
            bytes[344..348].copy_from_slice(b"n+9\0");
            bytes
        },
        "unknown magic",
        "NotNifti",
        &["n+9", "NIfTI-1"],
    );
    case(
        "analyze.hdr",
        {
            let mut bytes = cut(sound().file(), 348);
            bytes[344..348].fill(0);
            bytes
        },
        "ANALYZE 7.5: no magic",
        "NotNifti",
        &["ANALYZE 7.5", "convert"],
    );
    case("nrrd_named_nii.nii", b"NRRD0005\ntype: short\n".to_vec(), "another format", "NotNifti", &["NRRD"]);
    case(
        "lone.hdr",
        {
            let mut nifti = sound();
            nifti.single = false;
            nifti.header()
        },
        "a pair without its .img",
        "MissingPart",
        &["lone.img", "both files"],
    );

    case("dim0_eight.nii", with_dims([8, 4, 3, 2, 1, 1, 1, 1]), "dim[0] = 8", "Dimension", &["dim[0] = 8", "1 to 7"]);
    case(
        "dim1_zero.nii",
        with_dims([3, 0, 3, 2, 1, 1, 1, 1]),
        "dim[1] = 0",
        "Dimension",
        &["dim[1] = 0", "at least 1"],
    );
    case("dim2_negative.nii", with_dims([3, 4, -3, 2, 1, 1, 1, 1]), "dim[2] = -3", "Dimension", &["dim[2] = -3"]);
    case(
        "dim4_series.nii",
        with_dims([4, 4, 3, 1, 2, 1, 1, 1]),
        "two volumes",
        "NotThreeD",
        &["dim[4] = 2", "expected 1", "[4, 3, 1, 2]"],
    );
    case(
        "dim5_vectors.nii",
        with_dims([5, 2, 2, 2, 1, 3, 1, 1]),
        "three values per voxel",
        "NotThreeD",
        &["dim[5] = 3"],
    );
    case(
        "dim_huge.nii",
        with_dims([3, 32767, 32767, 32767, 1, 1, 1, 1]),
        "70 TB in 400 bytes",
        "Truncated",
        &["400 bytes", "70362301923678", "32767x32767x32767"],
    );
    case(
        "dim_huge.nii.gz",
        gzip(&with_dims([3, 32767, 32767, 32767, 1, 1, 1, 1])),
        "70 TB in a small gzip file",
        "Truncated",
        &["70362301923678"],
    );
    case(
        "dim_overflow_v2.nii",
        {
            let mut nifti = sound().two();
            nifti.dim[1..4].fill(1 << 62);
            nifti.file()
        },
        "2^186 voxels",
        "TooLarge",
        &["4611686018427387904x", "crop"],
    );
    case(
        "data_short.nii",
        cut(sound().file(), 399),
        "one byte missing",
        "Truncated",
        &["399 bytes", "expected 400", "int16"],
    );
    case(
        "data_short.nii.gz",
        gzip(&cut(sound().file(), 399)),
        "one byte missing in whole gzip",
        "Truncated",
        &["399 bytes", "expected 400"],
    );
    case(
        "gzip_short.nii.gz",
        {
            let packed = gzip(&sound().file());
            let length = packed.len() - 20;
            cut(packed, length)
        },
        "gzip stream cut",
        "Gzip",
        &["gzip", "copy it again"],
    );
    case(
        "gzip_bad_crc.nii.gz",
        {
            let mut packed = gzip(&sound().file());
            let crc = packed.len() - 8;
            packed[crc] ^= 1;
            packed
        },
        "gzip checksum wrong",
        "Gzip",
        &["gzip", "400 uncompressed"],
    );

    case("datatype_unknown.nii", with(|n| n.datatype = 999), "datatype 999", "UnknownDatatype", &["999", "1280"]);
    case(
        "datatype_rgb.nii",
        with(|n| (n.datatype, n.bitpix) = (128, 24)),
        "colour",
        "UnsupportedDatatype",
        &["128", "RGB24"],
    );
    case(
        "datatype_complex.nii",
        with(|n| (n.datatype, n.bitpix) = (32, 64)),
        "complex",
        "UnsupportedDatatype",
        &["complex64"],
    );
    case(
        "bitpix_mismatch.nii",
        with(|n| n.bitpix = 32),
        "int16 with 32 bits",
        "Bitpix",
        &["32", "int16", "expected 16"],
    );
    case("vox_offset_nan.nii", with(|n| n.vox_offset = nan()), "vox_offset NaN", "VoxOffset", &["NaN", "352"]);
    case(
        "vox_offset_in_header.nii",
        with(|n| n.vox_offset = 100.0),
        "voxels in the header",
        "VoxOffset",
        &["100", "352"],
    );
    case("vox_offset_fraction.nii", with(|n| n.vox_offset = 352.5), "half a byte", "VoxOffset", &["352.5"]);
    case("vox_offset_past_end.nii", with(|n| n.vox_offset = 1e9), "past the end", "VoxOffset", &["1000000000", "400"]);

    case("pixdim_nan.nii", with(|n| n.pixdim[2] = nan()), "pixdim[2] NaN", "Spacing", &["pixdim[2] = NaN"]);
    case("pixdim_zero.nii", with(|n| n.pixdim[1] = 0.0), "pixdim[1] 0", "Spacing", &["pixdim[1] = 0", "not 0"]);
    case("pixdim_absurd.nii", with(|n| n.pixdim[3] = 1e30), "pixdim[3] 1e30", "Spacing", &["pixdim[3]", "100000 mm"]);
    case("srow_absurd.nii", with(|n| n.srow[0][0] = 1e20), "axis of 1e20 mm", "Spacing", &["pixdim[1]"]);
    case("srow_nan.nii", with(|n| n.srow[1][3] = nan()), "sform NaN", "Affine", &["sform", "(1, 3)", "NaN"]);
    case("srow_singular.nii", with(|n| n.srow[2][2] = 0.0), "sform flat", "Affine", &["sform", "singular"]);
    case(
        "qoffset_infinite.nii",
        with_qform(|n| n.qoffset[0] = f64::INFINITY),
        "qform offset infinite",
        "Affine",
        &["qform", "inf"],
    );
    case(
        "quatern_nan.nii",
        with_qform(|n| n.quatern[0] = nan()),
        "quaternion NaN",
        "Quaternion",
        &["NaN", "at most 1"],
    );
    case(
        "quatern_long.nii",
        with_qform(|n| n.quatern = [1.0, 0.5, 0.0]),
        "no rotation",
        "Quaternion",
        &["0.5", "1.25"],
    );
    case(
        "qfac_nan.nii",
        with_qform(|n| n.pixdim[0] = nan()),
        "handedness NaN",
        "Handedness",
        &["pixdim[0] = NaN", "-1"],
    );
    case(
        "inter_nan.nii",
        with(|n| (n.slope, n.inter) = (2.0, nan())),
        "slope 2, intercept NaN",
        "Scaling",
        &["scl_inter = NaN", "2"],
    );
    case("units_seven.nii", with(|n| n.units = 7), "unit 7", "Units", &["7", "micron"]);

    case("label_negative.nii", label(-3.0, (4, 16)), "label -3", "NotALabel", &["(1, 1, 1)", "-3", "65535"]);
    case("label_fraction.nii", label(0.5, (16, 32)), "label 0.5", "NotALabel", &["(1, 1, 1)", "0.5"]);
    case("label_nan.nii", label(nan(), (64, 64)), "label NaN", "NotALabel", &["(1, 1, 1)", "NaN"]);
    case("label_large.nii", label(65536.0, (8, 32)), "label 65536", "NotALabel", &["(1, 1, 1)", "65536"]);
    cases
}

/// Every variant of the error, so that none goes untested when one is added here.
const VARIANTS: [&str; 21] = [
    "Affine",
    "Bitpix",
    "Dimension",
    "Gzip",
    "Handedness",
    "Io",
    "MissingPart",
    "NotAFile",
    "NotALabel",
    "NotNifti",
    "NotThreeD",
    "Quaternion",
    "Scaling",
    "ShortHeader",
    "Spacing",
    "TooLarge",
    "Truncated",
    "Units",
    "UnknownDatatype",
    "UnsupportedDatatype",
    "VoxOffset",
];

fn read(path: &Path) -> ReadVolumeError {
    let is_label = path.file_name().unwrap().to_string_lossy().starts_with("label_");
    let result = if is_label { read_labels(path).map(|_| ()) } else { read_ct(path).map(|_| ()) };
    result.expect_err(&path.display().to_string())
}

fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures")
}

const TABLE: [&str; 2] = ["<!-- bad: begin -->\n", "<!-- bad: end -->\n"];

fn table(cases: &[Case], folder: &Path) -> String {
    let mut text = String::from("\n| file | fault | error | sha256 |\n| --- | --- | --- | --- |\n");
    for Case { file, fault, error, .. } in cases {
        let digest = Sha256::digest(std::fs::read(folder.join(file)).unwrap());
        let sum = digest.iter().fold(String::new(), |sum, byte| sum + &format!("{byte:02x}"));
        writeln!(text, "| `{file}` | {fault} | `{error}` | `{sum}` |").unwrap();
    }
    text.push('\n');
    text
}

#[test]
fn every_bad_file_is_refused_with_its_error() {
    let folder = fixtures().join("bad");
    let cases = cases();
    let readme_path = fixtures().join("README.md");
    let readme = std::fs::read_to_string(&readme_path).unwrap();
    let (head, rest) = readme.split_once(TABLE[0]).unwrap();
    let (stated, tail) = rest.split_once(TABLE[1]).unwrap();
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        for case in &cases {
            std::fs::write(folder.join(case.file), &case.bytes).unwrap();
        }
        let text = [head, TABLE[0], &table(&cases, &folder), TABLE[1], tail].concat();
        std::fs::write(&readme_path, text).unwrap();
    } else {
        assert_eq!(stated, table(&cases, &folder), "fixtures/README.md and fixtures/bad differ");
    }

    // Folders beside the volumes hold other kinds of bad input.
    let files = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap()).filter(|e| e.path().is_file());
    let mut on_disk: Vec<_> = files.map(|entry| entry.file_name().into_string().unwrap()).collect();
    let mut expected: Vec<_> = cases.iter().map(|case| case.file.to_owned()).collect();
    on_disk.sort();
    expected.sort();
    assert_eq!(on_disk, expected);
    assert_eq!(cases.len(), 43);

    let mut seen = BTreeSet::new();
    for case in &cases {
        let error = read(&folder.join(case.file));
        assert_eq!(variant(&error), case.error, "{}: {error}", case.file);
        let message = error.to_string();
        assert_says(&message, &[case.file]);
        assert_says(&message, case.says);
        assert_says(&message, &["; "]);
        seen.insert(case.error);
    }
    seen.extend(["Io", "NotAFile"]);
    assert_eq!(seen.into_iter().collect::<Vec<_>>(), VARIANTS);
}

#[test]
fn what_is_no_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("missing.nii.gz");
    let error = read_info(&missing).unwrap_err();
    assert_eq!(variant(&error), "Io");
    assert_says(&error.to_string(), &["missing.nii.gz", "could not read", "No such file"]);
    let error = read_ct(folder.path()).unwrap_err();
    assert_eq!(variant(&error), "NotAFile");
    assert_says(&error.to_string(), &["a folder", "regular file", ".nii.gz"]);
    if Path::new("/dev/zero").exists() {
        assert_says(&read_ct(Path::new("/dev/zero")).unwrap_err().to_string(), &["/dev/zero", "device"]);
    }
}

#[test]
fn the_header_alone_shows_the_same_faults() {
    let folder = fixtures().join("bad");
    // Only what lies behind the header can go unseen: voxels that are no labels, and the end of a gzip stream.
    let unseen = ["label_negative.nii", "label_fraction.nii", "label_nan.nii", "label_large.nii"];
    let behind = ["data_short.nii.gz", "gzip_bad_crc.nii.gz", "gzip_short.nii.gz"];
    let mut refused = 0;
    for case in cases() {
        match read_info(&folder.join(case.file)) {
            Ok(_) => assert!(unseen.contains(&case.file) || behind.contains(&case.file), "{}", case.file),
            Err(error) => {
                assert_eq!(variant(&error), case.error);
                refused += 1;
            }
        }
    }
    assert!(refused >= 36, "{refused}");
}
