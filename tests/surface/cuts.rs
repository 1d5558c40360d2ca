//! Cuts with a shape: planes, half planes, discs, crossings, and the smallest bodies there are.

use std::sync::Arc;

use rayon::prelude::*;
use yawara::geometry::{Affine, Grid, GridShape, Vector3};
use yawara::lattice::Topology;
use yawara::lattice::neighbours::{ALL_ALIVE, OFFSETS, family, opposite};
use yawara::surface::check::check;
use yawara::surface::weld::{soup, weld};

use crate::support::{
    Random, ball, cut_plane, extract, lattice, lattice_on, report, sever, sever_between, springs, unit_grid,
};

fn random_plane(random: &mut Random, n: usize) -> (Vector3, Vector3) {
    let unit = || 2.0 * random.unit() - 1.0;
    let normal = Vector3::from_iterator(std::iter::repeat_with(unit)).normalize();
    let middle = Vector3::repeat((n as f64 - 1.0) / 2.0);
    (middle + normal * (random.unit() - 0.5), normal)
}

#[test]
fn a_full_plane_gives_two_parts_that_add_up_and_survive_welding() {
    let lattice = lattice(14, 14, 14, ball(14, 6.2));
    let whole = report(&lattice, &Topology::new(&lattice));
    (0..40_u64).into_par_iter().for_each(|trial| {
        let (point, normal) = random_plane(&mut Random::new(trial), 14);
        let mut topology = Topology::new(&lattice);
        assert!(cut_plane(&lattice, &mut topology, point, normal, |_| true) > 300);
        let mesh = extract(&lattice, &topology).at_rest(&lattice);
        let cut = check(&mesh);
        assert!(cut.passes(), "trial {trial}: {cut}");
        assert_eq!(cut.components.len(), 2, "trial {trial}");
        assert!(cut.components.iter().all(|part| part.euler == 2), "trial {trial}: {:?}", cut.components);
        // The gap between the lips is 0.002 of a spring wide; the rest is where the rim's straight pieces lie off the staircase, or reach
        // over a step of it: a twentieth of a cell per cell along the rim inward, a fiftieth outward.
        let lost = whole.volume_mm3 - cut.volume_mm3;
        let rim = 2.0 * std::f64::consts::PI * 6.5;
        assert!((-0.02 * rim..0.06 * rim).contains(&lost), "trial {trial}: {lost} of {}", whole.volume_mm3);
        let welded = check(&weld(&soup(&mesh), 0.0));
        assert!(welded.passes() && welded.components.len() == 2, "trial {trial}: {welded}");
    });
}

/// On a box cut square to an axis the skin runs straight up to the blade: only the gap between the lips is lost.
#[test]
fn a_square_cut_leaves_no_groove() {
    let lattice = lattice(10, 6, 6, |_| true);
    let mut topology = Topology::new(&lattice);
    cut_plane(&lattice, &mut topology, Vector3::new(4.3, 0.0, 0.0), Vector3::x(), |_| true);
    let whole = report(&lattice, &Topology::new(&lattice));
    let cut = report(&lattice, &topology);
    assert!(cut.passes(), "{cut}");
    let lost = whole.volume_mm3 - cut.volume_mm3;
    assert!((0.0..0.1).contains(&lost), "{lost}");
    assert!((cut.components[0].volume_mm3 + cut.components[1].volume_mm3 - cut.volume_mm3).abs() < 1e-9);
}

#[test]
fn half_planes_crossings_and_repeated_cuts_stay_sound() {
    let lattice = lattice(12, 12, 12, ball(12, 5.4));
    (0..40_u64).into_par_iter().for_each(|trial| {
        let mut random = Random::new(1000 + trial);
        let mut topology = Topology::new(&lattice);
        for cut in 0..3 {
            let (point, normal) = random_plane(&mut random, 12);
            let (_, side) = random_plane(&mut random, 12);
            let severed = cut_plane(&lattice, &mut topology, point, normal, |p| (p.coords - point).dot(&side) > 0.0);
            let after = report(&lattice, &topology);
            assert!(after.passes(), "trial {trial}, cut {cut}: {after}");
            // The same blade again finds nothing to sever.
            let again = cut_plane(&lattice, &mut topology, point, normal, |p| (p.coords - point).dot(&side) > 0.0);
            assert!(severed > 0 && again == 0, "trial {trial}");
        }
    });
}

/// A disc that ends inside the body opens a crack: a closed pocket whose wall is a sphere of its own, turned inward.
#[test]
fn a_disc_inside_is_a_pocket() {
    let lattice = lattice(13, 13, 13, ball(13, 6.0));
    let middle = Vector3::repeat(6.0);
    for (trial, normal) in [Vector3::z(), Vector3::new(1.0, 0.4, 0.2), Vector3::new(1.0, -1.0, 0.7)].iter().enumerate()
    {
        let normal = normal.normalize();
        let point = middle + normal * 0.4;
        let mut topology = Topology::new(&lattice);
        cut_plane(&lattice, &mut topology, point, normal, |p| (p.coords - point).norm() < 3.1);
        let cut = report(&lattice, &topology);
        assert!(cut.is_closed() && cut.is_manifold() && cut.passes(), "{trial}: {cut}");
        assert_eq!(cut.components.len(), 2, "skin and pocket: {cut}");
        let (pocket, skin) = {
            let mut parts = cut.components.clone();
            parts.sort_by(|a, b| a.volume_mm3.total_cmp(&b.volume_mm3));
            (parts[0], parts[1])
        };
        assert_eq!((pocket.euler, skin.euler), (2, 2), "{trial}: {cut}");
        // A gap of 0.002 per spring over a disc of radius 3, looking inward.
        assert!(pocket.volume_mm3 < 0.0 && pocket.volume_mm3 > -0.5, "{trial}: {}", pocket.volume_mm3);
        assert!(pocket.area_mm2 > 2.0 * 20.0, "{trial}: {}", pocket.area_mm2);
        // The skin does not know of it.
        let whole = report(&lattice, &Topology::new(&lattice));
        assert_eq!((skin.triangles, skin.vertices), (whole.triangles, whole.vertices));
    }
}

/// A spring whose ends hold together on every face at it parts nothing: the mesh is the uncut one, bit for bit. Only an
/// edge of the skin, where a face ends in the open, shows its loss as a small notch.
#[test]
fn a_lone_broken_spring_makes_no_bubble() {
    let lattice = lattice(4, 4, 4, |_| true);
    let whole = extract(&lattice, &Topology::new(&lattice)).at_rest(&lattice);
    let (mut hidden, mut notches) = (0, 0);
    for (particle, direction) in springs(&lattice) {
        let mut topology = Topology::new(&lattice);
        sever(&lattice, &mut topology, particle, direction, 0.4);
        let mesh = extract(&lattice, &topology).at_rest(&lattice);
        let across = (0..3).filter(|&axis| OFFSETS[direction][axis] == 0);
        let on_skin = across.filter(|&axis| [0, 3].contains(&lattice.ijk(particle)[axis])).count() > 0;
        if family(direction) == 1 && on_skin {
            let report = check(&mesh);
            assert!(report.passes() && report.components.len() == 1 && report.euler == 2, "{report}");
            notches += 1;
        } else {
            assert_eq!(mesh.triangles, whole.triangles, "particle {particle}, direction {direction}");
            assert_eq!(mesh.positions, whole.positions);
            hidden += 1;
        }
    }
    // 3 x 3 edges through each of the 4 inner rows of an axis stay hidden, and all the diagonals.
    assert_eq!((hidden, notches), (3 * 3 * 4 + 6 * 36 + 4 * 27, 3 * 3 * 12));
}

#[test]
fn the_smallest_bodies_are_closed() {
    let points: [&[[usize; 3]]; 9] = [
        &[[1, 1, 1]],
        &[[0, 0, 0], [1, 0, 0]],
        &[[0, 0, 0], [1, 1, 0]],
        &[[0, 0, 0], [1, 1, 1]],
        &[[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]],
        &[[0, 0, 0], [1, 1, 0], [2, 2, 0], [3, 3, 0]],
        &[[0, 0, 0], [1, 1, 1], [2, 2, 2], [3, 3, 3]],
        &[[0, 0, 0], [1, 1, 0], [0, 1, 1], [1, 0, 1]],
        &[[0, 0, 0], [1, 0, 1], [2, 0, 0], [1, 0, 2], [3, 0, 1]],
    ];
    for (case, body) in points.iter().enumerate() {
        let lattice = lattice(4, 4, 4, |ijk| body.contains(&ijk));
        let springs = springs(&lattice);
        // Every subset of severed springs.
        for subset in 0..1_u32 << springs.len() {
            let mut topology = Topology::new(&lattice);
            for (bit, &(particle, direction)) in springs.iter().enumerate() {
                if subset >> bit & 1 == 1 {
                    sever(&lattice, &mut topology, particle, direction, 0.5);
                }
            }
            let found = report(&lattice, &topology);
            assert!(found.passes(), "case {case}, subset {subset:b}: {found}");
        }
    }
}

/// Corners that touch across a face diagonal hold together by their spring and come apart with it.
#[test]
fn diagonal_neighbours_follow_their_spring() {
    let lattice = lattice(2, 2, 1, |[i, j, _]| i == j);
    let mut topology = Topology::new(&lattice);
    assert_eq!(report(&lattice, &topology).components.len(), 1);
    assert!(sever_between(&lattice, &mut topology, [0, 0, 0], [1, 1, 0], 0.5));
    assert_eq!(report(&lattice, &topology).components.len(), 2);
}

#[test]
fn subsets_of_a_full_cube_are_sound() {
    let lattice = lattice(3, 3, 3, |_| true);
    let springs = springs(&lattice);
    let parts_of = |trial: u64| {
        let mut random = Random::new(trial ^ 0xc0de);
        let mut topology = Topology::new(&lattice);
        // Whole families, one particle's springs, or a random share: each leaves other faces ambiguous.
        let (choice, share, victim) = (random.below(3), random.unit(), random.below(27) as u32);
        for &(particle, direction) in &springs {
            let hit = match choice {
                0 => family(direction) <= 1 + random.below(2) && random.unit() < share,
                1 => particle == victim || lattice.neighbour(particle, direction) == Some(victim),
                _ => random.unit() < share,
            };
            if hit {
                sever(&lattice, &mut topology, particle, direction, random.unit() as f32);
            }
        }
        let found = report(&lattice, &topology);
        assert!(found.passes(), "trial {trial}: {found}");
        found.components.len()
    };
    let found: Vec<usize> = (0..600_u64).into_par_iter().map(parts_of).collect();
    let (parts, fronts) = (found.iter().max(), found.iter().filter(|&&parts| parts == 1).count());
    assert!(parts >= Some(&20) && fronts > 40, "{parts:?} {fronts}");
    // Every spring gone: 27 separate closed bodies.
    let mut topology = Topology::new(&lattice);
    for &(particle, direction) in &springs {
        sever(&lattice, &mut topology, particle, direction, 0.5);
    }
    assert_eq!(report(&lattice, &topology).components.len(), 27);
}

#[test]
fn left_handed_oblique_grids_look_outward() {
    let turn = nalgebra::Rotation3::from_euler_angles(0.4, -0.7, 1.1).into_inner();
    for mirror in [1.0, -1.0] {
        let axes = turn * nalgebra::Matrix3::from_diagonal(&Vector3::new(mirror * 1.5, 1.5, 1.5));
        let affine = Affine::from_parts(axes, Vector3::new(-120.0, 40.0, 800.0)).unwrap();
        let lattice = lattice_on(Grid { shape: GridShape::new(9, 9, 9), affine }, ball(9, 3.7));
        let mut topology = Topology::new(&lattice);
        cut_plane(&lattice, &mut topology, Vector3::repeat(4.2), Vector3::new(0.2, 1.0, -0.3), |p| p.x < 5.5);
        let found = report(&lattice, &topology);
        assert!(found.passes(), "mirror {mirror}: {found}");
        let cubes = lattice.len() as f64 * 1.5_f64.powi(3);
        assert!((found.volume_mm3 / cubes - 1.0).abs() < 0.12, "{} against {cubes}", found.volume_mm3);
    }
}

/// Springs missing from the start (two bodies that touch but do not hold together) part the surface like cut ones.
#[test]
fn springs_that_never_were_part_the_surface() {
    let mut lattice = lattice(6, 4, 4, |_| true);
    for particle in 0..lattice.len() as u32 {
        let left = |p: u32, lattice: &yawara::lattice::Lattice| lattice.ijk(p)[0] < 3;
        for direction in 0..26 {
            if let Some(other) = lattice.neighbour(particle, direction)
                && left(particle, &lattice) != left(other, &lattice)
            {
                Arc::make_mut(&mut lattice.springs)[particle as usize] &= !(1 << direction);
                Arc::make_mut(&mut lattice.springs)[other as usize] &= !(1 << opposite(direction));
            }
        }
    }
    assert!(lattice.springs.iter().all(|&bits| bits & !ALL_ALIVE == 0) && OFFSETS.len() == 26);
    let found = report(&lattice, &Topology::new(&lattice));
    assert!(found.passes() && found.components.len() == 2, "{found}");
    assert!((found.components[0].volume_mm3 - found.components[1].volume_mm3).abs() < 1e-3);
}

#[test]
fn an_empty_field_gives_an_empty_surface() {
    let lattice = lattice_on(unit_grid(3, 3, 3), |_| true);
    let surface = yawara::surface::Surface::extract(&lattice, &Topology::new(&lattice), &[-1.0; 27]).unwrap();
    assert_eq!((surface.vertex_count(), surface.triangles().len()), (0, 0));
    assert!(surface.at_rest(&lattice).normals.is_empty());
}
