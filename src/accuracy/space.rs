//! What the pitch costs: the error of the finest of some lattices, from how far the coarser ones are from it.

use super::trial::Trial;
use crate::study::deviation::Deviation;
use crate::study::findings::Level;
use crate::study::space::space_errors;

/// The error of a pitch, and how it goes on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SpaceError {
    /// Of the finest lattice [mm].
    pub(super) error_mm: f64,
    /// The power of the pitch.
    pub(super) order: f64,
}

/// From runs of one scene on lattices of descending pitch. `None` with one, or where nothing can be compared.
pub(super) fn space_error(runs: &[Trial]) -> Option<SpaceError> {
    let finest = runs.last()?;
    let level = |run: &Trial| {
        let from_finest: Option<Deviation> =
            (run.choice.pitch_mm != finest.choice.pitch_mm).then(|| run.distance(finest)).flatten();
        Level {
            pitch_mm: run.choice.pitch_mm,
            particles: run.len(),
            extrapolated: false,
            doubt: None,
            time_orders: Vec::new(),
            from_finest,
            space_error: None,
        }
    };
    let mut levels: Vec<Level> = runs.iter().map(level).collect();
    // Where nothing moves there is no error, and no power of it.
    let mut seen = levels.iter().filter_map(|level| level.from_finest).peekable();
    if seen.peek().is_some() && seen.all(|found| found.rms_mm == 0.0) {
        return Some(SpaceError { error_mm: 0.0, order: 1.0 });
    }
    let law = space_errors(&mut levels)?;
    Some(SpaceError { error_mm: levels.last()?.space_error?.rms_mm, order: law.order })
}

impl SpaceError {
    /// The pitch with at most an error, from one with this.
    pub(super) fn pitch(&self, pitch_mm: f64, bound_mm: f64) -> f64 {
        pitch_mm * (bound_mm / self.error_mm).powf(self.order.recip())
    }
}
