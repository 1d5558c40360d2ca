//! Keeps a run on disk while it goes on.

use std::path::Path;
use std::time::{Duration, Instant};

use super::drive::{Frame, Observer};
use super::inputs::Inputs;
use super::obstacle_forces::ObstacleForces;
use super::prepare::Prepared;
use crate::dynamics::measure::CellVolume;
use crate::dynamics::timeline::{Event, What};
use crate::geometry::{Point3, Vector3};
use crate::lattice::neighbours::NEIGHBOURS;
use crate::lattice::{FRINGE, Lattice};
use crate::scene::resolved::{Scene, VoxelSelection};
use crate::store::{BackgroundWriter, Extra, ExtraValues, RunHeader, RunWriter, Status, WriteRunError};
use crate::volume::CtVolume;

/// Name of the extra array that holds the CT at the lattice points.
pub const HU_ARRAY: &str = "hu";
/// What lies beyond the CT: air [HU].
const OUTSIDE_HU: f32 = -1024.0;

/// Series are written at most this often while a run goes on: each write is synced to the disk, which can take longer
/// than a step.
const SERIES_INTERVAL: Duration = Duration::from_secs(1);

/// Writes frames, events and series of a run to its directory.
#[derive(Debug)]
pub struct Recorder {
    writer: BackgroundWriter,
    /// Values of each series that are not written yet: name, unit, values.
    series: Vec<(String, &'static str, Vec<f64>)>,
    written: Instant,
    /// Names of the scene's organs.
    organs: Vec<String>,
    /// The CT at the lattice points, kept when an organ was chosen by it.
    hu: Option<Vec<f32>>,
    last_frame: Option<(u64, f64)>,
    worst: Worst,
    forces: ObstacleForces,
}

/// The largest changes of volume among the frames of a run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Worst {
    /// The change of volume of whole cells that is furthest from zero, relative to rest, and its frame; `None` when no cell was
    /// ever whole.
    pub change: Option<(f64, u64)>,
    /// Cells turned inside out, if there were any.
    pub inverted: Option<InvertedCells>,
}

/// Cells turned inside out: their springs still pull them back, but through themselves, so that what they show is not tissue.
#[derive(Debug, Clone, PartialEq)]
pub struct InvertedCells {
    /// The most in any frame.
    pub most: usize,
    /// The first frame with so many.
    pub frame: u64,
    /// How many in the last frame.
    pub last: usize,
    /// Time of the first frame that has any [s].
    pub first_time: f64,
    /// Centre at rest of the first of them, RAS+ [mm].
    pub first_place: Point3,
    /// Name of the organ there.
    pub first_organ: String,
}

impl Worst {
    fn add(&mut self, frame: &Frame<'_>, organs: &[String]) {
        let CellVolume { inverted, first_inverted, .. } = frame.volume;
        if let Some(change) = frame.volume.change()
            && self.change.is_none_or(|(worst, _)| change.abs() > worst.abs())
        {
            self.change = Some((change, frame.number));
        }
        match (&mut self.inverted, first_inverted) {
            (Some(known), _) => {
                if inverted > known.most {
                    (known.most, known.frame) = (inverted, frame.number);
                }
                known.last = inverted;
            }
            (none, Some(corner)) => {
                let lattice = frame.world.lattice();
                // Half a cell from its lowest corner.
                let centre = lattice.grid.affine.apply_vector(Vector3::repeat(0.5));
                *none = Some(InvertedCells {
                    most: inverted,
                    frame: frame.number,
                    last: inverted,
                    first_time: frame.world.time(),
                    first_place: lattice.rest_place(corner) + centre,
                    first_organ: organ_name(lattice, corner, organs),
                });
            }
            (None, None) => {}
        }
    }
}

/// Counts, the worst frame, and where it began.
impl std::fmt::Display for InvertedCells {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { most, frame, last, first_time, first_place, first_organ } = self;
        let [x, y, z] = [first_place.x, first_place.y, first_place.z];
        write!(
            f,
            "{most} {} inside out in frame {frame}, {last} in the last; the first in `{first_organ}` at ({x:.1}, {y:.1}, \
             {z:.1}) mm, {first_time:.6} s",
            if *most == 1 { "cell" } else { "cells" }
        )
    }
}

/// Name of a particle's organ; a particle that only carries a border has that of the organ it borders.
pub fn organ_name(lattice: &Lattice, particle: u32, organs: &[String]) -> String {
    let of = |particle: u32| lattice.organ[particle as usize];
    let neighbours = (0..NEIGHBOURS).filter_map(|direction| lattice.neighbour(particle, direction));
    let organ = std::iter::once(particle).chain(neighbours).map(of).find(|&organ| organ != FRINGE);
    organ.and_then(|organ| organs.get(usize::from(organ))).map_or("none", String::as_str).to_owned()
}

impl Recorder {
    /// Begins the directory of a run.
    ///
    /// - `scene_toml`: the scene as written, kept word for word.
    ///
    /// # Errors
    /// See [`RunWriter::create`].
    ///
    /// # Panics
    /// Never: a resolved scene can always be written as JSON.
    pub fn create(
        path: &Path,
        scene: &Scene,
        scene_toml: Option<String>,
        inputs: &Inputs,
        prepared: &Prepared,
        overwrite: bool,
    ) -> Result<Self, WriteRunError> {
        let schedule = &prepared.schedule;
        let header = RunHeader {
            scene_toml,
            scene_json: serde_json::to_value(scene).expect("a resolved scene is plain data"),
            inputs: inputs.files.clone(),
            model: scene.lattice.model,
            dt_s: schedule.dt,
            steps: schedule.steps,
        };
        let lattice = &prepared.lattice;
        let hu = inputs.image.as_ref().map(|image| hu_at_points(lattice, image));
        let [nx, ny, nz] = lattice.grid.shape.dims();
        let extras: Vec<Extra<'_>> = hu
            .iter()
            .map(|hu| Extra {
                name: HU_ARRAY.to_owned(),
                description: "CT at the lattice points, trilinear".to_owned(),
                unit: "HU".to_owned(),
                shape: vec![nz, ny, nx],
                values: ExtraValues::F32(hu),
            })
            .collect();
        let mut writer = RunWriter::create(path, header, lattice, &extras, overwrite)?;
        writer.log(&format!(
            "lattice: {} particles, {} springs, pitch {:.4} mm; step {:.4e} s ({} steps), stable up to {:.4e} s",
            lattice.len(),
            lattice.spring_count(),
            lattice.pitch * 1e3,
            schedule.dt,
            schedule.steps,
            schedule.stable_dt,
        ))?;
        writer.log(&format!(
            "integrator: {}, {}",
            scene.time.integrator.name(),
            scene.time.integrator.cost_in_words()
        ))?;
        drop(extras);
        let writer = BackgroundWriter::new(writer)?;
        let by_hu = scene.organs.iter().any(|organ| matches!(organ.voxels, VoxelSelection::Hu { .. }));
        Ok(Self {
            writer,
            hu: hu.filter(|_| by_hu),
            series: Vec::new(),
            written: Instant::now(),
            organs: scene.organs.iter().map(|organ| organ.name.clone()).collect(),
            last_frame: None,
            worst: Worst::default(),
            forces: ObstacleForces::new(scene),
        })
    }

    /// Number and time [s] of the last frame that was recorded.
    pub fn last_frame(&self) -> Option<(u64, f64)> {
        self.last_frame
    }

    /// The largest changes of volume so far.
    pub fn worst(&self) -> &Worst {
        &self.worst
    }

    /// What tools, planes and bone have felt, a line for each.
    pub fn obstacle_lines(&self) -> Vec<String> {
        self.forces.lines()
    }

    /// Names of the organs, in the order of the scene.
    pub fn organs(&self) -> &[String] {
        &self.organs
    }

    /// The CT at the lattice points, when an organ was chosen by it: what its surface is drawn from.
    pub fn hu(&self) -> Option<&[f32]> {
        self.hu.as_deref()
    }

    /// Adds a line to the run's log.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn log(&mut self, line: &str) -> Result<(), WriteRunError> {
        self.writer.log(line)
    }

    /// Ends the run.
    ///
    /// # Errors
    /// If the series or the manifest cannot be written.
    pub fn finish(mut self, status: Status) -> Result<(), WriteRunError> {
        self.write_series()?;
        self.writer.finish(status)
    }

    fn write_series(&mut self) -> Result<(), WriteRunError> {
        for (name, unit, values) in self.series.drain(..) {
            self.writer.push_series(name, unit, values)?;
        }
        self.written = Instant::now();
        Ok(())
    }
}

impl Observer for Recorder {
    type Error = WriteRunError;

    fn frame(&mut self, frame: &Frame<'_>) -> Result<(), WriteRunError> {
        let world = frame.world;
        let own = [
            ("volume_by_cells", "m3", frame.volume.now),
            ("rest_volume_by_cells", "m3", frame.volume.rest),
            ("inverted_cells", "1", frame.volume.inverted as f64),
            ("kinetic_energy", "J", frame.balance.kinetic),
            ("elastic_energy", "J", frame.balance.elastic),
        ];
        let own = own.map(|(name, unit, value)| (name.to_owned(), unit, value));
        let values: Vec<(String, &str, f64)> = own.into_iter().chain(self.forces.of_frame(frame)).collect();
        // Before anything is kept: frames and series have the same length, whatever ends a run.
        if let Some((name, _, value)) = values.iter().find(|(_, _, value)| !value.is_finite()) {
            let (name, value) = (name.clone(), *value);
            return Err(WriteRunError::SeriesNotFinite { name, row: frame.number as usize, value });
        }
        self.writer.push_cuts(world.cut_sheet())?;
        let severed = world.topology().severed();
        self.writer.push_frame((world.time(), world.steps()), world.displacements_mm(), severed)?;
        for (name, unit, value) in values {
            match self.series.iter_mut().find(|series| series.0 == name) {
                Some((_, _, values)) => values.push(value),
                None => self.series.push((name, unit, vec![value])),
            }
        }
        self.last_frame = Some((frame.number, world.time()));
        let before = self.worst.inverted.is_some();
        self.worst.add(frame, &self.organs);
        if let (false, Some(inverted)) = (before, &self.worst.inverted) {
            let InvertedCells { most, first_place: place, first_organ, first_time, .. } = inverted;
            self.writer.log(&format!(
                "{first_time:.6} s: frame {} is the first with cells inside out: {most}, the first in `{first_organ}` at \
                 ({:.1}, {:.1}, {:.1}) mm",
                frame.number, place.x, place.y, place.z
            ))?;
        }
        if self.written.elapsed() > SERIES_INTERVAL { self.write_series() } else { Ok(()) }
    }

    fn event(&mut self, event: &Event) -> Result<(), WriteRunError> {
        self.writer.log(&describe(event))
    }
}

/// An event in one line.
pub fn describe(event: &Event) -> String {
    let Event { time, operation, what } = event;
    match what {
        What::Began(0) => format!("{time:.6} s: `{operation}` begins"),
        What::Began(particles) => format!("{time:.6} s: `{operation}` begins on {particles} particles"),
        What::Ended => format!("{time:.6} s: `{operation}` ends"),
        What::NeverBegan => format!("{time:.6} s: the run ends before `{operation}` could begin"),
        What::Severed(springs) => format!("{time:.6} s: `{operation}` ends, {springs} springs severed"),
    }
}

fn hu_at_points(lattice: &Lattice, image: &CtVolume) -> Vec<f32> {
    use rayon::prelude::*;
    (0..lattice.grid.shape.len())
        .into_par_iter()
        .map(|point| {
            let place: Point3 = lattice.grid.place(point);
            image.sample(place, OUTSIDE_HU)
        })
        .collect()
}
