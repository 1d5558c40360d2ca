//! `yawara mesh`: the surfaces of a run as files.

use std::path::{Path, PathBuf};

use anyhow::bail;

use super::args::{FrameChoice, MeshArguments};
use super::exit::Outcome;
use super::messages::{Messages, out};
use super::progress;
use super::source::Source;
use crate::io::gltf::AnimatedGlbWriter;
use crate::io::mesh_format::{MeshFormat, MeshOutput};
use crate::run::meshes::{MeshOptions, MeshRunError, Resolution, RunMesher};
use crate::store::RunReader;
use crate::surface::mesh::OrganMesh;

pub(super) fn mesh(arguments: &MeshArguments, messages: &Messages) -> anyhow::Result<Outcome> {
    let mut format = MeshFormat::from_path(&arguments.output)?;
    if arguments.ascii {
        format = format.ascii()?;
    }
    let options = MeshOptions { resolution: arguments.resolution.0, smoothing: arguments.smooth };
    let mut mesher = mesher(&arguments.run, &arguments.organ, &options, messages)?;
    let frames = frames(arguments.frame, mesher.reader())?;
    let output = MeshOutput::new(&arguments.output, format, frames.len())?;
    for path in write(&mut mesher, &frames, &output, format, messages)? {
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
            let (_, meshes) = mesher.frame(frames[0])?;
            write_one(format, path, &meshes)?;
            written.push(path.clone());
        }
        MeshOutput::Sequence(pattern) => {
            for &number in frames {
                let (_, meshes) = mesher.frame(number)?;
                let path = pattern.path(number, last);
                write_one(format, &path, &meshes)?;
                written.push(path);
                bar.inc(1);
            }
        }
        MeshOutput::Animation(path) => {
            let mut animation = AnimatedGlbWriter::create(path)?;
            for &number in frames {
                let (time, meshes) = mesher.frame(number)?;
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
