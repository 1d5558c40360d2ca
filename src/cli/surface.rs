//! How the surfaces of a run are drawn, as it is asked for on the command line.

use std::path::Path;
use std::str::FromStr;

use clap::Args;

use super::mesh::open;
use super::messages::Messages;
use crate::run::meshes::{MeshOptions, MeshRunError, Resolution, RunMesher};
use crate::store::RunReader;

/// Resolution and smoothing.
#[derive(Debug, Args)]
pub(super) struct SurfaceArguments {
    /// Smoothing of the surface at rest, 0 to 5; 1 takes away the staircases of the voxels, 0 keeps them.
    #[arg(long, default_value_t = 1.0, value_name = "X", value_parser = smoothing)]
    smooth: f32,
    /// How fine the surface is: `volume` (the voxels of the CT), `lattice`, or the distance of its points [mm].
    #[arg(long, default_value = "volume", value_name = "volume|lattice|MM", value_parser = resolution,
          allow_negative_numbers = true)]
    resolution: Resolution,
}

impl SurfaceArguments {
    pub(super) fn options(&self) -> MeshOptions {
        MeshOptions { resolution: self.resolution, smooth: self.smooth }
    }
}

/// Opens a run for its surfaces. Those of its volume's resolution fall back on the lattice's when the volume is not to be had.
pub(super) fn mesher(
    run: &Path,
    organs: &[String],
    options: &MeshOptions,
    messages: &Messages,
) -> anyhow::Result<RunMesher> {
    match RunMesher::new(open(run, messages)?, organs, options) {
        Err(MeshRunError::Body(error)) if options.resolution == Resolution::Volume => {
            messages.warning(format_args!("{error}; its surfaces are drawn at the resolution of the lattice instead"));
            let options = MeshOptions { resolution: Resolution::Lattice, ..*options };
            Ok(RunMesher::new(RunReader::open(run)?, organs, &options)?)
        }
        result => Ok(result?),
    }
}

fn resolution(text: &str) -> Result<Resolution, String> {
    match text {
        "volume" => Ok(Resolution::Volume),
        "lattice" => Ok(Resolution::Lattice),
        number => match f64::from_str(number) {
            Ok(mm) if mm.is_finite() && mm > 0.0 => Ok(Resolution::Spacing(mm)),
            _ => Err("expected `volume`, `lattice` or a length in mm above 0".to_owned()),
        },
    }
}

fn smoothing(text: &str) -> Result<f32, String> {
    match f32::from_str(text) {
        Ok(strength) if (0.0..=5.0).contains(&strength) => Ok(strength),
        _ => Err("expected a number from 0 to 5".to_owned()),
    }
}
