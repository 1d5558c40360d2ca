//! Files of other readers' test suites; the numbers are those of nibabel 5.4.2 on the same files.

use std::path::Path;

use yawara::geometry::Point3;
use yawara::io::nifti::{AffineSource, ByteOrder, Datatype, read_ct, read_info, read_labels};

use crate::support::{shared_data, variant};

/// Places are printed with five decimals, affines are f32.
const PLACE_TOLERANCE: f64 = 5e-5;
/// Sums of f32 values in another order.
const SUM_TOLERANCE: f64 = 1e-9;

/// A file, and what nibabel finds in it.
struct Found {
    file: &'static str,
    shape: [usize; 3],
    datatype: Datatype,
    order: ByteOrder,
    source: AffineSource,
    axes: &'static str,
    min_max_sum: [f64; 3],
    /// The last voxel and its place, RAS+ [mm].
    last: [f64; 3],
}

const FOUND: [Found; 8] = [
    Found {
        file: "nibabel/anatomical.nii",
        shape: [33, 41, 25],
        datatype: Datatype::I16,
        order: ByteOrder::Big,
        source: AffineSource::Sform,
        axes: "LAS",
        min_max_sum: [-610.0, 30393.0, 284166082.0],
        last: [-32.0, 40.0, 32.0],
    },
    Found {
        file: "nibabel/reoriented_anat_moved.nii",
        shape: [21, 26, 22],
        datatype: Datatype::F32,
        order: ByteOrder::Big,
        source: AffineSource::Sform,
        axes: "RAS",
        min_max_sum: [0.0, 21199.935546875, 32739769.449157715],
        last: [44.70210, 52.02242, 56.40059],
    },
    Found {
        file: "nibabel/standard.nii.gz",
        shape: [4, 5, 7],
        datatype: Datatype::U8,
        order: ByteOrder::Little,
        source: AffineSource::Sform,
        axes: "RAS",
        min_max_sum: [0.0, 255.0, 7650.0],
        last: [3.0, 12.0, 12.0],
    },
    Found {
        file: "nifti-rs/f32.nii.gz",
        shape: [11, 11, 11],
        datatype: Datatype::F32,
        order: ByteOrder::Little,
        source: AffineSource::Sform,
        axes: "RAS",
        min_max_sum: [0.0, 1.0, 166.00000071525574],
        last: [10.0, 10.0, 10.0],
    },
    Found {
        file: "nifti-rs/minimal_extended_hdr.nii",
        shape: [8, 8, 1],
        datatype: Datatype::F64,
        order: ByteOrder::Little,
        source: AffineSource::Sform,
        axes: "RAS",
        min_max_sum: [0.0, 0.0, 0.0],
        last: [7.0, 7.0, 0.0],
    },
    Found {
        file: "NIFTI-Reader-JS/big.nii.gz",
        shape: [64, 64, 21],
        datatype: Datatype::F32,
        order: ByteOrder::Big,
        source: AffineSource::Qform,
        axes: "LAS",
        min_max_sum: [-8.710750579833984, 18.582529067993164, 11648.372022011292],
        last: [-252.0, 252.0, 120.0],
    },
    Found {
        file: "NIFTI-Reader-JS/little.nii.gz",
        shape: [64, 64, 21],
        datatype: Datatype::F32,
        order: ByteOrder::Little,
        source: AffineSource::Qform,
        axes: "LAS",
        min_max_sum: [-8.710750579833984, 18.582529067993164, 11648.372022011292],
        last: [-252.0, 252.0, 120.0],
    },
    Found {
        file: "NIFTI-Reader-JS/air.hdr.gz",
        shape: [79, 67, 64],
        datatype: Datatype::F32,
        order: ByteOrder::Little,
        source: AffineSource::Sform,
        axes: "AIR",
        min_max_sum: [0.0, 92.55388641357422, 11398461.247137904],
        last: [74.50709, 75.63826, -71.76254],
    },
];

#[test]
fn found_files_agree_with_nibabel() {
    let Some(folder) = shared_data("stress-found/nifti") else { return };
    for expected in FOUND {
        let file = expected.file;
        let (volume, info) = read_ct(&folder.join(file)).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(info.shape().dims(), expected.shape, "{file}");
        assert_eq!(info.datatype, expected.datatype, "{file}");
        assert_eq!(info.byte_order, expected.order, "{file}");
        assert_eq!(info.affine_source, expected.source, "{file}");
        assert_eq!(info.axis_codes(), expected.axes, "{file}");
        let statistics = volume.statistics();
        let [min, max, sum] = expected.min_max_sum;
        assert_eq!((f64::from(statistics.min), f64::from(statistics.max)), (min, max), "{file}");
        assert!((statistics.sum - sum).abs() <= SUM_TOLERANCE * sum.abs(), "{file}: {} is not {sum}", statistics.sum);
        let last = info.grid.place(info.shape().len() - 1);
        assert!((last - Point3::from(expected.last)).norm() < PLACE_TOLERANCE, "{file}: {last}");
    }
}

#[test]
fn a_pair_is_read_by_either_name() {
    let Some(folder) = shared_data("stress-found/nifti") else { return };
    let (by_header, _) = read_ct(&folder.join("NIFTI-Reader-JS/air.hdr.gz")).unwrap();
    let (by_image, info) = read_ct(&folder.join("NIFTI-Reader-JS/air.img.gz")).unwrap();
    assert!(by_header == by_image);
    assert!(info.header_path.ends_with("air.hdr.gz") && info.data_path.ends_with("air.img.gz"));

    // No orientation at all: nibabel centres and flips such a volume, the standard's method 1 does neither.
    let (single, info) = read_ct(&folder.join("nifti-rs/minimal.nii")).unwrap();
    assert_eq!(info.affine_source, AffineSource::Spacing);
    assert_eq!(info.grid.place(single.shape().linear([1, 2, 3])), Point3::new(3.0, 6.0, 9.0));
    assert_eq!(single.statistics().sum, 1290240.0);
    for name in ["minimal.nii.gz", "minimal.hdr", "minimal.img"] {
        let (volume, info) = read_ct(&folder.join("nifti-rs").join(name)).unwrap();
        assert!(volume == single, "{name}");
        assert_eq!(info.byte_order, ByteOrder::Big);
    }
}

#[test]
fn ten_types_hold_the_same_ramp() {
    let Some(folder) = shared_data("stress-found/nifti/nifti-rs/27") else { return };
    let mut types = Vec::new();
    for entry in std::fs::read_dir(&folder).unwrap() {
        let path = entry.unwrap().path();
        let (ct, info) = read_ct(&path).unwrap();
        let (labels, _) = read_labels(&path).unwrap();
        // Counted with k fastest: 0, 9, 18 along i.
        let ramp = |n: usize| 9 * (n % 3) + 3 * (n / 3 % 3) + n / 9;
        assert!(ct.as_slice().iter().enumerate().all(|(n, value)| *value == ramp(n) as f32), "{}", path.display());
        assert!(
            labels.as_slice().iter().enumerate().all(|(n, label)| usize::from(*label) == ramp(n)),
            "{}",
            path.display()
        );
        assert!(path.ends_with(format!("{}.nii", info.datatype)), "{} is {}", path.display(), info.datatype);
        types.push(info.datatype);
    }
    types.sort_by_key(|datatype| datatype.code());
    types.dedup();
    assert_eq!(types.len(), Datatype::ALL.len());
}

#[test]
fn what_cannot_be_one_volume_is_refused() {
    let Some(folder) = shared_data("stress-found/nifti") else { return };
    let refused = [
        ("nibabel/example4d.nii.gz", "NotThreeD", "dim[4] = 2"),
        ("nibabel/functional.nii", "NotThreeD", "dim[4] = 20"),
        ("nibabel/nifti1.hdr", "MissingPart", "nifti1.img"),
        ("nifti-rs/crash-1.nii", "NotNifti", "bytes"),
        ("nifti-rs/crash-08123ef33416bd6f0c5fa63d44b681b8581d62a0", "NotNifti", "bytes"),
        ("NIFTI-Reader-JS/not-nifti.nii", "NotNifti", "bytes"),
    ];
    for (file, error, part) in refused {
        let path = folder.join(file);
        let name = Path::new(file).file_name().unwrap().to_str().unwrap();
        for found in [read_ct(&path).err(), read_labels(&path).err(), read_info(&path).err()] {
            let found = found.unwrap_or_else(|| panic!("{file} was read"));
            assert_eq!(variant(&found), error, "{found}");
            assert!(found.to_string().contains(part) && found.to_string().contains(name), "{found}");
        }
    }
}
