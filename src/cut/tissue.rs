//! Where the tissue is while a blade is tested, and which particles may be near a place.

use std::ops::Range;

use rayon::prelude::*;

use super::bounds::Bounds;
use crate::geometry::Vector3;
use crate::lattice::Lattice;
use crate::lattice::layout::{BLOCK, BLOCK_LEN, BlockLayout, NO_BLOCK, slot_in_block};

/// Where the particles are at the beginning and at the end of a test: they move along straight lines in between.
pub(crate) struct Tissue<'a> {
    pub(super) lattice: &'a Lattice,
    pub(super) layout: &'a BlockLayout,
    /// Displacements x, y, z [m] at the beginning and at the end: block order, lattice axes.
    moments: [&'a [Vec<f32>; 3]; 2],
    /// Box of the displacements in each block during the test [m]; slots without a particle are at rest.
    displaced: Vec<Bounds>,
}

/// Grid points of a block along each axis.
pub(super) type Part = [Range<usize>; 3];

impl<'a> Tissue<'a> {
    /// - `before`, `now`: displacement x, y, z [m] when the test begins and ends; the same twice for tissue that stands still.
    pub(crate) fn new(
        lattice: &'a Lattice,
        layout: &'a BlockLayout,
        before: &'a [Vec<f32>; 3],
        now: &'a [Vec<f32>; 3],
    ) -> Self {
        let moments = [before, now];
        let displaced = (0..layout.blocks.len()).into_par_iter().map(|block| {
            let mut bounds = Bounds::EMPTY;
            for moment in moments {
                for axis in 0..3 {
                    let [low, high] = extremes(&moment[axis][block * BLOCK_LEN..(block + 1) * BLOCK_LEN]);
                    bounds.min[axis] = bounds.min[axis].min(f64::from(low));
                    bounds.max[axis] = bounds.max[axis].max(f64::from(high));
                }
            }
            bounds
        });
        Self { lattice, layout, moments, displaced: displaced.collect() }
    }

    /// The grid points of a block from which something that reaches so many pitches below and above them at rest may meet a
    /// box, carried along with particles of the block and of those around it; `None` when there is none.
    pub(super) fn part_near(&self, block: usize, around: &Bounds, [below, above]: [f64; 2]) -> Option<Part> {
        let pitch = self.lattice.pitch;
        let blocks = self.layout.neighbours[block].iter().filter(|&&neighbour| neighbour != NO_BLOCK);
        let displaced = blocks.fold(Bounds::EMPTY, |all, &neighbour| all.joined(self.displaced[neighbour as usize]));
        let corner = self.layout.corner(block);
        let range = |axis: usize| {
            let least = (around.min[axis] - displaced.max[axis]) / pitch - above - corner[axis] as f64;
            let most = (around.max[axis] - displaced.min[axis]) / pitch + below - corner[axis] as f64;
            // Rounded outwards: what is on the border is near.
            let size = BLOCK[axis] as f64;
            (least - 1e-6).ceil().clamp(0.0, size) as usize..((most + 1e-6).floor() + 1.0).clamp(0.0, size) as usize
        };
        let part = [range(0), range(1), range(2)];
        (!part.iter().any(Range::is_empty)).then_some(part)
    }

    /// Displacement in a slot at the beginning and at the end [m].
    pub(super) fn displacements(&self, slot: usize) -> [Vector3; 2] {
        self.moments.map(|moment| Vector3::from([0, 1, 2].map(|axis| f64::from(moment[axis][slot]))))
    }

    /// Place of a grid point of a block or beside it (indices from -1 to the block's size) at the beginning and at the end [m].
    pub(super) fn places(&self, block: usize, at: [i64; 3]) -> [Vector3; 2] {
        let corner = self.layout.corner(block);
        let rest = Vector3::from([0, 1, 2].map(|axis| (corner[axis] + at[axis]) as f64)) * self.lattice.pitch;
        let beside = [0, 1, 2].map(|axis| at[axis].div_euclid(BLOCK[axis] as i64) + 1);
        let inside = [0, 1, 2].map(|axis| at[axis].rem_euclid(BLOCK[axis] as i64) as usize);
        match self.layout.neighbours[block][((beside[2] * 3 + beside[1]) * 3 + beside[0]) as usize] {
            NO_BLOCK => [rest; 2],
            block => self.displacements(block as usize * BLOCK_LEN + slot_in_block(inside)).map(|moved| rest + moved),
        }
    }
}

/// The smallest and the largest of whole rows of values, in lanes so that the compiler can take a register at a time.
fn extremes(values: &[f32]) -> [f32; 2] {
    let (mut low, mut high) = ([f32::MAX; BLOCK[0]], [f32::MIN; BLOCK[0]]);
    for row in values.as_chunks::<{ BLOCK[0] }>().0 {
        for lane in 0..BLOCK[0] {
            low[lane] = if row[lane] < low[lane] { row[lane] } else { low[lane] };
            high[lane] = if row[lane] > high[lane] { row[lane] } else { high[lane] };
        }
    }
    [low.into_iter().fold(f32::MAX, f32::min), high.into_iter().fold(f32::MIN, f32::max)]
}

/// Slots of a part of a block, ascending, from the block's first on.
pub(super) fn slots_of(part: &Part) -> impl Iterator<Item = usize> + use<> {
    let [x, y, z] = part.clone();
    z.flat_map(move |k| {
        let (x, y) = (x.clone(), y.clone());
        y.flat_map(move |j| x.clone().map(move |i| slot_in_block([i, j, k])))
    })
}
