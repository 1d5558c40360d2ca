//! What vertices are coloured by, as it is asked for on the command line.

use std::str::FromStr;

use clap::Args;

use super::messages::Messages;
use crate::look::colormap::Colormap;
use crate::look::paint::ColorBy;
use crate::run::meshes::RunMesher;
use crate::run::paint::{Attributes, PaintOptions, Painter};
use crate::surface::mesh::OrganMesh;

/// Colours and attributes of vertices.
#[derive(Debug, Args)]
pub(super) struct PaintArguments {
    /// Colour vertices by `organ`, `hu` (the CT: faces of cuts show the inside), `label`, `displacement`, `strain` or `speed`
    /// [default: none, each organ in its one colour].
    #[arg(long, value_name = "BY", value_parser = color_by)]
    color: Option<ColorBy>,
    /// Values of the first and the last colour: HU, mm, 1 (strain) or mm/s [default: from the run].
    #[arg(long, value_name = "LO,HI", value_parser = range, allow_hyphen_values = true, requires = "color")]
    range: Option<[f32; 2]>,
    /// Colour map, such as `viridis` or `grey` [default: viridis; with `--color hu` the colours of tissue].
    #[arg(long, value_name = "NAME", requires = "color")]
    colormap: Option<Colormap>,
    /// Fine detail that no CT resolves (lobules, fibres), 0 to 1; decoration, not data.
    #[arg(long, value_name = "X", default_value_t = 0.0, value_parser = strength)]
    detail: f32,
    /// Attributes to write besides label and displacement, for formats that hold them: `hu`, `strain`, `speed`.
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', value_parser = ["hu", "strain", "speed"])]
    attributes: Vec<String>,
}

impl PaintArguments {
    /// Whether anything is asked for.
    pub(super) fn asks(&self) -> bool {
        self.color.is_some() || self.detail > 0.0 || !self.attributes.is_empty()
    }

    /// What paints the meshes of a run; `None` when nothing is asked for.
    pub(super) fn painter(&self, mesher: &RunMesher, messages: &Messages) -> anyhow::Result<Option<Painter>> {
        if !self.asks() {
            return Ok(None);
        }
        let has = |name: &str| self.attributes.iter().any(|attribute| attribute == name);
        let attributes = Attributes { hu: has("hu"), strain: has("strain"), speed: has("speed") };
        // Detail without anything to paint is painted on the organ's colour.
        let by = self.color.or((self.detail > 0.0).then_some(ColorBy::Organ));
        let options = PaintOptions { by, range: self.range, colormap: self.colormap, detail: self.detail, attributes };
        let painter = Painter::new(mesher.reader(), mesher.scene(), options)?;
        if let Some(legend) = painter.legend() {
            messages.note(format_args!("colours: {legend}"));
        }
        Ok(Some(painter))
    }
}

/// Time [s] and meshes of a frame, painted when that is asked for.
pub(super) fn frame(
    mesher: &mut RunMesher,
    painter: Option<&Painter>,
    number: usize,
) -> anyhow::Result<(f64, Vec<OrganMesh>)> {
    let (time, mut meshes) = mesher.frame(number)?;
    if let Some(painter) = painter {
        painter.paint(mesher.reader(), number, &mut meshes, &mesher.on_cut())?;
    }
    Ok((time, meshes))
}

fn color_by(text: &str) -> Result<ColorBy, String> {
    ColorBy::ALL.into_iter().find(|by| by.name() == text).ok_or_else(|| {
        let names = ColorBy::ALL.map(ColorBy::name).join(", ");
        format!("expected one of {names}")
    })
}

fn range(text: &str) -> Result<[f32; 2], String> {
    let numbers = text.split(',').map(|part| f32::from_str(part.trim())).collect::<Result<Vec<_>, _>>();
    match numbers.as_deref() {
        Ok(&[low, high]) if low < high && low.is_finite() && high.is_finite() => Ok([low, high]),
        _ => Err("expected two finite numbers, the smaller first, such as 0,25".to_owned()),
    }
}

fn strength(text: &str) -> Result<f32, String> {
    f32::from_str(text)
        .ok()
        .filter(|x| (0.0..=1.0).contains(x))
        .ok_or_else(|| "expected a number from 0 to 1".to_owned())
}
