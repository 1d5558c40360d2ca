//! One step of a world: new velocities block by block, what drives and stops them, new places.

use arrayvec::ArrayVec;
use rayon::prelude::*;

use super::effects::fibres::FibreScratch;
use super::effects::inner_springs::InnerScratch;
use super::springs::{BlockInput, block_of};
use super::step_error::StepError;
use super::volume::CellScratch;
use super::workers::Worker;
use super::world::World;
use crate::kernel::block::StepConstants;
use crate::kernel::halo::gather_rows;
use crate::kernel::inner_length::InnerStep;
use crate::lattice::layout::BLOCK_LEN;

/// At most so many neighbouring blocks are stepped in a row by one thread, which asks for the next one's state meanwhile.
const MOST_BLOCKS_PER_TASK: usize = 8;
/// Every thread gets at least so many tasks, if there are enough blocks, so that threads end together.
const TASKS_PER_THREAD: usize = 8;
/// Fields of that state: displacement, old and new velocity, weight.
const MOST_AHEAD: usize = 10;

impl World {
    /// One step of symplectic Euler: new velocities from the forces at the old places, then new places.
    ///
    /// # Errors
    /// If a velocity is not finite or outruns the lattice; places are left as they were before the step, velocities are
    /// not.
    pub fn step(&mut self) -> Result<(), StepError> {
        // Handed to the workers once: small lattices would wait for them longer than they compute.
        rayon::scope(|_| self.step_among_workers())
    }

    fn step_among_workers(&mut self) -> Result<(), StepError> {
        self.kick();
        self.load_bodies();
        // Lent to what changes velocities, and given back whatever happens.
        let mut fastest = std::mem::take(&mut self.next_fastest);
        self.apply_drives(&mut fastest);
        self.apply_drag(&mut fastest);
        self.advance_bodies(&mut fastest);
        self.touch_obstacles(&mut fastest);
        let sound = self.check(&fastest).and_then(|()| self.watch_alternation(&fastest));
        self.next_fastest = fastest;
        sound?;
        std::mem::swap(&mut self.fastest_squared, &mut self.next_fastest);
        self.drift();
        self.settle_bodies();
        self.flow();
        self.tear();
        self.steps += 1;
        Ok(())
    }

    /// New velocities, and the largest squared speed of each block.
    fn kick(&mut self) {
        let step = StepConstants::new(self.lattice.pitch, self.dt, self.gravity.into());
        let inner_step = InnerStep::new(self.lattice.pitch, self.dt);
        let damped = self.springs.damped();
        let arithmetic = self.arithmetic;
        let rigid = self.rigid.as_deref();
        self.workers.prepare();
        let Self {
            displacement,
            velocity,
            next_velocity,
            next_fastest,
            dt_over_mass,
            layout,
            springs,
            cells,
            fibres,
            relaxation,
            plasticity,
            workers,
            ..
        } = self;
        let old_velocity: [&[f32]; 3] = [&[]; 3];
        // With dampers the neighbours' old velocities are read while new ones are written.
        let (old_velocity, [x, y, z]) = if damped {
            (velocity.each_ref().map(Vec::as_slice), next_velocity.each_mut())
        } else {
            (old_velocity, velocity.each_mut())
        };
        let tasks = TASKS_PER_THREAD * rayon::current_num_threads();
        let in_task = (layout.blocks.len() / tasks).clamp(1, MOST_BLOCKS_PER_TASK);
        let size = in_task * BLOCK_LEN;
        let groups = (x.par_chunks_mut(size), y.par_chunks_mut(size), z.par_chunks_mut(size));
        let groups = groups.into_par_iter().zip(next_fastest.par_chunks_mut(in_task));
        groups.enumerate().for_each(|(group, ((x, y, z), fastest))| {
            let Worker { scratch, cells: cell_scratch, fibres: fibre_scratch, inner } = &mut *workers.own();
            let mut rest = [x, y, z];
            for (place, fastest) in fastest.iter_mut().enumerate() {
                let block = group * in_task + place;
                let mut out = rest.each_mut().map(|rest| {
                    let (own, after) = std::mem::take(rest).split_at_mut(BLOCK_LEN);
                    *rest = after;
                    <&mut [f32; BLOCK_LEN]>::try_from(own).expect("whole blocks")
                });
                let mut ahead = ArrayVec::<&[f32; BLOCK_LEN], MOST_AHEAD>::new();
                if !rest[0].is_empty() {
                    ahead.extend(rest.iter().map(|rest| block_of(rest, 0)));
                    ahead.extend(displacement.iter().map(|field| block_of(field, block + 1)));
                    if damped {
                        ahead.extend(old_velocity.iter().map(|field| block_of(field, block + 1)));
                    }
                    ahead.push(block_of(dt_over_mass, block + 1));
                }
                let (neighbours, rows) = (&layout.neighbours[block], layout.rows[block]);
                for axis in 0..3 {
                    gather_rows(&displacement[axis], neighbours, rows, &mut scratch.displacement[axis]);
                }
                if damped {
                    for axis in 0..3 {
                        gather_rows(old_velocity[axis], neighbours, rows, &mut scratch.velocity[axis]);
                        out[axis].copy_from_slice(block_of(old_velocity[axis], block));
                    }
                }
                if let Some(rigid) = rigid {
                    rigid.clear_block(block, &mut out);
                }
                let mut force = match (&*fibres, &*cells) {
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
                let relaxation = relaxation.as_ref().filter(|springs| springs.acts_on(block));
                let plasticity = plasticity.as_ref().filter(|springs| springs.acts_on(block));
                if relaxation.is_some() || plasticity.is_some() {
                    let InnerScratch { halos, force: own, .. } = &mut **inner.get_or_insert_with(InnerScratch::new);
                    let force = force.get_or_insert_with(|| {
                        *own = [[0.0; BLOCK_LEN]; 3];
                        own
                    });
                    let input = (&scratch.displacement, springs.alive(block), inner_step);
                    if let Some(branches) = relaxation {
                        branches.add_forces(layout, block, input, halos, force);
                    }
                    if let Some(yielded) = plasticity {
                        yielded.add_forces(layout, block, input, halos, force);
                    }
                }
                let dt_over_mass = block_of(dt_over_mass, block);
                let input = BlockInput { scratch, cells: force.map(|force| &*force), dt_over_mass, ahead: &ahead };
                *fastest = springs.kick(arithmetic, step, layout, block, input, out);
            }
        });
        if damped {
            std::mem::swap(velocity, next_velocity);
        }
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
