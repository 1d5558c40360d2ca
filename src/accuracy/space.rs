//! What the pitch costs: the error of the finest of some lattices from how far the coarser ones are from it, and that of coarser ones
//! from how far they are from what all of them tend to.

use super::trial::Trial;
use crate::deviation::pitch_law::PitchLaw;
use crate::deviation::{Deviation, Witness};

/// Lattices so many times coarser than the finest are too coarse to show how errors fall here.
const COMPARED: f64 = 3.1;

/// Where runs tell no power of the pitch, promises go by a low one, so that they are kept; that a coarser run is enough is advice, and
/// goes by the middle of those that there are, from borders drawn in cubes to smooth tissue, 1 to 2.
const MIDDLE: f64 = 1.4;

/// How errors go with the pitch, from runs of one scene on lattices of descending pitch. `None` with one, or where nothing can be compared.
pub(super) fn pitch_law(runs: &[Trial]) -> Option<PitchLaw> {
    let finest = runs.last()?;
    let finest_mm = finest.choice.pitch_mm;
    let seen: Vec<(f64, Deviation)> =
        compared(runs).filter_map(|run| Some((run.choice.pitch_mm, run.distance(finest)?))).collect();
    // Where nothing moves there is no error, and no power of it.
    if !seen.is_empty() && seen.iter().all(|(_, found)| found.rms_mm == 0.0) {
        return Some(PitchLaw::NO_ERROR);
    }
    PitchLaw::fit(&seen, finest_mm)
}

/// The error of the pitch of a run \[mm\], root mean square: how far it is from what runs on lattices of descending pitch tend to by
/// their law. So errors that point the same way add up, and those that do not do not. `None` where nothing can be compared.
pub(super) fn error_mm(run: &Trial, runs: &[Trial], law: &PitchLaw) -> Option<f64> {
    let finest = runs.last()?;
    let finest_mm = finest.choice.pitch_mm;
    let order = if law.found { law.order } else { MIDDLE };
    let told = compared(runs).map(|coarser| {
        let power = (finest_mm / coarser.choice.pitch_mm).powf(order);
        // As for the law itself, a pitch near the finest says little.
        (coarser, Witness { weight: (1.0 - power).powi(2), share: power / (1.0 - power) })
    });
    let told: Vec<(&Trial, Witness)> = told.collect();
    Some(run.distance_from_limit(finest, &told, law.error(finest_mm).rms_mm)?.rms_mm)
}

/// Those that say something of the finest.
fn compared(runs: &[Trial]) -> impl Iterator<Item = &Trial> {
    let finest_mm = runs.last().map_or(f64::NAN, |finest| finest.choice.pitch_mm);
    runs.iter().filter(move |run| (1.001..COMPARED).contains(&(run.choice.pitch_mm / finest_mm)))
}
