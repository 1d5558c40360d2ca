//! The largest step that symplectic Euler may take.
//!
//! For `M a + C v + K u = 0` with the damper read at the old velocity, a mode of frequency `w` and damping ratio `z` stays
//! bounded iff `dt^2 w^2 + 4 z w dt < 4`, that is `dt < (2 / w) (sqrt(1 + z^2) - z)`. A spring adds at most
//! `2 (k_ij / m_i)` to the row of particle `i` in `M^-1 K`, in any rotation and down to half its length, so
//!
//! ```text
//! dt^2 * 2 sum_j k_ij / m_i  +  2 dt * 2 sum_j c_ij / m_i  <  4      for every free particle i
//! ```
//!
//! is enough (Gershgorin's theorem by 3 x 3 blocks). Cutting only removes terms: it never lowers the bound.

use rayon::prelude::*;

use crate::lattice::neighbours::NEIGHBOURS;
use crate::lattice::{Lattice, Topology};
use crate::material::Assembly;

/// Share of the bound that the program takes when it chooses the step: room for springs shorter than half.
pub const SAFETY: f64 = 0.95;

/// The largest step that is stable for the living springs [s]; infinite when no free particle has a spring.
pub fn stable_dt(lattice: &Lattice, topology: &Topology, assembly: &Assembly) -> f64 {
    (0..lattice.len() as u32)
        .into_par_iter()
        .map(|particle| {
            let mass = f64::from(assembly.mass[particle as usize]);
            if mass <= 0.0 {
                return f64::INFINITY;
            }
            let alive = topology.alive()[particle as usize];
            let (mut stiffness, mut damping) = (0.0, 0.0);
            for direction in (0..NEIGHBOURS).filter(|d| alive >> d & 1 == 1) {
                stiffness += assembly.stiffness.of(lattice, particle, direction);
                damping += assembly.damping.as_ref().map_or(0.0, |c| c.of(lattice, particle, direction));
            }
            // a dt^2 + 2 b dt = 4, solved without cancellation.
            let (a, b) = (2.0 * stiffness / mass, 2.0 * damping / mass);
            if a == 0.0 && b == 0.0 { f64::INFINITY } else { 4.0 / (b + (b * b + 4.0 * a).sqrt()) }
        })
        .reduce(|| f64::INFINITY, f64::min)
}
