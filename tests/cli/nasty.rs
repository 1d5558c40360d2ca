//! Scenes at the edge of what can be said: whatever the exit code, no file holds a number that is none.

use yawara::store::{RunReader, Status};

use crate::support::{Answer, CUBE, Folder};

/// The cube of 1000 particles as tissue.
fn tissue() -> String {
    let tissue = CUBE
        .replace("model = \"paper\"", "model = \"tissue\"")
        .replace("stiffness = 7.5\ndamping = 1e-3\nmass = 2.3e-4", "youngs_modulus = 5e3\ndensity = 1060")
        .replace("steps = 40\ndt = 5e-4", "duration = 0.02");
    assert!(tissue.contains("youngs_modulus") && tissue.contains("duration"), "CUBE has changed");
    tissue
}

/// The cube with one text instead of another, which must be there.
fn with(scene: &str, changes: &[(&str, &str)]) -> String {
    changes.iter().fold(scene.to_owned(), |scene, (from, to)| {
        assert!(scene.contains(from), "no {from} in {scene}");
        scene.replace(from, to)
    })
}

fn grab(path: &str, to: &str) -> String {
    format!(
        "{}\n[[pull]]\nname = \"grab\"\nregion = {{ half_space = {{ point = [0, 0, 20], normal = [0, 0, 1] }} }}\n\
         path = [[0, 0, 0], {path}]\nfrom = 0.0\nto = {to}\n",
        tissue()
    )
}

/// Every number of a run that can be infinite is not, and its frames and series belong together.
#[track_caller]
fn expect_finite(folder: &Folder, name: &str) -> Status {
    let run = RunReader::open(&folder.path("run")).unwrap_or_else(|error| panic!("{name}: {error}"));
    let finite = |what: &str, values: &[f64]| {
        let bad = values.iter().position(|value| !value.is_finite());
        assert!(bad.is_none(), "{name}: {what} {} at {}", values[bad.unwrap_or(0)], bad.unwrap_or(0));
    };
    finite("times", run.times());
    finite("pitch", &[run.lattice().pitch, run.manifest().dt_s, run.manifest().pitch_m]);
    for frame in 0..run.frames() {
        let moved = run.displacements_mm(frame).unwrap_or_else(|error| panic!("{name}: {error}"));
        finite(&format!("frame {frame}"), &moved.iter().flatten().map(|&u| f64::from(u)).collect::<Vec<_>>());
        let severed = run.severed(frame).unwrap_or_else(|error| panic!("{name}: {error}"));
        finite("severed", &severed.iter().flat_map(|s| [f64::from(s.at), s.time]).collect::<Vec<_>>());
    }
    let series = run.series_names();
    assert_eq!(series.is_empty(), run.frames() == 0, "{name}");
    for of in series {
        let values = run.series(&of).unwrap_or_else(|error| panic!("{name}: {error}")).values;
        assert_eq!(values.len(), run.frames(), "{name}: {of}");
        finite(&of, &values);
    }
    let hu = run.extra_f32("hu").unwrap_or_else(|error| panic!("{name}: {error}")).values;
    finite("hu", &hu.into_iter().map(f64::from).collect::<Vec<_>>());
    let words = |text: &str| {
        let mut words = text.split(|c: char| !c.is_ascii_alphanumeric());
        assert!(!words.any(|word| word == "NaN"), "{name}: {text}");
    };
    words(&run.log().unwrap_or_else(|error| panic!("{name}: {error}")));
    words(&folder.yawara(&["info", "run", "--json"]).done().stdout);
    run.manifest().status.clone()
}

/// Runs a scene into `run`; checks what it left, if anything.
#[track_caller]
fn run(name: &str, scene: &str) -> (Folder, Answer) {
    let folder = Folder::new();
    folder.write("nasty.toml", scene);
    let answer = folder.yawara(&["run", "nasty.toml", "-o", "run"]);
    assert!(!answer.stderr.contains("panicked") && !answer.stderr.contains("NaN"), "{name}: {}", answer.stderr);
    match answer.code {
        0 => assert_eq!(expect_finite(&folder, name), Status::Complete, "{name}"),
        1 => {
            let status = expect_finite(&folder, name);
            assert!(matches!(status, Status::Stopped { .. }), "{name}: {status:?}");
        }
        2 => assert!(!folder.path("run").exists(), "{name}: a refused scene left a run"),
        code => panic!("{name}: exit code {code}: {}", answer.stderr),
    }
    (folder, answer)
}

#[test]
fn forces_and_grabs_beyond_measure_stop_the_run_and_keep_its_frames() {
    let force = |force: &str| with(CUBE, &[("force = [0, 1.5, 0]", &format!("force = {force}"))]);
    let gravity = |g: &str| format!("{CUBE}\n[gravity]\nacceleration = [0, 0, {g}]\n");
    for (name, scene) in [
        ("force 1e9", force("[0, 1e9, 0]")),
        ("force 1e30", force("[0, 1e30, 0]")),
        ("force 1e300", force("[0, 0, 1e300]")),
        ("force max", force("[1.7e308, 1.7e308, -1.7e308]")),
        ("gravity 1e8", gravity("-1e8")),
        ("gravity 1e30", gravity("-1e30")),
        ("gravity 1e300", gravity("1e300")),
        ("grab at once", grab("[0, 0, 100]", "1e-9")),
        ("grab 1e6 mm", grab("[0, 0, 1e6]", "0.02")),
        ("grab 1e30 mm", grab("[1e30, 0, 1e30]", "0.02")),
        ("grab 1e44 mm", grab("[0, 0, 1e44]", "0.02")),
    ] {
        let (folder, answer) = run(name, &scene);
        let answer =
            answer.expect(1).says(&["error: organ `cube`: the state diverged at t = ", " mm: ", "lower the force"]);
        // The last good frame is named, and can be had with the command that is named.
        let last = RunReader::open(&folder.path("run")).expect("a run").frames() - 1;
        let command = format!("mesh run --frame {last} -o last.stl");
        answer.says(&[&format!("the last good one is frame {last}, t = 0.0"), &format!("`yawara {command}` shows it")]);
        folder.yawara(&command.split(' ').collect::<Vec<_>>()).done().says(&["warning: run: the run stopped early"]);
        folder.yawara(&["check", "last.stl"]).done();
    }
}

#[test]
fn constants_that_f32_cannot_hold_are_refused_by_name() {
    let paper = |from: &str, to: &str| with(CUBE, &[(from, to)]);
    let cell = |from: &str, to: &str| with(&tissue(), &[(from, to)]);
    for (name, scene, parts) in [
        ("mass 1e60", paper("mass = 2.3e-4", "mass = 1e60"), ["organ `cube`", "mass of a particle", "inf"].as_slice()),
        ("mass 1e-60", paper("mass = 2.3e-4", "mass = 1e-60"), &["organ `cube`", "mass of a particle", "0e0"]),
        ("mass 1e-30", paper("mass = 2.3e-4", "mass = 1e-30"), &["time.dt = 5e-4 s is not stable", "at most"]),
        ("stiffness 1e60", paper("stiffness = 7.5", "stiffness = 1e60"), &["stiffness of a spring", "inf"]),
        ("stiffness 1e38", paper("stiffness = 7.5", "stiffness = 1e38"), &["is not stable", "at most"]),
        ("stiffness 1e-300", paper("stiffness = 7.5", "stiffness = 1e-300"), &["stiffness of a spring", "0e0"]),
        ("damping 1e60", paper("damping = 1e-3", "damping = 1e60"), &["damping of a spring", "inf"]),
        ("damping 1e30", paper("damping = 1e-3", "damping = 1e30"), &["is not stable", "at most"]),
        ("pitch 1e-3", paper("[lattice]", "[lattice]\npitch = 1e-3"), &["lattice.pitch", "0.01 to 100 mm"]),
        ("pitch 1e9", paper("[lattice]", "[lattice]\npitch = 1e9"), &["lattice.pitch", "0.01 to 100 mm"]),
        ("modulus 1e300", cell("5e3", "1e300"), &["Young's modulus of a cell", "inf"]),
        ("modulus 1e30", cell("5e3", "1e30"), &["time.duration = 2e-2 s", "steps", "shorten"]),
        ("density 1e300", cell("1060", "1e300"), &["mass of a particle", "inf"]),
        ("density 1e-40", cell("1060", "1e-40"), &["mass of a particle", "0e0"]),
        ("a long run", cell("duration = 0.02", "duration = 1e300"), &["steps", "1e12"]),
    ] {
        let (_, answer) = run(name, &scene);
        answer.refused(parts);
    }
}

#[test]
fn extreme_scenes_that_can_be_run_stay_finite() {
    let early = ("from = 0.005", "from = 0.0");
    for (name, scene) in [
        ("dt 1e-300", with(CUBE, &[("dt = 5e-4", "dt = 1e-300")])),
        ("dt 1e-45", with(CUBE, &[("dt = 5e-4", "dt = 1e-45")])),
        ("duration 1e-300", with(&tissue(), &[("duration = 0.02", "duration = 1e-300")])),
        ("mass 1e-30", with(CUBE, &[("mass = 2.3e-4", "mass = 1e-30"), ("dt = 5e-4", "dt = 3e-29"), early])),
        ("stiffness 1e38", with(CUBE, &[("stiffness = 7.5", "stiffness = 1e38"), ("dt = 5e-4", "dt = 3e-22"), early])),
        ("damping 1e30", with(CUBE, &[("damping = 1e-3", "damping = 1e30"), ("dt = 5e-4", "dt = 8e-36"), early])),
        ("mass 1e30", with(CUBE, &[("mass = 2.3e-4", "mass = 1e30")])),
        ("modulus 1e30", with(&tissue(), &[("5e3", "1e30"), ("duration = 0.02", "duration = 1e-15")])),
        ("pitch 20", with(&tissue(), &[("[lattice]", "[lattice]\npitch = 20")])),
        ("free fall", {
            let table =
                "[[fix]]\nname = \"table\"\nregion = { half_space = { point = [0, 0, -24], normal = [0, 0, -1] } }\n";
            format!("{}\n[gravity]\nacceleration = [0, 0, -1e20]\n", with(CUBE, &[(table, "")]))
        }),
    ] {
        let (folder, answer) = run(name, &scene);
        answer.expect(0);
        let info = folder.yawara(&["info", "nasty.toml", "--json"]).done();
        assert!(info.json()["estimated_time_s"].as_f64().is_some_and(f64::is_finite), "{name}: {}", info.stdout);
        let text = folder.yawara(&["info", "nasty.toml"]).done().stdout;
        assert!(!text.contains("NaN") && !text.contains("inf"), "{name}: {text}");
    }
}

#[test]
fn inverted_cells_are_reported_where_they_are() {
    let (folder, answer) = run("force 60", &with(CUBE, &[("force = [0, 1.5, 0]", "force = [0, 60, 0]")]));
    let answer =
        answer.expect(0).says(&["warning: ", "cells inside out in frame", "in the last; the first in `cube` at ("]);
    assert!(answer.stderr.contains("refine lattice.pitch"), "{}", answer.stderr);
    let reader = RunReader::open(&folder.path("run")).expect("a run");
    let inverted = reader.series("inverted_cells").expect("a series").values;
    let most = inverted.iter().copied().fold(0.0, f64::max);
    assert!(most > 0.0 && inverted[0] == 0.0);
    let log = reader.log().expect("a log");
    assert!(log.contains("is the first with cells inside out"), "{log}");
    assert!(log.contains(&format!("{most} cells inside out in frame")), "{log}");
    // The place lies in the cube, half a cell (3 mm) from particles that lie 3 mm off the origin.
    let place = log.split("at (").nth(1).and_then(|rest| rest.split(')').next()).expect("a place");
    for coordinate in place.split(", ") {
        let value: f64 = coordinate.parse().expect("a coordinate");
        assert!(value.abs() <= 24.0 && value % 6.0 == 0.0, "{place}");
    }
    let volume = folder.yawara(&["volume", "run", "-o", "v.png", "--json"]).done().json();
    let shown: Vec<f64> = volume["organs"][0]["inverted_cells"]
        .as_array()
        .expect("a list")
        .iter()
        .filter_map(serde_json::Value::as_f64)
        .collect();
    assert_eq!(shown, inverted);
    // One organ: its cells are those of the whole run.
    let [now, rest] =
        ["volume_by_cells", "rest_volume_by_cells"].map(|name| reader.series(name).expect("a series").values);
    let percent = &volume["organs"][0]["by_cells"]["percent"];
    for frame in 0..reader.frames() {
        let expected = 100.0 * (now[frame] / rest[frame] - 1.0);
        let found = percent[frame].as_f64().expect("a number");
        // Displacements are kept in f32 mm.
        assert!((found - expected).abs() < 1e-4, "frame {frame}: {found} {expected}");
    }
}
