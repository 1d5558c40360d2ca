//! Scenes as files: those that ship resolve, those that are wrong are refused with a message that helps.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::{Path, PathBuf};

use yawara::dynamics::integrator::Method;
use yawara::geometry::{Point3, Vector3};
use yawara::lattice::region::Region;
use yawara::material::{ct_density, library};
use yawara::run::label_lookup::Files;
use yawara::scene::resolved::{
    Action, Body, Damping, Model, Operation, PhantomKind, Property, Scene, TimeSpec, VolumeSource, VoxelSelection,
};
use yawara::scene::{self, Caution, LabelLookup, Problem, SceneError, Warning};

/// The names that the scenes of the real abdomen use.
const ABDOMEN: [&str; 20] = [
    "background",
    "liver",
    "gallbladder",
    "stomach",
    "spleen",
    "kidney_right",
    "kidney_left",
    "colon",
    "small_bowel",
    "duodenum",
    "vertebrae_L5",
    "vertebrae_L4",
    "vertebrae_L3",
    "vertebrae_L2",
    "vertebrae_L1",
    "vertebrae_T12",
    "vertebrae_T11",
    "sacrum",
    "hip_left",
    "hip_right",
];

/// Label names without files: a healthy, a broken and an empty table, known by their file names; the phantoms have their
/// own.
struct Names;

impl LabelLookup for Names {
    fn in_file(&self, path: &Path) -> Result<BTreeMap<String, u16>, Box<dyn Error + Send + Sync>> {
        match path.file_name().and_then(|name| name.to_str()) {
            Some("names.tsv") => Ok(table(&["background", "liver", "spleen"])),
            Some("labels.tsv") => Ok(table(&ABDOMEN)),
            Some("empty.tsv") => Ok(BTreeMap::new()),
            _ => Err("line 3 of broken.tsv has no name".into()),
        }
    }

    fn of_phantom(&self, kind: PhantomKind) -> BTreeMap<String, u16> {
        Files.of_phantom(kind)
    }
}

fn table(names: &[&str]) -> BTreeMap<String, u16> {
    names.iter().map(|name| (*name).to_owned()).zip(0..).collect()
}

fn fixtures(folder: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(folder)
}

/// The TOML files of a folder, by name.
fn toml_files(folder: &Path) -> Vec<PathBuf> {
    let entries = folder.read_dir().unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<PathBuf> = entries.filter(|path| path.extension().is_some_and(|e| e == "toml")).collect();
    files.sort();
    files
}

/// A small correct scene in model `tissue`, with more after it.
fn small(more: &str) -> String {
    "[volume]\nlabels = \"seg.nii.gz\"\n[[organ]]\nname = \"liver\"\nlabel = 5\nyoungs_modulus = 5e3\ndensity = 1060\n\
     [time]\nduration = 0.4\n"
        .to_owned()
        + more
}

fn tissue(youngs_modulus: Property, poissons_ratio: f64, density: f64, damping: Damping) -> Body {
    Body::Tissue { youngs_modulus, poissons_ratio, density: Property::Constant(density), damping }
}

fn parse(text: &str) -> (Scene, Vec<Warning>) {
    let parsed = scene::parse(text, Path::new("s.toml"), Path::new("/data"), &Names);
    parsed.unwrap_or_else(|error| panic!("{error}\n{text}"))
}

#[test]
fn every_bad_scene_is_refused_with_its_message() {
    let files = toml_files(&fixtures("bad/scenes"));
    for path in &files {
        let text = std::fs::read_to_string(path).unwrap();
        let error = scene::load(path, &Names).expect_err(&format!("{} was accepted", path.display()));
        let SceneError::Invalid { problems } = &error else { panic!("{}: {error}", path.display()) };
        let message = error.to_string();
        let expected: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("# expect: ")).collect();
        assert!(!expected.is_empty(), "{} expects nothing", path.display());
        for part in expected {
            assert!(message.contains(part), "{}: no \"{part}\" in\n{message}", path.display());
        }
        for problem in problems {
            let shown = problem.to_string();
            let place = &problem.place;
            assert!(shown.starts_with(&format!("{}:{}:{}: ", path.display(), place.line, place.column)), "{shown}");
            assert_eq!(text.lines().nth(place.line - 1), Some(place.text.as_str()), "{shown}");
            assert!(shown.ends_with('^'), "{shown}");
        }
        let several = path.ends_with("several_faults.toml");
        assert_eq!(problems.len(), if several { 5 } else { 1 }, "{message}");
    }
    assert_eq!(files.len(), BAD_SCENES);
}
const BAD_SCENES: usize = 200;

#[test]
fn every_shipped_scene_resolves_without_a_warning_and_survives_json() {
    let files = toml_files(&fixtures("scenes"));
    for path in &files {
        let (scene, warnings) = scene::load(path, &Names).unwrap_or_else(|error| panic!("{error}"));
        assert!(warnings.is_empty(), "{}", warnings[0]);
        let json = serde_json::to_string(&scene).unwrap();
        assert_eq!(serde_json::from_str::<Scene>(&json).unwrap(), scene, "{}", path.display());
        if let VolumeSource::Files { image, labels } = &scene.volume {
            assert!(image.iter().chain(labels).all(|path| path.is_absolute()), "{:?}", scene.volume);
        }
        if scene.lattice.model == Model::Paper {
            check_paper_step(&scene, path);
        }
    }
    assert_eq!(files.len(), 17);
    let quickstart = scene::load(&fixtures("scenes/quickstart.toml"), &Names).unwrap().0;
    assert_eq!(parse(scene::QUICKSTART).0, quickstart);
}

/// The step of a `paper` scene must suit its springs and dampers: no eigenvalue of the 26-neighbour stiffness matrix
/// exceeds twice its row sum 26 k, the same holds for the dampers, and symplectic Euler with the damper at the old
/// velocity needs dt^2 w^2 + 2 dt c w^2 / k < 4.
fn check_paper_step(scene: &Scene, path: &Path) {
    let dt = scene.time.dt.expect("scenes of the paper name their step");
    for organ in &scene.organs {
        let Body::Paper { stiffness, damping, mass } = organ.body else { panic!("{}", path.display()) };
        let reach = dt * dt * 52.0 * stiffness / mass + 2.0 * dt * 52.0 * damping / mass;
        assert!(reach < 4.0, "{}: {reach}", path.display());
    }
}

#[test]
fn shipped_scenes_find_their_volumes() {
    let data = std::env::var_os("YAWARA_DATA").map_or(fixtures("../../shared/data"), PathBuf::from);
    if !data.is_dir() {
        eprintln!("SKIPPED: no real volumes in {}; set YAWARA_DATA", data.display());
        return;
    }
    let mut files = 0;
    for path in toml_files(&fixtures("scenes")) {
        let (scene, _) = scene::load(&path, &Names).unwrap();
        if let VolumeSource::Files { image, labels } = scene.volume {
            for file in image.iter().chain(&labels) {
                let below = file.iter().skip_while(|part| *part != "data").skip(1).collect::<PathBuf>();
                assert!(data.join(&below).is_file(), "{}: no {}", path.display(), data.join(below).display());
                files += 1;
            }
        }
    }
    assert_eq!(files, 9);
}

#[test]
fn what_is_left_out_has_defaults() {
    let (scene, warnings) = parse(&small("[[pull]]\nregion = { organ = \"liver\" }\nforce = [0, -3, 0]\n"));
    assert!(warnings.is_empty());
    assert_eq!(scene.volume, VolumeSource::Files { image: None, labels: Some("/data/seg.nii.gz".into()) });
    assert_eq!((scene.lattice.model, scene.lattice.pitch), (Model::Tissue, None));
    assert_eq!(scene.organs[0].voxels, VoxelSelection::Labels(vec![5]));
    assert_eq!(scene.organs[0].body, tissue(Property::Constant(5e3), 0.25, 1060.0, Damping::Ratio(0.1)));
    assert_eq!(
        scene.time,
        TimeSpec {
            duration: 0.4,
            frames: 30,
            dt: None,
            integrator: Method::SymplecticEuler,
            tolerance: None,
            exact: false
        }
    );
    assert_eq!((scene.gravity, scene.drag), (Vector3::zeros(), None));
    let action = Action::Force { region: Region::Organ(0), force: Vector3::new(0.0, -3.0, 0.0), ramp: 0.0 };
    let pull = Operation { name: "pull 1".into(), from: 0.0, until: f64::INFINITY, action };
    assert_eq!(scene.operations, [pull]);

    let phantom = small("").replace("labels = \"seg.nii.gz\"", "phantom = \"beam\"");
    assert_eq!(parse(&phantom).0.volume, VolumeSource::Phantom { kind: PhantomKind::Beam, spacing: 3.0, seed: 1 });
}

/// What the first organ of the small scene is made of, given other keys.
fn body(keys: &str) -> (Body, Vec<String>) {
    let pull = "[[pull]]\nregion = { organ = \"liver\" }\nforce = [0, -3, 0]\n";
    let text = small(pull).replace("youngs_modulus = 5e3\ndensity = 1060\n", keys);
    let (scene, warnings) = parse(&text.replace("[volume]", "[volume]\nimage = \"ct.nii.gz\""));
    (scene.organs[0].body.clone(), warnings.iter().map(ToString::to_string).collect())
}

#[test]
fn a_material_gives_numbers_and_keys_replace_them() {
    use Property::{Constant, FromFile, FromHu};
    let liver = library::tissue("liver").unwrap();
    let (modulus, ratio, density) = (Constant(liver.youngs_modulus), liver.poissons_ratio, liver.density);
    let damped = Damping::Ratio(0.1);
    let bowel = library::tissue("bowel").unwrap();
    let map = "youngs_modulus = { hu = [[-100, 2e3], [0, 5e3]] }\n";
    let cases = [
        ("", tissue(modulus.clone(), ratio, density, damped)),
        ("youngs_modulus = 7e3\n", tissue(Constant(7e3), ratio, density, damped)),
        ("density = 1000\n", tissue(modulus.clone(), ratio, 1000.0, damped)),
        ("poissons_ratio = 0.25\n", tissue(modulus.clone(), 0.25, density, damped)),
        ("poissons_ratio = 0.49\n", tissue(modulus.clone(), 0.49, density, damped)),
        ("damping_ratio = 0\n", tissue(modulus.clone(), ratio, density, Damping::Ratio(0.0))),
        ("viscosity = 15\n", tissue(modulus.clone(), ratio, density, Damping::Viscosity(15.0))),
        (map, tissue(FromHu(vec![[-100.0, 2e3], [0.0, 5e3]]), ratio, density, damped)),
        (
            "youngs_modulus = { file = \"e.nii.gz\" }\n",
            tissue(FromFile("/data/e.nii.gz".into()), ratio, density, damped),
        ),
        ("youngs_modulus.file = \"/e.nii\"\n", tissue(FromFile("/e.nii".into()), ratio, density, damped)),
    ];
    for (keys, expected) in cases {
        assert_eq!(body(&format!("material = \"liver\"\n{keys}")), (expected, Vec::new()), "{keys}");
    }
    let intestine = tissue(Constant(bowel.youngs_modulus), bowel.poissons_ratio, bowel.density, damped);
    assert_eq!(body("material = \"Intestine\"\n").0, intestine);
    assert_eq!(body(&format!("{map}density = 900\n")).1, [""; 0]);

    // A phantom has CT numbers of its own.
    let phantom = small("").replace("labels = \"seg.nii.gz\"", "phantom = \"abdomen\"");
    let body = parse(&phantom.replace("youngs_modulus = 5e3\n", map)).0.organs[0].body.clone();
    assert_eq!(body, tissue(FromHu(vec![[-100.0, 2e3], [0.0, 5e3]]), 0.25, 1060.0, damped));
}

/// A density has the forms of a modulus, for soft organs and for rigid ones that move.
#[test]
fn a_density_is_a_number_a_map_or_a_volume() {
    let published = ct_density::density_map("schneider_2000").unwrap().points.to_vec();
    let points = vec![[-1000.0, 1.2], [-100.0, 930.0], [50.0, 1050.0]];
    for (written, expected) in [
        ("density = 1000", Property::Constant(1000.0)),
        ("density = { hu = [[-1000, 1.2], [-100, 930], [50, 1050]] }", Property::FromHu(points)),
        ("density = { hu = \"schneider_2000\" }", Property::FromHu(published.clone())),
        ("density.hu = \"Schneider_2000\"", Property::FromHu(published)),
        ("density = { file = \"d.nii.gz\" }", Property::FromFile("/data/d.nii.gz".into())),
    ] {
        // Also beside a material, whose density it replaces, and without a word about air being light.
        let (soft, warnings) = body(&format!("material = \"liver\"\n{written}\n"));
        let Body::Tissue { density, .. } = soft else { panic!("{soft:?}") };
        assert_eq!((density, warnings), (expected.clone(), Vec::new()), "{written}");
        let (rigid, warnings) = body(&format!("rigid = true\nmaterial = \"bone\"\n{written}\n"));
        assert_eq!((rigid, warnings), (Body::Rigid { density: Some(expected) }, Vec::new()), "{written}");
    }
    let (_, warnings) = body("youngs_modulus = 5e3\ndensity = { hu = [[-100, 0.93], [50, 1050]] }\n");
    assert!(
        warnings.len() == 1 && warnings[0].contains("organ[0].density.hu[0][1]: 0.93 kg/m3 is outside"),
        "{warnings:?}"
    );
}

#[test]
fn every_material_of_the_library_can_be_named_without_a_warning() {
    for known in library::tissues() {
        let (body, warnings) = body(&format!("material = \"{}\"\n", known.name));
        let modulus = Property::Constant(known.youngs_modulus);
        assert_eq!(body, tissue(modulus, known.poissons_ratio, known.density, Damping::Ratio(0.1)));
        assert!(warnings.is_empty(), "{}", warnings[0]);
    }
}

#[test]
fn a_rigid_organ_with_a_density_is_free_and_one_without_holds() {
    let bone = library::tissue("bone").unwrap().density;
    for (keys, density) in [
        ("", None),
        ("density = 1500\n", Some(1500.0)),
        ("material = \"bone\"\n", Some(bone)),
        ("material = \"bone\"\ndensity = 1500\n", Some(1500.0)),
    ] {
        let (body, warnings) = body(&format!("rigid = true\n{keys}"));
        let density = density.map(Property::Constant);
        assert_eq!((body, warnings), (Body::Rigid { density }, Vec::new()), "{keys}");
    }
    let fall = "[[organ]]\nname = \"rib\"\nlabel = 6\nrigid = true\n[gravity]\nacceleration = [0, 0, -9.81]\n";
    assert!(parse(&small(fall)).1.is_empty());
    let free = fall.replace("rigid = true", "rigid = true\ndensity = 1500");
    assert!(matches!(parse(&small(&free)).1[..], [Warning { what: Caution::FreeFall, .. }]));
}

#[test]
fn units_become_si_and_names_become_numbers() {
    let text = "[volume]\nphantom = \"abdomen\"\n[lattice]\nmodel = \"paper\"\npitch = 2.5\n\
        [[organ]]\nname = \"soft\"\nlabel = [\"Ribs\", \"liver\", 20]\nstiffness = 10\ndamping = 0\nmass = 1\n\
        color = \"#ffffff\"\n\
        [[organ]]\nname = \"hard\"\nhu = [300, 3000]\nrigid = true\n\
        [time]\nsteps = 20\ndt = 1e-3\n[gravity]\nacceleration = [0, -9.81, 0]\n";
    let (scene, warnings) = parse(text);
    assert!(warnings.is_empty(), "{}", warnings[0]);
    assert_eq!(scene.lattice.pitch, Some(0.0025));
    assert_eq!(scene.organs[0].voxels, VoxelSelection::Labels(vec![1, 6, 20]));
    assert_eq!(scene.organs[0].body, Body::Paper { stiffness: 10.0, damping: 0.0, mass: 1.0 });
    assert_eq!(scene.organs[0].color, [1.0; 3]);
    assert_eq!(scene.organs[1].voxels, VoxelSelection::Hu { min: 300.0, max: 3000.0 });
    assert_eq!(scene.organs[1].body, Body::Rigid { density: None });
    assert_eq!(
        scene.time,
        TimeSpec {
            duration: 0.02,
            frames: 20,
            dt: Some(1e-3),
            integrator: Method::SymplecticEuler,
            tolerance: None,
            exact: false
        }
    );
    assert_eq!(scene.gravity, Vector3::new(0.0, -9.81, 0.0));
}

#[test]
fn steps_times_dt_allow_one_frame_each() {
    // Floating point makes 100 * 5e-4 / 5e-4 and 0.3 / 1e-3 a little less than whole in places.
    for (steps, dt) in [(100u32, 5e-4), (300, 1e-3), (7, 0.1), (1, 3e-5), (49, 1.0 / 49.0)] {
        let time = format!("steps = {steps}\ndt = {dt}\nframes = {steps}\n");
        let (scene, _) = parse(&small("").replace("duration = 0.4\n", &time));
        assert_eq!(scene.time.frames, steps as usize);
        let time = format!("duration = {}\ndt = {dt}\nframes = {steps}\n", f64::from(steps) * dt);
        assert_eq!(parse(&small("").replace("duration = 0.4\n", &time)).0.time, scene.time);
    }
}

#[test]
fn the_time_line_is_in_order_and_releases_end_it() {
    let more = "[[release]]\nof = \"hook\"\nat = 0.3\n[[release]]\nof = \"fix 1\"\nat = 0.35\n\
        [[push]]\nregion = { organ = \"liver\" }\nforce = [1, 0, 0]\nramp = 0.02\nfrom = 0.1\nto = 0.2\n\
        [[pull]]\nname = \"hook\"\nregion = { organ = \"liver\" }\npath = [[0, 0, 0], [0, 5, 0]]\nfrom = 0.1\nto = 0.2\n\
        [[cut]]\nblade = [[-60, 0, 0], [60, 0, 0]]\npath = [[0, 80, 0], [0, 0, 0]]\nfrom = 0.05\nto = 0.15\n\
        [[fix]]\nregion = { not = { nearest = { point = [1, 2, 3] } } }\n\
        [[pull]]\nregion = { organ = \"liver\" }\npath = [[0, 0, 0], [0, 5, 0]]\nfrom = 0.2\n";
    let (scene, warnings) = parse(&small(more));
    assert!(warnings.is_empty(), "{}", warnings[0]);
    let line: Vec<_> = scene.operations.iter().map(|o| (o.name.as_str(), o.from, o.until)).collect();
    let endless = f64::INFINITY;
    let expected = [("fix 1", 0.0, 0.35), ("cut 1", 0.05, 0.15), ("push 1", 0.1, 0.2), ("hook", 0.1, 0.3)];
    assert_eq!(line[..4], expected);
    assert_eq!(line[4], ("pull 2", 0.2, endless));
    let arrivals = scene.operations.iter().filter_map(|o| match &o.action {
        Action::Grab { arrive, path, .. } => Some((*arrive, path.len())),
        _ => None,
    });
    // Without `to` a grab arrives at the end of the run.
    assert_eq!(arrivals.collect::<Vec<_>>(), [(0.2, 2), (0.4, 2)]);
    let nearest = Region::Nearest { point: Point3::new(1.0, 2.0, 3.0), count: 1 };
    assert_eq!(scene.operations[0].action, Action::Fix { region: Region::Not(Box::new(nearest)) });
    let Action::Cut { blade, path } = &scene.operations[1].action else { panic!("{:?}", scene.operations[1]) };
    assert_eq!((blade[0], path[0]), (Point3::new(-60.0, 0.0, 0.0), Vector3::new(0.0, 80.0, 0.0)));
}

#[test]
fn oddities_are_warned_about_with_their_place() {
    let pull = "[[pull]]\nregion = { organ = \"liver\" }\nforce = [1, 0, 0]\n";
    let grab = "[[pull]]\nregion = { organ = \"liver\" }\npath = [[0, 0, 0], [1, 0, 0]]\n";
    let cut = "[[cut]]\nblade = [[-60, 0, 0], [60, 0, 0]]\npath = [[0, 80, 0], [0, 0, 0]]\n";
    let fall = "[gravity]\nacceleration = [0, 0, -9.81]\n";
    let hu =
        "[[organ]]\nname = \"b\"\nhu = [0, 50]\nrigid = true\n[[organ]]\nname = \"c\"\nhu = [50, 60]\nrigid = true\n";
    // A tool that moves moves the organs; one that stands still, or a plane, does not. A plane catches what falls.
    let tool = "[[tool]]\nshape = { sphere = { center = [0, 0, 0], radius = 9 } }\n";
    let plane = "[[plane]]\npoint = [0, 0, 0]\nnormal = [0, 0, 1]\n";
    let path = "path = [[0, 0, 9], [0, 0, 0]]\n";
    for quiet in [small(&format!("{tool}{path}")), small(&format!("{fall}{plane}"))] {
        assert!(parse(&quiet).1.is_empty(), "{}", parse(&quiet).1[0]);
    }
    let light = small(pull).replace("1060", "1.06").replace("5e3", "5");
    let with_image = small(&format!("{hu}{pull}")).replace("[volume]", "[volume]\nimage = \"ct.nii.gz\"");
    let cases = [
        (small(""), vec!["s.toml:1:1: nothing moves the organs"]),
        (small(fall), vec!["s.toml:10:1: gravity: nothing holds the organs"]),
        (small(&format!("{tool}{plane}")), vec!["s.toml:1:1: nothing moves the organs"]),
        (small(&format!("{tool}{path}from = 0.5\n")), vec!["tool[0].from: \"tool 1\" begins at 0.5 s"]),
        (small(&format!("{tool}{path}to = 0.5\n")), vec!["tool[0].to: \"tool 1\" is finished at 0.5 s"]),
        (small(&format!("{pull}from = 0.4\n")), vec!["s.toml:13:8: pull[0].from: \"pull 1\" begins at 0.4 s"]),
        (small(&format!("{pull}{cut}to = 0.5\n")), vec!["cut[0].to: \"cut 1\" is finished at 0.5 s", "ends at 0.4 s"]),
        (small(&format!("{grab}to = 0.5\n")), vec!["pull[0].to: \"pull 1\" is finished at 0.5 s"]),
        (small(&format!("{pull}ramp = 0.2\nto = 0.1\n")), vec!["ends at 0.1 s, before its full force at 0.2 s"]),
        (
            small(&format!("{grab}[[release]]\nof = \"pull 1\"\nat = 0.1\n")),
            vec!["pull[0]: \"pull 1\" ends at 0.1 s, before the end of its path at 0.4 s"],
        ),
        (light, vec!["organ[0].youngs_modulus: 5 Pa is outside", "organ[0].density: 1.06 kg/m3 is outside", "g/cm3"]),
        (
            small(pull).replace("density = 1060", "density = 1060\npoissons_ratio = 0.1"),
            vec!["s.toml:8:18: organ[0].poissons_ratio: Poisson's ratio 0.1 is below 0.25", "small strain only"],
        ),
        (
            with_image.replace("= 5e3", "= { hu = [[0, 2], [9, 2e3]] }").replace("hu = [50, 60]", "hu = [51, 60]"),
            vec!["organ[0].youngs_modulus.hu[0][1]: 2 Pa is outside what tissue has"],
        ),
        (with_image, vec!["organ[2].hu: [50, 60] HU overlaps the range of organ \"b\""]),
    ];
    for (text, expected) in &cases {
        let (_, warnings) = parse(text);
        let shown = warnings.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n");
        for part in expected {
            assert!(shown.contains(part), "no \"{part}\" in\n{shown}");
        }
        let two = shown.contains("g/cm3");
        assert_eq!(warnings.len(), if two { 2 } else { 1 }, "{shown}");
    }
    assert!(matches!(parse(&small("")).1[0].what, Caution::NothingMoves));
}

#[test]
fn what_is_no_scene_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let message = |path: &Path| scene::load(path, &Names).unwrap_err().to_string();
    let missing = folder.path().join("missing.toml");
    assert!(matches!(scene::load(&missing, &Names), Err(SceneError::Read { .. })));
    assert!(message(&missing).contains("missing.toml: could not read the scene"));
    assert!(message(folder.path()).contains("could not read the scene"));
    let binary = write("ct.nii.gz", &[0x1f, 0x8b, 8, 0, 0xff, 0xfe]);
    assert!(matches!(scene::load(&binary, &Names), Err(SceneError::Read { .. })));
    for filler in [0xffu8, b'#'] {
        let long = write("long.toml", &vec![filler; (4 << 20) + 1]);
        assert!(message(&long).contains("long.toml: more than 4194304 bytes"), "{}", message(&long));
    }
    let empty = write("empty.toml", b"");
    let Err(SceneError::Invalid { problems }) = scene::load(&empty, &Names) else { panic!("accepted") };
    assert!(matches!(&problems[0].what, Problem::Missing { key, .. } if key == "volume"), "{}", problems[0]);
}

#[test]
fn regions_nested_without_end_are_refused() {
    let nested = |depth: usize| format!("{}{{ organ = \"liver\" }}{}", "{ not = ".repeat(depth), " }".repeat(depth));
    assert_eq!(parse(&small(&format!("[[fix]]\nregion = {}\n", nested(20)))).0.operations.len(), 1);
    for region in [format!(" = {}", nested(100_000)), format!("{}.organ = \"liver\"", ".not".repeat(100_000))] {
        let text = small(&format!("[[fix]]\nregion{region}\n"));
        let error = scene::parse(&text, Path::new("s.toml"), Path::new(""), &Names).unwrap_err().to_string();
        assert!(error.contains("recurs") && error.len() < 1000, "{error}");
    }
}

#[test]
fn broken_text_never_panics() {
    // Every shipped scene, cut off or with one character replaced at every place.
    let mut cases = 0;
    for path in toml_files(&fixtures("scenes")) {
        let text = std::fs::read_to_string(&path).unwrap();
        for (at, _) in text.char_indices().step_by(3) {
            for filler in ["", "\n", "é", "]", "\"", "1"] {
                let broken = format!("{}{filler}{}", &text[..at], &text[(at + 1).min(text.len())..]);
                for text in [broken.as_str(), &text[..at]] {
                    if let Err(error) = scene::parse(text, &path, Path::new(""), &Names) {
                        assert!(!error.to_string().is_empty());
                    }
                    cases += 1;
                }
            }
        }
    }
    assert!(cases > 10_000, "only {cases} cases");
}
