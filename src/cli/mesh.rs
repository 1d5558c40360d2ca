//! `yawara mesh`: the surfaces of a run as files.

use std::path::{Path, PathBuf};

use anyhow::bail;

use super::args::{FrameChoice, MeshArguments};
use super::exit::Outcome;
use super::messages::{Messages, out};
use super::paint::frame;
use super::progress;
use super::source::Source;
use super::surface::mesher;
use crate::io::gltf::{Precision, StepAnimationWriter};
use crate::io::mesh_format::{MeshFormat, MeshOutput};
use crate::run::meshes::RunMesher;
use crate::run::paint::Painter;
use crate::store::RunReader;
use crate::surface::mesh::OrganMesh;

pub(super) fn mesh(arguments: &MeshArguments, messages: &Messages) -> anyhow::Result<Outcome> {
    let mut format = MeshFormat::from_path(&arguments.output)?;
    if arguments.ascii {
        format = format.ascii()?;
    }
    let mut mesher = mesher(&arguments.run, &arguments.organ, &arguments.surface.options(), messages)?;
    let frames = frames(arguments.frame, mesher.reader())?;
    let output = MeshOutput::new(&arguments.output, format, frames.len())?;
    let painter = arguments.paint.painter(&mesher, messages)?;
    for path in write(&mut mesher, painter.as_ref(), &frames, &output, format, messages)? {
        out(&path.display().to_string())?;
    }
    Ok(Outcome::Done)
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
    let count = reader.frames();
    let Some(last) = count.checked_sub(1) else { bail!("{}: the run has no frame yet", reader.path().display()) };
    match choice {
        FrameChoice::All => Ok((0..count).collect()),
        FrameChoice::Last => Ok(vec![last]),
        FrameChoice::Number(number) if number < count => Ok(vec![number]),
        FrameChoice::Number(number) => {
            bail!("{}: there is no frame {number}; the run has frames 0 to {last}", reader.path().display())
        }
    }
}

/// Writes frames and returns the paths written.
pub(super) fn write(
    mesher: &mut RunMesher,
    painter: Option<&Painter>,
    frames: &[usize],
    output: &MeshOutput,
    format: MeshFormat,
    messages: &Messages,
) -> anyhow::Result<Vec<PathBuf>> {
    let bar = progress::bar(messages, "frames", frames.len() as u64);
    let last = mesher.reader().frames().saturating_sub(1);
    let mut written = Vec::new();
    match output {
        MeshOutput::File(path) => {
            let (_, meshes) = frame(mesher, painter, frames[0])?;
            write_one(format, path, &meshes)?;
            written.push(path.clone());
        }
        MeshOutput::Sequence(pattern) => {
            for &number in frames {
                let (_, meshes) = frame(mesher, painter, number)?;
                let path = pattern.path(number, last);
                write_one(format, &path, &meshes)?;
                written.push(path);
                bar.inc(1);
            }
        }
        MeshOutput::Animation(path) => {
            let mut animation = StepAnimationWriter::create(path, Precision::Float)?;
            for &number in frames {
                let (time, meshes) = frame(mesher, painter, number)?;
                animation.push_frame(time, &meshes)?;
                bar.inc(1);
            }
            animation.finish()?;
            written.push(path.clone());
        }
    }
    bar.finish_and_clear();
    Ok(written)
}

fn write_one(format: MeshFormat, path: &Path, meshes: &[OrganMesh]) -> anyhow::Result<()> {
    Ok(format.write(path, meshes)?)
}
