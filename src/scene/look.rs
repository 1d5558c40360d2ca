//! How an organ's CT numbers become colours: a window, or colours of the user's own.

use super::checks::Checks;
use super::diagnostics::KeyPath;
use super::organs::parse_color;
use super::problem::{Problem, number};
use super::resolved::{Look, LookColor};
use super::schema;
use super::values::{ColorPoint, Pair};

/// Checks and resolves the look of an organ. The outer `None`: a problem was found.
pub(super) fn look(
    checks: &mut Checks<'_>,
    key: &KeyPath,
    written: Option<&schema::Look>,
    volume: &schema::Volume,
) -> Option<Option<Look>> {
    let Some(written) = written else { return Some(None) };
    let before = checks.problems.len();
    // A volume with nothing at all has been reported as such.
    if volume.image.is_none() && volume.phantom.is_none() && volume.labels.is_some() {
        let next = "the look is that of CT numbers, so add the CT: image = \"ct.nii.gz\"".to_owned();
        checks.problem(key, Problem::Missing { key: "volume.image".into(), next });
    }
    let look = match (written.window, &written.colors) {
        (Some(_), Some(_)) => {
            let next =
                "a window takes the shades of the organ's colour, `colors` are at CT numbers of their own".to_owned();
            let problem = Problem::Conflict { first: "window".into(), second: "colors".into(), next };
            checks.problem(&key.key("colors"), problem);
            None
        }
        (None, None) => {
            checks.out_of_range(key, "an empty table", "{ window = [0, 130] } or { colors = [[0, \"#4a1f18\"], ...] }");
            None
        }
        (Some(Pair([low, high])), None) => {
            // Also refuses NaN, and what is equal or infinite in the 32 bits of a CT number.
            let window = [low as f32, high as f32];
            if !(window[0] < window[1] && window.iter().all(|end| end.is_finite())) {
                let found = format!("[{}, {}]", number(low), number(high));
                checks.out_of_range(&key.key("window"), found, "two finite numbers of HU, the smaller first");
            }
            Some(Look::Window(window))
        }
        (None, Some(points)) => Some(Look::Colors(colors(checks, &key.key("colors"), points))),
    };
    (checks.problems.len() == before).then_some(look)
}

fn colors(checks: &mut Checks<'_>, key: &KeyPath, points: &[ColorPoint]) -> Vec<LookColor> {
    if points.len() < 2 {
        let found = if points.len() == 1 { "1 point".to_owned() } else { format!("{} points", points.len()) };
        let expected = "at least two points [HU, \"#rrggbb\"]; for one colour everywhere write color = \"#8c3b2e\"";
        checks.out_of_range(key, found, expected);
    }
    let mut earlier: Option<f64> = None;
    let mut resolved = Vec::new();
    for (index, ColorPoint(hu, text)) in points.iter().enumerate() {
        let point = key.index(index);
        let narrow = *hu as f32;
        if !narrow.is_finite() {
            checks.out_of_range(&point.index(0), number(*hu), "a finite number of HU");
        } else if let Some(earlier) = earlier.filter(|&earlier| narrow <= earlier as f32) {
            let expected =
                format!("more than the {} HU of the point before; give the points by ascending HU", number(earlier));
            checks.out_of_range(&point.index(0), format!("{} HU", number(*hu)), expected);
        }
        earlier = Some(*hu);
        if let Some(color) = parse_color(checks, &point.index(1), text) {
            resolved.push(LookColor { hu: narrow, color });
        }
    }
    resolved
}
