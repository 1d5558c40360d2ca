//! JSON for people: aligned lines, lists of like things as tables, six digits where a number has more.

use serde_json::Value;

/// What something is called comes before what it is like.
const FIRST: [&str; 4] = ["kind", "name", "label", "format"];

/// An object as lines `key  value`; objects inside are indented, lists of objects are tables.
pub(super) fn text(facts: &Value) -> String {
    let mut lines = Vec::new();
    write_object(facts, "", &mut lines);
    lines.join("\n")
}

/// Keys and values, names first.
fn entries(value: &Value) -> Vec<(&str, &Value)> {
    let mut entries: Vec<(&str, &Value)> =
        value.as_object().into_iter().flatten().map(|(key, value)| (key.as_str(), value)).collect();
    entries.sort_by_key(|(key, _)| FIRST.iter().position(|first| first == key).unwrap_or(FIRST.len()));
    entries
}

fn write_object(value: &Value, indent: &str, lines: &mut Vec<String>) {
    let entries = entries(value);
    let width = entries.iter().map(|(key, _)| key.len()).max().unwrap_or(0);
    for (key, value) in entries {
        let deeper = format!("{indent}  ");
        match value {
            Value::Object(_) => {
                lines.push(format!("{indent}{key}"));
                write_object(value, &deeper, lines);
            }
            Value::Array(items) if items.iter().any(Value::is_object) => {
                lines.push(format!("{indent}{key}"));
                write_table(items, &deeper, lines);
            }
            Value::Array(rows) if rows.len() > 2 && rows.iter().all(Value::is_array) => {
                lines.push(format!("{indent}{key}"));
                let rows = rows.iter().map(|row| row.as_array().into_iter().flatten().map(plain).collect()).collect();
                write_columns(rows, &deeper, lines);
            }
            value => lines.push(format!("{indent}{key:width$}  {}", plain(value))),
        }
    }
}

/// Objects with the same keys, one per line under a line of their keys.
fn write_table(items: &[Value], indent: &str, lines: &mut Vec<String>) {
    let Some(first) = items.first() else { return };
    let keys: Vec<&str> = entries(first).into_iter().map(|(key, _)| key).collect();
    let mut rows = vec![keys.iter().map(|key| (*key).to_owned()).collect()];
    rows.extend(items.iter().map(|item| keys.iter().map(|key| plain(&item[*key])).collect()));
    write_columns(rows, indent, lines);
}

/// Rows of cells as lines, each column as wide as its widest cell.
pub(super) fn write_columns(rows: Vec<Vec<String>>, indent: &str, lines: &mut Vec<String>) {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| {
        rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    for row in &rows {
        let cells: Vec<String> = row.iter().zip(&widths).map(|(cell, &width)| format!("{cell:width$}")).collect();
        lines.push(format!("{indent}{}", cells.join("  ").trim_end()));
    }
}

fn plain(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Null => "none".to_owned(),
        Value::Bool(yes) => if *yes { "yes" } else { "no" }.to_owned(),
        Value::Number(number) => match number.as_f64() {
            Some(real) if number.is_f64() => six_digits(real),
            _ => number.to_string(),
        },
        Value::Array(items) if items.is_empty() => "none".to_owned(),
        Value::Array(items) if items.iter().all(Value::is_array) => {
            items.iter().map(|item| format!("({})", plain(item))).collect::<Vec<_>>().join(" to ")
        }
        Value::Array(items) => items.iter().map(plain).collect::<Vec<_>>().join(", "),
        Value::Object(_) => value.to_string(),
    }
}

/// A number with at most six digits that count.
fn six_digits(value: f64) -> String {
    digits(value, 6)
}

/// A number with at most this many digits that count, at least 1.
pub(super) fn digits(value: f64, most: usize) -> String {
    let rounded: f64 = format!("{value:.*e}", most - 1).parse().unwrap_or(value);
    if rounded == 0.0 {
        "0".to_owned()
    } else if (1e-4..1e9).contains(&rounded.abs()) {
        rounded.to_string()
    } else {
        format!("{rounded:e}")
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn names_come_first_and_numbers_are_short() {
        let facts = json!({
            "dt_s": 0.000_227_272_727, "axes": "RAS", "kind": "scene", "bounds_ras_mm": [[0.0, 1.5], [2.0, 3.25]], "empty": [],
            "closed": true, "stable_dt_s": null, "tiny": -1.234_567_89e-7, "steps": 12,
        });
        let expected = "kind           scene\naxes           RAS\nbounds_ras_mm  (0, 1.5) to (2, 3.25)\nclosed         yes\n\
                        dt_s           0.000227273\nempty          none\nstable_dt_s    none\nsteps          12\n\
                        tiny           -1.23457e-7";
        assert_eq!(text(&facts), expected);
    }

    #[test]
    fn lists_of_objects_are_tables() {
        let facts = json!({
            "organs": [{ "particles": 12, "name": "liver" }, { "particles": 3456, "name": "bone" }],
            "status": { "state": "complete" },
        });
        let expected = "organs\n  name   particles\n  liver  12\n  bone   3456\nstatus\n  state  complete";
        assert_eq!(text(&facts), expected);
    }
}
