//! Can the numbers of a scene be kept in f32, as the state is?
//!
//! A constant that becomes 0 or infinite there would turn into a rigid particle, a missing spring, or NaN. Constants are looked at
//! after assembly, so that every way to give them counts.

use super::prepare::PrepareError;
use crate::lattice::Lattice;
use crate::lattice::build::NO_ORGAN;
use crate::material::{Assembly, SpringConstants};

/// Refuses an assembly with a mass, stiffness, damping, volume modulus or fibres that f32 cannot hold.
///
/// - `names`: of the organs; `rigid`: which of them do not deform, and have neither mass nor springs of their own.
/// - `dt` [s].
///
/// # Errors
/// [`PrepareError::OutOfRange`] with the first such organ and number.
pub(super) fn check(
    lattice: &Lattice,
    assembly: &Assembly,
    names: &[&str],
    rigid: &[bool],
    dt: f64,
) -> Result<(), PrepareError> {
    let normal = |value: f32| value.is_normal() && value > 0.0;
    let own = |constants: &SpringConstants, particle: usize| match constants {
        SpringConstants::Uniform(value) => *value,
        SpringConstants::MeanOfEnds(values) => values[particle],
        SpringConstants::SumOfCells { cell, .. } => cell[particle],
    };
    let is_rigid = |organ: u8| rigid.get(usize::from(organ)).copied().unwrap_or(false);
    for particle in 0..lattice.len() {
        // Cells have springs, and particles a mass, unless a rigid cell holds them.
        let (organ, soft, free) = if lattice.has_cells() {
            let organ = lattice.cell_organ[particle];
            let held = lattice.cells_around(particle as u32).any(|cell| is_rigid(lattice.cell_organ[cell as usize]));
            (organ, organ != NO_ORGAN && !is_rigid(organ), !held)
        } else {
            let organ = lattice.organ[particle];
            (organ, !is_rigid(organ), !is_rigid(organ))
        };
        let refuse = |what: &'static str, found: f64| {
            let organ = names.get(usize::from(organ)).map_or_else(|| "its border".to_owned(), |&name| name.to_owned());
            Err(PrepareError::OutOfRange { organ, what, found })
        };
        let mass = assembly.mass[particle];
        if !(normal(mass) || mass == 0.0 && !free) {
            return refuse("the mass of a particle [kg]", mass.into());
        }
        // What a force is multiplied with in a step.
        if mass > 0.0 && !((dt / f64::from(mass)) as f32).is_finite() {
            return refuse("the step over the mass of a particle [s/kg]", dt / f64::from(mass));
        }
        let stiffness = own(&assembly.stiffness, particle);
        if !(stiffness.is_finite() && (normal(stiffness) || !soft)) {
            return refuse("the stiffness of a spring [N/m] or Young's modulus of a cell [Pa]", stiffness.into());
        }
        let damping = assembly.damping.as_ref().map_or(0.0, |damping| own(damping, particle));
        if !damping.is_finite() {
            return refuse("the damping of a spring [N s/m] or viscosity of a cell [Pa s]", damping.into());
        }
        let volume = assembly.volume.as_ref();
        let modulus = volume.map_or(0.0, |term| term.modulus[particle]);
        let viscosity = volume.and_then(|term| term.viscosity.as_ref()).map_or(0.0, |viscosity| viscosity[particle]);
        if !(modulus.is_finite() && viscosity.is_finite()) {
            return refuse("the volume term of a cell [Pa, Pa s]", (modulus + viscosity).into());
        }
        let fibres = assembly.fibres.as_ref().map_or([0.0; 3], |term| term.root[particle]);
        let squared: f32 = fibres.iter().map(|part| part * part).sum();
        let lost = squared == 0.0 && fibres != [0.0; 3];
        if !squared.is_finite() || lost {
            return refuse(
                "the modulus of a cell's fibres [Pa]",
                fibres.iter().map(|&part| f64::from(part).powi(2)).sum(),
            );
        }
    }
    Ok(())
}
