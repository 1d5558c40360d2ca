//! Tissues by name, and Young's modulus and density from the CT or from volumes of their own.

use yawara::geometry::{Affine, Grid};
use yawara::io::nifti::{CtEncoding, read_labels, write_ct};
use yawara::volume::{CtVolume, Volume};

use crate::support::{CUBE, Folder};

#[test]
fn materials_are_listed_with_their_numbers_and_sources() {
    let folder = Folder::new();
    let text = folder.yawara(&["info", "--materials"]).done();
    let line = |name: &str| {
        let mut lines = text.stdout.lines();
        lines.find(|line| line.split_whitespace().next() == Some(name)).unwrap_or_else(|| panic!("{name}")).to_owned()
    };
    let columns = |name: &str| line(name).split_whitespace().map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(columns("liver")[1..6], ["5000", "500", "8500", "0.45", "1060"]);
    assert_eq!(columns("bone")[1], "1.7e10");
    // Notes refer to works by number, and every number leads somewhere.
    let last = text.stdout.lines().last().expect("sources");
    let most: usize = last.strip_prefix('[').and_then(|l| l.split(']').next()).expect("[n]").parse().expect("a number");
    for number in 1..=most {
        let reference = format!("[{number}]");
        assert!(text.stdout.matches(&reference).count() >= 2, "{reference} is not both cited and listed");
    }
    let json = folder.yawara(&["info", "--materials", "--json"]).done().json();
    let materials = json["materials"].as_array().expect("a list");
    assert_eq!(json["kind"], "materials");
    assert_eq!(materials.len(), yawara::material::library::tissues().len());
    let muscle = materials.iter().find(|m| m["name"] == "muscle").expect("muscle");
    assert_eq!(muscle["youngs_modulus_pa"], 1.1e4);
    assert_eq!(muscle["synonyms"][0], "skeletal_muscle");
    for material in materials {
        assert!(material["sources"].as_array().is_some_and(|sources| !sources.is_empty()), "{material}");
        let name = material["name"].as_str().expect("a name");
        assert!(columns(name).len() >= 6, "{name}");
    }
    // The published maps from CT numbers, each with its points and where they are from.
    let maps = json["density_maps"].as_array().expect("a list");
    assert_eq!(maps.len(), yawara::material::ct_density::density_maps().len());
    assert_eq!(maps[0]["points_hu_kg_per_m3"][0][0], -1000.0);
    assert!(maps[0]["source"].as_str().is_some_and(|source| source.contains("Phys. Med. Biol. 45 (2000) 459")));
    assert!(line("schneider_2000").contains("-1000: 1.21, -98: 930.5"), "{}", line("schneider_2000"));
    folder.yawara(&["info"]).refused(&["<PATH>"]);
    folder.yawara(&["info", "cube.toml", "--materials"]).refused(&["--materials"]);
    assert!(folder.everything().is_empty(), "info writes nothing");
}

/// The cube of model `tissue` with its modulus from `moduli.nii.gz`, on the voxels of the program's own phantom.
fn scene() -> String {
    CUBE.replace("phantom = \"cube\"\nspacing = 6.0", "labels = \"ph/labels.nii.gz\"\nlabel_names = \"ph/labels.tsv\"")
        .replace("model = \"paper\"", "model = \"tissue\"")
        .replace(
            "stiffness = 7.5\ndamping = 1e-3\nmass = 2.3e-4",
            "youngs_modulus = { file = \"moduli.nii.gz\" }\ndensity = 1060",
        )
        .replace("steps = 40\ndt = 5e-4", "duration = 0.01")
}

/// A folder with the scene and the phantom, and the grid of its voxels.
fn prepared() -> (Folder, Grid, Vec<u16>) {
    let folder = Folder::new();
    folder.yawara(&["phantom", "-o", "ph", "--kind", "cube", "--spacing", "6"]).done();
    folder.write("cube.toml", scene());
    let (labels, info) = read_labels(&folder.path("ph/labels.nii.gz")).expect("labels");
    (folder, info.grid, labels.as_slice().to_vec())
}

fn write(folder: &Folder, grid: Grid, values: Vec<f32>) {
    let moduli: CtVolume = Volume::from_vec(grid, values);
    write_ct(&folder.path("moduli.nii.gz"), &moduli, CtEncoding::Float32).expect("written");
}

#[test]
fn a_volume_of_moduli_gives_every_cell_its_own() {
    let (folder, grid, labels) = prepared();
    // Soft below the middle, ten times stiffer above; nothing where there is no organ.
    let [nx, ny, nz] = grid.shape.dims();
    let upper = |voxel: usize| voxel / (nx * ny) >= nz / 2;
    let value = |voxel: usize| match labels[voxel] {
        0 => 0.0,
        _ if upper(voxel) => 2e4,
        _ => 2e3,
    };
    write(&folder, grid, (0..labels.len()).map(value).collect());
    folder.yawara(&["run", "cube.toml", "-o", "run"]).done();
    let manifest = String::from_utf8(folder.read("run/manifest.json")).expect("text");
    assert!(manifest.contains("moduli.nii.gz"), "{manifest}");
    // Twice as stiff everywhere allows 1/sqrt(2) of the step.
    let bound = |folder: &Folder| {
        let facts = folder.yawara(&["info", "cube.toml", "--json"]).done().json();
        facts["stable_dt_s"].as_f64().expect("a bound")
    };
    let first = bound(&folder);
    write(&folder, grid, (0..labels.len()).map(|voxel| 2.0 * value(voxel)).collect());
    let text = folder.yawara(&["info", "cube.toml"]).done();
    text.prints(&["cube: its modulus differs from cell to cell, 4000 to 40000 Pa, mean 22000"]);
    let ratio = first / bound(&folder);
    assert!((ratio / 2.0_f64.sqrt() - 1.0).abs() < 0.01, "{ratio}");
}

#[test]
fn moduli_that_cannot_be_used_are_refused() {
    let (folder, grid, labels) = prepared();
    let refused = |parts: &[&str]| {
        let before = folder.everything();
        for call in [["run", "cube.toml"], ["info", "cube.toml"]] {
            folder.yawara(&call).refused(parts);
        }
        assert!(folder.everything() == before, "something was left");
    };
    refused(&["moduli.nii.gz", "o such file"]);

    let inside = labels.iter().position(|&label| label != 0).expect("an organ");
    for (value, shown) in [(0.0, "0 Pa"), (-300.0, "-300 Pa")] {
        let mut values = vec![5e3; labels.len()];
        values[inside] = value;
        write(&folder, grid, values);
        refused(&["`cube`", "moduli.nii.gz", shown, "above 0", "mm (RAS+)", "mend the volume"]);
    }

    let fine = Grid { affine: Affine::from_spacing([3.0; 3], [0.0; 3]).expect("an affine"), ..grid };
    write(&folder, fine, vec![5e3; labels.len()]);
    refused(&["moduli.nii.gz", "the volume of moduli", "the scene's volume", "voxels apart", "resample the moduli"]);
    let shape = yawara::geometry::GridShape::new(grid.shape.nx, grid.shape.ny, grid.shape.nz + 1);
    write(&folder, Grid { shape, ..grid }, vec![5e3; shape.len()]);
    let [found, expected] = [shape, grid.shape].map(|shape| shape.to_string());
    refused(&["moduli.nii.gz", "the volume of moduli has", &found, &expected]);
}

/// The cube with its density as given.
fn with_density(density: &str) -> String {
    scene().replace("{ file = \"moduli.nii.gz\" }", "5e3").replace("density = 1060", &format!("density = {density}"))
}

#[test]
fn a_density_from_ct_or_from_a_volume_is_told_by_info() {
    let (folder, grid, labels) = prepared();
    let [nx, ny, nz] = grid.shape.dims();
    let upper = |voxel: usize| voxel / (nx * ny) >= nz / 2;
    let value = |voxel: usize| match labels[voxel] {
        0 => 0.0,
        _ if upper(voxel) => 1200.0,
        _ => 800.0,
    };
    let densities: CtVolume = Volume::from_vec(grid, (0..labels.len()).map(value).collect());
    write_ct(&folder.path("densities.nii.gz"), &densities, CtEncoding::Float32).expect("written");
    folder.write("cube.toml", with_density("{ file = \"densities.nii.gz\" }"));
    let facts = folder.yawara(&["info", "cube.toml", "--json"]).done().json();
    let spread = &facts["organs"][0]["spread"];
    assert_eq!(spread["density_kg_per_m3"], serde_json::json!({ "least": 800.0, "most": 1200.0, "mean": 1000.0 }));
    assert!(spread["youngs_modulus_pa"].is_null());
    let told = "cube: its density differs from cell to cell, 800 to 1200 kg/m^3, mean 1000";
    folder.yawara(&["info", "cube.toml"]).done().prints(&[told, "density_kg_per_m3 from ", "densities.nii.gz"]);
    folder.yawara(&["run", "cube.toml", "-o", "run"]).done();
    let manifest = String::from_utf8(folder.read("run/manifest.json")).expect("text");
    assert!(manifest.contains("densities.nii.gz"), "{manifest}");
    folder.yawara(&["check", "run"]).done();

    // The same from CT numbers: the phantom's own, through the published map.
    let phantom = "labels = \"ph/labels.nii.gz\"\nlabel_names = \"ph/labels.tsv\"";
    let mapped = with_density("{ hu = \"schneider_2000\" }").replace(phantom, "phantom = \"cube\"\nspacing = 6.0");
    folder.write("mapped.toml", mapped);
    let facts = folder.yawara(&["info", "mapped.toml", "--json"]).done().json();
    let spread = &facts["organs"][0]["spread"]["density_kg_per_m3"];
    let part = |part: &str| spread[part].as_f64().expect("a number");
    folder.yawara(&["info", "mapped.toml"]).done().prints(&["density_kg_per_m3 from HU by 7 points"]);
    // It is 50 HU all through: 27 of the 77 HU from 23 to 100, from 1030 to 1119.9 kg/m^3.
    let expected = 1030.0 + 27.0 / 77.0 * 89.9;
    for name in ["least", "mean", "most"] {
        assert!((part(name) / expected - 1.0).abs() < 1e-9, "{spread}");
    }
}

#[test]
fn densities_that_cannot_be_used_are_refused() {
    let (folder, grid, labels) = prepared();
    folder.write("cube.toml", with_density("{ file = \"densities.nii.gz\" }"));
    let refused = |parts: &[&str]| {
        for call in [["run", "cube.toml"], ["info", "cube.toml"]] {
            folder.yawara(&call).refused(parts);
        }
    };
    refused(&["densities.nii.gz", "o such file"]);
    let write = |grid: Grid, values: Vec<f32>| {
        let densities: CtVolume = Volume::from_vec(grid, values);
        write_ct(&folder.path("densities.nii.gz"), &densities, CtEncoding::Float32).expect("written");
    };
    let mut values = vec![1e3; labels.len()];
    values[labels.iter().position(|&label| label != 0).expect("an organ")] = 0.0;
    write(grid, values);
    refused(&["`cube`", "densities.nii.gz", "a density of 0 kg/m3", "above 0", "mm (RAS+)", "mend the volume"]);
    let fine = Grid { affine: Affine::from_spacing([3.0; 3], [0.0; 3]).expect("an affine"), ..grid };
    write(fine, vec![1e3; labels.len()]);
    refused(&["densities.nii.gz", "the volume of densities", "the scene's volume", "resample the densities"]);
}
