//! From a scene to a run, meshes, slices and plots.

use crate::support::{CUBE, Folder, fixture};

#[test]
fn from_a_scene_to_everything_else() {
    let folder = Folder::new();
    folder.write("cube.toml", CUBE);

    let scene = folder.yawara(&["info", "cube.toml", "--json"]).done().json();
    assert_eq!((scene["particles"].as_u64(), scene["steps"].as_u64()), (Some(1000), Some(40)));
    assert_eq!(folder.yawara(&["scene", "cube.toml"]).done().json()["organs"][0]["name"], "cube");

    // Without -o: under outputs/, by the scene's name. Nothing but messages, and no progress outside a terminal.
    let run = folder.yawara(&["run", "cube.toml"]).done();
    let run = run.says(&["1000 particles", "`half`", "springs severed", "run: outputs/cube"]);
    assert_eq!(run.stdout, "");
    assert!(!run.stderr.contains(['\r', '\x1b']), "{:?}", run.stderr);
    let quiet = folder.yawara(&["run", "cube.toml", "-o", "run", "--quiet"]).done();
    assert_eq!((quiet.stdout.as_str(), quiet.stderr.as_str()), ("", ""));

    let info = folder.yawara(&["info", "run", "--json"]).done().json();
    assert_eq!(info["manifest"]["frames"].as_u64(), Some(5));
    assert_eq!(info["manifest"]["status"]["state"], "complete");
    assert!(info["severed_springs"].as_u64() > Some(100));
    folder.yawara(&["info", "run"]).done().prints(&[
        "kind             run",
        "pitch_m         0.006",
        "last_time_s      0.02",
    ]);
    folder.yawara(&["check", "run"]).done().prints(&["frame 0, cube: passed", "frame 4, cube: passed", "1 part,"]);
    let check = folder.yawara(&["check", "run", "--json"]).done().json();
    assert_eq!((check["passed"].as_bool(), check["meshes"].as_array().map(Vec::len)), (Some(true), Some(5)));
}

#[test]
fn meshes_of_every_format_and_frame() {
    let folder = Folder::with_run();
    let mesh = |output: &str, more: &[&str]| {
        let answer = folder.yawara(&[&["mesh", "run", "-o", output], more].concat()).done();
        assert_eq!(answer.stderr, "");
        answer.stdout
    };
    for (output, more) in [
        ("last.stl", [].as_slice()),
        ("first.stl", &["--frame", "0"]),
        ("text.stl", &["--ascii"]),
        ("last.ply", &["--frame", "last", "--organ", "cube"]),
        ("last.glb", &[]),
        ("all.glb", &["--frame", "all"]),
        ("steps.PLY", &["--smooth", "0"]),
        ("last.gltf", &[]),
        ("last.obj", &[]),
        ("morph.glb", &["--frame", "all", "--animation", "morph"]),
    ] {
        assert_eq!(mesh(output, more), format!("{output}\n"));
        folder.yawara(&["check", output]).done().prints(&["passed", "no defect"]);
    }
    assert_eq!(mesh("s_{frame}.stl", &["--frame", "all"]), "s_0.stl\ns_1.stl\ns_2.stl\ns_3.stl\ns_4.stl\n");
    assert_eq!(mesh("new/one_{frame}.ply", &["--frame", "2"]), "new/one_2.ply\n");
    assert_eq!(folder.read("s_0.stl"), folder.read("first.stl"));
    assert_eq!(folder.read("s_4.stl"), folder.read("last.stl"));
    assert!(folder.read("text.stl").starts_with(b"solid"));
    assert_ne!(folder.read("first.stl"), folder.read("last.stl"));

    // The same body whatever the file: 60 mm cubed, its edges and corners rounded to about a voxel of 6 mm.
    let mut first = None;
    for output in ["last.stl", "text.stl", "last.ply", "last.glb", "all.glb", "last.gltf", "last.obj"] {
        let facts = folder.yawara(&["info", output, "--json"]).done().json();
        let mesh = &facts["meshes"][0];
        let volume = mesh["volume_ml"].as_f64().expect("a volume");
        assert!((volume - 216.0).abs() < 4.3, "{output}: {volume}");
        // Of the animation it is the first frame that is looked at: at rest.
        let same = if output == "all.glb" { 0.5 } else { 0.01 };
        assert!((volume - *first.get_or_insert(volume)).abs() < same, "{output}: {volume}, others {first:?}");
        assert_eq!((mesh["closed"].as_bool(), mesh["components"].as_u64()), (Some(true), Some(1)), "{output}");
        folder.yawara(&["info", output]).done().prints(&["kind", "mesh", "volume_ml", "bounds_ras_mm"]);
    }
    for output in ["all.glb", "morph.glb"] {
        let checked = folder.yawara(&["check", output, "--json"]).done().json();
        assert_eq!(checked["meshes"].as_array().map(Vec::len), Some(5), "{output}");
    }
    let quantized = folder.yawara(&["mesh", "run", "-o", "q.glb", "--quantize"]).done();
    assert!(quantized.stderr.contains("mm from their place"), "{}", quantized.stderr);
    assert!(folder.read("q.glb").len() < folder.read("last.glb").len());
    // Crisp rims: more vertices, as many triangles, closed by place. Where every edge is smooth nothing is doubled.
    folder.yawara(&["mesh", "run", "-o", "crisp.glb", "--crisp"]).done();
    let of = |file: &str| folder.yawara(&["check", file, "--json"]).done().json()["meshes"][0].clone();
    let (plain, crisp) = (of("last.glb"), of("crisp.glb"));
    assert!(folder.read("crisp.glb").len() > folder.read("last.glb").len());
    assert!(crisp["merged"] == true && plain["merged"] == false, "{crisp}");
    assert!(crisp["triangles"] == plain["triangles"] && crisp["vertices"] == plain["vertices"], "{crisp}, {plain}");
    folder.yawara(&["check", "crisp.glb"]).done().prints(&["vertices at one place merged"]);
}

#[test]
fn sequences_for_paraview_come_with_their_times() {
    let folder = Folder::with_run();
    for (extension, what) in [("vtp", "PolyData"), ("vtu", "UnstructuredGrid")] {
        let pattern = format!("a_{{frame}}.{extension}");
        let answer = folder.yawara(&["mesh", "run", "-o", &pattern, "--frame", "all"]).done();
        let files: Vec<String> = (0..5).map(|frame| format!("a_{frame}.{extension}")).collect();
        assert_eq!(answer.stdout.lines().collect::<Vec<_>>(), [&files[..], &["a.pvd".to_owned()]].concat());
        let list = String::from_utf8(folder.read("a.pvd")).unwrap();
        assert_eq!(list.matches("<DataSet timestep=").count(), 5);
        for file in files {
            assert!(list.contains(&format!("file=\"{file}\"")), "{list}");
            let text = folder.read(&file);
            let text = String::from_utf8_lossy(&text);
            assert!(text.contains(&format!("<VTKFile type=\"{what}\"")) && text.contains("TimeValue"));
        }
    }
    folder.yawara(&["mesh", "run", "-o", "lattice.vtu"]).done().prints(&["lattice.vtu"]);
}

#[test]
fn the_speed_of_writing_is_told() {
    let folder = Folder::new();
    let bench = ["bench", "write", "--triangles", "1000", "--folder", "here", "--json"];
    let report = folder.yawara(&bench).done().json();
    let formats = report["formats"].as_array().unwrap();
    assert_eq!(formats.len(), 7);
    for format in formats {
        assert!(format["bytes"].as_u64().unwrap() > 10_000 && format["mb_per_s"].as_f64().unwrap() > 0.0, "{format}");
    }
    assert!(std::fs::read_dir(folder.path("here")).unwrap().next().is_none(), "nothing is left");
}

#[test]
fn slices_and_plots() {
    let folder = Folder::with_run();
    folder.yawara(&["phantom", "-o", "ph", "--kind", "cube", "--spacing", "6"]).done();
    for axis in ["x", "y", "z"] {
        for (name, more) in [("rest", ["--rest"].as_slice()), ("first", &["--frame", "0"]), ("last", &["--no-contour"])]
        {
            let output = format!("{name}-{axis}.png");
            let call = [&["slice", "run", "-o", &output, "--axis", axis, "--at", "10"], more].concat();
            assert_eq!(folder.yawara(&call).done().stdout, format!("{output}\n"));
        }
        let output = format!("volume-{axis}.png");
        folder.yawara(&["slice", "ph/ct.nii.gz", "-o", &output, "--axis", axis, "--at", "-10"]).done();
        let output = format!("labels-{axis}.png");
        folder.yawara(&["slice", "ph/labels.nii.gz", "-o", &output, "--axis", axis, "--at", "0"]).done();
        for kind in ["rest", "first", "last", "volume", "labels"] {
            let picture = image::open(folder.path(&format!("{kind}-{axis}.png"))).expect("a picture").to_rgb8();
            assert_eq!(picture.dimensions(), (800, 800), "{kind}-{axis}");
            let bright = picture.pixels().filter(|pixel| pixel[1] > 80).count();
            assert!((220_000..350_000).contains(&bright), "{kind}-{axis}: {bright} of 640 000 pixels show tissue");
        }
        assert_ne!(folder.read(&format!("rest-{axis}.png")), folder.read(&format!("last-{axis}.png")));
    }
    let coarse = ["slice", "ph/ct.nii.gz", "-o", "c.png", "--axis", "z", "--at", "0", "--pixel", "2", "--labels"];
    folder.yawara(&[&coarse[..], &["ph/labels.nii.gz", "--plain"]].concat()).done();
    assert_eq!(image::open(folder.path("c.png")).expect("a picture").to_rgb8().dimensions(), (42, 42));

    let plot = folder.yawara(&["volume", "run", "-o", "plot.png"]).done();
    plot.prints(&["by cells", "by surface", "plot.png\nplot.csv\n"]);
    assert!(image::open(folder.path("plot.png")).is_ok());
    let numbers = String::from_utf8(folder.read("plot.csv")).expect("text");
    // One line per frame below the titles.
    assert_eq!(numbers.lines().filter(|line| line.starts_with(|c: char| c.is_ascii_digit())).count(), 5, "{numbers}");
}

#[test]
fn a_phantom_on_disk_makes_the_scene_of_a_phantom() {
    let folder = Folder::new();
    let written = folder.yawara(&["phantom", "-o", "ph", "--kind", "cube", "--spacing", "6"]).done();
    assert_eq!(written.stdout, "ph/ct.nii.gz\nph/labels.nii.gz\nph/labels.tsv\n");
    let image = folder.yawara(&["info", "ph/ct.nii.gz", "--json"]).done().json();
    assert_eq!((image["shape"].to_string(), &image["axes"]), ("[14,14,14]".to_owned(), &"RAS".into()));
    assert!(image["max_hu"].as_f64() > Some(0.0) && image["min_hu"].as_f64() < Some(-900.0));
    let labels = folder.yawara(&["info", "ph/labels.nii.gz", "--json"]).done().json();
    assert_eq!((labels["labels"][0]["label"].as_u64(), labels["labels"][0]["voxels"].as_u64()), (Some(1), Some(1000)));
    folder.yawara(&["info", "ph/labels.nii.gz"]).done().prints(&["kind ", "label  touches_border", "1      no"]);

    // A scene of files in another folder than the one the program is called from.
    let files = "image = \"../ph/ct.nii.gz\"\nlabels = \"../ph/labels.nii.gz\"\nlabel_names = \"../ph/labels.tsv\"";
    folder.write("scenes/files.toml", CUBE.replace("phantom = \"cube\"\nspacing = 6.0", files));
    folder.write("made.toml", CUBE);
    folder.yawara(&["run", "scenes/files.toml", "-o", "a"]).done();
    folder.yawara(&["run", "made.toml", "-o", "b"]).done();
    for part in ["arrays.zarr/lattice", "arrays.zarr/frames", "arrays.zarr/severed"] {
        assert!(folder.tree(&format!("a/{part}")) == folder.tree(&format!("b/{part}")), "{part} differs");
    }
    let info = folder.yawara(&["info", "a", "--json"]).done().json();
    assert_eq!(info["manifest"]["inputs"].as_array().map(Vec::len), Some(2));
    // A changed input is noticed when it is read again.
    folder.yawara(&["slice", "a", "-o", "a.png", "--axis", "x", "--at", "0"]).done();
    folder.write("ph/ct.nii.gz", folder.read("ph/labels.nii.gz"));
    let answer = folder.yawara(&["slice", "a", "-o", "a.png", "--axis", "x", "--at", "0"]).done();
    answer.says(&["warning", "ct.nii.gz", "has changed"]);
}

/// Scenes of real volumes need files that are not part of this repository.
#[test]
fn every_shipped_scene_of_a_phantom_can_be_simulated() {
    let folder = Folder::new();
    let mut count = 0;
    for entry in std::fs::read_dir(fixture("scenes")).expect("scenes") {
        let path = entry.expect("an entry").path();
        if path.extension().is_some_and(|extension| extension == "toml")
            && std::fs::read_to_string(&path).expect("text").contains("phantom = ")
        {
            let facts = folder.yawara(&["info", &path.to_string_lossy(), "--json"]).done();
            assert_eq!(facts.stderr, "", "{}", path.display());
            assert!(facts.json()["particles"].as_u64() > Some(1000));
            count += 1;
        }
    }
    assert_eq!(count, 12);
}

/// The demo's own scene takes seconds: it is taken to its first message only.
#[test]
fn a_demo_is_not_written_over_other_files() {
    let folder = Folder::new();
    folder.write("mine/notes.txt", "keep");
    folder.write("mine/liver.stl", "keep");
    let before = folder.everything();
    folder.yawara(&["demo", "-o", "mine"]).refused(&["mine", "not empty", "--overwrite"]);
    folder.yawara(&["demo", "-o", "mine", "--overwrite"]).refused(&["mine", "no earlier demo", "another folder"]);
    folder.yawara(&["demo", "-o", "mine/notes.txt"]).refused(&["notes.txt", "is a file"]);
    folder.write("mine/run/notes.txt", "keep");
    folder.yawara(&["demo", "-o", "mine", "--overwrite"]).refused(&["not a yawara run"]);
    std::fs::remove_dir_all(folder.path("mine/run")).expect("removed");
    assert!(folder.everything() == before);
}

#[test]
fn a_demo_is_written_and_written_again() {
    let folder = Folder::new();
    let files = ["animation.glb", "liver.stl", "liver.ply", "axial-before.png", "axial-after.png", "coronal-after.png"];
    let first = folder.yawara(&["demo", "-o", "d"]).done().prints(&files);
    assert!(first.stderr.contains("particles"));
    folder.yawara(&["check", "d/liver.stl"]).done();
    folder.yawara(&["check", "d/animation.glb"]).done();
    let before = folder.tree("d");
    folder.yawara(&["demo", "-o", "d"]).refused(&["not empty", "--overwrite"]);
    assert!(folder.tree("d") == before);
    folder.write("d/notes.txt", "keep");
    folder.yawara(&["demo", "-o", "d", "--overwrite", "--quiet"]).done();
    let after = folder.tree("d");
    for file in files {
        assert!(after[file] == before[file], "{file} is not the same again");
    }
    assert_eq!(after["notes.txt"], b"keep");
    assert_eq!(after.len(), before.len() + 1);
}
