//! The cells' volume term: fast body against reference, force against energy, and what must not change.

#[path = "../support/mod.rs"]
mod support;

mod mechanics;
mod same_numbers;

use support::*;
use yawara::dynamics::World;
use yawara::dynamics::stable_dt::stable_dt;
use yawara::geometry::Vector3;
use yawara::kernel::reference::{spring_forces, volume_forces};
use yawara::lattice::build::OrganMap;
use yawara::lattice::{Lattice, Topology};
use yawara::material::tissue::{Damping, TissueBody};
use yawara::material::{Assembly, SpringConstants, VolumeTerm};

/// Volume modulus over Young's modulus of cells with Poisson's ratios of about 0.49 and 0.
const STIFF: f64 = 16.0;
const NEGATIVE: f64 = -0.4;

/// Value of the cell above each particle.
fn cells(constants: &SpringConstants) -> &[f32] {
    let SpringConstants::SumOfCells { cell, .. } = constants else { panic!("springs by cells") };
    cell
}

/// Tissue whose cells have a volume modulus of `factor` times their Young's modulus, and a volume viscosity of `viscous`
/// times that of the springs.
fn with_volume(
    map: &OrganMap,
    bodies: &[Option<TissueBody>],
    factor: f64,
    viscous: Option<f64>,
) -> (Lattice, Assembly) {
    let (lattice, mut assembly) = tissue_lattice(map, bodies);
    let times = |values: &[f32], factor: f64| values.iter().map(|&v| (factor * f64::from(v)) as f32).collect();
    assembly.volume = Some(VolumeTerm {
        modulus: times(cells(&assembly.stiffness), factor),
        viscosity: viscous.map(|f| times(cells(assembly.damping.as_ref().expect("damped springs")), f)),
    });
    (lattice, assembly)
}

/// A world with a step that is stable with the volume term too.
///
/// A cell adds at most `8 L h^3 |g|^2 = 3/2 L h` to a corner, eight of them `12 L h`; the springs' sum is about `9 E h`.
fn steady((lattice, assembly): (Lattice, Assembly)) -> World {
    let bound = stable_dt(&lattice, &Topology::new(&lattice), &assembly);
    World::new(lattice, assembly, 0.12 * bound)
}

fn damped(ratio: f64) -> TissueBody {
    TissueBody { damping: Damping::Ratio(ratio), ..TISSUE }
}

/// Forces of springs and cells in f64 at a world's present state.
fn reference_forces(world: &World) -> (Vec<Vector3>, Vec<Vector3>) {
    let (u, v) = (displacements(world), velocities(world));
    let (lattice, topology, assembly) = (world.lattice(), world.topology(), world.assembly());
    (
        spring_forces(lattice, topology, assembly, &u, &v, world.dt()),
        volume_forces(lattice, topology, assembly, &u, &v, world.dt()),
    )
}

fn largest(forces: &[Vector3]) -> f64 {
    forces.iter().map(Vector3::norm).fold(0.0, f64::max)
}
