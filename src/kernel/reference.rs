//! What the hot loop computes, written plainly and in f64: the oracle of every fast variant.

use crate::geometry::Vector3;
use crate::lattice::neighbours::{NEIGHBOURS, OFFSETS};
use crate::lattice::{Lattice, Topology};
use crate::material::Assembly;

/// Force of all living springs on each particle, lattice axes [N]. Shape `[particles]`.
///
/// - `displacement` [m], `velocity` [m/s]: shape `[particles]`, lattice axes.
/// - `dt` [s]: the damper compares the present length of a spring with that one step earlier, `|d - dt w|` with `w` the
///   difference of the ends' velocities.
///
/// # Panics
/// Never: a living spring has two ends.
///
/// # Source
/// Hattori and Kaneko, "3-D model of soft organs": spring `-k (l - L) u`, damper `-d (l - l') u` with `d = c / dt`.
pub fn spring_forces(
    lattice: &Lattice,
    topology: &Topology,
    assembly: &Assembly,
    displacement: &[Vector3],
    velocity: &[Vector3],
    dt: f64,
) -> Vec<Vector3> {
    (0..lattice.len() as u32)
        .map(|particle| {
            let i = particle as usize;
            let mut force = Vector3::zeros();
            for direction in (0..NEIGHBOURS).filter(|d| topology.alive()[i] >> d & 1 == 1) {
                let j = lattice.neighbour(particle, direction).expect("a living spring has two ends") as usize;
                let rest = Vector3::from(OFFSETS[direction].map(f64::from)) * lattice.pitch;
                let d = rest + displacement[j] - displacement[i];
                let length = d.norm();
                if length == 0.0 {
                    continue;
                }
                let mut tension = assembly.stiffness.of(lattice, particle, direction) * (length - rest.norm());
                if let Some(damping) = &assembly.damping {
                    let earlier = (d - dt * (velocity[j] - velocity[i])).norm();
                    tension += damping.of(lattice, particle, direction) * (length - earlier) / dt;
                }
                force += tension * d / length;
            }
            force
        })
        .collect()
}
