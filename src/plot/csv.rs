//! The numbers of a plot as a table.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;

use super::Plot;
use crate::io::atomic;

pub(super) fn write(plot: &Plot, path: &Path) -> io::Result<()> {
    // Rows by x in ascending order; a series that has an x twice takes as many rows.
    let mut rows: BTreeMap<(u64, usize), Vec<Option<f64>>> = BTreeMap::new();
    for (column, series) in plot.series.iter().enumerate() {
        let mut repeats = BTreeMap::new();
        for &[x, y] in &series.points {
            let repeat = repeats.entry(order(x)).or_insert(0);
            let row = rows.entry((order(x), *repeat)).or_insert_with(|| vec![None; 1 + plot.series.len()]);
            *repeat += 1;
            row[0] = Some(x);
            row[1 + column] = Some(y);
        }
    }
    atomic::write_file(path, |out| {
        let unit = if plot.y.unit.is_empty() { String::new() } else { format!(" [{}]", plot.y.unit) };
        let names = plot.series.iter().map(|series| format!("{}{unit}", series.name));
        let head: Vec<String> = std::iter::once(plot.x.caption()).chain(names).map(|name| field(&name)).collect();
        write!(out, "{}\r\n", head.join(","))?;
        for row in rows.values() {
            let cells: Vec<String> =
                row.iter().map(|cell| cell.map_or(String::new(), |value| value.to_string())).collect();
            write!(out, "{}\r\n", cells.join(","))?;
        }
        Ok(())
    })
}

/// A key that sorts like the number; -0 and 0 are one.
fn order(x: f64) -> u64 {
    let bits = (x + 0.0).to_bits();
    if bits >> 63 == 1 { !bits } else { bits | 1 << 63 }
}

fn field(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_string() }
}

#[cfg(test)]
mod tests {
    use super::super::{Axis, Series, Stroke};
    use super::*;

    #[test]
    fn series_share_their_x() {
        let series = |name: &str, points: &[[f64; 2]]| Series {
            name: name.into(),
            points: points.to_vec(),
            stroke: Stroke::Line,
        };
        let plot = Plot {
            title: String::new(),
            x: Axis::linear("time", "s"),
            y: Axis::linear("change", "%"),
            series: vec![
                series("by cells", &[[-1.0, 0.1], [0.5, 1e-7]]),
                series("a, b", &[[0.5, 2.0], [0.5, 3.0], [9.0, 4.0]]),
            ],
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("v.csv");
        plot.write_csv(&path).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let expected = "time [s],by cells [%],\"a, b [%]\"\r\n-1,0.1,\r\n0.5,0.0000001,2\r\n0.5,,3\r\n9,,4\r\n";
        assert_eq!(text, expected);
    }
}
