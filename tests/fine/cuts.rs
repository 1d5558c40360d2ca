//! Each side of a blade moves with its own particles, and the mesh stays closed.

use rayon::prelude::*;
use yawara::geometry::{Point3, Vector3};
use yawara::lattice::SeveredSpring;
use yawara::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS, OFFSETS};
use yawara::surface::check::check;
use yawara::surface::fine::{FineSurface, Memory};
use yawara::surface::weld::{soup, weld};

use crate::bodies::{RADIUS, ball, blade, cut, displace, fine_ball, fine_body, mesh, middle, surface};
use crate::support::Random;

#[test]
fn two_halves_part_along_the_blade() {
    for (tissue, normal) in [(true, Vector3::x()), (false, Vector3::x()), (true, Vector3::new(1.0, 0.6, -0.3))] {
        let normal = normal.normalize();
        let mut world = ball(tissue);
        let edge = normal.cross(&Vector3::new(0.2, -0.5, 1.0)).normalize();
        assert!(cut(&mut world, normal * 0.4, edge, normal.cross(&edge), 30.0) > 0);
        let side = |place: Point3| (place - middle()).dot(&normal) - 0.4;
        displace(&mut world, |place| normal * 4.0 * side(place).signum());
        let surface = surface(&world, &fine_ball(0.8));
        let mesh = surface.carry(world.lattice(), &world.displacements_mm());
        let report = check(&mesh);
        assert!(report.passes(), "{report}");
        assert_eq!(report.components.len(), 2, "{report}");
        for (moved, rest) in mesh.displacements.iter().zip(surface.rest_places()) {
            let expected = normal * 4.0 * side(Point3::from(*rest)).signum();
            if side(Point3::from(*rest)).abs() < 0.2 {
                // A vertex may be drawn over the blade by as much as its edge needs to stay clear of its ends.
                continue;
            }
            let off = (Vector3::from(moved.map(f64::from)) - expected).norm();
            // Every vertex goes with its own side, whole.
            assert!(off < 1e-4, "{rest:?} moves by {moved:?}, expected {expected}");
        }
        // Both lips lie in the plane of the blade.
        let lips = surface.on_seam().zip(surface.rest_places()).filter(|(seam, _)| *seam);
        let mut off: Vec<f64> = lips.map(|(_, rest)| side(Point3::from(*rest)).abs()).collect();
        off.sort_by(f64::total_cmp);
        println!(
            "{} vertices of lips, off the blade by {:.4} mm (95 of 100), {:.4} at most",
            off.len(),
            off[off.len() * 95 / 100],
            off[off.len() - 1]
        );
        assert!(off[off.len() * 95 / 100] < 0.05, "lips lie {off:?} mm off the blade");
    }
}

#[test]
fn half_a_cut_opens_and_ends_inside() {
    let mut world = ball(true);
    assert!(cut(&mut world, Vector3::new(0.3, 0.0, 0.0), Vector3::y(), Vector3::z(), 0.0) > 0);
    let surface = surface(&world, &fine_ball(0.8));
    let report = check(&surface.carry(world.lattice(), &world.displacements_mm()));
    assert!(report.passes(), "{report}");
    assert_eq!((report.components.len(), report.euler), (1, 2), "a slit changes no topology: {report}");
    let deepest = surface.on_seam().zip(surface.rest_places()).filter(|(seam, _)| *seam).map(|(_, rest)| rest[2]);
    let deepest = deepest.fold(f64::MIN, f64::max) - middle().z;
    // The fine surface ends where the edge did, not where the lattice's cells do.
    assert!((-0.9..0.9).contains(&deepest), "the cut ends {deepest} mm past the middle, asked was 0");
    // Without a displacement nothing moves, and the slit has no width.
    assert!((report.volume_mm3 / (4.0 / 3.0 * std::f64::consts::PI * RADIUS.powi(3)) - 1.0).abs() < 0.01);
}

/// Sides that part in proportion to the distance from the end of a cut that slants through the cells: where it ends they meet without a
/// leap.
#[test]
fn the_sides_of_a_cut_come_together_where_it_ends() {
    let [edge, way] = [Vector3::new(0.25, -0.3, 1.0), Vector3::new(0.2, 1.0, 0.35)].map(|axis| axis.normalize());
    let normal = edge.cross(&way).normalize();
    let forward = normal.cross(&edge).normalize();
    let mut world = ball(true);
    assert!(cut(&mut world, Vector3::zeros(), edge, way, 0.0) > 0);
    let behind = |place: Point3| -(place - middle()).dot(&forward);
    let parted = |place: Point3| 0.8 * behind(place).max(0.0) * (place - middle()).dot(&normal).signum();
    displace(&mut world, |place| normal * parted(place));
    let surface = surface(&world, &fine_ball(0.8));
    let mesh = surface.carry(world.lattice(), &world.displacements_mm());
    assert!(check(&mesh).passes());
    let place = |vertex: u32| Point3::from(surface.rest_places()[vertex as usize]);
    let moved = |vertex: u32| Vector3::from(mesh.displacements[vertex as usize].map(f64::from));
    let near =
        |vertex: &u32| behind(place(*vertex)).abs() < 3.0 && (place(*vertex) - middle()).dot(&normal).abs() < 1.0;
    let mut slopes = Vec::new();
    for triangle in surface.triangles().iter().filter(|triangle| triangle.iter().all(near)) {
        for [a, b] in [[0, 1], [1, 2], [2, 0]].map(|edge| edge.map(|corner| triangle[corner])) {
            slopes.push((moved(a) - moved(b)).norm() / (place(a) - place(b)).norm().max(0.4));
        }
    }
    slopes.sort_by(f64::total_cmp);
    let steepest = slopes[slopes.len() - 1];
    let steep = slopes.iter().filter(|slope| **slope > 1.2).count() as f64 / slopes.len() as f64;
    println!(
        "{} edges near the end, asked to part by 0.8 of their length at most: {steepest:.2} of it at most, {:.1} % by more than 1.2",
        slopes.len(),
        100.0 * steep
    );
    assert!(slopes.len() > 1000 && steepest < 1.7, "a ledge where the cut ends");
}

#[test]
fn cutting_again_through_an_open_cut_adds_nothing() {
    let mut world = ball(true);
    let blade =
        |world: &mut yawara::dynamics::World| cut(world, Vector3::new(0.3, 0.0, 0.0), Vector3::y(), Vector3::z(), 30.0);
    assert!(blade(&mut world) > 0);
    displace(&mut world, |place| Vector3::new(5.0 * (place.x - middle().x - 0.3).signum(), 0.0, 0.0));
    let quads = world.cut_sheet().quads.len();
    assert!(quads > 0);
    assert_eq!(blade(&mut world), 0);
    // What waits for a severed spring is given up, however long it goes on.
    (0..40).for_each(|_| assert_eq!(blade(&mut world), 0));
    assert_eq!(world.cut_sheet().quads.len(), quads);
}

#[test]
fn springs_severed_without_a_blade_part_the_surface_too() {
    let mut world = ball(true);
    let lattice = world.lattice().clone();
    let plane = lattice.grid.affine.index_of(middle()).x + 0.2;
    let springs = (0..lattice.len() as u32).flat_map(|particle| {
        let x = lattice.ijk(particle)[0] as f64;
        let alive = lattice.springs[particle as usize];
        (FIRST_FORWARD..NEIGHBOURS).filter_map(move |direction| {
            let at = (plane - x) / f64::from(OFFSETS[direction][0]);
            let severed = alive >> direction & 1 == 1 && (0.0..=1.0).contains(&at);
            severed.then_some(SeveredSpring { particle, direction: direction as u8, at: at as f32, time: 0.0 })
        })
    });
    let springs: Vec<_> = springs.collect();
    assert!(world.sever(springs) > 0);
    displace(&mut world, |place| Vector3::new(4.0 * (place.x - middle().x - 0.6).signum(), 0.0, 0.0));
    let mesh = mesh(&world, &fine_ball(0.8));
    let report = check(&mesh);
    assert!(report.passes() && report.components.len() == 2, "{report}");
    let between = mesh.displacements.iter().filter(|moved| moved[0].abs() < 3.99).count();
    assert_eq!(between, 0, "vertices that go with neither side");
}

/// Two blades go in step by step, and a few springs break by themselves; then everything is looked at again from the middle on. A
/// part of the body lies where the lattice has no cell.
#[test]
fn a_body_opened_cut_by_cut_is_the_body_opened_at_once() {
    let trials: u64 = std::env::var("YAWARA_TRIALS").map_or(6, |n| n.parse().expect("a number of bodies"));
    let counts: Vec<[usize; 2]> = (0..trials)
        .into_par_iter()
        .map(|trial| {
            let mut random = Random::new(1000 + trial);
            let mut world = ball(trial % 3 > 0);
            let apart = middle() + random.vector().normalize() * (RADIUS + 5.0);
            let depth = |place: Point3| (RADIUS - (place - middle()).norm()).max(2.5 - (place - apart).norm());
            let body = fine_body([2.3, 1.4, 1.1][trial as usize % 3], RADIUS + 9.0, depth);
            let mut states = vec![(world.topology().clone(), world.cut_sheet().clone())];
            for _ in 0..2 {
                let (edge, offset) = (random.vector(), random.vector() * 6.0);
                let way = edge.cross(&random.vector());
                let knife = blade(&world, offset, edge, way, 10.0 * random.unit());
                let steps = 6;
                for step in 0..steps {
                    let [from, to] = [step, step + 1].map(|at| knife.path_length() * f64::from(at) / f64::from(steps));
                    let lost = world.cut(&knife.sweep(from, to));
                    if step % 3 == 2 {
                        let particle = (random.unit() * world.lattice().len() as f64) as u32;
                        let alive = world.topology().alive()[particle as usize];
                        let living = (FIRST_FORWARD..NEIGHBOURS).filter(|direction| alive >> direction & 1 == 1);
                        let spring = |d| SeveredSpring { particle, direction: d as u8, at: 0.5, time: 0.0 };
                        let springs: Vec<_> = living.map(spring).collect();
                        world.sever(springs);
                    }
                    if lost > 0 || step % 3 == 2 {
                        states.push((world.topology().clone(), world.cut_sheet().clone()));
                    }
                }
            }
            let mut memory = Memory::default();
            let moved = world.displacements_mm();
            let again = states.len() / 2;
            for (topology, sheet) in states.iter().chain(&states[again..]) {
                let lattice = world.lattice();
                let at_once = FineSurface::extract(&body, lattice, topology, sheet).unwrap();
                let followed = FineSurface::extract_after(&body, lattice, topology, sheet, None, &mut memory).unwrap();
                assert_eq!(at_once.carry(lattice, &moved), followed.carry(lattice, &moved), "trial {trial}");
                assert!(at_once.on_seam().eq(followed.on_seam()), "trial {trial}");
            }
            let (topology, sheet) = &states[states.len() - 1];
            let surface = FineSurface::extract(&body, world.lattice(), topology, sheet).unwrap();
            [states.len(), surface.on_seam().filter(|seam| *seam).count()]
        })
        .collect();
    let sum = |which: usize| counts.iter().map(|count| count[which]).sum::<usize>();
    println!("{trials} bodies, {} states, {} vertices on cuts", sum(0), sum(1));
    assert!(sum(0) as u64 > 6 * trials && sum(1) as u64 > 200 * trials, "{counts:?}");
}

/// Random blades, whole and half, straight and slanting, one to four of them, on a body that is then shaken.
/// `YAWARA_TRIALS` sets how many bodies are cut.
#[test]
fn random_blades_leave_closed_manifolds() {
    let trials: u64 = std::env::var("YAWARA_TRIALS").map_or(200, |n| n.parse().expect("a number of bodies"));
    let (parts, triangles): (Vec<usize>, Vec<usize>) = (0..trials)
        .into_par_iter()
        .map(|trial| {
            let mut random = Random::new(trial);
            let mut world = ball(random.unit() < 0.7);
            let body = fine_ball([2.9, 1.7, 1.1][trial as usize % 3]);
            let severed: usize = (0..1 + trial % 4)
                .map(|_| {
                    let offset = random.vector() * 8.0;
                    let (edge, way) = if random.unit() < 0.3 {
                        // Straight along the axes, in the planes of grid points of one grid or the other.
                        let axis = trial as usize % 3;
                        (Vector3::ith(axis, 1.0), Vector3::ith((axis + 1) % 3, 1.0))
                    } else {
                        let edge = random.vector();
                        (edge, edge.cross(&random.vector()))
                    };
                    let depth = if random.unit() < 0.5 { 30.0 } else { 16.0 * random.unit() - 8.0 };
                    let severed = cut(&mut world, offset, edge, way, depth);
                    // The next blade meets tissue that has moved.
                    let (size, push) = (0.08 * random.unit(), random.vector());
                    displace(&mut world, |place| size * (place - middle()).cross(&push));
                    severed
                })
                .sum();
            let surface = surface(&world, &body);
            let rest = surface.carry(world.lattice(), &vec![[0.0; 3]; world.lattice().len()]);
            let report = check(&rest);
            assert!(report.passes(), "trial {trial}, {severed} springs severed: {report}");
            assert_eq!(report.unused_vertices, 0, "trial {trial}");
            let welded = check(&weld(&soup(&rest), 0.0));
            assert!(welded.passes(), "trial {trial}, welded: {welded}");
            crate::support::shake(&mut world, 0.2, 0.0, trial);
            let shaken = surface.carry(world.lattice(), &world.displacements_mm());
            assert!(shaken.positions.iter().chain(&shaken.normals).flatten().all(|c| c.is_finite()), "trial {trial}");
            (report.components.len(), report.triangles)
        })
        .unzip();
    println!(
        "{trials} cut bodies, {} parts, {} triangles: no defect",
        parts.iter().sum::<usize>(),
        triangles.iter().sum::<usize>()
    );
    assert!(parts.iter().filter(|&&parts| parts > 1).count() > trials as usize / 5);
}
