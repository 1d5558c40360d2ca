//! What `info` says of a scene before it is run.

use serde_json::Value;

use crate::support::{CUBE, Folder};

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

#[track_caller]
fn near(found: &Value, expected: f64) {
    let found = number(found);
    assert!((found / expected - 1.0).abs() < 1e-4, "{found} is not {expected}");
}

/// By hand, for k = 7.5 N/m at 6 mm: k/h = 1250 Pa.
#[test]
fn a_paper_scene_amounts_to_a_solid_in_every_direction() {
    let folder = Folder::new();
    folder.write("cube.toml", CUBE);
    let before = folder.everything();
    let facts = folder.yawara(&["info", "cube.toml", "--json"]).done().json();
    assert_eq!(
        [&facts["particles"], &facts["springs"], &facts["cells"]].map(Value::as_u64),
        [1000, 10476, 729].map(Some)
    );
    assert_eq!([&facts["steps"], &facts["frames"]].map(Value::as_u64), [40, 4].map(Some));
    assert_eq!(facts["dt_is_from"], "scene");
    near(&facts["dt_s"], 5e-4);
    near(&facts["duration_s"], 0.02);
    // 26 springs and dampers on an inner particle: a dt^2 + 2 b dt = 4 is what can be promised without looking closer; the
    // true limit is never below, and above by less than 2.
    let (a, b): (f64, f64) = (2.0 * 26.0 * 7.5 / 2.3e-4, 2.0 * 26.0 * 1e-3 / 2.3e-4);
    let sharper = number(&facts["stable_dt_s"]) / (4.0 / (b + (b * b + 4.0 * a).sqrt()));
    assert!((1.0..2.0).contains(&sharper), "{sharper}");
    near(&facts["memory_mb"], number(&facts["bytes_per_particle"]) * 1e-3);
    assert!(number(&facts["estimated_time_s"]) > 0.0 && facts["estimated_from_steps"].as_u64() >= Some(3));
    let effects = &facts["effects"];
    assert_eq!((effects["dampers"].as_bool(), effects["volume_term"].as_bool()), (Some(true), Some(false)));
    assert_eq!(effects["operations"].to_string(), r#"{"cut":1,"fix":1,"force":1}"#);

    let organ = &facts["organs"][0];
    assert_eq!((organ["name"].as_str(), organ["particles"].as_u64()), (Some("cube"), Some(1000)));
    let solid = &organ["solid"];
    assert_eq!(solid["isotropic"], false);
    near(&solid["density_kg_per_m3"], 2.3e-4 / 6e-3_f64.powi(3));
    near(&solid["anisotropy"], 7.0 / 3.0);
    near(&solid["viscosity_pa_s"], 2.7 * 1e-3 / 6e-3);
    near(&solid["c_p_m_per_s"], (13.0 / 3.0 * 1250.0 / number(&solid["density_kg_per_m3"])).sqrt());
    for (direction, modulus) in [2.7, 189.0 / 43.0, 189.0 / 34.0].into_iter().enumerate() {
        near(&solid["directions"][direction]["youngs_modulus_pa"], modulus * 1250.0);
    }
    folder.yawara(&["info", "cube.toml"]).done().prints(&[
        "1000 particles, 10476 springs, 729 cells",
        "as the scene asks; 0.20 of the stable bound",
        "springs, dampers, 1 cut, 1 fixed region, 1 force",
        "an estimate",
        "cube: not isotropic",
        "[100]  3375",
        "[111]  6949",
    ]);
    // Nothing is written.
    assert!(folder.everything() == before);

    // The estimate of the disk holds what a run takes there, lists and JSON aside.
    folder.yawara(&["run", "cube.toml", "-o", "run"]).done();
    let arrays = folder.tree("run/arrays.zarr");
    let chunks = arrays.iter().filter(|(name, _)| name.starts_with("frames/displacement/c."));
    let bytes: usize = chunks.map(|(_, bytes)| bytes.len()).sum();
    assert!(bytes > 0 && (bytes as f64) < 1e6 * number(&facts["disk_mb_at_most"]), "{bytes}");
}

#[test]
fn tissue_is_what_was_asked_for_and_waves_run_through_it() {
    let folder = Folder::new();
    let tissue = CUBE
        .replace("model = \"paper\"", "model = \"tissue\"")
        .replace("stiffness = 7.5\ndamping = 1e-3\nmass = 2.3e-4", "youngs_modulus = 5e3\ndensity = 1060")
        .replace("steps = 40\ndt = 5e-4", "duration = 0.02");
    folder.write("cube.toml", format!("{tissue}\n[gravity]\nacceleration = [0, 0, -9.81]\n"));
    let facts = folder.yawara(&["info", "cube.toml", "--json"]).done().json();
    assert_eq!(facts["dt_is_from"], "stable_dt");
    assert!(number(&facts["dt_s"]) <= 0.8 * number(&facts["stable_dt_s"]));
    let solid = &facts["organs"][0]["solid"];
    assert_eq!(solid["isotropic"], true);
    near(&solid["youngs_modulus_pa"], 5e3);
    near(&solid["density_kg_per_m3"], 1060.0);
    let nu = number(&solid["poissons_ratio"]);
    let (lambda, mu) = (5e3 * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), 5e3 / (2.0 * (1.0 + nu)));
    near(&solid["c_p_m_per_s"], ((lambda + 2.0 * mu) / 1060.0).sqrt());
    near(&solid["c_s_m_per_s"], (mu / 1060.0).sqrt());
    let text = folder.yawara(&["info", "cube.toml"]).done().prints(&[
        "gravity 9.81 m/s^2",
        "chosen; at most 0.8",
        "c_P [m/s]",
    ]);
    assert!(!text.stdout.contains("not isotropic"), "{}", text.stdout);

    // A scene that diverges at once says so, and one whose region is empty cannot be run.
    folder.write("wild.toml", format!("{tissue}\n[gravity]\nacceleration = [0, 0, -1e30]\n"));
    let wild =
        folder.yawara(&["info", "wild.toml", "--json"]).done().says(&["warning: no time can be estimated", "diverged"]);
    assert!(wild.json()["estimated_time_s"].is_null());
    folder.write("empty.toml", tissue.replace("point = [0, 0, -24]", "point = [0, 0, -240]"));
    folder.yawara(&["info", "empty.toml"]).refused(&["`table`", "selects no particle"]);
}

#[test]
fn contact_of_tissue_with_itself_is_told() {
    let folder = Folder::new();
    folder.write("cube.toml", format!("{CUBE}\n[self_contact]\nfriction = 0.25\n"));
    let facts = folder.yawara(&["info", "cube.toml", "--json"]).done().json();
    assert_eq!(facts["effects"]["operations"]["self_contact"], 1);
    assert_eq!(
        (&facts["self_contact"]["friction"], &facts["self_contact"]["organs"][0]),
        (&0.25.into(), &"cube".into())
    );
    // All of the cube's 1000 but the 512 inside, at least; what the blade has reached is not counted on.
    assert!(facts["self_contact"]["surface_particles"].as_u64() >= Some(488));
    folder.yawara(&["info", "cube.toml"]).done().prints(&["contact of tissue with itself", "friction 0.25"]);
    folder.write("plain.toml", CUBE);
    assert!(folder.yawara(&["info", "plain.toml", "--json"]).done().json()["self_contact"].is_null());
    folder.yawara(&["run", "cube.toml", "-o", "run"]).done().says(&["`self contact` begins"]);
}

#[test]
fn what_tissue_cannot_enter_is_listed() {
    let folder = Folder::new();
    let tool = "[[tool]]\nname = \"ball\"\nshape = { sphere = { center = [0, 0, 44], radius = 12.5 } }\n\
                path = [[0, 0, 0], [0, 0, -4]]\nfrom = 0.005\nto = 0.02\nfriction = 0.2\n";
    let plane = "[[plane]]\npoint = [0, 0, -40]\nnormal = [0, 0, 1]\n";
    folder.write("cube.toml", format!("{CUBE}\n{plane}{tool}"));
    let facts = folder.yawara(&["info", "cube.toml", "--json"]).done().json();
    let [plane, ball] = [&facts["obstacles"][0], &facts["obstacles"][1]];
    assert_eq!((plane["name"].as_str(), plane["until_s"].is_null()), (Some("plane 1"), true));
    assert_eq!(ball["is"]["tool"]["shape"]["sphere"]["radius_mm"], 12.5);
    assert_eq!((&ball["from_s"], &ball["is"]["tool"]["friction"]), (&0.005.into(), &0.2.into()));
    assert_eq!(
        (&facts["effects"]["operations"]["tool"], &facts["effects"]["operations"]["plane"]),
        (&1.into(), &1.into())
    );
    folder.yawara(&["info", "cube.toml"]).done().prints(&[
        "plane 1: plane through (0, 0, -40) mm, tissue towards (0, 0, 1), no friction",
        "ball: sphere of radius 12.5 mm at (0, 0, 44) mm, moves by (0, 0, -4) mm until 0.02 s, from 0.005 s, friction 0.2",
    ]);
    folder
        .yawara(&["run", "cube.toml", "-o", "run"])
        .done()
        .says(&["`ball`: force of the tissue on it", "series obstacle_2"]);

    folder.write("thin.toml", format!("{CUBE}\n{}", tool.replace("12.5", "5")));
    folder.yawara(&["info", "thin.toml"]).done().says(&["warning: `ball` is 10.000 mm thick", "6.000 mm apart"]);

    // An open mesh is refused with its tool.
    let mesh = tool.replace("sphere = { center = [0, 0, 44], radius = 12.5 }", "mesh = { file = \"tool.stl\" }");
    folder.write("mesh.toml", format!("{CUBE}\n{mesh}"));
    folder.yawara(&["info", "mesh.toml"]).refused(&["the mesh of tool `ball`", "tool.stl"]);
    let facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 9 0 0\nvertex 0 9 0\nendloop\nendfacet\n";
    folder.write("tool.stl", format!("solid open\n{facet}endsolid open\n"));
    folder.yawara(&["run", "mesh.toml", "-o", "other"]).refused(&["`ball`", "tool.stl", "it is not closed: 3 edges"]);
}

#[test]
fn an_organ_two_particles_thick_has_no_bulk() {
    let folder = Folder::new();
    let everywhere = "box = { min = [-99, -99, -99], max = [99, 99, 99] }";
    let thin = CUBE
        .replace("[lattice]", "[lattice]\npitch = 32")
        .replace("half_space = { point = [0, 0, -24], normal = [0, 0, -1] }", everywhere)
        .replace("box = { min = [-31, 1, 15], max = [31, 31, 31] }", everywhere);
    folder.write("thin.toml", thin);
    let facts = folder.yawara(&["info", "thin.toml", "--json"]).done().json();
    assert_eq!((facts["particles"].as_u64(), facts["organs"][0]["solid"].is_null()), (Some(8), true));
    folder.yawara(&["info", "thin.toml"]).done().prints(&["-: too thin for a material of its own"]);
}

#[test]
fn what_acts_besides_springs_is_listed() {
    let folder = Folder::new();
    let fibres = "youngs_modulus = 5e3\ndensity = 1060\nfibres = { direction = [0, 0, 2], modulus = 2e4 }";
    let tissue = CUBE
        .replace("model = \"paper\"", "model = \"tissue\"")
        .replace("stiffness = 7.5\ndamping = 1e-3\nmass = 2.3e-4", fibres)
        .replace("steps = 40\ndt = 5e-4", "duration = 0.02");
    let more = "[drag]\nrate = 2.5\n[[pressure]]\nregion = { organ = \"cube\" }\npressure = 200\n";
    folder.write("cube.toml", format!("{tissue}\n{more}"));
    folder.yawara(&["info", "cube.toml"]).done().prints(&[
        "drag 2.5 /s",
        "1 pressure",
        "1 fibrous organ",
        "cube: fibres along [0, 0, 1] add 20000 Pa to E where it is drawn out along them",
    ]);
    let facts = folder.yawara(&["info", "cube.toml", "--json"]).done().json();
    near(&facts["effects"]["drag_per_s"], 2.5);
    near(&facts["organs"][0]["fibres"]["modulus_pa"], 2e4);
    assert_eq!(facts["effects"]["fibrous_organs"], 1);
    // Taut fibres shorten the step.
    folder.write("plain.toml", tissue.replace("fibres = { direction = [0, 0, 2], modulus = 2e4 }", ""));
    let plain = folder.yawara(&["info", "plain.toml", "--json"]).done().json();
    let shorter = number(&facts["stable_dt_s"]) / number(&plain["stable_dt_s"]);
    assert!(shorter < 0.8, "{shorter}");
    assert!(plain["effects"]["drag_per_s"].is_null());
}

#[test]
fn an_integrator_is_named_before_and_in_the_run() {
    let folder = Folder::new();
    let scene = CUBE.replace("dt = 5e-4", "dt = 5e-4\nintegrator = \"bogacki_shampine\"\ntolerance = 1e-3");
    folder.write("cube.toml", scene);
    let name = "bogacki_shampine: order 3 with error control, four force evaluations per step";
    folder.yawara(&["info", "cube.toml"]).done().prints(&[name, "tolerance 0.001 mm"]);
    let facts = folder.yawara(&["info", "cube.toml", "--json"]).done().json();
    assert_eq!(facts["integrator"]["method"], "bogacki_shampine");
    near(&facts["integrator"]["tolerance_mm"], 1e-3);
    folder.yawara(&["run", "cube.toml", "-o", "out"]).done().says(&[name]);
    folder.write("plain.toml", CUBE);
    folder.yawara(&["info", "plain.toml"]).done().prints(&["symplectic_euler: order 1, one force evaluation per step"]);
}
