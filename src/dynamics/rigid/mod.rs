//! Rigid parts that move: which particles make a body, and the body's share of a step.
//!
//! # What is a body
//!
//! Free rigid particles that living springs join are one body, whichever organs they belong to: bones that touch are one
//! until a blade parts them. If springs join them to an anchored particle too, they are anchored with it and become a body
//! when they are cut off. Severing springs between rigid particles makes the parts bodies of their own; the momenta of the
//! parts add up to those of the whole.
//!
//! # How a body is stepped
//!
//! Its particles enter the kick with velocity 0 and their own mass, so they leave it with the impulse that springs, cells
//! and dampers give them, not rounded against their velocity. The sum of impulses and of their moments about the centre
//! moves the body ([`body`]), and every particle is put where the body takes it: places are functions of the body's state
//! in f64, never sums, so a part keeps its shape for ever. The velocity of a particle is its mean over the step, which is
//! what dampers compare. Springs inside a body do nothing and are left out of the kick; they stay in the topology.
//!
//! Summing forces over a body projects the motion of free particles with these masses onto rigid motions, orthogonally in
//! the metric of mass. A projection does not raise the largest frequency (Rayleigh's quotient over a subspace), and the
//! inertia of the voxels themselves lowers it further. So the stable step of the lattice whose rigid particles were loose
//! is enough, with nothing to be known about bodies: that is what [`super::stable_dt`] computes from their masses.
//!
//! # Holds, grabs, forces
//!
//! A hold of any of its particles stops the whole body. A grab of any moves the whole body along without turning; of two
//! grabs the later one moves it; a hold wins over both. Forces act where they are applied, torque included.
//!
//! Bodies do not feel each other but through soft tissue, and feel no obstacle ([`super::effects::contact`]).

mod body;

pub use body::RigidBody;

use rayon::prelude::*;

use self::body::{Advance, PlaceMap, place_of, rest_place};
use super::drive::raise;
use super::world::World;
use crate::geometry::Vector3;
use crate::lattice::layout::{BLOCK_LEN, BlockLayout};
use crate::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS, OFFSETS, opposite};
use crate::lattice::{Lattice, Topology};
use crate::material::{Assembly, RigidKind};

/// Marks a free particle that is joined to an anchored one.
const ANCHORED: u32 = u32::MAX;

/// All rigid bodies of a world and what they are made of.
#[derive(Debug, Clone)]
pub(super) struct Bodies {
    bodies: Vec<RigidBody>,
    /// Slots of the particles that feel soft tissue, for each body.
    attached: Vec<Vec<u32>>,
    /// Where each body goes in this step.
    advance: Vec<Advance>,
    /// Slots of all particles of kind free, ascending.
    slots: Vec<u32>,
    /// Body of each of them, or [`ANCHORED`].
    body: Vec<u32>,
    /// First of them in each block, and the end.
    first: Vec<u32>,
}

/// Free rigid particles that living springs join.
struct Component {
    particles: Vec<u32>,
    anchored: bool,
}

impl Bodies {
    /// The bodies of a lattice at rest; `None` when no particle is free and rigid.
    ///
    /// # Panics
    /// If there is not one kind per particle, or a free rigid particle has no mass.
    pub(super) fn new(
        lattice: &Lattice,
        topology: &Topology,
        assembly: &Assembly,
        layout: &BlockLayout,
    ) -> Option<Self> {
        let kind = assembly.rigid.as_ref()?.kind();
        assert_eq!(kind.len(), lattice.len(), "one kind per particle");
        let free: Vec<u32> = (0..lattice.len() as u32).filter(|&p| kind[p as usize] == RigidKind::Free).collect();
        assert!(free.iter().all(|&p| assembly.mass[p as usize] > 0.0), "free rigid particles have a mass");
        let mut slots: Vec<u32> = free.iter().map(|&p| layout.slot[p as usize]).collect();
        slots.sort_unstable();
        let starts = (0..=layout.blocks.len()).map(|block| block * BLOCK_LEN);
        let first = starts.map(|start| slots.partition_point(|&slot| (slot as usize) < start) as u32).collect();
        let body = vec![ANCHORED; slots.len()];
        let mut found = Self { bodies: Vec::new(), attached: Vec::new(), advance: Vec::new(), slots, body, first };
        for component in components(lattice, topology, kind, &free) {
            if !component.anchored {
                found.add(lattice, assembly, layout, RigidBody::new(lattice, &assembly.mass, component.particles));
            }
        }
        Some(found)
    }

    /// Body of a slot's particle: `None` for particles that are not free and rigid, `Some(None)` for anchored ones.
    fn membership(&self, slot: u32) -> Option<Option<usize>> {
        let place = self.slots.binary_search(&slot).ok()?;
        Some(Some(self.body[place]).filter(|&body| body != ANCHORED).map(|body| body as usize))
    }

    /// The body that moves a slot's particle.
    pub(super) fn of_slot(&self, slot: u32) -> Option<usize> {
        self.membership(slot).flatten()
    }

    /// True when a slot's particle only moves while it is grabbed, although it has a mass.
    pub(super) fn is_anchored(&self, slot: u32) -> bool {
        self.membership(slot) == Some(None)
    }

    /// Makes a body have this velocity [m/s] in this step, without turning.
    pub(super) fn drive(&mut self, body: usize, velocity: Vector3) {
        self.bodies[body].load.driven = Some(velocity);
    }

    /// Lets an impulse [N s] act on a body at one of its particles in this step.
    pub(super) fn push(&mut self, body: usize, impulse: Vector3, lattice: &Lattice, particle: u32) {
        let body = &mut self.bodies[body];
        let rest = rest_place(lattice, particle);
        body.push(impulse, rest + body.displacements().at(rest));
    }

    /// Leaves every body this share of the motion it has and of what acts on it in this step.
    pub(super) fn slow(&mut self, kept: f64) {
        self.bodies.iter_mut().for_each(|body| body.slow(kept));
    }

    /// Whether a block has free rigid particles.
    pub(super) fn is_in(&self, block: usize) -> bool {
        !self.range(block).is_empty()
    }

    /// Takes the velocities of a block's rigid particles out of the kick.
    pub(super) fn clear_block(&self, block: usize, velocity: &mut [&mut [f32; BLOCK_LEN]; 3]) {
        for &slot in &self.slots[self.range(block)] {
            for axis in 0..3 {
                velocity[axis][slot as usize % BLOCK_LEN] = 0.0;
            }
        }
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        let particles: usize = self.bodies.iter().map(|body| body.particles().len()).sum();
        let attached: usize = self.attached.iter().map(Vec::len).sum();
        4 * (2 * self.slots.len() + particles + attached + self.first.len())
            + self.bodies.len() * (size_of::<RigidBody>() + size_of::<Advance>())
    }

    fn range(&self, block: usize) -> std::ops::Range<usize> {
        self.first[block] as usize..self.first[block + 1] as usize
    }

    /// Adds a body; returns its number.
    fn add(&mut self, lattice: &Lattice, assembly: &Assembly, layout: &BlockLayout, body: RigidBody) -> usize {
        let number = self.bodies.len();
        self.bodies.push(body);
        self.attached.push(Vec::new());
        self.claim(number, lattice, assembly, layout);
        number
    }

    /// Enters a body's particles in the tables.
    fn claim(&mut self, number: usize, lattice: &Lattice, assembly: &Assembly, layout: &BlockLayout) {
        let kind = assembly.rigid.as_ref().expect("bodies come from rigid parts").kind();
        let body = &self.bodies[number];
        let mut attached = Vec::new();
        for &particle in body.particles() {
            let slot = layout.slot[particle as usize];
            let place = self.slots.binary_search(&slot).expect("a body's particles are free");
            self.body[place] = number as u32;
            // Springs at rest: a cell may act although its springs are severed.
            let springs = lattice.springs[particle as usize];
            let soft = |d: usize| lattice.neighbour(particle, d).is_some_and(|o| kind[o as usize] == RigidKind::Soft);
            if (0..NEIGHBOURS).any(|d| springs >> d & 1 == 1 && soft(d)) {
                attached.push(slot);
            }
        }
        self.attached[number] = attached;
    }
}

/// Splits free rigid particles (ascending) into those that living springs join, in the order of their first particles.
/// A spring leads to one of them, to an anchored particle or to a soft one. O(particles), and a byte for each of the lattice.
fn components(lattice: &Lattice, topology: &Topology, kind: &[RigidKind], among: &[u32]) -> Vec<Component> {
    let shape = lattice.grid.shape;
    // A living spring ends inside the grid: its far end is a plain step away.
    let steps = OFFSETS.map(|[i, j, k]| (k as isize * shape.ny as isize + j as isize) * shape.nx as isize + i as isize);
    let mut waiting = vec![false; lattice.len()];
    for &particle in among {
        waiting[particle as usize] = true;
    }
    let mut components = Vec::new();
    for &start in among {
        if !std::mem::take(&mut waiting[start as usize]) {
            continue;
        }
        let mut component = Component { particles: vec![start], anchored: false };
        let mut next = 0;
        while let Some(&particle) = component.particles.get(next) {
            next += 1;
            for direction in (0..NEIGHBOURS).filter(|d| topology.alive()[particle as usize] >> d & 1 == 1) {
                let point = lattice.points[particle as usize] as usize;
                let other = lattice.particle_at[point.wrapping_add_signed(steps[direction])];
                component.anchored |= kind[other as usize] == RigidKind::Anchored;
                if std::mem::take(&mut waiting[other as usize]) {
                    component.particles.push(other);
                }
            }
        }
        component.particles.sort_unstable();
        components.push(component);
    }
    components
}

impl World {
    /// The rigid bodies: those of the lattice at rest by their first particle, then those cut off since. A part that is
    /// cut keeps its number for the piece with its first particle.
    pub fn rigid_bodies(&self) -> &[RigidBody] {
        self.rigid.as_ref().map_or(&[], |rigid| &rigid.bodies)
    }

    /// The rigid body that moves a particle, by its number in [`World::rigid_bodies`]; `None` for soft and anchored ones.
    pub fn rigid_body_of(&self, particle: u32) -> Option<usize> {
        self.rigid.as_ref()?.of_slot(self.layout.slot[particle as usize])
    }

    /// Gives a rigid body a velocity of its centre [m/s] and an angular velocity [rad/s], lattice axes. A body that is held
    /// stays all the same.
    ///
    /// # Panics
    /// If there is no such body.
    pub fn set_rigid_motion(&mut self, body: usize, velocity: Vector3, angular_velocity: Vector3) {
        let moved = &mut self.rigid.as_mut().expect("the world has rigid bodies").bodies[body];
        moved.set_motion(velocity, angular_velocity);
        self.show_velocity(body);
    }

    /// Puts a whole body so that one of its particles has this displacement.
    pub(super) fn place_body(&mut self, body: usize, particle: u32, displacement: Vector3) {
        let Some(rigid) = &mut self.rigid else { return };
        let moved = &mut rigid.bodies[body];
        moved.shift(displacement - moved.displacements().at(rest_place(&self.lattice, particle)));
        self.show_place(body);
    }

    /// After the world is made: what a kick does with rigid particles.
    pub(super) fn adopt_bodies(&mut self) {
        for body in 0..self.rigid_bodies().len() {
            self.adopt(body);
        }
    }

    /// After claims have changed: which bodies are held. A held body stops at once.
    pub(super) fn hold_bodies(&mut self) {
        for number in 0..self.rigid_bodies().len() {
            let held = self.rigid_bodies()[number].particles().iter().any(|&p| self.is_held(p));
            let body = &mut self.rigid.as_mut().expect("there are bodies").bodies[number];
            if held && !std::mem::replace(&mut body.load.held, held) {
                body.set_motion(Vector3::zeros(), Vector3::zeros());
                self.show_velocity(number);
            } else {
                body.load.held = held;
            }
        }
    }

    /// After the kick: sums what it gave the rigid particles.
    pub(super) fn load_bodies(&mut self) {
        let (dt, gravity) = (self.dt(), self.gravity);
        let gravity_dt = gravity.map(|g| f64::from((g * dt) as f32));
        let Self { rigid: Some(rigid), lattice, layout, velocity, displacement, dt_over_mass, .. } = self else {
            return;
        };
        let Bodies { bodies, attached, .. } = &mut **rigid;
        bodies.par_iter_mut().zip(attached).for_each(|(body, attached)| {
            // In the order of particles: the same sum at any thread count.
            for &slot in attached.iter() {
                let slot = slot as usize;
                let of = |field: &[Vec<f32>; 3]| Vector3::from([0, 1, 2].map(|axis| f64::from(field[axis][slot])));
                let place = place_of(lattice, layout.ijk_of_slot(slot)) + of(displacement);
                body.push((of(velocity) - gravity_dt) * (dt / f64::from(dt_over_mass[slot])), place);
            }
            body.load.impulse += gravity * (body.mass() * dt);
        });
    }

    /// After the drives: moves the bodies on, and gives their particles the velocities that take them there.
    pub(super) fn advance_bodies(&mut self, fastest: &mut [f32]) {
        let dt = self.dt();
        let Self { rigid: Some(rigid), lattice, layout, velocity, .. } = self else { return };
        let Bodies { bodies, advance, .. } = &mut **rigid;
        bodies.par_iter_mut().map(|body| body.advance(dt)).collect_into_vec(advance);
        let rigid = &**rigid;
        let maps: Vec<PlaceMap> = rigid.advance.iter().map(|advance| advance.velocities).collect();
        rigid.write(lattice, layout, velocity, &maps);
        let velocity = &*velocity;
        fastest.par_iter_mut().enumerate().for_each(|(block, fastest)| {
            for place in rigid.range(block).filter(|&place| rigid.body[place] != ANCHORED) {
                raise(fastest, rigid.slots[place] as usize, velocity);
            }
        });
    }

    /// After the drift: puts the particles exactly where their bodies are.
    pub(super) fn settle_bodies(&mut self) {
        let Self { rigid: Some(rigid), lattice, layout, displacement, .. } = self else { return };
        let Bodies { bodies, advance, .. } = &mut **rigid;
        for (body, advance) in bodies.iter_mut().zip(advance) {
            body.settle(advance);
        }
        let maps: Vec<PlaceMap> = rigid.bodies.iter().map(RigidBody::displacements).collect();
        rigid.write(lattice, layout, displacement, &maps);
    }

    /// After springs between rigid particles were severed: parts that no longer hold together become bodies.
    ///
    /// - `severed`: a free end of each of these springs.
    pub(super) fn split_bodies(&mut self, severed: &[u32]) {
        let Some(mut rigid) = self.rigid.take() else { return };
        // The bodies these particles belong to; ANCHORED stands for all that is joined to anchored bone.
        let mut touched: Vec<u32> = severed
            .iter()
            .map(|&p| rigid.of_slot(self.layout.slot[p as usize]).map_or(ANCHORED, |body| body as u32))
            .collect();
        touched.sort_unstable();
        touched.dedup();
        let (mut changed, mut loose) = (false, Vec::new());
        for number in touched {
            let among = match number {
                ANCHORED => rigid.anchored(self),
                body => rigid.bodies[body as usize].particles().to_vec(),
            };
            let kind = self.assembly().rigid.as_ref().expect("bodies come from rigid parts").kind();
            let parts = components(self.lattice(), self.topology(), kind, &among);
            let (lattice, assembly, layout) = (self.lattice(), self.assembly(), &self.layout);
            if number == ANCHORED {
                for part in parts.into_iter().filter(|part| !part.anchored) {
                    let body = self.loose_body(part.particles);
                    loose.push(rigid.add(lattice, assembly, layout, body));
                }
            } else if parts.len() > 1 {
                changed = true;
                let whole = rigid.bodies[number as usize].clone();
                for (place, part) in parts.into_iter().enumerate() {
                    let body = whole.part(lattice, &assembly.mass, part.particles);
                    if place == 0 {
                        rigid.bodies[number as usize] = body;
                        rigid.claim(number as usize, lattice, assembly, layout);
                    } else {
                        rigid.add(lattice, assembly, layout, body);
                    }
                }
            }
        }
        self.rigid = Some(rigid);
        // Parts of bodies already are where they say, and are ready for the kick.
        changed |= !loose.is_empty();
        for body in loose {
            self.adopt(body);
            self.show_place(body);
            self.show_velocity(body);
        }
        if changed {
            self.hold_bodies();
        }
    }

    /// A part cut off from anchored ones: it goes on as its particles do in the mean, unturned, because anchored particles
    /// are only ever shifted. Where a grab had pulled them apart, they take their shape again.
    fn loose_body(&self, particles: Vec<u32>) -> RigidBody {
        let mut body = RigidBody::new(self.lattice(), self.mass(), particles);
        let mean = |of: &dyn Fn(u32) -> Vector3| -> Vector3 {
            let sum: Vector3 = body.particles().iter().map(|&p| of(p) * f64::from(self.mass()[p as usize])).sum();
            sum / body.mass()
        };
        let (offset, velocity) = (mean(&|p| self.displacement(p)), mean(&|p| self.velocity(p)));
        body.shift(offset);
        body.set_motion(velocity, Vector3::zeros());
        body
    }

    /// Prepares a new body's particles for the kick.
    fn adopt(&mut self, number: usize) {
        let dt = self.dt();
        let Self { rigid: Some(rigid), lattice, topology, assembly, layout, springs, dt_over_mass, .. } = self else {
            return;
        };
        let kind = assembly.rigid.as_ref().expect("bodies come from rigid parts").kind();
        for &particle in rigid.bodies[number].particles() {
            let slot = layout.slot[particle as usize];
            dt_over_mass[slot as usize] = 0.0;
            // Springs inside the body cancel out; left in, they would add their rounding. A living spring to a free particle
            // is inside, or the two would be one body.
            let alive = topology.alive()[particle as usize];
            for direction in (FIRST_FORWARD..NEIGHBOURS).filter(|d| alive >> d & 1 == 1) {
                let far = lattice.neighbour(particle, direction).expect("a living spring has two ends");
                if kind[far as usize] == RigidKind::Free {
                    springs.sever(slot, direction, layout.slot[far as usize], opposite(direction));
                }
            }
        }
        for &slot in &rigid.attached[number] {
            let particle = layout.particle_of_slot(lattice, slot as usize).expect("slots of particles");
            dt_over_mass[slot as usize] = (dt / f64::from(assembly.mass[particle as usize])) as f32;
        }
    }

    /// Writes the velocities of a body's particles now.
    fn show_velocity(&mut self, body: usize) {
        let Self { rigid: Some(rigid), lattice, layout, velocity, .. } = self else { return };
        let body = &rigid.bodies[body];
        show(body, lattice, layout, velocity, body.velocities());
    }

    /// Writes the displacements of a body's particles now.
    fn show_place(&mut self, body: usize) {
        let Self { rigid: Some(rigid), lattice, layout, displacement, .. } = self else { return };
        let body = &rigid.bodies[body];
        show(body, lattice, layout, displacement, body.displacements());
    }
}

/// Writes a vector for every particle of a body.
fn show(body: &RigidBody, lattice: &Lattice, layout: &BlockLayout, field: &mut [Vec<f32>; 3], map: PlaceMap) {
    for &particle in body.particles() {
        let vector = map.at(rest_place(lattice, particle));
        let slot = layout.slot[particle as usize] as usize;
        for axis in 0..3 {
            field[axis][slot] = vector[axis] as f32;
        }
    }
}

impl Bodies {
    /// Free particles joined to anchored ones, ascending.
    fn anchored(&self, world: &World) -> Vec<u32> {
        let of = |&slot: &u32| world.layout.particle_of_slot(&world.lattice, slot as usize);
        let slots = self.slots.iter().zip(&self.body).filter(|&(_, &body)| body == ANCHORED).map(|(slot, _)| slot);
        let mut particles: Vec<u32> = slots.filter_map(of).collect();
        particles.sort_unstable();
        particles
    }

    /// Writes a vector for every particle of all bodies; one map per body.
    fn write(&self, lattice: &Lattice, layout: &BlockLayout, field: &mut [Vec<f32>; 3], maps: &[PlaceMap]) {
        let [x, y, z] = field.each_mut().map(|part| part.par_chunks_exact_mut(BLOCK_LEN));
        (x, y, z).into_par_iter().enumerate().for_each(|(block, (x, y, z))| {
            let range = self.range(block);
            for (&slot, &body) in self.slots[range.clone()].iter().zip(&self.body[range]) {
                if body == ANCHORED {
                    continue;
                }
                let slot = slot as usize;
                let vector = maps[body as usize].at(place_of(lattice, layout.ijk_of_slot(slot)));
                for (axis, part) in [&mut *x, &mut *y, &mut *z].into_iter().enumerate() {
                    part[slot % BLOCK_LEN] = vector[axis] as f32;
                }
            }
        });
    }
}
