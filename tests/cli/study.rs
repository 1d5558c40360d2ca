//! `yawara study`: errors and times of a small scene, gone on with after an interruption.

use crate::support::Folder;

/// A block, held below and pulled above: 343 particles at its own pitch.
const BLOCK: &str = r#"
[volume]
phantom = "cube"
spacing = 10.0

[[organ]]
name = "cube"
label = "cube"
youngs_modulus = 5e3
density = 1060
damping_ratio = 0.2

[time]
duration = 0.06
frames = 4

[[fix]]
region = { half_space = { point = [0, 0, -24], normal = [0, 0, -1] } }

[[pull]]
region = { half_space = { point = [0, 0, 24], normal = [0, 0, 1] } }
force = [1.0, 0, 0.5]
ramp = 0.02
"#;

/// Two pitches, two steps and a reference of each, exact arithmetic and f64.
const STUDY: [&str; 14] = [
    "study",
    "block.toml",
    "-o",
    "s",
    "--steps",
    "1,2",
    "--pitches",
    "20,10",
    "--repeats",
    "1",
    "--budget",
    "3",
    "--integrators",
    "symplectic_euler",
];

#[test]
fn a_study_says_what_accuracy_costs_and_goes_on_where_it_was() {
    let folder = Folder::new();
    folder.write("block.toml", BLOCK);
    let answer = folder.yawara(&STUDY).done().says(&["runs planned"]);
    for file in
        ["report.md", "report.html", "results.csv", "results.json", "error-time.png", "orders.png", "surfaces.png"]
    {
        assert!(answer.stdout.contains(file) && !folder.read(&format!("s/{file}")).is_empty(), "{file}");
    }
    let json = |name: &str| serde_json::from_slice::<serde_json::Value>(&folder.read(name)).unwrap();
    let results = json("s/results.json");
    let rows = results["findings"]["rows"].as_array().unwrap();
    // Steps 1, 2 and 4 of 20 mm, 1 and 2 and 4 of 10 mm, 1 exact, 1 in f64.
    assert_eq!(rows.len(), 8, "{rows:#?}");
    let error = |fineness: f64| {
        let row = rows.iter().find(|row| {
            let choice = &row["choice"];
            choice["pitch_mm"] == 10.0 && choice["fineness"] == fineness && choice["arithmetic"] == "fast"
        });
        row.unwrap()["time_error"]["rms_mm"].as_f64().unwrap()
    };
    // Symplectic Euler is of first order.
    let order = (error(1.0) / error(2.0)).log2();
    assert!((order - 1.0).abs() < 0.15, "{order}");
    assert!(rows.iter().all(|row| row["same_bits"] == true));
    assert!(rows.iter().all(|row| row["surface"].is_null() || row["surface"]["mean_mm"].as_f64() > Some(0.0)));
    // Half the spacing, and the surface is nearer to the finest.
    let surfaces: Vec<f64> = results["surfaces"].as_array().unwrap()[1..]
        .iter()
        .filter_map(|line| line["distance"]["mean_mm"].as_f64())
        .collect();
    assert!(surfaces.len() == 3 && surfaces.is_sorted_by(|a, b| a > b), "{surfaces:?}");
    let rounding = results["rounding"]["max_mm"].as_f64().unwrap();
    assert!(rounding > 0.0 && rounding < 1e-3, "{rounding}");
    let report = String::from_utf8(folder.read("s/report.md")).unwrap();
    for part in ["yawara study block.toml -o s", "largest stable step", "Observed orders", "cheapest choice", "0.01 %"]
    {
        assert!(report.contains(part), "{report}");
    }

    // Once more: nothing is run, and everything is the same.
    let first = folder.tree("s");
    folder.yawara(&STUDY).done().says(&["going on with the study: 8 of 8 runs are there"]);
    assert_eq!(folder.tree("s"), first);

    // Interrupted while the last lines were written: only what is missing is run, and comes to the same errors.
    let lines = String::from_utf8(folder.read("s/results.jsonl")).unwrap();
    let last_runs = lines.match_indices("{\"run\":{").map(|(at, _)| at).nth(5).unwrap();
    folder.write("s/results.jsonl", &lines[..last_runs + 30]);
    folder.yawara(&STUDY).done().says(&["5 of 8 runs are there"]);
    let again = json("s/results.json");
    for (before, after) in rows.iter().zip(again["findings"]["rows"].as_array().unwrap()) {
        for key in ["choice", "time_error", "space_error", "error", "energy_error", "surface", "steps"] {
            assert_eq!(before[key], after[key], "{key}");
        }
    }

    // Another scene is another study.
    folder.write("block.toml", BLOCK.replace("1060", "1000"));
    let before = folder.tree("s");
    folder.yawara(&STUDY).refused(&["the scene or a volume of it has changed", "--overwrite", "another folder"]);
    assert_eq!(folder.tree("s"), before);
    let mut anew = STUDY.to_vec();
    (anew[5], anew[7]) = ("1", "20");
    anew.push("--overwrite");
    anew.extend(["--arithmetic", "fast"]);
    folder.yawara(&anew).done().says(&["2 runs planned"]);
    let runs = std::fs::read_dir(folder.path("s/runs")).unwrap().count();
    assert_eq!(runs, 2, "runs of the old study are gone");
}

#[test]
fn every_integrator_is_judged_and_f64_too() {
    let folder = Folder::new();
    // A force that is there from the start: nothing jumps, so that errors go with the powers of theory.
    folder.write("block.toml", BLOCK.replace("ramp = 0.02", ""));
    let call = ["study", "block.toml", "-o", "s", "--pitches", "10", "--repeats", "1", "--budget", "2"];
    folder.yawara(&call).done();
    let results = serde_json::from_slice::<serde_json::Value>(&folder.read("s/results.json")).unwrap();
    let findings = &results["findings"];
    assert_eq!(findings["judge"], "rk4");
    let rows = findings["rows"].as_array().unwrap();
    let of = |name: &str, arithmetic: &str| {
        let own = |row: &&serde_json::Value| {
            row["choice"]["integrator"] == name
                && row["choice"]["arithmetic"] == arithmetic
                && row["reference"] == false
        };
        rows.iter().filter(own).collect::<Vec<_>>()
    };
    let error = |row: &serde_json::Value| row["time_error"]["rms_mm"].as_f64().unwrap();
    let largest = findings["largest_mm"].as_f64().unwrap();
    let orders = findings["levels"][0]["time_orders"].as_array().unwrap();
    // Steps of backward Euler are still long against the swing; rk4 and the adaptive method soon come to what f32 can tell.
    for (name, theory, within) in [
        ("symplectic_euler", 1.0, 0.1),
        ("verlet", 2.0, 0.15),
        ("rk4", 4.0, 0.3),
        ("bogacki_shampine", 3.0, 0.8),
        ("backward_euler", 1.0, 0.4),
    ] {
        let own = of(name, "fast");
        assert_eq!(own.len(), 4, "{name}");
        assert!(own.iter().all(|row| row["evaluations"].as_u64() >= row["steps"].as_u64()), "{own:#?}");
        let order = orders.iter().find(|order| order["integrator"] == name).unwrap()["law"]["slope"].as_f64().unwrap();
        assert!((order - theory).abs() < within, "{name}: {order}");
        let errors: Vec<f64> = own.iter().take(2).map(|row| error(row)).collect();
        assert!(errors[0] > 1.5 * errors[1] && errors[1] > 0.0, "{name}: {errors:?}");
    }
    // A step of backward Euler stands for some twenty of the plain one.
    let steps = |name: &str| of(name, "fast")[0]["steps"].as_u64().unwrap();
    assert!((8..=20).contains(&(steps("symplectic_euler") / steps("backward_euler"))));
    assert!(steps("rk4") < steps("symplectic_euler"), "it counts from its own limit");
    // In f64 the same methods come to the same, but for rounding; of the plain one the dampers differ with the step.
    for (name, apart) in [("symplectic_euler", 1e-2), ("verlet", 1e-6), ("rk4", 1e-6)] {
        let own = of(name, "double");
        let from_fast = own[0]["from_usual"]["rms_mm"].as_f64().unwrap() / largest;
        assert!(own.len() == 1 && from_fast > 0.0 && from_fast < apart, "{name}: {from_fast}");
    }
    assert!(of("backward_euler", "exact").is_empty() && of("backward_euler", "double").is_empty(), "it is always f64");
    let report = String::from_utf8(folder.read("s/report.md")).unwrap();
    assert!(report.contains("the cheapest integrator at 10 mm for an error (rms) of 10 %: "), "{report}");
    assert!(!folder.read("s/integrators.png").is_empty());

    // Contact is for the plain step alone, and for f32.
    let plane = "\n[[plane]]\npoint = [0, 0, -60]\nnormal = [0, 0, 1]\n";
    folder.write("contact.toml", format!("{BLOCK}{plane}"));
    let refused = |more: [&str; 2]| {
        let call = [&["study", "contact.toml", "-o", "c", "--pitches", "20", "--budget", "0.2"], &more[..]].concat();
        folder.yawara(&call).refused(&[more[0], more[1], "plane"]);
    };
    refused(["--arithmetic", "double"]);
    refused(["--integrators", "verlet"]);
    let call = ["study", "block.toml", "-o", "c", "--integrators", "backward_euler,bogacki_shampine"];
    folder.yawara(&call).refused(&["cannot be judged", "symplectic_euler, verlet, rk4"]);
}

#[test]
fn a_budget_that_is_too_short_is_kept_and_said() {
    let folder = Folder::new();
    folder.write("block.toml", BLOCK.replace("duration = 0.06", "duration = 4"));
    let call = ["study", "block.toml", "-o", "s", "--pitches", "10", "--budget", "0.05"];
    folder.yawara(&call).done().says(&["left out"]);
    // 3 s are asked for. Two runs are made in any case; the others have to fit, as far as one can know before.
    let lines = String::from_utf8(folder.read("s/results.jsonl")).unwrap();
    let lines = lines.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    let seconds: Vec<f64> = lines.filter_map(|line| line["run"]["all_seconds"].as_f64()).collect();
    assert!(seconds.len() >= 2 && seconds[2..].iter().sum::<f64>() < 6.0, "{seconds:?}");
    let report = String::from_utf8(folder.read("s/report.md")).unwrap();
    assert!(report.contains("What is missing") && report.contains("--budget MINUTES"), "{report}");
}

#[test]
fn bad_studies_are_refused() {
    let folder = Folder::new();
    folder.write("block.toml", BLOCK);
    folder.write("taken/notes.txt", "mine");
    let before = folder.everything();
    folder.yawara(&["study", "block.toml", "-o", "taken"]).refused(&["taken", "results.jsonl", "another folder"]);
    folder.yawara(&["study", "block.toml", "-o", "taken", "--overwrite"]).refused(&["taken", "another folder"]);
    folder.yawara(&["study", "block.toml", "-o", "block.toml"]).refused(&["is a file"]);
    folder.yawara(&["study", "block.toml", "-o", "s", "--steps", "1,0"]).refused(&["`0`", "above 0"]);
    folder
        .yawara(&["study", "block.toml", "-o", "s", "--integrators", "magic"])
        .refused(&["magic", "symplectic_euler"]);
    folder.yawara(&["study", "block.toml", "-o", "s", "--arithmetic", "slow"]).refused(&["slow", "fast"]);
    folder.yawara(&["study", "none.toml", "-o", "s"]).refused(&["none.toml"]);
    assert_eq!(folder.everything(), before);
}
