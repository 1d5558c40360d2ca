//! The pictures of a study.

use std::path::Path;

use super::findings::{Findings, Row};
use super::ledger::SurfaceLine;
use super::order::fit;
use super::pareto::front;
use super::surface_distance::SurfaceDistance;
use super::surfaces::LATTICE;
use crate::plot::{Axis, Plot, PlotError, Series, Stroke};

/// Error against time of all choices, one colour for each pitch, with the front.
pub const ERROR_TIME: &str = "error-time.png";
/// Error of the step alone against the step.
pub const ORDERS: &str = "orders.png";
/// Error against pitch.
pub const PITCHES: &str = "pitches.png";
/// Distance of surfaces against the time to draw them.
pub const SURFACES: &str = "surfaces.png";
/// All of them.
pub const ALL: [&str; 4] = [ERROR_TIME, ORDERS, PITCHES, SURFACES];

/// A choice is ringed when it is better by this share than all that are faster.
const GAIN: f64 = 0.02;

/// Time \[s\] and relative error (rms) of a row: of step and pitch where the pitch's is known, else of the step.
pub fn point(row: &Row, findings: &Findings) -> Option<[f64; 2]> {
    let error = match (row.error, row.time_error, &findings.space_law) {
        (Some(both), ..) => both.rms_mm,
        (None, Some(time), None) => time.rms_mm,
        _ => return None,
    };
    let point = [row.least_seconds(), error / findings.largest_mm];
    point.iter().all(|&x| x > 0.0 && x.is_finite()).then_some(point)
}

/// Writes every picture that there are points for, and returns their names.
///
/// # Errors
/// If one cannot be written.
pub fn write(findings: &Findings, surfaces: &[&SurfaceLine], folder: &Path) -> Result<Vec<&'static str>, PlotError> {
    let plots = [
        (ERROR_TIME, error_time(findings)),
        (ORDERS, orders(findings)),
        (PITCHES, pitches(findings)),
        (SURFACES, surface_times(surfaces)),
    ];
    let mut names = Vec::new();
    for (name, plot) in plots {
        if plot.series.iter().any(|series| !series.points.is_empty()) {
            plot.write_png(&folder.join(name))?;
            names.push(name);
        }
    }
    Ok(names)
}

/// Rows of the grid proper.
fn grid(findings: &Findings) -> impl Iterator<Item = &Row> {
    findings.rows.iter().filter(|row| !row.reference)
}

fn error_time(findings: &Findings) -> Plot {
    let points: Vec<[f64; 2]> = grid(findings).filter_map(|row| point(row, findings)).collect();
    let best = front(&points, GAIN).into_iter().map(|n| points[n]).collect();
    let mut series = vec![Series { name: "worth their time".to_owned(), points: best, stroke: Stroke::Rings }];
    series.extend(kinds(findings).into_iter().map(|(name, rows)| {
        let mut points: Vec<[f64; 2]> = rows.into_iter().filter_map(|row| point(row, findings)).collect();
        points.sort_by(|a, b| a[0].total_cmp(&b[0]));
        Series { name, points, stroke: Stroke::Discs }
    }));
    series.retain(|series| !series.points.is_empty());
    let what = if findings.space_law.is_some() { "step and pitch" } else { "the step" };
    Plot {
        title: format!("Error of {what} against time"),
        x: Axis::logarithmic("time of a run", "s"),
        y: Axis::logarithmic("error (rms) over largest displacement", ""),
        series,
    }
}

/// Rows by integrator, pitch and arithmetic, with a name for each kind.
fn kinds(findings: &Findings) -> Vec<(String, Vec<&Row>)> {
    let mut kinds: Vec<(String, Vec<&Row>)> = Vec::new();
    let first = findings.rows.first().map(|row| row.choice.integrator.clone());
    for row in grid(findings) {
        let choice = &row.choice;
        let mut name = format!("{} mm", choice.pitch_mm);
        if Some(&choice.integrator) != first.as_ref() {
            name = format!("{name} {}", choice.integrator);
        }
        if choice.exact {
            name.push_str(" exact");
        }
        match kinds.iter_mut().find(|kind| kind.0 == name) {
            Some((_, rows)) => rows.push(row),
            None => kinds.push((name, vec![row])),
        }
    }
    kinds.sort_by(|a, b| {
        let of = |kind: &(String, Vec<&Row>)| kind.1.first().map_or(0.0, |row| row.choice.pitch_mm);
        of(b).total_cmp(&of(a))
    });
    kinds
}

fn orders(findings: &Findings) -> Plot {
    let mut series = Vec::new();
    for (name, rows) in kinds(findings) {
        let of = |row: &&Row| Some([row.dt_s, row.time_error?.rms_mm]).filter(|p| p[1] > 0.0);
        let mut points: Vec<[f64; 2]> = rows.iter().filter_map(of).collect();
        points.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let clear: Vec<[f64; 2]> = rows.iter().filter(|row| row.shows_order).filter_map(of).collect();
        let slope = fit(&clear).map_or(String::new(), |law| format!(", order {:.2}", law.slope));
        series.push(Series { name: format!("{name}{slope}"), points, stroke: Stroke::Marked });
    }
    series.retain(|series| !series.points.is_empty());
    Plot {
        title: "Error of the step alone".to_owned(),
        x: Axis::logarithmic("step", "s"),
        y: Axis::logarithmic("error (rms)", "mm"),
        series,
    }
}

fn pitches(findings: &Findings) -> Plot {
    let seen = |part: fn(&super::deviation::Deviation) -> f64| {
        let levels = findings.levels.iter();
        levels.filter_map(|level| Some([level.pitch_mm, part(&level.from_finest?)])).filter(|p| p[1] > 0.0).collect()
    };
    let estimated = findings.levels.iter().filter_map(|level| Some([level.pitch_mm, level.space_error?.rms_mm]));
    let law = findings.space_law.map_or(String::new(), |law| {
        if law.found { format!(", order {:.2}", law.order) } else { ", order 1 assumed".to_owned() }
    });
    let mut series = vec![
        Series { name: "seen (max)".to_owned(), points: seen(|d| d.max_mm), stroke: Stroke::Discs },
        Series { name: "seen (rms)".to_owned(), points: seen(|d| d.rms_mm), stroke: Stroke::Discs },
        Series { name: format!("estimated (rms){law}"), points: estimated.collect(), stroke: Stroke::Dashed },
    ];
    series.retain(|series| !series.points.is_empty());
    let finest = findings.levels.last().map_or(0.0, |level| level.pitch_mm);
    Plot {
        title: format!("Error of the pitch, seen against {finest} mm"),
        x: Axis::logarithmic("pitch", "mm"),
        y: Axis::logarithmic("distance", "mm"),
        series,
    }
}

fn surface_times(surfaces: &[&SurfaceLine]) -> Plot {
    type Part = fn(&SurfaceDistance) -> f64;
    let parts: [(&str, Part); 2] = [("Hausdorff", |d| d.hausdorff_mm), ("mean", |d| d.mean_mm)];
    let points = |of_lattice: bool, part: Part| -> Vec<[f64; 2]> {
        let own = surfaces.iter().filter(|line| (line.resolution == LATTICE) == of_lattice);
        let points = own.filter_map(|line| Some([line.seconds, part(&line.distance?)]));
        points.filter(|point| point.iter().all(|&x| x > 0.0)).collect()
    };
    // From coarse to fine, as they were measured.
    let fine = parts.map(|(name, part)| (name.to_owned(), points(false, part), Stroke::Marked));
    let lattice = parts.map(|(name, part)| (format!("{name}, of the lattice"), points(true, part), Stroke::Discs));
    let all = fine.into_iter().chain(lattice);
    let series = all.filter(|(_, points, _)| !points.is_empty());
    Plot {
        title: "Distance from the finest surface against time".to_owned(),
        x: Axis::logarithmic("time to draw a frame", "s"),
        y: Axis::logarithmic("distance", "mm"),
        series: series.map(|(name, points, stroke)| Series { name, points, stroke }).collect(),
    }
}
