//! What a lattice's springs hold back of their lengthening, in block order: common to [`super::relaxation`] and
//! [`super::plasticity`], which say what it means.

use std::marker::PhantomData;

use rayon::prelude::*;

use crate::dynamics::slot_constants::SlotConstants;
use crate::dynamics::springs::block_of;
use crate::dynamics::workers::{Worker, Workers};
use crate::kernel::halo::{HALO_LEN, Halo, gather_rows};
use crate::kernel::inner_length::{Flow, InnerLengths, InnerState, InnerStep, STARTING, add_inner_forces, flow};
use crate::kernel::laws::{MeanOfEnds, SumOfCells};
use crate::lattice::layout::{BLOCK_LEN, BlockLayout, NO_BLOCK};
use crate::material::SpringConstants;

/// Buffers of one worker thread.
pub(in crate::dynamics) struct InnerScratch {
    pub(in crate::dynamics) halos: InnerHalos,
    /// Springs of a block that tear.
    pub(super) found: [u32; BLOCK_LEN],
    /// Forces on a block on which no cell acts.
    pub(in crate::dynamics) force: [[f32; BLOCK_LEN]; 3],
}

/// What a block's springs are computed from, with halo.
pub(in crate::dynamics) struct InnerHalos {
    pub(super) constants: [Halo; 3],
    inner: [Halo; STARTING],
}

impl InnerScratch {
    pub(in crate::dynamics) fn new() -> Box<Self> {
        let halos = InnerHalos { constants: [[0.0; HALO_LEN]; 3], inner: [[0.0; HALO_LEN]; STARTING] };
        Box::new(Self { halos, found: [0; BLOCK_LEN], force: [[0.0; BLOCK_LEN]; 3] })
    }
}

/// Inner lengthenings of all springs.
#[derive(Debug, Clone)]
pub(in crate::dynamics) struct InnerSprings<F> {
    /// Stiffness, rate and threshold, see [`flow`].
    constants: [SlotConstants; 3],
    /// Of the springs that start at each slot: block by block, direction by direction [m].
    inner: Vec<f32>,
    /// Blocks in which springs that flow can start.
    flows: Vec<bool>,
    /// Blocks in which a spring that holds something back starts.
    holds: Vec<bool>,
    /// Blocks that feel what springs hold back: those in which some does, and all beside them.
    feels: Vec<bool>,
    law: PhantomData<F>,
}

impl<F: Flow> InnerSprings<F> {
    /// - `acts`: whether a constant, stiffness and threshold at a slot, is that of a spring that can flow.
    pub(super) fn new(layout: &BlockLayout, constants: [&SpringConstants; 3], acts: impl Fn(f32, f32) -> bool) -> Self {
        let constants = constants.map(|constants| SlotConstants::new(layout, constants));
        let [stiffness, _, threshold] = constants.each_ref().map(SlotConstants::values);
        let own = |block: usize| {
            let pairs = block_of(stiffness, block).iter().zip(block_of(threshold, block));
            pairs.into_iter().any(|(&stiffness, &threshold)| acts(stiffness, threshold))
        };
        let own: Vec<bool> = (0..layout.blocks.len()).map(own).collect();
        let flows = beside(layout, &own);
        let feels = if F::ONLY_WHAT_IS_HELD { vec![false; flows.len()] } else { beside(layout, &flows) };
        Self {
            constants,
            inner: vec![0.0; layout.blocks.len() * STARTING * BLOCK_LEN],
            holds: vec![false; flows.len()],
            flows,
            feels,
            law: PhantomData,
        }
    }

    /// What the spring that starts at a slot holds back [m].
    ///
    /// - `start`: which of those that start there.
    pub(in crate::dynamics) fn held_back(&self, slot: u32, start: usize) -> f32 {
        let (block, inside) = (slot as usize / BLOCK_LEN, slot as usize % BLOCK_LEN);
        self.inner[(block * STARTING + start) * BLOCK_LEN + inside]
    }

    /// What the springs that start in a block hold back.
    pub(super) fn of_block(&self, block: usize) -> &InnerLengths {
        let own = &self.inner[block * STARTING * BLOCK_LEN..][..STARTING * BLOCK_LEN];
        own.as_chunks().0.try_into().expect("one block")
    }

    /// Lets springs flow for one step, as they are stretched now.
    pub(in crate::dynamics) fn flow(
        &mut self,
        layout: &BlockLayout,
        displacement: &[Vec<f32>; 3],
        alive: &[u32],
        step: InnerStep,
        workers: &Workers,
    ) {
        let Self { constants, inner, flows, holds, feels, .. } = self;
        let blocks = inner.par_chunks_mut(STARTING * BLOCK_LEN).zip(holds.par_iter_mut()).enumerate();
        blocks.filter(|&(block, _)| flows[block]).for_each(|(block, (own, holds))| {
            let (neighbours, rows) = (&layout.neighbours[block], layout.rows[block]);
            let Worker { scratch, inner, .. } = &mut *workers.own();
            let buffers = inner.get_or_insert_with(InnerScratch::new);
            for (field, halo) in displacement.iter().zip(&mut scratch.displacement) {
                gather_rows(field, neighbours, rows, halo);
            }
            for (constants, halo) in constants.iter().zip(&mut buffers.halos.constants) {
                gather_rows(constants.values(), neighbours, rows, halo);
            }
            let displacement = scratch.displacement.each_ref();
            let state = InnerState { step, displacement, alive: block_of(alive, block) };
            let own = own.as_chunks_mut().0.try_into().expect("one block");
            let law = F::default();
            *holds = match constants[0].weight() {
                Some(weight) => {
                    let [k, rate, threshold] =
                        buffers.halos.constants.each_ref().map(|cell| SumOfCells { cell, weight });
                    flow(law, k, rate, threshold, state, own)
                }
                None => {
                    let [k, rate, threshold] =
                        buffers.halos.constants.each_ref().map(|particle| MeanOfEnds { particle });
                    flow(law, k, rate, threshold, state, own)
                }
            };
        });
        if F::ONLY_WHAT_IS_HELD {
            for (feels, around) in feels.iter_mut().zip(&layout.neighbours) {
                *feels = any_of(around, holds);
            }
        }
    }

    /// Whether the particles of a block feel any of it.
    pub(in crate::dynamics) fn acts_on(&self, block: usize) -> bool {
        self.feels[block]
    }

    /// Adds the forces on the particles of a block to those of its cells [N].
    ///
    /// `displacement` with halo [m]; `alive`: living springs of the block's slots.
    pub(in crate::dynamics) fn add_forces(
        &self,
        layout: &BlockLayout,
        block: usize,
        (displacement, alive, step): (&[Halo; 3], &[u32; BLOCK_LEN], InnerStep),
        InnerHalos { constants: [constants, ..], inner }: &mut InnerHalos,
        force: &mut [[f32; BLOCK_LEN]; 3],
    ) {
        if !self.feels[block] {
            return;
        }
        let (neighbours, rows) = (&layout.neighbours[block], layout.rows[block]);
        gather_rows(self.constants[0].values(), neighbours, rows, constants);
        for (start, halo) in inner.iter_mut().enumerate() {
            // The arrays of a block follow each other: that of this direction is a block of its own.
            let place =
                |&block: &u32| if block == NO_BLOCK { NO_BLOCK } else { block * STARTING as u32 + start as u32 };
            gather_rows(&self.inner, &neighbours.each_ref().map(place), rows, halo);
        }
        let state = InnerState { step, displacement: displacement.each_ref(), alive };
        match self.constants[0].weight() {
            Some(weight) => add_inner_forces(F::default(), SumOfCells { cell: constants, weight }, state, inner, force),
            None => add_inner_forces(F::default(), MeanOfEnds { particle: constants }, state, inner, force),
        }
    }

    /// Bytes held.
    pub(in crate::dynamics) fn bytes(&self) -> usize {
        4 * (self.inner.len() + self.constants.iter().map(|constants| constants.values().len()).sum::<usize>())
    }
}

/// The blocks named, and all that border on one.
pub(super) fn beside(layout: &BlockLayout, blocks: &[bool]) -> Vec<bool> {
    layout.neighbours.iter().map(|around| any_of(around, blocks)).collect()
}

fn any_of(around: &[u32; 27], blocks: &[bool]) -> bool {
    around.iter().any(|&block| block != NO_BLOCK && blocks[block as usize])
}
