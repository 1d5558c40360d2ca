//! What the program says about itself, and how it behaves in a pipe.

use crate::support::{Folder, fixture};

const COMMANDS: [&[&str]; 24] = [
    &[],
    &["demo"],
    &["run"],
    &["mesh"],
    &["slice"],
    &["render"],
    &["volume"],
    &["phantom"],
    &["info"],
    &["check"],
    &["scene"],
    &["verify"],
    &["study"],
    &["bench"],
    &["bench", "lattice"],
    &["bench", "scene"],
    &["bench", "surface"],
    &["bench", "carry"],
    &["bench", "cut"],
    &["bench", "write"],
    &["bench", "render"],
    &["bench", "care"],
    &["completions"],
    &["man"],
];

#[test]
fn every_command_helps_with_an_example_and_its_defaults() {
    let folder = Folder::new();
    for command in COMMANDS {
        let answer = folder.yawara(&[command, &["--help"]].concat()).done();
        let example = format!("\n  {}", ["yawara"].iter().chain(command).copied().collect::<Vec<_>>().join(" "));
        let answer = answer.prints(&["Usage:", "Example", &example]);
        assert_eq!(answer.stderr, "");
    }
    folder.yawara(&["phantom", "--help"]).done().prints(&["[mm]", "default: 3", "default: outputs/phantom"]);
    folder.yawara(&["slice", "--help"]).done().prints(&["[mm]", "[HU]", "default: 400", "about 800"]);
    folder.yawara(&["mesh", "--help"]).done().prints(&["patient mm (RAS+)", "default: last", "default: 1"]);
    folder.yawara(&["--help"]).done().prints(&["Exit codes: 0", "--threads", "--quiet"]);
    assert!(folder.everything().is_empty());
}

/// Every subcommand of the help is in `COMMANDS`.
#[test]
fn no_command_is_left_out() {
    let help = Folder::new().yawara(&["--help"]).done().stdout;
    let listed: Vec<&str> = help
        .lines()
        .skip_while(|line| *line != "Commands:")
        .skip(1)
        .take_while(|line| !line.is_empty())
        .filter(|line| line.starts_with("  ") && !line.starts_with("   "))
        .filter_map(|line| line.split_whitespace().next())
        .filter(|name| *name != "help")
        .collect();
    assert!(listed.len() >= 12, "{listed:?}");
    for name in listed {
        assert!(COMMANDS.iter().any(|command| command.first() == Some(&name)), "{name}");
    }
}

#[test]
fn version_completions_and_manual() {
    let folder = Folder::new();
    let version = folder.yawara(&["--version"]).done().stdout;
    assert_eq!(version, format!("yawara {}\n", env!("CARGO_PKG_VERSION")));
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        folder.yawara(&["completions", shell]).done().prints(&["yawara", "phantom", "overwrite"]);
    }
    folder.yawara(&["man"]).done().prints(&[".TH yawara 1", "phantom", "Exit codes"]);
    folder.yawara(&["man", "mesh"]).done().prints(&["yawara", "\\-\\-organ", "patient mm"]);
    folder.yawara(&["man", "meshes"]).refused(&["`meshes`", "mesh, slice"]);
}

#[test]
fn wrong_usage_is_refused() {
    let folder = Folder::new();
    folder.yawara(&[]).refused(&["Usage"]);
    folder.yawara(&["fly"]).refused(&["fly", "--help"]);
    folder.yawara(&["run"]).refused(&["<SCENE>"]);
    folder.yawara(&["info", "x", "--jsn"]).refused(&["--jsn"]);
    folder.yawara(&["scene"]).refused(&["<SCENE>"]);
    for threads in ["0", "-1", "many", "1000000"] {
        folder.yawara(&[&format!("--threads={threads}"), "bench", "lattice"]).refused(&[threads, "--threads"]);
    }
    folder.yawara(&["--threads", "0", "man"]).refused(&["0 is not in 1..=1024"]);
    folder.yawara(&["mesh", "run", "-o", "a.stl", "--smooth", "21"]).refused(&["21", "from 0 to 5"]);
    for n in ["0", "1", "801"] {
        folder.yawara(&["bench", "lattice", "--n", n]).refused(&[n, "from 2 to 800"]);
    }
    folder.yawara(&["bench", "lattice", "--n", "8", "--steps", "0"]).refused(&["--steps 0", "at least one"]);
    folder.yawara(&["bench", "render", "--triangles", "10"]).refused(&["--triangles is 10", "1000 to"]);
    folder.yawara(&["bench", "surface", "--n", "1"]).refused(&["--n is 1", "2 to 1024"]);
    assert!(folder.everything().is_empty());
}

#[test]
fn the_schema_is_json_with_units() {
    let schema = Folder::new().yawara(&["scene", "--schema"]).done();
    assert!(schema.json()["properties"]["organ"].is_object());
    schema.prints(&["youngs_modulus", "Pa", "kg", "mm"]);
}

#[test]
fn benches_print_one_object() {
    let folder = Folder::new();
    let lattice = folder.yawara(&["bench", "lattice", "--n", "12", "--steps", "3", "--json"]).done().json();
    assert_eq!((lattice["n"].as_u64(), lattice["steps"].as_u64()), (Some(12), Some(3)));
    assert!(lattice["particle_steps_per_s"].as_f64() > Some(0.0) && lattice["mean_moved"].as_f64() > Some(0.0));
    let scene = &fixture("scenes/fig3-cube.toml");
    let times = folder.yawara(&["bench", "scene", scene, "--pitch", "4", "--runs", "1", "--json"]).done().json();
    let row = &times["pitches"][0];
    assert!(row["pitch_mm"].as_f64() == Some(4.0) && row["steps"].as_u64() > Some(10), "{row}");
    let parts = ["step_s", "operations_s", "control_s"].map(|part| row[part].as_f64().unwrap());
    let slower = parts.iter().sum::<f64>() / row["simulated_s"].as_f64().unwrap();
    assert!(parts[0] > 0.0 && (row["slower_than_life"].as_f64().unwrap() / slower - 1.0).abs() < 1e-9, "{row}");
    folder.yawara(&["bench", "scene", scene, "--pitch", "0"]).refused(&["--pitch [0.0]", "above 0 mm"]);
    let surface = folder.yawara(&["bench", "surface", "--n", "40", "--json"]).done().json();
    assert!(surface["triangles"].as_u64() > Some(1000));
    let cut = folder.yawara(&["bench", "cut", "--n", "24", "--json"]).done().json();
    assert!(cut["vertices_on_cut"].as_u64() > Some(20) && cut["after_s"].as_f64() > Some(0.0), "{cut}");
    folder.yawara(&["bench", "cut", "--n", "12"]).done().prints(&["after a further cut", "at once"]);
    folder.yawara(&["bench", "cut", "--n", "1"]).refused(&["--n is 1", "8 to 1024"]);
    let render = ["bench", "render", "--triangles", "4000", "--size", "64x48"];
    let drawn = folder.yawara(&[&render[..], &["--json"]].concat()).done().json();
    assert_eq!((drawn["width"].as_u64(), drawn["height"].as_u64()), (Some(64), Some(48)));
    assert!(drawn["triangles"].as_u64() > Some(3500) && drawn["seconds"].as_f64() > Some(0.0));
    folder.yawara(&render).done().prints(&["triangles on 64 x 48 pixels"]);
    let care = folder.yawara(&["bench", "care", "--n", "40", "--percent", "20", "--json"]).done().json();
    assert!(care["passed"] == true && care["triangles_left"].as_u64() <= care["triangles"].as_u64().map(|t| t / 5));
    folder.write("five.raw", [0_u8; 500]);
    folder.yawara(&["bench", "surface", "--n", "5", "--raw", "five.raw"]).done().prints(&["0 triangles"]);
    let short = folder.yawara(&["bench", "surface", "--n", "6", "--raw", "five.raw"]);
    short.refused(&["five.raw", "500 bytes", "864", "--n"]);
    let everything = ["bench", "lattice", "--n", "12", "--steps", "3", "--law", "everything", "--exact"];
    folder.yawara(&everything).done().prints(&["1728 particles, law everything, 3 steps", "exact", "GB/s"]);
    folder.yawara(&["bench", "lattice", "--n", "1"]).refused(&["--n is 1", "2 to 800"]);
    let effects =
        folder.yawara(&["bench", "effects", "--n", "6", "--rounds", "1", "-o", "prices", "--json"]).done().json();
    let rows = effects["effects"].as_array().unwrap();
    assert!(rows.len() > 15 && rows.iter().all(|row| row["step_ms"].as_f64() > Some(0.0)), "{effects}");
    // What a scene does not name is not kept: each effect alone needs less than all of them.
    let bytes = |name: &str| {
        rows.iter().find(|row| row["effect"] == name).and_then(|row| row["bytes_per_particle"].as_f64()).unwrap()
    };
    let bare = bytes("springs (bare)");
    assert!(["gravity", "drag", "pressure", "nothing (noise)"].iter().all(|name| bytes(name) == bare), "{effects}");
    assert!(["dampers", "volume term", "fibres", "tool"].iter().all(|name| bytes(name) > bare), "{effects}");
    assert!(folder.read("prices/effects.csv").starts_with(b"effect,step_ms,"));
    assert!(!folder.read("prices/effects.png").is_empty());
    // Another program that does the same work: this one.
    let same = folder
        .shell("$Y bench lattice --n 12 --steps 3 --pairs 2 --against \"$Y bench lattice --n 12 --steps 3 --json\"");
    same.done().prints(&["times as fast as yawara", "2 pairs"]);
    let other =
        folder.shell("$Y bench lattice --n 12 --steps 3 --against \"$Y bench lattice --n 12 --steps 9 --json\"");
    other.refused(&["did other work", "same n and steps"]);
    folder.yawara(&["bench", "surface", "--n", "40"]).done().prints(&["40^3 values", "triangles"]);
}

#[cfg(unix)]
#[test]
fn pipes_may_break_and_fill_up() {
    let folder = Folder::with_run();
    // The status of a pipeline is that of `head`: the program's own goes to a file.
    for call in ["man", "check run", "info run", "scene cube.toml", "--help", "completions bash"] {
        let answer = folder.shell(&format!("{{ $Y {call}; echo $? >code; }} | head -n 1")).done();
        assert_eq!(answer.stderr, "", "{call}");
        assert_eq!(folder.read("code"), b"0\n", "{call}");
        // Closed before the first byte.
        let answer = folder.shell(&format!("{{ sleep 0.05; $Y {call}; echo $? >code; }} | true; sleep 0.2")).done();
        assert_eq!(answer.stderr, "", "{call}");
    }
    if std::path::Path::new("/dev/full").exists() {
        folder.shell("$Y info run >/dev/full").refused(&["standard output", "No space left"]);
    }
}
