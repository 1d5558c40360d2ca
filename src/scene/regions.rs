//! Regions as written, to regions as selected: shapes that exist, organs by number.

use super::checks::Checks;
use super::diagnostics::KeyPath;
use super::problem::{Problem, nearest_name, number};
use super::schema::{self, SceneFile};
use super::values::Triple;
use crate::geometry::{Point3, Vector3};
use crate::lattice::region::Region;

/// Checks and resolves a region; `None` when it cannot be built. Whether it holds particles shows with the lattice.
pub(super) fn region(
    checks: &mut Checks<'_>,
    key: &KeyPath,
    written: &schema::Region,
    file: &SceneFile,
) -> Option<Region> {
    match written {
        schema::Region::Sphere(sphere) => {
            let key = key.key("sphere");
            let center = Point3::from(checks.triple(&key.key("center"), sphere.center, "mm"));
            let radius = checks.above_zero(&key.key("radius"), sphere.radius, "mm");
            Some(Region::Sphere { center, radius })
        }
        schema::Region::Box(corners) => {
            let key = key.key("box");
            let min = checks.triple(&key.key("min"), corners.min, "mm");
            let max = checks.triple(&key.key("max"), corners.max, "mm");
            for axis in 0..3 {
                if min[axis] > max[axis] {
                    let found = format!("min {} above max {}", number(min[axis]), number(max[axis]));
                    let expected = format!("min at most max along {}", ["x", "y", "z"][axis]);
                    checks.out_of_range(&key.key("min").index(axis), found, expected);
                }
            }
            Some(Region::Box { min: min.into(), max: max.into() })
        }
        schema::Region::HalfSpace(half_space) => {
            let key = key.key("half_space");
            let point = Point3::from(checks.triple(&key.key("point"), half_space.point, "mm"));
            let normal = direction(checks, &key.key("normal"), half_space.normal, "a direction into the region");
            Some(Region::HalfSpace { point, normal })
        }
        schema::Region::Organ(name) => {
            let index = file.organ.iter().position(|organ| organ.name == *name);
            if index.is_none() {
                let known: Vec<String> = file.organ.iter().map(|organ| organ.name.clone()).collect();
                let suggestion = nearest_name(name, known.iter().map(String::as_str));
                let problem = Problem::UnknownName { kind: "organ", found: name.clone(), suggestion, known };
                checks.problem(&key.key("organ"), problem);
            }
            index.map(Region::Organ)
        }
        schema::Region::Nearest(nearest) => {
            let key = key.key("nearest");
            let point = Point3::from(checks.triple(&key.key("point"), nearest.point, "mm"));
            let count = u32::try_from(nearest.count).ok().filter(|&count| count > 0);
            if count.is_none() {
                let expected = format!("1 to {} particles", u32::MAX);
                checks.out_of_range(&key.key("count"), nearest.count.to_string(), expected);
            }
            Some(Region::Nearest { point, count: count? as usize })
        }
        schema::Region::All(list) => several(checks, &key.key("all"), list, file).map(Region::All),
        schema::Region::Any(list) => several(checks, &key.key("any"), list, file).map(Region::Any),
        schema::Region::Not(inner) => {
            region(checks, &key.key("not"), inner, file).map(|inner| Region::Not(Box::new(inner)))
        }
    }
}

/// A vector that has a direction.
///
/// - `expected`: what it is, in words.
pub(super) fn direction(checks: &mut Checks<'_>, key: &KeyPath, written: Triple, expected: &str) -> Vector3 {
    let normal = Vector3::from(checks.triple(key, written, "any unit"));
    let length = normal.norm();
    // Shorter or longer than this its square would not be a number.
    if written.0.iter().all(|part| part.is_finite()) && !(1e-150..=1e150).contains(&length) {
        let found = format!("a normal of length {}", number(length));
        let expected = format!("{expected}, such as [0, 0, 1]");
        checks.problem(key, Problem::Degenerate { found, expected });
    }
    normal
}

fn several(checks: &mut Checks<'_>, key: &KeyPath, list: &[schema::Region], file: &SceneFile) -> Option<Vec<Region>> {
    if list.is_empty() {
        checks.out_of_range(key, "an empty list", "at least one region");
    }
    // Every entry is checked before the first failure counts, so that all faults are reported together.
    let entries: Vec<Option<Region>> =
        list.iter().enumerate().map(|(index, entry)| region(checks, &key.index(index), entry, file)).collect();
    entries.into_iter().collect()
}
