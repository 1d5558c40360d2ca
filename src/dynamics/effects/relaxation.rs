//! Visco-elasticity: tissue that is held stretched lets go of a part of its tension in time.
//!
//! Every spring gets a Maxwell branch in parallel, a spring of `ratio` times its stiffness in series with a damper: the standard
//! linear solid. Stretched by `e` and held, it pulls with
//!
//! ```text
//! k e (1 + ratio exp(-t / time))
//! ```
//!
//! so at once a tissue has `1 + ratio` times the Young's modulus that it has in the long run; what lasts is the modulus that the
//! scene gives. In between it damps: most where the period of the motion is about `2 pi time`. Unlike the damper of a spring, whose
//! tension grows without end with the rate of strain, a branch never pulls with more than its stiffness; the stable step is that
//! of springs `1 + ratio` times as stiff, whatever the time. The volume term does not relax: volume is kept as before.
//!
//! The damper's lengthening steps by backward Euler after the new places are known, first order as the step is. A spring at the
//! wall of two organs has both their branches, with the mean of their rates by stiffness.
//!
//! Source: the standard linear (Zener) solid, as in Fung, *Biomechanics: Mechanical Properties of Living Tissues*, section 2.11.

use super::inner_springs::InnerSprings;
use crate::kernel::inner_length::Relaxing;
use crate::lattice::layout::BlockLayout;
use crate::material::RelaxationTerm;

/// The branches of a lattice.
pub(in crate::dynamics) type MaxwellBranches = InnerSprings<Relaxing>;

impl MaxwellBranches {
    pub(in crate::dynamics) fn of(layout: &BlockLayout, term: &RelaxationTerm) -> Self {
        let RelaxationTerm { stiffness, rate } = term;
        Self::new(layout, [stiffness, rate, rate], |stiffness, _| stiffness > 0.0)
    }
}
