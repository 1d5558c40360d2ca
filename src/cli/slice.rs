//! `yawara slice`: a plane of a volume or a run as PNG.

use std::path::Path;

use anyhow::{Context, bail};

use super::args::{FrameChoice, SliceArguments};
use super::exit::Outcome;
use super::mesh::{frames, open};
use super::messages::{Messages, out};
use super::source::{Source, expect_png, label_map};
use crate::geometry::Grid;
use crate::io::nifti::{read_ct, read_info, read_labels};
use crate::io::png::write_png;
use crate::look::colormap::label_color;
use crate::run::inputs;
use crate::run::meshes::{MeshOptions, RunMesher, scene_of};
use crate::scene::resolved::{Scene, VoxelSelection};
use crate::slice::deformed::InverseMap;
use crate::slice::{SlicePicture, SlicePlane, Tint, Window};
use crate::surface::mesh::{OrganMesh, TriangleMesh};
use crate::volume::{CtVolume, LabelVolume};

pub(super) fn slice(arguments: &SliceArguments, messages: &Messages) -> anyhow::Result<Outcome> {
    if !(0.0..=1.0).contains(&arguments.tint) {
        bail!("--tint is {}, expected a share from 0 (grey) to 1", arguments.tint);
    }
    expect_png(&arguments.output)?;
    match Source::of(&arguments.source)? {
        Source::Run => of_run(arguments, messages)?,
        Source::Volume => of_volume(arguments)?,
        other => return Err(other.refuse(&arguments.source, "a volume (NIfTI) or a run directory")),
    }
    out(&arguments.output.display().to_string())?;
    Ok(Outcome::Done)
}

fn of_volume(arguments: &SliceArguments) -> anyhow::Result<()> {
    let own = || label_map(&arguments.source, &read_info(&arguments.source)?);
    let (ct, labels) = match &arguments.labels {
        Some(path) => (Some(read_ct(&arguments.source)?.0), Some(read_labels(path)?.0)),
        None => match own()? {
            Some(labels) => (None, Some(labels)),
            None => (Some(read_ct(&arguments.source)?.0), None),
        },
    };
    let grid = grid_of(arguments, &ct, &labels)?;
    let tint = labels.as_ref().map(|labels| Tint { colors: palette(labels), alpha: arguments.tint });
    let plane = plane(arguments, grid);
    let raster = plane.raster(grid)?;
    let picture = SlicePicture {
        ct: ct.as_ref(),
        labels: labels.as_ref(),
        window: window(arguments),
        tint: tint.as_ref(),
        carried: None,
        contours: &[],
        annotate: !arguments.plain,
    };
    Ok(write_png(&arguments.output, &picture.draw(&raster)?, Some(plane.pixel_mm))?)
}

fn of_run(arguments: &SliceArguments, messages: &Messages) -> anyhow::Result<()> {
    if arguments.labels.is_some() {
        bail!("--labels goes with a volume; a run brings its own label map");
    }
    if arguments.frame == FrameChoice::All {
        bail!("--frame all: a slice shows one frame; give a number or `last`");
    }
    let reader = open(&arguments.source, messages)?;
    let number = frames(arguments.frame, &reader)?[0];
    let scene = scene_of(&reader)?;
    // The run keeps no copy of its volumes: they are read, or made, again.
    let volumes = inputs::load_volume(&scene.volume).with_context(|| {
        format!("{}: the volumes of the run are needed again for a slice", arguments.source.display())
    })?;
    for (now, then) in volumes.files.iter().zip(&reader.manifest().inputs) {
        if now.sha256 != then.sha256 {
            messages.warning(format_args!("{}: has changed since the run was made", now.path.display()));
        }
    }
    let at_rest = if arguments.rest { 0 } else { number };
    let frame = reader.frame(number)?;
    let mut mesher = RunMesher::new(reader, &[], &MeshOptions::default())?;
    let meshes = if arguments.no_contour { Vec::new() } else { mesher.frame(at_rest)?.1 };
    draw_run(arguments, &scene, &volumes.image, &volumes.labels, &meshes, |raster| {
        (!arguments.rest).then(|| {
            InverseMap::new(mesher.reader().lattice(), &frame.topology, &frame.displacements_mm).carried(raster)
        })
    })
}

fn draw_run(
    arguments: &SliceArguments,
    scene: &Scene,
    image: &Option<CtVolume>,
    labels: &Option<LabelVolume>,
    meshes: &[OrganMesh],
    carry: impl Fn(&crate::slice::Raster) -> Option<crate::slice::deformed::CarriedRaster>,
) -> anyhow::Result<()> {
    let grid = grid_of(arguments, image, labels)?;
    let plane = plane(arguments, grid);
    let raster = plane.raster(grid)?;
    let carried = carry(&raster);
    let colors = scene
        .organs
        .iter()
        .filter_map(|organ| match &organ.voxels {
            VoxelSelection::Labels(labels) => Some(labels.iter().map(|&label| (label, organ.color))),
            VoxelSelection::Hu { .. } => None,
        })
        .flatten()
        .collect();
    let tint = Tint { colors, alpha: arguments.tint };
    let contours: Vec<(&TriangleMesh, [f32; 3])> = meshes.iter().map(|organ| (&organ.mesh, organ.color)).collect();
    let picture = SlicePicture {
        ct: image.as_ref(),
        labels: labels.as_ref(),
        window: window(arguments),
        tint: labels.is_some().then_some(&tint),
        carried: carried.as_ref(),
        contours: &contours,
        annotate: !arguments.plain,
    };
    Ok(write_png(&arguments.output, &picture.draw(&raster)?, Some(plane.pixel_mm))?)
}

/// The grid that a slice covers: the image's, or else the label map's.
fn grid_of<'a>(
    arguments: &SliceArguments,
    image: &'a Option<CtVolume>,
    labels: &'a Option<LabelVolume>,
) -> anyhow::Result<&'a Grid> {
    match (image, labels) {
        (Some(image), _) => Ok(image.grid()),
        (None, Some(labels)) => Ok(labels.grid()),
        (None, None) => bail!("{}: has neither image nor labels", arguments.source.display()),
    }
}

fn plane(arguments: &SliceArguments, grid: &Grid) -> SlicePlane {
    let (axis, at_mm) = (arguments.axis.into(), arguments.at);
    match arguments.pixel {
        Some(pixel_mm) => SlicePlane { axis, at_mm, pixel_mm },
        None => SlicePlane::fitting(axis, at_mm, grid),
    }
}

fn window(arguments: &SliceArguments) -> Window {
    Window { center: arguments.level, width: arguments.window }
}

/// A colour for every label of a map: evenly spread hues, the same for the same label.
fn palette(labels: &LabelVolume) -> std::collections::BTreeMap<u16, [f32; 3]> {
    labels
        .label_summaries()
        .iter()
        .filter(|summary| summary.label != 0)
        .map(|summary| (summary.label, label_color(summary.label)))
        .collect()
}

/// Draws one slice of a run in the demo's manner.
pub(super) fn of_run_at(
    run: &Path,
    output: &Path,
    axis: super::args::AxisChoice,
    at: f64,
    frame: FrameChoice,
    messages: &Messages,
) -> anyhow::Result<()> {
    let arguments = SliceArguments {
        source: run.to_owned(),
        output: output.to_owned(),
        axis,
        at,
        pixel: None,
        level: Window::SOFT_TISSUE.center,
        window: Window::SOFT_TISSUE.width,
        labels: None,
        tint: 0.25,
        frame,
        rest: false,
        no_contour: false,
        plain: false,
    };
    of_run(&arguments, messages)
}
