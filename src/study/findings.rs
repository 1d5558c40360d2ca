//! What a study found: plain data, for tables, plots and the report.

use super::choice::{Arithmetic, Choice};
use super::order::PowerLaw;
use super::surface_distance::SurfaceDistance;
use crate::deviation::pitch_law::PitchLaw;
use crate::deviation::{Deviation, Sizes};
use crate::dynamics::integrator::Method;

/// What one choice costs and brings.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Row {
    /// The choice.
    pub choice: Choice,
    /// There only to judge others by.
    pub reference: bool,
    /// Particles.
    pub particles: usize,
    /// Time step \[s\], the mean one where the integrator divides it itself.
    pub dt_s: f64,
    /// Steps taken, or parts of them.
    pub steps: u64,
    /// Those that were divided, where the tissue was deformed too far for the step.
    pub divided: u64,
    /// Computations of all forces.
    pub evaluations: u64,
    /// Springs severed.
    pub severed: usize,
    /// Time of each repeat, ascending \[s\].
    pub seconds: Vec<f64>,
    /// All repeats came to the same bits.
    pub same_bits: bool,
    /// Distance from the reference of its lattice.
    pub time_error: Option<Deviation>,
    /// Whether that is ten times the doubt about the reference.
    pub time_resolved: bool,
    /// Whether the row may show the order of its integrator: its error is clear enough, and its steps were not divided.
    pub shows_order: bool,
    /// Distance from the same choice in the usual arithmetic; `None` for that.
    pub from_usual: Option<Deviation>,
    /// Error of its pitch, estimated.
    pub space_error: Option<Sizes>,
    /// Sum of both.
    pub error: Option<Sizes>,
    /// Largest difference of the volume of whole cells from the finest run of its pitch, over that volume at rest.
    pub volume_error: Option<f64>,
    /// Largest difference of kinetic and elastic energy from the same, over the largest energy.
    pub energy_error: Option<f64>,
    /// Largest difference of momentum from the same \[kg m/s\].
    pub momentum_error: Option<f64>,
    /// Distance of the surfaces at the end from those of the finest run of all; `None` for that run.
    pub surface: Option<SurfaceDistance>,
}

impl Row {
    /// The shortest time \[s\].
    pub fn least_seconds(&self) -> f64 {
        self.seconds.first().copied().unwrap_or(f64::NAN)
    }

    /// The middle time \[s\].
    pub fn median_seconds(&self) -> f64 {
        self.seconds.get((self.seconds.len().max(1) - 1) / 2).copied().unwrap_or(f64::NAN)
    }
}

/// A pitch.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Level {
    /// Distance of particles \[mm\].
    pub pitch_mm: f64,
    /// Particles.
    pub particles: usize,
    /// Whether its reference is a limit of vanishing steps, or its finest run.
    pub extrapolated: bool,
    /// Doubt about its reference.
    pub doubt: Option<Deviation>,
    /// Powers of the step that the time errors (rms) follow, of rows that show it.
    pub time_orders: Vec<TimeOrder>,
    /// Its reference against that of the finest pitch.
    pub from_finest: Option<Deviation>,
    /// Estimated error of the pitch.
    pub space_error: Option<Sizes>,
}

/// How errors of an integrator go with its step: `c dt^p`.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct TimeOrder {
    /// The integrator.
    pub integrator: Method,
    /// The power that was found.
    pub law: PowerLaw,
}

/// All that was found.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Findings {
    /// The pitch of the scene \[mm\].
    pub base_mm: f64,
    /// Numbers of the grid; others are there only for comparison.
    pub usual: Arithmetic,
    /// The integrator that others are judged by.
    pub judge: Method,
    /// Largest displacement in its reference: what relative errors are relative to \[mm\].
    pub largest_mm: f64,
    /// One row for each choice that came to its end.
    pub rows: Vec<Row>,
    /// Pitches, coarsest first.
    pub levels: Vec<Level>,
    /// How errors go with the pitch; `None` with one pitch.
    pub space_law: Option<PitchLaw>,
    /// Choices that did not come to their end, and why.
    pub failed: Vec<(Choice, String)>,
    /// Whether runs of one pitch severed different springs.
    pub cuts_differ: bool,
}
