//! What is written: the same values and places when read again, and a file that stays as it was when refused.

use std::path::Path;

use yawara::geometry::{Affine, Grid, GridShape, Matrix3, Vector3};
use yawara::io::nifti::{
    AffineSource, CtEncoding, Datatype, SpatialUnit, read_ct, read_info, read_labels, write_ct, write_labels,
};
use yawara::volume::{CtVolume, LabelVolume, Overlay, SAME_GRID_TOLERANCE, check_same_grid};

use crate::support::{assert_says, variant};

const SHAPE: GridShape = GridShape::new(7, 5, 3);

/// Grids of every kind; the last is sheared, which a qform cannot hold.
fn grids() -> Vec<(&'static str, Grid)> {
    let turn = |x, y, z| nalgebra::Rotation3::from_euler_angles(x, y, z).into_inner();
    let scaled = |spacing: [f64; 3]| Matrix3::from_diagonal(&Vector3::from(spacing));
    let sheared = Matrix3::new(0.8, 0.0, 0.0, 0.0, 0.8, 0.33, 0.0, 0.0, 2.5);
    [
        ("straight", scaled([0.8, 0.8, 2.5])),
        ("left-handed", scaled([-1.5, 1.5, 1.5])),
        ("LPS", scaled([-0.7, -0.7, 5.0])),
        ("half turn", turn(std::f64::consts::PI, 0.0, 0.0) * scaled([1.0, 2.0, 3.0])),
        ("oblique", turn(0.1, -0.5, 2.8) * scaled([1.5, 1.5, 3.0])),
        ("oblique, left-handed", turn(-2.0, 0.7, -1.3) * scaled([1.5, 0.9, -3.0])),
        ("sheared", sheared),
    ]
    .into_iter()
    .map(|(name, linear)| {
        let affine = Affine::from_parts(linear, Vector3::new(-177.95633, 11.319, 394.30176)).unwrap();
        (name, Grid { shape: SHAPE, affine })
    })
    .collect()
}

fn ct(grid: Grid) -> CtVolume {
    CtVolume::from_vec(grid, (0..SHAPE.len()).map(|n| (n as f32 * 0.77).sin() * 1500.25 - 300.0).collect())
}

#[test]
fn values_and_places_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let mut cases = 0;
    for (kind, grid) in grids() {
        for name in ["a.nii", "a.nii.gz", "deep/er/A.NII.GZ"] {
            let path = folder.path().join(name);
            let ct = ct(grid);
            write_ct(&path, &ct, CtEncoding::Float32).unwrap();
            let (found, info) = read_ct(&path).unwrap();
            assert_eq!(found.as_slice(), ct.as_slice(), "{kind} {name}");
            assert_eq!(check_same_grid(&grid, &info.grid, Overlay::Labels), Ok(()), "{kind} {name}");
            assert_eq!((info.datatype, info.unit), (Datatype::F32, SpatialUnit::Millimetre));
            assert_eq!((info.affine_source, info.gzip), (AffineSource::Sform, name != "a.nii"));
            assert_eq!(info.description, "yawara");

            write_ct(&path, &ct, CtEncoding::Int16).unwrap();
            let (found, info) = read_ct(&path).unwrap();
            assert!(found.as_slice().iter().zip(ct.as_slice()).all(|(a, b)| *a == b.round()), "{kind} {name}");
            assert_eq!((info.datatype, info.scaling), (Datatype::I16, None));

            for (largest, datatype) in [(255, Datatype::U8), (65_535, Datatype::U16)] {
                let mut labels: Vec<u16> = (0..SHAPE.len() as u16).map(|n| n % 9).collect();
                labels[11] = largest;
                let labels = LabelVolume::from_vec(grid, labels);
                write_labels(&path, &labels).unwrap();
                let (found, info) = read_labels(&path).unwrap();
                assert_eq!(found.as_slice(), labels.as_slice(), "{kind} {name}");
                assert_eq!(info.datatype, datatype);
            }
            cases += 1;
        }
    }
    assert_eq!(cases, 21);
}

#[test]
fn the_qform_says_the_same_as_the_sform() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.nii");
    for (kind, grid) in grids() {
        write_ct(&path, &ct(grid), CtEncoding::Float32).unwrap();
        let mut bytes = std::fs::read(&path).unwrap();
        // sform_code to 0: the reader must fall back on the qform, or on the spacing where there is none.
        bytes[254] = 0;
        std::fs::write(&path, bytes).unwrap();
        let info = read_info(&path).unwrap();
        if kind == "sheared" {
            assert_eq!(info.affine_source, AffineSource::Spacing);
        } else {
            assert_eq!(info.affine_source, AffineSource::Qform, "{kind}");
            assert_eq!(
                check_same_grid(&grid, &info.grid, Overlay::Labels),
                Ok(()),
                "{kind} within {SAME_GRID_TOLERANCE}"
            );
        }
    }
}

#[test]
fn the_same_volume_gives_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str| {
        let path = folder.path().join(name);
        write_ct(&path, &ct(grids()[0].1), CtEncoding::Int16).unwrap();
        std::fs::read(path).unwrap()
    };
    assert_eq!(write("one.nii.gz"), write("another.nii.gz"));
}

#[test]
fn what_cannot_be_written_is_refused_and_the_old_file_stays() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("kept.nii");
    std::fs::write(&path, b"old").unwrap();
    let refused = |value: f32, found: &str| {
        let mut values = ct(grids()[0].1).as_slice().to_vec();
        values[SHAPE.linear([1, 2, 1])] = value;
        let error = write_ct(&path, &CtVolume::from_vec(grids()[0].1, values), CtEncoding::Int16).unwrap_err();
        assert_eq!(variant(&error), "NotInt16");
        assert_says(&error.to_string(), &["kept.nii", "(1, 2, 1)", found, "float32"]);
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
    };
    refused(32_768.0, "32768");
    refused(-40_000.5, "-40000.5");
    refused(f32::NAN, "NaN");

    let labels = LabelVolume::from_vec(grids()[0].1, vec![1; SHAPE.len()]);
    let error = write_labels(Path::new("out/labels.nrrd"), &labels).unwrap_err();
    assert_eq!(variant(&error), "Name");
    assert_says(&error.to_string(), &["labels.nrrd", ".nii.gz", "rename"]);

    let long = Grid { shape: GridShape::new(40_000, 1, 1), ..grids()[0].1 };
    let error = write_labels(&path, &LabelVolume::from_vec(long, vec![1; 40_000])).unwrap_err();
    assert_eq!(variant(&error), "Shape");
    assert_says(&error.to_string(), &["kept.nii", "40000", "axis 1", "32767"]);

    let blocked = path.join("below-a-file.nii");
    let error = write_labels(&blocked, &labels).unwrap_err();
    assert_eq!(variant(&error), "Io");
    assert_says(&error.to_string(), &["below-a-file.nii", "could not write"]);
    assert_eq!(std::fs::read(&path).unwrap(), b"old");
}
