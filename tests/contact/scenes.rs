//! From a scene with tools, planes and bone to frames and forces.

use std::path::Path;

use yawara::dynamics::timeline::{Timeline, TimelineError, What};
use yawara::io::stl::write_stl;
use yawara::lattice::region::Region;
use yawara::run::drive::{Observer, drive};
use yawara::run::inputs::{self, InputError};
use yawara::run::label_lookup::Files;
use yawara::run::prepare::prepare;
use yawara::run::record::Recorder;
use yawara::scene;
use yawara::scene::resolved::{Action, Scene};
use yawara::store::{RunReader, Status};
use yawara::surface::mesh::{Finish, OrganMesh, TriangleMesh};

use super::*;

/// A cube of 60 mm of 6 mm cells, held at its bottom.
fn cube(more: &str) -> String {
    "[volume]\nphantom = \"cube\"\nspacing = 6.0\n[[organ]]\nname = \"block\"\nlabel = \"cube\"\nyoungs_modulus = 5e3\n\
     density = 1060\ndamping_ratio = 0.4\n[time]\nduration = 0.3\nframes = 6\n\
     [[fix]]\nregion = { half_space = { point = [0, 0, -29], normal = [0, 0, -1] } }\n"
        .to_owned()
        + more
}

fn parse(text: &str, folder: &Path) -> Scene {
    let (scene, warnings) = scene::parse(text, Path::new("s.toml"), folder, &Files).unwrap_or_else(|e| panic!("{e}"));
    assert!(warnings.is_empty(), "{}", warnings[0]);
    scene
}

/// Runs a scene; the world at the end.
fn simulate(scene: &Scene, observer: &mut impl Observer) -> World {
    let inputs = inputs::load(scene).unwrap();
    let prepared = prepare(scene, &inputs).unwrap();
    let mut timeline = Timeline::with_tools(&scene.operations, &prepared.lattice, &inputs.tools).unwrap();
    let schedule = prepared.schedule;
    let mut world = prepared.into_world(scene);
    assert!(drive(&mut world, &mut timeline, &schedule, observer).is_ok());
    world
}

/// A box as an organ's mesh [mm].
fn cuboid(min: [f32; 3], max: [f32; 3]) -> OrganMesh {
    let corner = |c: usize| [0, 1, 2].map(|axis| if c >> axis & 1 == 1 { max[axis] } else { min[axis] });
    let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    let mesh = TriangleMesh { positions: (0..8).map(corner).collect(), triangles, ..TriangleMesh::default() };
    OrganMesh { name: "tool".to_owned(), color: [0.5; 3], finish: Finish::Wet, mesh }
}

const PRESS: &str = "path = [[0, 0, 0], [0, 0, -6]]\nto = 0.2\nfriction = 0.3\n";

#[test]
fn a_mesh_presses_as_the_box_it_is() {
    let folder = tempfile::tempdir().unwrap();
    write_stl(&folder.path().join("box.stl"), &[cuboid([-14.0, -15.0, 30.0], [16.0, 13.0, 40.0])]).unwrap();
    let force = |shape: &str| {
        let scene = parse(&cube(&format!("[[tool]]\nshape = {shape}\n{PRESS}")), folder.path());
        let world = simulate(&scene, &mut ());
        let facts: Vec<_> = world.obstacles().map(|facts| (facts.name.to_owned(), facts.force)).collect();
        assert_eq!((facts.len(), facts[0].0.as_str()), (1, "tool 1"));
        facts[0].1
    };
    let [solid, mesh] =
        ["{ box = { min = [-14, -15, 30], max = [16, 13, 40] } }", "{ mesh = { file = \"box.stl\" } }"].map(force);
    assert!(solid.z > 0.1 && (solid - mesh).norm() < 0.01 * solid.norm(), "{solid} {mesh}");
}

#[test]
fn bad_meshes_say_what_is_wrong_with_which_tool() {
    let folder = tempfile::tempdir().unwrap();
    let mut open = cuboid([-14.0, -15.0, 30.0], [16.0, 13.0, 40.0]);
    let mut inside_out = open.clone();
    open.mesh.triangles.pop();
    inside_out.mesh.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    write_stl(&folder.path().join("open.stl"), &[open]).unwrap();
    write_stl(&folder.path().join("turned.stl"), &[inside_out]).unwrap();
    std::fs::write(folder.path().join("torn.stl"), b"solid").unwrap();
    let scene = |file: &str| {
        let tool = format!("[[tool]]\nname = \"probe\"\nshape = {{ mesh = {{ file = \"{file}\" }} }}\n{PRESS}");
        parse(&cube(&tool), folder.path())
    };
    for (file, what) in
        [("open.stl", "it is not closed: 3 edges"), ("turned.stl", "it is inside out: its volume is -8400")]
    {
        let scene = scene(file);
        let inputs = inputs::load(&scene).unwrap();
        let prepared = prepare(&scene, &inputs).unwrap();
        let error = Timeline::with_tools(&scene.operations, &prepared.lattice, &inputs.tools).unwrap_err().to_string();
        assert!(["`probe`", file, what].iter().all(|part| error.contains(part)), "{error}");
        let unread = Timeline::new(&scene.operations, &prepared.lattice).unwrap_err();
        assert!(matches!(unread, TimelineError::MeshNotRead { .. }), "{unread}");
    }
    for file in ["torn.stl", "missing.stl"] {
        let error = inputs::load(&scene(file)).unwrap_err();
        assert!(matches!(&error, InputError::Tool { tool, .. } if tool == "probe"), "{error}");
        assert!(error.to_string().contains(file), "{error}");
    }
}

#[test]
fn a_run_keeps_the_forces_of_its_frames() {
    let folder = tempfile::tempdir().unwrap();
    let text = cube(&format!(
        "[gravity]\nacceleration = [0, 0, -9.81]\n[[plane]]\nname = \"table\"\npoint = [0, 0, -30]\nnormal = [0, 0, 2]\n\
         friction = 0.4\n[[tool]]\nname = \"ball\"\nshape = {{ sphere = {{ center = [0, 0, 42], radius = 12 }} }}\n{PRESS}"
    ))
    .replace("[[fix]]\nregion = { half_space = { point = [0, 0, -29], normal = [0, 0, -1] } }\n", "");
    let scene = parse(&text, folder.path());
    let inputs = inputs::load(&scene).unwrap();
    let prepared = prepare(&scene, &inputs).unwrap();
    let path = folder.path().join("run");
    let mut recorder = Recorder::create(&path, &scene, None, &inputs, &prepared, false).unwrap();
    let world = simulate(&scene, &mut recorder);
    let lines = recorder.obstacle_lines();
    assert!(lines.len() == 2 && lines[0].contains("`table`") && lines[1].contains("obstacle_2_force_x"), "{lines:?}");
    recorder.finish(Status::Complete).unwrap();

    let reader = RunReader::open(&path).unwrap();
    let series = |name: &str| reader.series(name).unwrap();
    let [table, ball] = ["obstacle_1_force_z", "obstacle_2_force_z"].map(series);
    assert_eq!((table.values.len(), table.unit.as_str()), (7, "N"));
    assert_eq!((table.values[0], ball.values[0]), (0.0, 0.0));
    // Means over the time between frames: their sum is the impulse. What gravity gave and obstacles did not take still moves.
    let impulse: f64 = table.values.iter().chain(&ball.values).map(|force| force * 0.3 / 6.0).sum();
    let (mass, largest) = (total_mass(&world), ball.values.iter().copied().fold(0.0, f64::max));
    let moves = mass * mean_velocity(&world).z;
    println!("impulse {impulse:.5} N s, of gravity {:.5}, left {moves:.5}; ball {largest:.3} N", -mass * 9.81 * 0.3);
    assert!((impulse + mass * 9.81 * 0.3 + moves).abs() < 1e-4 * mass * 9.81 * 0.3);
    assert!(largest > 0.1 && table.values[1..].iter().all(|&force| force < 0.0));
    // Alike on all sides, so that nothing is left across.
    assert!(series("obstacle_2_force_x").values.iter().all(|force| force.abs() < 0.01 * largest));
    // The scene as kept is read back.
    let kept: Scene = serde_json::from_value(serde_json::to_value(&scene).unwrap()).unwrap();
    assert_eq!(kept, scene);
}

/// Notes what begins and ends.
#[derive(Default)]
struct Events(Vec<String>);

impl Observer for Events {
    type Error = std::convert::Infallible;

    fn event(&mut self, event: &yawara::dynamics::timeline::Event) -> Result<(), Self::Error> {
        let what = match event.what {
            What::Began(_) => "begins",
            _ => "ends",
        };
        self.0.push(format!("{:.3} {} {what}", event.time, event.operation));
        Ok(())
    }
}

#[test]
fn a_released_tool_lets_tissue_return() {
    let folder = tempfile::tempdir().unwrap();
    let tool = "[[tool]]\nname = \"rod\"\nshape = { capsule = { from = [0, -50, 36], to = [0, 50, 36], radius = 6 } }\n\
                path = [[0, 0, 1], [0, 0, -8]]\nfrom = 0.02\nto = 0.06\n";
    let dent = |more: &str| {
        let mut events = Events::default();
        let world = simulate(&parse(&cube(&format!("{tool}{more}")), folder.path()), &mut events);
        let lowest =
            places_mm(&world).iter().filter(|p| p.x.abs() < 0.1 && p.z > 15.0).map(|p| p.z).fold(0.0, f64::max);
        let force = world.obstacles().next().unwrap().force.norm();
        (lowest, force, events.0)
    };
    let (pressed, force, _) = dent("");
    assert!((pressed - 22.0).abs() < 0.1 && force > 0.1, "{pressed} {force}");
    let (free, force, events) = dent("[[release]]\nof = \"rod\"\nat = 0.1\n");
    assert!(free > 28.0 && force == 0.0, "{free} {force}");
    let rod: Vec<&str> = events.iter().map(String::as_str).filter(|event| event.contains("rod")).collect();
    assert!(rod.len() == 2 && rod[0].starts_with("0.02") && rod[1].starts_with("0.10"), "{rod:?}");
    // Without a path, `to` takes it away.
    let still = tool.replace("path = [[0, 0, 1], [0, 0, -8]]\n", "").replace("36]", "30]");
    let gravity = "[gravity]\nacceleration = [0, 0, -1]\n";
    let scene = parse(&cube(&format!("{still}{gravity}")), folder.path());
    let rod = scene.operations.iter().find(|operation| operation.name == "rod").unwrap();
    assert_eq!((rod.from, rod.until), (0.02, 0.06));
    assert!(matches!(&rod.action, Action::Tool { path, friction: 0.0, .. } if path.len() == 1));
}

#[test]
fn bone_is_grabbed_as_a_whole_or_not_at_all() {
    let folder = tempfile::tempdir().unwrap();
    let text = "[volume]\nphantom = \"abdomen\"\nspacing = 8.0\n[[organ]]\nname = \"liver\"\nlabel = \"liver\"\nmaterial = \"liver\"\n\
        [[organ]]\nname = \"spine\"\nlabel = \"spine\"\nrigid = true\n[time]\nduration = 0.01\n[contact]\nbone = true\nfriction = 0.1\n";
    let pull =
        |region: &str| format!("{text}[[pull]]\nname = \"hook\"\nregion = {region}\npath = [[0, 0, 0], [0, 2, 0]]\n");
    let world = simulate(
        &parse(&pull("{ all = [{ organ = \"liver\" }, { not = { organ = \"spine\" } }] }"), folder.path()),
        &mut (),
    );
    assert_eq!(world.obstacles().map(|facts| facts.name.to_owned()).collect::<Vec<_>>(), ["bone"]);
    let world = simulate(&parse(&pull("{ organ = \"spine\" }"), folder.path()), &mut ());
    let spine = Region::Organ(1).select(world.lattice());
    let moved = world.displacements_mm();
    assert!(spine.iter().all(|&p| (moved[p as usize][1] - 2.0).abs() < 1e-4));
    assert_eq!(world.obstacles().count(), 1);
    let scene = parse(&pull("{ half_space = { point = [0, 0, 0], normal = [0, 0, 1] } }"), folder.path());
    let prepared = prepare(&scene, &inputs::load(&scene).unwrap()).unwrap();
    let error = Timeline::new(&scene.operations, &prepared.lattice).unwrap_err().to_string();
    let parts = ["`hook` takes hold of ", " particles of a rigid organ that is moved (organ[1])", "contact.bone"];
    assert!(parts.iter().all(|part| error.contains(part)), "{error}");
}
