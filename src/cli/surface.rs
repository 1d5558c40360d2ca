//! How the surfaces of a run are drawn, as it is asked for on the command line.

use std::path::Path;
use std::str::FromStr;

use anyhow::bail;
use clap::{Args, ValueEnum};

use super::mesh::open;
use super::messages::Messages;
use crate::run::interfaces::Interfaces;
use crate::run::meshes::{MeshCare, MeshOptions, MeshRunError, Resolution, RunMesher};
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
    /// Remove slivers: very short edges and very small angles.
    #[arg(long)]
    tidy: bool,
    /// Decimate each organ to about this many triangles; the surface stays closed, and the lips of cuts stay apart.
    #[arg(long, value_name = "N", value_parser = triangles)]
    triangles: Option<usize>,
    /// Decimate each organ as far as it stays within this distance of its full surface, at rest [mm].
    #[arg(long, value_name = "MM", value_parser = length)]
    max_error: Option<f64>,
    /// Whose the walls between organs are: `separate` closes each organ by itself; `shared` draws every wall once, one mesh for each pair
    /// that touches (`liver|gallbladder`, `liver|outside`).
    #[arg(long, value_enum, default_value_t = InterfaceChoice::Separate)]
    interfaces: InterfaceChoice,
}

/// Whose the walls between organs are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum InterfaceChoice {
    Separate,
    Shared,
}

impl SurfaceArguments {
    pub(super) fn options(&self) -> MeshOptions {
        let care = MeshCare { tidy: self.tidy, triangles: self.triangles, max_error_mm: self.max_error };
        let interfaces = match self.interfaces {
            InterfaceChoice::Separate => Interfaces::Separate,
            InterfaceChoice::Shared => Interfaces::Shared,
        };
        MeshOptions { resolution: self.resolution, smooth: self.smooth, care, interfaces }
    }
}

/// Opens a run for its surfaces. Those of its volume's resolution fall back on the lattice's when the volume is not to be had.
pub(super) fn mesher(
    run: &Path,
    organs: &[String],
    options: &MeshOptions,
    messages: &Messages,
) -> anyhow::Result<RunMesher> {
    if options.resolution == Resolution::Lattice && options.care != MeshCare::default() {
        bail!(
            "--tidy, --triangles and --max-error need a surface finer than the lattice; leave out --resolution lattice"
        );
    }
    if options.interfaces == Interfaces::Shared && options.care != MeshCare::default() {
        bail!(
            "--tidy, --triangles and --max-error would move shared walls apart; leave them out, or take --interfaces separate"
        );
    }
    match RunMesher::new(open(run, messages)?, organs, options) {
        Err(MeshRunError::Body(error)) if options.resolution == Resolution::Volume => {
            messages.warning(format_args!("{error}; its surfaces are drawn at the resolution of the lattice instead"));
            let options = MeshOptions { resolution: Resolution::Lattice, care: MeshCare::default(), ..*options };
            Ok(RunMesher::new(RunReader::open(run)?, organs, &options)?)
        }
        result => Ok(result?),
    }
}

fn resolution(text: &str) -> Result<Resolution, String> {
    match text {
        "volume" => Ok(Resolution::Volume),
        "lattice" => Ok(Resolution::Lattice),
        number => length(number)
            .map(Resolution::Spacing)
            .map_err(|_| "expected `volume`, `lattice` or a length in mm above 0".to_owned()),
    }
}

fn triangles(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(count) if count >= 4 => Ok(count),
        _ => Err("expected a whole number from 4, the least that close a surface".to_owned()),
    }
}

fn length(text: &str) -> Result<f64, String> {
    match f64::from_str(text) {
        Ok(mm) if mm.is_finite() && mm > 0.0 => Ok(mm),
        _ => Err("expected a length in mm above 0".to_owned()),
    }
}

fn smoothing(text: &str) -> Result<f32, String> {
    match f32::from_str(text) {
        Ok(strength) if (0.0..=5.0).contains(&strength) => Ok(strength),
        _ => Err("expected a number from 0 to 5".to_owned()),
    }
}
