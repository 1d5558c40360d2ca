//! The largest step that symplectic Euler may take.
//!
//! For `M a + C v + K u = 0` with the damper read at the old velocity, every mode stays bounded while
//!
//! ```text
//! lambda_max(M^-1 (dt^2 K + 2 dt C)) < 4
//! ```
//!
//! and one grows beyond: with damping `C = tau K` that is `dt^2 w^2 + 2 tau w^2 dt < 4`, the exact limit of the scheme.
//! Three limits follow, each larger than the one before:
//!
//! - **promise**: springs at any rotation and any stretch. The tangent of a spring of tension `k (l - L)` is
//!   `k [n n^T + (1 - L / l) (I - n n^T)]`, at most `k I`, and `((u_j - u_i) . n)^2 <= 2 (u_i . n)^2 + 2 (u_j . n)^2`,
//!   so particle `i` sees at most `2 sum_j k_ij`. A cell's volume term adds `8 lambda h^3 |g|^2` with
//!   `g = (+-1, +-1, +-1) / (4 h)`, which holds while no face of the cell grows (`|cof F| <= 1`) and `J` is near 1. Fibres add
//!   what they do when taut, which is the most at any stretch and rotation, see [`crate::kernel::fibres`].
//! - **rest**: springs and cells near rest. `K` is bounded by its block diagonal `K_ii = 2 sum_j k_ij n n^T +
//!   8 sum_cells lambda h^3 g g^T` (a cell is a form of rank one over eight corners), so the largest eigenvalue of the
//!   3 x 3 blocks will do. Inside a uniform lattice it is exact: the fastest mode turns every second plane against the next.
//! - **sharp**: the largest eigenvalue of the whole lattice at rest, by Lanczos' iteration, see [`Limits::sharpen`].
//!
//! A negative `lambda` counts as 0 in the first two. Cuts only remove terms that were counted, and holding particles only
//! removes freedom: neither ever lowers a limit. What a large deformation does is the business of
//! [`super::step_control`].
//!
//! Source: the splitting into blocks is Gershgorin's theorem, by 3 x 3 blocks.

mod lanczos;
mod rest;

use crate::lattice::{Lattice, Topology};
use crate::material::Assembly;

pub(crate) use rest::{DampingTimes, damping_times, whole_moduli};

/// Share of the limit that the program takes when it chooses the step.
///
/// Nearer to the limit undamped tissue, though it does not diverge, hands energy to its fastest modes: small blocks shaken
/// by 0.03 pitches for 20 000 steps ended with 40 to 70 times their energy at 0.95, with up to 65 times at 0.9, and within
/// 12 % of it at 0.8.
pub const SAFETY: f64 = 0.8;

/// The step that springs allow at any rotation and stretch [s]: what to give a [`super::World`] that is stepped without
/// [`super::step_control`]. Infinite when no free particle has a spring.
///
/// Rigorous for springs and fibres, O(particles); volume terms count as they are while faces of cells do not grow, see [`Limits`].
pub fn stable_dt(lattice: &Lattice, topology: &Topology, assembly: &Assembly) -> f64 {
    Limits::at_rest(lattice, topology, assembly).promise
}

/// The largest stable steps of a lattice [s]; infinite when no spring limits them. See the module for what each promises.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// At any rotation and stretch of springs and fibres.
    pub promise: f64,
    /// Near rest, by the blocks.
    pub rest: f64,
    /// Near rest, by the whole lattice; equal to `rest` until sharpened.
    pub sharp: f64,
}

impl Limits {
    /// Promise and rest limit. O(particles): about 0.1 s for a million on two cores.
    pub fn at_rest(lattice: &Lattice, topology: &Topology, assembly: &Assembly) -> Self {
        let (promise, rest) = rest::limits(lattice, topology, assembly);
        Self { promise, rest, sharp: rest }
    }

    /// Looks for the true limit of the rest state as long as that pays in a run of so many `steps`.
    ///
    /// The iteration starts from a random vector, always the same one, and its estimate is raised by the error that
    /// Kuczynski and Wozniakowski bound for such starts: the limit is too large with a probability below 1e-6, and the
    /// program takes [`SAFETY`] of it.
    #[must_use]
    pub fn sharpen(self, lattice: &Lattice, topology: &Topology, assembly: &Assembly, steps: f64) -> Self {
        if !self.rest.is_finite() {
            return self;
        }
        Self { sharp: lanczos::sharpened(lattice, topology, assembly, self.rest, steps).max(self.rest), ..self }
    }
}
