//! The state of a lattice and one step of it.

use std::collections::HashMap;

use rayon::prelude::*;

use super::alternation::AlternationWatch;
use super::drive::{Claims, Drive};
use super::effects::Drag;
use super::effects::contact::Contact;
use super::effects::fibres::CellFibres;
use super::effects::plasticity::YieldedSprings;
use super::effects::relaxation::MaxwellBranches;
use super::effects::self_contact::SelfContact;
use super::effects::sleep::Sleepers;
use super::effects::tearing::Tearing;
use super::integrator::Integration;
use super::rigid::Bodies;
use super::springs::BlockSprings;
use super::step_error::StepError;
use super::volume::CellVolumes;
use super::workers::Workers;
use crate::cut::{Crossing, CutSheet, Displaced, SheetRecorder, Sweep, Tissue, crossings, displaced};
use crate::geometry::{Matrix3, Vector3};
use crate::kernel::dispatch::Arithmetic;
use crate::lattice::layout::{BLOCK_LEN, BlockLayout};
use crate::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS, opposite};
use crate::lattice::{Lattice, SeveredSpring, Topology};
use crate::material::{Assembly, Inelastic, RigidKind, SpringConstants};

/// Where the particles of a world were at some moment.
#[derive(Debug, Clone)]
pub struct Moment {
    displacement: [Vec<f32>; 3],
    displaced: Displaced,
}

/// A lattice in motion.
///
/// State is f32, in lattice axes and SI units; positions are kept as displacements from rest, which resolves strains of
/// 1e-7 anywhere in the lattice. Times are f64. Methods take and give patient axes (RAS+) where they say so.
///
/// Same lattice, same calls: same bits, at any number of threads.
#[derive(Debug, Clone)]
pub struct World {
    pub(super) lattice: Lattice,
    pub(super) topology: Topology,
    pub(super) assembly: Assembly,
    pub(super) layout: BlockLayout,
    pub(super) springs: BlockSprings,
    /// `None` when no cell has a volume term: then nothing is stored, loaded or computed for it.
    pub(super) cells: Option<CellVolumes>,
    /// `None` when no cell has fibres: the same.
    pub(super) fibres: Option<Box<CellFibres>>,
    /// `None` when no spring relaxes, yields or tears: the same.
    pub(super) relaxation: Option<Box<MaxwellBranches>>,
    pub(super) plasticity: Option<Box<YieldedSprings>>,
    pub(super) tearing: Option<Box<Tearing>>,
    /// Displacement x, y, z of each slot [m].
    pub(super) displacement: [Vec<f32>; 3],
    /// Velocity x, y, z of each slot [m/s].
    pub(super) velocity: [Vec<f32>; 3],
    /// New velocities while the old ones are still read by neighbours, and those of the step before between steps; empty
    /// without dampers.
    pub(super) next_velocity: [Vec<f32>; 3],
    /// `None` without dampers: then a step that is too long shows by itself.
    pub(super) alternation: Option<AlternationWatch>,
    /// Step over mass [s/kg]; 0 for held, grabbed and anchored particles and for empty slots. Particles of rigid bodies have
    /// their own mass here if they feel soft tissue, else 0.
    pub(super) dt_over_mass: Vec<f32>,
    /// Of the slots that have any.
    pub(super) claims: HashMap<u32, Claims>,
    pub(super) drives: Vec<Drive>,
    /// Rigid parts that move; `None` without any, which then cost nothing.
    pub(super) rigid: Option<Box<Bodies>>,
    /// What soft particles may not enter; `None` without any obstacle, which then costs nothing.
    pub(super) contact: Option<Box<Contact>>,
    /// `None` where tissue may pass through tissue, which then costs nothing.
    pub(super) self_contact: Option<Box<SelfContact>>,
    /// `None` where every block is stepped.
    pub(super) sleepers: Option<Box<Sleepers>>,
    /// Patient axes to lattice axes.
    axes: Matrix3,
    pub(super) gravity: Vector3,
    pub(super) arithmetic: Arithmetic,
    /// `None` for the plain step, symplectic Euler.
    pub(super) integration: Option<Box<Integration>>,
    /// `None` without drag.
    pub(super) drag: Option<Drag>,
    pub(super) dt: f64,
    pub(super) steps: u64,
    /// Time and number of steps when the step was last changed.
    since: (f64, u64),
    /// Largest squared speed of each block in the last step [m^2/s^2].
    pub(super) fastest_squared: Vec<f32>,
    /// The same while a step is under way.
    pub(super) next_fastest: Vec<f32>,
    pub(super) workers: Workers,
    /// Where blades went, at rest.
    sheet: SheetRecorder,
}

impl World {
    /// A lattice at rest.
    ///
    /// - `dt`: time step [s]; see [`super::stable_dt`] for the largest that is stable.
    ///
    /// # Panics
    /// If the assembly is not the lattice's, `dt` is not positive, or a free rigid particle has no mass; if cells have a
    /// volume term or fibres although the springs are not sums over cells, or its viscosity comes without damped springs (old
    /// velocities are kept only for these).
    pub fn new(lattice: Lattice, assembly: Assembly, dt: f64) -> Self {
        assert_eq!(assembly.mass.len(), lattice.len(), "one mass per particle");
        assert!(dt > 0.0 && dt.is_finite(), "the step is a positive time");
        let layout = BlockLayout::new(&lattice);
        let topology = Topology::new(&lattice);
        let springs = BlockSprings::new(&layout, &assembly, topology.alive());
        let by_cells = matches!(assembly.stiffness, SpringConstants::SumOfCells { .. });
        let fibres = assembly.fibres.as_ref().map(|term| {
            assert!(by_cells, "only springs that are sums over cells are joined by fibres");
            Box::new(CellFibres::new(&lattice, &layout, &topology, term, dt))
        });
        let cells = assembly.volume.as_ref().map(|term| {
            assert!(by_cells, "only springs that are sums over cells are joined by a volume term");
            assert!(term.viscosity.is_none() || springs.damped(), "a volume term with viscosity needs damped springs");
            CellVolumes::new(&lattice, &layout, &topology, term, dt)
        });
        let inelastic = assembly.inelastic.as_ref();
        let relaxation = inelastic.and_then(|terms| terms.relaxation.as_ref());
        let plasticity = inelastic.and_then(|terms| terms.plasticity.as_ref());
        let tearing = inelastic.and_then(|terms| terms.tearing.as_ref());
        let zeros = || [0, 1, 2].map(|_| vec![0.0; layout.slots()]);
        let next_velocity = if springs.damped() { zeros() } else { [const { Vec::new() }; 3] };
        let alternation = springs.damped().then(|| AlternationWatch::new(layout.blocks.len()));
        let rigid = Bodies::new(&lattice, &topology, &assembly, &layout).map(Box::new);
        let axes = lattice.grid.affine.linear().transpose() * (1e-3 / lattice.pitch);
        let mut world = Self {
            relaxation: relaxation.map(|term| Box::new(MaxwellBranches::of(&layout, term))),
            plasticity: plasticity.map(|term| Box::new(YieldedSprings::of(&layout, term))),
            tearing: tearing.map(|term| Box::new(Tearing::new(&layout, term))),
            displacement: zeros(),
            velocity: zeros(),
            next_velocity,
            alternation,
            dt_over_mass: vec![0.0; layout.slots()],
            claims: HashMap::new(),
            drives: Vec::new(),
            rigid,
            contact: None,
            self_contact: None,
            sleepers: None,
            axes,
            gravity: Vector3::zeros(),
            arithmetic: Arithmetic::default(),
            integration: None,
            drag: None,
            dt,
            steps: 0,
            since: (0.0, 0),
            fastest_squared: vec![0.0; layout.blocks.len()],
            next_fastest: vec![0.0; layout.blocks.len()],
            workers: Workers::default(),
            sheet: SheetRecorder::default(),
            lattice,
            topology,
            assembly,
            layout,
            springs,
            cells,
            fibres,
        };
        for particle in 0..world.lattice.len() {
            world.refresh(world.layout.slot[particle]);
        }
        world.adopt_bodies();
        world
    }

    /// The rest state.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// The living and the severed springs.
    pub fn topology(&self) -> &Topology {
        &self.topology
    }

    /// Masses and spring constants.
    pub fn assembly(&self) -> &Assembly {
        &self.assembly
    }

    /// Mass of each particle [kg]; 0 for rigid organs that stay where they are.
    pub fn mass(&self) -> &[f32] {
        &self.assembly.mass
    }

    /// Time step [s].
    pub fn dt(&self) -> f64 {
        self.dt
    }

    /// Steps taken.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Simulated time [s].
    pub fn time(&self) -> f64 {
        self.since.0 + (self.steps - self.since.1) as f64 * self.dt
    }

    /// Changes the time step from the next step on [s]. O(particles) unless it stays the same.
    ///
    /// # Panics
    /// If `dt` is not positive.
    pub fn set_dt(&mut self, dt: f64) {
        assert!(dt > 0.0 && dt.is_finite(), "the step is a positive time");
        if dt == self.dt {
            return;
        }
        self.since = (self.time(), self.steps);
        self.dt = dt;
        if let Some(cells) = &mut self.cells {
            cells.set_dt(self.lattice.pitch, dt);
        }
        if let Some(fibres) = &mut self.fibres {
            fibres.set_dt(self.lattice.pitch, dt);
        }
        for (particle, &slot) in self.layout.slot.iter().enumerate() {
            let weight = &mut self.dt_over_mass[slot as usize];
            // Held and rigid particles keep their 0.
            if *weight > 0.0 {
                *weight = (dt / f64::from(self.assembly.mass[particle])) as f32;
            }
        }
    }

    /// Living springs of a block's slots, one bit per direction.
    pub(super) fn living_springs(&self, block: usize) -> &[u32; BLOCK_LEN] {
        self.springs.alive(block)
    }

    pub(super) fn too_stiff(&self, limit: f64, particle: u32, most_parts: u64) -> StepError {
        StepError::TooStiff { time: self.time(), place: self.lattice.rest_place(particle), limit, most_parts }
    }

    /// How forces are computed.
    pub fn arithmetic(&self) -> Arithmetic {
        self.arithmetic
    }

    /// Computes forces otherwise from the next step on.
    pub fn set_arithmetic(&mut self, arithmetic: Arithmetic) {
        self.arithmetic = arithmetic;
    }

    /// Sets the acceleration of every free particle, RAS+ [m/s^2].
    pub fn set_gravity(&mut self, gravity: Vector3) {
        let gravity = self.to_lattice_axes(gravity);
        if gravity != std::mem::replace(&mut self.gravity, gravity) {
            self.wake_all();
        }
    }

    /// Displacement of a particle from rest, lattice axes [m].
    pub fn displacement(&self, particle: u32) -> Vector3 {
        let slot = self.layout.slot[particle as usize] as usize;
        Vector3::from([0, 1, 2].map(|axis| f64::from(self.displacement[axis][slot])))
    }

    /// Velocity of a particle, lattice axes [m/s]; of a rigid body's its mean over the last step, which leads from place to
    /// place along the chord.
    pub fn velocity(&self, particle: u32) -> Vector3 {
        let slot = self.layout.slot[particle as usize] as usize;
        Vector3::from([0, 1, 2].map(|axis| f64::from(self.velocity[axis][slot])))
    }

    /// Puts a particle somewhere: displacement from rest, lattice axes [m]. One of a rigid body takes the body along.
    pub fn set_displacement(&mut self, particle: u32, displacement: Vector3) {
        if let Some(body) = self.rigid_body_of(particle) {
            return self.place_body(body, particle, displacement);
        }
        let slot = self.layout.slot[particle as usize];
        for axis in 0..3 {
            self.displacement[axis][slot as usize] = displacement[axis] as f32;
        }
        self.forget_clearance(slot);
        self.wake_around(slot);
    }

    /// Gives a particle a velocity, lattice axes [m/s]. One of a rigid body gives it to the whole body, which stops turning;
    /// see also [`World::set_rigid_motion`].
    pub fn set_velocity(&mut self, particle: u32, velocity: Vector3) {
        if let Some(body) = self.rigid_body_of(particle) {
            return self.set_rigid_motion(body, velocity, Vector3::zeros());
        }
        let slot = self.layout.slot[particle as usize] as usize;
        for axis in 0..3 {
            self.velocity[axis][slot] = velocity[axis] as f32;
        }
        self.wake(slot as u32);
    }

    /// Displacement of every particle from rest, RAS+ [mm]. Shape `[particles, 3]`.
    pub fn displacements_mm(&self) -> Vec<[f32; 3]> {
        let to_patient = self.axes.transpose() * 1e3;
        (0..self.lattice.len() as u32)
            .into_par_iter()
            .map(|particle| {
                let moved = to_patient * self.displacement(particle);
                [moved.x as f32, moved.y as f32, moved.z as f32]
            })
            .collect()
    }

    /// A vector from patient axes (RAS+) to lattice axes; the unit stays.
    pub fn to_lattice_axes(&self, patient: Vector3) -> Vector3 {
        self.axes * patient
    }

    /// A vector from lattice axes to patient axes (RAS+); the unit stays.
    pub fn to_patient_axes(&self, local: Vector3) -> Vector3 {
        self.axes.tr_mul(&local)
    }

    /// Share of blocks whose springs are all alive and alike, which the fastest body steps.
    pub fn alike_share(&self) -> f64 {
        self.springs.alike_blocks() as f64 / self.layout.blocks.len() as f64
    }

    /// Bytes held per particle by state, springs, cells and lattice.
    pub fn bytes_per_particle(&self) -> f64 {
        let slots = self.layout.slots();
        let fields = if self.springs.damped() { 9 } else { 6 };
        let state = slots * 4 * (fields + 1) + self.claims.len() * size_of::<(u32, Claims)>();
        // Grid point, organ, springs, slot and mass; a second copy of the springs once one is severed.
        let severed = if self.topology.severed().is_empty() { 0 } else { 4 };
        let lattice = self.lattice.len() * (4 + 1 + 4 + 4 + 4 + severed)
            + 4 * self.lattice.particle_at.len()
            + self.lattice.cell_organ.len()
            + 4 * self.lattice.cell_fill.len();
        let Assembly { stiffness, damping, inelastic, .. } = &self.assembly;
        let constants = stiffness.bytes()
            + damping.as_ref().map_or(0, SpringConstants::bytes)
            + inelastic.as_ref().map_or(0, Inelastic::bytes);
        let rigid = self.rigid.as_ref().map_or(0, |rigid| rigid.bytes());
        // Once in block order, once as assembled.
        let assembled = self.assembly.volume.as_ref();
        let assembled = assembled.map_or(0, |term| term.modulus.len() + term.viscosity.as_ref().map_or(0, Vec::len));
        let cells = self.cells.as_ref().map_or(0, CellVolumes::bytes) + 4 * assembled;
        let fibres = self.fibres.as_ref().map_or(0, |fibres| fibres.bytes() + 12 * self.lattice.len());
        let contact = self.contact.as_ref().map_or(0, |contact| contact.bytes())
            + self.self_contact.as_ref().map_or(0, |contact| contact.bytes());
        let inner = self.relaxation.as_ref().map_or(0, |springs| springs.bytes())
            + self.plasticity.as_ref().map_or(0, |springs| springs.bytes())
            + self.tearing.as_ref().map_or(0, |tearing| tearing.bytes());
        let sleepers = self.sleepers.as_ref().map_or(0, |sleepers| sleepers.bytes());
        let integration = self.integration.as_ref().map_or(0, |integration| integration.bytes(slots));
        (state
            + integration
            + self.springs.bytes()
            + cells
            + fibres
            + inner
            + lattice
            + constants
            + rigid
            + contact
            + sleepers) as f64
            / self.lattice.len() as f64
    }

    /// What the springs that start at a particle hold back: in their Maxwell branches, and yielded [m].
    pub(super) fn held_back(&self, particle: u32) -> [[f64; 2]; NEIGHBOURS - FIRST_FORWARD] {
        let slot = self.layout.slot[particle as usize];
        std::array::from_fn(|start| {
            let relaxed = self.relaxation.as_ref().map_or(0.0, |springs| springs.held_back(slot, start));
            let yielded = self.plasticity.as_ref().map_or(0.0, |springs| springs.held_back(slot, start));
            [relaxed, yielded].map(f64::from)
        })
    }

    /// Energy of the spring that starts at a particle in a forward direction, stretched by so much [m]: of what has not yielded,
    /// and of its Maxwell branch [J].
    pub(super) fn spring_energy(&self, particle: u32, direction: usize, stretch: f64) -> f64 {
        let slot = self.layout.slot[particle as usize];
        let elastic = |constants: &SpringConstants, held_back: f64| {
            0.5 * constants.of(&self.lattice, particle, direction) * (stretch - held_back).powi(2)
        };
        let start = direction - FIRST_FORWARD;
        let yielded = self.plasticity.as_ref().map_or(0.0, |springs| f64::from(springs.held_back(slot, start)));
        let mut energy = elastic(&self.assembly.stiffness, yielded);
        let term = self.assembly.inelastic.as_ref().and_then(|inelastic| inelastic.relaxation.as_ref());
        if let (Some(term), Some(branches)) = (term, &self.relaxation) {
            energy += elastic(&term.stiffness, f64::from(branches.held_back(slot, start)));
        }
        energy
    }

    /// Where every particle is now, for a later [`World::cut_since`].
    pub fn moment(&self) -> Moment {
        Moment { displacement: self.displacement.clone(), displaced: displaced(&self.displacement) }
    }

    /// The same in place of an earlier moment, whose memory is taken.
    fn remember(&self, moment: &mut Moment, displaced: Displaced) {
        for (kept, now) in moment.displacement.iter_mut().zip(&self.displacement) {
            let kept = kept.par_chunks_mut(16 * BLOCK_LEN);
            kept.zip(now.par_chunks(16 * BLOCK_LEN)).for_each(|(kept, now)| kept.copy_from_slice(now));
        }
        moment.displaced = displaced;
    }

    /// Sweeps a blade through the lattice as it stands now and severs every spring the edge passes through; returns how
    /// many.
    pub fn cut(&mut self, sweep: &Sweep) -> usize {
        self.pass(None, sweep).0
    }

    /// The same while the particles moved, along straight lines, from where they were to where they are now.
    pub fn cut_since(&mut self, before: &Moment, sweep: &Sweep) -> usize {
        self.pass(Some(before), sweep).0
    }

    /// [`World::cut_since`]; then the moment is the present one.
    pub fn cut_and_remember(&mut self, moment: &mut Moment, sweep: &Sweep) -> usize {
        rayon::scope(|_| {
            let (count, displaced) = self.pass(Some(moment), sweep);
            self.remember(moment, displaced);
            count
        })
    }

    /// Where blades have gone so far, as it lies at rest.
    pub fn cut_sheet(&self) -> &CutSheet {
        self.sheet.sheet()
    }

    /// Severs what a blade passes through; returns how many springs that were, and the boxes of the present displacements.
    fn pass(&mut self, before: Option<&Moment>, sweep: &Sweep) -> (usize, Displaced) {
        // Handed to the workers once.
        rayon::scope(|_| {
            let time = self.time();
            let boxes = displaced(&self.displacement);
            let now = (&self.displacement, &boxes);
            let before = before.map_or(now, |moment| (&moment.displacement, &moment.displaced));
            let tissue = Tissue::new(&self.lattice, &self.layout, before, now);
            let found = crossings(&tissue, &self.topology, sweep);
            self.sheet.record(&tissue, sweep, &found, time);
            let severed = |c: Crossing| SeveredSpring { particle: c.particle, direction: c.direction, at: c.at, time };
            (self.sever(found.into_iter().map(severed)), boxes)
        })
    }

    /// Severs the given springs; returns how many of them were alive.
    ///
    /// # Panics
    /// If a direction is not a forward one, or has no neighbour.
    pub fn sever(&mut self, springs: impl IntoIterator<Item = SeveredSpring>) -> usize {
        let mut count = 0;
        // A free end of every spring between rigid particles.
        let mut freed = Vec::new();
        for spring in springs {
            if self.topology.sever(&self.lattice, spring) {
                let direction = usize::from(spring.direction);
                let far = self.lattice.neighbour(spring.particle, direction).expect("a spring has two ends");
                let slot = |particle: u32| self.layout.slot[particle as usize];
                let ends = [slot(spring.particle), slot(far)];
                self.springs.sever(ends[0], direction, ends[1], opposite(direction));
                ends.into_iter().for_each(|end| self.wake_around(end));
                if let Some(cells) = &mut self.cells {
                    for cell in self.lattice.cells_of_spring(spring.particle, direction) {
                        cells.drop_cell(&self.lattice, &self.layout, cell);
                    }
                }
                if let Some(fibres) = &mut self.fibres {
                    for cell in self.lattice.cells_of_spring(spring.particle, direction) {
                        fibres.drop_cell(&self.lattice, &self.layout, cell);
                    }
                }
                count += 1;
                if let Some(parts) = &self.assembly.rigid {
                    let ends = [spring.particle, far];
                    let kind = ends.map(|end| parts.kind()[end as usize]);
                    if !kind.contains(&RigidKind::Soft) {
                        freed.extend((0..2).find(|&end| kind[end] == RigidKind::Free).map(|end| ends[end]));
                    }
                }
            }
        }
        if !freed.is_empty() {
            self.split_bodies(&freed);
        }
        count
    }

    /// Steps every block with the general body from now on. Same bits, slower: for tests and measurements.
    pub fn forget_alike_blocks(&mut self) {
        self.springs.forget_alike_blocks();
        if let Some(cells) = &mut self.cells {
            cells.forget_alike_blocks();
        }
        if let Some(fibres) = &mut self.fibres {
            fibres.forget_alike_blocks();
        }
    }

    /// Largest distance any particle covered in the last step [m]; 0 before the first.
    pub fn longest_move(&self) -> f64 {
        f64::from(self.fastest_squared.iter().copied().fold(0.0, f32::max)).sqrt() * self.dt
    }

    /// Largest squared speed of each block in the last step [m^2/s^2]; 0 before the first.
    pub(super) fn fastest_of_blocks(&self) -> &[f32] {
        &self.fastest_squared
    }

    /// Brings a slot's weight in line with who claims it.
    pub(super) fn refresh(&mut self, slot: u32) {
        self.wake(slot);
        let claims = self.claims_on(slot);
        // Bodies are held and grabbed as wholes; what is joined to anchored bone moves like it.
        let mut fixed = false;
        if let Some(rigid) = &self.rigid {
            if rigid.of_slot(slot).is_some() {
                return;
            }
            fixed = rigid.is_anchored(slot);
        }
        let particle = self.layout.particle_of_slot(&self.lattice, slot as usize);
        let mass = particle.filter(|_| !fixed).map_or(0.0, |particle| f64::from(self.assembly.mass[particle as usize]));
        let free = claims == Claims::default() && mass > 0.0;
        self.dt_over_mass[slot as usize] = if free { (self.dt / mass) as f32 } else { 0.0 };
        // Rigid organs only move while something moves them.
        if claims.holds > 0 || (mass == 0.0 && claims.grabs == 0) {
            for velocity in &mut self.velocity {
                velocity[slot as usize] = 0.0;
            }
        }
    }
}
