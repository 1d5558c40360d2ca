//! One step of a world: new velocities block by block, what drives and stops them, new places.

use arrayvec::ArrayVec;
use rayon::prelude::*;

use super::effects::fibres::{CellFibres, FibreScratch};
use super::effects::inner_springs::InnerScratch;
use super::effects::plasticity::YieldedSprings;
use super::effects::relaxation::MaxwellBranches;
use super::rigid::Bodies;
use super::springs::{BlockInput, BlockSprings, block_of};
use super::step_error::StepError;
use super::volume::{CellScratch, CellVolumes};
use super::workers::{Worker, Workers};
use super::world::World;
use crate::kernel::block::StepConstants;
use crate::kernel::dispatch::Arithmetic;
use crate::kernel::halo::gather_rows;
use crate::kernel::inner_length::InnerStep;
use crate::lattice::layout::{BLOCK_LEN, BlockLayout};

/// At most so many neighbouring blocks are stepped in a row by one thread, which asks for the next one's state meanwhile.
const MOST_BLOCKS_PER_TASK: usize = 8;
/// Every thread gets at least so many tasks, if there are enough blocks, so that threads end together.
const TASKS_PER_THREAD: usize = 8;
/// Fields of that state: displacement, old and new velocity, weight, constants and living springs.
const MOST_AHEAD: usize = 13;

impl World {
    /// One step of symplectic Euler: new velocities from the forces at the old places, then new places. Or of the integrator
    /// that [`World::set_integrator`] chose.
    ///
    /// # Errors
    /// If a velocity is not finite or outruns the lattice; places are left as they were before the step, velocities are
    /// not (with another integrator both are those of the step that failed). If an integrator with a tolerance cannot meet it.
    pub fn step(&mut self) -> Result<(), StepError> {
        // Handed to the workers once: small lattices would wait for them longer than they compute.
        rayon::scope(|_| match self.integration.take() {
            None => self.step_among_workers(),
            Some(mut integration) => {
                let result = integration.step(self);
                self.integration = Some(integration);
                result
            }
        })
    }

    fn step_among_workers(&mut self) -> Result<(), StepError> {
        self.kick();
        self.load_bodies();
        // Lent to what changes velocities, and given back whatever happens.
        let mut fastest = std::mem::take(&mut self.next_fastest);
        self.apply_drives(&mut fastest);
        self.apply_drag(&mut fastest);
        self.advance_bodies(&mut fastest);
        self.touch_itself(&mut fastest);
        self.touch_obstacles(&mut fastest);
        let sound = self.check(&fastest).and_then(|()| self.watch_alternation(&fastest));
        self.next_fastest = fastest;
        sound?;
        std::mem::swap(&mut self.fastest_squared, &mut self.next_fastest);
        self.drift();
        self.note_moves_of_surface();
        self.settle_bodies();
        self.flow();
        self.tear();
        self.steps += 1;
        Ok(())
    }

    /// New velocities, and the largest squared speed of each block.
    fn kick(&mut self) {
        let step = StepConstants::new(self.lattice.pitch, self.dt, self.gravity.into());
        let damped = self.springs.damped();
        self.workers.prepare();
        let old_velocity: [&[f32]; 3] = [&[]; 3];
        // With dampers the neighbours' old velocities are read while new ones are written.
        let (old_velocity, out) = if damped {
            (self.velocity.each_ref().map(Vec::as_slice), self.next_velocity.each_mut())
        } else {
            (old_velocity, self.velocity.each_mut())
        };
        let kick = Kick {
            step,
            arithmetic: self.arithmetic,
            displacement: &self.displacement,
            old_velocity,
            from_rest: false,
            dt_over_mass: &self.dt_over_mass,
            layout: &self.layout,
            springs: &self.springs,
            cells: &self.cells,
            fibres: &self.fibres,
            inner_step: InnerStep::new(self.lattice.pitch, self.dt),
            relaxation: self.relaxation.as_deref(),
            plasticity: self.plasticity.as_deref(),
            rigid: self.rigid.as_deref(),
            workers: &self.workers,
            asleep: self.sleepers.as_ref().map(|sleepers| sleepers.asleep()),
        };
        kick.all(out, &mut self.next_fastest);
        if damped {
            std::mem::swap(&mut self.velocity, &mut self.next_velocity);
        }
    }

    /// What a step would add to velocities, at any places and velocities: the accelerations of springs, cells, gravity and
    /// dampers times the step, dampers reading the rate of length itself.
    ///
    /// - `kick` [m/s]: overwritten, 0 where nothing is free.
    pub(super) fn kick_at(&mut self, displacement: &[Vec<f32>; 3], velocity: &[Vec<f32>; 3], kick: &mut [Vec<f32>; 3]) {
        let gravity = (self.gravity * self.dt).into();
        // Dampers over no time at all; gravity, which counts per step, over the step.
        let step = StepConstants { dt: 0.0, ..StepConstants::new(self.lattice.pitch, 1.0, gravity) };
        self.workers.prepare();
        kick.iter_mut().for_each(|axis| axis.par_chunks_mut(16 * BLOCK_LEN).for_each(|axis| axis.fill(0.0)));
        let kicks = Kick {
            step,
            arithmetic: self.arithmetic,
            displacement,
            old_velocity: velocity.each_ref().map(Vec::as_slice),
            from_rest: true,
            dt_over_mass: &self.dt_over_mass,
            layout: &self.layout,
            springs: &self.springs,
            cells: &self.cells,
            fibres: &self.fibres,
            // What flows takes part in the plain step only.
            inner_step: InnerStep::new(self.lattice.pitch, self.dt),
            relaxation: None,
            plasticity: None,
            rigid: None,
            workers: &self.workers,
            asleep: None,
        };
        kicks.all(kick.each_mut(), &mut self.next_fastest);
    }

    /// Lets springs relax and yield at the new places.
    fn flow(&mut self) {
        let step = InnerStep::new(self.lattice.pitch, self.dt);
        let Self { displacement, layout, springs, relaxation, plasticity, workers, .. } = self;
        if let Some(branches) = relaxation {
            branches.flow(layout, displacement, springs.alive_slots(), step, workers);
        }
        if let Some(yielded) = plasticity {
            yielded.flow(layout, displacement, springs.alive_slots(), step, workers);
        }
    }

    fn drift(&mut self) {
        if let Some(sleepers) = self.sleepers.take() {
            return self.drift_awake(sleepers);
        }
        let dt = self.dt as f32;
        for axis in 0..3 {
            self.displacement[axis]
                .par_chunks_mut(16 * BLOCK_LEN)
                .zip(self.velocity[axis].par_chunks(16 * BLOCK_LEN))
                .for_each(|(displacement, velocity)| {
                    for (u, v) in displacement.iter_mut().zip(velocity) {
                        *u += dt * v;
                    }
                });
        }
    }
}

/// What the velocities of a step are computed from.
struct Kick<'a> {
    step: StepConstants,
    arithmetic: Arithmetic,
    displacement: &'a [Vec<f32>; 3],
    /// Read only with dampers.
    old_velocity: [&'a [f32]; 3],
    /// What is written starts from what it holds, not from the old velocity.
    from_rest: bool,
    dt_over_mass: &'a [f32],
    layout: &'a BlockLayout,
    springs: &'a BlockSprings,
    cells: &'a Option<CellVolumes>,
    fibres: &'a Option<Box<CellFibres>>,
    inner_step: InnerStep,
    relaxation: Option<&'a MaxwellBranches>,
    plasticity: Option<&'a YieldedSprings>,
    rigid: Option<&'a Bodies>,
    workers: &'a Workers,
    /// Blocks that are left as they are.
    asleep: Option<&'a [bool]>,
}

impl Kick<'_> {
    /// Adds to the velocities of all blocks; writes the largest squared speed of each.
    fn all(&self, [x, y, z]: [&mut Vec<f32>; 3], next_fastest: &mut [f32]) {
        let &Self { displacement, old_velocity, dt_over_mass, layout, springs, .. } = self;
        let damped = springs.damped();
        let tasks = TASKS_PER_THREAD * rayon::current_num_threads();
        let in_task = (layout.blocks.len() / tasks).clamp(1, MOST_BLOCKS_PER_TASK);
        let size = in_task * BLOCK_LEN;
        let groups = (x.par_chunks_mut(size), y.par_chunks_mut(size), z.par_chunks_mut(size));
        let groups = groups.into_par_iter().zip(next_fastest.par_chunks_mut(in_task));
        groups.enumerate().for_each(|(group, ((x, y, z), fastest))| {
            let Worker { scratch, cells: cell_scratch, fibres: fibre_scratch, inner } = &mut *self.workers.own();
            let mut rest = [x, y, z];
            for (place, fastest) in fastest.iter_mut().enumerate() {
                let block = group * in_task + place;
                let mut out = rest.each_mut().map(|rest| {
                    let (own, after) = std::mem::take(rest).split_at_mut(BLOCK_LEN);
                    *rest = after;
                    <&mut [f32; BLOCK_LEN]>::try_from(own).expect("whole blocks")
                });
                if self.asleep.is_some_and(|asleep| asleep[block]) {
                    *fastest = 0.0;
                    continue;
                }
                let mut ahead = ArrayVec::<&[f32; BLOCK_LEN], MOST_AHEAD>::new();
                if !rest[0].is_empty() {
                    ahead.extend(rest.iter().map(|rest| block_of(rest, 0)));
                    ahead.push(block_of(dt_over_mass, block + 1));
                    // Fields with halo: the halo of the next block has a layer of the one after it.
                    let after = (block + 2).min(layout.blocks.len() - 1);
                    ahead.extend(displacement.iter().map(|field| block_of(field, after)));
                    if damped {
                        ahead.extend(old_velocity.iter().map(|field| block_of(field, after)));
                    }
                    ahead.extend(springs.ahead(after));
                }
                let (neighbours, rows) = (&layout.neighbours[block], layout.rows[block]);
                for axis in 0..3 {
                    gather_rows(&displacement[axis], neighbours, rows, &mut scratch.displacement[axis]);
                }
                if damped {
                    for axis in 0..3 {
                        gather_rows(old_velocity[axis], neighbours, rows, &mut scratch.velocity[axis]);
                        if !self.from_rest {
                            out[axis].copy_from_slice(block_of(old_velocity[axis], block));
                        }
                    }
                }
                if let Some(rigid) = self.rigid {
                    rigid.clear_block(block, &mut out);
                }
                let mut force = match (self.fibres, self.cells) {
                    (None, None) => None,
                    (None, Some(cells)) => {
                        cells.forces(layout, block, scratch, cell_scratch.get_or_insert_with(CellScratch::new))
                    }
                    (Some(fibres), cells) => {
                        let own = cell_scratch.get_or_insert_with(CellScratch::new);
                        let halos = fibre_scratch.get_or_insert_with(FibreScratch::new);
                        fibres.forces(cells.as_ref(), layout, block, scratch, own, halos)
                    }
                };
                let relaxation = self.relaxation.filter(|springs| springs.acts_on(block));
                let plasticity = self.plasticity.filter(|springs| springs.acts_on(block));
                if relaxation.is_some() || plasticity.is_some() {
                    let InnerScratch { halos, force: own, .. } = &mut **inner.get_or_insert_with(InnerScratch::new);
                    let force = force.get_or_insert_with(|| {
                        *own = [[0.0; BLOCK_LEN]; 3];
                        own
                    });
                    let input = (&scratch.displacement, springs.alive(block), self.inner_step);
                    if let Some(branches) = relaxation {
                        branches.add_forces(layout, block, input, halos, force);
                    }
                    if let Some(yielded) = plasticity {
                        yielded.add_forces(layout, block, input, halos, force);
                    }
                }
                let dt_over_mass = block_of(dt_over_mass, block);
                let input = BlockInput { scratch, cells: force.map(|force| &*force), dt_over_mass, ahead: &ahead };
                *fastest = springs.kick(self.arithmetic, self.step, layout, block, input, out);
            }
        });
    }
}
