//! Organs that touch: written into one file and welded by place, they stay manifold.

use yawara::geometry::Vector3;
use yawara::lattice::{Lattice, Topology};
use yawara::surface::check::{MeshReport, check};
use yawara::surface::mesh::TriangleMesh;
use yawara::surface::weld::{soup, weld};
use yawara::surface::{Surface, field};

use crate::support::{Random, cut_plane, lattice};

/// Parting the walls may change the volume of an organ by this share: its wall stands back by 0.0025 pitch.
const VOLUME_CHANGE: f64 = 0.005;
/// Vertices are welded over this distance [pitches]: what single precision leaves of 0.0005 pitch at 100 pitches from the origin.
const WELD: f32 = 5e-4;

/// The field of every organ, made by `make`, before and after its walls are parted.
fn fields(lattice: &Lattice, organs: u8, make: impl Fn(&Lattice, u8) -> Vec<f32>) -> (Vec<Vec<f32>>, Vec<Vec<f32>>) {
    let alone: Vec<Vec<f32>> = (0..organs).map(|organ| make(lattice, organ)).collect();
    let mut parted = alone.clone();
    parted.iter_mut().enumerate().for_each(|(organ, field)| field::part_walls(lattice, organ as u8, field));
    (alone, parted)
}

fn meshes(lattice: &Lattice, topology: &Topology, fields: &[Vec<f32>]) -> Vec<TriangleMesh> {
    fields.iter().map(|field| Surface::extract(lattice, topology, field).unwrap().at_rest(lattice)).collect()
}

/// What an importer sees that welds all organs together.
fn welded(meshes: &[TriangleMesh], tolerance: f32) -> MeshReport {
    let all: Vec<_> = meshes.iter().flat_map(soup).collect();
    check(&weld(&all, tolerance))
}

fn volume(mesh: &TriangleMesh) -> f64 {
    check(mesh).volume_mm3
}

/// A block of three organs: a left and a right half, and a thick rod through both.
fn three_organs() -> Lattice {
    let mut lattice = lattice(18, 14, 12, |_| true);
    for particle in 0..lattice.len() as u32 {
        let [i, j, k] = lattice.ijk(particle).map(|n| n as f64);
        let rod = (j - 6.3).hypot(k - 5.6) < 3.2;
        lattice.organ[particle as usize] = if rod { 2 } else { u8::from(i + 0.4 * j > 11.0) };
    }
    lattice
}

#[test]
fn organs_that_touch_stay_manifold_when_welded() {
    let lattice = three_organs();
    let topology = Topology::new(&lattice);
    for passes in [0, 2] {
        let (alone, parted) = fields(&lattice, 3, |lattice, organ| field::smoothed(lattice, organ, passes));
        let before = meshes(&lattice, &topology, &alone);
        if passes == 0 {
            let report = welded(&before, 0.0);
            assert!(report.non_manifold_edges > 100, "nothing to part: {report}");
        }
        let after = meshes(&lattice, &topology, &parted);
        for tolerance in [0.0, WELD] {
            let report = welded(&after, tolerance);
            assert!(report.passes(), "{passes} passes, welded over {tolerance}: {report}");
        }
        for (organ, (before, after)) in before.iter().zip(&after).enumerate() {
            let change = volume(after) / volume(before) - 1.0;
            eprintln!("{passes} passes, organ {organ}: volume {:+.3} %", 100.0 * change);
            assert!(change.abs() < VOLUME_CHANGE, "{passes} passes, organ {organ}: {change}");
        }
    }
}

#[test]
fn a_cut_across_walls_leaves_them_apart() {
    let lattice = three_organs();
    let mut random = Random::new(7);
    for trial in 0..40 {
        let mut topology = Topology::new(&lattice);
        let normal = Vector3::from_fn(|_, _| random.unit() - 0.5).normalize();
        let point = Vector3::new(8.5, 6.5, 5.5) + Vector3::from_fn(|_, _| 3.0 * (random.unit() - 0.5));
        let stop = 9.0 + 6.0 * random.unit();
        assert!(cut_plane(&lattice, &mut topology, point, normal, |place| place.x < stop) > 20);
        let (_, parted) = fields(&lattice, 3, |lattice, organ| field::smoothed(lattice, organ, trial % 3));
        let meshes = meshes(&lattice, &topology, &parted);
        for (organ, mesh) in meshes.iter().enumerate() {
            let report = check(mesh);
            assert!(report.passes(), "trial {trial}, organ {organ}: {report}");
        }
        let report = welded(&meshes, 0.0);
        assert!(report.passes(), "trial {trial}: {report}");
    }
}

#[test]
fn organs_mixed_at_random_stay_apart() {
    for trial in 0..200 {
        let mut random = Random::new(trial);
        let mut lattice = lattice(6, 5, 4, |_| true);
        lattice.organ.iter_mut().for_each(|organ| *organ = random.below(3) as u8);
        let topology = Topology::new(&lattice);
        let (_, parted) = fields(&lattice, 3, |lattice, organ| {
            let hu: Vec<f32> = (0..lattice.particle_at.len()).map(|_| 1e4 * random_of(organ, trial)).collect();
            match trial % 3 {
                0 => field::binary(lattice, organ),
                1 => field::smoothed(lattice, organ, 2),
                _ => field::from_hu(lattice, organ, &hu, [0.0, f32::INFINITY], 100.0),
            }
        });
        let report = welded(&meshes(&lattice, &topology, &parted), 0.0);
        assert!(report.passes(), "trial {trial}: {report}");
    }
}

#[test]
fn walls_that_were_joined_lie_in_one_place() {
    let lattice = three_organs();
    let topology = Topology::new(&lattice);
    let mut fields: Vec<Vec<f32>> = (0..3).map(|organ| field::smoothed(&lattice, organ, 2)).collect();
    // Of the vertices of organ 0, those that no vertex of another organ comes close to although they lie on a wall.
    let alone = |fields: &[Vec<f32>]| {
        let [own, rest @ ..] = &meshes(&lattice, &topology, fields)[..] else { unreachable!("three organs") };
        let on_wall =
            own.positions.iter().filter(|place| place.iter().zip([17.0, 13.0, 11.0]).all(|(&x, n)| x > 0.0 && x < n));
        let others: Vec<[f32; 3]> = rest.iter().flat_map(|mesh| mesh.positions.iter().copied()).collect();
        let near =
            |place: &&[f32; 3]| !others.iter().any(|other| (0..3).all(|axis| (other[axis] - place[axis]).abs() < 1e-4));
        (on_wall.clone().count(), on_wall.filter(near).count())
    };
    let (walls, before) = alone(&fields);
    assert!(walls > 200 && before > 50, "{before} of {walls} have nothing to mend");
    field::join_walls(&lattice, &mut fields);
    assert_eq!(alone(&fields).1, 0, "of {walls}");
}

/// A value of an organ in -1..1, the same for the same trial.
fn random_of(organ: u8, trial: u64) -> f32 {
    (2.0 * Random::new(trial << 8 | u64::from(organ)).unit() - 1.0) as f32
}
