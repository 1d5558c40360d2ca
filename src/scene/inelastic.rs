//! What an organ's springs do beyond elasticity: relax, yield, tear.

use super::checks::Checks;
use super::diagnostics::KeyPath;
use super::resolved::{Inelastic, Plasticity, Relaxation};
use super::schema;

/// Beyond, the instant modulus has nothing to do with the lasting one, and the step is theirs by the root.
const RATIO: [f64; 2] = [1e-3, 1e3];
/// Below, rounding yields; above, springs shorten to nothing before they yield.
const YIELD_STRAIN: [f64; 2] = [1e-4, 0.5];
/// Below, a bent bar tears at rest; above, tissue is drawn into threads.
const TEAR_STRAIN: [f64; 2] = [1e-3, 10.0];

/// The keys of an organ that are read here.
pub(super) fn keys(organ: &schema::Organ) -> [(&'static str, bool); 3] {
    [
        ("relaxation", organ.relaxation.is_some()),
        ("plasticity", organ.plasticity.is_some()),
        ("tear_strain", organ.tear_strain.is_some()),
    ]
}

/// Checks and resolves them; `None` when a problem was found. A rigid organ has none: that it has says so elsewhere.
pub(super) fn inelastic(checks: &mut Checks<'_>, table: &KeyPath, organ: &schema::Organ) -> Option<Inelastic> {
    if organ.rigid {
        return Some(Inelastic::default());
    }
    let before = checks.problems.len();
    let relaxation = organ.relaxation.as_ref().map(|written| {
        let table = table.key("relaxation");
        Relaxation {
            ratio: checks.between(&table.key("ratio"), written.ratio, RATIO, ""),
            time: checks.above_zero(&table.key("time"), written.time, "s"),
        }
    });
    let plasticity = organ.plasticity.as_ref().map(|written| {
        let table = table.key("plasticity");
        Plasticity {
            yield_strain: checks.between(&table.key("yield_strain"), written.yield_strain, YIELD_STRAIN, ""),
            time: checks.not_negative(&table.key("time"), written.time.unwrap_or(0.0), "s"),
        }
    });
    let tear_strain =
        organ.tear_strain.map(|strain| checks.between(&table.key("tear_strain"), strain, TEAR_STRAIN, ""));
    (checks.problems.len() == before).then_some(Inelastic { relaxation, plasticity, tear_strain })
}
