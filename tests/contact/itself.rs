//! Soft tissue against soft tissue: bodies that meet, slide and rest on each other, lips of cuts, prongs of one organ.

use yawara::cut::Blade;
use yawara::dynamics::effects::self_contact::LATERAL;
use yawara::dynamics::measure::balance;
use yawara::lattice::SeveredSpring;
use yawara::lattice::build::NO_ORGAN;

use super::*;

const G: f64 = 9.81;

/// Two cubes of 5 cells, organs 0 and 1, with three cells of nothing between them along x.
fn two_cubes(tissue: TissueBody) -> World {
    let map = organ_map([13, 5, 5], |[i, _, _]| match i {
        0..5 => 0,
        8.. => 1,
        _ => NO_ORGAN,
    });
    world(tissue_lattice(&map, &[Some(tissue), Some(tissue)]))
}

/// Particles on either side of a grid plane across x.
fn sides(world: &World, plane: usize) -> [Vec<u32>; 2] {
    particles(world).into_iter().partition(|&p| world.lattice().ijk(p)[0] < plane).into()
}

fn throw(world: &mut World, of: &[u32], velocity: Vector3) {
    of.iter().for_each(|&p| world.set_velocity(p, velocity));
}

fn shift(world: &mut World, of: &[u32], pitches: Vector3) {
    let moved = pitches * world.lattice().pitch;
    of.iter().for_each(|&p| world.set_displacement(p, moved));
}

/// How many particles lie deeper than a share of a pitch inside whole cells that they are no corner of, and the depth of the deepest
/// [pitches]: by the six tetrahedra of each cell around a diagonal.
fn inside(world: &World, deeper: f64) -> (usize, f64) {
    const AROUND: [usize; 7] = [1, 3, 2, 6, 4, 5, 1];
    let place = places(world);
    let h = world.lattice().pitch;
    let cells: Vec<[u32; 8]> =
        particles(world).into_iter().filter_map(|p| world.topology().whole_cell(world.lattice(), p)).collect();
    // A tetrahedron with how far inside a point is, as the least distance to a side that is not shared within its cell.
    let depth = |point: &Vector3, corners: &[Vector3; 8]| -> Option<f64> {
        AROUND.windows(2).find_map(|pair| {
            let t = [corners[0], corners[7], corners[pair[0]], corners[pair[1]]];
            let volume = (t[1] - t[0]).cross(&(t[2] - t[0])).dot(&(t[3] - t[0]));
            let within = (0..4).all(|corner| {
                let mut other = t;
                other[corner] = *point;
                (other[1] - other[0]).cross(&(other[2] - other[0])).dot(&(other[3] - other[0])) / volume >= 0.0
            });
            within.then(|| {
                let faces = [[0, 2, 6], [1, 3, 7], [0, 1, 5], [2, 3, 7], [0, 1, 3], [4, 5, 7]];
                let to = |[a, b, c]: [usize; 3]| {
                    let normal = (corners[b] - corners[a]).cross(&(corners[c] - corners[a])).normalize();
                    (point - corners[a]).dot(&normal).abs()
                };
                faces.into_iter().map(to).fold(f64::INFINITY, f64::min) / h
            })
        })
    };
    let (mut count, mut deepest) = (0, 0.0_f64);
    for (p, point) in place.iter().enumerate() {
        let found = cells.iter().filter(|cell| !cell.contains(&(p as u32))).find_map(|cell| {
            let corners = cell.map(|corner| place[corner as usize]);
            let near = (corners[0] - point).norm() < 3.0 * h;
            near.then(|| depth(point, &corners)).flatten()
        });
        if let Some(depth) = found {
            count += usize::from(depth > deeper);
            deepest = deepest.max(depth);
        }
    }
    (count, deepest)
}

#[test]
fn cubes_meet_keep_momentum_and_do_not_pass() {
    for (case, offset) in [[0.0, 0.0], [0.5, 0.5], [0.3, -1.2]].into_iter().enumerate() {
        let run = |contact: bool| {
            let mut world = two_cubes(TISSUE);
            world.set_dt(0.25 * world.dt());
            let [left, right] = sides(&world, 7);
            shift(&mut world, &right, Vector3::new(0.0, offset[0], offset[1]));
            throw(&mut world, &left, Vector3::new(0.3, 0.0, 0.0));
            throw(&mut world, &right, Vector3::new(-0.1, 0.0, 0.0));
            if contact {
                world.set_self_contact(&[0, 1], 0.0);
            }
            let start = balance(&world);
            let (mut touched, mut highest, mut deepest) = (0, 0.0_f64, 0.0_f64);
            let mut step = 0;
            while world.time() < 0.09 {
                world.step().unwrap();
                touched += usize::from(world.self_contact().is_some_and(|facts| facts.touching > 0));
                if step % 8 == 0 {
                    let now = balance(&world);
                    highest = highest.max(now.kinetic + now.elastic - start.kinetic);
                }
                if step % 100 == 0 {
                    deepest = deepest.max(inside(&world, 0.1).1);
                }
                step += 1;
            }
            let end = balance(&world);
            let kept = (end.momentum - start.momentum).norm() / start.momentum.norm();
            let mass = |p: u32| f64::from(world.mass()[p as usize]);
            let impulse: f64 = right.iter().map(|&p| mass(p) * (world.velocity(p).x + 0.1)).sum();
            // In pitches aside, of the impulse that they gave each other.
            let turned = (end.angular_momentum - start.angular_momentum).norm() / (world.lattice().pitch * impulse);
            let mean = |of: &[u32]| of.iter().map(|&p| world.velocity(p).x).sum::<f64>() / of.len() as f64;
            (kept, turned, highest / start.kinetic, deepest, touched, mean(&right) - mean(&left))
        };
        let (kept, turned, highest, deepest, touched, parting) = run(true);
        println!(
            "{case}: momentum {kept:.1e}, angular {turned:.1e}, energy {highest:.1e}, {deepest:.3} deep, {touched} steps"
        );
        assert!(kept < 1e-5 && turned < if case == 0 { 1e-4 } else { LATERAL }, "{kept:e} {turned:e}");
        assert!(highest < 1e-3, "{highest:e}");
        assert!(deepest < 0.1 && touched > 10, "{deepest} {touched}");
        // They stop each other, or part again.
        assert!(parting > -0.02, "{parting}");
        let (_, _, _, deepest, _, parting) = run(false);
        // Particles of cubes in line meet face to face, where no depth shows.
        assert!((case == 0 || deepest > 0.15) && parting < -0.35, "without: {deepest} {parting}");
    }
}

/// A small block over a long slab whose particles are all held, one cell of nothing between; gravity is turned instead of the slab.
fn on_slab(degrees: f64, friction: f64) -> (World, Vec<u32>) {
    let map = organ_map([22, 11, 8], |[i, j, k]| match k {
        0 | 1 => 0,
        3.. if (3..8).contains(&i) && (3..8).contains(&j) && k < 6 => 1,
        _ => NO_ORGAN,
    });
    let mut world = world(tissue_lattice(&map, &[Some(DAMPED), Some(DAMPED)]));
    let (slab, block): (Vec<u32>, Vec<u32>) =
        particles(&world).into_iter().partition(|&p| world.lattice().ijk(p)[2] <= 3);
    world.hold(&slab);
    let angle = f64::to_radians(degrees);
    world.set_gravity(Vector3::new(G * angle.sin(), 0.0, -G * angle.cos()));
    world.set_self_contact(&[0, 1], friction);
    // To just above the slab.
    shift(&mut world, &block, Vector3::new(0.13, 0.21, -0.99));
    (world, block)
}

fn mean_of(world: &World, of: &[u32], what: impl Fn(u32) -> Vector3) -> Vector3 {
    let mass = |p: u32| f64::from(world.mass()[p as usize]);
    of.iter().map(|&p| what(p) * mass(p)).sum::<Vector3>() / of.iter().map(|&p| mass(p)).sum::<f64>()
}

#[test]
fn a_block_slides_on_tissue_as_coulomb_says() {
    for (degrees, friction) in [(20.0, 0.0), (30.0, 0.3)] {
        let (mut world, block) = on_slab(degrees, friction);
        run(&mut world, 0.05);
        let velocity = |world: &World| mean_of(world, &block, |p| world.velocity(p));
        let before = velocity(&world);
        run(&mut world, 0.05);
        let gained = (velocity(&world) - before) / 0.05;
        let angle = f64::to_radians(degrees);
        let expected = G * (angle.sin() - friction * angle.cos());
        println!("{degrees} degrees, friction {friction}: {:.3} of {expected:.3} m/s2, off {:.3}", gained.x, gained.z);
        assert!((gained.x - expected).abs() < 0.05 * G * angle.sin(), "{gained}");
        assert!(inside(&world, 0.1).0 == 0);
    }
}

#[test]
fn a_block_sticks_to_tissue_below_the_angle_of_friction() {
    let (mut world, block) = on_slab(20.0, 0.6);
    run(&mut world, 0.3);
    let before = mean_of(&world, &block, |p| world.displacement(p));
    run(&mut world, 0.1);
    let moved = mean_of(&world, &block, |p| world.displacement(p)) - before;
    println!("{:.2e} m in 0.1 s", moved.norm());
    // Sliding it would have gone 17 mm.
    assert!(moved.norm() < 5e-5, "{moved}");
}

/// A block of 10 x 6 x 6 cells cut in two by a plane through its middle, which leans by so much.
fn cut_block(tissue: TissueBody, lean: f64) -> (World, [Vec<u32>; 2]) {
    let mut world = world(tissue_lattice(&block([10, 6, 6]), &[Some(tissue)]));
    let h = world.lattice().pitch;
    let edge =
        vec![Point3::new((6.45 - 6.0 * lean) * h, -h, -3.0 * h), Point3::new((6.45 + 6.0 * lean) * h, -h, 11.0 * h)];
    let blade = Blade::new(edge, &[Vector3::zeros(), Vector3::new(0.0, 12.0 * h, 0.0)]);
    assert!(world.cut(&blade.sweep(0.0, blade.path_length())) > 0);
    let alone = |p: u32| {
        let [x, _, z] = world.lattice().ijk(p).map(|index| index as f64);
        x < 6.45 - 6.0 * lean + 12.0 * lean * (z + 3.0) / 14.0
    };
    let sides = particles(&world).into_iter().partition(|&p| alone(p)).into();
    (world, sides)
}

/// Holds one end of a cut block and presses the other towards it by so many pitches, and across by a share of that.
fn press_lips(world: &mut World, pitches: f64, across: f64, each: &mut impl FnMut(&World)) {
    let end = |first: usize| {
        particles(world).into_iter().filter(|&p| world.lattice().ijk(p)[0].abs_diff(first) < 2).collect()
    };
    let (held, grabbed): (Vec<u32>, Vec<u32>) = (end(1), end(11));
    world.hold(&held);
    let grab = world.grab(&grabbed);
    let far = pitches * world.lattice().pitch * 1e3;
    while world.time() < 0.12 {
        let share = ((world.time() + world.dt()) / 0.08).min(1.0);
        world.move_grab(grab, Vector3::new(-far, across * far, 0.5 * across * far) * share);
        world.step().unwrap();
        each(world);
    }
}

/// Lattice axes are those of the patient here.
#[test]
fn lips_that_are_pressed_do_not_pass() {
    for lean in [0.0, 0.25] {
        let (start, [left, right]) = cut_block(DAMPED, lean);
        let overlap = |contact: Option<f64>| {
            let mut world = start.clone();
            if let Some(friction) = contact {
                world.set_self_contact(&[0], friction);
            }
            press_lips(&mut world, 1.6, 0.2, &mut |_| {});
            // Mean places of the halves: what is pressed together and does not pass keeps them apart.
            let [a, b] = [&left, &right].map(|side| mean_of(&world, side, |p| world.displacement(p)).x);
            let (count, deepest) = inside(&world, 0.1);
            ((b - a) / world.lattice().pitch, count, deepest)
        };
        let [without, with, rough] = [None, Some(0.0), Some(0.3)].map(overlap);
        println!("lean {lean}: without {without:?}, with {with:?}, rough {rough:?}");
        assert!(without.1 > 40 && without.2 > 0.12, "{without:?}");
        assert!(with.1 == 0 && rough.1 == 0, "{with:?} {rough:?}");
    }
}

/// The cells beside a cut are gone for [`inside`]; particle by particle, lips keep the distance they had.
#[test]
fn lips_bear_where_the_blade_parted_them() {
    let (mut world, [left, _]) = cut_block(DAMPED, 0.0);
    world.set_self_contact(&[0], 0.0);
    let h = world.lattice().pitch;
    let across: Vec<[u32; 2]> = left
        .iter()
        .filter(|&&p| world.lattice().ijk(p)[0] == 6)
        .map(|&p| [p, world.lattice().neighbour(p, 13).unwrap_or(p)])
        .filter(|[p, q]| world.lattice().ijk(*q)[0] == world.lattice().ijk(*p)[0] + 1)
        .collect();
    assert_eq!(across.len(), 49);
    let mut least = f64::INFINITY;
    press_lips(&mut world, 2.0, 0.0, &mut |world| {
        for [p, q] in &across {
            least = least.min(1.0 + (world.displacement(*q) - world.displacement(*p)).x / h);
        }
    });
    println!("least distance of lips {least:.4} pitches");
    assert!(least > 0.88 && world.self_contact().unwrap().touching > 25, "{least}");
}

#[test]
fn lips_without_friction_give_no_energy() {
    let (mut world, [left, right]) = cut_block(TISSUE, 0.25);
    world.set_dt(0.25 * world.dt());
    world.set_self_contact(&[0], 0.0);
    throw(&mut world, &left, Vector3::new(0.1, 0.02, 0.0));
    throw(&mut world, &right, Vector3::new(-0.1, 0.0, 0.03));
    let start = balance(&world).kinetic;
    let (mut highest, mut touched, mut step) = (0.0_f64, 0, 0);
    while world.time() < 0.06 {
        world.step().unwrap();
        touched += usize::from(world.self_contact().unwrap().touching > 0);
        if step % 8 == 0 {
            let now = balance(&world);
            highest = highest.max(now.kinetic + now.elastic - start);
        }
        step += 1;
    }
    println!("{:.2e} of the start at most, {touched} steps with contact", highest / start);
    assert!(touched > 50 && highest < 2e-3 * start, "{highest:e} of {start:e}, {touched}");
}

/// Two prongs of one organ, joined at one end, pressed together.
#[test]
fn an_organ_does_not_pass_through_itself() {
    let map = organ_map([16, 4, 9], |[i, _, k]| if i < 3 || !(3..6).contains(&k) { 0 } else { NO_ORGAN });
    let start = world(tissue_lattice(&map, &[Some(DAMPED)]));
    let deepest = |contact: bool| {
        let mut world = start.clone();
        if contact {
            world.set_self_contact(&[0], 0.1);
        }
        let part = |test: &dyn Fn([usize; 3]) -> bool| -> Vec<u32> {
            particles(&world).into_iter().filter(|&p| test(world.lattice().ijk(p))).collect()
        };
        let (end, top, low) =
            (part(&|[i, ..]| i <= 2), part(&|[i, _, k]| i > 12 && k == 10), part(&|[i, _, k]| i > 12 && k == 1));
        world.hold(&end);
        let (down, up) = (world.grab(&top), world.grab(&low));
        let way = Vector3::new(0.0, 0.25, -2.2) * world.lattice().pitch * 1e3;
        while world.time() < 0.12 {
            let share = ((world.time() + world.dt()) / 0.1).min(1.0);
            world.move_grab(down, way * share);
            world.move_grab(up, -way * share);
            world.step().unwrap();
        }
        inside(&world, 0.1)
    };
    let (without, with) = (deepest(false), deepest(true));
    println!("without {without:?}, with {with:?}");
    assert!(without.0 > 10 && with.0 == 0, "{without:?} {with:?}");
}

#[test]
fn only_the_named_organs_take_part() {
    let parting = |organs: &[usize]| {
        let mut world = two_cubes(DAMPED);
        world.set_self_contact(organs, 0.0);
        let [left, right] = sides(&world, 7);
        throw(&mut world, &left, Vector3::new(0.3, 0.0, 0.0));
        run(&mut world, 0.05);
        let mean = |of: &[u32]| mean_of(&world, of, |p| world.velocity(p)).x;
        mean(&right) - mean(&left)
    };
    assert!((parting(&[1]) + 0.3).abs() < 1e-5);
    assert!(parting(&[0, 1]) > -0.02);
}

#[test]
fn what_does_not_touch_changes_no_bit() {
    // Cut and left alone; cut and drawn open; bodies that fly past each other.
    for case in 0..3 {
        let run = |contact: bool| {
            let mut world = if case == 2 { two_cubes(DAMPED) } else { cut_block(DAMPED, 0.25).0 };
            if contact {
                world.set_self_contact(&[0, 1], 0.3);
            }
            let [left, right] = sides(&world, 7);
            match case {
                0 => {}
                1 => {
                    world.hold(&left);
                    throw(&mut world, &right, Vector3::new(0.1, 0.0, 0.0));
                }
                _ => {
                    throw(&mut world, &left, Vector3::new(0.0, 0.0, 0.5));
                    throw(&mut world, &right, Vector3::new(-0.2, 0.0, -0.5));
                }
            }
            for _ in 0..60 {
                world.step().unwrap();
            }
            (displacements(&world), velocities(&world))
        };
        assert!(run(true) == run(false), "case {case}");
    }
}

/// Lips that are pressed and slide, so that all there is takes part.
fn busy(search_always: bool) -> (Vec<Vector3>, Vec<Vector3>, u64) {
    let (mut world, [_, right]) = cut_block(DAMPED, 0.25);
    world.set_self_contact(&[0], 0.2);
    throw(&mut world, &right, Vector3::new(-0.2, 0.1, 0.3));
    for _ in 0..150 {
        if search_always {
            world.set_displacement(0, world.displacement(0));
        }
        world.step().unwrap();
    }
    let facts = world.self_contact().unwrap();
    assert!(facts.looks > 1000);
    (displacements(&world), velocities(&world), facts.searches)
}

#[test]
fn threads_and_searches_change_no_bit() {
    let with =
        |threads: usize| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| busy(false));
    let one = with(1);
    assert!((2..5).all(|threads| with(threads) == one));
    // What the skin leaves out never matters.
    let always = busy(true);
    println!("{} searches in place of {}", one.2, always.2);
    assert!(always.2 == 150 && one.2 < 75 && one.2 > 1);
    assert!(always.0 == one.0 && always.1 == one.1);
}

#[test]
fn what_is_cut_or_torn_on_the_way_touches() {
    // Severed one layer across, between two steps, while it swings.
    let start = world(tissue_lattice(&block([10, 6, 6]), &[Some(DAMPED)]));
    let gap = |contact: bool| {
        let mut world = start.clone();
        if contact {
            world.set_self_contact(&[0], 0.0);
        }
        let [left, right] = sides(&world, 7);
        let before = world.self_contact().map_or(0, |facts| facts.surface_particles);
        run(&mut world, 0.01);
        let time = world.time();
        let across: Vec<SeveredSpring> = left
            .iter()
            .flat_map(|&p| (13..26).map(move |direction| (p, direction)))
            .filter(|&(p, d)| world.lattice().neighbour(p, d).is_some_and(|q| world.lattice().ijk(q)[0] >= 7))
            .map(|(particle, direction)| SeveredSpring { particle, direction: direction as u8, at: 0.5, time })
            .collect();
        // Forward directions whose first end lies on the right lead back over the plane.
        let back: Vec<SeveredSpring> = right
            .iter()
            .flat_map(|&p| (13..26).map(move |direction| (p, direction)))
            .filter(|&(p, d)| world.lattice().neighbour(p, d).is_some_and(|q| world.lattice().ijk(q)[0] < 7))
            .map(|(particle, direction)| SeveredSpring { particle, direction: direction as u8, at: 0.5, time })
            .collect();
        world.sever(across.into_iter().chain(back));
        throw(&mut world, &left, Vector3::new(0.2, 0.0, 0.0));
        run(&mut world, 0.04);
        let mean = |of: &[u32]| mean_of(&world, of, |p| world.displacement(p)).x;
        let after = world.self_contact().map_or(0, |facts| facts.surface_particles);
        ((mean(&right) - mean(&left)) / world.lattice().pitch, after - before)
    };
    let (without, with) = (gap(false), gap(true));
    println!("without {without:?}, with {with:?}");
    assert!(without.0 < -2.0 && with.0 > -0.5, "{without:?} {with:?}");
    // The inner 5 x 5 of both lips are new to the surface.
    assert_eq!(with.1, 50);
}

#[test]
fn a_world_at_rest_costs_no_looks() {
    let (mut world, _) = cut_block(DAMPED, 0.0);
    world.set_self_contact(&[0], 0.0);
    for _ in 0..50 {
        world.step().unwrap();
    }
    let facts = world.self_contact().unwrap();
    // Once, to know that nothing touches.
    assert!(facts.searches == 1 && facts.looks > 0 && facts.looks < 2000, "{facts:?}");
    // Bodies far from each other have no pairs, however they move.
    let mut world = two_cubes(DAMPED);
    world.set_self_contact(&[0, 1], 0.0);
    let [left, _] = sides(&world, 7);
    throw(&mut world, &left, Vector3::new(-0.5, 0.0, 0.0));
    for _ in 0..200 {
        world.step().unwrap();
    }
    let facts = world.self_contact().unwrap();
    assert!(facts.looks < 200, "{facts:?}");
}
