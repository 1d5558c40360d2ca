//! Surfaces of lattices whose voxels are cells.

use rayon::prelude::*;
use yawara::lattice::build::{NO_ORGAN, OrganMap};
use yawara::lattice::cells::build_cells;
use yawara::lattice::{Lattice, Topology};
use yawara::surface::check::{MeshReport, check};
use yawara::surface::mesh::TriangleMesh;
use yawara::surface::weld::{soup, weld};
use yawara::surface::{Surface, field};
use yawara::volume::Volume;

use crate::support::{Random, sever, springs, unit_grid};

/// Voxels of 1 mm; `organ` gives the organ of each.
fn cells(dims: [usize; 3], organ: impl Fn([usize; 3]) -> u8) -> Lattice {
    let grid = unit_grid(dims[0], dims[1], dims[2]);
    let map = OrganMap::from_vec(grid, (0..grid.shape.len()).map(|voxel| organ(grid.shape.ijk(voxel))).collect());
    build_cells(&map, None).unwrap()
}

fn mesh(lattice: &Lattice, organ: u8, passes: usize) -> TriangleMesh {
    let values = field::smoothed(lattice, organ, passes);
    Surface::extract(lattice, &Topology::new(lattice), &values).unwrap().at_rest(lattice)
}

fn sound(mesh: &TriangleMesh, what: &str) -> MeshReport {
    let report = check(mesh);
    assert!(report.passes(), "{what}: {report}");
    let welded = check(&weld(&soup(mesh), 0.0));
    assert!(welded.passes(), "{what}, welded: {welded}");
    report
}

#[test]
fn a_block_of_voxels_has_the_volume_of_its_voxels() {
    let lattice = cells([12, 10, 8], |_| 0);
    for passes in [0, 2] {
        let report = sound(&mesh(&lattice, 0, passes), "block");
        let ratio = report.volume_mm3 / 960.0;
        // Edges are blunt, and smoothing makes up for the volume they lose by moving the walls.
        assert!((0.96..1.02).contains(&ratio), "{passes} passes: {ratio}");
        let bounds = report.bounds.expect("a mesh has bounds");
        let off = if passes == 0 { 0.1 } else { 0.25 };
        assert!(bounds[0].iter().all(|&low| (low + 0.5).abs() < off), "{bounds:?}");
    }
}

#[test]
fn a_ball_of_voxels_is_round_and_has_its_volume() {
    for radius in [4.0, 7.0, 11.0_f64] {
        let n = 2 * radius as usize + 6;
        let middle = n as f64 / 2.0 - 0.3;
        let place = |ijk: [usize; 3]| ijk.map(|i| i as f64 - middle);
        let inside = |ijk| place(ijk).iter().map(|x| x * x).sum::<f64>().sqrt() < radius;
        let lattice = cells([n, n, n], |ijk| if inside(ijk) { 0 } else { NO_ORGAN });
        let voxels = lattice.cell_organ.iter().filter(|&&organ| organ == 0).count() as f64;
        let round = mesh(&lattice, 0, 2);
        let report = sound(&round, "ball");
        assert!((report.volume_mm3 / voxels - 1.0).abs() < 2e-3, "{radius}: {}", report.volume_mm3 / voxels - 1.0);
        let far = |p: &[f32; 3]| p.iter().map(|&x| (f64::from(x) - middle).powi(2)).sum::<f64>().sqrt();
        let mean = round.positions.iter().map(far).sum::<f64>() / round.positions.len() as f64;
        let rms = (round.positions.iter().map(|p| (far(p) - mean).powi(2)).sum::<f64>() / round.positions.len() as f64)
            .sqrt();
        println!("radius {radius}: mean {mean:.3}, rms {rms:.3}");
        assert!(rms < 0.12, "{radius}: {rms}");
    }
}

#[test]
fn parts_one_voxel_thin_are_drawn() {
    let air = NO_ORGAN;
    let parts: [(&str, Lattice, f64); 4] = [
        ("voxel", cells([3, 3, 3], |ijk| if ijk == [1, 1, 1] { 0 } else { air }), 1.0),
        ("rod", cells([9, 3, 3], |[_, j, k]| if [j, k] == [1, 1] { 0 } else { air }), 9.0),
        ("sheet", cells([9, 9, 3], |[.., k]| if k == 1 { 0 } else { air }), 81.0),
        ("slanted rod", cells([9, 9, 3], |[i, j, k]| if (i == j || i == j + 1) && k == 1 { 0 } else { air }), 17.0),
    ];
    for (name, lattice, voxels) in parts {
        for passes in [0, 2] {
            let report = sound(&mesh(&lattice, 0, passes), name);
            let ratio = report.volume_mm3 / voxels;
            println!("{name}, {passes} passes: {ratio:.3} of its voxels");
            assert_eq!(report.components.len(), 1, "{name}");
            assert!((0.5..2.0).contains(&ratio), "{name}, {passes} passes: {ratio}");
        }
    }
}

#[test]
fn a_gap_of_one_voxel_stays_a_gap() {
    let lattice = cells([9, 6, 6], |[i, ..]| if i == 4 { NO_ORGAN } else { 0 });
    for passes in [0, 2] {
        let halves = mesh(&lattice, 0, passes);
        let report = sound(&halves, "halves");
        assert_eq!(report.components.len(), 2);
        let x = |p: &&[f32; 3]| f64::from(p[0]);
        let left = halves.positions.iter().filter(|p| x(p) < 4.0).map(|p| x(&p)).fold(f64::MIN, f64::max);
        let right = halves.positions.iter().filter(|p| x(p) > 4.0).map(|p| x(&p)).fold(f64::MAX, f64::min);
        assert!((right - left - 1.0).abs() < 0.1, "{passes} passes: a gap of {}", right - left);
    }
}

#[test]
fn random_cells_with_random_severed_springs_give_closed_manifolds() {
    const TRIALS: u64 = 1500;
    let changed: usize = (0..TRIALS)
        .into_par_iter()
        .map(|trial| {
            let mut random = Random::new(trial);
            let dims = [0; 3].map(|_| 2 + random.below(5));
            let fill = [0.2, 0.5, 0.8, 1.0][random.below(4)];
            let seed = random.next();
            let lattice = cells(dims, |[i, j, k]| {
                let inside = i + j + k == 0 || Random::new(seed ^ ((i * 64 + j * 8 + k) as u64) << 20).unit() < fill;
                if inside { 0 } else { NO_ORGAN }
            });
            let mut topology = Topology::new(&lattice);
            let density = [0.0, 0.05, 0.2, 0.6][random.below(4)];
            for (particle, direction) in springs(&lattice) {
                if random.unit() < density {
                    sever(&lattice, &mut topology, particle, direction, random.unit() as f32);
                }
            }
            let values = field::smoothed(&lattice, 0, random.below(4));
            let mesh = Surface::extract(&lattice, &topology, &values).unwrap().at_rest(&lattice);
            let report = check(&mesh);
            assert!(report.passes(), "trial {trial}, density {density}: {report}");
            usize::from(!check(&weld(&soup(&mesh), 0.0)).passes())
        })
        .sum();
    // As for random springs elsewhere: not promised, but rare.
    assert!(changed <= TRIALS as usize / 100, "{changed} change when vertices are welded by place");
}

#[test]
fn organs_of_cells_stay_apart_when_welded() {
    for trial in 0..100 {
        let mut random = Random::new(trial);
        let smooth = trial % 2 == 0;
        let lattice = if smooth {
            // Two organs with a slanted wall, and a rod of a third through both.
            let tilt = random.unit();
            cells([14, 10, 9], |[i, j, k]| {
                let [x, y, z] = [i, j, k].map(|n| n as f64);
                if (y - 5.0).hypot(z - 4.0) < 2.2 { 2 } else { u8::from(x + tilt * y > 8.0) }
            })
        } else {
            let seed = random.next();
            cells([5, 4, 4], |[i, j, k]| Random::new(seed ^ ((i * 64 + j * 8 + k) as u64) << 20).below(3) as u8)
        };
        let mut all = TriangleMesh::default();
        for organ in 0..3 {
            let mut values = field::smoothed(&lattice, organ, 2);
            field::part_walls(&lattice, organ, &mut values);
            let part = Surface::extract(&lattice, &Topology::new(&lattice), &values).unwrap().at_rest(&lattice);
            assert!(check(&part).passes(), "trial {trial}, organ {organ}");
            let first = all.positions.len() as u32;
            all.positions.extend(part.positions);
            all.triangles.extend(part.triangles.iter().map(|t| t.map(|vertex| vertex + first)));
        }
        let report = check(&weld(&soup(&all), 0.0));
        assert!(report.passes(), "trial {trial}: {report}");
    }
}

#[test]
fn half_filled_cells_move_the_border() {
    let grid = unit_grid(8, 8, 8);
    // A wall at 5.5 voxels: the sixth layer is half full.
    let organs: Vec<u8> = (0..512).map(|voxel| if grid.shape.ijk(voxel)[0] <= 5 { 0 } else { NO_ORGAN }).collect();
    let fill: Vec<f32> = (0..512).map(|voxel| if grid.shape.ijk(voxel)[0] == 5 { 0.5 } else { 1.0 }).collect();
    let lattice = build_cells(&Volume::from_vec(grid, organs), Some(&Volume::from_vec(grid, fill))).unwrap();
    let report = sound(&mesh(&lattice, 0, 2), "block");
    assert!((report.volume_mm3 / (5.5 * 64.0) - 1.0).abs() < 0.03, "{}", report.volume_mm3);
}
