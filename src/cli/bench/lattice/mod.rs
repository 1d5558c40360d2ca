//! `yawara bench lattice`: steps of a lattice, as a share of what the machine can do, and in turn with another program.

mod against;
mod bodies;
mod limits;
mod scaling;

use std::time::Instant;

use anyhow::bail;
use serde_json::json;

use super::super::args::BenchLatticeArguments;
use super::super::messages::out;
use crate::dynamics::World;
use crate::kernel::dispatch::{Arithmetic, InstructionSet};
use limits::Machine;

/// What one measurement found.
struct Measured {
    particles: usize,
    particle_steps_per_s: f64,
    bytes_per_particle: f64,
    /// Mean distance from the start [m].
    mean_moved: f64,
    /// Along the longest axis [m].
    length: f64,
}

pub(super) fn lattice(arguments: &BenchLatticeArguments) -> anyhow::Result<()> {
    let BenchLatticeArguments {
        n,
        steps,
        law,
        json,
        exact,
        ref instructions,
        ref scene,
        ref against,
        pairs,
        ref scaling,
    } = *arguments;
    if !(2..=800).contains(&n) || steps == 0 || pairs == 0 {
        bail!(
            "--n is {n}, --steps {steps} and --pairs {pairs}; expected n from 2 to 800, at least one step and one pair"
        );
    }
    let set = instructions.unwrap_or_else(InstructionSet::best);
    if !set.available() {
        bail!("--instructions is {}, which this machine does not have; leave it out for the best it has", set.name());
    }
    let arithmetic = Arithmetic::new(set, exact);
    if let Some(folder) = scaling {
        return scaling::scaling(folder, law, arithmetic);
    }
    let run = || -> anyhow::Result<Measured> {
        let mut body = match scene {
            Some(path) => bodies::of_scene(path, law)?,
            None => bodies::cube(n, law)?,
        };
        body.world.set_arithmetic(arithmetic);
        measure(&mut body, steps)
    };
    if let Some(command) = against {
        return against::against(command, pairs, json, run);
    }
    let measured = run()?;
    let machine = Machine::measured(set);
    let threads = rayon::current_num_threads();
    let [arithmetic_share, memory_share] = machine.shares(&measured, law);
    let report = json!({
        "peer": concat!("yawara ", env!("CARGO_PKG_VERSION")),
        "n": n,
        "steps": steps,
        "particles": measured.particles,
        "law": law.name(),
        "threads": threads,
        "instruction_set": set.name(),
        "exact": exact,
        "particle_steps_per_s": measured.particle_steps_per_s,
        "bytes_per_particle": measured.bytes_per_particle,
        "mean_moved": measured.mean_moved,
        "lane_operations_per_s": machine.lane_operations_per_s,
        "memory_bytes_per_s": machine.memory_bytes_per_s,
        "share_of_arithmetic": arithmetic_share,
        "share_of_memory": memory_share,
    });
    if json {
        return out(&report.to_string());
    }
    out(&format!(
        "{:.1} million particle-steps/s ({} particles, law {}, {steps} steps, {threads} threads, {}{}), {:.1} bytes per \
         particle, mean moved {:.6e} m",
        measured.particle_steps_per_s * 1e-6,
        measured.particles,
        law.name(),
        set.name(),
        if exact { ", exact" } else { "" },
        measured.bytes_per_particle,
        measured.mean_moved
    ))?;
    out(&format!(
        "that is {:.0} % of the {:.0} thousand million lane operations a second and {:.0} % of the {:.1} GB/s that this \
         machine reached just now with as many threads",
        100.0 * arithmetic_share,
        machine.lane_operations_per_s * 1e-9,
        100.0 * memory_share,
        machine.memory_bytes_per_s * 1e-9
    ))
}

/// Steps a body that was stepped once before, so that its memory is there.
fn measure(body: &mut bodies::Body, steps: u32) -> anyhow::Result<Measured> {
    body.start();
    body.world.step()?;
    body.start();
    let began = Instant::now();
    for _ in 0..steps {
        body.world.step()?;
    }
    let seconds = began.elapsed().as_secs_f64();
    let world: &World = &body.world;
    let particles = world.lattice().len();
    let longest = world.lattice().grid.shape.dims().into_iter().max().unwrap_or(0);
    let moved: f64 = (0..particles as u32).map(|p| (world.displacement(p) - body.place(p)).norm()).sum();
    Ok(Measured {
        particles,
        particle_steps_per_s: particles as f64 * f64::from(steps) / seconds,
        bytes_per_particle: world.bytes_per_particle(),
        mean_moved: moved / particles as f64,
        length: longest as f64 * world.lattice().pitch,
    })
}
