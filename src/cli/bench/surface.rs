//! `yawara bench surface`: marching cubes of a plain field, with normals.

use std::fs;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, bail};
use serde_json::json;

use super::super::args::BenchSurfaceArguments;
use super::super::messages::out;
use crate::geometry::{Affine, GridShape};
use crate::surface::field_normals::GradientOf;
use crate::surface::marching_cubes;

/// Best of this many extractions is reported.
const RUNS: usize = 5;

pub(super) fn surface(arguments: &BenchSurfaceArguments) -> anyhow::Result<()> {
    let BenchSurfaceArguments { n, json, ref raw } = *arguments;
    if !(2..=1024).contains(&n) {
        bail!("--n is {n}; expected grid points along an edge from 2 to 1024");
    }
    let shape = GridShape::new(n, n, n);
    let values = raw.as_ref().map_or_else(|| Ok(bumpy_ball(shape)), |path| read_raw(path, shape))?;
    let affine = Affine::from_spacing([1.0; 3], [0.0; 3])?;
    let mut best = f64::INFINITY;
    let mut counts = (0, 0);
    for _ in 0..RUNS {
        let began = Instant::now();
        let mesh = marching_cubes(shape, &affine, &values, GradientOf::Field)?;
        best = best.min(began.elapsed().as_secs_f64());
        counts = (mesh.positions.len(), mesh.triangles.len());
    }
    let report = json!({
        "peer": concat!("yawara ", env!("CARGO_PKG_VERSION")),
        "n": n,
        "threads": rayon::current_num_threads(),
        "seconds": best,
        "voxels_per_s": shape.len() as f64 / best,
        "vertices": counts.0,
        "triangles": counts.1,
    });
    if json {
        return out(&report.to_string());
    }
    out(&format!(
        "{:.1} ms (best of {RUNS}) for {n}^3 values: {} vertices, {} triangles, with normals, {} threads",
        best * 1e3,
        counts.0,
        counts.1,
        rayon::current_num_threads()
    ))
}

/// Above zero inside a ball of radius 0.7 with bumps, over [-1, 1]^3.
fn bumpy_ball(shape: GridShape) -> Vec<f32> {
    let axis: Vec<f32> = (0..shape.nx).map(|i| (2.0 * i as f64 / (shape.nx - 1) as f64 - 1.0) as f32).collect();
    let value = |linear| {
        let [x, y, z] = shape.ijk(linear).map(|i| axis[i]);
        0.7 - (x * x + y * y + z * z).sqrt() + 0.08 * (20.0 * x).sin() * (20.0 * y).sin() * (20.0 * z).sin()
    };
    (0..shape.len()).map(value).collect()
}

/// One little-endian f32 per grid point, x fastest, and nothing else.
fn read_raw(path: &Path, shape: GridShape) -> anyhow::Result<Vec<f32>> {
    let expected = 4 * shape.len() as u64;
    let found = fs::metadata(path).with_context(|| format!("{}: could not read values", path.display()))?.len();
    if found != expected {
        bail!(
            "{}: {found} bytes, but --n {} needs {expected} ({shape} values of 4 bytes); give the --n of the file",
            path.display(),
            shape.nx
        );
    }
    let bytes = fs::read(path).with_context(|| format!("{}: could not read values", path.display()))?;
    Ok(bytes.as_chunks::<4>().0.iter().map(|&value| f32::from_le_bytes(value)).collect())
}
