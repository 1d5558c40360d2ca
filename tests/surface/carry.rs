//! How the surface follows the particles.

use nalgebra::Rotation3;
use yawara::geometry::{Affine, Grid, GridShape, Matrix3, Vector3};
use yawara::lattice::{FRINGE, Lattice, Topology};
use yawara::surface::check::check;
use yawara::surface::{Surface, field};

use crate::support::{Random, ball, cut_plane, lattice, lattice_on, sever, springs};

fn grid(n: usize, origin: f64) -> Grid {
    let turn = Rotation3::from_euler_angles(0.3, 0.8, -0.5).into_inner();
    let affine = Affine::from_parts(turn * 1.25, Vector3::repeat(origin)).unwrap();
    Grid { shape: GridShape::new(n, n, n), affine }
}

/// A ball with a shell of fringe particles on one half, cut half through.
fn body(origin: f64) -> (Lattice, Topology, Surface) {
    let mask = ball(11, 4.9);
    let tissue = ball(11, 4.1);
    let mut lattice = lattice_on(grid(11, origin), |ijk| if ijk[0] < 5 { mask(ijk) } else { tissue(ijk) });
    for particle in 0..lattice.len() as u32 {
        if !tissue(lattice.ijk(particle)) {
            lattice.organ[particle as usize] = FRINGE;
        }
    }
    let mut topology = Topology::new(&lattice);
    cut_plane(&lattice, &mut topology, Vector3::repeat(5.2), Vector3::new(0.1, 0.2, 1.0), |p| p.y > 4.6);
    let surface = Surface::extract(&lattice, &topology, &field::smoothed(&lattice, 0, 1)).unwrap();
    (lattice, topology, surface)
}

fn moved_by(lattice: &Lattice, map: impl Fn(Vector3) -> Vector3) -> Vec<[f32; 3]> {
    (0..lattice.len() as u32)
        .map(|particle| {
            let rest = lattice.rest_place(particle).coords;
            let u = map(rest) - rest;
            [u.x as f32, u.y as f32, u.z as f32]
        })
        .collect()
}

/// Largest distance between where the surface went and where the map sends its rest places.
fn error_of(surface: &Surface, lattice: &Lattice, map: impl Fn(Vector3) -> Vector3) -> f64 {
    let mesh = surface.carry(lattice, &moved_by(lattice, &map));
    surface
        .rest_places()
        .zip(&mesh.positions)
        .map(|(rest, place)| (map(Vector3::from(rest)) - Vector3::from(place.map(f64::from))).norm())
        .fold(0.0, f64::max)
}

#[test]
fn affine_maps_are_reproduced_by_every_kind_of_vertex() {
    let (lattice, topology, surface) = body(0.0);
    assert!(topology.severed().len() > 100 && surface.on_seam().filter(|seam| *seam).count() > 50);
    let shear = Matrix3::new(1.3, 0.2, -0.1, 0.05, 0.8, 0.3, 0.0, -0.2, 1.1);
    let error = error_of(&surface, &lattice, |x| shear * x + Vector3::new(3.0, -2.0, 7.0));
    // Displacements reach 20 mm: a few units in their last place.
    assert!(error < 2e-5, "{error} mm");
}

#[test]
fn a_rigid_motion_carries_the_mesh_rigidly_even_far_away() {
    for origin in [0.0, 5000.0] {
        let (lattice, _, surface) = body(origin);
        let centre = lattice.rest_place(0).coords;
        let turn = Rotation3::from_euler_angles(0.7, -0.4, 2.0).into_inner();
        let error = error_of(&surface, &lattice, |x| turn * (x - centre) + centre);
        let last_place = f64::from(f32::EPSILON) * (origin + 20.0);
        assert!(error < 4.0 * last_place + 1e-5, "origin {origin}: {error} mm");
    }
}

#[test]
fn small_motions_far_away_are_not_lost() {
    let (lattice, _, surface) = body(5000.0);
    let centre = lattice.rest_place(0).coords;
    let map = |x: Vector3| x + (x - centre) * 1e-6;
    let mesh = surface.carry(&lattice, &moved_by(&lattice, map));
    for (rest, moved) in surface.rest_places().zip(&mesh.displacements) {
        let expected = (Vector3::from(rest) - centre) * 1e-6;
        // Displacements of up to 2e-5 mm, where f32 places 5 m away are 5e-4 mm apart.
        let error = (expected - Vector3::from(moved.map(f64::from))).norm();
        assert!(error < 1e-9, "{error}");
    }
}

/// Two halves pulled apart: every lip goes with its own half, and nothing is stretched across the gap.
#[test]
fn separated_lips_follow_their_own_side() {
    let lattice = lattice(8, 8, 8, |_| true);
    let mut topology = Topology::new(&lattice);
    cut_plane(&lattice, &mut topology, Vector3::new(3.6, 0.0, 0.0), Vector3::x(), |_| true);
    let surface = Surface::extract(&lattice, &topology, &field::binary(&lattice, 0)).unwrap();
    let apart = Vector3::new(10.0, 1.0, 0.0);
    let displacements: Vec<[f32; 3]> = (0..lattice.len() as u32)
        .map(|p| if lattice.ijk(p)[0] < 4 { [0.0; 3] } else { [apart.x as f32, apart.y as f32, 0.0] })
        .collect();
    let mesh = surface.carry(&lattice, &displacements);
    for (rest, moved) in surface.rest_places().zip(&mesh.displacements) {
        let expected = if rest[0] < 3.6 { Vector3::zeros() } else { apart };
        assert!((Vector3::from(moved.map(f64::from)) - expected).norm() < 1e-5, "{rest:?} {moved:?}");
    }
    let report = check(&mesh);
    assert!(report.passes() && report.components.len() == 2, "{report}");
}

/// Sheets, chains and lone particles have no gradient of their own; they still turn as well as they can.
#[test]
fn thin_bodies_turn_with_their_particles() {
    let turn = Rotation3::from_euler_angles(0.5, 1.0, -0.8).into_inner();
    let about = Vector3::new(2.0, 2.0, 2.0);
    let map = |x: Vector3| turn * (x - about) + about;
    let sheet = lattice(5, 5, 5, |ijk| ijk[2] == 2);
    let surface = Surface::extract(&sheet, &Topology::new(&sheet), &field::binary(&sheet, 0)).unwrap();
    assert!(error_of(&surface, &sheet, map) < 1e-5);
    let chain = lattice(5, 5, 5, |ijk| ijk[1] == 2 && ijk[2] == 2);
    let surface = Surface::extract(&chain, &Topology::new(&chain), &field::binary(&chain, 0)).unwrap();
    let report = check(&surface.carry(&chain, &moved_by(&chain, map)));
    let rest = check(&surface.at_rest(&chain));
    assert!(report.passes() && (report.volume_mm3 / rest.volume_mm3 - 1.0).abs() < 1e-5, "{report}");
    let lone = lattice(3, 3, 3, |ijk| ijk == [1, 1, 1]);
    let surface = Surface::extract(&lone, &Topology::new(&lone), &field::binary(&lone, 0)).unwrap();
    let report = check(&surface.carry(&lone, &[[5.0, 6.0, 7.0]]));
    assert!(report.passes() && report.bounds.unwrap()[0][0] > 5.0, "{report}");
}

/// A plate one particle thick on a thick body: its particles borrow the gradients of the body.
#[test]
fn a_fin_borrows_from_the_body() {
    let lattice = lattice(6, 6, 6, |[i, _, k]| i < 3 || (i == 3 && k == 2));
    let surface = Surface::extract(&lattice, &Topology::new(&lattice), &field::binary(&lattice, 0)).unwrap();
    let shear = Matrix3::new(1.1, 0.2, 0.1, 0.0, 0.9, 0.0, -0.1, 0.0, 1.2);
    assert!(error_of(&surface, &lattice, |x| shear * x) < 1e-5);
}

/// Whatever the particles do, a vertex stays within four pitches of the particles it belongs to.
#[test]
fn crushed_and_exploded_neighbourhoods_do_not_throw_vertices() {
    let (lattice, _, surface) = body(0.0);
    let mut random = Random::new(9);
    for size in [0.0, 3.0, 100.0] {
        let target = lattice.rest_place(0).coords;
        let displacements = moved_by(&lattice, |x| {
            let noise = || size * (random_unit(&mut Random::new(x.x.to_bits() ^ x.y.to_bits().rotate_left(9))) - 0.5);
            (x - target) * 1e-3 + target + Vector3::repeat(noise())
        });
        let mesh = surface.carry(&lattice, &displacements);
        let reach = displacements.iter().zip(0..).fold(0.0_f64, |reach, (u, particle)| {
            let place = lattice.rest_place(particle).coords + Vector3::from(u.map(f64::from));
            reach.max((place - target).norm())
        });
        for place in &mesh.positions {
            let distance = (Vector3::from(place.map(f64::from)) - target).norm();
            assert!(distance < reach + 2.0 * 4.0 * 1.25 + 1e-3, "{size}: {distance} beyond {reach}");
        }
    }
    // One particle lost to infinity spoils its own vertices and no others.
    let mut displacements = vec![[0.0; 3]; lattice.len()];
    displacements[random.below(lattice.len())] = [f32::INFINITY; 3];
    let mesh = surface.carry(&lattice, &displacements);
    let spoiled = check(&mesh).non_finite_vertices;
    assert!(spoiled < 200, "{spoiled}");
}

fn random_unit(random: &mut Random) -> f64 {
    random.unit()
}

#[test]
fn the_same_bits_at_any_thread_count() {
    let lattice = lattice(30, 22, 26, ball(26, 11.0));
    let mut topology = Topology::new(&lattice);
    cut_plane(&lattice, &mut topology, Vector3::repeat(12.3), Vector3::new(0.3, 1.0, 0.5), |p| p.x > 10.0);
    let mut random = Random::new(77);
    for (particle, direction) in springs(&lattice) {
        if random.unit() < 0.02 {
            sever(&lattice, &mut topology, particle, direction, 0.3);
        }
    }
    let displacements: Vec<[f32; 3]> = (0..lattice.len()).map(|_| [0; 3].map(|_| random.unit() as f32)).collect();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let surface = Surface::extract(&lattice, &topology, &field::smoothed(&lattice, 0, 2)).unwrap();
            surface.carry(&lattice, &displacements)
        })
    };
    let one = run(1);
    assert!(one.triangles.len() > 5000);
    for threads in [2, 4] {
        let many = run(threads);
        assert_eq!(many.triangles, one.triangles);
        let bits = |v: &[[f32; 3]]| v.iter().flatten().map(|c| c.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&many.positions), bits(&one.positions));
        assert_eq!(bits(&many.normals), bits(&one.normals));
    }
}
