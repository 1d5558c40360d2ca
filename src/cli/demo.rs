//! `yawara demo`: the whole way on the embedded phantom.

use std::path::Path;

use anyhow::{Context, bail};

use super::args::{AxisChoice, DemoArguments, FrameChoice};
use super::exit::Outcome;
use super::mesh::{Style, write};
use super::messages::{Messages, out};
use super::surface::mesher;
use super::{run, slice};
use crate::io::mesh_format::{MeshFormat, MeshOutput};
use crate::run::label_lookup::Files;
use crate::run::meshes::MeshOptions;
use crate::scene::QUICKSTART;
use crate::store::RunWriter;

/// Organ whose surface is written as STL and PLY.
const ORGAN: &str = "liver";
const RUN: &str = "run";
const ANIMATION: &str = "animation.glb";
const STL: &str = "liver.stl";
const PLY: &str = "liver.ply";
/// Slices: name, axis, place [mm], frame.
const SLICES: [(&str, AxisChoice, f64, FrameChoice); 3] = [
    ("axial-before.png", AxisChoice::Z, 0.0, FrameChoice::Number(0)),
    ("axial-after.png", AxisChoice::Z, 0.0, FrameChoice::Last),
    ("coronal-after.png", AxisChoice::Y, 40.0, FrameChoice::Last),
];

pub(super) fn demo(arguments: &DemoArguments, messages: &Messages) -> anyhow::Result<Outcome> {
    let folder = &arguments.output;
    make_room(folder, arguments.overwrite)?;
    let (scene, _) = crate::scene::parse(QUICKSTART, Path::new("quickstart.toml"), Path::new(""), &Files)?;
    let run = folder.join(RUN);
    let outcome = run::simulate(&scene, QUICKSTART.to_owned(), &run, arguments.overwrite, messages)?;
    if outcome != Outcome::Done {
        return Ok(outcome);
    }

    let mesh = |name: &str, organs: &[String], all: bool| -> anyhow::Result<()> {
        let path = folder.join(name);
        let format = MeshFormat::from_path(&path)?;
        let mut mesher = mesher(&run, organs, &MeshOptions::default(), messages)?;
        let last = mesher.reader().frames() - 1;
        let frames: Vec<usize> = if all { (0..=last).collect() } else { vec![last] };
        let output = MeshOutput::new(&path, format.animates(), frames.len())?;
        // The animation is for looking at, the others for work.
        let style = if all { Style::crisp(format) } else { Style::plain(format) };
        write(&mut mesher, None, &frames, &output, style, messages)?;
        Ok(())
    };
    mesh(ANIMATION, &[], true)?;
    mesh(STL, &[ORGAN.to_owned()], false)?;
    mesh(PLY, &[ORGAN.to_owned()], false)?;
    for (name, axis, at, frame) in SLICES {
        slice::of_run_at(&run, &folder.join(name), axis, at, frame, messages)?;
    }
    let at = |name: &str| folder.join(name).display().to_string();
    let [before, after, coronal] = SLICES.map(|slice| at(slice.0));
    out(&format!(
        "{}  the whole motion: open it in Blender (File > Import > glTF), f3d, or any three.js viewer\n\
         {}  the cut liver at the end, patient mm: MeshLab, ParaView, 3D Slicer\n\
         {}  the same with normals, labels and displacements\n\
         {before}  a slice of the CT before\n\
         {after}  the same slice after\n\
         {coronal}  a slice seen from the front, after\n\
         {}  the run itself: yawara info, mesh, slice, volume, check",
        at(ANIMATION),
        at(STL),
        at(PLY),
        at(RUN),
    ))?;
    Ok(Outcome::Done)
}

/// Refuses a folder that holds something else than a demo to be replaced; takes away what an earlier one wrote around its run, so that
/// files of two demos never lie side by side. The run itself is replaced when the new one begins.
fn make_room(folder: &Path, overwrite: bool) -> anyhow::Result<()> {
    if folder.exists() && !folder.is_dir() {
        bail!("{}: is a file; give a folder to write to", folder.display());
    }
    let held = folder.is_dir() && folder.read_dir().with_context(|| at(folder, "could not be read"))?.next().is_some();
    if !held {
        return Ok(());
    }
    if !overwrite {
        bail!(
            "{}: exists and is not empty; choose another folder, or replace an earlier demo in it (--overwrite)",
            folder.display()
        );
    }
    if !folder.join(RUN).is_dir() {
        bail!(
            "{}: holds no earlier demo (no {RUN} in it), so nothing is overwritten; choose another folder",
            folder.display()
        );
    }
    RunWriter::check_place(&folder.join(RUN), overwrite)?;
    for name in [ANIMATION, STL, PLY].into_iter().chain(SLICES.map(|slice| slice.0)) {
        let path = folder.join(name);
        match std::fs::remove_file(&path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                return Err(error).with_context(|| at(&path, "could not be replaced"));
            }
            _ => {}
        }
    }
    Ok(())
}

fn at(path: &Path, what: &str) -> String {
    format!("{}: {what}", path.display())
}
