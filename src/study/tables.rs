//! The rows of a study as CSV and JSON.

use std::fmt::Write;

use serde_json::{Value, json};

use super::findings::{Findings, Row};
use super::ledger::{Ledger, RoundingLine, SurfaceLine};
use super::plan::Plan;

/// Columns of the table, with units.
const COLUMNS: [&str; 31] = [
    "integrator",
    "pitch_mm",
    "fineness",
    "arithmetic",
    "tolerance_mm",
    "reference",
    "particles",
    "dt_s",
    "steps",
    "divided_steps",
    "force_evaluations",
    "severed_springs",
    "seconds_min",
    "seconds_median",
    "repeats",
    "same_bits",
    "time_error_rms_mm",
    "time_error_99_percent_mm",
    "time_error_max_mm",
    "time_error_rms_relative",
    "time_resolved",
    "from_usual_arithmetic_rms_mm",
    "space_error_rms_mm",
    "space_error_max_mm",
    "error_rms_mm",
    "error_max_mm",
    "volume_error_relative",
    "energy_error_relative",
    "momentum_error_kg_m_per_s",
    "surface_hausdorff_mm",
    "surface_mean_mm",
];

/// One row for each choice, RFC 4180; what is not known is empty.
///
/// # Panics
/// Never: writing to a string does not fail.
pub fn csv(findings: &Findings) -> String {
    let mut text = COLUMNS.join(",");
    text.push_str("\r\n");
    for row in &findings.rows {
        let fields = fields(row, findings.largest_mm);
        write!(text, "{}\r\n", fields.join(",")).expect("text");
    }
    text
}

fn fields(row: &Row, largest_mm: f64) -> Vec<String> {
    let number = |value: Option<f64>| value.filter(|v| v.is_finite()).map_or(String::new(), |v| format!("{v:e}"));
    let Row { choice, time_error, space_error, error, surface, .. } = row;
    vec![
        choice.integrator.name().to_owned(),
        choice.pitch_mm.to_string(),
        choice.fineness.to_string(),
        choice.arithmetic.to_string(),
        number(choice.tolerance().map(|tolerance| tolerance * 1e3)),
        row.reference.to_string(),
        row.particles.to_string(),
        number(Some(row.dt_s)),
        row.steps.to_string(),
        row.divided.to_string(),
        row.evaluations.to_string(),
        row.severed.to_string(),
        number(Some(row.least_seconds())),
        number(Some(row.median_seconds())),
        row.seconds.len().to_string(),
        row.same_bits.to_string(),
        number(time_error.map(|e| e.rms_mm)),
        number(time_error.map(|e| e.most_mm)),
        number(time_error.map(|e| e.max_mm)),
        number(time_error.map(|e| e.rms_mm / largest_mm)),
        row.time_resolved.to_string(),
        number(row.from_usual.map(|apart| apart.rms_mm)),
        number(space_error.map(|e| e.rms_mm)),
        number(space_error.map(|e| e.max_mm)),
        number(error.map(|e| e.rms_mm)),
        number(error.map(|e| e.max_mm)),
        number(row.volume_error),
        number(row.energy_error),
        number(row.momentum_error),
        number(surface.map(|s| s.hausdorff_mm)),
        number(surface.map(|s| s.mean_mm)),
    ]
}

/// Everything that was found, with what was left out.
pub fn json(findings: &Findings, plan: &Plan, ledger: &Ledger) -> Value {
    let surfaces: Vec<&SurfaceLine> = ledger.surfaces().collect();
    let rounding: Option<&RoundingLine> = ledger.rounding();
    let left_out: Vec<Value> =
        plan.left_out.iter().map(|left| json!({ "choice": left.choice, "seconds": left.seconds })).collect();
    json!({
        "version": env!("CARGO_PKG_VERSION"),
        "findings": findings,
        "surfaces": surfaces,
        "rounding": rounding,
        "left_out": left_out,
    })
}
