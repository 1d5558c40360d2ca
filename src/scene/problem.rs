//! What can be wrong with a scene, and what is worth a warning.
//!
//! A message gives the value found, what was expected and what to do next; the key and the place around it come from
//! [`Located`](super::Located).

use super::diagnostics::KeyPath;

/// Why a scene cannot be run.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Problem {
    /// The text is not TOML, or a value has the wrong type.
    #[error("{message}")]
    Toml {
        /// What the reader found and expected.
        message: String,
    },
    /// A key that no scene has at this place.
    #[error("unknown key `{found}`{}; {}", did_you_mean(suggestion), known_names("keys", known))]
    UnknownKey {
        /// The key.
        found: String,
        /// The known key that is spelt almost like it.
        suggestion: Option<String>,
        /// All keys known at this place.
        known: Vec<String>,
    },
    /// A word or name that means nothing at this place.
    #[error("there is no {kind} `{found}`{}; {}", did_you_mean(suggestion), known_names("names", known))]
    UnknownName {
        /// What it should have named.
        kind: &'static str,
        /// The name.
        found: String,
        /// The known name that is spelt almost like it.
        suggestion: Option<String>,
        /// All names known at this place.
        known: Vec<String>,
    },
    /// A key that is needed and not written.
    #[error("`{key}` is missing; {next}")]
    Missing {
        /// The key.
        key: String,
        /// What to write.
        next: String,
    },
    /// A value outside its range, NaN or infinite.
    #[error("found {found}, expected {expected}")]
    OutOfRange {
        /// The value.
        found: String,
        /// The range, with its unit.
        expected: String,
    },
    /// Two keys of which only one may be written.
    #[error("`{first}` and `{second}` exclude each other; {next}")]
    Conflict {
        /// One key.
        first: String,
        /// The other.
        second: String,
        /// Which one to keep.
        next: String,
    },
    /// A material key of the other model.
    #[error(
        "`{key}` belongs to model \"{belongs_to}\", but this scene uses model \"{model}\", which takes {takes}; \
         leave `{key}` out or set lattice.model = \"{belongs_to}\""
    )]
    OtherModel {
        /// The key.
        key: &'static str,
        /// The model that has it.
        belongs_to: &'static str,
        /// The model of the scene.
        model: &'static str,
        /// The keys this model takes.
        takes: &'static str,
    },
    /// Two things with one name.
    #[error("the name `{name}` is already taken by {first}; give each {kind} a name of its own")]
    DuplicateName {
        /// What bears the name.
        kind: &'static str,
        /// The name.
        name: String,
        /// The key of the first that bears it.
        first: String,
    },
    /// A label that two organs select.
    #[error("label {label} is already selected by {first}; a voxel can belong to one organ only")]
    DuplicateLabel {
        /// The label, with its name if it was given by name.
        label: String,
        /// The organ that selected it first.
        first: String,
    },
    /// A time that does not come after another.
    #[error("{found} s is not after {earlier_name} = {earlier} s; expected a later time")]
    NotAfter {
        /// The time [s].
        found: String,
        /// The key of the earlier time.
        earlier_name: &'static str,
        /// The earlier time [s].
        earlier: String,
    },
    /// A shape without the extent it needs.
    #[error("{found}; expected {expected}")]
    Degenerate {
        /// What it is.
        found: String,
        /// What is needed.
        expected: String,
    },
    /// The names of the labels could not be read.
    #[error("the label names could not be read: {message}; correct the file, or give labels by number")]
    LabelNames {
        /// Why.
        message: String,
    },
}

/// Something in a scene that can be run but is probably not meant.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Caution {
    /// An operation that begins after the end of the run.
    #[error("{operation} begins at {from} s but the run ends at {duration} s, so it never happens; lengthen the run")]
    NeverHappens {
        /// The operation.
        operation: String,
        /// Its beginning [s].
        from: String,
        /// The end of the run [s].
        duration: String,
    },
    /// A cut or a grab that the end of the run breaks off.
    #[error(
        "{operation} is finished at {to} s but the run ends at {duration} s; lengthen the run or finish it earlier"
    )]
    NeverFinished {
        /// The operation.
        operation: String,
        /// Its planned end [s].
        to: String,
        /// The end of the run [s].
        duration: String,
    },
    /// An operation that ends before it has reached its goal.
    #[error("{operation} ends at {until} s, before {goal} at {at} s; is that meant?")]
    EndsEarly {
        /// The operation.
        operation: String,
        /// Its end [s].
        until: String,
        /// What it does not reach.
        goal: &'static str,
        /// When it would be reached [s].
        at: String,
    },
    /// A value far from any tissue, as if given in another unit.
    #[error("{found} {unit} is outside what tissue has ({usual} {unit}); check the unit: {hint}")]
    UnusualValue {
        /// The value.
        found: String,
        /// The unit it is read in.
        unit: &'static str,
        /// The usual range.
        usual: &'static str,
        /// What the number might have been meant as.
        hint: &'static str,
    },
    /// A Poisson's ratio below that of springs alone, so that the volume term takes stiffness away.
    #[error(
        "Poisson's ratio {found} is below 0.25, which is sound at small strain only: cells resist being squeezed less \
         than their springs do and may collapse; use 0.25 or more for large deformations"
    )]
    SmallStrainOnly {
        /// The value.
        found: String,
    },
    /// Fibres in an organ that nothing damps.
    #[error(
        "fibres without damping: they go slack and taut in turn, and the steps hand energy to their motion that nothing takes \
         away; give the organ a damping_ratio of 0.01 or more, or a viscosity"
    )]
    UndampedFibres,
    /// Two organs whose HU ranges overlap.
    #[error("[{min}, {max}] HU overlaps the range of {first}, which takes the common voxels because it comes first")]
    OverlappingHu {
        /// Lowest value [HU].
        min: String,
        /// Highest value [HU].
        max: String,
        /// The organ that comes first.
        first: String,
    },
    /// Gravity, but nothing that holds the organs.
    #[error(
        "nothing holds the organs, so they fall freely; add a [[fix]], a [[plane]], an organ with `rigid = true` and no density, \
         or a grab"
    )]
    FreeFall,
    /// No force, no motion: the run would show the rest state.
    #[error(
        "nothing moves the organs, so every frame shows them at rest; add a [[pull]], a [[push]], a [[pressure]], a [[tool]] with a \
         path, or [gravity]"
    )]
    NothingMoves,
}

impl Problem {
    /// Turns a message of serde into a problem, adding near misses to unknown names.
    pub(super) fn from_reader(message: &str, key: &KeyPath) -> Self {
        // serde's wording: "unknown field `x`, expected one of `a`, `b`" and "missing field `x`".
        let mut quoted = message.split('`').skip(1).step_by(2).map(str::to_owned);
        let mut unknown = || {
            let found = quoted.next().unwrap_or_default();
            let known: Vec<String> = quoted.by_ref().collect();
            (nearest_name(&found, known.iter().map(String::as_str)), found, known)
        };
        if message.starts_with("unknown field `") {
            let (suggestion, found, known) = unknown();
            return Self::UnknownKey { found, suggestion, known };
        }
        if message.starts_with("unknown variant `") {
            let (suggestion, found, known) = unknown();
            let is_region = known.iter().any(|name| name == "half_space");
            let kind = match key.to_string().as_str() {
                "lattice.model" => "model",
                "volume.phantom" => "phantom",
                _ if known.iter().any(|name| name == "capsule") => "shape",
                _ if is_region => "region",
                _ => "choice",
            };
            // A label is selected through the organ that holds it.
            let suggestion = if is_region && found == "label" { Some("organ".to_owned()) } else { suggestion };
            return Self::UnknownName { kind, found, suggestion, known };
        }
        if let Some(name) = message.strip_prefix("missing field `").and_then(|rest| rest.strip_suffix('`')) {
            return Self::Missing { key: name.to_owned(), next: what_to_write(name).to_owned() };
        }
        if message.starts_with("wanted exactly 1 element") {
            let found = message.rsplit(", ").next().unwrap_or(message).replace("found ", "").replace("element", "key");
            if key.to_string().starts_with("tool[") {
                return Self::OutOfRange { found, expected: "exactly one of sphere, capsule, box, mesh".to_owned() };
            }
            let expected = "exactly one of sphere, box, half_space, organ, nearest, all, any, not; combine regions with \
                            all = [...] or any = [...]";
            return Self::OutOfRange { found, expected: expected.to_owned() };
        }
        if key.to_string() == "gravity" && message.starts_with("invalid type") {
            let next = "write [gravity] and below it acceleration = [0, 0, -9.81] (m/s2)";
            return Self::Toml { message: format!("{message}; {next}") };
        }
        let message =
            message.replace("expected f64", "expected a number").replace("expected u64", "expected a whole number");
        Self::Toml { message }
    }
}

/// The next step for each key that a table cannot do without.
fn what_to_write(key: &str) -> &'static str {
    match key {
        "volume" => "add a [volume] table that says where the voxels come from",
        "organ" => "add an [[organ]] table for each organ",
        "time" => "add a [time] table with `duration = ...` (s)",
        "name" => "give the organ a name, such as name = \"liver\"",
        "region" => "say which particles, such as region = { organ = \"liver\" }",
        "blade" => "give the edge of the blade, such as blade = [[-60, 0, 0], [60, 0, 0]] (mm)",
        "path" => "give offsets of the blade, such as path = [[0, 80, 0], [0, 0, 0]] (mm)",
        "to" => "say when the cut is finished, such as to = 0.15 (s)",
        "pressure" => "give it in Pa, such as pressure = 2e3 (1 mmHg is 133 Pa)",
        "of" => "name the fix, pull, push, pressure, tool or plane that ends, such as of = \"pull 1\"",
        "at" => "say when, such as at = 0.3 (s)",
        "acceleration" => "write acceleration = [0, 0, -9.81] (m/s2)",
        "direction" => "write direction = [0, 0, 1] (RAS+)",
        "modulus" => "write modulus = 2e4 (Pa)",
        "rate" => "write rate = 2.0 (1/s)",
        "radius" => "give it in mm, such as radius = 12",
        "shape" => "give its shape, such as shape = { sphere = { center = [0, 0, 40], radius = 10 } } (mm)",
        "file" => "name the file, such as file = \"tool.stl\"",
        _ => "write [x, y, z] in mm, such as [10, -40, 0]",
    }
}

/// The name spelt most like `found`, if at most a third of it (and always one letter) would have to change.
pub(super) fn nearest_name<'n>(found: &str, known: impl IntoIterator<Item = &'n str>) -> Option<String> {
    let allowed = (found.chars().count() / 3).max(1);
    let distance = |name: &str| edit_distance(&found.to_lowercase(), &name.to_lowercase());
    known
        .into_iter()
        .map(|name| (distance(name), name))
        .filter(|&(distance, _)| distance <= allowed)
        .min()
        .map(|(_, name)| name.to_owned())
}

/// Letters to insert, delete, replace or swap with their neighbour (optimal string alignment distance).
fn edit_distance(a: &str, b: &str) -> usize {
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
    let mut two_back = vec![0; b.len() + 1];
    let mut back: Vec<usize> = (0..=b.len()).collect();
    for i in 1..=a.len() {
        let mut row = vec![i; b.len() + 1];
        for j in 1..=b.len() {
            let replaced = back[j - 1] + usize::from(a[i - 1] != b[j - 1]);
            row[j] = replaced.min(back[j] + 1).min(row[j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                row[j] = row[j].min(two_back[j - 2] + 1);
            }
        }
        two_back = std::mem::replace(&mut back, row);
    }
    back[b.len()]
}

/// A number as a user would write it: plain where that is short, else with an exponent.
pub(super) fn number(value: f64) -> String {
    let plain = value == 0.0 || !value.is_finite() || (1e-4..1e7).contains(&value.abs());
    if plain { format!("{value}") } else { format!("{value:e}") }
}

fn did_you_mean(suggestion: &Option<String>) -> String {
    suggestion.as_ref().map_or(String::new(), |name| format!(", did you mean `{name}`?"))
}

/// The names to choose from; long lists (labels of a whole body) are cut short.
fn known_names(kind: &str, known: &[String]) -> String {
    const SHOWN: usize = 24;
    if known.is_empty() {
        return format!("no {kind} are known here");
    }
    let mut text = format!("known {kind}: {}", known[..known.len().min(SHOWN)].join(", "));
    if known.len() > SHOWN {
        text += &format!(" and {} more", known.len() - SHOWN);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_misses_are_found_and_far_ones_are_not() {
        let known = ["density", "damping", "damping_ratio", "duration", "hu"];
        let nearest = |found| nearest_name(found, known);
        assert_eq!(nearest("densty").as_deref(), Some("density"));
        assert_eq!(nearest("dampnig").as_deref(), Some("damping"));
        assert_eq!(nearest("dampingratio").as_deref(), Some("damping_ratio"));
        assert_eq!(nearest("Hu").as_deref(), Some("hu"));
        assert_eq!(nearest("color"), None);
        assert_eq!(nearest(""), None);
    }

    #[test]
    fn distances_count_edits() {
        for (a, b, distance) in [("", "abc", 3), ("abc", "abc", 0), ("abc", "acb", 1), ("kitten", "sitting", 3)] {
            assert_eq!(edit_distance(a, b), distance, "{a} {b}");
            assert_eq!(edit_distance(b, a), distance, "{b} {a}");
        }
    }

    #[test]
    fn numbers_stay_short() {
        let shown = [0.0, -3.0, 1e-4, 5e-324, 1e12, f64::NAN, f64::INFINITY].map(number);
        assert_eq!(shown, ["0", "-3", "0.0001", "5e-324", "1e12", "NaN", "inf"]);
    }
}
