//! The phantoms: same bits, plausible organs, partial volume, and refusals.

use std::sync::LazyLock;

use yawara::geometry::Point3;
use yawara::phantom::{self, Phantom, PhantomError, label};
use yawara::scene::resolved::PhantomKind;

/// Every organ but fat, muscle and skin, which may come in pieces, with plausible volumes [mL] in a section of 174 mm.
const ORGANS: [(u16, f64, f64); 9] = [
    (label::LIVER, 1000.0, 1700.0),
    (label::KIDNEY_RIGHT, 90.0, 190.0),
    (label::KIDNEY_LEFT, 90.0, 190.0),
    (label::SPINE, 180.0, 350.0),
    (label::AORTA, 35.0, 65.0),
    (label::SPLEEN, 120.0, 300.0),
    (label::STOMACH, 150.0, 450.0),
    (label::GALLBLADDER, 8.0, 40.0),
    (label::SPINAL_CANAL, 20.0, 50.0),
];

/// One patient at 2 mm for all tests that need nothing special.
fn patient() -> &'static Phantom {
    static PATIENT: LazyLock<Phantom> = LazyLock::new(|| phantom::abdomen(2.0, 4).unwrap());
    &PATIENT
}

fn is(phantom: &Phantom, organ: u16) -> impl Fn(usize) -> bool + '_ {
    let labels = phantom.labels.as_slice();
    // The vessels of the liver are part of the liver.
    move |at| labels[at] == organ || (organ == label::LIVER && labels[at] == label::LIVER_VESSELS)
}

fn voxels(phantom: &Phantom, organ: u16) -> Vec<usize> {
    let is = is(phantom, organ);
    (0..phantom.labels.shape().len()).filter(|&at| is(at)).collect()
}

fn millilitres(phantom: &Phantom, organ: u16) -> f64 {
    voxels(phantom, organ).len() as f64 * phantom.labels.grid().affine.determinant() / 1000.0
}

/// Sizes of the face-connected components, largest first.
fn components(phantom: &Phantom, organ: u16) -> Vec<usize> {
    let shape = phantom.labels.shape();
    let is = is(phantom, organ);
    let mut seen = vec![false; shape.len()];
    let mut sizes = Vec::new();
    for start in 0..shape.len() {
        if seen[start] || !is(start) {
            continue;
        }
        let (mut stack, mut size) = (vec![start], 0);
        seen[start] = true;
        while let Some(at) = stack.pop() {
            size += 1;
            for offset in [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]] {
                if let Some(next) = shape.neighbour(shape.ijk(at), offset)
                    && !seen[next]
                    && is(next)
                {
                    seen[next] = true;
                    stack.push(next);
                }
            }
        }
        sizes.push(size);
    }
    sizes.sort_unstable_by(|a, b| b.cmp(a));
    sizes
}

/// Voxels of an organ whose 26 neighbours are all of the same label.
fn deep(phantom: &Phantom, organ: u16) -> Vec<usize> {
    let shape = phantom.labels.shape();
    let labels = phantom.labels.as_slice();
    (0..shape.len())
        .filter(|&at| {
            labels[at] == organ
                && yawara::lattice::neighbours::OFFSETS
                    .iter()
                    .all(|&o| shape.neighbour(shape.ijk(at), o).is_some_and(|next| labels[next] == organ))
        })
        .collect()
}

fn mean_and_sd(phantom: &Phantom, at: &[usize]) -> (f64, f64) {
    let values: Vec<f64> = at.iter().map(|&v| f64::from(phantom.image.as_slice()[v])).collect();
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64;
    (mean, variance.sqrt())
}

fn centroid(phantom: &Phantom, organ: u16) -> Point3 {
    let at = voxels(phantom, organ);
    let sum = at.iter().fold(nalgebra::Vector3::zeros(), |sum, &v| sum + phantom.labels.grid().place(v).coords);
    Point3::from(sum / at.len() as f64)
}

#[test]
fn same_seed_same_bits_at_any_thread_count() {
    let with_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| phantom::abdomen(9.0, 11).unwrap())
    };
    let one = with_threads(1);
    for threads in [2, 3] {
        let other = with_threads(threads);
        let bits = |p: &Phantom| p.image.as_slice().iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert!(bits(&one) == bits(&other) && one.labels == other.labels, "{threads} threads");
    }
    let another = phantom::abdomen(9.0, 12).unwrap();
    assert_ne!(one.labels, another.labels, "another seed is another patient");
    let pairs = one.image.as_slice().iter().zip(another.image.as_slice());
    let differ = pairs.filter(|(a, b)| a != b).count();
    assert!(differ * 10 > one.image.shape().len() * 9, "only {differ} voxels differ");
}

#[test]
fn organs_have_plausible_volumes_and_hang_together_for_every_seed() {
    for seed in [0, 2, 77, u64::MAX] {
        let phantom = phantom::abdomen(4.0, seed).unwrap();
        for (organ, least, most) in ORGANS {
            let volume = millilitres(&phantom, organ);
            assert!((least..most).contains(&volume), "seed {seed}: label {organ} has {volume} mL");
            let sizes = components(&phantom, organ);
            assert_eq!(sizes.len(), 1, "seed {seed}: label {organ} comes in pieces of {sizes:?} voxels");
        }
        let vessels = millilitres(&phantom, label::LIVER_VESSELS);
        assert!((10.0..120.0).contains(&vessels), "seed {seed}: {vessels} mL of vessels");
        // Seven ribs a side; short pieces where a rib leaves through the top of the section.
        let ribs = components(&phantom, label::RIBS);
        assert!((10..=18).contains(&ribs.len()), "seed {seed}: ribs in pieces of {ribs:?} voxels");
    }
}

#[test]
fn volumes_do_not_depend_on_the_spacing() {
    let (fine, coarse) = (patient(), &phantom::abdomen(4.0, 4).unwrap());
    for (organ, tolerance) in [
        (label::LIVER, 0.01),
        (label::KIDNEY_RIGHT, 0.03),
        (label::KIDNEY_LEFT, 0.03),
        (label::SPINE, 0.04),
        (label::SPLEEN, 0.02),
        (label::STOMACH, 0.02),
        (label::MUSCLE, 0.05),
    ] {
        let [a, b] = [fine, coarse].map(|p| millilitres(p, organ));
        assert!((a - b).abs() < tolerance * a, "label {organ}: {a} mL at 2 mm, {b} mL at 4 mm");
    }
    // A scanner with larger voxels sees the same matter: the mean of the image over the trunk stays.
    let mean = |p: &Phantom| {
        let sum: f64 = p.image.as_slice().iter().map(|&v| f64::from(v) + 1000.0).sum();
        sum * p.image.grid().affine.determinant()
    };
    let ratio = mean(fine) / mean(coarse);
    assert!((ratio - 1.0).abs() < 0.003, "mass ratio {ratio}");
}

#[test]
fn hounsfield_units_inside_organs() {
    let phantom = patient();
    // Parenchyma holds vessels too thin for a label, so the liver is a little brighter and less even than its tissue.
    for (organ, mean_hu, within, most_sd) in [
        (label::LIVER, 106.0, 3.0, 14.5),
        (label::LIVER_VESSELS, 165.0, 4.0, 13.0),
        (label::SPLEEN, 120.0, 1.0, 11.6),
        (label::MUSCLE, 60.0, 1.0, 13.0),
        (label::FAT, -100.0, 2.0, 14.0),
        (label::AORTA, 150.0, 1.0, 11.6),
        (label::GALLBLADDER, 8.0, 2.0, 12.0),
    ] {
        let deep = deep(phantom, organ);
        assert!(deep.len() > 50, "label {organ}: {} voxels inside", deep.len());
        let (mean, sd) = mean_and_sd(phantom, &deep);
        assert!((mean - mean_hu).abs() < within, "label {organ}: mean {mean} HU");
        assert!((9.5..most_sd).contains(&sd), "label {organ}: sd {sd} HU");
    }
    // Cortex brighter than medulla: both kinds of voxel are there.
    let (_, sd) = mean_and_sd(phantom, &deep(phantom, label::KIDNEY_RIGHT));
    assert!((25.0..50.0).contains(&sd), "kidney sd {sd} HU");
    let spine: Vec<f32> = voxels(phantom, label::SPINE).iter().map(|&v| phantom.image.as_slice()[v]).collect();
    assert!(
        spine.iter().any(|&hu| hu > 700.0) && spine.iter().filter(|&&hu| (180.0..300.0).contains(&hu)).count() > 5000
    );
}

#[test]
fn border_voxels_are_mixtures() {
    let phantom = patient();
    let shape = phantom.image.shape();
    let image = phantom.image.as_slice();
    // The outermost skin against air along rows: exactly the share of the voxel that lies inside the body.
    let (mut mixed, mut rows) = (0, 0);
    for k in shape.nz / 4..3 * shape.nz / 4 {
        for j in shape.ny / 4..3 * shape.ny / 4 {
            let row = &image[shape.linear([0, j, k])..shape.linear([0, j, k]) + shape.nx];
            let first = row.iter().position(|&hu| hu > -940.0).unwrap();
            rows += 1;
            mixed += usize::from((-900.0..-100.0).contains(&row[first]));
            // Monotone from air to skin within two voxels: no ringing, no step of a whole voxel in most rows.
            assert!(
                row[first - 1] < -930.0 && row[first + 1] > -250.0,
                "row {j} of slice {k}: {:?}",
                &row[..first + 3]
            );
        }
    }
    assert!(mixed * 10 > rows * 7, "{mixed} of {rows} rows cross the border in steps");
    // Between liver (105) and the fat or lung around it there are voxels at every level between.
    let labels = phantom.labels.as_slice();
    let mut histogram = [0; 8];
    for at in 0..shape.len() {
        if labels[at] != label::LIVER {
            continue;
        }
        let outside = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]]
            .into_iter()
            .filter_map(|o| shape.neighbour(shape.ijk(at), o))
            .any(|n| labels[n] == label::FAT);
        if outside && (-60.0..100.0).contains(&image[at]) {
            histogram[((image[at] + 60.0) / 20.0) as usize] += 1;
        }
    }
    assert!(histogram[2..].iter().all(|&n| n > 200), "{histogram:?}");
}

#[test]
fn a_plane_border_gives_the_volume_fraction() {
    // The end of the section is a plane: skin of 2.5 mm at |z| = 87 mm. Columns through the middle show the fractions.
    for spacing in [3.5, 6.0] {
        let phantom = phantom::abdomen(spacing, 3).unwrap();
        let shape = phantom.image.shape();
        let [ci, cj] = [shape.nx / 2, shape.ny / 2];
        for k in (shape.nz / 2 + (84.0 / spacing) as usize)..shape.nz {
            let z = phantom.image.grid().place(shape.linear([0, 0, k])).z;
            let share =
                |low: f64, high: f64| ((z + 0.5 * spacing).min(high) - (z - 0.5 * spacing).max(low)).max(0.0) / spacing;
            let (fat, skin, air) = (share(0.0, 84.5), share(84.5, 87.0), share(87.0, 1e3));
            let expected = -100.0 * fat + 20.0 * skin - 1000.0 * air;
            // Mean over 11 x 11 voxels takes the noise away: 11 HU / sqrt(121 / 7) = 2.6 HU; clipping at -1024 lifts air.
            let mut sum = 0.0;
            for j in cj - 5..=cj + 5 {
                for i in ci - 5..=ci + 5 {
                    sum += f64::from(phantom.image.as_slice()[shape.linear([i, j, k])]);
                }
            }
            let mean = sum / 121.0;
            assert!((mean - expected).abs() < 12.0, "{spacing} mm, z = {z}: {mean} HU, expected {expected}");
        }
    }
}

#[test]
fn patient_axes_and_extents() {
    let phantom = patient();
    assert_eq!(phantom.image.grid(), phantom.labels.grid());
    assert_eq!(phantom.image.grid().affine.axis_codes(), "RAS");
    let center = phantom.image.grid().affine.index_of(Point3::origin());
    assert!(center.iter().all(|i| (i - i.round()).abs() < 1e-9), "the origin is a voxel centre");
    let liver = centroid(phantom, label::LIVER);
    assert!(liver.x > 40.0 && liver.x < 80.0 && liver.y.abs() < 25.0 && liver.z.abs() < 20.0, "liver at {liver}");
    assert!(centroid(phantom, label::KIDNEY_RIGHT).x > 50.0);
    assert!(centroid(phantom, label::KIDNEY_LEFT).x < -50.0);
    assert!(centroid(phantom, label::SPLEEN).x < -80.0);
    let spine = centroid(phantom, label::SPINE);
    assert!(spine.x.abs() < 2.0 && spine.y < -40.0, "spine at {spine}");
    // Extents of the whole liver.
    let places: Vec<Point3> = voxels(phantom, label::LIVER).iter().map(|&v| phantom.labels.grid().place(v)).collect();
    for (axis, least, most) in [(0, 155.0, 195.0), (1, 120.0, 155.0), (2, 110.0, 135.0)] {
        let low = places.iter().map(|p| p[axis]).fold(f64::MAX, f64::min);
        let high = places.iter().map(|p| p[axis]).fold(f64::MIN, f64::max);
        assert!((least..most).contains(&(high - low)), "axis {axis}: liver from {low} to {high} mm");
    }
}

#[test]
fn nothing_touches_the_border_of_the_volume() {
    for spacing in [3.7, 7.3, 10.0] {
        let phantom = phantom::abdomen(spacing, 9).unwrap();
        let shape = phantom.labels.shape();
        let mut checked = 0;
        for at in 0..shape.len() {
            let [i, j, k] = shape.ijk(at);
            if i == 0 || j == 0 || k == 0 || i + 1 == shape.nx || j + 1 == shape.ny || k + 1 == shape.nz {
                assert_eq!(phantom.labels.as_slice()[at], label::AIR);
                assert!(phantom.image.as_slice()[at] < -930.0);
                checked += 1;
            }
        }
        assert!(checked > 1000);
    }
}

#[test]
fn every_label_has_a_name_and_every_name_a_voxel() {
    let phantom = patient();
    for &(organ, name) in phantom.names {
        assert!(!voxels(phantom, organ).is_empty(), "{name} has no voxel");
    }
    let named = |l: u16| l == label::AIR || phantom.names.iter().any(|&(organ, _)| organ == l);
    assert!(phantom.labels.as_slice().iter().all(|&l| named(l)));
}

#[test]
fn blocks_have_exact_counts() {
    let cube = phantom::cube(7, 1.5).unwrap();
    assert_eq!(voxels(&cube, label::BLOCK).len(), 343);
    assert!(centroid(&cube, label::BLOCK).coords.norm() < 1e-9);
    let values = cube.image.as_slice().iter().zip(cube.labels.as_slice());
    assert!(values.into_iter().all(|(&hu, &l)| hu == if l == label::BLOCK { phantom::BLOCK_HU } else { -1000.0 }));
    let made = phantom::make(PhantomKind::Cube, 3.0, 0).unwrap();
    assert_eq!(voxels(&made, label::BLOCK).len(), 20 * 20 * 20);
    let beam = phantom::make(PhantomKind::Beam, 4.0, 0).unwrap();
    assert_eq!(voxels(&beam, label::BLOCK).len(), 40 * 8 * 8);
    assert_eq!(beam.names, phantom::BEAM_NAMES);
    assert_eq!(phantom::make(PhantomKind::Abdomen, 8.0, 5).unwrap().labels, phantom::abdomen(8.0, 5).unwrap().labels);
}

#[test]
fn bad_requests_are_refused_with_the_value_and_the_range() {
    for found in [f64::NAN, f64::INFINITY, 0.0, -1.0, 0.49, 10.5] {
        for kind in [PhantomKind::Abdomen, PhantomKind::Cube, PhantomKind::Beam] {
            let error = phantom::make(kind, found, 1).unwrap_err();
            assert!(matches!(error, PhantomError::BadSpacing { .. }));
            let text = error.to_string();
            assert!(text.contains(&format!("{found} mm")) && text.contains("0.5 to 10"), "{text}");
        }
    }
    let text = phantom::cube(0, 1.0).unwrap_err().to_string();
    assert!(text.contains("block of 0 voxels") && text.contains("1 to 1024"), "{text}");
    let text = phantom::beam([2000, 4, 4], 1.0).unwrap_err().to_string();
    assert!(text.contains("2000"), "{text}");
    let text = phantom::cube(1000, 1.0).unwrap_err().to_string();
    assert!(text.contains("1012048064") && text.contains("268435456"), "{text}");
}
