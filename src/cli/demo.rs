//! `yawara demo`: the whole way on the embedded phantom.

use std::path::Path;

use super::args::{AxisChoice, DemoArguments, FrameChoice};
use super::exit::Outcome;
use super::mesh::{open, write};
use super::messages::{Messages, out};
use super::{run, slice};
use crate::io::mesh_format::{MeshFormat, MeshOutput};
use crate::run::label_lookup::Files;
use crate::run::meshes::{DEFAULT_SMOOTHING, RunMesher};
use crate::scene::QUICKSTART;

/// Organ whose surface is written as STL and PLY.
const ORGAN: &str = "liver";

pub(super) fn demo(arguments: &DemoArguments, messages: &Messages) -> anyhow::Result<Outcome> {
    let folder = &arguments.output;
    let (scene, _) = crate::scene::parse(QUICKSTART, Path::new("quickstart.toml"), Path::new(""), &Files)?;
    let run = folder.join("run");
    let outcome = run::simulate(&scene, QUICKSTART.to_owned(), &run, arguments.overwrite, messages)?;
    if outcome != Outcome::Done {
        return Ok(outcome);
    }

    let mesh = |name: &str, organs: &[String], all: bool| -> anyhow::Result<()> {
        let path = folder.join(name);
        let format = MeshFormat::from_path(&path)?;
        let mut mesher = RunMesher::new(open(&run, messages)?, organs, DEFAULT_SMOOTHING)?;
        let last = mesher.reader().frames() - 1;
        let frames: Vec<usize> = if all { (0..=last).collect() } else { vec![last] };
        write(&mut mesher, &frames, &MeshOutput::new(&path, format, frames.len())?, format, messages)?;
        Ok(())
    };
    mesh("animation.glb", &[], true)?;
    mesh("liver.stl", &[ORGAN.to_owned()], false)?;
    mesh("liver.ply", &[ORGAN.to_owned()], false)?;
    for (name, axis, at, frame) in [
        ("axial-before.png", AxisChoice::Z, 0.0, FrameChoice::Number(0)),
        ("axial-after.png", AxisChoice::Z, 0.0, FrameChoice::Last),
        ("coronal-after.png", AxisChoice::Y, 40.0, FrameChoice::Last),
    ] {
        slice::of_run_at(&run, &folder.join(name), axis, at, frame, messages)?;
    }
    let at = |name: &str| folder.join(name).display().to_string();
    out(&format!(
        "{}  the whole motion: open it in Blender (File > Import > glTF), f3d, or any three.js viewer\n\
         {}  the cut liver at the end, patient mm: MeshLab, ParaView, 3D Slicer\n\
         {}  the same with normals, labels and displacements\n\
         {}  a slice of the CT before and (…-after.png) after\n\
         {}  the run itself: yawara info, mesh, slice, volume, check",
        at("animation.glb"),
        at("liver.stl"),
        at("liver.ply"),
        at("axial-before.png"),
        at("run"),
    ))?;
    Ok(Outcome::Done)
}
