//! `yawara volume`: the volume of the tissue over a run, as a plot and as numbers.
//!
//! Two measures for each organ, in percent of rest. By cells: the sum over the cells whose eight corners belong to the organ and
//! whose springs are all alive, now against the same cells at rest; a cell that a blade went through drops out of both. By
//! surface: what the organ's closed surface encloses, against frame 0; a cut that opens lets neither in nor out.

use serde_json::{Value, json};

use super::args::VolumeArguments;
use super::exit::Outcome;
use super::mesh::open;
use super::messages::{Messages, out};
use super::progress;
use super::source::expect_png;
use crate::dynamics::measure::organ_volume;
use crate::geometry::Vector3;
use crate::plot::{Axis, Plot, Series, Stroke};
use crate::run::meshes::{MeshOptions, Resolution, RunMesher, scene_of};
use crate::scene::resolved::Body;
use crate::surface::check::check;

/// The volume of an organ over the frames.
struct Curves {
    name: String,
    /// Number in the scene.
    organ: u8,
    /// Change by cells in each frame [%]; `None` where no cell of the organ is whole.
    by_cells: Vec<Option<f64>>,
    /// Change by surface in each frame [%]; `None` where the surface encloses nothing at rest.
    by_surface: Vec<Option<f64>>,
    /// Volume the surface encloses at rest [ml].
    rest_ml: f64,
    /// Cells turned inside out in each frame.
    inverted: Vec<usize>,
}

pub(super) fn volume(arguments: &VolumeArguments, messages: &Messages) -> anyhow::Result<Outcome> {
    expect_png(&arguments.output)?;
    let reader = open(&arguments.run, messages)?;
    let scene = scene_of(&reader)?;
    let frames = reader.frames();
    let steps: Vec<u64> = (0..frames).map(|frame| reader.step(frame)).collect();
    let times = reader.times().to_vec();

    let names = if arguments.organ.is_empty() {
        let soft = scene.organs.iter().filter(|organ| !matches!(organ.body, Body::Rigid { .. }));
        soft.map(|organ| organ.name.clone()).collect()
    } else {
        arguments.organ.clone()
    };
    let mut mesher =
        RunMesher::new(reader, &names, &MeshOptions { resolution: Resolution::Lattice, ..MeshOptions::default() })?;
    // The mesher gives the organs in the order of the scene.
    let mut organs: Vec<Curves> = (0..)
        .zip(&scene.organs)
        .filter(|(_, organ)| names.contains(&organ.name))
        .map(|(number, organ)| Curves::new(number, &organ.name))
        .collect();
    let bar = progress::bar(messages, "frames", frames as u64);
    for frame in 0..frames {
        let meshes = mesher.frame(frame)?.1;
        let reader = mesher.reader();
        let lattice = reader.lattice();
        let moved = reader.displacements_mm(frame)?;
        let topology = reader.topology(frame)?;
        // From patient axes [mm] to lattice axes [m].
        let axes = lattice.grid.affine.linear().transpose() * (1e-3 / lattice.pitch) * 1e-3;
        let displacement = |particle: u32| axes * Vector3::from(moved[particle as usize].map(f64::from));
        for (curves, mesh) in organs.iter_mut().zip(&meshes) {
            let cells = organ_volume(lattice, &topology, curves.organ, displacement);
            curves.by_cells.push(cells.change().map(|change| 100.0 * change));
            curves.inverted.push(cells.inverted);
            let enclosed_ml = check(&mesh.mesh).volume_ml();
            if frame == 0 {
                curves.rest_ml = enclosed_ml;
            }
            let rest_ml = curves.rest_ml;
            curves.by_surface.push((rest_ml > 0.0).then(|| 100.0 * (enclosed_ml / rest_ml - 1.0)));
        }
        bar.inc(1);
    }
    bar.finish_and_clear();

    let plot = plot(&organs, &steps);
    plot.write_png(&arguments.output)?;
    let numbers = arguments.output.with_extension("csv");
    plot.write_csv(&numbers)?;
    if arguments.json {
        let organs: Vec<Value> = organs.iter().map(Curves::json).collect();
        let files = [&arguments.output, &numbers].map(|path| path.display().to_string());
        out(&json!({ "steps": steps, "times_s": times, "organs": organs, "files": files }).to_string())?;
    } else {
        let lines: Vec<String> = organs.iter().map(Curves::text).collect();
        out(&format!("{}\n{}\n{}", lines.join("\n"), arguments.output.display(), numbers.display()))?;
    }
    Ok(Outcome::Done)
}

fn plot(organs: &[Curves], steps: &[u64]) -> Plot {
    let series = |name: String, values: &[Option<f64>]| {
        let points = steps.iter().zip(values).filter_map(|(&step, value)| Some([step as f64, (*value)?]));
        Series { name, points: points.collect(), stroke: Stroke::Line }
    };
    let names: Vec<&str> = organs.iter().map(|organ| organ.name.as_str()).collect();
    Plot {
        title: format!("Volume of {}", names.join(", ")),
        x: Axis::linear("step", ""),
        y: Axis::linear("change of volume", "%"),
        series: organs
            .iter()
            .flat_map(|organ| {
                [
                    series(format!("{}, by cells", organ.name), &organ.by_cells),
                    series(format!("{}, by surface", organ.name), &organ.by_surface),
                ]
            })
            // An organ too thin for cells has no such line.
            .filter(|series| !series.points.is_empty())
            .collect(),
    }
}

/// Smallest, largest and last of the values there are.
fn range(values: &[Option<f64>]) -> Option<[f64; 3]> {
    let last = values.iter().rev().flatten().next()?;
    let there = || values.iter().flatten().copied();
    Some([there().fold(f64::INFINITY, f64::min), there().fold(f64::NEG_INFINITY, f64::max), *last])
}

impl Curves {
    fn new(organ: u8, name: &str) -> Self {
        let name = name.to_owned();
        Self { name, organ, by_cells: Vec::new(), by_surface: Vec::new(), rest_ml: 0.0, inverted: Vec::new() }
    }

    /// Number of the frame with the most inverted cells, if any has one.
    fn worst(&self) -> Option<usize> {
        let worst = (0..self.inverted.len()).rev().max_by_key(|&frame| self.inverted[frame])?;
        (self.inverted[worst] > 0).then_some(worst)
    }

    fn text(&self) -> String {
        let part = |values: &[Option<f64>], none: &str| match range(values) {
            Some([low, high, last]) => format!("{low:+.3} to {high:+.3} %, at the end {last:+.3} %"),
            None => none.to_owned(),
        };
        let mut text = format!(
            "{}: by cells {}; by surface {}",
            self.name,
            part(&self.by_cells, "none (no cell lies wholly in it)"),
            part(&self.by_surface, "none (it encloses nothing)"),
        );
        if let Some(frame) = self.worst() {
            text.push_str(&format!("; up to {} cells inside out (frame {frame})", self.inverted[frame]));
        }
        text
    }

    fn json(&self) -> Value {
        let part = |values: &[Option<f64>]| {
            range(values).map(|[low, high, last]| {
                json!({ "min_percent": low, "max_percent": high, "last_percent": last, "percent": values })
            })
        };
        json!({
            "name": self.name,
            "rest_ml": self.rest_ml,
            "by_cells": part(&self.by_cells),
            "by_surface": part(&self.by_surface),
            "inverted_cells": self.inverted,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_organ_without_cells_has_one_line() {
        let mut thin = Curves::new(0, "wall");
        thin.by_cells = vec![None, None];
        thin.by_surface = vec![Some(0.0), Some(-1.5)];
        thin.inverted = vec![0, 3];
        assert_eq!(
            thin.text(),
            "wall: by cells none (no cell lies wholly in it); by surface -1.500 to +0.000 %, at the end -1.500 %; up to 3 \
             cells inside out (frame 1)"
        );
        assert!(thin.json()["by_cells"].is_null());
        assert_eq!(thin.json()["by_surface"]["last_percent"], -1.5);
        assert_eq!(plot(&[thin], &[0, 10]).series.len(), 1);
    }
}
