//! `yawara bench carry`: a fine surface moved by a coarser lattice.

use std::time::Instant;

use anyhow::bail;
use serde_json::json;

use super::super::args::BenchCarryArguments;
use super::super::messages::out;
use super::surface::bumpy_ball;
use crate::cut::CutSheet;
use crate::geometry::{Affine, Grid, GridShape};
use crate::lattice::cells::build_cells;
use crate::lattice::{Lattice, Topology};
use crate::surface::fine::{Body, FineSurface};
use crate::volume::Volume;

/// Frames that are timed; the best is reported.
const RUNS: usize = 9;
/// Spacing of the lattice in spacings of the surface.
const RATIO: usize = 3;

pub(super) fn carry(arguments: &BenchCarryArguments) -> anyhow::Result<()> {
    let BenchCarryArguments { n, json } = *arguments;
    let (body, lattice) = ball_on_lattice(n)?;
    let surface = FineSurface::extract(&body, &lattice, &Topology::new(&lattice), &CutSheet::default())?;
    let bend = |particle: u32| {
        let place = lattice.rest_place(particle) / n as f64;
        [0.1 * place.y * place.y, 0.05 * place.x, 0.1 * (3.0 * place.x).sin()].map(|c| (n as f64 * c) as f32)
    };
    let displacements: Vec<[f32; 3]> = (0..lattice.len() as u32).map(bend).collect();
    let mut mesh = surface.carry(&lattice, &displacements);
    let mut best = f64::INFINITY;
    for _ in 0..RUNS {
        let began = Instant::now();
        surface.carry_into(&lattice, &displacements, &mut mesh);
        best = best.min(began.elapsed().as_secs_f64());
    }
    let vertices = surface.vertex_count();
    let report = json!({
        "peer": concat!("yawara ", env!("CARGO_PKG_VERSION")),
        "n": n,
        "threads": rayon::current_num_threads(),
        "seconds": best,
        "vertices": vertices,
        "particles": lattice.len(),
        "vertices_per_s": vertices as f64 / best,
    });
    if json {
        return out(&report.to_string());
    }
    out(&format!(
        "{:.1} million vertices/s ({vertices} vertices with normals in {:.2} ms, best of {RUNS}; {} particles, {} threads)",
        vertices as f64 / best * 1e-6,
        best * 1e3,
        lattice.len(),
        rayon::current_num_threads()
    ))
}

/// A ball of `n` points [mm] across its grid, and a lattice that fills the grid with cells of three times its spacing.
pub(super) fn ball_on_lattice(n: usize) -> anyhow::Result<(Body, Lattice)> {
    if !(8..=1024).contains(&n) {
        bail!("--n is {n}; expected grid points along an edge from 8 to 1024");
    }
    let grid = |count: usize, spacing: f64| -> anyhow::Result<Grid> {
        // Both grids begin at the same corner: cells are centred on their index.
        let first = [0.5 * spacing; 3];
        Ok(Grid { shape: GridShape::new(count, count, count), affine: Affine::from_spacing([spacing; 3], first)? })
    };
    let fine = grid(n, 1.0)?;
    let body = Body::new(fine, bumpy_ball(fine.shape))?;
    let coarse = grid(n.div_ceil(RATIO), RATIO as f64)?;
    let lattice = build_cells(&Volume::from_vec(coarse, vec![0; coarse.shape.len()]), None)?;
    Ok((body, lattice))
}
