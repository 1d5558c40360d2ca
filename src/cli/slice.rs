//! `yawara slice`: a plane of a volume or a run as PNG.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use image::{DynamicImage, RgbImage};

use super::args::{FrameChoice, SliceArguments, SliceColor};
use super::exit::Outcome;
use super::mesh::{frames, open};
use super::messages::{Messages, out};
use super::pictures::{Pictures, delays, is_animation};
use super::progress;
use super::source::{Source, label_map};
use super::surface::mesher;
use crate::geometry::{Grid, Point3, Vector3};
use crate::io::apng::write_apng;
use crate::io::nifti::{read_ct, read_info, read_labels};
use crate::io::png::write_png;
use crate::lattice::Lattice;
use crate::look::colormap::{Colormap, label_color};
use crate::look::strain::equivalent_strains;
use crate::plot::color_bar::ColorBar;
use crate::run::inputs;
use crate::run::meshes::{MeshOptions, RunMesher};
use crate::slice::deformed::InverseMap;
use crate::slice::montage::montage;
use crate::slice::{ObliquePlane, Organs, Overlay, Raster, Section, SlicePicture, SlicePlane, Tint, Window};
use crate::store::{Frame, RunReader};
use crate::surface::mesh::{OrganMesh, TriangleMesh};
use crate::volume::{CtVolume, LabelVolume};

pub(super) fn slice(arguments: &SliceArguments, messages: &Messages) -> anyhow::Result<Outcome> {
    if !(0.0..=1.0).contains(&arguments.tint) {
        bail!("--tint is {}, expected a share from 0 (grey) to 1", arguments.tint);
    }
    let animated = is_animation(&arguments.output)?;
    let written = match Source::of(&arguments.source)? {
        Source::Run => of_run(arguments, messages)?,
        Source::Volume if animated => bail!(
            "{}: a volume has no frames that could follow each other; end the name in .png",
            arguments.output.display()
        ),
        Source::Volume => of_volume(arguments)?,
        other => return Err(other.refuse(&arguments.source, "a volume (NIfTI) or a run directory")),
    };
    for path in written {
        out(&path.display().to_string())?;
    }
    Ok(Outcome::Done)
}

fn of_volume(arguments: &SliceArguments) -> anyhow::Result<Vec<PathBuf>> {
    if is_value(arguments.color) {
        bail!("--color displacement and strain go with a run directory; a volume does not move");
    }
    let own = || label_map(&arguments.source, &read_info(&arguments.source)?);
    let (ct, labels) = match &arguments.labels {
        Some(path) => (Some(read_ct(&arguments.source)?.0), Some(read_labels(path)?.0)),
        None => match own()? {
            Some(labels) => (None, Some(labels)),
            None => (Some(read_ct(&arguments.source)?.0), None),
        },
    };
    let rasters = rasters(arguments, grid_of(arguments, &ct, &labels)?)?;
    let tint =
        labels.as_ref().filter(|_| arguments.color != SliceColor::Hu).map(|labels| every_label(labels, arguments.tint));
    let picture = SlicePicture {
        ct: ct.as_ref(),
        labels: labels.as_ref(),
        window: window(arguments),
        tint: tint.as_ref(),
        annotate: !arguments.plain,
        ..base(&ct, &labels)?
    };
    let panels = rasters.iter().map(|raster| Ok(picture.draw(raster)?)).collect::<anyhow::Result<Vec<_>>>()?;
    write(arguments, &arguments.output, panels, &rasters[0])?;
    Ok(vec![arguments.output.clone()])
}

fn of_run(arguments: &SliceArguments, messages: &Messages) -> anyhow::Result<Vec<PathBuf>> {
    if arguments.labels.is_some() {
        bail!("--labels goes with a volume; a run brings its own label map");
    }
    if arguments.rest && is_value(arguments.color) {
        bail!("--color displacement and strain show tissue that has moved; leave out --rest");
    }
    let numbers = frames(arguments.frame, &open(&arguments.source, messages)?)?;
    let pictures = Pictures::of(&arguments.output, numbers.len())?;
    let mut run = SlicedRun::open(arguments, &numbers, messages)?;
    let bar = progress::bar(messages, "frames", numbers.len() as u64);
    let last = run.mesher.reader().frames().saturating_sub(1);
    let mut written = Vec::new();
    if let Pictures::Animation(path) = &pictures {
        let times: Vec<f64> = numbers.iter().map(|&number| run.mesher.reader().times()[number]).collect();
        let (delays, pixel_mm) = (delays(path, &times, arguments.slow)?, run.rasters[0].pixel_mm());
        write_apng(path, &delays, Some(pixel_mm), |at| {
            let panels = run.frame(arguments, numbers[at])?;
            bar.inc(1);
            compose(arguments, panels).map(DynamicImage::from)
        })?;
        written.push(path.clone());
    } else {
        for &number in &numbers {
            let panels = run.frame(arguments, number)?;
            let path = pictures.path(number, last);
            write(arguments, &path, panels, &run.rasters[0])?;
            written.push(path);
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    Ok(written)
}

/// A run with what all its slices share.
struct SlicedRun {
    mesher: RunMesher,
    image: Option<CtVolume>,
    labels: Option<LabelVolume>,
    rasters: Vec<Raster>,
    /// Surfaces at rest, and what they hold of each raster.
    rest: Vec<OrganMesh>,
    rest_sections: Vec<Section>,
    bar: Option<ColorBar>,
}

impl SlicedRun {
    fn open(arguments: &SliceArguments, numbers: &[usize], messages: &Messages) -> anyhow::Result<Self> {
        // Warns when the volumes have changed.
        let mut mesher = mesher(&arguments.source, &[], &MeshOptions::default(), messages)?;
        // The run keeps no copy of its volumes: they are read, or made, again.
        let volumes = inputs::load_volume(&mesher.scene().volume).with_context(|| {
            format!("{}: the volumes of the run are needed again for a slice", arguments.source.display())
        })?;
        let (image, labels) = (volumes.image, volumes.labels);
        let rasters = rasters(arguments, grid_of(arguments, &image, &labels)?)?;
        let bar = is_value(arguments.color).then(|| color_bar(arguments, mesher.reader(), numbers)).transpose()?;
        let rest = mesher.frame(0)?.1;
        let rest_sections = rasters.iter().map(|raster| section(&rest, raster)).collect();
        Ok(Self { mesher, image, labels, rasters, rest, rest_sections, bar })
    }

    /// The slices of one frame.
    fn frame(&mut self, arguments: &SliceArguments, number: usize) -> anyhow::Result<Vec<RgbImage>> {
        let (frame, moved) = match arguments.rest {
            true => (None, None),
            false => (Some(self.mesher.reader().frame(number)?), Some(self.mesher.frame(number)?.1)),
        };
        let meshes = moved.as_ref().unwrap_or(&self.rest);
        let contours: Vec<(&TriangleMesh, [f32; 3])> = match arguments.no_contour {
            true => Vec::new(),
            false => meshes.iter().map(|organ| (&organ.mesh, organ.color)).collect(),
        };
        let title = match &frame {
            Some(frame) => format!("frame {number}, {:.4} s", frame.time_s),
            None => "at rest".to_owned(),
        };
        let list: Vec<(&str, [f32; 3])> = meshes.iter().map(|organ| (organ.name.as_str(), organ.color)).collect();
        let values = frame.as_ref().filter(|_| self.bar.is_some());
        let values = values.map(|frame| values_of(arguments.color, self.mesher.reader().lattice(), frame));
        let map = frame.as_ref().map(|frame| {
            let map = InverseMap::new(self.mesher.reader().lattice(), &frame.topology, &frame.displacements_mm);
            match &values {
                Some(values) => map.with_values(values),
                None => map,
            }
        });
        let every_label = match (arguments.color, &self.labels) {
            (SliceColor::Label, Some(labels)) => Some(every_label(labels, arguments.tint)),
            (SliceColor::Label, None) => bail!("--color label: the run has no label map; take --color organ"),
            _ => None,
        };
        let mut panels = Vec::new();
        for (raster, then) in self.rasters.iter().zip(&self.rest_sections) {
            let own = map.as_ref().map(|_| section(meshes, raster));
            let now = own.as_ref().unwrap_or(then);
            let carried = map.as_ref().map(|map| map.carried_within(raster, now, then));
            let organs = Organs { section: now, list: &list, alpha: arguments.tint };
            let picture = SlicePicture {
                labels: self.labels.as_ref(),
                window: window(arguments),
                tint: every_label.as_ref(),
                organs: (arguments.color == SliceColor::Organ).then_some(organs),
                overlay: self.bar.as_ref().map(|bar| Overlay { bar, alpha: arguments.tint }),
                carried: carried.as_ref(),
                contours: &contours,
                title: &title,
                annotate: !arguments.plain,
                ..base(&self.image, &self.labels)?
            };
            panels.push(picture.draw(raster)?);
        }
        Ok(panels)
    }
}

fn section(meshes: &[OrganMesh], raster: &Raster) -> Section {
    Section::new(&meshes.iter().map(|organ| &organ.mesh).collect::<Vec<_>>(), raster)
}

/// Whether colours show a value of the particles.
fn is_value(color: SliceColor) -> bool {
    matches!(color, SliceColor::Displacement | SliceColor::Strain)
}

/// What the colours show of each particle.
fn values_of(color: SliceColor, lattice: &Lattice, frame: &Frame) -> Vec<f32> {
    if color == SliceColor::Strain {
        return equivalent_strains(lattice, &frame.topology, &frame.displacements_mm);
    }
    let length = |[x, y, z]: &[f32; 3]| (x * x + y * y + z * z).sqrt();
    frame.displacements_mm.iter().map(length).collect()
}

/// The range that holds the values of all frames that are drawn, unless one is given.
fn color_bar(arguments: &SliceArguments, reader: &RunReader, numbers: &[usize]) -> anyhow::Result<ColorBar> {
    let range = match arguments.range {
        Some(range) => range,
        None => {
            let mut most = 0.0_f32;
            for &number in numbers {
                let values = values_of(arguments.color, reader.lattice(), &reader.frame(number)?);
                most = values.into_iter().fold(most, f32::max);
            }
            // Where nothing has moved any range will do.
            [0.0, if most > 0.0 && most.is_finite() { most } else { 1.0 }]
        }
    };
    let title = if arguments.color == SliceColor::Strain { "equivalent strain" } else { "displacement [mm]" };
    Ok(ColorBar { colormap: arguments.colormap, range, title: title.to_owned() })
}

/// A picture of what there is: the CT, else the labels.
fn base<'a>(image: &'a Option<CtVolume>, labels: &'a Option<LabelVolume>) -> anyhow::Result<SlicePicture<'a>> {
    match (image, labels) {
        (Some(image), _) => Ok(SlicePicture::of_ct(image)),
        (None, Some(labels)) => Ok(SlicePicture::of_labels(labels)),
        (None, None) => bail!("neither image nor labels"),
    }
}

/// Writes the slices of one frame as one picture.
fn write(arguments: &SliceArguments, path: &Path, panels: Vec<RgbImage>, raster: &Raster) -> anyhow::Result<()> {
    Ok(write_png(path, &compose(arguments, panels)?, Some(raster.pixel_mm()))?)
}

/// The slices of one frame in one picture.
fn compose(arguments: &SliceArguments, mut panels: Vec<RgbImage>) -> anyhow::Result<RgbImage> {
    let columns = match arguments.montage {
        Some([columns, _]) => columns,
        None => (panels.len() as f64).sqrt().ceil() as usize,
    };
    match panels.len() {
        1 => Ok(panels.remove(0)),
        _ => montage(&panels, columns).context("the montage is too large; take fewer slices or larger pixels"),
    }
}

/// The planes asked for.
fn rasters(arguments: &SliceArguments, grid: &Grid) -> anyhow::Result<Vec<Raster>> {
    if let (Some(point), Some(normal)) = (arguments.point, arguments.normal) {
        let (point, normal, up) = (Point3::from(point), Vector3::from(normal), arguments.up.map(Vector3::from));
        return Ok(vec![ObliquePlane { point, normal, up, pixel_mm: arguments.pixel }.raster(grid)?]);
    }
    let Some(axis) = arguments.axis else { bail!("give --axis and --at, or --point and --normal") };
    let places = match (arguments.montage, arguments.from, arguments.to) {
        (Some([columns, rows]), Some(from), Some(to)) => {
            let steps = (columns * rows - 1).max(1) as f64;
            (0..columns * rows).map(|at| from + (to - from) * at as f64 / steps).collect()
        }
        _ => arguments.at.clone(),
    };
    let panels = places.len().max(1) as f64;
    let raster = |at_mm: f64| {
        let mut plane = SlicePlane::fitting(axis.into(), at_mm, grid);
        // Panels share the room of one picture, four times as large.
        plane.pixel_mm = arguments.pixel.unwrap_or(plane.pixel_mm * (panels.sqrt() / 2.0).max(1.0));
        Ok(plane.raster(grid)?)
    };
    places.into_iter().map(raster).collect()
}

fn every_label(labels: &LabelVolume, alpha: f64) -> Tint {
    let found = labels.label_summaries();
    let colors = found.iter().filter(|summary| summary.label != 0);
    Tint { colors: colors.map(|summary| (summary.label, label_color(summary.label))).collect(), alpha }
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

fn window(arguments: &SliceArguments) -> Window {
    Window { center: arguments.level, width: arguments.window }
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
        axis: Some(axis),
        at: vec![at],
        montage: None,
        from: None,
        to: None,
        point: None,
        normal: None,
        up: None,
        color: SliceColor::Organ,
        range: None,
        colormap: Colormap::Viridis,
        pixel: None,
        level: Window::SOFT_TISSUE.center,
        window: Window::SOFT_TISSUE.width,
        labels: None,
        tint: 0.25,
        frame,
        slow: 1.0,
        rest: false,
        no_contour: false,
        plain: false,
    };
    of_run(&arguments, messages)?;
    Ok(())
}
