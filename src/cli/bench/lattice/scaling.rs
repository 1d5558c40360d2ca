//! Cost per particle-step over size and threads, measured, written and plotted.

use std::path::Path;

use anyhow::Context;

use super::super::super::args::BenchLaw;
use super::super::super::messages::out;
use super::{bodies, measure};
use crate::kernel::dispatch::Arithmetic;
use crate::plot::{Axis, Plot, Series, Stroke};

/// Edges of the cubes: from 1e5 to 5e7 particles.
const EDGES: [usize; 7] = [46, 64, 92, 128, 184, 256, 368];
/// Particle-steps of one measurement, about.
const WORK: f64 = 6e7;
/// Best of this many is plotted; sizes and threads take turns.
const ROUNDS: usize = 3;

pub(super) fn scaling(folder: &Path, law: BenchLaw, arithmetic: Arithmetic) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder)
        .with_context(|| format!("{}: the folder could not be made; check the path", folder.display()))?;
    let most = rayon::current_num_threads();
    let threads: Vec<usize> = if most == 1 { vec![1] } else { vec![1, most] };
    let pools = threads
        .iter()
        .map(|&threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build())
        .collect::<Result<Vec<_>, _>>()?;
    let mut best = vec![[f64::INFINITY; EDGES.len()]; threads.len()];
    for (place, &n) in EDGES.iter().enumerate() {
        let mut body = bodies::cube(n, law)?;
        body.world.set_arithmetic(arithmetic);
        let steps = (WORK / (n * n * n) as f64).ceil().max(2.0) as u32;
        for _ in 0..ROUNDS {
            for (pool, best) in pools.iter().zip(&mut best) {
                let measured = pool.install(|| measure(&mut body, steps))?;
                best[place] = best[place].min(1e9 / measured.particle_steps_per_s);
            }
        }
        let times: Vec<String> = threads
            .iter()
            .zip(&best)
            .map(|(threads, best)| {
                format!("{:.2} ns with {threads} thread{}", best[place], if *threads == 1 { "" } else { "s" })
            })
            .collect();
        out(&format!("{:>9} particles: {} per particle-step", n * n * n, times.join(", ")))?;
    }
    let series = threads
        .iter()
        .zip(&best)
        .map(|(threads, best)| Series {
            name: format!("{threads} thread{}", if *threads == 1 { "" } else { "s" }),
            points: EDGES.iter().zip(best).map(|(&n, &time)| [(n * n * n) as f64, time]).collect(),
            stroke: Stroke::Marked,
        })
        .collect();
    let plot = Plot {
        title: format!("cost of a particle-step, law {}, {}", law.name(), arithmetic.set().name()),
        x: Axis::logarithmic("particles", ""),
        y: Axis::linear("time per particle-step", "ns"),
        series,
    };
    let png = folder.join("scaling.png");
    plot.write_png(&png)?;
    plot.write_csv(&folder.join("scaling.csv"))?;
    out(&format!("wrote {} and scaling.csv beside it", png.display()))
}
