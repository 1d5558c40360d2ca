//! The moving lattice once more, plainly and in f64: what [`World`] is judged by.
//!
//! Symplectic Euler over [`crate::kernel::reference`], with the meaning of [`World::step`] for free particles, held
//! and grabbed ones, gravity and drag, and with the same check of every step. No blocks, no threads, no instruction sets: some hundred
//! times slower, and right to f64 rounding.
//!
//! Not covered: tearing; forces and rigid bodies that move; anchored rigid particles stay where they are.

use super::alternation::{AlternationWatch, alternates};
use super::divergence::LONGEST_MOVE;
use super::effects::Drag;
use super::step_error::{StepError, likely_cause};
use super::world::World;
use crate::geometry::Vector3;
use crate::kernel::alternation::Alternation;
use crate::kernel::reference::{HeldBack, cell_fibre_energy, cell_volume_energy, fibre_forces, flow, inelastic_forces};
use crate::kernel::reference_table::{LivingSprings, VolumeCells};
use crate::lattice::neighbours::{FIRST_FORWARD, OFFSETS};
use crate::lattice::{Lattice, SeveredSpring, Topology};
use crate::material::Assembly;

/// A lattice in motion, in f64. Lattice axes, SI units.
#[derive(Debug, Clone)]
pub struct ReferenceWorld {
    lattice: Lattice,
    topology: Topology,
    assembly: Assembly,
    /// Of the present topology.
    springs: LivingSprings,
    cells: VolumeCells,
    displacement: Vec<Vector3>,
    velocity: Vec<Vector3>,
    /// What Maxwell branches and yielding hold back of each spring [m].
    relaxed: HeldBack,
    yielded: HeldBack,
    held: Vec<bool>,
    grabbed: Option<Grabbed>,
    gravity: Vector3,
    drag: Option<Drag>,
    dt: f64,
    time: f64,
    steps: u64,
    alternation: Option<AlternationWatch>,
}

/// Particles that follow an offset from where they were grabbed [m].
#[derive(Debug, Clone)]
struct Grabbed {
    particles: Vec<u32>,
    start: Vec<Vector3>,
    offset: Vector3,
}

impl ReferenceWorld {
    /// The twin of a world: its present state, cuts, gravity, drag and step; particles that are held in it when it is made stay
    /// held.
    pub fn of(world: &World) -> Self {
        let all = || 0..world.lattice().len() as u32;
        Self {
            lattice: world.lattice().clone(),
            topology: world.topology().clone(),
            assembly: world.assembly().clone(),
            springs: LivingSprings::new(world.lattice(), world.topology(), world.assembly()),
            cells: VolumeCells::new(world.lattice(), world.topology(), world.assembly()),
            displacement: all().map(|p| world.displacement(p)).collect(),
            velocity: all().map(|p| world.velocity(p)).collect(),
            relaxed: all().map(|p| world.held_back(p).map(|[relaxed, _]| relaxed)).collect(),
            yielded: all().map(|p| world.held_back(p).map(|[_, yielded]| yielded)).collect(),
            held: all().map(|p| world.mass()[p as usize] == 0.0 || world.is_held(p)).collect(),
            grabbed: None,
            gravity: world.gravity,
            drag: world.drag,
            dt: world.dt(),
            time: world.time(),
            steps: world.steps(),
            alternation: world.assembly().damping.is_some().then(|| AlternationWatch::new(1)),
        }
    }

    /// Displacement of each particle from rest [m]. Shape `[particles]`.
    pub fn displacement(&self) -> &[Vector3] {
        &self.displacement
    }

    /// Velocity of each particle [m/s]. Shape `[particles]`.
    pub fn velocity(&self) -> &[Vector3] {
        &self.velocity
    }

    /// Time step [s].
    pub fn dt(&self) -> f64 {
        self.dt
    }

    /// Simulated time [s].
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Changes the time step from the next step on [s].
    ///
    /// # Panics
    /// If `dt` is not positive.
    pub fn set_dt(&mut self, dt: f64) {
        assert!(dt > 0.0 && dt.is_finite(), "the step is a positive time");
        self.dt = dt;
    }

    /// Puts a particle somewhere: displacement from rest, lattice axes [m].
    pub fn set_displacement(&mut self, particle: u32, displacement: Vector3) {
        self.displacement[particle as usize] = displacement;
    }

    /// Grabs particles, as [`World::grab`]; ends a grab before.
    pub fn grab(&mut self, particles: &[u32]) {
        let start = particles.iter().map(|&particle| self.displacement[particle as usize]).collect();
        self.grabbed = Some(Grabbed { particles: particles.to_vec(), start, offset: Vector3::zeros() });
    }

    /// Where the grabbed particles are to be after the next step, relative to where they were grabbed, lattice axes [m].
    pub fn move_grab(&mut self, offset: Vector3) {
        if let Some(grabbed) = &mut self.grabbed {
            grabbed.offset = offset;
        }
    }

    /// Severs springs; returns how many of them were alive.
    pub fn sever(&mut self, springs: impl IntoIterator<Item = SeveredSpring>) -> usize {
        let severed = springs.into_iter().filter(|&spring| self.topology.sever(&self.lattice, spring)).count();
        if severed > 0 {
            self.springs = LivingSprings::new(&self.lattice, &self.topology, &self.assembly);
            self.cells = VolumeCells::new(&self.lattice, &self.topology, &self.assembly);
        }
        severed
    }

    /// One step of symplectic Euler.
    ///
    /// # Errors
    /// [`StepError::Diverged`] and [`StepError::Alternates`] as [`World::step`] (which looks for alternation block by block,
    /// this world at the whole); places are left as they were before the step.
    pub fn step(&mut self) -> Result<(), StepError> {
        let Self { lattice, topology, assembly, displacement, velocity, relaxed, yielded, dt, .. } = &*self;
        let inelastic = inelastic_forces(lattice, topology, assembly, displacement, relaxed, yielded);
        let springs = self.springs.forces(displacement, velocity, *dt);
        let cells = self.cells.forces(displacement, velocity, *dt);
        let fibres = fibre_forces(lattice, topology, assembly, displacement);
        let before = self.velocity.clone();
        let kept = self.drag.map_or(1.0, |drag| drag.kept(self.dt));
        let forces = springs.into_iter().zip(cells).zip(fibres).zip(inelastic);
        for (p, (((spring, cell), fibre), inelastic)) in forces.enumerate() {
            self.velocity[p] = if self.held[p] {
                Vector3::zeros()
            } else {
                let acceleration =
                    (spring + cell + fibre + inelastic) / f64::from(self.assembly.mass[p]) + self.gravity;
                (self.velocity[p] + self.dt * acceleration) * kept
            };
        }
        if let Some(Grabbed { particles, start, offset }) = &self.grabbed {
            for (&particle, start) in particles.iter().zip(start) {
                let p = particle as usize;
                if !self.held[p] {
                    self.velocity[p] = (start + offset - self.displacement[p]) / self.dt;
                }
            }
        }
        self.check()?;
        self.watch_alternation(&before)?;
        for (displacement, velocity) in self.displacement.iter_mut().zip(&self.velocity) {
            *displacement += self.dt * velocity;
        }
        let Self { lattice, topology, assembly, displacement, relaxed, yielded, dt, .. } = self;
        flow(lattice, topology, assembly, displacement, *dt, relaxed, yielded);
        self.time += self.dt;
        self.steps += 1;
        Ok(())
    }

    /// Elastic, kinetic and half-step energy [J], see [`step_energy`].
    pub fn energy(&self) -> f64 {
        let Self { lattice, topology, assembly, springs, cells, .. } = self;
        energy_of((lattice, topology, assembly), springs, cells, &self.displacement, &self.velocity, self.dt)
    }

    fn watch_alternation(&mut self, before: &[Vector3]) -> Result<(), StepError> {
        let Self { lattice, topology, assembly, springs, velocity, alternation, dt, time, steps, .. } = self;
        let Some(watch) = alternation.as_mut().filter(|_| AlternationWatch::is_due(*steps)) else { return Ok(()) };
        let mut found = Alternation::default();
        for particle in 0..lattice.len() as u32 {
            for (_, other) in springs.of(particle).filter(|&(direction, _)| direction >= FIRST_FORWARD) {
                let relative = |of: &[Vector3]| of[other as usize] - of[particle as usize];
                let (now, then) = (relative(velocity), relative(before));
                found.difference += (now - then).norm_squared();
                found.sum += (now + then).norm_squared();
            }
        }
        if watch.look(*dt, lattice.pitch, [found]).is_none() {
            return Ok(());
        }
        let change = |particle: u32| velocity[particle as usize] - before[particle as usize];
        let all = 0..lattice.len() as u32;
        Err(alternates((lattice, topology, assembly), (*time, *steps, *dt), all, change))
    }

    fn check(&self) -> Result<(), StepError> {
        let parting = |particle: u32| {
            let own = self.velocity[particle as usize];
            if !own.norm_squared().is_finite() {
                return f64::INFINITY;
            }
            self.springs.of(particle).map(|(_, other)| (self.velocity[other as usize] - own).norm()).fold(0.0, f64::max)
        };
        let fastest = (0..self.lattice.len() as u32).map(|p| (parting(p), p)).max_by(|a, b| a.0.total_cmp(&b.0));
        let Some((speed, particle)) = fastest else { return Ok(()) };
        let moves = speed * self.dt / self.lattice.pitch;
        if moves <= LONGEST_MOVE {
            return Ok(());
        }
        Err(StepError::Diverged {
            time: self.time + self.dt,
            step: self.steps + 1,
            place: self.lattice.rest_place(particle),
            speed,
            moves,
            dt: self.dt,
            cause: likely_cause(&self.lattice, &self.topology, &self.assembly, self.dt),
        })
    }
}

/// The energy that symplectic Euler keeps of a linear lattice, and that dampers only lower [J].
///
/// ```text
/// E = elastic(u) + 1/2 v.M v + dt/2 v.F_elastic(u) + dt/4 v.F_damper(u, v)
/// ```
///
/// - `displacement` [m], `velocity` [m/s]: shape `[particles]`, lattice axes; held particles have velocity 0.
///
/// The plain sum of kinetic and elastic energy swings, because places and velocities are half a step apart: by a factor of
/// 40 in modes next to the stable limit. For `M a + C v + K u = 0` the change of `E` over a step is
/// `-dt/4 (v + v').C (v + v')`, with `v'` the next velocity: zero without dampers and never positive with them. Beyond
/// small strain both hold up to the order of `dt`.
pub fn step_energy(
    lattice: &Lattice,
    topology: &Topology,
    assembly: &Assembly,
    displacement: &[Vector3],
    velocity: &[Vector3],
    dt: f64,
) -> f64 {
    let springs = LivingSprings::new(lattice, topology, assembly);
    let cells = VolumeCells::new(lattice, topology, assembly);
    energy_of((lattice, topology, assembly), &springs, &cells, displacement, velocity, dt)
}

/// [`step_energy`] with springs and cells that have been looked up.
fn energy_of(
    (lattice, topology, assembly): (&Lattice, &Topology, &Assembly),
    living: &LivingSprings,
    whole: &VolumeCells,
    displacement: &[Vector3],
    velocity: &[Vector3],
    dt: f64,
) -> f64 {
    let forces = |velocity: &[Vector3]| -> Vec<Vector3> {
        let springs = living.forces(displacement, velocity, dt);
        let cells = whole.forces(displacement, velocity, dt);
        let fibres = fibre_forces(lattice, topology, assembly, displacement);
        springs.iter().zip(&cells).zip(&fibres).map(|((spring, cell), fibre)| spring + cell + fibre).collect()
    };
    let elastic = forces(&vec![Vector3::zeros(); lattice.len()]);
    let damped = assembly.damping.is_some();
    let all = if damped { forces(velocity) } else { elastic.clone() };
    let mut energy = 0.0;
    for particle in 0..lattice.len() as u32 {
        let (p, v) = (particle as usize, velocity[particle as usize]);
        for (direction, other) in living.of(particle).filter(|&(direction, _)| direction >= FIRST_FORWARD) {
            let rest = Vector3::from(OFFSETS[direction].map(f64::from)) * lattice.pitch;
            let difference = displacement[other as usize] - displacement[p];
            // l - L without cancellation: (l^2 - L^2) / (l + L).
            let stretch = difference.dot(&(2.0 * rest + difference)) / ((rest + difference).norm() + rest.norm());
            energy += 0.5 * assembly.stiffness.of(lattice, particle, direction) * stretch * stretch;
        }
        if let Some(term) = &assembly.volume {
            energy += cell_volume_energy(lattice, topology, term, particle, |p| displacement[p as usize]);
        }
        if let Some(term) = &assembly.fibres {
            energy += cell_fibre_energy(lattice, topology, term, particle, |p| displacement[p as usize]);
        }
        energy += 0.5 * f64::from(assembly.mass[p]) * v.norm_squared();
        energy += 0.25 * dt * v.dot(&(elastic[p] + all[p]));
    }
    energy
}
