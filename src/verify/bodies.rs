//! Small lattices for the cases, and stepping them as a scene is stepped.

use crate::dynamics::reference_world::{ReferenceWorld, step_energy};
use crate::dynamics::stable_dt::{Limits, SAFETY};
use crate::dynamics::step_control::{Interval, StepControl};
use crate::dynamics::{StepError, World};
use crate::geometry::{Affine, Grid, GridShape, Vector3};
use crate::lattice::build::{NO_ORGAN, OrganMap, build};
use crate::lattice::cells::build_cells;
use crate::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS};
use crate::lattice::{Lattice, SeveredSpring, Topology};
use crate::material::Assembly;
use crate::material::paper::{self, PaperBody};
use crate::material::tissue::{self, Damping, TissueBody};
use crate::splitmix::SplitMix;
use crate::volume::Volume;

/// Planned steps after which the guard plans again, as between two frames.
const STEPS_PER_FRAME: u64 = 10;

/// What a body is made of, of the order of soft tissue.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Model {
    /// One particle per voxel, equal springs.
    Paper,
    /// One cell per voxel, with a Poisson's ratio.
    Tissue(f64),
}

/// Both models, tissue without and with a volume term.
pub(super) const MODELS: [Model; 3] = [Model::Paper, Model::Tissue(0.25), Model::Tissue(0.45)];
/// And with a negative one.
pub(super) const ALL_MODELS: [Model; 4] = [Model::Tissue(0.0), MODELS[0], MODELS[1], MODELS[2]];
/// Pitches [mm] with voxels along each edge.
pub(super) const SIZES: [(f64, usize); 3] = [(1.5, 5), (3.0, 4), (6.0, 3)];

impl std::fmt::Display for Model {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Paper => f.write_str("paper"),
            Self::Tissue(nu) => write!(f, "tissue of Poisson's ratio {nu}"),
        }
    }
}

/// How one organ differs from the usual.
#[derive(Debug, Clone, Copy)]
pub(super) struct Organ {
    /// Times the usual stiffness.
    pub(super) stiffness: f64,
    /// Times the usual mass.
    pub(super) mass: f64,
    /// Damping ratio.
    pub(super) damping: f64,
}

/// The usual organ, with a damping ratio.
pub(super) fn organ(damping: f64) -> Organ {
    Organ { stiffness: 1.0, mass: 1.0, damping }
}

/// An organ map of cubic voxels; `organ` gives the organ of each (i, j, k).
pub(super) fn organ_map(affine: Affine, dims: [usize; 3], organ: impl Fn([usize; 3]) -> u8) -> OrganMap {
    let shape = GridShape::new(dims[0], dims[1], dims[2]);
    Volume::from_vec(Grid { shape, affine }, (0..shape.len()).map(|linear| organ(shape.ijk(linear))).collect())
}

/// Cubic voxels near the origin; `pitch` [mm].
pub(super) fn near_origin(pitch: f64) -> Affine {
    Affine::from_spacing([pitch; 3], [-10.0, 5.0, 20.0]).expect("a positive pitch")
}

/// A full block of one organ; `pitch` [mm].
pub(super) fn block(pitch: f64, dims: [usize; 3]) -> OrganMap {
    organ_map(near_origin(pitch), dims, |_| 0)
}

/// A random blob: about `fill` of the voxels, of two organs.
pub(super) fn blob(pitch: f64, dims: [usize; 3], fill: f64, random: &mut Random) -> OrganMap {
    let shape = GridShape::new(dims[0], dims[1], dims[2]);
    let mut voxels: Vec<u8> =
        (0..shape.len()).map(|_| if random.unit() < fill { u8::from(random.unit() < 0.3) } else { NO_ORGAN }).collect();
    voxels[0] = 0;
    organ_map(near_origin(pitch), dims, |ijk| voxels[shape.linear(ijk)])
}

/// The lattice of a map: springs of 10 N/m and 30 mg at every pitch, or 5 kPa and 1000 kg/m^3.
pub(super) fn lattice(model: Model, map: &OrganMap, organs: &[Organ]) -> (Lattice, Assembly) {
    match model {
        Model::Paper => {
            let body = |organ: &Organ| {
                let (stiffness, mass) = (10.0 * organ.stiffness, 3e-5 * organ.mass);
                Some(PaperBody { stiffness, damping: 2.0 * organ.damping * (stiffness * mass).sqrt(), mass })
            };
            let lattice = build(map).expect("voxels that are cubes");
            let assembly = paper::assemble(&lattice, &organs.iter().map(body).collect::<Vec<_>>());
            (lattice, assembly)
        }
        Model::Tissue(poissons_ratio) => {
            let body = |organ: &Organ| {
                Some(TissueBody {
                    youngs_modulus: 5e3 * organ.stiffness,
                    poissons_ratio,
                    density: 1e3 * organ.mass,
                    damping: Damping::Ratio(organ.damping),
                })
            };
            let lattice = build_cells(map, None).expect("voxels that are cubes");
            let assembly = tissue::assemble(&lattice, &organs.iter().map(body).collect::<Vec<_>>());
            (lattice, assembly)
        }
    }
}

/// A block of the usual organ.
pub(super) fn block_of(model: Model, pitch: f64, dims: [usize; 3], damping: f64) -> (Lattice, Assembly) {
    lattice(model, &block(pitch, dims), &[organ(damping)])
}

/// A world with the step that a scene would get, and what is known of its stability.
#[derive(Clone)]
pub(super) struct Trial {
    pub(super) world: World,
    pub(super) limits: Limits,
    /// Steps taken, divided ones counted one by one.
    pub(super) steps: u64,
}

impl Trial {
    /// At rest. Without springs, nothing limits the step: then it is 1 ms.
    pub(super) fn new((lattice, assembly): (Lattice, Assembly)) -> Self {
        let topology = Topology::new(&lattice);
        let limits = Limits::at_rest(&lattice, &topology, &assembly).sharpen(&lattice, &topology, &assembly, 1e5);
        let dt = if limits.sharp.is_finite() { SAFETY * limits.sharp } else { 1e-3 };
        Self { world: World::new(lattice, assembly, dt), limits, steps: 0 }
    }

    /// Steps through a number of frames of ten planned steps, divided where the guard asks for it; `each` acts before every
    /// step.
    pub(super) fn run(&mut self, frames: u64, mut each: impl FnMut(&mut World)) -> Result<(), StepError> {
        let world = &mut self.world;
        let mut control = StepControl::new(world, self.limits);
        let (dt, start) = (world.dt(), world.time());
        for frame in 1..=frames {
            let until = start + (STEPS_PER_FRAME * frame) as f64 * dt;
            let mut interval = Interval::new(until, dt, STEPS_PER_FRAME);
            while control.plan(world, &mut interval)? {
                each(world);
                self.steps += 1;
                world.step()?;
                control.stepped(world, &mut interval);
            }
        }
        world.set_dt(dt);
        Ok(())
    }

    /// The same together with its twin in f64, as [`Trial::run`] divides the steps; returns the largest distance of a
    /// particle from its twin over these frames [pitches].
    pub(super) fn run_with_twin(&mut self, frames: u64) -> Result<f64, StepError> {
        let mut twin = ReferenceWorld::of(&self.world);
        let mut apart = 0.0_f64;
        let mut failed = None;
        self.run(frames, |world| {
            apart = apart.max(distance(world, &twin));
            twin.set_dt(world.dt());
            failed = failed.take().or(twin.step().err());
        })?;
        match failed {
            Some(error) => Err(error),
            None => Ok(apart.max(distance(&self.world, &twin))),
        }
    }

    /// Places particles: from number and rest place [m] to the new place [m].
    pub(super) fn place(&mut self, place: impl Fn(u32, Vector3) -> Vector3) {
        for p in particles(&self.world) {
            let rest = rest_place(&self.world, p);
            self.world.set_displacement(p, place(p, rest) - rest);
        }
    }
}

/// The largest distance of a particle from its twin [pitches]; infinite when one is not a number.
pub(super) fn distance(world: &World, twin: &ReferenceWorld) -> f64 {
    let apart = |p: u32| (world.displacement(p) - twin.displacement()[p as usize]).norm() / world.lattice().pitch;
    largest(particles(world).into_iter().map(apart))
}

/// The largest of some numbers; infinite as soon as one is none.
pub(super) fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(0.0, |a, b| if b.is_nan() { f64::INFINITY } else { a.max(b) })
}

/// All particle numbers.
pub(super) fn particles(world: &World) -> Vec<u32> {
    (0..world.lattice().len() as u32).collect()
}

/// Rest place of a particle, lattice axes [m].
pub(super) fn rest_place(world: &World, particle: u32) -> Vector3 {
    Vector3::from(world.lattice().ijk(particle).map(|n| n as f64)) * world.lattice().pitch
}

/// The middle of all rest places [m].
pub(super) fn centre(world: &World) -> Vector3 {
    particles(world).into_iter().map(|p| rest_place(world, p)).sum::<Vector3>() / world.lattice().len() as f64
}

/// True when every place is finite.
pub(super) fn is_finite(world: &World) -> bool {
    world.displacements_mm().iter().flatten().all(|x| x.is_finite())
}

/// The energy that the scheme keeps, see [`step_energy`] [J].
pub(super) fn energy(world: &World) -> f64 {
    let (displacement, velocity) = state(world);
    step_energy(world.lattice(), world.topology(), world.assembly(), &displacement, &velocity, world.dt())
}

/// Displacements [m] and velocities [m/s], lattice axes.
pub(super) fn state(world: &World) -> (Vec<Vector3>, Vec<Vector3>) {
    particles(world).into_iter().map(|p| (world.displacement(p), world.velocity(p))).unzip()
}

/// Gives every particle a random displacement (in pitches) and velocity (in m/s).
pub(super) fn shake(world: &mut World, displacement: f64, speed: f64, random: &mut Random) {
    let h = world.lattice().pitch;
    for particle in particles(world) {
        world.set_displacement(particle, random.vector() * displacement * h);
        world.set_velocity(particle, random.vector() * speed);
    }
}

/// Every living spring: lower particle, forward direction, other end.
pub(super) fn springs(lattice: &Lattice, topology: &Topology) -> Vec<(u32, usize, u32)> {
    let mut springs = Vec::new();
    for particle in 0..lattice.len() as u32 {
        let alive = topology.alive()[particle as usize];
        for direction in (FIRST_FORWARD..NEIGHBOURS).filter(|d| alive >> d & 1 == 1) {
            springs.extend(lattice.neighbour(particle, direction).map(|other| (particle, direction, other)));
        }
    }
    springs
}

/// The piece that each particle belongs to, by the lowest particle in it.
pub(super) fn pieces(world: &World) -> Vec<u32> {
    let mut piece = particles(world);
    let springs = springs(world.lattice(), world.topology());
    loop {
        let mut changed = false;
        for &(a, _, b) in &springs {
            let low = piece[a as usize].min(piece[b as usize]);
            for end in [a, b] {
                changed |= std::mem::replace(&mut piece[end as usize], low) != low;
            }
        }
        if !changed {
            return piece;
        }
    }
}

/// Severs every living spring that `parted` says to, halfway.
pub(super) fn sever(world: &mut World, parted: impl Fn(u32, u32) -> bool) -> usize {
    let severed: Vec<SeveredSpring> = springs(world.lattice(), world.topology())
        .into_iter()
        .filter(|&(a, _, b)| parted(a, b))
        .map(|(particle, direction, _)| SeveredSpring {
            particle,
            direction: direction as u8,
            at: 0.5,
            time: world.time(),
        })
        .collect();
    world.sever(severed)
}

/// Does something on one thread: lattices of one block gain nothing from more.
pub(super) fn alone<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    match rayon::ThreadPoolBuilder::new().num_threads(1).build() {
        Ok(pool) => pool.install(work),
        // No thread to be had: do it here.
        Err(_) => work(),
    }
}

/// Numbers for the cases, the same everywhere.
pub(super) struct Random(SplitMix);

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        Self(SplitMix::new(seed))
    }

    pub(super) fn next(&mut self) -> u64 {
        self.0.next()
    }

    /// In 0..1.
    pub(super) fn unit(&mut self) -> f64 {
        self.0.unit()
    }

    /// Each part in -1..1.
    pub(super) fn vector(&mut self) -> Vector3 {
        Vector3::from_fn(|_, _| 2.0 * self.unit() - 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The oracle of the cases against the world it judges: two hundred steps, dampers, a cut and held particles.
    #[test]
    fn the_twin_in_f64_agrees_to_f32_rounding() {
        for model in ALL_MODELS {
            let mut random = Random::new(1);
            let map = blob(3.0, [6, 5, 5], 0.8, &mut random);
            let soft = Organ { stiffness: 0.3, ..organ(0.1) };
            let mut trial = Trial::new(lattice(model, &map, &[organ(0.05), soft]));
            shake(&mut trial.world, 0.02, 0.1, &mut random);
            trial.world.set_gravity(Vector3::new(1.0, -2.0, -9.81));
            let middle = centre(&trial.world);
            let side = |world: &World, p: u32| rest_place(world, p).x > middle.x;
            let world = trial.world.clone();
            assert!(sever(&mut trial.world, |a, b| a % 2 == 0 && side(&world, a) != side(&world, b)) > 20);
            trial.world.hold(&[0, 5, 9]);
            let apart = trial.run_with_twin(20).unwrap();
            println!("{model}: {apart:.1e} pitches apart after 200 steps");
            assert!(apart < 1e-4, "{model}: {apart:e} pitches");
            assert!(trial.steps >= 200, "the twin follows divided steps too");
        }
    }

    #[test]
    fn the_twin_finds_what_diverges() {
        let mut trial = Trial::new(block_of(Model::Tissue(0.45), 3.0, [3, 2, 2], 0.0));
        shake(&mut trial.world, 1e-3, 0.0, &mut Random::new(2));
        trial.world.set_dt(2.0 * trial.world.dt());
        let mut twin = ReferenceWorld::of(&trial.world);
        let error = (0..1000).find_map(|_| twin.step().err()).expect("twice the limit");
        assert!(error.to_string().contains("times the stable one"), "{error}");
        assert!(twin.displacement().iter().all(|u| u.norm().is_finite()));
        assert!(twin.time() > 0.0 && twin.time() < 1000.0 * twin.dt());
        shake(&mut trial.world, 0.0, 0.0, &mut Random::new(2));
        trial.world.set_displacement(3, Vector3::new(0.0, f64::NAN, 0.0));
        assert!(matches!(ReferenceWorld::of(&trial.world).step(), Err(StepError::Diverged { step: 1, .. })));
    }
}
