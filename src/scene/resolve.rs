//! From the scene as written to the scene as run: everything checked, every unit SI.
//!
//! Nothing is read from disk here but label names, through [`LabelLookup`]: that files exist, that organs have voxels
//! and that regions hold particles is found out by those who open them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::checks::Checks;
use super::diagnostics::{KeyPath, Located, Source};
use super::problem::{Caution, Problem, number};
use super::resolved::{
    Action, Body, LatticeSpec, Model, Operation, Organ, PhantomKind, Scene, SleepSpec, TimeSpec, VolumeSource,
    needs_plain_step,
};
use super::schema::{self, SceneFile};
use super::values::Switch;
use super::{operations, organs};
use crate::dynamics::integrator::Method;
use crate::geometry::Vector3;
use crate::phantom::SPACING_MM;

const DEFAULT_PHANTOM_SPACING: f64 = 3.0;
const DEFAULT_SEED: u64 = 1;
const DEFAULT_FRAMES: u64 = 30;
/// Bounds of a pitch [mm]: wide enough for anything seen in CT, narrow enough to catch a pitch given in metres.
const PITCH: [f64; 2] = [0.01, 100.0];
/// Bounds of an accuracy: f32 keeps no more, and worse is no result.
const ACCURACY: [f64; 2] = [1e-6, 0.5];
/// More frames than anybody plays back, few enough for six digits in a file name.
const MAX_FRAMES: u64 = 100_000;
/// Steps of a run, so that a mistyped `dt` is refused and not run for years.
const MAX_STEPS: f64 = 1e12;

/// Who knows the names of labels.
///
/// Scenes may give labels by name; where names stand is a matter of file formats and phantoms, not of scenes.
pub trait LabelLookup {
    /// Reads a file of label names: name to label.
    ///
    /// # Errors
    /// If the file cannot be read or understood; the message becomes part of the scene's error.
    fn in_file(&self, path: &Path) -> Result<BTreeMap<String, u16>, Box<dyn std::error::Error + Send + Sync>>;

    /// Names of the labels of a phantom: name to label.
    fn of_phantom(&self, kind: PhantomKind) -> BTreeMap<String, u16>;
}

/// A scene with what is odd about it.
type Resolved = (Scene, Vec<Located<Caution>>);

/// Checks a scene and makes every choice it leaves open.
pub(super) fn resolve(
    file: &SceneFile,
    source: &Source<'_>,
    folder: &Path,
    label_names: &dyn LabelLookup,
) -> Result<Resolved, Vec<Located<Problem>>> {
    let mut checks = Checks::new(source);
    let volume = volume(&mut checks, &file.volume, folder);
    let lattice = lattice(&mut checks, &file.lattice);
    let time = time(&mut checks, &file.time);
    accuracy(&mut checks, file);
    let gravity = file.gravity.as_ref().map_or(Vector3::zeros(), |gravity| {
        let key = KeyPath::top("gravity").key("acceleration");
        Vector3::from(checks.triple(&key, gravity.acceleration, "m/s2"))
    });
    let drag = file.drag.as_ref().map(|drag| checks.above_zero(&KeyPath::top("drag").key("rate"), drag.rate, "1/s"));
    let organs = organs::organs(&mut checks, file, lattice.model, folder, label_names);
    let operations = operations::operations(&mut checks, file, time.map(|time| time.duration), folder);
    let sleep = sleep(&mut checks, file.sleep.as_ref());
    plain_step_only(&mut checks, time, organs.as_deref(), operations.as_deref(), sleep);
    let in_order_of_text = |found: &Located<Problem>| (found.place.line, found.place.column);
    checks.problems.sort_by_key(in_order_of_text);
    if !checks.problems.is_empty() {
        return Err(checks.problems);
    }
    // A part is `None` only when a problem says why, so this is reached with every part at hand.
    let (Some(volume), Some(time), Some(organs), Some(operations)) = (volume, time, organs, operations) else {
        return Err(checks.problems);
    };
    let scene = Scene { volume, lattice, organs, accuracy: file.accuracy, time, gravity, drag, sleep, operations };
    look_over(&mut checks, &scene);
    checks.cautions.sort_by_key(|found| (found.place.line, found.place.column));
    Ok((scene, checks.cautions))
}

fn sleep(checks: &mut Checks<'_>, written: Option<&Switch<schema::Sleep>>) -> Option<SleepSpec> {
    match written? {
        Switch::Plain(on) => on.then(SleepSpec::default),
        Switch::Table(schema::Sleep { tolerance, window }) => {
            let table = KeyPath::top("sleep");
            let mut above_zero =
                |key, value: &Option<f64>, unit| value.map(|value| checks.above_zero(&table.key(key), value, unit));
            let tolerance = above_zero("tolerance", tolerance, "mm").map(|mm| mm * 1e-3);
            Some(SleepSpec { tolerance, window: above_zero("window", window, "s") })
        }
    }
}

fn volume(checks: &mut Checks<'_>, written: &schema::Volume, folder: &Path) -> Option<VolumeSource> {
    let table = KeyPath::top("volume");
    let files = [("image", &written.image), ("labels", &written.labels), ("label_names", &written.label_names)];
    if let Some(kind) = written.phantom {
        for (key, path) in files {
            if path.is_some() {
                let next = "keep `phantom` for a volume made by the program, or the files for one of yours".to_owned();
                let problem = Problem::Conflict { first: "phantom".into(), second: key.into(), next };
                checks.problem(&table.key(key), problem);
            }
        }
        let spacing = written.spacing.unwrap_or(DEFAULT_PHANTOM_SPACING);
        let spacing = checks.between(&table.key("spacing"), spacing, SPACING_MM, "mm");
        return Some(VolumeSource::Phantom { kind, spacing, seed: written.seed.unwrap_or(DEFAULT_SEED) });
    }
    for (key, present) in [("spacing", written.spacing.is_some()), ("seed", written.seed.is_some())] {
        if present {
            let next = format!("`{key}` belongs to a phantom; add it, or leave `{key}` out (files have their own)");
            checks.problem(&table.key(key), Problem::Missing { key: "phantom".into(), next });
        }
    }
    for (key, path) in files {
        if path.as_ref().is_some_and(|path| path.as_os_str().is_empty()) {
            checks.out_of_range(&table.key(key), "an empty path", "the path of a file");
        }
    }
    if written.image.is_none() && written.labels.is_none() {
        let next = "give `image`, `labels` or both, or a volume of the program's own: phantom = \"abdomen\"";
        checks.problem(&table, Problem::Missing { key: "image".into(), next: next.into() });
        return None;
    }
    let path = |path: &Option<PathBuf>| path.as_ref().map(|path| folder.join(path));
    Some(VolumeSource::Files { image: path(&written.image), labels: path(&written.labels) })
}

fn lattice(checks: &mut Checks<'_>, written: &schema::Lattice) -> LatticeSpec {
    let key = KeyPath::top("lattice").key("pitch");
    let pitch = written.pitch.map(|pitch| checks.between(&key, pitch, PITCH, "mm") * 1e-3);
    LatticeSpec { model: written.model.unwrap_or(Model::Tissue), pitch }
}

fn time(checks: &mut Checks<'_>, written: &schema::Time) -> Option<TimeSpec> {
    let table = KeyPath::top("time");
    let dt = written.dt.map(|dt| checks.above_zero(&table.key("dt"), dt, "s"));
    let duration = match (written.duration, written.steps, dt) {
        (Some(_), Some(_), _) => {
            let next = "keep `duration` (s), or `steps` together with `dt`".to_owned();
            let problem = Problem::Conflict { first: "steps".into(), second: "duration".into(), next };
            checks.problem(&table.key("steps"), problem);
            return None;
        }
        (None, None, _) => {
            checks.missing(&table, "duration", "say how long to simulate, such as duration = 0.4 (s)");
            return None;
        }
        (None, Some(_), None) => {
            let next =
                "`steps` counts steps of a known length: add dt = ... (s), or give `duration` instead".to_owned();
            checks.problem(&table.key("steps"), Problem::Missing { key: "dt".into(), next });
            return None;
        }
        (None, Some(0), _) => {
            checks.out_of_range(&table.key("steps"), "0", "at least 1 step");
            return None;
        }
        (None, Some(steps), Some(dt)) => steps as f64 * dt,
        (Some(duration), None, _) => checks.above_zero(&table.key("duration"), duration, "s"),
    };
    // The most steps the run can have, where it says; rounding must not make 100 steps 99.
    let steps = dt.map_or(f64::INFINITY, |dt| (duration / dt * (1.0 + 1e-9)).floor().max(1.0));
    if dt.is_some() && steps > MAX_STEPS {
        checks.out_of_range(&table.key("dt"), format!("{steps:.1e} steps"), "at most 1e12 steps; enlarge `dt`");
    }
    let frames = written.frames.unwrap_or(DEFAULT_FRAMES.min(steps as u64));
    if !(1..=MAX_FRAMES).contains(&frames) {
        checks.out_of_range(&table.key("frames"), frames.to_string(), format!("1 to {MAX_FRAMES} frames"));
    } else if frames as f64 > steps {
        let expected = format!("at most one frame per step, and there are {} steps", number(steps));
        checks.out_of_range(&table.key("frames"), frames.to_string(), expected);
    }
    let integrator = written.integrator.unwrap_or_default();
    let tolerance = written.tolerance.map(|length| checks.above_zero(&table.key("tolerance"), length, "mm") * 1e-3);
    if tolerance.is_some() && !integrator.has_tolerance() {
        let next =
            "leave `tolerance` out, or take \"bogacki_shampine\", \"backward_euler\" or \"quasi_static\"".to_owned();
        let second = format!("integrator = \"{}\"", integrator.name());
        checks.problem(&table.key("tolerance"), Problem::Conflict { first: "tolerance".into(), second, next });
    }
    let frames = usize::try_from(frames).ok()?;
    Some(TimeSpec { duration, frames, dt, integrator, tolerance, exact: written.exact })
}

/// The bound is in its range, and nothing is given that it is to choose.
fn accuracy(checks: &mut Checks<'_>, file: &SceneFile) {
    let Some(asked) = file.accuracy else { return };
    let key = KeyPath::top("accuracy");
    if !(ACCURACY[0]..=ACCURACY[1]).contains(&asked) {
        let expected = "1e-6 to 0.5, an error over the largest displacement, such as accuracy = 0.02";
        checks.out_of_range(&key, number(asked), expected);
    }
    let time = &file.time;
    let chosen =
        [("dt", time.dt.is_some()), ("integrator", time.integrator.is_some()), ("tolerance", time.tolerance.is_some())];
    for (second, _) in chosen.into_iter().filter(|(_, given)| *given) {
        let next = format!("leave time.{second} out and let the program choose it, or leave `accuracy` out");
        let problem = Problem::Conflict { first: "accuracy".into(), second: format!("time.{second}"), next };
        checks.problem(&KeyPath::top("time").key(second), problem);
    }
}

/// Refuses what only the plain step has, where another integrator is asked for.
fn plain_step_only(
    checks: &mut Checks<'_>,
    time: Option<TimeSpec>,
    organs: Option<&[Organ]>,
    operations: Option<&[Operation]>,
    sleep: Option<SleepSpec>,
) {
    let Some(integrator) = time.map(|time| time.integrator).filter(|&method| method != Method::SymplecticEuler) else {
        return;
    };
    let (organs, operations) = (organs.unwrap_or_default(), operations.unwrap_or_default());
    if let Some(second) = needs_plain_step(organs, operations, sleep) {
        let first = format!("integrator = \"{}\"", integrator.name());
        let next =
            "only \"symplectic_euler\", the default, has contact, rigid bodies that move, relaxation, plasticity, tearing and sleep: \
             leave `integrator` out"
                .to_owned();
        checks.problem(&KeyPath::top("time").key("integrator"), Problem::Conflict { first, second, next });
    }
}

/// Warnings about the scene as a whole.
fn look_over(checks: &mut Checks<'_>, scene: &Scene) {
    let does = |test: fn(&Action) -> bool| scene.operations.iter().any(|operation| test(&operation.action));
    let grabbed = does(|action| matches!(action, Action::Grab { .. }));
    let held = grabbed
        || does(|action| matches!(action, Action::Fix { .. } | Action::Plane { .. }))
        || scene.organs.iter().any(|organ| organ.body == Body::Rigid { density: None });
    let falls = scene.gravity != Vector3::zeros();
    if falls && !held {
        checks.caution(&KeyPath::top("gravity"), Caution::FreeFall);
    }
    let pushed = does(|action| matches!(action, Action::Force { .. } | Action::Pressure { .. }))
        || does(|action| matches!(action, Action::Tool { path, .. } if path.len() > 1));
    if !falls && !grabbed && !pushed {
        checks.caution(&KeyPath::default(), Caution::NothingMoves);
    }
}
