//! Any type, byte order, version and packing, written by the test's own writer and read back.

use proptest::prelude::*;
use yawara::geometry::Point3;
use yawara::io::nifti::{AffineSource, ByteOrder, NiftiVersion, Scaling, SpatialUnit, read_ct, read_info, read_labels};

use crate::builder::{Nifti, TYPES, gzip};

/// How the bytes lie in files.
#[derive(Debug, Clone, Copy)]
enum Packing {
    Plain,
    Gzip,
    TwoMembers,
    Pair,
    GzipPair,
}

const PACKINGS: [Packing; 5] = [Packing::Plain, Packing::Gzip, Packing::TwoMembers, Packing::Pair, Packing::GzipPair];

/// Writes the files and returns the name to ask for; of a pair, either.
fn write(folder: &std::path::Path, nifti: &Nifti, packing: Packing, by_image: bool) -> std::path::PathBuf {
    let put = |name: &str, bytes: &[u8]| {
        let path = folder.join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    match packing {
        Packing::Plain => put("a.nii", &nifti.file()),
        Packing::Gzip => put("a.nii.gz", &gzip(&nifti.file())),
        Packing::TwoMembers => {
            let bytes = nifti.file();
            let (head, tail) = bytes.split_at(bytes.len() - 1);
            put("a.nii", &[gzip(head), gzip(tail)].concat())
        }
        Packing::Pair => {
            let paths = [put("a.hdr", &nifti.header()), put("a.img", &nifti.body())];
            paths[usize::from(by_image)].clone()
        }
        Packing::GzipPair => {
            let paths = [put("a.hdr.gz", &gzip(&nifti.header())), put("a.img.gz", &gzip(&nifti.body()))];
            paths[usize::from(by_image)].clone()
        }
    }
}

/// Values every type holds exactly, and those that only this type holds.
fn values_of(datatype: i16) -> BoxedStrategy<f64> {
    match datatype {
        2 => (0..=255i32).prop_map(f64::from).boxed(),
        256 => (-128..=127i32).prop_map(f64::from).boxed(),
        4 => (-32_768..=32_767i32).prop_map(f64::from).boxed(),
        512 => (0..=65_535i32).prop_map(f64::from).boxed(),
        768 | 1280 => (0..=u32::MAX).prop_map(f64::from).boxed(),
        8 | 1024 => any::<i32>().prop_map(f64::from).boxed(),
        _ => any::<f32>().prop_map(f64::from).boxed(),
    }
}

fn any_nifti() -> impl Strategy<Value = (Nifti, Packing, bool)> {
    let kind = (0..TYPES.len(), any::<bool>(), any::<bool>(), 0..PACKINGS.len(), any::<bool>());
    (kind, 1..5i64, 1..5i64, 1..5i64, 0..4usize).prop_flat_map(
        |((kind, two, big, packing, by_image), nx, ny, nz, scale)| {
            let count = (nx * ny * nz) as usize;
            proptest::collection::vec(values_of(TYPES[kind].0), count).prop_map(move |values| {
                let packing = PACKINGS[packing];
                let single = !matches!(packing, Packing::Pair | Packing::GzipPair);
                let mut nifti = Nifti { big, single, values, ..Nifti::new([nx, ny, nz]).typed(TYPES[kind]) };
                if !single {
                    nifti.vox_offset = 0.0;
                }
                if two {
                    nifti = nifti.two();
                }
                // Exact in f32, so that both versions hold the same numbers.
                (nifti.slope, nifti.inter) = [(1.0, 0.0), (0.0, 7.0), (0.5, -1024.0), (f64::NAN, 3.0)][scale];
                (nifti, packing, by_image)
            })
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn what_was_written_is_read((nifti, packing, by_image) in any_nifti()) {
        let folder = tempfile::tempdir().unwrap();
        let path = write(folder.path(), &nifti, packing, by_image);
        let (volume, info) = read_ct(&path).unwrap();
        let scaled = |value: f64| if nifti.slope == 0.5 { value * 0.5 - 1024.0 } else { value };
        let mut replaced = 0;
        for (found, value) in volume.as_slice().iter().zip(&nifti.values) {
            let expected = scaled(*value) as f32;
            if expected.is_finite() {
                prop_assert_eq!(*found, expected);
            } else {
                prop_assert_eq!(*found, -1024.0);
                replaced += 1;
            }
        }
        prop_assert_eq!(info.replaced_voxels, replaced);
        prop_assert_eq!(info.shape().dims().map(|n| n as i64), [nifti.dim[1], nifti.dim[2], nifti.dim[3]]);
        prop_assert_eq!(info.datatype.code(), nifti.datatype);
        prop_assert_eq!(info.byte_order, if nifti.big { ByteOrder::Big } else { ByteOrder::Little });
        prop_assert_eq!(info.version, if nifti.two { NiftiVersion::Two } else { NiftiVersion::One });
        prop_assert_eq!(info.gzip, matches!(packing, Packing::Gzip | Packing::TwoMembers | Packing::GzipPair));
        let scaling = (nifti.slope == 0.5).then_some(Scaling { slope: 0.5, intercept: -1024.0 });
        prop_assert_eq!(info.scaling, scaling);
        prop_assert_eq!(info.affine_source, AffineSource::Sform);
        prop_assert_eq!(info.unit, SpatialUnit::Millimetre);
        prop_assert_eq!(info.affine().apply(Point3::new(1.0, 2.0, 3.0)), Point3::new(-9.0, 24.0, 39.0));
        let mut header = read_info(&path).unwrap();
        header.replaced_voxels = replaced;
        prop_assert_eq!(header, info);

        let label = |value: f64| (value.fract() == 0.0 && (0.0..=65_535.0).contains(&value)).then_some(value as u16);
        let labels: Option<Vec<u16>> = nifti.values.iter().map(|value| label(scaled(*value))).collect();
        prop_assert_eq!(read_labels(&path).ok().map(|(volume, _)| volume.as_slice().to_vec()), labels);
    }

    #[test]
    fn labels_are_read_from_every_type(kind in 0..TYPES.len(), big: bool, values in proptest::collection::vec(0..128u16, 24)) {
        let folder = tempfile::tempdir().unwrap();
        let stored = values.iter().map(|value| f64::from(*value)).collect();
        let nifti = Nifti { big, values: stored, ..Nifti::new([4, 3, 2]).typed(TYPES[kind]) };
        let path = write(folder.path(), &nifti, Packing::Plain, false);
        let (volume, _) = read_labels(&path).unwrap();
        prop_assert_eq!(volume.as_slice(), &values);
    }
}

#[test]
fn labels_scaled_by_a_rounded_slope_are_whole_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mask.nii");
    let mut nifti = Nifti::new([4, 3, 2]).typed((2, 8));
    nifti.values = (0..24).map(|n| if n % 2 == 0 { 0.0 } else { 255.0 }).collect();
    nifti.slope = 1.0 / 255.0;
    std::fs::write(&path, nifti.file()).unwrap();
    let (volume, _) = read_labels(&path).unwrap();
    assert!(volume.as_slice().iter().enumerate().all(|(n, label)| usize::from(*label) == n % 2));
    // Half of it is no label, however the slope was rounded.
    nifti.values[5] = 128.0;
    std::fs::write(&path, nifti.file()).unwrap();
    assert!(read_labels(&path).unwrap_err().to_string().contains("(1, 1, 0)"));
}
