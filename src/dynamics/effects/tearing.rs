//! Tearing: springs that are stretched too far are severed.
//!
//! A spring tears in the middle, at the end of the step in which its elastic strain `(l - L) / L`, less what it has yielded, exceeds
//! the tear strain of its organ. Cells with a torn spring have no volume term and no fibres from then on, as after a cut, and the
//! surface opens there. What the spring held is lost.
//!
//! One at the wall of two organs tears when its tension is what their parts bear together, and never beside tissue that does not
//! tear. A crack runs along the lattice's springs, so its path depends on the pitch, and so does the load under which it runs on from its
//! own tip (the strain there grows as cells get smaller): the tear strain is a property of tissue at a pitch.
//!
//! Source: springs that break at a strain, as in Terzopoulos and Fleischer, "Modeling inelastic deformation: viscoelasticity,
//! plasticity, fracture" (1988).

use rayon::prelude::*;

use super::inner_springs::{InnerScratch, beside};
use crate::dynamics::World;
use crate::dynamics::slot_constants::SlotConstants;
use crate::dynamics::springs::{Scratch, block_of};
use crate::dynamics::workers::Worker;
use crate::kernel::halo::gather_rows;
use crate::kernel::inner_length::{InnerState, InnerStep, overstretched};
use crate::kernel::laws::{MeanOfEnds, SumOfCells};
use crate::lattice::SeveredSpring;
use crate::lattice::layout::{BLOCK_LEN, BlockLayout};
use crate::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS};
use crate::material::TearingTerm;

/// Where a spring tears: 0 at one end, 1 at the other.
const MIDDLE: f32 = 0.5;

/// What the springs of a lattice bear.
#[derive(Debug, Clone)]
pub(in crate::dynamics) struct Tearing {
    /// Stiffness and threshold.
    constants: [SlotConstants; 2],
    /// Blocks in which springs that can tear can start.
    tears: Vec<bool>,
    /// Springs torn so far.
    torn: u64,
}

impl Tearing {
    pub(in crate::dynamics) fn new(layout: &BlockLayout, term: &TearingTerm) -> Self {
        let constants = [&term.stiffness, &term.threshold].map(|constants| SlotConstants::new(layout, constants));
        let own = |block: usize| {
            let [stiffness, threshold] = constants.each_ref().map(|constants| block_of(constants.values(), block));
            stiffness.iter().zip(threshold).any(|(&stiffness, &threshold)| stiffness > 0.0 && threshold.is_finite())
        };
        let own: Vec<bool> = (0..layout.blocks.len()).map(own).collect();
        Self { tears: beside(layout, &own), constants, torn: 0 }
    }

    /// Bytes held.
    pub(in crate::dynamics) fn bytes(&self) -> usize {
        4 * self.constants.iter().map(|constants| constants.values().len()).sum::<usize>()
    }
}

impl World {
    /// How many springs have torn so far; `None` when none can.
    pub fn torn(&self) -> Option<u64> {
        self.tearing.as_ref().map(|tearing| tearing.torn)
    }

    /// Severs every spring that is stretched beyond what it bears.
    pub(in crate::dynamics) fn tear(&mut self) {
        let Some(tearing) = &self.tearing else { return };
        let blocks = (0..self.layout.blocks.len()).into_par_iter().filter(|&block| tearing.tears[block]);
        let look = |block: usize, torn: Option<&mut Vec<SeveredSpring>>| {
            let Worker { scratch, inner, .. } = &mut *self.workers.own();
            let buffers = inner.get_or_insert_with(InnerScratch::new);
            let some = self.find_overstretched(tearing, block, scratch, buffers);
            if let Some(torn) = torn.filter(|_| some) {
                self.list(block, &buffers.found, torn);
            }
            some
        };
        // Nothing tears in most steps, and then no list is made.
        if !blocks.clone().any(|block| look(block, None)) {
            return;
        }
        let list = |block: usize| {
            let mut torn = Vec::new();
            look(block, Some(&mut torn));
            torn
        };
        let torn: Vec<SeveredSpring> = blocks.flat_map_iter(list).collect();
        let torn = self.sever(torn) as u64;
        if let Some(tearing) = &mut self.tearing {
            tearing.torn += torn;
        }
    }

    fn find_overstretched(
        &self,
        tearing: &Tearing,
        block: usize,
        scratch: &mut Scratch,
        buffers: &mut InnerScratch,
    ) -> bool {
        let (neighbours, rows) = (&self.layout.neighbours[block], self.layout.rows[block]);
        for (field, halo) in self.displacement.iter().zip(&mut scratch.displacement) {
            gather_rows(field, neighbours, rows, halo);
        }
        for (constants, halo) in tearing.constants.iter().zip(&mut buffers.halos.constants) {
            gather_rows(constants.values(), neighbours, rows, halo);
        }
        let step = InnerStep::new(self.lattice.pitch, self.dt);
        let state =
            InnerState { step, displacement: scratch.displacement.each_ref(), alive: self.living_springs(block) };
        let yielded = self.plasticity.as_ref().map(|springs| springs.of_block(block));
        let [stiffness, threshold, _] = &buffers.halos.constants;
        match tearing.constants[0].weight() {
            Some(weight) => {
                let [stiffness, threshold] = [stiffness, threshold].map(|cell| SumOfCells { cell, weight });
                overstretched(stiffness, threshold, state, yielded, &mut buffers.found)
            }
            None => {
                let [stiffness, threshold] = [stiffness, threshold].map(|particle| MeanOfEnds { particle });
                overstretched(stiffness, threshold, state, yielded, &mut buffers.found)
            }
        }
    }

    /// The springs of a block whose bits are set.
    fn list(&self, block: usize, found: &[u32; BLOCK_LEN], torn: &mut Vec<SeveredSpring>) {
        let time = self.time();
        for (inside, &bits) in found.iter().enumerate().filter(|&(_, &bits)| bits != 0) {
            let Some(particle) = self.layout.particle_of_slot(&self.lattice, block * BLOCK_LEN + inside) else {
                continue;
            };
            let directions = (FIRST_FORWARD..NEIGHBOURS).filter(|d| bits >> d & 1 == 1);
            torn.extend(directions.map(|d| SeveredSpring { particle, direction: d as u8, at: MIDDLE, time }));
        }
    }
}
