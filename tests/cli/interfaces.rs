//! `mesh --interfaces shared`: every wall once, at either resolution.

use std::collections::{BTreeMap, BTreeSet};

use yawara::io::gltf::GltfReader;
use yawara::surface::check::check;
use yawara::surface::mesh::TriangleMesh;
use yawara::surface::weld::{soup, weld};

use crate::support::Folder;

/// Two organs that touch, a blade through both.
const TWO: &str = r#"
[volume]
phantom = "abdomen"
spacing = 8.0
[lattice]
model = "tissue"
[[organ]]
name = "liver"
label = "liver"
youngs_modulus = 5e3
density = 1060
damping_ratio = 0.2
[[organ]]
name = "vessels"
label = "liver_vessels"
youngs_modulus = 2e4
density = 1060
damping_ratio = 0.2
[time]
duration = 0.03
frames = 2
[[fix]]
region = { half_space = { point = [0, -30, 0], normal = [0, -1, 0] } }
[[cut]]
blade = [[61, 20, -80], [61, 20, 80]]
path = [[0, 80, 0], [0, 0, 0]]
from = 0.001
to = 0.01
[[pull]]
region = { sphere = { center = [74, 58, 0], radius = 20 } }
force = [1, 0.5, 0]
from = 0.01
"#;

fn flipped(mesh: &TriangleMesh) -> TriangleMesh {
    let mut mesh = mesh.clone();
    mesh.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    mesh
}

#[test]
fn walls_in_a_file_close_every_organ_and_exclude_what_would_part_them() {
    let folder = Folder::new();
    folder.write("two.toml", TWO);
    folder.yawara(&["run", "two.toml", "-o", "run"]).done();
    for resolution in ["lattice", "volume", "5.0"] {
        let shared = ["--interfaces", "shared", "--resolution", resolution];
        folder
            .yawara(&[&["mesh", "run", "-o", "w.glb", "--frame", "all", "--color", "strain"], &shared[..]].concat())
            .done();
        folder.yawara(&[&["mesh", "run", "-o", "w.vtp"], &shared[..]].concat()).done();
        let mut reader = GltfReader::open(&folder.path("w.glb")).unwrap();
        let last = reader.frames() - 1;
        let walls: BTreeMap<String, TriangleMesh> =
            reader.read_frame(last).unwrap().into_iter().map(|wall| (wall.name, wall.mesh)).collect();
        let names: BTreeSet<&str> = walls.keys().map(|name| name.split(' ').next().unwrap()).collect();
        assert!(names.contains("liver|vessels") && names.contains("liver|outside"), "{names:?}");
        // The walls that name an organ close it, by their places alone.
        for organ in ["liver", "vessels"] {
            let sides = walls.iter().filter_map(|(name, mesh)| {
                let (inside, outside) = name.split(' ').next()?.split_once('|')?;
                if inside == organ { Some(mesh.clone()) } else { (outside == organ).then(|| flipped(mesh)) }
            });
            let report = check(&weld(&sides.flat_map(|mesh| soup(&mesh)).collect::<Vec<_>>(), 0.0));
            assert!(
                report.is_closed() && report.is_oriented() && report.volume_mm3 > 1e3,
                "{resolution}, {organ}: {report}"
            );
        }
        let vtp = String::from_utf8_lossy(&folder.read("w.vtp")).into_owned();
        assert!(vtp.contains("region_names") && vtp.contains("Name=\"inside\"") && vtp.contains("Name=\"outside\""));
    }
    folder.yawara(&["mesh", "run", "-o", "one.glb", "--interfaces", "shared", "--organ", "vessels"]).done();
    for care in [["--tidy"].as_slice(), &["--triangles", "500"], &["--max-error", "1"]] {
        let call = [&["mesh", "run", "-o", "no.glb", "--interfaces", "shared"], care].concat();
        folder.yawara(&call).refused(&["--max-error", "--interfaces separate"]);
    }
    assert!(!folder.path("no.glb").exists());
}
