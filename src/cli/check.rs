//! `yawara check`: are meshes closed, manifold and oriented?

use std::path::Path;

use serde_json::{Value, json};

use super::args::CheckArguments;
use super::examine::{Examined, examine};
use super::exit::Outcome;
use super::messages::{Messages, out};
use super::progress;
use super::source::Source;
use super::surface::mesher;
use crate::io::gltf::GltfReader;
use crate::io::mesh_format::MeshFormat;
use crate::run::meshes::MeshOptions;
use crate::surface::check::check as by_index;
use crate::surface::mesh::OrganMesh;

pub(super) fn check(arguments: &CheckArguments, messages: &Messages) -> anyhow::Result<Outcome> {
    let path = &arguments.path;
    let checked = match Source::of(path)? {
        Source::Run => of_run(path, messages)?,
        Source::Mesh(format) => of_mesh(path, format)?,
        other => return Err(other.refuse(path, "a mesh (.stl, .ply, .glb, .gltf, .obj) or a run directory")),
    };
    let passed = checked.iter().all(|(_, _, found)| found.report.passes());
    if arguments.json {
        let meshes: Vec<Value> = checked.iter().map(|(frame, name, found)| to_json(*frame, name, found)).collect();
        out(&json!({ "passed": passed, "meshes": meshes }).to_string())?;
    } else {
        for (frame, name, Examined { report, merged }) in &checked {
            let frame = frame.map(|frame| format!("frame {frame}, ")).unwrap_or_default();
            let verdict = if report.passes() { "passed" } else { "FAILED" };
            let how = if *merged { ", with vertices at one place merged" } else { "" };
            out(&format!("{frame}{name}: {verdict}{how}\n{report}"))?;
        }
    }
    Ok(if passed { Outcome::Done } else { Outcome::CheckFailed })
}

type Checked = Vec<(Option<usize>, String, Examined)>;

fn of_mesh(path: &Path, format: MeshFormat) -> anyhow::Result<Checked> {
    let report = |frame, organs: Vec<OrganMesh>| {
        organs.into_iter().map(move |organ| (frame, organ.name, examine(&organ.mesh))).collect::<Vec<_>>()
    };
    if matches!(format, MeshFormat::Glb | MeshFormat::Gltf) {
        let mut reader = GltfReader::open(path)?;
        let frames = reader.frames();
        let mut checked = Vec::new();
        for frame in 0..frames {
            checked.extend(report((frames > 1).then_some(frame), reader.read_frame(frame)?));
        }
        return Ok(checked);
    }
    Ok(report(None, format.read(path)?))
}

fn of_run(path: &Path, messages: &Messages) -> anyhow::Result<Checked> {
    let mut mesher = mesher(path, &[], &MeshOptions::default(), messages)?;
    let frames = mesher.reader().frames();
    let bar = progress::bar(messages, "frames", frames as u64);
    let mut checked = Vec::new();
    for frame in 0..frames {
        let (_, meshes) = mesher.frame(frame)?;
        // Surfaces of our own are closed by index, or not at all.
        let report = |organ: &OrganMesh| Examined { report: by_index(&organ.mesh), merged: false };
        checked.extend(meshes.into_iter().map(|organ| (Some(frame), organ.name.clone(), report(&organ))));
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(checked)
}

fn to_json(frame: Option<usize>, name: &str, Examined { report, merged }: &Examined) -> Value {
    json!({
        "frame": frame,
        "name": name,
        "passed": report.passes(),
        "merged": merged,
        "closed": report.is_closed(),
        "manifold": report.is_manifold(),
        "oriented": report.is_oriented(),
        "vertices": report.vertices,
        "triangles": report.triangles,
        "open_edges": report.open_edges,
        "non_manifold_edges": report.non_manifold_edges,
        "non_manifold_vertices": report.non_manifold_vertices,
        "inconsistent_edges": report.inconsistent_edges,
        "duplicate_triangles": report.duplicate_triangles,
        "non_finite_vertices": report.non_finite_vertices,
        "components": report.components.len(),
        "euler_characteristic": report.euler,
        "area_mm2": report.area_mm2,
        "volume_mm3": report.volume_mm3,
        "min_angle_deg": report.min_angle_deg,
        "triangles_below_5_deg": report.slivers,
    })
}
