//! Equal springs and dampers, one particle per voxel.
//!
//! Source: Hattori and Kaneko, "3-D model of soft organs". Their damper multiplies a difference of lengths between two
//! steps, so its constant belongs to one step length; here the continuous constant `c = d dt` is kept, so that halving
//! the step does not halve the damping. Differs: organs with different constants may share a lattice; a spring between
//! them takes the mean of both.

use super::{Assembly, RigidKind, RigidParts, SpringConstants};
use crate::lattice::Lattice;
use crate::lattice::neighbours::NEIGHBOURS;

/// Constants of one organ in model `paper`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperBody {
    /// Spring constant [N/m].
    pub stiffness: f64,
    /// Dashpot constant [N s/m].
    pub damping: f64,
    /// Mass of a particle [kg].
    pub mass: f64,
}

/// Masses and spring constants of a lattice of model `paper`. `bodies[organ]` is `None` for a rigid organ, which stays.
pub fn assemble(lattice: &Lattice, bodies: &[Option<PaperBody>]) -> Assembly {
    assemble_with_rigid(lattice, bodies, &vec![None; bodies.len()], |_| None)
}

/// The same with rigid organs that move.
///
/// - `rigid_density[organ]`: density of a rigid organ that moves freely [kg/m^3]; `None` for one that stays where it is, and
///   for soft ones.
/// - `density(particle)`: that of a particle's own cube, where the organ moves freely [kg/m^3]; `None` for its organ's.
pub fn assemble_with_rigid(
    lattice: &Lattice,
    bodies: &[Option<PaperBody>],
    rigid_density: &[Option<f64>],
    density: impl Fn(u32) -> Option<f64>,
) -> Assembly {
    let (kind, mass) = (0..)
        .zip(&lattice.organ)
        .map(|(particle, &organ)| match (bodies[usize::from(organ)], rigid_density[usize::from(organ)]) {
            (Some(body), _) => (RigidKind::Soft, body.mass as f32),
            (None, Some(of_organ)) => {
                let density = density(particle).unwrap_or(of_organ);
                (RigidKind::Free, (density * lattice.pitch.powi(3)) as f32)
            }
            (None, None) => (RigidKind::Anchored, 0.0),
        })
        .unzip();
    let damped = bodies.iter().flatten().any(|b| b.damping > 0.0);
    Assembly {
        mass,
        stiffness: constants(lattice, bodies, |b| b.stiffness),
        damping: damped.then(|| constants(lattice, bodies, |b| b.damping)),
        volume: None,
        fibres: None,
        inelastic: None,
        rigid: RigidParts::new(kind),
    }
}

fn constants(lattice: &Lattice, bodies: &[Option<PaperBody>], of: impl Fn(&PaperBody) -> f64) -> SpringConstants {
    let mut soft = bodies.iter().flatten();
    let first = soft.next().map_or(0.0, &of);
    if soft.all(|body| of(body) == first) {
        return SpringConstants::Uniform(first as f32);
    }
    let own =
        |particle: u32| bodies[usize::from(lattice.organ[particle as usize])].as_ref().map(|body| of(body) as f32);
    SpringConstants::MeanOfEnds(
        (0..lattice.len() as u32)
            .map(|particle| {
                // A rigid end takes its soft neighbours' mean, so that an attachment is as stiff as the tissue.
                own(particle).unwrap_or_else(|| {
                    let around: Vec<f32> =
                        (0..NEIGHBOURS).filter_map(|d| own(lattice.neighbour(particle, d)?)).collect();
                    if around.is_empty() { 0.0 } else { around.iter().sum::<f32>() / around.len() as f32 }
                })
            })
            .collect(),
    )
}
