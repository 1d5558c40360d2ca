//! `yawara bench lattice`: steps of a full cube of particles.

use std::time::Instant;

use anyhow::bail;
use serde_json::json;

use super::super::args::BenchLatticeArguments;
use super::super::messages::out;
use crate::dynamics::World;
use crate::geometry::{Affine, Grid, GridShape, Vector3};
use crate::kernel::dispatch::instruction_set;
use crate::lattice::build::build;
use crate::material::paper::{PaperBody, assemble};
use crate::volume::Volume;

/// A cube of n^3 particles: mass 1 kg, spacing 1 m, stiffness 10 N/m, stretched by 0.1 % along x, dt 0.01 s.
pub(super) fn lattice(arguments: &BenchLatticeArguments) -> anyhow::Result<()> {
    let BenchLatticeArguments { n, steps, json } = *arguments;
    if !(2..=800).contains(&n) || steps == 0 {
        bail!("--n is {n} and --steps {steps}; expected n from 2 to 800 and at least one step");
    }
    let mut world = {
        let affine = Affine::from_spacing([1e3; 3], [0.0; 3])?;
        let organs = Volume::from_vec(Grid { shape: GridShape::new(n, n, n), affine }, vec![0_u8; n * n * n]);
        let lattice = build(&organs)?;
        let assembly = assemble(&lattice, &[Some(PaperBody { stiffness: 10.0, damping: 0.0, mass: 1.0 })]);
        World::new(lattice, assembly, 0.01)
    };
    let particles = world.lattice().len() as u32;
    let start = |world: &World, particle: u32| {
        // The lattice keeps one empty layer around its particles.
        Vector3::new(1e-3 * (world.lattice().ijk(particle)[0] as f64 - 1.0), 0.0, 0.0)
    };
    let stretch = |world: &mut World| {
        for particle in 0..particles {
            let place = start(world, particle);
            world.set_displacement(particle, place);
            world.set_velocity(particle, Vector3::zeros());
        }
    };
    stretch(&mut world);
    world.step()?;
    stretch(&mut world);
    let began = Instant::now();
    for _ in 0..steps {
        world.step()?;
    }
    let seconds = began.elapsed().as_secs_f64();
    let moved: f64 = (0..particles).map(|p| (world.displacement(p) - start(&world, p)).norm()).sum();
    let rate = f64::from(particles) * f64::from(steps) / seconds;
    let report = json!({
        "peer": concat!("yawara ", env!("CARGO_PKG_VERSION")),
        "n": n,
        "steps": steps,
        "threads": rayon::current_num_threads(),
        "instruction_set": instruction_set(),
        "particle_steps_per_s": rate,
        "bytes_per_particle": world.bytes_per_particle(),
        "mean_moved": moved / f64::from(particles),
    });
    if json {
        return out(&report.to_string());
    }
    out(&format!(
        "{:.1} million particle-steps/s ({n}^3 particles, {steps} steps, {} threads, {}), {:.1} bytes per particle, mean moved {:.6e} m",
        rate * 1e-6,
        rayon::current_num_threads(),
        instruction_set(),
        world.bytes_per_particle(),
        moved / f64::from(particles)
    ))
}
