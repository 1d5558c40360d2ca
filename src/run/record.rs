//! Keeps a run on disk while it goes on.

use std::path::Path;

use super::drive::{Frame, Observer};
use super::inputs::Inputs;
use super::prepare::Prepared;
use crate::dynamics::timeline::{Event, What};
use crate::geometry::Point3;
use crate::lattice::Lattice;
use crate::scene::resolved::Scene;
use crate::store::{Extra, ExtraValues, FrameData, RunHeader, RunWriter, Status, WriteRunError};
use crate::volume::CtVolume;

/// Name of the extra array that holds the CT at the lattice points.
pub const HU_ARRAY: &str = "hu";
/// What lies beyond the CT: air [HU].
const OUTSIDE_HU: f32 = -1024.0;

/// Writes frames, events and series of a run to its directory.
#[derive(Debug)]
pub struct Recorder {
    writer: RunWriter,
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
        Ok(Self { writer })
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
    /// If the manifest cannot be written.
    pub fn finish(self, status: Status) -> Result<(), WriteRunError> {
        self.writer.finish(status)
    }
}

impl Observer for Recorder {
    type Error = WriteRunError;

    fn frame(&mut self, frame: &Frame<'_>) -> Result<(), WriteRunError> {
        let world = frame.world;
        self.writer.push_many_series(&[
            ("volume_by_cells", "m3", &[frame.volume.now]),
            ("rest_volume_by_cells", "m3", &[frame.volume.rest]),
            ("inverted_cells", "1", &[frame.volume.inverted as f64]),
            ("kinetic_energy", "J", &[frame.balance.kinetic]),
            ("elastic_energy", "J", &[frame.balance.elastic]),
        ])?;
        self.writer.push_frame(FrameData {
            time_s: world.time(),
            step: world.steps(),
            displacements_mm: &world.displacements_mm(),
            severed: world.topology().severed(),
        })
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
