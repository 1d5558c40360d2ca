//! Places that cannot be written: refused, with nothing half-written.
#![cfg(unix)]

use crate::support::{CUBE, Folder};

/// Every command that writes, with `OUT` for the folder to write in.
const WRITERS: [&str; 9] = [
    "run cube.toml -o OUT/new",
    "mesh run -o OUT/a.stl",
    "mesh run -o OUT/b.stl --ascii",
    "mesh run -o OUT/a.ply",
    "mesh run -o OUT/a.glb",
    "mesh run -o OUT/b.glb --frame all",
    "slice run -o OUT/a.png --axis z --at 0",
    "volume run -o OUT/v.png",
    "phantom --kind abdomen --spacing 8 -o OUT/ph",
];

#[test]
fn a_file_where_a_folder_should_be() {
    let folder = Folder::with_run();
    folder.write("file", "keep");
    let before = folder.everything();
    for call in WRITERS {
        let call = call.replace("OUT", "file");
        let arguments: Vec<&str> = call.split(' ').collect();
        folder.yawara(&arguments).refused(&["file", "is a file"]);
    }
    assert!(folder.everything() == before, "something was left");
}

#[test]
fn a_folder_where_a_file_should_be() {
    let folder = Folder::with_run();
    for name in ["a.stl", "a.glb", "a.png"] {
        std::fs::create_dir(folder.path(name)).expect("a folder");
    }
    let before = folder.everything();
    folder.yawara(&["mesh", "run", "-o", "a.stl"]).refused(&["a.stl", "directory"]);
    folder.yawara(&["mesh", "run", "-o", "a.glb", "--frame", "all"]).refused(&["a.glb", "directory"]);
    folder.yawara(&["slice", "run", "-o", "a.png", "--axis", "z", "--at", "0"]).refused(&["a.png", "directory"]);
    assert!(folder.everything() == before, "something was left");
}

/// Files may grow to 4 KiB only: writing fails in the middle, as on a disk that fills up.
#[test]
fn files_that_cannot_grow_leave_nothing() {
    let folder = Folder::with_run();
    std::fs::create_dir(folder.path("out")).expect("a folder");
    for call in &WRITERS[1..] {
        let call = call.replace("OUT", "out");
        // Without the trap the system ends the program with a signal.
        let answer = folder.shell(&format!("trap '' XFSZ; ulimit -f 8; exec $Y {call}"));
        answer.refused(&["out/", "File too large"]);
        let left: Vec<String> = folder.tree("out").into_keys().filter(|name| !name.ends_with('/')).collect();
        assert!(left.is_empty(), "{call} left {left:?}");
    }
}

/// A disk of 96 KiB in a name space of its own.
#[test]
fn a_full_disk() {
    let folder = Folder::with_run();
    std::fs::create_dir(folder.path("out")).expect("a folder");
    let on_small_disk = |line: &str| {
        folder.shell(&format!("unshare -rm sh -c 'mount -t tmpfs -o size=96k none out || exit 99; {line}'"))
    };
    if on_small_disk("true").code != 0 {
        eprintln!("SKIPPED: a full disk needs the right to mount one (unshare -rm, tmpfs)");
        return;
    }
    // A mesh that does not fit beside an old file, which stays.
    let line = "echo old >out/a.stl; head -c 40000 /dev/zero >out/other; $Y mesh run -o out/a.stl; \
                code=$?; cat out/a.stl; ls -A out; exit $code";
    let answer = on_small_disk(line).expect(2);
    assert_eq!(answer.stdout, "old\na.stl\nother\n");
    answer.says(&["out/a.stl", "No space left"]);
    // A run that fits only in part: its frames so far stay readable; or, with less room, nothing is left.
    folder.write("long.toml", CUBE.replace("frames = 4", "frames = 40"));
    let line = "$Y -q run long.toml -o out/r; code=$?; $Y info out/r --json; exit $code";
    // Folders and chunks of a page each: a mount of 400 KiB holds the lattice and a few frames.
    let answer = folder.shell(&format!("unshare -rm sh -c 'mount -t tmpfs -o size=400k none out || exit 99; {line}'"));
    let answer = answer.expect(2).says(&["out/r", "the disk is full", "free some space", "warning"]);
    let info = answer.json();
    assert_eq!(info["manifest"]["status"]["state"], "running");
    let line = "$Y -q run cube.toml -o out/r; code=$?; ls -A out; exit $code";
    let answer = on_small_disk(line).expect(2).says(&["the disk is full"]);
    assert_eq!(answer.stdout, "");
}
