//! Pressure on the lips of a cut.

use std::path::Path;

use yawara::cut::Blade;
use yawara::dynamics::timeline::Timeline;
use yawara::dynamics::{World, lip_faces};
use yawara::geometry::{Point3, Vector3};
use yawara::run::label_lookup::Files;
use yawara::scene;

use crate::support::*;

/// A block of 13 x 4 x 8 cells, cut from its top down to half of its height across x, in the middle of a layer of cells.
fn cut_block() -> World {
    let mut world = world(tissue_lattice(&block([13, 4, 8]), &[Some(TISSUE)]));
    let h = world.lattice().pitch;
    let edge = vec![Point3::new(7.5 * h, -h, 20.0 * h), Point3::new(7.5 * h, 9.0 * h, 20.0 * h)];
    let blade = Blade::new(edge, &[Vector3::zeros(), Vector3::new(0.0, 0.0, -14.6 * h)]);
    assert!(world.cut(&blade.sweep(0.0, blade.path_length())) > 0);
    world
}

#[test]
fn lips_are_the_faces_beside_the_cut() {
    let world = cut_block();
    let lips = lip_faces(world.lattice(), world.topology(), world.topology().severed());
    let places = rest_places(&world);
    let h = world.lattice().pitch;
    let area = |face: &yawara::dynamics::Face| {
        let [a, b, c, d] = face.corners.map(|corner| places[corner as usize]);
        (c - a).cross(&(d - b)) * 0.5
    };
    let (mut left, mut right, mut below) = (0, 0, 0);
    for face in &lips {
        let middle = face.corners.iter().map(|&corner| places[corner as usize]).sum::<Vector3>() / 4.0;
        let outward = area(face) / (h * h);
        match (outward.x.round() as i32, outward.z.round() as i32) {
            // Out of the tissue, so into the cut.
            (1, 0) => {
                assert!(middle.x < 7.5 * h);
                left += 1;
            }
            (-1, 0) => {
                assert!(middle.x > 7.5 * h);
                right += 1;
            }
            (0, 1) => below += 1,
            other => panic!("{other:?}"),
        }
    }
    println!("{left} faces on the left lip, {right} on the right, {below} below the edge");
    assert!(left == right && left >= 4 * 3 && below >= 4, "{left} {right} {below}");
    assert_eq!(lip_faces(world.lattice(), world.topology(), &[]), []);
}

#[test]
fn pressure_opens_a_cut_in_proportion() {
    let opened = |pressure: f64| {
        let mut world = cut_block();
        let lips = lip_faces(world.lattice(), world.topology(), world.topology().severed());
        let bottom: Vec<u32> = particles(&world).into_iter().filter(|&p| world.lattice().ijk(p)[2] == 1).collect();
        world.hold(&bottom);
        let handle = world.press(&lips);
        world.set_pressure(handle, pressure);
        world.set_drag(200.0);
        while world.time() < 0.5 {
            world.step().unwrap();
        }
        // The corners of the top beside the cut.
        let mean = |side: usize| {
            let of_side: Vec<u32> = particles(&world)
                .into_iter()
                .filter(|&p| world.lattice().ijk(p)[0] == side && world.lattice().ijk(p)[2] == 9)
                .collect();
            of_side.iter().map(|&p| world.displacement(p).x).sum::<f64>() / of_side.len() as f64
        };
        let (left, right) = (mean(7), mean(8));
        assert!((left + right).abs() < 0.02 * (right - left).abs(), "both lips alike: {left} {right}");
        right - left
    };
    let (one, two, sucked) = (opened(20.0), opened(40.0), opened(-20.0));
    println!("opened by {one:e} m, {two:e} m, {sucked:e} m");
    assert!(one > 1e-5 && (two / one - 2.0).abs() < 0.1 && (sucked / one + 1.0).abs() < 0.1);
}

#[test]
fn a_scene_opens_its_incision_as_far_as_it_has_come() {
    let text = |pressure: &str| {
        format!(
            "[volume]\nphantom = \"cube\"\nspacing = 6\n[[organ]]\nname = \"cube\"\nlabel = \"cube\"\nmaterial = \"liver\"\n\
             [time]\nduration = 0.08\n[[fix]]\nregion = {{ half_space = {{ point = [0, 0, -24], normal = [0, 0, -1] }} }}\n\
             [[cut]]\nname = \"incision\"\nblade = [[-40, 0.4, 0], [40, 0.4, 0]]\npath = [[0, 0, 40], [0, 0, 0]]\n\
             from = 0.01\nto = 0.05\n{pressure}"
        )
    };
    let run = |text: &str| {
        let scene = scene::parse(text, Path::new("s.toml"), Path::new("/"), &Files).unwrap().0;
        let inputs = yawara::run::inputs::load(&scene).unwrap();
        let mut world = yawara::run::prepare::prepare(&scene, &inputs).unwrap().into_world(&scene);
        let mut timeline = Timeline::new(&scene.operations, world.lattice()).unwrap();
        let mut at_half = 0.0;
        while world.time() < 0.08 {
            timeline.advance(&mut world);
            world.step().unwrap();
            if at_half == 0.0 && world.time() > 0.03 {
                at_half = displacements(&world).iter().map(|u| u.y.abs()).fold(0.0, f64::max);
            }
        }
        (at_half, displacements(&world).iter().map(|u| u.y.abs()).fold(0.0, f64::max))
    };
    let (half, whole) = run(&text("[[pressure]]\ncut = \"incision\"\npressure = 300\n"));
    println!("half way {half:e} m, in the end {whole:e} m");
    assert!(half > 1e-5 && whole > 3.0 * half, "{half} {whole}");
    assert_eq!(run(&text("")), (0.0, 0.0), "a cut alone opens nothing");
}
