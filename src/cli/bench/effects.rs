//! `yawara bench effects`: what each effect of a scene costs, alone and in the usual company.
//!
//! Every case is a scene like any other and is stepped as a run steps it. Cases take turns, round after round, and each is
//! compared with the bare one of its own round: on a machine that others use, only neighbours in time can be compared.

use std::fmt::Write as _;
use std::path::Path;
use std::time::Duration;

use anyhow::{Context, bail};
use serde_json::{Value, json};

use super::super::args::BenchEffectsArguments;
use super::super::messages::out;
use crate::dynamics::World;
use crate::dynamics::timeline::Timeline;
use crate::plot::bars::{Bar, write_bars};
use crate::run::estimate::Pace;
use crate::run::inputs;
use crate::run::label_lookup::Files;
use crate::run::prepare::{Schedule, prepare};
use crate::scene::parse;

/// Edge of the cube [mm].
const EDGE_MM: f64 = 60.0;

/// What a case adds to the bare scene.
#[derive(Clone, Copy)]
struct Effect {
    name: &'static str,
    /// Keys of the organ; later ones replace those of [`BARE`].
    organ: &'static str,
    /// Keys of the time.
    time: &'static str,
    /// Whole tables.
    tables: &'static str,
}

const fn effect(name: &'static str) -> Effect {
    Effect { name, organ: "", time: "", tables: "" }
}

const fn of_organ(name: &'static str, organ: &'static str) -> Effect {
    Effect { organ, ..effect(name) }
}

const fn of_tables(name: &'static str, tables: &'static str) -> Effect {
    Effect { tables, ..effect(name) }
}

/// The cube is cut in two before the first step that is timed, and the halves are pushed against each other.
macro_rules! pressed_lips {
    () => {
        "[[cut]]\nblade = [[-40, 1, 0], [40, 1, 0]]\npath = [[0, 0, 40], [0, 0, -40]]\nto = 1e-9\n\
         [[push]]\nregion = { half_space = { point = [0, 25, 0], normal = [0, 1, 0] } }\nforce = [0, -1, 0]\n\
         [[push]]\nregion = { half_space = { point = [0, -25, 0], normal = [0, -1, 0] } }\nforce = [0, 1, 0]"
    };
}
const PRESSED_LIPS: &str = pressed_lips!();

/// Each effect alone, and contact of tissue with itself among what it is for.
const EFFECTS: [Effect; 20] = [
    of_tables("gravity", "[gravity]\nacceleration = [0, 0, -9.81]"),
    of_organ("dampers", "damping_ratio = 0.2"),
    of_organ("volume term", "poissons_ratio = 0.45"),
    of_organ("fibres", "fibres = { direction = [1, 1, 0], modulus = 1e4 }"),
    of_organ("relaxation", "relaxation = { ratio = 0.5, time = 0.2 }"),
    of_organ("plasticity", "plasticity = { yield_strain = 0.1 }"),
    of_organ("tearing", "tear_strain = 0.5"),
    of_tables("drag", "[drag]\nrate = 2.0"),
    of_tables("fix", "[[fix]]\nregion = { half_space = { point = [0, 0, -25], normal = [0, 0, -1] } }"),
    of_tables(
        "pull",
        "[[pull]]\nregion = { sphere = { center = [0, 0, 30], radius = 10 } }\npath = [[0, 0, 0], [0, 0, 5]]\nto = 1.0",
    ),
    of_tables(
        "pressure",
        "[[pressure]]\nregion = { half_space = { point = [0, 0, 25], normal = [0, 0, 1] } }\npressure = 100",
    ),
    of_tables("plane", "[[plane]]\npoint = [0, 0, -29]\nnormal = [0, 0, 1]\nfriction = 0.3"),
    of_tables(
        "tool",
        "[[tool]]\nshape = { sphere = { center = [0, 0, 45], radius = 20 } }\npath = [[0, 0, 0], [0, 0, -5]]\nto = 1.0\n\
         friction = 0.2",
    ),
    // Through half of the cube before the first step that is timed.
    of_tables("cut", "[[cut]]\nblade = [[-40, 0, 0], [40, 0, 0]]\npath = [[0, 0, 40], [0, 0, 0]]\nto = 1e-9"),
    of_tables("self contact", "[self_contact]\nfriction = 0.1"),
    of_tables("lips pressed together", PRESSED_LIPS),
    of_tables("lips pressed, self contact", concat!("[self_contact]\nfriction = 0.1\n", pressed_lips!())),
    of_tables("sleep, nothing moves", "[sleep]"),
    Effect { time: "exact = true", ..effect("exact arithmetic") },
    effect("nothing (noise)"),
];

/// The usual company: names of [`EFFECTS`].
const COMPANY: [(&str, &[&str]); 4] = [
    ("pull and sleep", &["pull", "sleep, nothing moves"]),
    ("tissue at rest", &["gravity", "dampers", "volume term", "fix"]),
    ("surgery", &["gravity", "dampers", "volume term", "fix", "cut", "tool"]),
    (
        "everything",
        &["gravity", "dampers", "volume term", "fibres", "drag", "fix", "pull", "pressure", "plane", "tool", "cut"],
    ),
];

/// Keys of the organ without any effect.
const BARE: [&str; 4] = ["youngs_modulus = 5e3", "poissons_ratio = 0.25", "density = 1060", "damping_ratio = 0"];

struct Case {
    name: String,
    world: World,
    timeline: Timeline,
    schedule: Schedule,
    /// Time of a step in each round [s].
    steps: Vec<f64>,
}

pub(super) fn effects(arguments: &BenchEffectsArguments) -> anyhow::Result<()> {
    let BenchEffectsArguments { n, rounds, json, ref output } = *arguments;
    if !(6..=120).contains(&n) || rounds == 0 {
        bail!("--n is {n} and --rounds {rounds}; expected cells along the edge from 6 to 120 and at least one round");
    }
    let mut cases = vec![case("springs (bare)", &[], n)?];
    for effect in &EFFECTS {
        cases.push(case(effect.name, &[*effect], n)?);
    }
    for (name, members) in COMPANY {
        let members: Vec<Effect> = EFFECTS.iter().copied().filter(|effect| members.contains(&effect.name)).collect();
        cases.push(case(name, &members, n)?);
    }
    for _ in 0..rounds {
        for case in &mut cases {
            let pace = Pace::measure(&mut case.world, &mut case.timeline, &case.schedule, Duration::from_millis(150))
                .with_context(|| format!("case \"{}\"", case.name))?;
            // A step of the schedule may have been divided; what one step costs is asked here.
            case.steps.push(pace.step * case.world.dt() / case.schedule.dt);
        }
    }
    report(&cases, json, output.as_deref())
}

fn case(name: &str, effects: &[Effect], n: usize) -> anyhow::Result<Case> {
    let text = scene_text(effects, n);
    let (scene, _) =
        parse(&text, Path::new(name), Path::new(""), &Files).with_context(|| format!("case \"{name}\""))?;
    let prepared = prepare(&scene, &inputs::load(&scene)?)?;
    let timeline = Timeline::new(&scene.operations, &prepared.lattice)?;
    let schedule = prepared.schedule;
    Ok(Case { name: name.to_owned(), world: prepared.into_world(&scene), timeline, schedule, steps: Vec::new() })
}

/// The scene of a case, as a user would write it.
fn scene_text(effects: &[Effect], n: usize) -> String {
    let key = |line: &str| line.split(' ').next().unwrap_or_default().to_owned();
    let mut organ: Vec<&str> = BARE.to_vec();
    for line in effects.iter().map(|effect| effect.organ).filter(|line| !line.is_empty()) {
        organ.retain(|other| key(other) != key(line));
        organ.push(line);
    }
    let mut text = format!("[volume]\nphantom = \"cube\"\nspacing = {}\n", EDGE_MM / n as f64);
    let _ = writeln!(text, "[[organ]]\nname = \"cube\"\nlabel = \"cube\"\n{}", organ.join("\n"));
    let _ = writeln!(text, "[time]\nduration = 10\nframes = 1");
    for line in effects.iter().map(|effect| effect.time).filter(|line| !line.is_empty()) {
        let _ = writeln!(text, "{line}");
    }
    for table in effects.iter().map(|effect| effect.tables).filter(|table| !table.is_empty()) {
        let _ = writeln!(text, "{table}");
    }
    text
}

/// The middle one.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Columns after the name: key, unit or meaning.
const COLUMNS: [(&str, &str); 4] = [
    ("step_ms", "ms per step"),
    ("ns_per_particle", "ns per particle"),
    ("bytes_per_particle", "bytes per particle"),
    ("ratio_to_bare", "times the bare step"),
];

fn report(cases: &[Case], json: bool, output: Option<&Path>) -> anyhow::Result<()> {
    let bare = &cases[0].steps;
    let rows: Vec<(&str, [f64; 4])> = cases
        .iter()
        .map(|case| {
            let step = median(case.steps.clone());
            let ratio = median(case.steps.iter().zip(bare).map(|(step, bare)| step / bare).collect());
            let ns = step * 1e9 / case.world.lattice().len() as f64;
            (case.name.as_str(), [step * 1e3, ns, case.world.bytes_per_particle(), ratio])
        })
        .collect();
    let world = &cases[0].world;
    let setting = format!(
        "{} particles, {} threads, {}, {} rounds in turn",
        world.lattice().len(),
        rayon::current_num_threads(),
        world.arithmetic().set().name(),
        bare.len()
    );
    if let Some(folder) = output {
        write_files(&rows, &setting, folder)?;
    }
    if json {
        let object = |(name, numbers): &(&str, [f64; 4])| {
            let mut object = json!({ "effect": name });
            for ((key, _), number) in COLUMNS.iter().zip(numbers) {
                object[*key] = json!(number);
            }
            object
        };
        let effects: Vec<Value> = rows.iter().map(object).collect();
        return out(&json!({ "setting": setting, "effects": effects }).to_string());
    }
    let mut text =
        format!("{setting}\n\n| effect | {} |\n|---|---:|---:|---:|---:|", COLUMNS.map(|(_, title)| title).join(" | "));
    for (name, [step, ns, bytes, ratio]) in &rows {
        let _ = write!(text, "\n| {name} | {step:.2} | {ns:.1} | {bytes:.0} | {ratio:.2} |");
    }
    out(&text)
}

fn write_files(rows: &[(&str, [f64; 4])], setting: &str, folder: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder)
        .with_context(|| format!("{}: the folder could not be made; check the path", folder.display()))?;
    let mut csv = format!("effect,{}\n", COLUMNS.map(|(key, _)| key).join(","));
    for (name, numbers) in rows {
        let _ = writeln!(csv, "{name},{}", numbers.map(|number| number.to_string()).join(","));
    }
    let place = folder.join("effects.csv");
    std::fs::write(&place, csv).with_context(|| format!("{}: could not be written", place.display()))?;
    let bars: Vec<Bar> = rows
        .iter()
        .map(|(name, [step, _, _, ratio])| Bar {
            name: (*name).to_owned(),
            value: *step,
            label: format!("{step:.2} ms, x{ratio:.2}"),
        })
        .collect();
    Ok(write_bars(&format!("a step of {setting}"), &bars, &folder.join("effects.png"))?)
}
