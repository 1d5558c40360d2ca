//! From layers to voxels: partial volume, labels, noise.
//!
//! A voxel far from every border takes one evaluation. A voxel near one is cut into sub-voxels of at most
//! [`FINEST`], but never more than [`MOST_CUTS`] along an edge; in each the share of a layer is what its distance says a plane would leave, so the HU is the mean over
//! the voxel's volume to the accuracy of a plane through every sub-voxel.

use rayon::prelude::*;

use super::abdomen::{AIR_HU, Abdomen, LAYERS, SKIN, TISSUES};
use super::label;
use super::noise::slice_noise;
use super::sdf::coverage;
use crate::geometry::{Grid, Point3, Vector3};

/// Sub-voxels at borders are at most this large [mm].
const FINEST: f64 = 2.0;
/// Most sub-voxels along the edge of a voxel.
const MOST_CUTS: usize = 3;
/// A scanner does not go below this [HU].
const LOWEST_HU: f64 = -1024.0;

/// Share of each layer, of skin and of air in a voxel.
type Shares = [f64; LAYERS + 2];

/// HU and labels of every voxel, in grid order. `first` is the index of voxel (0, 0, 0) counted from the patient's
/// origin, so that noise belongs to the place and not to the box.
pub(super) fn render(abdomen: &Abdomen, grid: &Grid, first: [i64; 3], noise: (u64, f64)) -> (Vec<f32>, Vec<u16>) {
    let shape = grid.shape;
    let mut image = vec![0.0_f32; shape.len()];
    let mut labels = vec![0_u16; shape.len()];
    let slice = shape.nx * shape.ny;
    let spacing = grid.affine.spacing()[0];
    image.par_chunks_mut(slice).zip(labels.par_chunks_mut(slice)).enumerate().for_each(|(k, (image, labels))| {
        let grain = slice_noise(noise.0, shape.nx, shape.ny, k as i64 + first[2], [first[0], first[1]]);
        for at in 0..slice {
            let center = grid.place(k * slice + at);
            let shares = shares(abdomen, center, spacing);
            let hu = mean_hu(&shares) + noise.1 * f64::from(grain[at]);
            image[at] = hu.max(LOWEST_HU) as f32;
            labels[at] = majority(&shares);
        }
    });
    (image, labels)
}

/// Shares of the layers in the voxel around `center`.
fn shares(abdomen: &Abdomen, center: Point3, spacing: f64) -> Shares {
    let here = abdomen.layers(center);
    let mut shares = [0.0; LAYERS + 2];
    // Half the voxel's diagonal, and a little for distances that are estimates.
    let near = spacing * 0.95;
    let cuts = ((spacing / FINEST).ceil() as usize).min(MOST_CUTS);
    // Only borders that show: a layer under another one does not count.
    let mut union = f64::INFINITY;
    let shows = |&d: &f64| {
        union = union.min(d);
        union.abs() < near
    };
    if cuts == 1 || !here.iter().any(shows) {
        add(&mut shares, &here, spacing, 1.0);
        return shares;
    }
    let part = spacing / cuts as f64;
    let weight = 1.0 / (cuts * cuts * cuts) as f64;
    let offset = |n: usize| (n as f64 + 0.5) * part - 0.5 * spacing;
    for n in 0..cuts * cuts * cuts {
        let place = center + Vector3::new(offset(n % cuts), offset(n / cuts % cuts), offset(n / (cuts * cuts)));
        add(&mut shares, &abdomen.layers(place), part, weight);
    }
    shares
}

fn add(shares: &mut Shares, layers: &[f64; LAYERS + 1], width: f64, weight: f64) {
    let mut union = f64::INFINITY;
    let mut covered = 0.0;
    for (share, &distance) in shares.iter_mut().zip(layers) {
        union = union.min(distance);
        let now = coverage(union, width);
        *share += weight * (now - covered);
        covered = now;
        if covered == 1.0 {
            return;
        }
    }
    shares[LAYERS + 1] += weight * (1.0 - covered);
}

fn mean_hu(shares: &Shares) -> f64 {
    let layers: f64 = TISSUES.iter().zip(shares).map(|(tissue, share)| tissue.hu * share).sum();
    layers + SKIN.hu * shares[LAYERS] + AIR_HU * shares[LAYERS + 1]
}

/// The label with the largest share; liver and its vessels stand together against everything else, and so do the parts
/// of every other organ, which have one label.
fn majority(shares: &Shares) -> u16 {
    let mut by_label = [0.0; label::COUNT];
    for (tissue, share) in TISSUES.iter().zip(shares) {
        by_label[usize::from(tissue.label)] += share;
    }
    by_label[usize::from(label::SKIN)] += shares[LAYERS];
    by_label[0] += shares[LAYERS + 1];
    let vessels = std::mem::take(&mut by_label[usize::from(label::LIVER_VESSELS)]);
    let parenchyma = by_label[usize::from(label::LIVER)];
    by_label[usize::from(label::LIVER)] += vessels;
    let best = (0..label::COUNT).fold(0, |best, at| if by_label[at] > by_label[best] { at } else { best }) as u16;
    if best == label::LIVER && vessels > parenchyma { label::LIVER_VESSELS } else { best }
}
