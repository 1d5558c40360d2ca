//! `yawara mesh`: the surfaces of a run as files.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use rayon::prelude::*;

use super::args::{AnimationChoice, FrameChoice, MeshArguments};
use super::exit::Outcome;
use super::messages::{Messages, out};
use super::paint::frame;
use super::progress;
use super::source::Source;
use super::surface::mesher;
use crate::io::gltf::{MorphAnimationWriter, Precision, StepAnimationWriter, quantization_error_mm, write_gltf};
use crate::io::mesh_format::{FramePattern, MeshFormat, MeshOutput};
use crate::io::vtk::{self, LatticeState};
use crate::run::interfaces::SharedRegions;
use crate::run::meshes::{RunMesher, scene_of};
use crate::run::paint::Painter;
use crate::store::RunReader;
use crate::surface::mesh::OrganMesh;
use crate::surface::sharp_edges::split_sharp_edges;

pub(super) fn mesh(arguments: &MeshArguments, messages: &Messages) -> anyhow::Result<Outcome> {
    let lattice = arguments.output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("vtu"));
    let written = if lattice { write_lattice(arguments, messages)? } else { write_surfaces(arguments, messages)? };
    for path in written {
        out(&path.display().to_string())?;
    }
    Ok(Outcome::Done)
}

fn write_surfaces(arguments: &MeshArguments, messages: &Messages) -> anyhow::Result<Vec<PathBuf>> {
    let style = Style::of(arguments)?;
    if matches!(style.format, MeshFormat::Stl | MeshFormat::StlAscii) && arguments.paint.asks() {
        bail!(
            "{}: STL holds no colours and no attributes; --color, --detail and --attributes are for other formats",
            arguments.output.display()
        );
    }
    let mut mesher = mesher(&arguments.run, &arguments.organ, &arguments.surface.options(), messages)?;
    let frames = frames(arguments.frame, mesher.reader())?;
    let output = MeshOutput::new(&arguments.output, style.format.animates(), frames.len())?;
    if style.animation == AnimationChoice::Morph && !matches!(output, MeshOutput::Animation(_)) {
        bail!(
            "{}: --animation morph is for several frames in one .glb or .gltf; add --frame all, and no {{frame}} in the name",
            arguments.output.display()
        );
    }
    let painter = arguments.paint.painter(&mesher, messages)?;
    write(&mut mesher, painter.as_ref(), &frames, &output, style, messages)
}

/// Writes the lattice in place of surfaces.
fn write_lattice(arguments: &MeshArguments, messages: &Messages) -> anyhow::Result<Vec<PathBuf>> {
    let MeshArguments { output, organ, ascii, quantize, crisp, animation, .. } = arguments;
    if *ascii || *quantize || *crisp || *animation == AnimationChoice::Morph || !organ.is_empty() {
        bail!(
            "{}: a .vtu holds the whole lattice as it is; --organ, --ascii, --quantize, --crisp and --animation are for surfaces",
            output.display()
        );
    }
    let reader = open(&arguments.run, messages)?;
    let frames = frames(arguments.frame, &reader)?;
    let last = reader.frames() - 1;
    let output = MeshOutput::new(output, false, frames.len())?;
    let names: Vec<String> = scene_of(&reader)?.organs.into_iter().map(|organ| organ.name).collect();
    let bar = progress::bar(messages, "frames", frames.len() as u64);
    let mut written = Sequence::default();
    for &number in &frames {
        let path = match &output {
            MeshOutput::Sequence(pattern) => pattern.path(number, last),
            MeshOutput::File(path) | MeshOutput::Animation(path) => path.clone(),
        };
        let frame = reader.frame(number)?;
        let state = LatticeState {
            lattice: reader.lattice(),
            topology: &frame.topology,
            displacements_mm: &frame.displacements_mm,
            organ_names: &names,
            time: frame.time_s,
        };
        vtk::write_vtu(&path, &state)?;
        written.add(frame.time_s, path);
        bar.inc(1);
    }
    bar.finish_and_clear();
    match &output {
        MeshOutput::Sequence(pattern) => written.with_times(pattern),
        MeshOutput::File(_) | MeshOutput::Animation(_) => Ok(written.paths),
    }
}

/// What mesh files are like.
#[derive(Debug, Clone, Copy)]
pub(super) struct Style {
    format: MeshFormat,
    precision: Precision,
    crisp: bool,
    animation: AnimationChoice,
}

impl Style {
    /// The usual files of a format.
    pub(super) fn plain(format: MeshFormat) -> Self {
        Self { format, precision: Precision::Float, crisp: false, animation: AnimationChoice::Step }
    }

    /// The same with crisp edges.
    pub(super) fn crisp(format: MeshFormat) -> Self {
        Self { crisp: true, ..Self::plain(format) }
    }

    fn of(arguments: &MeshArguments) -> anyhow::Result<Self> {
        let mut style = Self::plain(MeshFormat::from_path(&arguments.output)?);
        if arguments.ascii {
            style.format = style.format.ascii()?;
        }
        if arguments.quantize {
            if !style.format.animates() {
                bail!("{}: --quantize is for .glb and .gltf", arguments.output.display());
            }
            if arguments.animation == AnimationChoice::Morph {
                bail!("morph targets are not quantised; leave --quantize or --animation morph out");
            }
            style.precision = Precision::Quantized;
        }
        if arguments.crisp {
            if matches!(style.format, MeshFormat::Stl | MeshFormat::StlAscii) {
                bail!("{}: STL has no normals of vertices; --crisp is for other formats", arguments.output.display());
            }
            if arguments.animation == AnimationChoice::Morph {
                bail!("morph targets need the same vertices in every frame; leave --crisp or --animation morph out");
            }
            style.crisp = true;
        }
        style.animation = arguments.animation;
        Ok(style)
    }
}

/// Files written one after the other.
#[derive(Default)]
struct Sequence {
    paths: Vec<PathBuf>,
    times: Vec<f64>,
}

impl Sequence {
    fn add(&mut self, time: f64, path: PathBuf) {
        self.paths.push(path);
        self.times.push(time);
    }

    /// Writes the list of files with their times, and gives all paths, this last.
    fn with_times(mut self, pattern: &FramePattern) -> anyhow::Result<Vec<PathBuf>> {
        let names = self.paths.iter().map(|path| path.file_name().unwrap_or_default().to_string_lossy().into_owned());
        let list: Vec<(f64, String)> = self.times.iter().copied().zip(names).collect();
        let path = pattern.summary("pvd");
        vtk::write_pvd(&path, &list)
            .with_context(|| format!("{}: could not write the list of frames", path.display()))?;
        self.paths.push(path);
        Ok(self.paths)
    }
}

/// Opens a run and says when it is not complete.
pub(super) fn open(path: &Path, messages: &Messages) -> anyhow::Result<RunReader> {
    match Source::of(path)? {
        Source::Run => {}
        other => return Err(other.refuse(path, "a run directory")),
    }
    let reader = RunReader::open(path)?;
    if let Some(warning) = reader.warning() {
        messages.warning(warning);
    }
    Ok(reader)
}

/// Numbers of the frames that are asked for.
pub(super) fn frames(choice: FrameChoice, reader: &RunReader) -> anyhow::Result<Vec<usize>> {
    frames_of(choice, reader.frames(), reader.path(), "the run")
}

/// The same of anything with so many frames.
pub(super) fn frames_of(choice: FrameChoice, count: usize, path: &Path, what: &str) -> anyhow::Result<Vec<usize>> {
    let Some(last) = count.checked_sub(1) else { bail!("{}: {what} has no frame yet", path.display()) };
    match choice {
        FrameChoice::All => Ok((0..count).collect()),
        FrameChoice::Last => Ok(vec![last]),
        FrameChoice::Number(number) if number < count => Ok(vec![number]),
        FrameChoice::Number(number) => {
            bail!("{}: there is no frame {number}; {what} has frames 0 to {last}", path.display())
        }
    }
}

/// Writes frames, one at a time, and returns the paths written.
pub(super) fn write(
    mesher: &mut RunMesher,
    painter: Option<&Painter>,
    frames: &[usize],
    output: &MeshOutput,
    style: Style,
    messages: &Messages,
) -> anyhow::Result<Vec<PathBuf>> {
    let bar = progress::bar(messages, "frames", frames.len() as u64);
    let last = mesher.reader().frames().saturating_sub(1);
    // How far quantised vertices lie from their place [mm].
    let mut error = 0.0_f64;
    let mut unreached = mesher.care().triangles;
    let mut next = |number: usize| -> anyhow::Result<(f64, Vec<OrganMesh>, Option<SharedRegions>)> {
        let (time, mut meshes) = frame(mesher, painter, number)?;
        if let Some(asked) = unreached.take() {
            tell_unreached(asked, &meshes, messages);
        }
        if style.crisp {
            make_crisp(mesher, &mut meshes);
        }
        if style.precision == Precision::Quantized {
            error = error.max(quantization_error_mm(&meshes));
        }
        bar.inc(1);
        Ok((time, meshes, mesher.regions()))
    };
    let written = match output {
        MeshOutput::File(path) => {
            let (time, meshes, regions) = next(frames[0])?;
            write_one(style, path, time, &meshes, regions)?;
            vec![path.clone()]
        }
        MeshOutput::Sequence(pattern) => {
            let mut written = Sequence::default();
            for &number in frames {
                let (time, meshes, regions) = next(number)?;
                let path = pattern.path(number, last);
                write_one(style, &path, time, &meshes, regions)?;
                written.add(time, path);
            }
            if style.format == MeshFormat::Vtp { written.with_times(pattern)? } else { written.paths }
        }
        MeshOutput::Animation(path) => {
            match style.animation {
                AnimationChoice::Step => {
                    let mut animation = StepAnimationWriter::create(path, style.precision)?;
                    for &number in frames {
                        let (time, meshes, _) = next(number)?;
                        animation.push_frame(time, &meshes)?;
                    }
                    animation.finish()?;
                }
                AnimationChoice::Morph => {
                    let mut animation = MorphAnimationWriter::create(path)?;
                    for &number in frames {
                        let (time, meshes, _) = next(number)?;
                        animation.push_frame(time, &meshes)?;
                    }
                    animation.finish()?;
                }
            }
            vec![path.clone()]
        }
    };
    bar.finish_and_clear();
    if style.precision == Precision::Quantized {
        messages.note(format!(
            "quantised: vertices lie at most {error:.2e} mm from their place along each axis, normals turn by at most 0.4 degrees"
        ));
    }
    Ok(written)
}

/// Says which organs kept more triangles than they were to be decimated to.
fn tell_unreached(asked: usize, meshes: &[OrganMesh], messages: &Messages) {
    for organ in meshes.iter().filter(|organ| organ.mesh.triangles.len() > asked + asked / 10) {
        messages.warning(format_args!(
            "organ `{}` has {} triangles, not the {asked} asked for: without more of its edges it would open or fold",
            organ.name,
            organ.mesh.triangles.len()
        ));
    }
}

/// Gives the rims of cuts and other sharp edges of a frame two normals.
pub(super) fn make_crisp(mesher: &RunMesher, meshes: &mut [OrganMesh]) {
    let on_cut = mesher.on_cut();
    meshes.par_iter_mut().zip(on_cut).for_each(|(organ, on_cut)| split_sharp_edges(&mut organ.mesh, &on_cut));
}

/// - `regions`: what lies on the two sides of each mesh, where walls are shared.
fn write_one(
    style: Style,
    path: &Path,
    time: f64,
    meshes: &[OrganMesh],
    regions: Option<SharedRegions>,
) -> anyhow::Result<()> {
    match style.format {
        MeshFormat::Vtp => match &regions {
            Some(SharedRegions { names, sides }) => {
                vtk::write_vtp_borders(path, meshes, vtk::Regions { names, sides }, Some(time))?;
            }
            None => vtk::write_vtp(path, meshes, Some(time))?,
        },
        MeshFormat::Glb | MeshFormat::Gltf => write_gltf(path, meshes, style.precision)?,
        format => format.write(path, meshes)?,
    }
    Ok(())
}
