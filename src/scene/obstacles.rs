//! Tools, planes, bone and tissue itself: what soft tissue cannot enter.

use std::path::Path;

use super::checks::Checks;
use super::diagnostics::KeyPath;
use super::operations::{FARTHEST_MM, near, polyline};
use super::problem::{Problem, nearest_name, number};
use super::regions::direction;
use super::resolved::{Action, ToolShape};
use super::schema::{self, SceneFile};
use super::values::Triple;
use crate::geometry::{Point3, Vector3};

/// Checks and resolves a tool.
///
/// - `arrive`: when the end of its path is reached [s].
pub(super) fn tool(
    checks: &mut Checks<'_>,
    table: &KeyPath,
    tool: &schema::Tool,
    folder: &Path,
    arrive: f64,
) -> Option<Action> {
    let friction = friction(checks, table, tool.friction);
    let shape = shape(checks, &table.key("shape"), &tool.shape, folder);
    let key = table.key("path");
    let path = match &tool.path {
        None => vec![Vector3::zeros()],
        Some(path) => polyline(checks, &key, path, "the path of a tool").filter(|path| near(checks, &key, path))?,
    };
    Some(Action::Tool { shape: shape?, path, arrive, friction })
}

/// Checks and resolves a plane.
pub(super) fn plane(checks: &mut Checks<'_>, table: &KeyPath, plane: &schema::Plane) -> Option<Action> {
    let point = place(checks, &table.key("point"), plane.point);
    let normal = direction(checks, &table.key("normal"), plane.normal, "a direction to the side where tissue stays");
    let friction = friction(checks, table, plane.friction);
    Some(Action::Plane { point: point?, normal, friction })
}

/// Checks and resolves contact with bone; `None` also when it is not asked for.
pub(super) fn bone(
    checks: &mut Checks<'_>,
    table: &KeyPath,
    contact: &schema::Contact,
    file: &SceneFile,
) -> Option<Action> {
    let friction = friction(checks, table, contact.friction);
    let key = table.key("bone");
    if !contact.bone {
        if contact.friction.is_some() {
            let next = "friction of what? write bone = true, or leave `friction` out".to_owned();
            checks.problem(&table.key("friction"), Problem::Missing { key: "bone".into(), next });
        }
        return None;
    }
    let rigid = || file.organ.iter().enumerate().filter(|(_, organ)| organ.rigid);
    let free = rigid().find(|(_, organ)| organ.density.is_some() || organ.material.is_some());
    if let Some((index, organ)) = free {
        let found = format!("organ `{}` (organ[{index}]) is a rigid body that moves", organ.name);
        let expected =
            "rigid organs that stay or are grabbed: contact with bodies that move freely is not modelled, so leave its \
                        density or material out, or contact.bone"
                .to_owned();
        checks.problem(&key, Problem::Degenerate { found, expected });
        return None;
    }
    let organs: Vec<usize> = rigid().map(|(index, _)| index).collect();
    if organs.is_empty() {
        let found = "no organ of this scene is rigid".to_owned();
        let expected = "at least one organ with rigid = true to be in contact with".to_owned();
        checks.problem(&key, Problem::Degenerate { found, expected });
        return None;
    }
    Some(Action::Bone { organs, friction })
}

/// Checks and resolves contact of soft tissue with itself.
pub(super) fn self_contact(
    checks: &mut Checks<'_>,
    table: &KeyPath,
    contact: &schema::SelfContact,
    file: &SceneFile,
) -> Option<Action> {
    let friction = friction(checks, table, contact.friction);
    let soft = || file.organ.iter().enumerate().filter(|(_, organ)| !organ.rigid);
    let Some(names) = &contact.organs else {
        let organs: Vec<usize> = soft().map(|(index, _)| index).collect();
        if organs.is_empty() {
            let found = "every organ of this scene is rigid".to_owned();
            let expected = "at least one organ without rigid = true, or no [self_contact]".to_owned();
            checks.problem(table, Problem::Degenerate { found, expected });
            return None;
        }
        return Some(Action::SelfContact { organs, friction });
    };
    let key = table.key("organs");
    if names.is_empty() {
        checks.out_of_range(&key, "an empty list", "names of soft organs; leave `organs` out for all of them");
        return None;
    }
    let mut organs = Vec::new();
    for (place, name) in names.iter().enumerate() {
        let key = key.index(place);
        match file.organ.iter().position(|organ| organ.name == *name) {
            None => {
                let known: Vec<String> = soft().map(|(_, organ)| organ.name.clone()).collect();
                let suggestion = nearest_name(name, known.iter().map(String::as_str));
                checks.problem(&key, Problem::UnknownName { kind: "organ", found: name.clone(), suggestion, known });
            }
            Some(index) if file.organ[index].rigid => {
                let found = format!("organ `{name}` (organ[{index}]) is rigid");
                let expected =
                    "soft organs; for tissue on bone that stays where it is write [contact] bone = true".to_owned();
                checks.problem(&key, Problem::Degenerate { found, expected });
            }
            Some(index) => organs.push(index),
        }
    }
    organs.sort_unstable();
    organs.dedup();
    (!organs.is_empty()).then_some(Action::SelfContact { organs, friction })
}

fn friction(checks: &mut Checks<'_>, table: &KeyPath, written: Option<f64>) -> f64 {
    written.map_or(0.0, |friction| checks.not_negative(&table.key("friction"), friction, ""))
}

fn shape(checks: &mut Checks<'_>, key: &KeyPath, written: &schema::ToolShape, folder: &Path) -> Option<ToolShape> {
    match written {
        schema::ToolShape::Sphere(sphere) => {
            let key = key.key("sphere");
            let center = place(checks, &key.key("center"), sphere.center);
            let radius = length(checks, &key.key("radius"), sphere.radius);
            Some(ToolShape::Sphere { center: center?, radius: radius? })
        }
        schema::ToolShape::Capsule(capsule) => {
            let key = key.key("capsule");
            let [from, to] =
                [("from", capsule.from), ("to", capsule.to)].map(|(end, at)| place(checks, &key.key(end), at));
            let radius = length(checks, &key.key("radius"), capsule.radius);
            Some(ToolShape::Capsule { from: from?, to: to?, radius: radius? })
        }
        schema::ToolShape::Box(corners) => {
            let key = key.key("box");
            let [min, max] =
                [("min", corners.min), ("max", corners.max)].map(|(end, at)| place(checks, &key.key(end), at));
            let (min, max) = (min?, max?);
            for axis in 0..3 {
                if min[axis] >= max[axis] {
                    let found = format!("min {} not below max {}", number(min[axis]), number(max[axis]));
                    let expected = format!("min below max along {}: a tool has a volume", ["x", "y", "z"][axis]);
                    checks.out_of_range(&key.key("min").index(axis), found, expected);
                }
            }
            Some(ToolShape::Box { min, max })
        }
        schema::ToolShape::Mesh(mesh) => {
            let key = key.key("mesh").key("file");
            if mesh.file.as_os_str().is_empty() {
                checks.out_of_range(&key, "an empty path", "the path of an STL file");
            }
            Some(ToolShape::Mesh { file: folder.join(&mesh.file) })
        }
    }
}

/// A length above zero that fits in a room.
fn length(checks: &mut Checks<'_>, key: &KeyPath, written: f64) -> Option<f64> {
    let problems = checks.problems.len();
    checks.above_zero(key, written, "mm");
    within_a_room(checks, key, written);
    (checks.problems.len() == problems).then_some(written)
}

/// A place in a room with the patient.
fn place(checks: &mut Checks<'_>, key: &KeyPath, written: Triple) -> Option<Point3> {
    let problems = checks.problems.len();
    let place = checks.triple(key, written, "mm");
    (0..3).for_each(|axis| within_a_room(checks, &key.index(axis), place[axis]));
    (checks.problems.len() == problems).then(|| place.into())
}

/// What is not finite has been reported.
fn within_a_room(checks: &mut Checks<'_>, key: &KeyPath, coordinate: f64) {
    if coordinate.is_finite() && coordinate.abs() > FARTHEST_MM {
        let expected = format!("{} to {} mm", number(-FARTHEST_MM), number(FARTHEST_MM));
        checks.out_of_range(key, format!("{} mm", number(coordinate)), expected);
    }
}
