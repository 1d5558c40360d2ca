//! `yawara bench`: speed of the parts that matter.

use std::fs;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, bail};
use serde_json::json;

use super::args::{BenchCareArguments, BenchCommand, BenchLatticeArguments, BenchSurfaceArguments};
use super::exit::Outcome;
use super::messages::out;
use crate::dynamics::World;
use crate::geometry::{Affine, Grid, GridShape, Vector3};
use crate::kernel::dispatch::instruction_set;
use crate::lattice::build::build;
use crate::material::paper::{PaperBody, assemble};
use crate::surface::care::{Care, RestMesh};
use crate::surface::check::{MeshReport, check};
use crate::surface::field_normals::GradientOf;
use crate::surface::marching_cubes;
use crate::surface::mesh::TriangleMesh;
use crate::volume::Volume;

/// Best of this many extractions is reported.
const SURFACE_RUNS: usize = 5;

pub(super) fn bench(command: &BenchCommand) -> anyhow::Result<Outcome> {
    match command {
        BenchCommand::Lattice(arguments) => lattice(arguments),
        BenchCommand::Surface(arguments) => surface(arguments),
        BenchCommand::Care(arguments) => care(arguments),
    }?;
    Ok(Outcome::Done)
}

/// A cube of n^3 particles: mass 1 kg, spacing 1 m, stiffness 10 N/m, stretched by 0.1 % along x, dt 0.01 s.
fn lattice(arguments: &BenchLatticeArguments) -> anyhow::Result<()> {
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

fn surface(arguments: &BenchSurfaceArguments) -> anyhow::Result<()> {
    let BenchSurfaceArguments { n, json, ref raw } = *arguments;
    if !(2..=1024).contains(&n) {
        bail!("--n is {n}; expected grid points along an edge from 2 to 1024");
    }
    let shape = GridShape::new(n, n, n);
    let values = raw.as_ref().map_or_else(|| Ok(bumpy_ball(shape)), |path| read_raw(path, shape))?;
    let affine = Affine::from_spacing([1.0; 3], [0.0; 3])?;
    let mut best = f64::INFINITY;
    let mut counts = (0, 0);
    for _ in 0..SURFACE_RUNS {
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
        "{:.1} ms (best of {SURFACE_RUNS}) for {n}^3 values: {} vertices, {} triangles, with normals, {} threads",
        best * 1e3,
        counts.0,
        counts.1,
        rayon::current_num_threads()
    ))
}

fn care(arguments: &BenchCareArguments) -> anyhow::Result<()> {
    let BenchCareArguments { n, percent, tidy, max_error, json } = *arguments;
    if !(2..=1024).contains(&n) || !(1..=100).contains(&percent) {
        bail!("--n is {n} and --percent {percent}; expected n from 2 to 1024 and a percentage from 1 to 100");
    }
    let shape = GridShape::new(n, n, n);
    let affine = Affine::from_spacing([1.0; 3], [0.0; 3])?;
    let given = marching_cubes(shape, &affine, &bumpy_ball(shape), GradientOf::Field)?;
    let places: Vec<[f64; 3]> = given.positions.iter().map(|place| place.map(f64::from)).collect();
    let rest = RestMesh { positions: &places, triangles: &given.triangles, sheets: &[], organs: &[] };
    let triangles = Some(given.triangles.len() * percent / 100);
    let began = Instant::now();
    let cared = Care { spacing_mm: 1.0, tidy, triangles, max_error_mm: max_error }.apply(rest)?;
    let seconds = began.elapsed().as_secs_f64();
    let positions = cared.positions.iter().map(|place| place.map(|c| c as f32)).collect();
    let left = TriangleMesh { positions, triangles: cared.triangles, ..TriangleMesh::default() };
    let [before, after]: [MeshReport; 2] = [&given, &left].map(check);
    let change = after.volume_mm3 / before.volume_mm3 - 1.0;
    if json {
        let report = json!({
            "peer": concat!("yawara ", env!("CARGO_PKG_VERSION")),
            "n": n,
            "threads": rayon::current_num_threads(),
            "seconds": seconds,
            "triangles": before.triangles,
            "triangles_left": after.triangles,
            "volume_change": change,
            "min_angle_deg": after.min_angle_deg,
            "passed": after.passes(),
        });
        return out(&report.to_string());
    }
    out(&format!(
        "{seconds:.2} s from {} to {} triangles, volume {:+.4} %\n{after}",
        before.triangles,
        after.triangles,
        100.0 * change
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
