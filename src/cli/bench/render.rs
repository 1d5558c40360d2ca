//! `yawara bench render`: a picture of a ball of many triangles.

use std::time::Instant;

use anyhow::bail;
use serde_json::json;

use super::super::args::BenchRenderArguments;
use super::super::messages::out;
use crate::io::png::write_png_rgba;
use crate::render::camera::{Direction, Framing, Lens};
use crate::render::normals::creased;
use crate::render::{Look, render as draw};
use crate::surface::mesh::{Finish, OrganMesh, TriangleMesh};

/// Best of this many pictures is reported.
const RUNS: usize = 5;

pub(super) fn render(arguments: &BenchRenderArguments) -> anyhow::Result<()> {
    let BenchRenderArguments { triangles, size, ref output, json } = *arguments;
    if !(1000..=20_000_000).contains(&triangles) {
        bail!("--triangles is {triangles}; expected 1000 to 20000000");
    }
    // Twice as many columns as rows, two triangles in each of their cells.
    let rows = (triangles as f64 / 4.0).sqrt().round() as u32;
    // Smooth all over.
    let mesh = creased(&bumpy_ball(rows, 2 * rows), 180.0);
    let found = mesh.triangles.len();
    let organ = OrganMesh { name: "ball".to_owned(), color: [0.26, 0.044, 0.027], finish: Finish::Wet, mesh };
    let organs = [organ];
    let mut framing = Framing::new(Direction::THREE_QUARTER, size)?;
    framing.include(&organs);
    let camera = framing.camera(&Lens::default())?;
    let mut best = f64::INFINITY;
    let mut picture = None;
    for _ in 0..RUNS {
        let began = Instant::now();
        picture = Some(draw(&organs, &camera, &Look::default())?);
        best = best.min(began.elapsed().as_secs_f64());
    }
    if let (Some(path), Some(picture)) = (output, picture) {
        write_png_rgba(path, picture)?;
    }
    let [width, height] = size;
    let report = json!({
        "peer": concat!("yawara ", env!("CARGO_PKG_VERSION")),
        "triangles": found,
        "width": width,
        "height": height,
        "threads": rayon::current_num_threads(),
        "seconds": best,
        "triangles_per_s": found as f64 / best,
    });
    if json {
        return out(&report.to_string());
    }
    out(&format!(
        "{:.1} ms (best of {RUNS}) for {found} triangles on {width} x {height} pixels, {} threads",
        best * 1e3,
        rayon::current_num_threads()
    ))
}

/// A ball with bumps, of rows from pole to pole; about 100 mm wide.
fn bumpy_ball(rows: u32, columns: u32) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    for row in 0..=rows {
        for column in 0..columns {
            let polar = std::f64::consts::PI * f64::from(row) / f64::from(rows);
            let around = std::f64::consts::TAU * f64::from(column) / f64::from(columns);
            let [x, y, z] = [polar.sin() * around.cos(), polar.sin() * around.sin(), polar.cos()];
            let radius = 45.0 * (1.0 + 0.09 * (9.0 * x).sin() * (9.0 * y).sin() * (9.0 * z).sin());
            mesh.positions.push([x, y, z].map(|along| (radius * along) as f32));
        }
    }
    let at = |row: u32, column: u32| row * columns + column % columns;
    for row in 0..rows {
        for column in 0..columns {
            let (a, b) = (at(row, column), at(row, column + 1));
            let (c, d) = (at(row + 1, column), at(row + 1, column + 1));
            mesh.triangles.extend([[a, c, d], [a, d, b]]);
        }
    }
    mesh
}
