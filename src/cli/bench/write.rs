//! `yawara bench write`: how fast mesh files are written, against the disk.

use std::f32::consts::{PI, TAU};
use std::io::Write;
use std::path::Path;
use std::time::Instant;

use anyhow::Context;
use serde_json::json;

use super::super::args::BenchWriteArguments;
use super::super::facts::write_columns;
use super::super::messages::out;
use crate::io::atomic;
use crate::io::gltf::{Precision, write_gltf};
use crate::io::mesh_error::WriteMeshError;
use crate::io::mesh_format::MeshFormat;
use crate::surface::mesh::{Finish, OrganMesh, TriangleMesh};

/// Best of this many writes is reported.
const RUNS: usize = 3;
/// What a row is called, its file, and what writes it.
type Row = (&'static str, &'static str, fn(&Path, &[OrganMesh]) -> Result<(), WriteMeshError>);
const ROWS: [Row; 7] = [
    ("STL", "m.stl", |path, organs| MeshFormat::Stl.write(path, organs)),
    ("STL (text)", "t.stl", |path, organs| MeshFormat::StlAscii.write(path, organs)),
    ("PLY", "m.ply", |path, organs| MeshFormat::Ply.write(path, organs)),
    ("GLB", "m.glb", |path, organs| MeshFormat::Glb.write(path, organs)),
    ("GLB (quantised)", "q.glb", |path, organs| write_gltf(path, organs, Precision::Quantized)),
    ("OBJ", "m.obj", |path, organs| MeshFormat::Obj.write(path, organs)),
    ("VTP", "m.vtp", |path, organs| MeshFormat::Vtp.write(path, organs)),
];

/// Writes a ball in every format, and the same bytes raw, all through to the disk (fsync).
pub(super) fn write(arguments: &BenchWriteArguments) -> anyhow::Result<()> {
    let folder = match &arguments.folder {
        Some(folder) => {
            atomic::make_folder(folder)?;
            tempfile::tempdir_in(folder).with_context(|| format!("{}: no room to write in", folder.display()))?
        }
        None => tempfile::tempdir()?,
    };
    let organs = [ball(arguments.triangles)];
    let triangles = organs[0].mesh.triangles.len();
    let mut rows = vec![["format", "MB", "MB/s", "raw MB/s"].map(str::to_owned).to_vec()];
    let mut formats = Vec::new();
    for (name, file, write) in ROWS {
        let path = folder.path().join(file);
        let seconds = best(|| Ok(write(&path, &organs)?))?;
        let bytes = std::fs::read(&path)?;
        let raw = best(|| Ok(atomic::write_file(&path, |out| out.write_all(&bytes))?))?;
        std::fs::remove_file(&path)?;
        let megabytes = bytes.len() as f64 * 1e-6;
        rows.push(
            [name.to_owned()]
                .into_iter()
                .chain([megabytes, megabytes / seconds, megabytes / raw].map(|number| format!("{number:.0}")))
                .collect(),
        );
        formats.push(json!({
            "format": name, "bytes": bytes.len(), "mb_per_s": megabytes / seconds, "raw_mb_per_s": megabytes / raw,
        }));
    }
    if arguments.json {
        let threads = rayon::current_num_threads();
        return out(&json!({ "triangles": triangles, "threads": threads, "formats": formats }).to_string());
    }
    let mut lines = vec![format!(
        "{triangles} triangles with every attribute, best of {RUNS}, {} threads; written through to the disk",
        rayon::current_num_threads()
    )];
    write_columns(rows, "", &mut lines);
    out(&lines.join("\n"))
}

/// Least time [s] of some runs.
fn best(mut run: impl FnMut() -> anyhow::Result<()>) -> anyhow::Result<f64> {
    let mut best = f64::INFINITY;
    for _ in 0..RUNS {
        let began = Instant::now();
        run()?;
        best = best.min(began.elapsed().as_secs_f64());
    }
    Ok(best)
}

/// A ball of latitudes and longitudes, radius 100 mm, with every attribute.
fn ball(triangles: usize) -> OrganMesh {
    let rings = ((triangles as f64 / 4.0).sqrt().round() as u32).max(2);
    let columns = 2 * rings;
    let mut mesh = TriangleMesh::default();
    for ring in 0..=rings {
        let latitude = PI * ring as f32 / rings as f32;
        for column in 0..columns {
            let longitude = TAU * column as f32 / columns as f32;
            let normal = [latitude.sin() * longitude.cos(), latitude.sin() * longitude.sin(), latitude.cos()];
            mesh.positions.push(normal.map(|part| 100.0 * part));
            mesh.normals.push(normal);
            mesh.labels.push(5);
            mesh.displacements.push(normal.map(|part| 3.0 * part));
            mesh.hu.push(60.0 + 10.0 * normal[2]);
            mesh.strains.push(0.1 * latitude);
            mesh.speeds.push(longitude);
            mesh.colors.push(normal.map(|part| 0.5 + 0.5 * part));
        }
    }
    for ring in 0..rings {
        for column in 0..columns {
            let at = |ring: u32, column: u32| ring * columns + column % columns;
            let (a, b) = (at(ring, column), at(ring, column + 1));
            let (c, d) = (at(ring + 1, column), at(ring + 1, column + 1));
            mesh.triangles.extend([[a, c, d], [a, d, b]]);
        }
    }
    OrganMesh { name: "ball".to_owned(), color: [0.5, 0.1, 0.1], finish: Finish::Wet, mesh }
}
