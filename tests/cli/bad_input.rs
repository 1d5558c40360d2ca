//! Inputs that cannot be used: refused with what, where and what next, and nothing left behind.

use crate::support::{CUBE, Folder, fixture};

/// Runs a changed `CUBE`, which must be refused with `parts` and leave nothing.
#[track_caller]
fn refuse_scene(from: &str, to: &str, parts: &[&str]) {
    assert!(CUBE.contains(from), "{from}");
    let folder = Folder::new();
    folder.write("cube.toml", CUBE.replace(from, to));
    let before = folder.everything();
    folder.yawara(&["run", "cube.toml", "-o", "out/run"]).refused(parts);
    assert!(folder.everything() == before, "something was left");
}

#[test]
fn missing_files_are_named() {
    let folder = Folder::new();
    for call in [
        ["run", "no.toml"].as_slice(),
        &["info", "no.nii.gz"],
        &["info", "no"],
        &["check", "no.stl"],
        &["scene", "no.toml"],
        &["mesh", "no", "-o", "a.stl"],
        &["volume", "no", "-o", "a.png"],
        &["render", "no", "-o", "a.png"],
        &["slice", "no", "-o", "a.png", "--axis", "x", "--at", "0"],
    ] {
        folder.yawara(call).refused(&[call[1], "o such file"]);
    }
    let files = "image = \"no.nii.gz\"";
    folder.write(
        "hu.toml",
        CUBE.replace("phantom = \"cube\"\nspacing = 6.0", files).replace("label = \"cube\"", "hu = [0, 100]"),
    );
    let before = folder.everything();
    folder.yawara(&["run", "hu.toml"]).refused(&["no.nii.gz", "could not read"]);
    folder.yawara(&["info", "hu.toml"]).refused(&["no.nii.gz", "could not read"]);
    assert!(folder.everything() == before);
}

#[test]
fn damaged_volumes_are_refused_by_every_command() {
    let folder = Folder::new();
    for (file, parts) in [
        ("gzip_short.nii.gz", ["gzip stream breaks", "copy it again"].as_slice()),
        ("data_short.nii.gz", &["399 bytes", "expected 400"]),
        ("dim_huge.nii.gz", &["32767x32767x32767", "70362301923678"]),
        ("dim_overflow_v2.nii", &["4611686018427387904", "crop or resample"]),
        ("pixdim_nan.nii", &["pixdim[2] = NaN", "fix the header"]),
        ("empty.nii", &["empty.nii"]),
        ("srow_singular.nii", &["srow"]),
    ] {
        let path = fixture(&format!("bad/{file}"));
        let parts = [&[path.as_str()], parts].concat();
        folder.yawara(&["info", &path]).refused(&parts);
        folder.yawara(&["slice", &path, "-o", "a.png", "--axis", "z", "--at", "0"]).refused(&parts);
        folder.write(
            "bad.toml",
            CUBE.replace("phantom = \"cube\"\nspacing = 6.0", &format!("labels = {path:?}"))
                .replace("label = \"cube\"", "label = 1"),
        );
        folder.yawara(&["run", "bad.toml", "-o", "run"]).refused(&parts);
        assert_eq!(folder.everything().keys().collect::<Vec<_>>(), ["bad.toml"], "{file}");
    }
}

#[test]
fn every_bad_scene_is_refused_by_run_info_and_scene() {
    let mut count = 0;
    for entry in std::fs::read_dir(fixture("bad/scenes")).expect("bad scenes") {
        let path = entry.expect("an entry").path();
        if path.extension().is_none_or(|extension| extension != "toml") {
            continue;
        }
        count += 1;
        let folder = Folder::new();
        let (name, path) = (path.file_name().expect("a name").to_string_lossy(), path.to_string_lossy());
        let answer = folder.yawara(&["run", &path]).refused(&[&name]);
        assert_eq!(folder.yawara(&["scene", &path]).refused(&[]).stderr, answer.stderr);
        assert!(folder.everything().is_empty(), "{name}");
    }
    assert!(count > 60, "{count} bad scenes");
}

#[test]
fn scenes_that_make_no_sense() {
    refuse_scene("label = \"cube\"", "label = 7", &["organ `cube`", "label 7", "holds 1"]);
    refuse_scene("label = \"cube\"", "label = \"spleen\"", &["cube.toml", "spleen"]);
    refuse_scene("label = \"cube\"", "hu = [2000, 3000]", &["organ `cube`", "2000 to 3000 HU", "the image holds"]);
    refuse_scene(
        "min = [-31, 1, 15], max = [31, 31, 31]",
        "min = [50, 1, 15], max = [60, 9, 31]",
        &["`hand`", "selects no particle", "mm", "move or enlarge"],
    );
    refuse_scene("dt = 5e-4", "dt = 5e-3", &["time.dt = 5e-3 s", "not stable", "2.572e-3 s", "leave time.dt out"]);
    refuse_scene("stiffness", "stifness", &["cube.toml", "`stifness`", "did you mean `stiffness`"]);
    refuse_scene("mass = 2.3e-4", "mass = -1", &["cube.toml", "mass", "-1"]);
    refuse_scene("spacing = 6.0", "spacing = 0.01", &["volume.spacing", "0.01", "0.5 to 10 mm"]);
    refuse_scene("stiffness = 7.5\ndamping = 1e-3\nmass = 2.3e-4", "rigid = true", &["every organ is rigid"]);
}

#[test]
fn triangles_that_cannot_go_are_a_warning() {
    let folder = Folder::with_run();
    let answer = folder.yawara(&["mesh", "run", "-o", "few.ply", "--triangles", "4"]);
    answer.done().says(&["warning: organ `cube` has", "triangles, not the 4 asked for"]);
}

#[test]
fn a_blade_that_misses_is_a_warning() {
    let folder = Folder::new();
    folder.write("cube.toml", CUBE.replace("path = [[0, 0, 40], [0, 0, 0]]", "path = [[0, 0, 90], [0, 0, 50]]"));
    let answer = folder.yawara(&["run", "cube.toml", "-o", "run", "-q"]).done();
    answer.says(&["warning: cut `half` severed no spring", "check its blade and path"]);
}

#[test]
fn a_state_that_diverges_ends_with_code_1_and_keeps_its_frames() {
    let folder = Folder::new();
    folder.write("cube.toml", CUBE.replace("force = [0, 1.5, 0]", "force = [0, 1e9, 0]"));
    let answer = folder.yawara(&["run", "cube.toml", "-o", "run"]).expect(1);
    assert_eq!(answer.stdout, "");
    answer.says(&["error: organ `cube`: the state diverged at t = 0.00", "mm", "the frames before are in run"]);
    let info = folder.yawara(&["info", "run", "--json"]).done().says(&["warning"]).json();
    assert_eq!(info["manifest"]["status"]["state"], "stopped");
    assert!(info["manifest"]["frames"].as_u64() >= Some(1));
    folder.yawara(&["mesh", "run", "-o", "a.stl", "--frame", "0"]).done().says(&["warning"]);
    folder.yawara(&["check", "a.stl"]).done();
}

#[test]
fn one_kind_given_for_another_says_what_it_is() {
    let folder = Folder::with_run();
    folder.yawara(&["phantom", "-o", "ph", "--kind", "cube", "--spacing", "6"]).done();
    folder.yawara(&["mesh", "run", "-o", "a.stl"]).done();
    folder.write("notes.txt", "hello");
    let before = folder.everything();
    let slice = |source: &str| folder.yawara(&["slice", source, "-o", "x.png", "--axis", "x", "--at", "0"]);
    let mesh = |source: &str| folder.yawara(&["mesh", source, "-o", "x.stl"]);
    folder.yawara(&["run", "ph/ct.nii.gz"]).refused(&["ph/ct.nii.gz", "TOML"]);
    folder.yawara(&["run", "run"]).refused(&["run: expected a scene (TOML)", "folder"]);
    folder.yawara(&["run", "a.stl"]).refused(&["a.stl: expected a scene (TOML), but this is a mesh"]);
    slice("cube.toml").refused(&["cube.toml: expected a volume", "a scene", "yawara run cube.toml"]);
    slice("a.stl").refused(&["a.stl: expected a volume", "a mesh"]);
    slice("ph").refused(&["ph: not a yawara run", "manifest.json"]);
    slice("notes.txt").refused(&["notes.txt: not a NIfTI file"]);
    mesh("cube.toml").refused(&["cube.toml: expected a run directory", "yawara run cube.toml"]);
    mesh("ph/ct.nii.gz").refused(&["ct.nii.gz: expected a run directory"]);
    mesh("ph").refused(&["ph: not a yawara run"]);
    folder.yawara(&["volume", "a.stl", "-o", "x.png"]).refused(&["a.stl: expected a run directory"]);
    folder.yawara(&["check", "cube.toml"]).refused(&["cube.toml: expected a mesh", "a scene"]);
    folder.yawara(&["check", "ph/ct.nii.gz"]).refused(&["ct.nii.gz: expected a mesh"]);
    folder.yawara(&["info", "notes.txt"]).refused(&["notes.txt: not a NIfTI file", "hello"]);
    folder.yawara(&["info", "ph"]).refused(&["ph: not a yawara run"]);
    let labels = ["slice", "run", "-o", "x.png", "--axis", "x", "--at", "0", "--labels", "ph/labels.nii.gz"];
    folder.yawara(&labels).refused(&["--labels", "a run brings its own"]);
    assert!(folder.everything() == before, "something was left");
}

#[test]
fn requests_a_run_cannot_answer() {
    let folder = Folder::with_run();
    folder.yawara(&["phantom", "-o", "ph", "--kind", "cube", "--spacing", "6"]).done();
    let before = folder.everything();
    let mesh = |output: &str, more: &[&str]| folder.yawara(&[&["mesh", "run", "-o", output], more].concat());
    mesh("a.stl", &["--frame", "5"]).refused(&["no frame 5", "0 to 4"]);
    mesh("a.stl", &["--frame", "-1"]).refused(&["`-1` is not a frame", "`last` or `all`"]);
    mesh("a.stl", &["--frame", "first"]).refused(&["`first` is not a frame"]);
    mesh("a.stl", &["--frame", "all"]).refused(&["5 frames", "a_{frame}.stl"]);
    mesh("a.stl", &["--organ", "spleen"]).refused(&["`spleen`", "cube"]);
    mesh("a.off", &[]).refused(&["a.off", ".stl, .ply, .glb, .gltf, .obj or .vtp", ".vtu"]);
    mesh("a", &[]).refused(&["a: the extension is missing"]);
    mesh("a_{time}.stl", &["--frame", "all"]).refused(&["{time}", "{frame}"]);
    mesh("a.ply", &["--ascii"]).refused(&["PLY is written in one way", "only STL"]);
    mesh("a.stl", &["--quantize"]).refused(&["a.stl: --quantize is for .glb and .gltf"]);
    mesh("a.stl", &["--crisp"]).refused(&["a.stl: STL has no normals", "--crisp"]);
    mesh("a.stl", &["--color", "displacement"]).refused(&["a.stl: STL holds no colours", "--color"]);
    mesh("a.stl", &["--attributes", "strain"]).refused(&["a.stl: STL holds no colours", "--attributes"]);
    mesh("a.ply", &["--triangles", "3"]).refused(&["'3'", "--triangles", "from 4"]);
    mesh("a.ply", &["--resolution", "500"]).refused(&["`cube`", "500 mm apart", "finer"]);
    mesh("a.glb", &["--crisp", "--animation", "morph", "--frame", "all"]).refused(&["same vertices", "--crisp"]);
    mesh("a.glb", &["--animation", "morph"])
        .refused(&["a.glb: --animation morph is for several frames", "--frame all"]);
    mesh("a.glb", &["--quantize", "--animation", "morph", "--frame", "all"]).refused(&["not quantised"]);
    mesh("a.vtu", &["--organ", "cube"]).refused(&["a.vtu: a .vtu holds the whole lattice", "--organ"]);
    mesh("a.vtu", &["--frame", "all"]).refused(&["5 frames", "a_{frame}.vtu"]);
    folder.yawara(&["volume", "run", "-o", "v.pdf"]).refused(&["v.pdf", ".png"]);
    folder.yawara(&["volume", "run", "-o", "v.png", "--organ", "spleen"]).refused(&["`spleen`", "cube"]);
    for source in ["run", "ph/ct.nii.gz"] {
        let slice = |output: &str, more: &[&str]| {
            folder.yawara(&[&["slice", source, "-o", output, "--axis", "z"], more].concat())
        };
        slice("a.png", &["--at", "500"]).refused(&["across z at 500 mm", "-42 to 42 mm"]);
        slice("a.png", &["--at", "nan"]).refused(&["NaN"]);
        slice("a.jpg", &["--at", "0"]).refused(&["a.jpg", ".png"]);
        slice("a.png", &["--at", "0", "--pixel", "0"]).refused(&["0 mm", "above 0"]);
        slice("a.png", &["--at", "0", "--pixel", "1e-6"]).refused(&["more than", "larger pixels"]);
        slice("a.png", &["--at", "0", "--window", "0"]).refused(&["width 0"]);
        slice("a.png", &["--at", "0", "--tint", "2"]).refused(&["--tint is 2", "0 (grey) to 1"]);
    }
    let slice = ["slice", "run", "-o", "a.png", "--axis", "z", "--at", "0", "--frame"];
    folder.yawara(&[&slice[..], &["all"]].concat()).refused(&["5 frames", "{frame}"]);
    folder.yawara(&[&slice[..], &["9"]].concat()).refused(&["no frame 9", "0 to 4"]);
    assert!(folder.everything() == before, "something was left");
}

#[test]
fn a_mesh_with_a_hole_fails_its_check() {
    let folder = Folder::with_run();
    folder.yawara(&["mesh", "run", "-o", "whole.stl"]).done();
    // Binary STL: 80 bytes, a count, 50 bytes per triangle. The last triangle goes.
    let mut bytes = folder.read("whole.stl");
    let count = (bytes.len() - 84) / 50;
    bytes.truncate(bytes.len() - 50);
    bytes[80..84].copy_from_slice(&(count as u32 - 1).to_le_bytes());
    folder.write("hole.stl", &bytes);
    let answer = folder.yawara(&["check", "hole.stl"]).expect(1);
    assert_eq!(answer.stderr, "");
    answer.prints(&["hole: FAILED", "3 open edges"]);
    let json = folder.yawara(&["check", "hole.stl", "--json"]).expect(1).json();
    assert_eq!((json["passed"].as_bool(), json["meshes"][0]["open_edges"].as_u64()), (Some(false), Some(3)));
    folder.write("torn.stl", &bytes[..1000]);
    folder.yawara(&["check", "torn.stl"]).refused(&["torn.stl", "not a usable"]);
    folder.yawara(&["info", "torn.stl"]).refused(&["torn.stl", "not a usable"]);
}
