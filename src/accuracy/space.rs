//! What the pitch costs: the error of the finest of some lattices, from how far the coarser ones are from it.

use super::trial::Trial;
use crate::deviation::Deviation;
use crate::deviation::pitch_law::PitchLaw;

/// Lattices so many times coarser than the finest are too coarse to show how errors fall here.
const COMPARED: f64 = 3.1;

/// From runs of one scene on lattices of descending pitch. `None` with one, or where nothing can be compared.
pub(super) fn pitch_law(runs: &[Trial]) -> Option<PitchLaw> {
    let finest = runs.last()?;
    let finest_mm = finest.choice.pitch_mm;
    let compared = |run: &&Trial| (1.001..COMPARED).contains(&(run.choice.pitch_mm / finest_mm));
    let coarser = runs.iter().filter(compared);
    let seen: Vec<(f64, Deviation)> =
        coarser.filter_map(|run| Some((run.choice.pitch_mm, run.distance(finest)?))).collect();
    // Where nothing moves there is no error, and no power of it.
    if !seen.is_empty() && seen.iter().all(|(_, found)| found.rms_mm == 0.0) {
        return Some(PitchLaw::NO_ERROR);
    }
    PitchLaw::fit(&seen, finest_mm)
}
