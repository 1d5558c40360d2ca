//! Plasticity: tissue that is stretched or pressed too far stays so.
//!
//! A spring has an elastic strain and one that has yielded, `(l - L) / L = elastic + yielded`, and only the first has tension.
//! Where it exceeds the yield strain in size, what is beyond flows over into the second, with a time constant or at once:
//!
//! ```text
//! d yielded / dt = (|elastic| - yield) sign(elastic) / time        while |elastic| > yield
//! ```
//!
//! Pulled slowly beyond the yield strain, a bar pulls with `E yield` and no more; let go, it keeps what it was drawn out beyond.
//! The work done on what yields is lost. A spring never yields by more than half its length in all. Rotations yield nothing, and
//! the volume term does not yield: what flows keeps its volume.
//!
//! A spring at the wall of two organs yields when its tension is what their parts bear together; beside tissue that does not
//! yield it never does. Yielding is symmetric and does not harden.
//!
//! Source: overstress of Perzyna, "Fundamental problems in viscoplasticity" (1966), by springs, as the rest lengths that move
//! beyond a yield ratio of Clavet, Beaudoin and Poulin, "Particle-based viscoelastic fluid simulation" (2005).

use super::inner_springs::InnerSprings;
use crate::kernel::inner_length::Yielding;
use crate::lattice::layout::BlockLayout;
use crate::material::PlasticTerm;

/// What a lattice's springs have yielded.
pub(in crate::dynamics) type YieldedSprings = InnerSprings<Yielding>;

impl YieldedSprings {
    pub(in crate::dynamics) fn of(layout: &BlockLayout, term: &PlasticTerm) -> Self {
        let PlasticTerm { stiffness, threshold, rate } = term;
        Self::new(layout, [stiffness, rate, threshold], |stiffness, threshold| stiffness > 0.0 && threshold.is_finite())
    }
}
