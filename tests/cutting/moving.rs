//! Blades in tissue that moves.

use yawara::dynamics::World;
use yawara::dynamics::timeline::Timeline;
use yawara::geometry::{Point3, Vector3};
use yawara::scene::resolved::{Action, Operation};

use crate::oracle::{Expected, Quad, brute_force, passed, severed};
use crate::support::*;

/// A cut as an operation; places and offsets in lattice axes [m].
fn cut(world: &World, edge: [Vector3; 2], path: &[Vector3], from: f64, until: f64) -> Operation {
    let affine = &world.lattice().grid.affine;
    let h = world.lattice().pitch;
    let blade = edge.iter().map(|&v| affine.apply(Point3::from(v / h))).collect();
    let path = path.iter().map(|&v| affine.apply_vector(v / h)).collect();
    Operation { name: "cut".into(), from, until, action: Action::Cut { blade, path } }
}

/// Steps through a time line until a time.
fn run(world: &mut World, timeline: &mut Timeline, until: f64) {
    while world.time() < until - 0.5 * world.dt() {
        timeline.advance(world);
        world.step().unwrap();
    }
    timeline.advance(world);
}

/// A body that flies past an edge that hardly moves, from either side and obliquely: in the frame of the body the edge
/// sweeps a flat piece, which brute force judges at rest.
#[test]
fn tissue_that_flies_through_a_slow_edge_is_cut() {
    let mut total = [0; 3];
    let mut faults = Vec::new();
    for (number, speed) in [(0, 0.3), (1, 1.0), (2, 2.5), (3, 5.0)] {
        for (way, creep) in [
            (-Vector3::x(), Vector3::x()),
            (-Vector3::x(), -Vector3::x()),
            (-Vector3::x(), Vector3::y()),
            (Vector3::new(-1.0, 0.3, 0.2), Vector3::new(0.2, 1.0, 0.1)),
            (Vector3::new(0.2, -1.0, 0.3), Vector3::new(1.0, 1.0, 0.0)),
        ] {
            let mut world = world(paper_lattice(&block([10, 9, 9]), &[Some(PAPER)]));
            let h = world.lattice().pitch;
            let velocity = way * speed;
            for particle in particles(&world) {
                world.set_velocity(particle, velocity);
            }
            // The edge is met after a third of the flight and stands along z (and a little across).
            let duration = (8.0 * h / speed / world.dt()).round() * world.dt();
            let middle = Vector3::new(5.43, 5.13, 5.0) * h + velocity * (0.5 * duration);
            let side = Vector3::new(0.04, 0.1, 1.0) * 30.0 * h;
            let edge = [middle - 0.5 * side, middle + 0.5 * side];
            let stroke = creep * (1e-3 * h);
            let operation = cut(&world, edge, &[-0.5 * stroke, 0.5 * stroke], 0.0, duration);
            let mut timeline = Timeline::new(&[operation], world.lattice()).unwrap();
            let intact = world.clone();
            run(&mut world, &mut timeline, duration);
            // The edge in the frame of the body.
            let quad = Quad { corner: edge[0] - 0.5 * stroke, side, stroke: stroke - velocity * duration };
            let expected = brute_force(&intact, &rest_places(&intact), &[quad], 2e-3 * h);
            let found = severed(&world);
            total[0] += expected.must.len();
            total[1] += expected.must.difference(&found).count();
            total[2] += found.difference(&expected.may).count();
            if expected.must.difference(&found).count() + found.difference(&expected.may).count() > 0 {
                faults.push((number, way, creep));
            }
            assert!(expected.must.len() > 150, "{}", expected.must.len());
        }
    }
    println!("flying tissue: {} springs to sever, {} missed, {} too many; {faults:?}", total[0], total[1], total[2]);
    assert_eq!(total[1..], [0, 0]);
}

/// A body that turns, sways and vibrates around a blade: the edge's way relative to every spring, step by step.
#[test]
fn tissue_that_turns_and_vibrates_is_cut_where_the_edge_passes() {
    let mut total = [0; 4];
    for case in 0..6 {
        let mut world = match case % 2 {
            0 => world(paper_lattice(&block([9, 9, 9]), &[Some(PAPER)])),
            _ => world(tissue_lattice(&blob([9, 9, 9], 0.8, 3), &[Some(TISSUE), Some(TISSUE)])),
        };
        let h = world.lattice().pitch;
        shake(&mut world, 0.05, 0.1, 20 + case);
        let mut random = Random::new(30 + case);
        let (spin, drift) = (random.vector() * 60.0, random.vector() * 0.8);
        let centre = Vector3::new(5.0, 5.0, 5.0) * h;
        for (particle, rest) in particles(&world).into_iter().zip(rest_places(&world)) {
            let velocity = world.velocity(particle) + spin.cross(&(rest - centre)) + drift;
            world.set_velocity(particle, velocity);
        }
        let side = random.vector().normalize() * 6.0 * h;
        let corner = centre + random.vector() * 2.0 * h - 0.5 * side;
        let (a, b) = (random.vector().normalize() * 2.0 * h, random.vector().normalize() * 3.0 * h);
        let path = [-a, Vector3::zeros(), b];
        let steps = if case < 4 { 40 } else { 200 };
        let duration = f64::from(steps) * world.dt();
        let operation = cut(&world, [corner, corner + side], &path, 0.0, duration);
        let mut timeline = Timeline::new(&[operation], world.lattice()).unwrap();

        let edge_at = |share: f64| {
            let s = share.clamp(0.0, 1.0) * 5.0 * h;
            if s <= 2.0 * h { -a + a * (s / (2.0 * h)) } else { b * ((s - 2.0 * h) / (3.0 * h)) }
        };
        let intact = world.clone();
        let mut expected = Expected::default();
        let mut before = places(&world);
        for step in 0..=steps {
            // The edge runs one step ahead of the tissue: it takes its lead over tissue at rest, and waits at the end.
            let after = places(&world);
            let (from, to) =
                (edge_at(f64::from(step) / f64::from(steps)), edge_at(f64::from(step + 1) / f64::from(steps)));
            let here = passed(&intact, &before, &after, [corner + from, corner + side + from], to - from, 16, 0.02 * h);
            expected.must.extend(here.must);
            expected.may.extend(here.may);
            before = after;
            timeline.advance(&mut world);
            if step < steps {
                world.step().unwrap();
            }
        }
        let found = severed(&world);
        total[0] += expected.must.len();
        total[1] += expected.must.difference(&found).count();
        total[2] += found.difference(&expected.may).count();
        total[3] += expected.may.len() - expected.must.len();
    }
    println!(
        "turning tissue: {} springs to sever, {} missed, {} too many, {} too near to tell",
        total[0], total[1], total[2], total[3]
    );
    assert_eq!(total[1..3], [0, 0]);
}
