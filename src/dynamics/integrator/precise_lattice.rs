//! A lattice in f64: forces, energy and tangent at any places, for references and for what is solved.
//!
//! The same blocks and slots as a [`World`], with the constants of every spring in a table of their own: some 420 bytes per slot
//! with dampers, 210 without, and as much again for a tangent. An evaluation of the forces takes about five times as long as
//! the fast f32 body's. Cuts are followed spring by spring.
//!
//! Not covered: rigid bodies that move, contact.

use std::ops::Range;

use rayon::prelude::*;

use super::Mechanics;
use super::cells::{CellRate, Cells};
use super::field::{Field, zeros};
use crate::dynamics::world::World;
use crate::kernel::halo::{HALO_LEN, gather};
use crate::kernel::precise::{Rate, SPRINGS_LEN, WideHalo, apply_tangents, spring_forces, spring_tangents};
use crate::lattice::layout::{BLOCK_LEN, BlockLayout};
use crate::lattice::neighbours::{NEIGHBOURS, opposite};
use crate::lattice::{Lattice, Topology};
use crate::material::SpringConstants;

/// Buffers of one thread: displacement, velocity or vector, displacement when the step began.
type Halos = Box<[[WideHalo; 3]; 2]>;

fn halos() -> Halos {
    Box::new([[[0.0; HALO_LEN]; 3]; 2])
}

/// Springs, masses and loads of a world, in f64 and block order. Lattice axes, SI units.
#[derive(Debug, Clone)]
pub struct PreciseLattice {
    layout: BlockLayout,
    pitch: f64,
    /// Stiffness of every spring [N/m], by block, direction and slot; 0 where there is none.
    stiffness: Vec<f64>,
    /// Damping of every spring [N s/m].
    damping: Option<Vec<f64>>,
    cells: Option<Cells>,
    /// Whether cells have a viscosity.
    viscous: bool,
    /// Of each slot [kg].
    mass: Vec<f64>,
    /// One over mass of what is free, 0 for all others [1/kg].
    free: Vec<f64>,
    gravity: [f64; 3],
    drag: f64,
    /// Forces from outside [N].
    pub(super) load: Field<f64>,
    /// Severed springs it knows.
    severed: usize,
    tangent: Tangent,
}

/// The second derivative of the energy over a step, as it was taken last.
#[derive(Debug, Clone, Default)]
struct Tangent {
    along: Vec<f32>,
    across: Vec<f32>,
    /// Damping over the step [N/m].
    per_step: Vec<f64>,
    dt: f64,
    place: Field<f64>,
    diagonal: [Vec<f64>; 6],
}

impl PreciseLattice {
    /// The twin of a world: its springs, cuts, gravity and drag, and which particles are free. No loads.
    pub fn of(world: &World) -> Self {
        let (lattice, topology, assembly) = (world.lattice(), world.topology(), world.assembly());
        let layout = world.layout.clone();
        let table = |constants: &SpringConstants| table_of(lattice, topology, &layout, constants);
        let (stiffness, damping) = (table(&assembly.stiffness), assembly.damping.as_ref().map(table));
        let mut mass = vec![0.0; layout.slots()];
        for (&slot, &m) in layout.slot.iter().zip(&assembly.mass) {
            mass[slot as usize] = m.into();
        }
        let mut precise = Self {
            pitch: lattice.pitch,
            stiffness,
            damping,
            cells: Cells::new(lattice, topology, &layout, assembly),
            viscous: assembly.volume.as_ref().is_some_and(|term| term.viscosity.is_some()),
            free: vec![0.0; layout.slots()],
            mass,
            gravity: [0.0; 3],
            drag: 0.0,
            load: zeros(layout.slots()),
            severed: topology.severed().len(),
            tangent: Tangent::default(),
            layout,
        };
        precise.follow(world);
        precise
    }

    /// Takes over what changed in the world: cuts, which particles are free, gravity and drag.
    ///
    /// # Panics
    /// Never: a severed spring had two ends.
    pub fn follow(&mut self, world: &World) {
        let (lattice, topology) = (world.lattice(), world.topology());
        for spring in &topology.severed()[self.severed..] {
            let direction = usize::from(spring.direction);
            let far = lattice.neighbour(spring.particle, direction).expect("a severed spring had two ends");
            for (end, direction) in [(spring.particle, direction), (far, opposite(direction))] {
                let place = place(self.layout.slot[end as usize] as usize, direction);
                self.stiffness[place] = 0.0;
                if let Some(damping) = &mut self.damping {
                    damping[place] = 0.0;
                }
            }
            if let Some(cells) = &mut self.cells {
                lattice.cells_of_spring(spring.particle, direction).for_each(|cell| cells.drop_cell(cell));
            }
        }
        self.severed = topology.severed().len();
        self.gravity = world.gravity.into();
        self.drag = world.drag_rate();
        let weights = self.free.par_iter_mut().zip(&self.mass).zip(&world.dt_over_mass).with_min_len(BLOCK_LEN);
        weights.for_each(|((free, mass), weight)| *free = if *weight > 0.0 { mass.recip() } else { 0.0 });
    }

    /// Bytes held, once a tangent has been taken if one will be.
    pub(super) fn bytes(&self, with_tangent: bool) -> usize {
        let springs = self.stiffness.len();
        let damping = self.damping.as_ref().map_or(0, Vec::len);
        let tangent = if with_tangent { 8 * springs + 8 * damping + 72 * self.slots() } else { 0 };
        8 * (springs + damping) + 40 * self.slots() + self.cells.as_ref().map_or(0, Cells::bytes) + tangent
    }

    /// Mass of each slot [kg]; 0 for empty slots and rigid organs.
    pub fn mass(&self) -> &[f64] {
        &self.mass
    }

    /// One over mass of each slot that is free to move, else 0 [1/kg].
    pub fn free(&self) -> &[f64] {
        &self.free
    }

    pub(super) fn slots(&self) -> usize {
        self.layout.slots()
    }

    pub(super) fn gravity(&self) -> [f64; 3] {
        self.gravity
    }

    pub(super) fn drag(&self) -> f64 {
        self.drag
    }

    fn springs(&self, block: usize) -> Range<usize> {
        block * SPRINGS_LEN..(block + 1) * SPRINGS_LEN
    }

    fn gather(&self, block: usize, field: &Field<f64>, halo: &mut [WideHalo; 3]) {
        for axis in 0..3 {
            gather(&field[axis], &self.layout.neighbours[block], &mut halo[axis]);
        }
    }

    /// Forces of springs, dampers, volume terms and fibres [N], overwritten, with dampers reading velocities [m/s]; returns the elastic
    /// energy [J].
    pub fn forces(&mut self, displacement: &Field<f64>, velocity: &Field<f64>, force: &mut Field<f64>) -> f64 {
        let energy =
            self.spring_forces(displacement, self.damping.as_deref().map(|damping| (damping, velocity)), false, force);
        let rate = if self.viscous { CellRate::Velocity(velocity) } else { CellRate::None };
        energy + self.cells.as_mut().map_or(0.0, |cells| cells.add_forces(displacement, rate, force))
    }

    /// The same over a step `dt` [s] that began at `before` [m], and with the energy that dampers take in it; without dampers where
    /// `dt` is infinite.
    pub(super) fn forces_over(
        &mut self,
        displacement: &Field<f64>,
        before: &Field<f64>,
        dt: f64,
        force: &mut Field<f64>,
    ) -> f64 {
        self.set_step(dt);
        let damped = self.damping.is_some() && dt.is_finite();
        let dampers = damped.then_some((self.tangent.per_step.as_slice(), before));
        let energy = self.spring_forces(displacement, dampers, true, force);
        let rate = if self.viscous && dt.is_finite() { CellRate::Earlier(before, dt.recip()) } else { CellRate::None };
        energy + self.cells.as_mut().map_or(0.0, |cells| cells.add_forces(displacement, rate, force))
    }

    /// Damping over the step.
    fn set_step(&mut self, dt: f64) {
        if let Some(damping) = &self.damping
            && dt.is_finite()
            && (self.tangent.dt != dt || self.tangent.per_step.len() != damping.len())
        {
            self.tangent.per_step.resize(damping.len(), 0.0);
            let both = self.tangent.per_step.par_iter_mut().zip(damping).with_min_len(SPRINGS_LEN);
            both.for_each(|(per_step, damping)| *per_step = damping / dt);
        }
        self.tangent.dt = dt;
    }

    /// Forgets what belongs to severed springs.
    pub(super) fn forget_step(&mut self) {
        self.tangent.dt = 0.0;
    }

    fn spring_forces(
        &self,
        displacement: &Field<f64>,
        dampers: Option<(&[f64], &Field<f64>)>,
        earlier: bool,
        force: &mut Field<f64>,
    ) -> f64 {
        let [x, y, z] = force.each_mut().map(|axis| axis.par_chunks_mut(BLOCK_LEN));
        let blocks = (x, y, z).into_par_iter().enumerate();
        let energies: Vec<f64> = blocks
            .map_init(halos, |halos, (block, (x, y, z))| {
                let [u, other] = &mut **halos;
                self.gather(block, displacement, u);
                let springs = self.springs(block);
                let rate = match dampers {
                    None => Rate::None,
                    Some((damping, field)) => {
                        self.gather(block, field, other);
                        let (damping, field) = (&damping[springs.clone()], other.each_ref());
                        if earlier {
                            Rate::Earlier { damping, displacement: field }
                        } else {
                            Rate::Velocity { damping, velocity: field }
                        }
                    }
                };
                let force = [x, y, z].map(|axis| axis.try_into().expect("whole blocks"));
                spring_forces(self.pitch, &self.stiffness[springs], rate, u.each_ref(), force)
            })
            .collect();
        energies.into_iter().sum()
    }

    /// Takes the tangent of [`PreciseLattice::forces_over`] at these displacements for [`PreciseLattice::apply`]: exact, or without
    /// what may make it negative.
    pub(super) fn take_tangent(&mut self, displacement: &Field<f64>, before: &Field<f64>, dt: f64, exact: bool) {
        self.set_step(dt);
        let mut tangent = std::mem::take(&mut self.tangent);
        tangent.along.resize(self.stiffness.len(), 0.0);
        tangent.across.resize(self.stiffness.len(), 0.0);
        for axis in 0..3 {
            tangent.place[axis].clone_from(&displacement[axis]);
        }
        tangent.diagonal.iter_mut().for_each(|entry| entry.resize(self.layout.slots(), 0.0));
        let damped = self.damping.is_some() && dt.is_finite();
        let Tangent { along, across, per_step, diagonal, .. } = &mut tangent;
        let [xx, yy, zz, yz, xz, xy] = diagonal.each_mut().map(|entry| entry.par_chunks_mut(BLOCK_LEN));
        let springs = along.par_chunks_mut(SPRINGS_LEN).zip(across.par_chunks_mut(SPRINGS_LEN));
        let blocks = springs.zip(((xx, yy, zz), (yz, xz, xy)).into_par_iter()).enumerate();
        blocks.for_each_init(halos, |halos, (block, ((along, across), ((xx, yy, zz), (yz, xz, xy))))| {
            let [u, other] = &mut **halos;
            self.gather(block, displacement, u);
            let springs = self.springs(block);
            let rate = if damped {
                self.gather(block, before, other);
                Rate::Earlier { damping: &per_step[springs.clone()], displacement: other.each_ref() }
            } else {
                Rate::None
            };
            let diagonal = [xx, yy, zz, yz, xz, xy].map(|entry| entry.try_into().expect("whole blocks"));
            spring_tangents(self.pitch, &self.stiffness[springs], rate, u.each_ref(), exact, [along, across], diagonal);
        });
        if let Some(cells) = &mut self.cells {
            let rate = if dt.is_finite() { CellRate::Earlier(before, dt.recip()) } else { CellRate::None };
            cells.take_tangent(displacement, rate, exact, &mut tangent.diagonal);
        }
        self.tangent = tangent;
    }

    /// Diagonal blocks of the tangent taken last: xx, yy, zz, yz, xz, xy [N/m].
    pub(super) fn diagonal(&self) -> &[Vec<f64>; 6] {
        &self.tangent.diagonal
    }

    /// The tangent taken last times a vector [m]: overwrites `product` [N].
    pub(super) fn apply(&mut self, vector: &Field<f64>, product: &mut Field<f64>) {
        let Tangent { along, across, place, .. } = &self.tangent;
        let [x, y, z] = product.each_mut().map(|axis| axis.par_chunks_mut(BLOCK_LEN));
        (x, y, z).into_par_iter().enumerate().for_each_init(halos, |halos, (block, (x, y, z))| {
            let [u, other] = &mut **halos;
            self.gather(block, place, u);
            self.gather(block, vector, other);
            let springs = self.springs(block);
            let product = [x, y, z].map(|axis| axis.try_into().expect("whole blocks"));
            let (along, across) = (&along[springs.clone()], &across[springs]);
            apply_tangents(self.pitch, along, across, u.each_ref(), other.each_ref(), product);
        });
        if let Some(cells) = &mut self.cells {
            cells.add_product(vector, product);
        }
    }
}

impl Mechanics for PreciseLattice {
    type Real = f64;

    fn accelerations(&mut self, _share: f64, displacement: &Field<f64>, velocity: &Field<f64>, out: &mut Field<f64>) {
        self.forces(displacement, velocity, out);
        let (gravity, drag) = (self.gravity, self.drag);
        for axis in 0..3 {
            let outer = self.free.par_iter().zip(&self.load[axis]).zip(&velocity[axis]);
            out[axis].par_iter_mut().zip(outer).with_min_len(BLOCK_LEN).for_each(|(out, ((free, load), velocity))| {
                *out = if *free > 0.0 { (*out + load) * free + gravity[axis] - drag * velocity } else { 0.0 };
            });
        }
    }

    fn unit(&self) -> f64 {
        1.0
    }

    fn damped(&self) -> bool {
        self.damping.is_some() || self.viscous || self.drag > 0.0
    }
}

/// Where the constant of a slot's spring in a direction stands.
fn place(slot: usize, direction: usize) -> usize {
    let (block, own) = (slot / BLOCK_LEN, slot % BLOCK_LEN);
    block * SPRINGS_LEN + direction * BLOCK_LEN + own
}

/// The constant of every living spring.
fn table_of(lattice: &Lattice, topology: &Topology, layout: &BlockLayout, constants: &SpringConstants) -> Vec<f64> {
    let mut table = vec![0.0; layout.blocks.len() * SPRINGS_LEN];
    table.par_chunks_mut(SPRINGS_LEN).enumerate().for_each(|(block, table)| {
        for own in 0..BLOCK_LEN {
            let Some(particle) = layout.particle_of_slot(lattice, block * BLOCK_LEN + own) else { continue };
            let alive = topology.alive()[particle as usize];
            for direction in (0..NEIGHBOURS).filter(|direction| alive >> direction & 1 == 1) {
                table[direction * BLOCK_LEN + own] = constants.of(lattice, particle, direction);
            }
        }
    });
    table
}
