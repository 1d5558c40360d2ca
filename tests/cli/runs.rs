//! Runs that were interrupted, damaged, or are in the way.

use crate::support::{CUBE, Folder};

#[test]
fn an_existing_run_is_replaced_only_when_asked() {
    let folder = Folder::with_run();
    let before = folder.everything();
    let refused = folder.yawara(&["run", "cube.toml", "-o", "run"]).refused(&["run: exists", "--overwrite"]);
    // Told before any work is done.
    assert!(!refused.stderr.contains("particles"), "{}", refused.stderr);
    assert!(folder.everything() == before);
    folder.write("cube.toml", CUBE.replace("frames = 4", "frames = 2"));
    folder.yawara(&["run", "cube.toml", "-o", "run", "--overwrite"]).done();
    let info = folder.yawara(&["info", "run", "--json"]).done().json();
    assert_eq!(info["manifest"]["frames"].as_u64(), Some(3));
    assert!(!folder.everything().keys().any(|name| name.contains(".part")));

    // A scene that is refused leaves the old run alone.
    folder.write("cube.toml", CUBE.replace("dt = 5e-4", "dt = 5e-3"));
    let before = folder.everything();
    folder.yawara(&["run", "cube.toml", "-o", "run", "--overwrite"]).refused(&["not stable"]);
    assert!(folder.everything() == before);
}

#[test]
fn what_is_not_a_run_is_never_replaced() {
    let folder = Folder::new();
    folder.write("cube.toml", CUBE);
    folder.write("mine/thesis.txt", "keep");
    let before = folder.everything();
    folder.yawara(&["run", "cube.toml", "-o", "mine", "--overwrite"]).refused(&["mine", "not a yawara run"]);
    folder.yawara(&["run", "cube.toml", "-o", "mine"]).refused(&["mine: exists and is not empty"]);
    assert!(folder.everything() == before);
    folder.yawara(&["run", "cube.toml", "-o", "run"]).done();
    folder.write("run/thesis.txt", "keep");
    let before = folder.everything();
    folder.yawara(&["run", "cube.toml", "-o", "run", "--overwrite"]).refused(&["\"thesis.txt\"", "would be deleted"]);
    assert!(folder.everything() == before);

    folder.yawara(&["phantom", "-o", "ph", "--kind", "cube", "--spacing", "6"]).done();
    let before = folder.everything();
    folder.yawara(&["phantom", "-o", "ph", "--kind", "beam"]).refused(&["ph/ct.nii.gz: exists", "--overwrite"]);
    assert!(folder.everything() == before);
}

#[test]
fn an_interrupted_run_gives_its_frames_with_a_warning() {
    let folder = Folder::with_run();
    let manifest = String::from_utf8(folder.read("run/manifest.json")).expect("text");
    folder.write("run/manifest.json", manifest.replace("complete", "running"));
    for call in [
        ["info", "run"].as_slice(),
        &["check", "run"],
        &["mesh", "run", "-o", "a.stl"],
        &["volume", "run", "-o", "v.png"],
        &["slice", "run", "-o", "s.png", "--axis", "y", "--at", "0"],
    ] {
        folder.yawara(call).done().says(&["warning: "]);
    }
}

#[test]
fn a_damaged_run_is_refused_where_it_is_damaged() {
    let folder = Folder::with_run();
    let chunk = "run/arrays.zarr/frames/displacement/c.3.0.0";
    let bytes = folder.read(chunk);
    folder.write(chunk, &bytes[..bytes.len() / 2]);
    let before = folder.everything();
    folder.yawara(&["mesh", "run", "-o", "a.stl", "--frame", "3"]).refused(&["c.3.0.0", "damaged"]);
    folder.yawara(&["mesh", "run", "-o", "a.glb", "--frame", "all"]).refused(&["c.3.0.0", "damaged"]);
    folder.yawara(&["volume", "run", "-o", "v.png"]).refused(&["c.3.0.0", "damaged"]);
    folder.yawara(&["slice", "run", "-o", "s.png", "--axis", "x", "--at", "0", "--frame", "3"]).refused(&["c.3.0.0"]);
    folder.yawara(&["check", "run"]).refused(&["c.3.0.0", "damaged"]);
    assert!(folder.everything() == before, "something was left");
    // Other frames are still there.
    folder.yawara(&["mesh", "run", "-o", "a.stl", "--frame", "4"]).done();

    let manifest = folder.read("run/manifest.json");
    folder.write("run/manifest.json", &manifest[..manifest.len() / 2]);
    folder.yawara(&["info", "run"]).refused(&["manifest.json", "damaged"]);
    let newer = String::from_utf8(manifest).expect("text").replace("\"format_version\": 3", "\"format_version\": 99");
    folder.write("run/manifest.json", newer);
    folder.yawara(&["info", "run"]).refused(&["manifest.json", "99"]);
    std::fs::remove_file(folder.path("run/manifest.json")).expect("removed");
    folder.yawara(&["info", "run"]).refused(&["run: not a yawara run"]);
}
