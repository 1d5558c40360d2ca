//! Contact of soft tissue with itself: the lips of a cut, an organ and its neighbour, a flap and what it is folded onto.
//!
//! # What touches what
//!
//! Bodies are their surface particles: soft ones that lack one of their six nearest neighbours, at the border, at a cut or where
//! springs tore (the `surface` file). Each has an outward normal, taken from the springs it lacks and turned with the tissue around
//! it, and a thickness: how far beyond it the surface lies. At a cut that is where the blade went, at the border half a pitch where
//! particles are the voxels themselves (model `paper`) and nothing where they are corners of cells. Two surface particles that look
//! at each other, and that no living spring joins, nor two springs over a particle between them, must keep along their common
//! normal `n = (n_p - n_q) / |n_p - n_q|`
//!
//! ```text
//! gap = (x_q - x_p) . n >= least        least = min(thickness_p + thickness_q, pitch, gap at rest where they were neighbours)
//! ```
//!
//! while they are within [`LATERAL`] of each other across it. So lips at rest feel nothing, and lips that are pressed together bear
//! on each other where the blade parted them. Measured along a normal that belongs to both surfaces and not from point to point,
//! surfaces are as smooth as their normals are, and what has no friction slides.
//!
//! # One step
//!
//! An impulse for each pair, given after all forces of a step and before its drift, equal and opposite, along the normal: just so
//! large that the gap after the drift is not below the least one, and never drawing. It is inelastic; of the sliding velocity
//! friction takes at most the coefficient times the normal impulse. Pairs that share particles are solved together by projected
//! Gauss-Seidel in the order of their particles, with accumulated impulses that may go back but not below zero, in at most
//! [`SWEEPS`] sweeps. Every update lowers kinetic energy, so contact takes energy and gives none, but for what leads apart pairs that
//! overlap by more than a tenth of a pitch: these part at a tenth of the rest per step and at most [`PUSH_OUT_SPEED`]. No stiffness has to be chosen, and
//! the stable step stays what it was.
//!
//! Linear momentum is kept: exactly but for the rounding of velocities to f32. Angular momentum is not quite, for an impulse along the
//! normal between places that are not opposite turns both: every pair errs by its impulse times its distance across, so all of them by
//! at most [`LATERAL`] pitches times the impulse. Particles that stand opposite each other, as those of lips do, give no error; two
//! grids that meet half a pitch aside err by most of that half.
//!
//! Sources: impulses before the drift, inelastic and with Coulomb friction after Bridson, Fedkiw and Anderson, "Robust treatment of
//! collisions, contact and friction for cloth animation", SIGGRAPH 2002; accumulated impulses after Jourdan, Alart and Jean, "A
//! Gauss-Seidel like algorithm to solve frictional contact problems", Computer Methods in Applied Mechanics and Engineering 1998;
//! lists of near pairs with a skin after Verlet, "Computer experiments on classical fluids", Physical Review 1967; normals by the
//! cofactor of the deformation gradient, Nanson's relation.
//!
//! # What it cannot do
//!
//! - Surfaces are points with normals. Where tissue is stretched so that its particles are more than 1.5 pitches apart, a particle of
//!   the other side can slip between them; a sheet of a single layer of particles and a lone particle have no normal and touch
//!   nothing. An edge belongs to each side that meets there, so sides meet sides; what comes edge against edge may pass.
//! - Bodies that come nearer by more than half a pitch in a step can pass through each other, and what overlaps by more than a pitch
//!   no longer counts as touching.
//! - One row of lip particles next to the front of a cut is left to the springs there.
//! - Rigid bodies, bone included, take no part; obstacles ([`super::contact`]) have the last word.
//!
//! # Cost
//!
//! Candidates are found by sorting surface particles into cells, and found anew only when some may have moved, against the mean of all,
//! by half of [`SKIN`]; in between a step looks at the pairs on that list, and where nothing moves not even at these. After something was
//! severed the surface is made anew where it changed, but candidates everywhere: a cut under way costs about a search for every eighth of
//! a pitch that it comes on.
//!
//! Same world, same calls: same bits, at any number of threads.

mod response;
mod search;
mod surface;
mod touch;

use self::search::Pair;
use self::surface::Surface;
use crate::dynamics::World;

/// Pairs farther apart across their normal do not touch [pitches]: enough for every particle to meet one of a surface that is stretched
/// by a half.
pub const LATERAL: f64 = 1.1;
/// What particles may have moved, two together, before candidates are looked for again [pitches].
pub const SKIN: f64 = 0.5;
/// Most sweeps over the pairs that touch in one step.
pub const SWEEPS: usize = 16;
/// Overlapping pairs are led apart no faster than this [m/s], as out of obstacles.
pub use super::contact::PUSH_OUT_SPEED;

/// Contact of a world's soft tissue with itself.
#[derive(Debug, Clone)]
pub(in crate::dynamics) struct SelfContact {
    friction: f64,
    surface: Surface,
    /// Candidates, ascending; of no meaning while `found_at` is empty.
    pairs: Vec<Pair>,
    /// Displacement of each surface particle when they were found [m]; empty when they have to be found again.
    found_at: Vec<[f32; 3]>,
    /// Surface particles may have moved by so much against their mean since then [m].
    moved: f64,
    /// And by so much since pairs were last looked at [m].
    unseen: f64,
    /// Pairs that pushed in the last step.
    touching: usize,
    looks: u64,
    searches: u64,
}

/// What contact of tissue with itself amounts to so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SelfContactFacts {
    /// Particles that can touch.
    pub surface_particles: usize,
    /// Pairs that pushed each other in the last step.
    pub touching: usize,
    /// Pairs that were compared, summed over all steps.
    pub looks: u64,
    /// How often candidates were looked for.
    pub searches: u64,
}

impl World {
    /// Keeps soft tissue of these organs from passing through itself and through each other, from the next step on.
    ///
    /// - `organs`: their indices; particles beyond the border of an organ belong to those they are joined to.
    /// - `friction`: Coulomb's coefficient, 0 or more.
    ///
    /// # Panics
    /// If `friction` is negative or not finite, or the world has another integrator than the plain step.
    pub fn set_self_contact(&mut self, organs: &[usize], friction: f64) {
        assert!(friction >= 0.0 && friction.is_finite(), "friction is 0 or more");
        assert!(self.integration.is_none(), "only the plain step has contact");
        let surface = Surface::new(&self.lattice, &self.topology, &self.layout, &self.assembly, organs);
        self.self_contact = Some(Box::new(SelfContact {
            friction,
            surface,
            pairs: Vec::new(),
            found_at: Vec::new(),
            moved: 0.0,
            unseen: f64::INFINITY,
            touching: 0,
            looks: 0,
            searches: 0,
        }));
    }

    /// What contact of tissue with itself amounts to so far; `None` without.
    pub fn self_contact(&self) -> Option<SelfContactFacts> {
        self.self_contact.as_ref().map(|contact| SelfContactFacts {
            surface_particles: contact.surface.particles(),
            touching: contact.touching,
            looks: contact.looks,
            searches: contact.searches,
        })
    }
}

impl SelfContact {
    /// After a particle was put somewhere: nothing is known of who is near.
    pub(in crate::dynamics) fn forget(&mut self) {
        self.found_at.clear();
        self.unseen = f64::INFINITY;
    }

    /// Bytes held.
    pub(in crate::dynamics) fn bytes(&self) -> usize {
        self.surface.bytes() + size_of::<Pair>() * self.pairs.len() + 12 * self.found_at.len()
    }
}
