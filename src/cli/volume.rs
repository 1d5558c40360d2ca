//! `yawara volume`: the volume of the tissue over a run, as a plot and as numbers.

use super::args::VolumeArguments;
use super::exit::Outcome;
use super::mesh::open;
use super::messages::{Messages, out};
use super::progress;
use super::source::expect_png;
use crate::plot::{Axis, Plot, Series};
use crate::run::meshes::{DEFAULT_SMOOTHING, RunMesher, scene_of};
use crate::scene::resolved::Body;
use crate::surface::check::check;

pub(super) fn volume(arguments: &VolumeArguments, messages: &Messages) -> anyhow::Result<Outcome> {
    expect_png(&arguments.output)?;
    let reader = open(&arguments.run, messages)?;
    let scene = scene_of(&reader)?;
    let frames = reader.frames();
    let steps: Vec<f64> = (0..frames).map(|frame| reader.step(frame) as f64).collect();
    let now = reader.series("volume_by_cells")?.values;
    let rest = reader.series("rest_volume_by_cells")?.values;
    let by_cells: Vec<[f64; 2]> =
        steps.iter().zip(now.iter().zip(&rest)).map(|(&step, (now, rest))| [step, percent(*now, *rest)]).collect();

    let organs = if arguments.organ.is_empty() {
        let soft = scene.organs.iter().filter(|organ| !matches!(organ.body, Body::Rigid { .. }));
        soft.map(|organ| organ.name.clone()).collect()
    } else {
        arguments.organ.clone()
    };
    let mut mesher = RunMesher::new(reader, &organs, DEFAULT_SMOOTHING)?;
    let bar = progress::bar(messages, "frames", frames as u64);
    let mut by_surface = Vec::with_capacity(frames);
    let mut first = None;
    for (frame, &step) in steps.iter().enumerate() {
        let (_, meshes) = mesher.frame(frame)?;
        let volume: f64 = meshes.iter().map(|organ| check(&organ.mesh).volume_mm3).sum();
        by_surface.push([step, percent(volume, *first.get_or_insert(volume))]);
        bar.inc(1);
    }
    bar.finish_and_clear();

    let range = |points: &[[f64; 2]]| {
        points.iter().map(|p| p[1]).fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), y| (low.min(y), high.max(y)))
    };
    let ((cells_low, cells_high), (surface_low, surface_high)) = (range(&by_cells), range(&by_surface));
    let plot = Plot {
        title: format!("Volume of {}", organs.join(", ")),
        x: Axis::linear("step", ""),
        y: Axis::linear("change of volume", "%"),
        series: vec![
            Series { name: "by cells".to_owned(), points: by_cells, marks: false },
            Series { name: "by surface".to_owned(), points: by_surface, marks: false },
        ],
    };
    plot.write_png(&arguments.output)?;
    let numbers = arguments.output.with_extension("csv");
    plot.write_csv(&numbers)?;
    out(&format!(
        "change of volume by cells {cells_low:+.3} to {cells_high:+.3} %, by surface {surface_low:+.3} to {surface_high:+.3} %\n{}\n{}",
        arguments.output.display(),
        numbers.display()
    ))?;
    Ok(Outcome::Done)
}

fn percent(now: f64, rest: f64) -> f64 {
    if rest == 0.0 { 0.0 } else { 100.0 * (now / rest - 1.0) }
}
