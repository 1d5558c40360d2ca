//! What the steps of one pitch are judged by, and how far that can be trusted itself.
//!
//! The finest run of a pitch still has an error of its own. Where the error goes with a power of the step, two runs tell what a
//! vanishing step would give (Richardson, 1911):
//!
//! ```text
//! u* = u(dt) + (u(dt) - u(r dt)) / (r^p - 1)
//! ```
//!
//! with `p` the order of the integrator. The three finest runs give two such limits; how far these differ is the doubt about the better
//! one. Where cuts or contact make the error jump, they differ more than the finest run does from the one before: then the finest
//! run itself is the reference, and its distance from the one before is the doubt.

use std::path::Path;

use crate::deviation::{Deviation, Judged};
use crate::geometry::Vector3;
use crate::lattice::{Lattice, Topology};
use crate::scene::resolved::Scene;
use crate::store::{ReadRunError, RunReader};

/// Displacements of a run at its instants.
pub struct Track {
    reader: RunReader,
    /// Of every instant after the first \[mm\]: shape `[particles]`.
    pub frames: Vec<Vec<Vector3>>,
}

impl Track {
    /// Reads a run.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn read(run: &Path) -> Result<Self, ReadRunError> {
        let reader = RunReader::open(run)?;
        let frame = |number| {
            let moved = reader.displacements_mm(number)?;
            Ok(moved.into_iter().map(|u| Vector3::from(u.map(f64::from))).collect())
        };
        let frames = (1..reader.frames()).map(frame).collect::<Result<_, ReadRunError>>()?;
        Ok(Self { reader, frames })
    }

    /// Its lattice.
    pub fn lattice(&self) -> &Lattice {
        self.reader.lattice()
    }

    /// Its springs at the end.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn topology(&self) -> Result<Topology, ReadRunError> {
        self.reader.topology(self.reader.frames() - 1)
    }
}

/// What runs of one pitch are judged by.
pub struct Reference {
    /// The finest run, with the limit in place of its own displacements where that is the better reference.
    pub track: Track,
    /// Particles that are judged.
    pub judged: Judged,
    /// Whether the limit is taken.
    pub extrapolated: bool,
    /// How far the reference itself may be off; `None` when there is but one run.
    pub doubt: Option<Deviation>,
    /// Largest displacement of a judged particle at any instant \[mm\].
    pub largest_mm: f64,
}

impl Reference {
    /// From up to three runs of one pitch, coarsest step first, with their finenesses.
    ///
    /// - `order`: of their integrator.
    /// - `smooth`: whether that order may be trusted with two runs alone.
    ///
    /// `None` without a run.
    pub fn of(mut runs: Vec<(f64, Track)>, scene: &Scene, order: f64, smooth: bool) -> Option<Self> {
        let (finest, mut track) = runs.pop()?;
        let judged = Judged::of(track.lattice(), scene);
        let mut extrapolated = false;
        let mut doubt = None;
        if let Some((coarser, second)) = runs.pop() {
            let step = deviation(&judged, &second, &track)?;
            let limit = limit(&track, &second, finest / coarser, order);
            let limit_before =
                runs.pop().map(|(coarsest, third)| self::limit(&second, &third, coarser / coarsest, order));
            let doubt_of_limit = match &limit_before {
                Some(before) => worst(&judged, &limit, before),
                None if smooth => Some(Deviation {
                    max_mm: 0.5 * step.max_mm,
                    most_mm: 0.5 * step.most_mm,
                    rms_mm: 0.5 * step.rms_mm,
                    ..step
                }),
                None => None,
            };
            doubt = Some(step);
            if let Some(less) = doubt_of_limit.filter(|limit| limit.rms_mm < step.rms_mm) {
                (extrapolated, doubt) = (true, Some(less));
                track.frames = limit;
            }
        }
        let largest = |frame: &Vec<Vector3>| judged.largest(|particle| frame[particle as usize]);
        let largest_mm = track.frames.iter().map(largest).fold(0.0, f64::max);
        Some(Self { track, judged, extrapolated, doubt, largest_mm })
    }

    /// How far a run on the same lattice is off, at the worst instant.
    pub fn deviation(&self, run: &Track) -> Option<Deviation> {
        self.apart(run, &self.track)
    }

    /// How far two runs on the same lattice are from each other, at the worst instant.
    pub fn apart(&self, run: &Track, other: &Track) -> Option<Deviation> {
        deviation(&self.judged, run, other)
    }
}

fn deviation(judged: &Judged, found: &Track, expected: &Track) -> Option<Deviation> {
    worst(judged, &found.frames, &expected.frames)
}

fn worst(judged: &Judged, found: &[Vec<Vector3>], expected: &[Vec<Vector3>]) -> Option<Deviation> {
    let instants = found.iter().zip(expected);
    instants.map(|(found, expected)| judged.on_one_lattice(found, expected)).reduce(Deviation::worse)
}

/// What a vanishing step would give, from a run and one whose step is `ratio` times longer.
fn limit(fine: &Track, coarse: &Track, ratio: f64, order: f64) -> Vec<Vec<Vector3>> {
    let share = 1.0 / (ratio.powf(order) - 1.0);
    let frame = |(fine, coarse): (&Vec<Vector3>, &Vec<Vector3>)| {
        fine.iter().zip(coarse).map(|(fine, coarse)| fine + (fine - coarse) * share).collect()
    };
    fine.frames.iter().zip(&coarse.frames).map(frame).collect()
}
