//! Colours and attributes of vertices, from the command line to the file.

use yawara::geometry::Grid;
use yawara::io::nifti::{CtEncoding, read_labels, write_ct};
use yawara::io::ply::read_ply;
use yawara::look::colormap::{Colormap, linear_to_srgb8};
use yawara::surface::mesh::TriangleMesh;
use yawara::volume::{CtVolume, Volume};

use crate::support::{CUBE, Folder};

fn mesh(folder: &Folder, arguments: &[&str]) -> TriangleMesh {
    folder.yawara(&[&["mesh", "run", "-o", "a.ply"], arguments].concat()).done();
    read_ply(&folder.path("a.ply")).expect("a mesh")
}

fn srgb(color: [f32; 3]) -> [u8; 3] {
    color.map(linear_to_srgb8)
}

#[test]
fn every_colour_is_written_and_shows_what_it_says() {
    let folder = Folder::with_run();
    let plain = mesh(&folder, &[]);
    assert!(plain.colors.is_empty() && plain.hu.is_empty() && plain.strains.is_empty() && plain.speeds.is_empty());
    let count = plain.positions.len();
    for by in ["organ", "hu", "label", "displacement", "strain", "speed"] {
        let painted = mesh(&folder, &["--color", by]);
        assert_eq!((painted.colors.len(), &painted.positions), (count, &plain.positions), "{by}");
        assert_eq!(painted.hu.len(), if by == "hu" { count } else { 0 }, "{by}");
    }
    let moved = mesh(&folder, &["--color", "displacement", "--range", "0,2", "--colormap", "inferno"]);
    for (color, moved) in moved.colors.iter().zip(&moved.displacements) {
        let length = moved.iter().map(|c| c * c).sum::<f32>().sqrt();
        assert_eq!(srgb(*color), srgb(Colormap::Inferno.rgb(length / 2.0)));
    }
    let all = mesh(&folder, &["--attributes", "hu,strain,speed"]);
    assert!(all.colors.is_empty());
    // The phantom's cube is 50 HU in air: the skin shows none of the air, and the cut none at all.
    assert!(all.hu.len() == count && all.hu.iter().all(|&hu| hu == 50.0), "{:?}", all.hu);
    assert!(all.strains.iter().any(|&strain| strain > 1e-3) && all.strains.iter().all(|s| (0.0..10.0).contains(s)));
    let fastest = all.speeds.iter().fold(0.0_f32, |most, &speed| most.max(speed));
    assert!(all.speeds.len() == count && fastest > 1.0, "{fastest} mm/s");
    // The first frame has none before it.
    let first = mesh(&folder, &["--attributes", "strain,speed", "--frame", "0"]);
    assert!(first.speeds.iter().chain(&first.strains).all(|&value| value == 0.0));
    let said = folder.yawara(&["mesh", "run", "-o", "a.ply", "--color", "strain", "--range", "0,0.5"]).done();
    said.says(&["colours: equivalent strain, 0 to 0.5, viridis"]);
}

#[test]
fn what_cannot_be_painted_is_refused() {
    let folder = Folder::with_run();
    let before = folder.everything();
    let refused = |arguments: &[&str], parts: &[&str]| {
        folder.yawara(&[&["mesh", "run", "-o", "a.ply"], arguments].concat()).refused(parts);
        assert!(folder.everything() == before, "{arguments:?} left something");
    };
    refused(&["--color", "beauty"], &["beauty", "organ, hu, label, displacement, strain, speed"]);
    refused(&["--color", "hu", "--range", "3,1"], &["3,1", "the smaller first"]);
    refused(&["--color", "hu", "--range", "0,nan"], &["0,nan", "two finite numbers"]);
    refused(&["--color", "organ", "--range", "0,1"], &["0 to 1", "colours by organ have none"]);
    refused(&["--color", "strain", "--colormap", "jet"], &["jet", "viridis"]);
    refused(&["--range", "0,1"], &["--color"]);
    refused(&["--detail", "2"], &["2", "from 0 to 1"]);
    refused(&["--attributes", "mood"], &["mood", "strain"]);
}

#[test]
fn hu_come_from_the_ct_of_the_run_and_from_no_other() {
    let folder = Folder::new();
    folder.yawara(&["phantom", "-o", "ph", "--kind", "cube", "--spacing", "6"]).done();
    let files = "image = \"ct.nii.gz\"\nlabels = \"ph/labels.nii.gz\"\nlabel_names = \"ph/labels.tsv\"";
    let scene = CUBE.replace("phantom = \"cube\"\nspacing = 6.0", files);
    let (labels, _) = read_labels(&folder.path("ph/labels.nii.gz")).expect("labels");
    let grid: Grid = *labels.grid();
    let ramp = |add: f64| {
        let values = (0..grid.shape.len()).map(|n| (grid.place(n).x + add) as f32).collect();
        let ct: CtVolume = Volume::from_vec(grid, values);
        write_ct(&folder.path("ct.nii.gz"), &ct, CtEncoding::Float32).expect("written");
    };
    ramp(0.0);
    folder.write("cube.toml", &scene);
    folder.yawara(&["run", "cube.toml", "-o", "run"]).done();
    let painted = mesh(&folder, &["--color", "hu"]);
    // At most the skin's depth (1.5 voxels) from where the vertex was at rest.
    for vertex in 0..painted.positions.len() {
        let rest = painted.positions[vertex][0] - painted.displacements[vertex][0];
        assert!((painted.hu[vertex] - rest).abs() < 9.1, "{} HU at x = {rest}", painted.hu[vertex]);
    }
    let inner = (0..painted.hu.len()).filter(|&v| {
        let rest = painted.positions[v][0] - painted.displacements[v][0];
        (painted.hu[v] - rest).abs() < 1e-3
    });
    assert!(inner.count() > 50, "faces of the cut are read in place");

    let color = ["mesh", "run", "-o", "b.ply", "--color", "hu"];
    ramp(1.0);
    folder.yawara(&color).refused(&["ct.nii.gz", "has changed since the run was made", "SHA-256"]);
    std::fs::remove_file(folder.path("ct.nii.gz")).expect("removed");
    folder.yawara(&color).refused(&["ct.nii.gz", "cannot be read again", "colour by something else"]);
    folder.yawara(&["mesh", "run", "-o", "b.ply", "--color", "strain"]).done();

    folder.write("bare.toml", scene.replace("image = \"ct.nii.gz\"\n", ""));
    folder.yawara(&["run", "bare.toml", "-o", "bare"]).done();
    let call = ["mesh", "bare", "-o", "c.ply", "--attributes", "hu"];
    folder.yawara(&call).refused(&["bare", "without a CT", "label, displacement, strain or speed"]);
    folder.yawara(&["mesh", "bare", "-o", "c.ply", "--color", "organ", "--detail", "0.5"]).done();
}

#[test]
fn a_look_of_the_scene_is_kept_and_seen() {
    let folder = Folder::new();
    let look = "look = { colors = [[0, \"#102030\"], [50, \"#e0c0a0\"], [90, \"#ffffff\"]] }\nstiffness = 7.5";
    folder.write("cube.toml", CUBE.replace("stiffness = 7.5", look));
    folder.yawara(&["run", "cube.toml", "-o", "run"]).done();
    let painted = mesh(&folder, &["--color", "hu"]);
    assert!(painted.colors.iter().all(|&color| srgb(color) == [0xe0, 0xc0, 0xa0]), "50 HU everywhere");
    // A range given by hand takes the shades of the organ's colour instead.
    let ranged = mesh(&folder, &["--color", "hu", "--range", "49,51"]);
    assert!(ranged.colors.iter().all(|&color| srgb(color) != [0xe0, 0xc0, 0xa0]));
}

#[test]
fn colours_do_not_depend_on_threads() {
    let folder = Folder::with_run();
    let bytes = |threads: &str| {
        let call = ["mesh", "run", "-o", "a.ply", "--color", "strain", "--detail", "1", "--threads", threads];
        folder.yawara(&[&call[..], &["--attributes", "hu,speed"]].concat()).done();
        folder.read("a.ply")
    };
    let one = bytes("1");
    assert!(one == bytes("2") && one == bytes("4"));
}
