//! Swept surfaces against brute force over all springs.

use std::collections::BTreeSet;

use yawara::cut::Blade;
use yawara::dynamics::World;
use yawara::dynamics::timeline::{Timeline, What};
use yawara::geometry::{Affine, Matrix3, Point3, Vector3};
use yawara::lattice::neighbours::OFFSETS;
use yawara::scene::resolved::{Action, Operation};

use crate::oracle::{brute_force, living, quads, severed};
use crate::support::*;

/// Nearer to a border than this, either answer is right [pitches]: 30 nm at 3 mm.
const MARGIN: f64 = 1e-5;

fn lattices() -> Vec<(&'static str, World)> {
    vec![
        ("paper block", world(paper_lattice(&block([12, 9, 10]), &[Some(PAPER)]))),
        ("paper blob", world(paper_lattice(&blob([13, 9, 9], 0.6, 1), &[Some(PAPER), Some(PAPER)]))),
        ("tissue block", world(tissue_lattice(&block([10, 9, 10]), &[Some(TISSUE)]))),
        ("tissue blob", world(tissue_lattice(&blob([20, 8, 8], 0.4, 2), &[Some(TISSUE), Some(TISSUE)]))),
    ]
}

/// A polyline of 2 to 4 points through the neighbourhood of `centre`.
fn polyline(random: &mut Random, centre: Vector3, size: f64) -> Vec<Vector3> {
    let count = 2 + random.next() % 3;
    (0..count).map(|_| centre + random.vector() * size).collect()
}

fn blade(edge: &[Vector3], path: &[Vector3]) -> Blade {
    Blade::new(edge.iter().map(|&v| Point3::from(v)).collect(), path)
}

fn cut_all(world: &mut World, blade: &Blade) -> usize {
    world.cut(&blade.sweep(0.0, blade.path_length()))
}

#[test]
fn random_blades_sever_what_brute_force_says() {
    let mut random = Random::new(3);
    let (mut cases, mut springs, mut border) = (0, 0, 0);
    for (name, rest) in lattices() {
        let h = rest.lattice().pitch;
        let middle = rest_places(&rest).iter().sum::<Vector3>() / rest.lattice().len() as f64;
        for deformation in [0.0, 0.2, 1.5] {
            let mut deformed = rest.clone();
            shake(&mut deformed, deformation, 0.0, 4 + cases);
            let places = places(&deformed);
            for stroke in [0.02, 0.7, 8.0, 100.0] {
                for _ in 0..5 {
                    let centre = middle + random.vector() * 4.0 * h;
                    let size = [2.0, 9.0, 60.0][random.next() as usize % 3] * h;
                    let edge = polyline(&mut random, centre, size);
                    let path = polyline(&mut random, Vector3::zeros(), stroke * h);
                    let mut world = deformed.clone();
                    let count = cut_all(&mut world, &blade(&edge, &path));
                    let expected = brute_force(&deformed, &places, &quads(&edge, &path), MARGIN * h);
                    assert_eq!(count, severed(&world).len());
                    expected.check(&severed(&world), &format!("{name}, {deformation}, {edge:?} along {path:?}"));
                    cases += 1;
                    springs += count;
                    border += expected.may.len() - expected.must.len();
                }
            }
        }
    }
    println!("{cases} blades severed {springs} springs, {border} of them too near to a border to tell");
    assert!(cases == 240 && springs > 15_000 && border * 1000 < springs);
}

/// Crossings say where the blade went through.
#[test]
fn the_place_of_a_crossing_lies_on_the_blade() {
    let mut world = world(tissue_lattice(&block([8, 8, 8]), &[Some(TISSUE)]));
    shake(&mut world, 0.3, 0.0, 5);
    let h = world.lattice().pitch;
    let (side, stroke) = (Vector3::new(0.3, 1.0, 0.2) * 40.0 * h, Vector3::new(0.1, -0.2, 1.0) * 40.0 * h);
    let corner = Vector3::new(4.3, 4.1, 4.7) * h - 0.5 * (side + stroke);
    let blade = Blade::new(vec![Point3::from(corner), Point3::from(corner + side)], &[Vector3::zeros(), stroke]);
    let places = places(&world);
    assert!(cut_all(&mut world, &blade) > 300);
    let normal = side.cross(&stroke).normalize();
    for spring in world.topology().severed() {
        let other = world.lattice().neighbour(spring.particle, usize::from(spring.direction)).unwrap();
        let (a, b) = (places[spring.particle as usize], places[other as usize]);
        let distance = normal.dot(&(a + (b - a) * f64::from(spring.at) - corner));
        assert!(distance.abs() < 1e-5 * h, "{:e} pitches from the blade", distance / h);
    }
}

#[test]
fn one_big_sweep_is_a_thousand_small_ones() {
    let mut random = Random::new(6);
    for (name, rest) in lattices() {
        let h = rest.lattice().pitch;
        let deformation = if name.contains("blob") { 0.3 } else { 0.0 };
        let mut whole = rest.clone();
        shake(&mut whole, deformation, 0.0, 7);
        let centre = Vector3::new(5.0, 4.0, 4.0) * h;
        let edge = polyline(&mut random, centre, 12.0 * h);
        let path = polyline(&mut random, Vector3::zeros(), 12.0 * h);
        let blade = blade(&edge, &path);
        let mut pieces = whole.clone();
        cut_all(&mut whole, &blade);
        let length = blade.path_length();
        let sum: usize = (0..1000)
            .map(|i| pieces.cut(&blade.sweep(length * f64::from(i) / 1e3, length * f64::from(i + 1) / 1e3)))
            .sum();
        assert_eq!(severed(&whole), severed(&pieces), "{name}");
        assert_eq!(sum, severed(&pieces).len(), "{name}: nothing is severed twice");
        assert_eq!(cut_all(&mut whole, &blade), 0, "{name}: cutting again finds nothing");
    }
}

/// A plane through a whole layer of particles, also an oblique one and one met from behind: the cut takes the springs of
/// one side, the same side for all particles.
#[test]
fn a_blade_through_particles_leaves_them_the_springs_of_one_side() {
    let rest = world(paper_lattice(&block([10, 10, 10]), &[Some(PAPER)]));
    let h = rest.lattice().pitch;
    let places = rest_places(&rest);
    let on = Vector3::new(5.0, 5.0, 5.0) * h;
    let planes = [
        (Vector3::x(), Vector3::y()),
        (Vector3::y(), Vector3::z()),
        (Vector3::z(), Vector3::x()),
        (Vector3::z(), Vector3::new(1.0, 1.0, 0.0)),
        (Vector3::z(), Vector3::new(1.0, -1.0, 0.0)),
        (Vector3::new(1.0, -1.0, 0.0), Vector3::new(0.0, 1.0, -1.0)),
        (Vector3::new(0.0, 1.0, 2.0), Vector3::new(3.0, 1.0, 0.0)),
    ];
    for (side, stroke) in planes {
        let normal = side.cross(&stroke);
        let mut sides = BTreeSet::new();
        for (side, stroke, steps) in [(side, stroke, 1), (side, stroke, 617), (side, -stroke, 1), (-side, stroke, 41)] {
            let (side, stroke) = (side * 20.0 * h, stroke * 20.0 * h);
            let edge = [on - 0.5 * side, on + 0.5 * side].map(Point3::from);
            let blade = Blade::new(edge.to_vec(), &[-0.5 * stroke, 0.5 * stroke]);
            let mut world = rest.clone();
            for i in 0..steps {
                let at = |i: usize| blade.path_length() * i as f64 / steps as f64;
                world.cut(&blade.sweep(at(i), at(i + 1)));
            }
            // To and fro once more along the same plane.
            let before = severed(&world);
            let back = Blade::new(edge.to_vec(), &[0.5 * stroke, -0.5 * stroke, 0.4 * stroke]);
            assert_eq!(cut_all(&mut world, &back), 0, "{side:?}, {stroke:?}: the way back severs nothing");
            let mut on_plane = 0;
            for particle in particles(&world) {
                let place = places[particle as usize] - on;
                if normal.dot(&place).abs() > 1e-9 * h {
                    continue;
                }
                on_plane += 1;
                let (mut lost, mut kept) = ([false; 2], [false; 2]);
                for (direction, offset) in OFFSETS.iter().enumerate() {
                    let towards = normal.dot(&Vector3::from(offset.map(f64::from)));
                    if world.lattice().springs[particle as usize] >> direction & 1 == 0 || towards == 0.0 {
                        continue;
                    }
                    let alive = world.topology().alive()[particle as usize] >> direction & 1 == 1;
                    (if alive { &mut kept } else { &mut lost })[usize::from(towards > 0.0)] = true;
                }
                assert!(!(lost[0] && lost[1]), "particle {particle} is stripped on both sides of {normal:?}");
                assert!((0..2).all(|s| !(lost[s] && kept[s])), "particle {particle} keeps some springs of a side");
                if lost[0] || lost[1] {
                    sides.insert(usize::from(lost[1]));
                }
            }
            assert!(on_plane >= 10, "{on_plane}");
            let lost = before.iter().filter(|&&(p, d)| {
                let towards = normal.dot(&Vector3::from(OFFSETS[d].map(f64::from)));
                let place = normal.dot(&(places[p as usize] - on));
                place.abs() > 1e-9 * h && (place + towards * h).abs() > 1e-9 * h && place * (place + towards * h) > 0.0
            });
            assert_eq!(lost.count(), 0, "springs that do not reach the plane stay");
        }
        assert_eq!(sides.len(), 1, "plane {normal:?}: every particle and direction of travel loses the same side");
    }
}

#[test]
fn an_edge_along_an_axis_cuts_a_whole_layer() {
    for (name, mut world) in lattices().into_iter().filter(|(name, _)| name.contains("block")) {
        let h = world.lattice().pitch;
        let dims = world.lattice().grid.shape.dims().map(|n| n as f64);
        // Between the layers i = 4 and i = 5, the edge along z, from beyond y = 0 to beyond the end: in one step.
        let edge = [Point3::new(4.5 * h, -h, -h), Point3::new(4.5 * h, -h, dims[2] * h)];
        let blade = Blade::new(edge.to_vec(), &[Vector3::zeros(), Vector3::y() * (dims[1] + 2.0) * h]);
        let expected: Vec<_> = living(&world)
            .into_iter()
            .filter(|&(_, a, b)| {
                let i = |p: usize| world.lattice().ijk(p as u32)[0];
                i(a).min(i(b)) == 4 && i(a).max(i(b)) == 5
            })
            .map(|(spring, ..)| spring)
            .collect();
        assert_eq!(cut_all(&mut world, &blade), expected.len(), "{name}");
        assert!(expected.into_iter().eq(severed(&world)), "{name}");
        assert!(world.topology().severed().iter().all(|s| (s.at - 0.5).abs() < 2e-6));
    }
}

#[test]
fn a_blade_that_stops_inside_severs_what_it_reached() {
    let mut world = world(paper_lattice(&block([10, 10, 10]), &[Some(PAPER)]));
    let h = world.lattice().pitch;
    let edge = vec![Point3::new(5.5 * h, 0.0, 3.2 * h), Point3::new(5.5 * h, 0.0, 6.8 * h)];
    let blade = Blade::new(edge, &[Vector3::zeros(), Vector3::y() * 4.3 * h]);
    cut_all(&mut world, &blade);
    let rest = rest_places(&world);
    let mut face = 0;
    for spring in world.topology().severed() {
        let other = world.lattice().neighbour(spring.particle, usize::from(spring.direction)).unwrap();
        let (a, b) = (rest[spring.particle as usize], rest[other as usize]);
        let hit = (a + b) * (0.5 / h);
        assert!((hit.x - 5.5).abs() < 1e-9 && hit.y < 4.3 + 1e-4 && (3.2 - 1e-4..6.8 + 1e-4).contains(&hit.z));
        face += usize::from((a - b).norm() < 1.5 * h && (a - b).yz().norm() < 1e-9);
    }
    // Rows y = 1 to 4 (the lattice starts at 1), z = 4 to 6.
    assert_eq!(face, 4 * 3);
}

/// Blades given in patient millimetres, through a time line, on volumes that lie at an angle and mirrored.
#[test]
fn blades_in_millimetres_meet_oblique_and_mirrored_lattices() {
    let mut random = Random::new(8);
    let mut springs = 0;
    for case in 0..24 {
        let turn = nalgebra::Rotation3::from_scaled_axis(random.vector() * 3.0).into_inner();
        let mirror = Matrix3::from_diagonal(&Vector3::new(if case % 2 == 0 { 1.0 } else { -1.0 }, 1.0, 1.0));
        let affine = Affine::from_parts(turn * mirror * 2.5, random.vector() * 300.0).unwrap();
        let map = block_placed(affine, [8, 7, 9]);
        let mut world = if case % 3 == 0 {
            world(tissue_lattice(&map, &[Some(TISSUE)]))
        } else {
            world(paper_lattice(&map, &[Some(PAPER)]))
        };
        assert_eq!(world.lattice().grid.affine.determinant() < 0.0, case % 2 == 1);
        shake(&mut world, 0.3, 0.0, 9 + case);
        let places: Vec<Vector3> = world
            .displacements_mm()
            .iter()
            .zip(particles(&world))
            .map(|(u, p)| world.lattice().rest_place(p).coords + Vector3::from(u.map(f64::from)))
            .collect();
        let middle = places.iter().sum::<Vector3>() / places.len() as f64;
        let edge = polyline(&mut random, middle, 20.0);
        let path = polyline(&mut random, Vector3::zeros(), 20.0);
        // The whole cut lies before the first step, so the state is the one above.
        let dt = world.dt();
        let cut = Operation {
            name: "cut".into(),
            from: 0.0,
            until: 0.5 * dt,
            action: Action::Cut { blade: edge.iter().map(|&v| Point3::from(v)).collect(), path: path.clone() },
        };
        let mut timeline = Timeline::new(&[cut], world.lattice()).unwrap();
        let intact = world.clone();
        timeline.advance(&mut world);
        let expected = brute_force(&intact, &places, &quads(&edge, &path), 1e-4 * 2.5);
        expected.check(&severed(&world), &format!("case {case}"));
        assert_eq!(timeline.finish(&mut world)[0].what, What::Severed(severed(&world).len()));
        springs += severed(&world).len();
    }
    assert!(springs > 3000, "{springs}");
}
