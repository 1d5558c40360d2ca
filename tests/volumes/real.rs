//! Real volumes the whole way: counts of the data's own tables, places by nibabel 5.4.2.

use std::path::Path;
use std::time::Instant;

use yawara::geometry::{Point3, Vector3};
use yawara::io::label_names::LabelNames;
use yawara::io::nifti::{Datatype, read_ct, read_labels};
use yawara::volume::{
    GridMismatch, LabelVolume, Overlay, check_same_grid, grid_with_spacing, label_fraction, margin_in_voxels,
    resample_ct, resample_labels,
};

use crate::support::shared_data;

/// Places are printed with five decimals, affines are f32.
const PLACE_TOLERANCE: f64 = 5e-5;
/// Sums of a million coordinates.
const CENTROID_TOLERANCE: f64 = 1e-4;

fn labels(path: &Path) -> LabelVolume {
    read_labels(path).unwrap_or_else(|error| panic!("{error}")).0
}

/// Mean place of the voxels of a label, RAS+ [mm].
fn centroid(volume: &LabelVolume, label: u16) -> Point3 {
    let (mut sum, mut count) = (Vector3::zeros(), 0.0);
    for (linear, _) in volume.as_slice().iter().enumerate().filter(|(_, found)| **found == label) {
        sum += volume.grid().place(linear).coords;
        count += 1.0;
    }
    Point3::from(sum / count)
}

#[test]
fn voxels_lie_where_nibabel_puts_them() {
    let places = [
        ("ct-abdomen-3mm/example_ct.nii.gz", [0, 0, 0], [-177.95633, 11.31900, 94.30176]),
        ("ct-abdomen-3mm/example_ct.nii.gz", [60, 50, 100], [2.04367, 161.31900, 394.30176]),
        ("labels-1.5mm-s0327/liver.nii.gz", [0, 0, 0], [-186.49583, 31.62831, 92.77158]),
        ("labels-1.5mm-s0327/liver.nii.gz", [221, 165, 428], [159.70558, 258.10808, 734.77158]),
        ("labels-1.5mm-s0327/liver.nii.gz", [100, 80, 200], [-29.34726, 142.10150, 392.77158]),
        ("stress-derived/oblique_sform_qform.nii.gz", [29, 31, 40], [28.99962, 185.87547, 95.38820]),
        ("stress-derived/oblique_sform_qform.nii.gz", [1, 2, 3], [-28.83021, 53.92575, 16.70541]),
        ("stress-derived/sheared_sform.nii.gz", [29, 31, 40], [92.0, 113.15144, 153.0]),
        ("stress-derived/qform_only_qfac_neg.nii.gz", [29, 31, 40], [-27.0, 33.0, 140.0]),
    ];
    for (file, voxel, expected) in places {
        let Some(path) = shared_data(file) else { continue };
        let info = yawara::io::nifti::read_info(&path).unwrap();
        let found = info.grid.place(info.shape().linear(voxel));
        assert!((found - Point3::from(expected)).norm() < PLACE_TOLERANCE, "{file} {voxel:?}: {found}");
    }
}

#[test]
fn the_abdomen_has_the_organs_of_its_table() {
    let Some(folder) = shared_data("ct-abdomen-3mm") else { return };
    let (ct, info) = read_ct(&folder.join("example_ct.nii.gz")).unwrap();
    assert_eq!(info.datatype, Datatype::I32);
    assert_eq!((info.scaling, info.replaced_voxels), (None, 0));
    let statistics = ct.statistics();
    assert_eq!((statistics.min, statistics.max, statistics.sum), (-1207.0, 3382.0, -496851173.0));
    let seg = labels(&folder.join("example_seg.nii.gz"));
    assert_eq!(check_same_grid(ct.grid(), seg.grid(), Overlay::Labels), Ok(()));

    // Number, name, voxels, ..., axes along which the organ is cut off.
    let table = folder.join("labels.tsv");
    let names = LabelNames::read(&table).unwrap();
    let summaries = seg.label_summaries();
    let text = std::fs::read_to_string(&table).unwrap();
    let mut listed = 0;
    for row in text.lines().skip(1).map(|line| line.split('\t').collect::<Vec<_>>()) {
        let id: u16 = row[0].parse().unwrap();
        assert_eq!(names.id(row[1]), Ok(id));
        let found = summaries.iter().find(|summary| summary.label == id).unwrap();
        assert_eq!(found.voxels, row[2].parse::<u64>().unwrap(), "{}", row[1]);
        let cut: String =
            ['i', 'j', 'k'].into_iter().zip(found.touches).filter(|(_, t)| t[0] || t[1]).map(|(c, _)| c).collect();
        assert_eq!(if cut.is_empty() { "-" } else { &cut }, row[6], "{}", row[1]);
        listed += 1;
    }
    // The map has labels that the table leaves out only if the table says so: 58 rows.
    assert_eq!((listed, summaries.len(), names.len()), (58, 58, 58));

    let liver = names.id("liver").unwrap();
    let summary = summaries.iter().find(|summary| summary.label == liver).unwrap();
    assert_eq!(summary.voxels, 41733);
    assert_eq!((summary.bounds.min, summary.bounds.max), ([31, 25, 69], [104, 86, 111]));
    assert!((centroid(&seg, liver) - Point3::new(66.08019, 185.43898, 392.35186)).norm() < CENTROID_TOLERANCE);
    let hu: f64 =
        seg.as_slice().iter().zip(ct.as_slice()).filter(|(l, _)| **l == liver).map(|(_, hu)| f64::from(*hu)).sum();
    assert!((hu / 41733.0 - 44.43840605755637).abs() < 1e-9);
    let mask = labels(&folder.join("liver_mask_float64.nii.gz"));
    assert_eq!(mask.as_slice().iter().filter(|label| **label == 1).count(), 41602);
}

#[test]
fn a_crop_and_a_resampling_keep_the_liver_in_place() {
    let Some(folder) = shared_data("ct-abdomen-3mm") else { return };
    let (ct, _) = read_ct(&folder.join("example_ct.nii.gz")).unwrap();
    let seg = labels(&folder.join("example_seg.nii.gz"));
    let before = centroid(&seg, 5);
    let tight = seg.bounding_box(|label| *label == 5).unwrap();
    assert_eq!((tight.min, tight.max), ([31, 25, 69], [104, 86, 111]));
    let part = tight.grown(margin_in_voxels(seg.grid(), 10.0), seg.shape());
    assert_eq!((part.min, part.max), ([27, 21, 65], [108, 90, 111]));
    let (seg, ct) = (seg.crop(&part), ct.crop(&part));
    assert_eq!(check_same_grid(ct.grid(), seg.grid(), Overlay::Labels), Ok(()));
    assert_eq!(seg.as_slice().iter().filter(|label| **label == 5).count(), 41733);
    assert!((centroid(&seg, 5) - before).norm() < 1e-9);

    for spacing in [2.0, 4.0, 6.0] {
        let target = grid_with_spacing(seg.grid(), [spacing; 3]).unwrap();
        let fraction = label_fraction(&seg, &target, |label| label == 5);
        let volume = fraction.as_slice().iter().map(|part| f64::from(*part)).sum::<f64>() * spacing.powi(3);
        assert!((volume / (41733.0 * 27.0) - 1.0).abs() < 1e-5, "{spacing} mm: {volume} mm3");
        let majority = resample_labels(&seg, &target);
        let moved = (centroid(&majority, 5) - before).norm();
        // Ratios of 2/3 and 2 put borders in the middle of target voxels; each such tie is worth half a voxel.
        assert!(moved < 0.5 * spacing, "{spacing} mm: the centroid moved by {moved} mm");
        // Averages over boxes keep the mean exactly, once each voxel counts as much as of it lies inside the source;
        // interpolation on the finer grid only nearly.
        let tolerance = if spacing < 3.0 { 1.0 } else { 1e-3 };
        let inside = label_fraction(&seg, &target, |_| true);
        let other = resample_ct(&ct, &target, -1024.0);
        let weighted =
            inside.as_slice().iter().zip(other.as_slice()).map(|(part, hu)| f64::from(*part) * f64::from(*hu));
        let mean = weighted.sum::<f64>() / inside.statistics().sum;
        let off = mean - ct.statistics().mean();
        assert!(off.abs() < tolerance, "{spacing} mm: the mean is off by {off} HU");
    }
}

#[test]
fn the_oblique_liver_is_read_counted_and_coarsened() {
    let Some(folder) = shared_data("labels-1.5mm-s0327") else { return };
    let start = Instant::now();
    let liver = labels(&folder.join("liver.nii.gz"));
    let read = start.elapsed();
    let start = Instant::now();
    let summaries = liver.label_summaries();
    let counted = start.elapsed();
    eprintln!("222x166x429 labels: read in {read:.0?}, counted in {counted:.0?}");
    assert_eq!(liver.shape().dims(), [222, 166, 429]);
    let [summary] = summaries[..] else { panic!("{} labels", summaries.len()) };
    assert_eq!((summary.label, summary.voxels), (1, 382544));
    assert_eq!((summary.bounds.min, summary.bounds.max), ([84, 34, 192], [199, 148, 284]));
    assert!(!summary.touches_border());
    let before = centroid(&liver, 1);
    assert!((before - Point3::new(55.25905, 160.66810, 465.22993)).norm() < CENTROID_TOLERANCE, "{before}");

    let crop = liver.crop(&summary.bounds.grown([2; 3], liver.shape()));
    let target = grid_with_spacing(crop.grid(), [3.0; 3]).unwrap();
    let fraction = label_fraction(&crop, &target, |label| label == 1);
    let volume = fraction.as_slice().iter().map(|part| f64::from(*part)).sum::<f64>() * target.affine.determinant();
    let expected = 382544.0 * liver.grid().affine.determinant();
    assert!((volume / expected - 1.0).abs() < 1e-5, "{volume} is not {expected} mm3");

    // Another subject's grid is told apart, with both shapes.
    if let Some(ct) = shared_data("ct-abdomen-3mm/example_ct.nii.gz") {
        let ct = yawara::io::nifti::read_info(&ct).unwrap();
        let mismatch = check_same_grid(&ct.grid, liver.grid(), Overlay::Labels).unwrap_err();
        assert!(matches!(mismatch, GridMismatch::Shape { .. }), "{mismatch}");
        assert!(mismatch.to_string().contains("222x166x429") && mismatch.to_string().contains("122x101x112"));
    }
}
