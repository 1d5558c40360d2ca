//! Small lattices for the tests.
#![allow(dead_code, unreachable_pub)]

mod random;

pub use random::Random;
use yawara::dynamics::World;
use yawara::dynamics::stable_dt::{SAFETY, stable_dt};
use yawara::geometry::{Affine, Grid, GridShape, Vector3};
use yawara::lattice::build::{NO_ORGAN, OrganMap, build};
use yawara::lattice::cells::build_cells;
use yawara::lattice::{Lattice, Topology};
use yawara::material::paper::PaperBody;
use yawara::material::tissue::{Damping, TissueBody};
use yawara::material::{Assembly, paper, tissue};
use yawara::volume::Volume;

/// Spring constants of the order of soft tissue at 3 mm.
pub const PAPER: PaperBody = PaperBody { stiffness: 10.0, damping: 0.0, mass: 3e-5 };
/// Soft tissue without damping.
pub const TISSUE: TissueBody =
    TissueBody { youngs_modulus: 5e3, poissons_ratio: 0.25, density: 1000.0, damping: Damping::Ratio(0.0) };

/// An organ map on 3 mm cubes; `organ` gives the organ of each (i, j, k).
pub fn organ_map(dims: [usize; 3], organ: impl Fn([usize; 3]) -> u8) -> OrganMap {
    let shape = GridShape::new(dims[0], dims[1], dims[2]);
    let grid = Grid { shape, affine: Affine::from_spacing([3.0; 3], [-10.0, 5.0, 20.0]).unwrap() };
    Volume::from_vec(grid, (0..shape.len()).map(|linear| organ(shape.ijk(linear))).collect())
}

/// A full block of voxels of one organ, placed by any affine with cubic voxels.
pub fn block_placed(affine: Affine, dims: [usize; 3]) -> OrganMap {
    let shape = GridShape::new(dims[0], dims[1], dims[2]);
    Volume::from_vec(Grid { shape, affine }, vec![0; shape.len()])
}

/// A full block of voxels of one organ.
pub fn block(dims: [usize; 3]) -> OrganMap {
    organ_map(dims, |_| 0)
}

/// A random blob: about `fill` of the voxels, of two organs.
pub fn blob(dims: [usize; 3], fill: f64, seed: u64) -> OrganMap {
    let mut random = Random::new(seed);
    let shape = GridShape::new(dims[0], dims[1], dims[2]);
    let voxels: Vec<u8> =
        (0..shape.len()).map(|_| if random.unit() < fill { u8::from(random.unit() < 0.3) } else { NO_ORGAN }).collect();
    organ_map(dims, |ijk| voxels[shape.linear(ijk)])
}

pub fn paper_lattice(map: &OrganMap, bodies: &[Option<PaperBody>]) -> (Lattice, Assembly) {
    let lattice = build(map).unwrap();
    let assembly = paper::assemble(&lattice, bodies);
    (lattice, assembly)
}

pub fn tissue_lattice(map: &OrganMap, bodies: &[Option<TissueBody>]) -> (Lattice, Assembly) {
    let lattice = build_cells(map, None).unwrap();
    let assembly = tissue::assemble(&lattice, bodies);
    (lattice, assembly)
}

/// A world with the step the program would choose.
pub fn world((lattice, assembly): (Lattice, Assembly)) -> World {
    let dt = SAFETY * stable_dt(&lattice, &Topology::new(&lattice), &assembly);
    World::new(lattice, assembly, dt)
}

/// All particle numbers of a world.
pub fn particles(world: &World) -> Vec<u32> {
    (0..world.lattice().len() as u32).collect()
}

/// Gives every particle a random displacement (in pitches) and velocity (in m/s).
pub fn shake(world: &mut World, displacement: f64, speed: f64, seed: u64) {
    let mut random = Random::new(seed);
    let h = world.lattice().pitch;
    for particle in particles(world) {
        world.set_displacement(particle, random.vector() * displacement * h);
        world.set_velocity(particle, random.vector() * speed);
    }
}

/// Displacements of all particles, lattice axes [m].
pub fn displacements(world: &World) -> Vec<Vector3> {
    particles(world).into_iter().map(|p| world.displacement(p)).collect()
}

/// Velocities of all particles, lattice axes [m/s].
pub fn velocities(world: &World) -> Vec<Vector3> {
    particles(world).into_iter().map(|p| world.velocity(p)).collect()
}

/// Present places of all particles, lattice axes [m].
pub fn places(world: &World) -> Vec<Vector3> {
    rest_places(world).iter().zip(displacements(world)).map(|(rest, u)| rest + u).collect()
}

/// Rest places of all particles, lattice axes [m].
pub fn rest_places(world: &World) -> Vec<Vector3> {
    let lattice = world.lattice();
    particles(world).into_iter().map(|p| Vector3::from(lattice.ijk(p).map(|n| n as f64)) * lattice.pitch).collect()
}
