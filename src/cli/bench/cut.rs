//! `yawara bench cut`: a fine surface extracted again and again while a blade goes through it.

use std::time::Instant;

use serde_json::json;

use super::super::args::BenchCutArguments;
use super::super::messages::out;
use super::carry::ball_on_lattice;
use crate::cut::Blade;
use crate::dynamics::World;
use crate::geometry::{Point3, Vector3};
use crate::material::tissue::{Damping, TissueBody, assemble};
use crate::surface::fine::{FineSurface, Memory};

/// Moments of the cut at which the surface is extracted.
const MOMENTS: u32 = 20;
/// Soft tissue; nothing moves here, so it only fills the lattice.
const TISSUE: TissueBody =
    TissueBody { youngs_modulus: 5e3, poissons_ratio: 0.25, density: 1000.0, damping: Damping::Ratio(0.0) };

pub(super) fn cut(arguments: &BenchCutArguments) -> anyhow::Result<()> {
    let BenchCutArguments { n, json } = *arguments;
    let (body, lattice) = ball_on_lattice(n)?;
    let assembly = assemble(&lattice, &[Some(TISSUE)]);
    let mut world = World::new(lattice, assembly, 1e-4);
    // Upright, a little aslant, from one side to the middle of the grid.
    let side = n as f64 * 1e-3;
    let edge = vec![Point3::new(0.47, -0.1, -0.1) * side, Point3::new(0.52, -0.1, 1.1) * side];
    let blade = Blade::new(edge, &[Vector3::zeros(), Vector3::new(0.03, 0.6, 0.0) * side]);
    let mut memory = Memory::default();
    let mut seconds = [Vec::new(), Vec::new()];
    let mut vertices = [0; 2];
    for moment in 0..=MOMENTS {
        if moment > 0 {
            let [from, to] = [moment - 1, moment].map(|at| blade.path_length() * f64::from(at) / f64::from(MOMENTS));
            world.cut(&blade.sweep(from, to));
        }
        let mut timed = |which: usize, memory: &mut Memory| -> anyhow::Result<FineSurface> {
            let began = Instant::now();
            let (lattice, topology, sheet) = (world.lattice(), world.topology(), world.cut_sheet());
            let surface = FineSurface::extract_after(&body, lattice, topology, sheet, None, memory)?;
            seconds[which].push(began.elapsed().as_secs_f64());
            Ok(surface)
        };
        timed(0, &mut Memory::default())?;
        let surface = timed(1, &mut memory)?;
        vertices = [surface.vertex_count(), surface.on_seam().filter(|seam| *seam).count()];
    }
    let mean = |seconds: &[f64]| seconds.iter().sum::<f64>() / seconds.len() as f64;
    // The first is of the whole ball, either way.
    let [at_once, after] = [0, 1].map(|which| mean(&seconds[which][1..]));
    if json {
        let report = json!({
            "n": n, "threads": rayon::current_num_threads(), "moments": MOMENTS,
            "vertices": vertices[0], "vertices_on_cut": vertices[1],
            "uncut_s": seconds[0][0], "at_once_s": at_once, "after_s": after,
        });
        return out(&report.to_string());
    }
    out(&format!(
        "{:.0} ms after a further cut, {:.0} ms at once, {:.0} ms uncut (mean of {MOMENTS} moments; {} vertices, at the end {} on the \
         cut; {} threads)",
        after * 1e3,
        at_once * 1e3,
        seconds[0][0] * 1e3,
        vertices[0],
        vertices[1],
        rayon::current_num_threads()
    ))
}
