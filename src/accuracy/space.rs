//! What the pitch costs: the error of the finest of some lattices, from how far the coarser ones are from it.

use super::trial::Trial;
use crate::deviation::Deviation;
use crate::deviation::pitch_law::PitchLaw;

/// The error of a pitch, and how it goes on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SpaceError {
    /// Of the finest lattice [mm].
    pub(super) error_mm: f64,
    /// The power of the pitch.
    pub(super) order: f64,
}

/// Coarser lattices that the finest is compared with: those before are too coarse to show how errors fall here.
const COMPARED: usize = 3;

/// From runs of one scene on lattices of descending pitch. `None` with one, or where nothing can be compared.
pub(super) fn space_error(runs: &[Trial]) -> Option<SpaceError> {
    let finest = runs.last()?;
    let finest_mm = finest.choice.pitch_mm;
    let coarser = runs.iter().rev().filter(|run| run.choice.pitch_mm != finest_mm).take(COMPARED);
    let seen: Vec<(f64, Deviation)> =
        coarser.filter_map(|run| Some((run.choice.pitch_mm, run.distance(finest)?))).collect();
    // Where nothing moves there is no error, and no power of it.
    if !seen.is_empty() && seen.iter().all(|(_, found)| found.rms_mm == 0.0) {
        return Some(SpaceError { error_mm: 0.0, order: 1.0 });
    }
    let law = PitchLaw::fit(&seen, finest_mm)?;
    Some(SpaceError { error_mm: law.error(finest_mm).rms_mm, order: law.order })
}

impl SpaceError {
    /// The error of another pitch [mm].
    pub(super) fn at(&self, pitch_mm: f64, other_mm: f64) -> f64 {
        self.error_mm * (other_mm / pitch_mm).powf(self.order)
    }

    /// The pitch with at most an error, from one with this.
    pub(super) fn pitch(&self, pitch_mm: f64, bound_mm: f64) -> f64 {
        pitch_mm * (bound_mm / self.error_mm).powf(self.order.recip())
    }
}
