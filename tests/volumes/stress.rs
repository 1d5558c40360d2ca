//! One real crop in many encodings, some of them damaged: every case of `stress-derived/expected.json` that is NIfTI.

use serde_json::Value;
use yawara::io::nifti::{AIR_HU, AffineSource, SpatialUnit, read_ct, read_info, read_labels};

use crate::support::{shared_data, variant};

/// The affines of `expected.json` are rounded to six decimals, the files hold f32.
const AFFINE_TOLERANCE: f64 = 2e-5;
/// Means are rounded to six decimals.
const MEAN_TOLERANCE: f64 = 1e-6;

/// What each damaged file is refused with.
const REFUSED: [(&str, &str); 16] = [
    ("bitpix_mismatch.nii", "Bitpix"),
    ("datatype_unknown.nii", "UnknownDatatype"),
    ("dim0_zero.nii", "Dimension"),
    ("dim1_negative.nii", "Dimension"),
    ("dim_huge.nii", "Truncated"),
    ("empty.nii", "ShortHeader"),
    ("four_d.nii.gz", "NotThreeD"),
    ("gz_bad_crc.nii.gz", "Gzip"),
    ("pixdim_nan.nii", "Spacing"),
    ("srow_nan.nii", "Affine"),
    ("srow_singular.nii", "Affine"),
    ("truncated_data.nii", "Truncated"),
    ("truncated_gz.nii.gz", "Gzip"),
    ("truncated_header.nii", "ShortHeader"),
    ("vox_offset_nan.nii", "VoxOffset"),
    ("vox_offset_past_end.nii", "VoxOffset"),
];

fn number(case: &Value, key: &str) -> f64 {
    case[key].as_f64().unwrap_or_else(|| panic!("{key} is missing in {case}"))
}

#[test]
fn every_encoding_gives_the_expected_volume_or_error() {
    let Some(folder) = shared_data("stress-derived") else { return };
    let expected: Value = serde_json::from_slice(&std::fs::read(folder.join("expected.json")).unwrap()).unwrap();
    let is_nifti = |name: &str| [".nii", ".nii.gz", ".hdr"].iter().any(|ending| name.ends_with(ending));
    let (mut volumes, mut errors) = (0, 0);
    for (name, case) in expected.as_object().unwrap().iter().filter(|(name, _)| is_nifti(name)) {
        let path = folder.join(name);
        if let Some((_, error)) = REFUSED.iter().find(|(refused, _)| refused == name) {
            let found = read_ct(&path).unwrap_err();
            assert_eq!(variant(&found), *error, "{found}");
            assert!(found.to_string().contains(name.as_str()), "{found}");
            errors += 1;
            continue;
        }
        let (volume, info) = read_ct(&path).unwrap_or_else(|error| panic!("{error}"));
        let shape: Vec<u64> = case["shape"].as_array().unwrap().iter().map(|n| n.as_u64().unwrap()).collect();
        assert_eq!(info.shape().dims().map(|n| n as u64), shape[..3], "{name}");
        match case["affine_ras_mm"].as_array() {
            Some(rows) => {
                assert_ne!(info.affine_source, AffineSource::Spacing, "{name}");
                let matrix = info.affine().matrix();
                for (row, columns) in rows.iter().enumerate() {
                    for (column, entry) in columns.as_array().unwrap().iter().enumerate() {
                        let (found, entry) = (matrix[(row, column)], entry.as_f64().unwrap());
                        assert!(
                            (found - entry).abs() < AFFINE_TOLERANCE,
                            "{name} ({row}, {column}): {found} is not {entry}"
                        );
                    }
                }
            }
            None => {
                assert_eq!(info.affine_source, AffineSource::Spacing, "{name}");
                assert_eq!(info.spacing(), [3.0; 3], "{name}");
            }
        }
        // The file's own statistics leave out NaN and infinite voxels; here they became air, below every other value.
        let lost = if name == "f32_nan_inf.nii.gz" { 3 } else { 0 };
        assert_eq!(info.replaced_voxels, lost, "{name}");
        let kept: Vec<f32> = volume.as_slice().iter().copied().filter(|value| lost == 0 || *value != AIR_HU).collect();
        let statistics = volume.statistics();
        assert_eq!(kept.len() as u64 + lost, statistics.count, "{name}");
        let sum = statistics.sum - lost as f64 * f64::from(AIR_HU);
        assert_eq!(sum, number(case, "sum"), "{name}");
        assert!((sum / kept.len() as f64 - number(case, "mean")).abs() < MEAN_TOLERANCE, "{name}");
        assert_eq!(f64::from(kept.iter().copied().fold(f32::INFINITY, f32::min)), number(case, "min"), "{name}");
        assert_eq!(f64::from(statistics.max), number(case, "max"), "{name}");
        let at = volume.shape().linear([1, 2, 3]);
        assert_eq!(f64::from(volume.as_slice()[at]), number(case, "value_at_1_2_3"), "{name}");
        let positive = volume.as_slice().iter().filter(|value| **value > 0.0).count();
        assert_eq!(positive as f64, number(case, "count_gt_0"), "{name}");
        volumes += 1;
    }
    assert_eq!((volumes, errors), (23, 16));
}

#[test]
fn the_info_says_what_is_special() {
    let Some(folder) = shared_data("stress-derived") else { return };
    let info = |name: &str| read_info(&folder.join(name)).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(info("qform_only_qfac_neg.nii.gz").affine_source, AffineSource::Qform);
    assert_eq!(info("qform_only_qfac_neg.nii.gz").axis_codes(), "LAS");
    assert_eq!(info("sform_vs_qform.nii.gz").affine_source, AffineSource::Sform);
    assert_eq!(info("units_metre.nii.gz").unit, SpatialUnit::Metre);
    assert_eq!(info("units_micron.nii.gz").unit, SpatialUnit::Micron);
    assert_eq!(info("extension_slope0.nii").scaling, None);
    assert_eq!(info("extension_slope0.nii").offset, 416);
    assert_eq!(info("scl_i16_quarter.nii").scaling.map(|s| (s.slope, s.intercept)), Some((0.25, 100.0)));
    assert!(info("gz_named_nii.nii").gzip);
    assert!(!info("plain_named_gz.nii.gz").gzip);
    let by_image = info("pair_i16.img");
    assert_eq!(by_image, info("pair_i16.hdr"));
    assert!(by_image.data_path.ends_with("pair_i16.img") && by_image.header_path.ends_with("pair_i16.hdr"));
    let (labels, _) = read_labels(&folder.join("label_u8.nii.gz")).unwrap();
    assert!(labels.as_slice().contains(&2));
    let refused = read_labels(&folder.join("base_i16.nii.gz")).unwrap_err();
    assert_eq!(variant(&refused), "NotALabel");
}
