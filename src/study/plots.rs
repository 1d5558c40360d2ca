//! The pictures of a study.

use std::path::Path;

use super::choice::{Arithmetic, Choice, METHODS};
use super::findings::{Findings, Row};
use super::ledger::SurfaceLine;
use super::pareto::front;
use super::surface_distance::SurfaceDistance;
use super::surfaces::LATTICE;
use crate::dynamics::integrator::Method;
use crate::plot::{Axis, Plot, PlotError, Series, Stroke};

/// Error against time of all choices, one colour for each pitch, with the front.
pub const ERROR_TIME: &str = "error-time.png";
/// Error of the step alone against time, one colour for each integrator.
pub const INTEGRATORS: &str = "integrators.png";
/// Error of the step alone against the step, the same.
pub const ORDERS: &str = "orders.png";
/// Error against pitch.
pub const PITCHES: &str = "pitches.png";
/// Distance of surfaces against the time to draw them.
pub const SURFACES: &str = "surfaces.png";
/// All of them.
pub const ALL: [&str; 5] = [ERROR_TIME, INTEGRATORS, ORDERS, PITCHES, SURFACES];

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
        (INTEGRATORS, integrators(findings)),
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
    series.extend(findings.levels.iter().map(|level| {
        let own = grid(findings).filter(|row| row.choice.pitch_mm == level.pitch_mm);
        let points = own.filter_map(|row| point(row, findings)).collect();
        Series { name: format!("{} mm", level.pitch_mm), points, stroke: Stroke::Discs }
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

/// Rows of the scene's own pitch by integrator, coarsest step first.
fn by_integrator(findings: &Findings) -> Vec<(Method, Vec<&Row>)> {
    let kind = |&integrator: &_| {
        let own = |row: &&Row| {
            let Choice { integrator: other, pitch_mm, arithmetic, .. } = row.choice;
            (other, pitch_mm, arithmetic) == (integrator, findings.base_mm, findings.usual)
        };
        let mut rows: Vec<&Row> = grid(findings).filter(own).collect();
        rows.sort_by(|a, b| a.choice.fineness.total_cmp(&b.choice.fineness));
        (integrator, rows)
    };
    METHODS.iter().map(kind).filter(|(_, rows)| !rows.is_empty()).collect()
}

/// One line for each integrator.
fn lines(findings: &Findings, point: impl Fn(&Row) -> Option<[f64; 2]>) -> Vec<Series> {
    let line = |(integrator, rows): (Method, Vec<&Row>)| {
        let points = rows.into_iter().filter_map(&point).filter(|p| p.iter().all(|&x| x > 0.0 && x.is_finite()));
        let name = integrator.name().to_owned();
        Series { name, points: points.collect(), stroke: Stroke::Marked }
    };
    by_integrator(findings).into_iter().map(line).filter(|series| !series.points.is_empty()).collect()
}

fn integrators(findings: &Findings) -> Plot {
    let point = |row: &Row| Some([row.least_seconds(), row.time_error?.rms_mm / findings.largest_mm]);
    let mut series = lines(findings, point);
    // Other numbers are points of their own.
    series.extend(Arithmetic::ALL.into_iter().filter(|&arithmetic| arithmetic != findings.usual).filter_map(
        |arithmetic| {
            let own = grid(findings).filter(|row| row.choice.arithmetic == arithmetic);
            let points: Vec<[f64; 2]> =
                own.filter_map(point).filter(|p| p.iter().all(|&x| x > 0.0 && x.is_finite())).collect();
            let name = arithmetic.name().to_owned();
            (!points.is_empty()).then_some(Series { name, points, stroke: Stroke::Discs })
        },
    ));
    Plot {
        title: format!("Error of the step alone against time, {} mm", findings.base_mm),
        x: Axis::logarithmic("time of a run", "s"),
        y: Axis::logarithmic("error (rms) over largest displacement", ""),
        series,
    }
}

fn orders(findings: &Findings) -> Plot {
    let mut series = lines(findings, |row| Some([row.dt_s, row.time_error?.rms_mm]));
    let base = findings.levels.iter().find(|level| level.pitch_mm == findings.base_mm);
    for order in base.map_or(&[][..], |level| &level.time_orders) {
        if let Some(line) = series.iter_mut().find(|line| line.name == order.integrator.name()) {
            line.name = format!("{}, order {:.2}", line.name, order.law.slope);
        }
    }
    Plot {
        title: format!("Error of the step alone, {} mm", findings.base_mm),
        x: Axis::logarithmic("step (mean step where it is divided by its error)", "s"),
        y: Axis::logarithmic("error (rms)", "mm"),
        series,
    }
}

fn pitches(findings: &Findings) -> Plot {
    let seen = |part: fn(&crate::deviation::Deviation) -> f64| {
        let levels = findings.levels.iter();
        levels.filter_map(|level| Some([level.pitch_mm, part(&level.from_finest?)])).filter(|p| p[1] > 0.0).collect()
    };
    let estimated = findings.levels.iter().filter_map(|level| Some([level.pitch_mm, level.space_error?.rms_mm]));
    let law = findings
        .space_law
        .map_or(String::new(), |law| format!(", order {:.2}{}", law.order, if law.found { "" } else { " assumed" }));
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
