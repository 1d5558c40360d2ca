//! What is stepped: the cube that other programs step too, or the particles of a scene's organs.

use std::path::Path;

use super::super::super::args::BenchLaw;
use crate::dynamics::World;
use crate::geometry::{Affine, Grid, GridShape, Vector3};
use crate::lattice::build::build;
use crate::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS, OFFSETS};
use crate::lattice::{Lattice, SeveredSpring};
use crate::material::paper::{PaperBody, assemble};
use crate::run::inputs;
use crate::run::label_lookup::Files;
use crate::run::prepare::prepare;
use crate::volume::Volume;

/// Step of every law [s].
const DT: f64 = 0.01;
/// Strain along x at the start.
const STRAIN: f64 = 1e-3;
/// Thickness of the two organs' slabs, and distance of the cuts [pitches].
const SLAB: usize = 24;

/// A lattice and where it starts.
pub(super) struct Body {
    pub(super) world: World,
}

impl Body {
    /// Where a particle starts, lattice axes [m].
    pub(super) fn place(&self, particle: u32) -> Vector3 {
        // The lattice keeps one empty layer around its particles.
        let i = self.world.lattice().ijk(particle)[0] as f64 - 1.0;
        Vector3::new(STRAIN * i * self.world.lattice().pitch, 0.0, 0.0)
    }

    /// Every particle to its start, at rest.
    pub(super) fn start(&mut self) {
        for particle in 0..self.world.lattice().len() as u32 {
            let place = self.place(particle);
            self.world.set_displacement(particle, place);
            self.world.set_velocity(particle, Vector3::zeros());
        }
    }
}

/// A cube of n^3 particles 1 m apart.
pub(super) fn cube(n: usize, law: BenchLaw) -> anyhow::Result<Body> {
    let affine = Affine::from_spacing([1e3; 3], [0.0; 3])?;
    let shape = GridShape::new(n, n, n);
    let organs = (0..shape.len()).map(|linear| organ_at(shape.ijk(linear), law)).collect();
    body(build(&Volume::from_vec(Grid { shape, affine }, organs))?, law)
}

/// The particles of a scene's organs, at the scene's pitch, without its materials.
pub(super) fn of_scene(path: &Path, law: BenchLaw) -> anyhow::Result<Body> {
    let (scene, _) = crate::scene::load(path, &Files)?;
    let lattice = prepare(&scene, &inputs::load(&scene)?)?.lattice;
    let organs = (0..lattice.grid.shape.len())
        .map(|linear| match lattice.particle_at[linear] {
            u32::MAX => crate::lattice::build::NO_ORGAN,
            _ => organ_at(lattice.grid.shape.ijk(linear), law),
        })
        .collect();
    body(build(&Volume::from_vec(lattice.grid, organs))?, law)
}

fn organ_at([_, _, k]: [usize; 3], law: BenchLaw) -> u8 {
    match law {
        BenchLaw::Bare => 0,
        BenchLaw::Everything => (k / SLAB % 2) as u8,
    }
}

fn body(lattice: Lattice, law: BenchLaw) -> anyhow::Result<Body> {
    let bodies = match law {
        BenchLaw::Bare => vec![Some(PaperBody { stiffness: 10.0, damping: 0.0, mass: 1.0 })],
        BenchLaw::Everything => [(10.0, 0.1), (20.0, 0.2)]
            .map(|(stiffness, damping)| Some(PaperBody { stiffness, damping, mass: 1.0 }))
            .to_vec(),
    };
    let cuts = match law {
        BenchLaw::Bare => Vec::new(),
        BenchLaw::Everything => cuts(&lattice),
    };
    let assembly = assemble(&lattice, &bodies);
    let mut world = World::new(lattice, assembly, DT);
    world.sever(cuts);
    Ok(Body { world })
}

/// The springs that pass planes across x.
fn cuts(lattice: &Lattice) -> Vec<SeveredSpring> {
    let mut cuts = Vec::new();
    for particle in 0..lattice.len() as u32 {
        let i = lattice.ijk(particle)[0] as i64;
        for direction in FIRST_FORWARD..NEIGHBOURS {
            let far = i + i64::from(OFFSETS[direction][0]);
            let crosses = far.div_euclid(SLAB as i64) != i.div_euclid(SLAB as i64);
            if crosses && lattice.springs[particle as usize] >> direction & 1 == 1 {
                cuts.push(SeveredSpring { particle, direction: direction as u8, at: 0.5, time: 0.0 });
            }
        }
    }
    cuts
}
