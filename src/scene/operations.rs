//! The time line: fixes, cuts, pulls, pushes and pressures, what they act on, and when they end. What tissue cannot enter comes
//! from [`super::obstacles`].

use super::checks::Checks;
use super::diagnostics::KeyPath;
use super::obstacles;
use super::problem::{Caution, Problem, nearest_name, number};
use super::regions::region;
use super::resolved::{Action, Model, Operation, Pressed};
use super::schema::{self, SceneFile};
use super::values::Triple;
use std::path::Path;

use crate::geometry::{Point3, Vector3};

/// A blade or tool is drawn and moved within this many millimetres of the origin (a thousand kilometres). Products of lengths up to
/// there stay finite, and in f64 a place is still known to better than a micrometre.
pub(super) const FARTHEST_MM: f64 = 1e9;

/// An operation with the way to its table.
struct Entry {
    table: KeyPath,
    operation: Operation,
}

/// Checks and resolves the time line; `None` when a problem was found. Without a duration (itself wrong) the checks
/// against the end of the run are left out.
pub(super) fn operations(
    checks: &mut Checks<'_>,
    file: &SceneFile,
    duration: Option<f64>,
    folder: &Path,
) -> Option<Vec<Operation>> {
    let before = checks.problems.len();
    let duration = duration.unwrap_or(f64::INFINITY);
    let mut entries = Vec::new();
    for (index, fix) in file.fix.iter().enumerate() {
        let table = KeyPath::top("fix").index(index);
        let (from, to) = span(checks, &table, fix.from, fix.to);
        let action = region(checks, &table.key("region"), &fix.region, file).map(|region| Action::Fix { region });
        push(&mut entries, table, name(&fix.name, "fix", index), from, to.unwrap_or(f64::INFINITY), action);
    }
    for (index, cut) in file.cut.iter().enumerate() {
        let table = KeyPath::top("cut").index(index);
        let (from, to) = span(checks, &table, cut.from, Some(cut.to));
        let action = blade_sweep(checks, &table, cut);
        push(&mut entries, table, name(&cut.name, "cut", index), from, to.unwrap_or(cut.to), action);
    }
    for (kind, list) in [("pull", &file.pull), ("push", &file.push)] {
        for (index, pull) in list.iter().enumerate() {
            let table = KeyPath::top(kind).index(index);
            let (from, to) = span(checks, &table, pull.from, pull.to);
            let action = force_or_grab(checks, &table, pull, file, to.unwrap_or(duration));
            // A grab holds on after its path has ended; a force does not.
            let until = to.filter(|_| pull.path.is_none()).unwrap_or(f64::INFINITY);
            push(&mut entries, table, name(&pull.name, kind, index), from, until, action);
        }
    }
    for (index, pressure) in file.pressure.iter().enumerate() {
        let table = KeyPath::top("pressure").index(index);
        let (from, to) = span(checks, &table, pressure.from, pressure.to);
        let action = pressed(checks, &table, pressure, file);
        push(&mut entries, table, name(&pressure.name, "pressure", index), from, to.unwrap_or(f64::INFINITY), action);
    }
    for (index, tool) in file.tool.iter().enumerate() {
        let table = KeyPath::top("tool").index(index);
        let (from, to) = span(checks, &table, tool.from, tool.to);
        let action = obstacles::tool(checks, &table, tool, folder, to.unwrap_or(duration));
        // A tool stays after its path has ended, as a grab does.
        let until = to.filter(|_| tool.path.is_none()).unwrap_or(f64::INFINITY);
        push(&mut entries, table, name(&tool.name, "tool", index), from, until, action);
    }
    for (index, plane) in file.plane.iter().enumerate() {
        let table = KeyPath::top("plane").index(index);
        let action = obstacles::plane(checks, &table, plane);
        push(&mut entries, table, name(&plane.name, "plane", index), 0.0, f64::INFINITY, action);
    }
    if let Some(contact) = &file.contact {
        let table = KeyPath::top("contact");
        let action = obstacles::bone(checks, &table, contact, file);
        push(&mut entries, table, "bone".to_owned(), 0.0, f64::INFINITY, action);
    }
    if let Some(contact) = &file.self_contact {
        let table = KeyPath::top("self_contact");
        let action = obstacles::self_contact(checks, &table, contact, file);
        push(&mut entries, table, "self contact".to_owned(), 0.0, f64::INFINITY, action);
    }
    check_names(checks, &entries);
    release(checks, file, &mut entries);
    if checks.problems.len() > before {
        return None;
    }
    for entry in &entries {
        check_against_run(checks, entry, duration);
    }
    // Sorted once more by time below, so that what begins together stays in the order of the text.
    entries.sort_by_key(|entry| checks.offset(&entry.table));
    entries.sort_by(|a, b| a.operation.from.total_cmp(&b.operation.from));
    Some(entries.into_iter().map(|entry| entry.operation).collect())
}

fn name(written: &Option<String>, kind: &str, index: usize) -> String {
    written.clone().unwrap_or_else(|| format!("{kind} {}", index + 1))
}

fn push(entries: &mut Vec<Entry>, table: KeyPath, name: String, from: f64, until: f64, action: Option<Action>) {
    // Without an action the problem has been reported; the time line is refused as a whole.
    if let Some(action) = action {
        entries.push(Entry { table, operation: Operation { name, from, until, action } });
    }
}

/// Checks `from` and `to` of an operation.
fn span(checks: &mut Checks<'_>, table: &KeyPath, from: Option<f64>, to: Option<f64>) -> (f64, Option<f64>) {
    let from = from.map_or(0.0, |from| checks.not_negative(&table.key("from"), from, "s"));
    if let Some(to) = to {
        let key = table.key("to");
        if !to.is_finite() {
            checks.out_of_range(&key, number(to), "a finite time (s); leave `to` out to last to the end of the run");
        } else if to <= from {
            checks.problem(&key, Problem::NotAfter { found: number(to), earlier_name: "from", earlier: number(from) });
        }
    }
    (from, to)
}

fn blade_sweep(checks: &mut Checks<'_>, table: &KeyPath, cut: &schema::Cut) -> Option<Action> {
    let blade = polyline(checks, &table.key("blade"), &cut.blade, "the edge of a blade");
    let path = polyline(checks, &table.key("path"), &cut.path, "the path of a blade");
    let (blade, path) = (blade?, path?);
    let [blade_ok, path_ok] =
        [("blade", &blade), ("path", &path)].map(|(key, points)| near(checks, &table.key(key), points));
    if !(blade_ok && path_ok) {
        return None;
    }
    // An edge that only slides along itself sweeps no area, so it can sever nothing.
    let sweeps = blade.windows(2).any(|edge| {
        path.windows(2).any(|way| {
            let (edge, way) = (edge[1] - edge[0], way[1] - way[0]);
            edge.cross(&way).norm() > 1e-9 * edge.norm() * way.norm()
        })
    });
    if !sweeps {
        let found = "the blade moves along its own edge and sweeps no area".to_owned();
        let expected = "a path across the edge".to_owned();
        checks.problem(&table.key("path"), Problem::Degenerate { found, expected });
    }
    Some(Action::Cut { blade: blade.into_iter().map(Point3::from).collect(), path })
}

/// Whether all places are near enough to be in a room with the patient; the first that is not is reported.
pub(super) fn near(checks: &mut Checks<'_>, key: &KeyPath, points: &[Vector3]) -> bool {
    let far = |point: &Vector3| point.iter().copied().find(|part| part.abs() > FARTHEST_MM);
    let found = points.iter().enumerate().find_map(|(index, point)| far(point).map(|part| (index, part)));
    if let Some((index, part)) = found {
        let expected = format!("coordinates from {} to {} mm", number(-FARTHEST_MM), number(FARTHEST_MM));
        checks.out_of_range(&key.index(index), format!("{} mm", number(part)), expected);
    }
    found.is_none()
}

/// Finite places, at least two of them, and a length above zero.
pub(super) fn polyline(checks: &mut Checks<'_>, key: &KeyPath, points: &[Triple], what: &str) -> Option<Vec<Vector3>> {
    let points: Vec<Vector3> = checks.triples(key, points).into_iter().map(Vector3::from).collect();
    if !points.iter().flatten().all(|part| part.is_finite()) {
        return None;
    }
    let length: f64 = points.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
    if points.len() < 2 {
        let found = format!("{what} has {} of the points it needs", points.len());
        checks.problem(key, Problem::Degenerate { found, expected: "at least two points [x, y, z] in mm".into() });
        return None;
    }
    if length == 0.0 {
        let found = format!("{what} has length 0 mm: all its {} points are the same", points.len());
        checks.problem(key, Problem::Degenerate { found, expected: "at least two different points in mm".into() });
        return None;
    }
    Some(points)
}

fn force_or_grab(
    checks: &mut Checks<'_>,
    table: &KeyPath,
    pull: &schema::Pull,
    file: &SceneFile,
    arrive: f64,
) -> Option<Action> {
    let region = region(checks, &table.key("region"), &pull.region, file);
    match (pull.force, &pull.path) {
        (Some(_), Some(_)) => {
            let next = "pull by a force (N), or grab and move along a path (mm)".to_owned();
            checks
                .problem(&table.key("path"), Problem::Conflict { first: "force".into(), second: "path".into(), next });
            None
        }
        (None, None) => {
            checks.missing(table, "force", "write force = [0, -3, 0] (N), or path = [[0, 0, 0], [0, -20, 0]] (mm)");
            None
        }
        (Some(force), None) => {
            let key = table.key("force");
            let force = Vector3::from(checks.triple(&key, force, "newtons"));
            if force == Vector3::zeros() {
                let found = "the force is [0, 0, 0] N".to_owned();
                checks.problem(&key, Problem::Degenerate { found, expected: "a force that acts".into() });
            }
            let ramp = pull.ramp.map_or(0.0, |ramp| checks.not_negative(&table.key("ramp"), ramp, "s"));
            Some(Action::Force { region: region?, force, ramp })
        }
        (None, Some(path)) => {
            if pull.ramp.is_some() {
                let next = "a ramp belongs to a force; a grab starts and ends where its path says".to_owned();
                let problem = Problem::Conflict { first: "ramp".into(), second: "path".into(), next };
                checks.problem(&table.key("ramp"), problem);
            }
            let key = table.key("path");
            let path = polyline(checks, &key, path, "the path of a grab")?;
            if path[0] != Vector3::zeros() {
                let found = format!("[{}, {}, {}] mm", number(path[0].x), number(path[0].y), number(path[0].z));
                let expected = "[0, 0, 0] first: displacements count from where the region was grabbed";
                checks.out_of_range(&key.index(0), found, expected);
            }
            Some(Action::Grab { region: region?, path, arrive })
        }
    }
}

fn pressed(checks: &mut Checks<'_>, table: &KeyPath, written: &schema::Pressure, file: &SceneFile) -> Option<Action> {
    if file.lattice.model == Some(Model::Paper) {
        let expected =
            "model \"tissue\", whose cells have faces to press on; set lattice.model = \"tissue\" or push with a force";
        checks.out_of_range(table, "a pressure in model \"paper\"", expected);
    }
    let on = match (&written.region, &written.cut) {
        (Some(_), Some(_)) => {
            let next = "press on what borders on nothing in a region, or on the lips of a cut".to_owned();
            let problem = Problem::Conflict { first: "region".into(), second: "cut".into(), next };
            checks.problem(&table.key("cut"), problem);
            None
        }
        (None, None) => {
            checks.missing(
                table,
                "region",
                "say which faces, such as region = { organ = \"liver\" }, or cut = \"cut 1\"",
            );
            None
        }
        (Some(written), None) => region(checks, &table.key("region"), written, file).map(Pressed::Border),
        (None, Some(found)) => {
            let known: Vec<String> =
                file.cut.iter().enumerate().map(|(index, cut)| name(&cut.name, "cut", index)).collect();
            if !known.contains(found) {
                let suggestion = nearest_name(found, known.iter().map(String::as_str));
                let problem = Problem::UnknownName { kind: "cut", found: found.clone(), suggestion, known };
                checks.problem(&table.key("cut"), problem);
            }
            Some(Pressed::LipsOf(found.clone()))
        }
    };
    let key = table.key("pressure");
    if !(written.pressure.is_finite() && written.pressure != 0.0) {
        checks.out_of_range(&key, number(written.pressure), "a finite number of Pa, not 0; 1 mmHg is 133 Pa");
    }
    let ramp = written.ramp.map_or(0.0, |ramp| checks.not_negative(&table.key("ramp"), ramp, "s"));
    Some(Action::Pressure { on: on?, pressure: written.pressure, ramp })
}

fn check_names(checks: &mut Checks<'_>, entries: &[Entry]) {
    for (index, Entry { table, operation }) in entries.iter().enumerate() {
        if operation.name.trim().is_empty() {
            checks.out_of_range(&table.key("name"), "an empty name", "a name, or no `name` at all");
        }
        if let Some(first) = entries[..index].iter().find(|earlier| earlier.operation.name == operation.name) {
            let first = first.table.to_string();
            let problem = Problem::DuplicateName { kind: "operation", name: operation.name.clone(), first };
            checks.problem(&table.key("name"), problem);
        }
    }
}

/// Lets every `[[release]]` end its operation.
fn release(checks: &mut Checks<'_>, file: &SceneFile, entries: &mut [Entry]) {
    for (index, release) in file.release.iter().enumerate() {
        let table = KeyPath::top("release").index(index);
        let earlier = file.release[..index].iter().position(|earlier| earlier.of == release.of);
        if let Some(earlier) = earlier {
            let first = KeyPath::top("release").index(earlier).to_string();
            let next = format!("\"{}\" can be released once", release.of);
            checks.problem(&table.key("of"), Problem::Conflict { first, second: table.to_string(), next });
            continue;
        }
        let lasts =
            |action: &Action| matches!(action, Action::Cut { .. } | Action::Bone { .. } | Action::SelfContact { .. });
        let held = |entry: &&mut Entry| !lasts(&entry.operation.action);
        let Some(target) = entries.iter_mut().filter(held).find(|entry| entry.operation.name == release.of) else {
            unknown_target(checks, &table.key("of"), file, &release.of);
            continue;
        };
        let (at, key, operation) = (release.at, table.key("at"), &mut target.operation);
        if !at.is_finite() {
            checks.out_of_range(&key, number(at), "a finite time (s)");
        } else if at <= operation.from {
            let (found, earlier) = (number(at), number(operation.from));
            checks.problem(&key, Problem::NotAfter { found, earlier_name: "the beginning of what it ends", earlier });
        } else if at >= operation.until {
            let expected =
                format!("a time before {} s, when \"{}\" ends by itself", number(operation.until), release.of);
            checks.out_of_range(&key, format!("{} s", number(at)), expected);
        } else {
            operation.until = at;
        }
    }
}

fn unknown_target(checks: &mut Checks<'_>, key: &KeyPath, file: &SceneFile, found: &str) {
    let known: Vec<String> = [
        ("fix", file.fix.iter().map(|fix| &fix.name).collect::<Vec<_>>()),
        ("pull", file.pull.iter().map(|pull| &pull.name).collect()),
        ("push", file.push.iter().map(|push| &push.name).collect()),
        ("pressure", file.pressure.iter().map(|pressure| &pressure.name).collect()),
        ("tool", file.tool.iter().map(|tool| &tool.name).collect()),
        ("plane", file.plane.iter().map(|plane| &plane.name).collect()),
    ]
    .into_iter()
    .flat_map(|(kind, names)| names.into_iter().enumerate().map(move |(index, own)| name(own, kind, index)))
    .collect();
    // A target that exists but is itself at fault has been reported where it stands.
    if known.iter().all(|name| name != found) {
        let suggestion = nearest_name(found, known.iter().map(String::as_str));
        checks.problem(
            key,
            Problem::UnknownName {
                kind: "fix, pull, push, pressure, tool or plane",
                found: found.to_owned(),
                suggestion,
                known,
            },
        );
    }
}

/// Warns about what the run is too short for. Times equal up to rounding (100 steps of 1 ms and 0.1 s) are equal.
fn check_against_run(checks: &mut Checks<'_>, entry: &Entry, duration: f64) {
    let Entry { table, operation: Operation { name, from, until, action } } = entry;
    let end = duration * (1.0 + 1e-9);
    let name = format!("\"{name}\"");
    if *from >= duration {
        let caution = Caution::NeverHappens { operation: name, from: number(*from), duration: number(duration) };
        checks.caution(&table.key("from"), caution);
        return;
    }
    let (finished, goal) = match action {
        Action::Fix { .. } | Action::Plane { .. } | Action::Bone { .. } | Action::SelfContact { .. } => return,
        Action::Tool { path, .. } if path.len() < 2 => return,
        Action::Force { ramp, .. } => (from + ramp, "its full force"),
        Action::Pressure { ramp, .. } => (from + ramp, "its full pressure"),
        Action::Grab { arrive, .. } | Action::Tool { arrive, .. } => (*arrive, "the end of its path"),
        Action::Cut { .. } => (*until, ""),
    };
    if finished > *until * (1.0 + 1e-9) {
        let caution = Caution::EndsEarly { operation: name, until: number(*until), goal, at: number(finished) };
        checks.caution(table, caution);
    } else if finished > end {
        let caution = Caution::NeverFinished { operation: name, to: number(finished), duration: number(duration) };
        checks.caution(&table.key("to"), caution);
    }
}
