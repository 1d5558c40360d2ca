//! Pictures of runs and meshes, and what is refused.

use crate::support::Folder;

fn picture(folder: &Folder, name: &str) -> image::DynamicImage {
    image::load_from_memory(&folder.read(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

#[test]
fn runs_and_meshes_are_drawn() {
    let folder = Folder::with_run();
    let draw = |source: &str, output: &str, more: &[&str]| {
        let call = [&["render", source, "-o", output, "--size", "160x120"], more].concat();
        let answer = folder.yawara(&call).done();
        assert_eq!(answer.stderr, "");
        answer.stdout
    };
    for (output, more) in [
        ("surface.png", [].as_slice()),
        ("voxels.png", &["--style", "voxels", "--organ", "cube"]),
        ("lines.png", &["--style", "wireframe", "--view", "superior", "--orthographic"]),
        ("section.png", &["--clip", "0,0,-5,0,0,1", "--azimuth", "-20", "--elevation", "50", "--zoom", "1.5"]),
        ("plain.png", &["--plain", "--no-occlusion", "--background", "#203040", "--center", "0,-1.5,0"]),
        ("cut.png", &["--background", "transparent", "--smooth", "0"]),
    ] {
        assert_eq!(draw("run", output, more), format!("{output}\n"));
        let drawn = picture(&folder, output);
        assert_eq!((drawn.width(), drawn.height()), (160, 120), "{output}");
        let colors: std::collections::HashSet<_> = drawn.to_rgba8().pixels().copied().collect();
        assert!(colors.len() > 100, "{output}: {} colours", colors.len());
        assert_eq!(drawn.color().has_alpha(), output == "cut.png");
    }
    assert_eq!(picture(&folder, "plain.png").to_rgb8().get_pixel(0, 0).0, [0x20, 0x30, 0x40]);

    // Meshes of the same frame give the same picture, but for what their formats keep.
    for mesh in ["m.stl", "m.ply", "m.glb"] {
        folder.yawara(&["mesh", "run", "-o", mesh]).done();
        draw(mesh, "m.png", &["--clip", "0,5,0,0,1,0", "--view", "anterior"]);
        assert!(picture(&folder, "m.png").to_rgb8().get_pixel(80, 60)[0] > 60, "{mesh}");
    }
}

#[test]
fn frames_are_numbered_and_framed_alike() {
    let folder = Folder::with_run();
    let call = ["render", "run", "-o", "new/f_{frame}.png", "--frame", "all", "--size", "96x96", "--plain"];
    let listed = folder.yawara(&call).done().stdout;
    assert_eq!(listed, "new/f_0.png\nnew/f_1.png\nnew/f_2.png\nnew/f_3.png\nnew/f_4.png\n");
    // The first and last frame alone are framed as within the whole, as the motion grows.
    for number in ["0", "4"] {
        folder.yawara(&["render", "run", "-o", "one.png", "--frame", number, "--size", "96x96", "--plain"]).done();
        let of_all = folder.read(&format!("new/f_{number}.png"));
        assert!(folder.read("one.png") == of_all, "{number}");
    }
    assert_ne!(folder.read("new/f_0.png"), folder.read("new/f_4.png"));
    folder.yawara(&["mesh", "run", "-o", "all.glb", "--frame", "all"]).done();
    let call = ["render", "all.glb", "-o", "g_{frame}.png", "--frame", "all", "--size", "96x96"];
    assert_eq!(folder.yawara(&call).done().stdout.lines().count(), 5);
}

#[test]
fn what_cannot_be_drawn_is_refused() {
    let folder = Folder::with_run();
    folder.yawara(&["mesh", "run", "-o", "m.stl"]).done();
    folder.write("ct.nii", "x");
    let before = folder.everything();
    for (call, parts) in [
        (["run", "-o", "a.jpg"].as_slice(), ["a.jpg", ".png"].as_slice()),
        (&["no", "-o", "a.png"], &["no such file"]),
        (&["cube.toml", "-o", "a.png"], &["cube.toml", "a run directory or a mesh", "yawara run"]),
        (&["ct.nii", "-o", "a.png"], &["ct.nii", "a run directory or a mesh"]),
        (&["m.stl", "-o", "a.png", "--style", "voxels"], &["m.stl", "no voxels"]),
        (&["m.stl", "-o", "a.png", "--frame", "3"], &["no frame 3", "0 to 0"]),
        (&["m.stl", "-o", "a.png", "--organ", "liver"], &["`liver`", "there are m"]),
        (&["run", "-o", "a.png", "--frame", "5"], &["no frame 5", "0 to 4"]),
        (
            &["run", "-o", "a.png", "--frame", "all"],
            &["5 frames do not fit into one picture", "a_{frame}.png", ".apng"],
        ),
        (&["run", "-o", "a_{step}.png"], &["{step}", "{frame}"]),
        (&["run", "-o", "a.png", "--organ", "liver"], &["`liver`", "cube"]),
        (&["run", "-o", "a.png", "--organ", "liver", "--style", "voxels"], &["`liver`", "cube"]),
        (&["run", "-o", "a.png", "--size", "10x10"], &["10 x 10", "from 16 to 8192"]),
        (&["run", "-o", "a.png", "--size", "99999x99999"], &["99999 x 99999"]),
        (&["run", "-o", "a.png", "--size", "huge"], &["`huge`", "1920x1080"]),
        (&["run", "-o", "a.png", "--zoom", "0"], &["zoom is 0", "0.02 to 50"]),
        (&["run", "-o", "a.png", "--zoom", "NaN"], &["zoom is NaN"]),
        (&["run", "-o", "a.png", "--azimuth", "inf"], &["azimuth is inf"]),
        (&["run", "-o", "a.png", "--center", "1,2"], &["`1,2`", "3 finite numbers"]),
        (&["run", "-o", "a.png", "--clip", "0,0,0,0,0,nan"], &["`0,0,0,0,0,nan`", "6 finite numbers"]),
        (&["run", "-o", "a.png", "--clip", "0,0,0,0,0,0"], &["clip plane", "not zero"]),
        (&["run", "-o", "a.png", "--background", "pink"], &["`pink`", "#rrggbb"]),
    ] {
        folder.yawara(&[&["render"], call].concat()).refused(parts);
    }
    assert!(folder.everything() == before, "something was left");
}
