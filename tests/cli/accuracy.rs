//! Scenes that ask for an accuracy, from the command line.

use super::support::*;

const PRESSED: &str = r#"
accuracy = 0.02
[volume]
phantom = "cube"
spacing = 10
[[organ]]
name = "block"
label = "cube"
youngs_modulus = 5e3
density = 1060
viscosity = 20
[time]
duration = 0.1
frames = 5
[[fix]]
region = { half_space = { point = [0, 0, -29.9], normal = [0, 0, -1] } }
[[push]]
region = { half_space = { point = [0, 0, 29.9], normal = [0, 0, 1] } }
path = [[0, 0, 0], [0, 0, -6]]
to = 0.1
"#;

#[test]
fn a_bound_that_can_be_kept_is_kept_and_told() {
    let folder = Folder::new();
    folder.write("cube.toml", PRESSED);
    folder.yawara(&["info", "cube.toml"]).done().prints(&["accuracy", "2.0 % asked"]);
    let run = folder.yawara(&["run", "cube.toml", "-o", "out"]).done();
    run.says(&["tried pitch", "chosen: pitch", "estimated error", "2.0 % kept"]);
    let read = |name: &str| String::from_utf8(folder.read(name)).unwrap();
    let log = read("out/log.txt");
    assert!(["tried pitch", "chosen: pitch", "2.0 % kept"].iter().all(|part| log.contains(part)), "{log}");
    // The run is that of the last choice, and as good as any.
    let scene: serde_json::Value = serde_json::from_str(&read("out/scene.json")).unwrap();
    assert_eq!(scene["accuracy"], 0.02);
    let pitch = scene["lattice"]["pitch_m"].as_f64().map_or(10.0, |pitch| pitch * 1e3);
    assert!(log.lines().any(|line| line.contains(&format!("chosen: pitch {pitch:.3} mm"))), "{log}");
    folder.yawara(&["mesh", "out", "-o", "cube.stl"]).done();
    folder.yawara(&["check", "out"]).done();
    // The same choices and the same bits once more.
    folder.yawara(&["run", "cube.toml", "-o", "again", "--threads", "1"]).done();
    assert_eq!(read("out/scene.json"), read("again/scene.json"));
    let displacements = |run: &str| folder.tree(&format!("{run}/arrays.zarr/frames/displacement"));
    assert_eq!(displacements("out"), displacements("again"));
}

#[test]
fn a_bound_out_of_reach_is_said_to_be() {
    let folder = Folder::new();
    folder.write("cube.toml", PRESSED.replace("accuracy = 0.02", "accuracy = 1e-5"));
    let run = folder.yawara(&["run", "cube.toml", "-o", "out"]);
    run.expect(1).says(&["NOT kept", "the accuracy asked for was not reached", "name that lattice.pitch"]);
    // What there is can be used.
    folder.yawara(&["mesh", "out", "-o", "cube.stl"]).done();
}

#[test]
fn a_pitch_that_is_named_is_left_alone() {
    let folder = Folder::new();
    let named = PRESSED.replace("[[organ]]", "[lattice]\npitch = 10\n[[organ]]").replace("0.02", "1e-4");
    folder.write("cube.toml", named);
    let run = folder.yawara(&["run", "cube.toml", "-o", "out"]).done();
    run.says(&["the pitch of 10.000 mm is the scene's", "the pitch not counted", "0.010 % kept"]);
}

/// A particle at (10, 10, 30) mm is there at pitches of 20 and 10 mm, not at those between.
#[test]
fn a_pitch_at_which_a_region_is_empty_is_passed_over() {
    let folder = Folder::new();
    let spot = "[[push]]\nname = \"spot\"\nregion = { box = { min = [9, 9, 29], max = [11, 11, 31] } }\nforce = [0, 0, 1e-3]\n";
    folder.write("cube.toml", format!("{PRESSED}{spot}"));
    let run = folder.yawara(&["run", "cube.toml", "-o", "out"]).done();
    run.says(&[
        "tried pitch 20.000 mm",
        "pitch 15.000 mm, symplectic_euler will not do: `spot`",
        "chosen: pitch 10.000 mm",
        "kept",
    ]);
}
