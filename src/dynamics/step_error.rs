//! Why a step could not be finished, and what is likely to have gone wrong.

use super::stable_dt::Limits;
use crate::geometry::Point3;
use crate::lattice::{Lattice, Topology};
use crate::material::Assembly;

/// Why a step could not be finished. The state before it has been handed out; nothing of the bad one is.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StepError {
    /// A velocity became NaN or infinite, or two joined particles part too fast for the step to mean anything. How fast
    /// a body moves as a whole does not matter.
    #[error(
        "the state diverged at t = {time:.6} s (step {step}) near ({:.1}, {:.1}, {:.1}) mm: neighbours part at \
         {speed:.3e} m/s, that is {moves:.2e} pitches in a step of {dt:.3e} s; {cause}",
        place.x, place.y, place.z
    )]
    Diverged {
        /// When [s].
        time: f64,
        /// Number of the step that failed, from 1.
        step: u64,
        /// Rest place of the particle, RAS+ [mm].
        place: Point3,
        /// Its speed relative to a particle it is joined to [m/s]; infinite when the velocity is not a number.
        speed: f64,
        /// The same in pitches per step.
        moves: f64,
        /// The step [s].
        dt: f64,
        /// What is likely to have gone wrong, and what to do.
        cause: String,
    },
    /// Neighbours part and meet in turn from step to step and do not come to rest: the step is too long, although dampers
    /// keep the motion within bounds.
    #[error(
        "the motion alternates from step to step at t = {time:.6} s (step {step}) near ({:.1}, {:.1}, {:.1}) mm: neighbours \
         part and meet by {moves:.2e} pitches in turn, in steps of {dt:.3e} s, and do not come to rest; {cause}",
        place.x, place.y, place.z
    )]
    Alternates {
        /// When [s].
        time: f64,
        /// Number of the step that failed, from 1.
        step: u64,
        /// Rest place of the particle that alternates most, RAS+ [mm].
        place: Point3,
        /// How far it parts from a particle it is joined to in one step, to come back in the next [pitches].
        moves: f64,
        /// The step [s].
        dt: f64,
        /// What is likely to have gone wrong, and what to do.
        cause: String,
    },
    /// The tissue is deformed so far that hardly any step is stable.
    #[error(
        "the tissue is too stiff to go on at t = {time:.6} s near ({:.1}, {:.1}, {:.1}) mm: deformed as it is, it allows steps \
         of {limit:.3e} s, and a planned step is divided into at most {most_parts} parts; something squeezes or stretches \
         it beyond what it can follow: lower the force, give the motion more time, or refine lattice.pitch",
        place.x, place.y, place.z
    )]
    TooStiff {
        /// When [s].
        time: f64,
        /// Rest place of the stiffest particle, RAS+ [mm].
        place: Point3,
        /// The largest step that is stable there [s].
        limit: f64,
        /// Largest number of parts.
        most_parts: u64,
    },
    /// An adaptive integrator cannot meet its tolerance.
    #[error(
        "the error control went down to steps of {part:.3e} s at t = {time:.6} s near ({:.1}, {:.1}, {:.1}) mm and does not meet \
         time.tolerance = {tolerance:e} mm (a step is divided into at most {most_parts} parts): ask for a larger one (f32 places \
         are known to about 1e-7 of a displacement), for a smaller time.dt, or lower the force that moves the tissue there",
        place.x, place.y, place.z
    )]
    TooFine {
        /// When the step began [s].
        time: f64,
        /// Rest place of the fastest particle, RAS+ [mm].
        place: Point3,
        /// The tolerance [mm].
        tolerance: f64,
        /// The part that still had too large an error [s].
        part: f64,
        /// Largest number of parts.
        most_parts: u32,
    },
    /// The shape that an implicit integrator looks for was not found.
    #[error(
        "no shape was found in which the forces are in balance at t = {time:.6} s: after {iterations} iterations the tissue near \
         ({:.1}, {:.1}, {:.1}) mm would still move by {step:.2e} mm, more than time.tolerance = {tolerance:e} mm; {hint}",
        place.x, place.y, place.z
    )]
    Unsettled {
        /// When [s].
        time: f64,
        /// Rest place of the particle that would move most, RAS+ [mm].
        place: Point3,
        /// How far [mm].
        step: f64,
        /// The tolerance [mm].
        tolerance: f64,
        /// Iterations taken at most.
        iterations: u32,
        /// What to do.
        hint: &'static str,
    },
}

impl StepError {
    /// Rest place of the particle where it began, RAS+ [mm].
    pub fn place(&self) -> Point3 {
        match self {
            Self::Diverged { place, .. }
            | Self::Alternates { place, .. }
            | Self::TooStiff { place, .. }
            | Self::TooFine { place, .. }
            | Self::Unsettled { place, .. } => *place,
        }
    }
}

/// Why a state that diverged may have done so, and what to do.
pub(super) fn likely_cause(lattice: &Lattice, topology: &Topology, assembly: &Assembly, dt: f64) -> String {
    step_too_long(lattice, topology, assembly, dt).unwrap_or_else(|| {
        "the step is within the stable bound, so a force or a grabbed region or a tool (or a start far from rest) \
         moves the tissue faster than it can follow: lower the force, or give the motion more time"
            .to_owned()
    })
}

/// Says so when a step is longer than what is stable at rest, and what to do.
pub(super) fn step_too_long(lattice: &Lattice, topology: &Topology, assembly: &Assembly, dt: f64) -> Option<String> {
    let limits = Limits::at_rest(lattice, topology, assembly);
    // As close as it gets, in the time of a few hundred steps.
    let bound = limits.sharpen(lattice, topology, assembly, 1e4).sharp;
    (dt > bound).then(|| {
        format!(
            "the step is {:.2} times the stable one ({bound:.3e} s): ask for a smaller time.dt or leave it out",
            dt / bound
        )
    })
}
