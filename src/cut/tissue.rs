//! Where the tissue is while a blade is tested, and which particles may be near a place.

use std::ops::Range;

use rayon::prelude::*;

use super::bounds::Bounds;
use crate::geometry::Vector3;
use crate::lattice::Lattice;
use crate::lattice::layout::{BLOCK, BLOCK_LEN, BlockLayout, NO_BLOCK, slot_in_block};

/// Box of the displacements in each block at one moment [m]: the least and the most along each axis. Slots without a particle
/// are at rest.
pub(crate) type Displaced = Vec<[[f32; 2]; 3]>;

/// The boxes of displacements in block order. Reads all of them: what is kept is not to be asked for again.
pub(crate) fn displaced(displacement: &[Vec<f32>; 3]) -> Displaced {
    let block =
        |block: usize| displacement.each_ref().map(|axis| extremes(&axis[block * BLOCK_LEN..(block + 1) * BLOCK_LEN]));
    (0..displacement[0].len() / BLOCK_LEN).into_par_iter().with_min_len(8).map(block).collect()
}

/// Where the particles are at the beginning and at the end of a test: they move along straight lines in between.
pub(crate) struct Tissue<'a> {
    pub(super) lattice: &'a Lattice,
    pub(super) layout: &'a BlockLayout,
    /// Displacements x, y, z [m] at the beginning and at the end: block order, lattice axes.
    moments: [&'a [Vec<f32>; 3]; 2],
    /// Their boxes.
    displaced: [&'a Displaced; 2],
    /// Box of all displacements during the test [m].
    farthest: Bounds,
}

/// Grid points of a block along each axis.
pub(super) type Part = [Range<usize>; 3];

impl<'a> Tissue<'a> {
    /// - `before`, `now`: displacement x, y, z [m] when the test begins and ends, with their boxes; the same twice for tissue
    ///   that stands still.
    pub(crate) fn new(
        lattice: &'a Lattice,
        layout: &'a BlockLayout,
        before: (&'a [Vec<f32>; 3], &'a Displaced),
        now: (&'a [Vec<f32>; 3], &'a Displaced),
    ) -> Self {
        let displaced = [before.1, now.1];
        let all = displaced.iter().flat_map(|moment| moment.iter());
        let farthest = all.fold(Bounds::EMPTY, |mut all, block| {
            all.include_displaced(block);
            all
        });
        Self { lattice, layout, moments: [before.0, now.0], displaced, farthest }
    }

    /// The blocks with grid points from which something that reaches so many pitches below and above them at rest may meet a
    /// box, ascending, each with these points; see [`Tissue::part_near`].
    pub(super) fn parts_near(&self, around: &Bounds, reach: [f64; 2]) -> Vec<(usize, Part)> {
        // Most blocks are too far away for any displacement that there is.
        let [least, most] = self.grid_range(around, &self.farthest, reach);
        let far = |block: &usize| {
            let corner = self.layout.corner(*block);
            (0..3).any(|axis| {
                most[axis] < corner[axis] as f64 || least[axis] > (corner[axis] + BLOCK[axis] as i64) as f64
            })
        };
        let near = (0..self.layout.blocks.len()).filter(|block| !far(block));
        near.filter_map(|block| Some((block, self.part_near(block, around, reach)?))).collect()
    }

    /// The least and the largest grid index along each axis from which something may meet a box, displaced within another one.
    fn grid_range(&self, around: &Bounds, displaced: &Bounds, [below, above]: [f64; 2]) -> [Vector3; 2] {
        // Rounded outwards: what is on the border is near.
        let pitch = self.lattice.pitch;
        let least = ((around.min - displaced.max) / pitch).add_scalar(-above - 1e-6);
        let most = ((around.max - displaced.min) / pitch).add_scalar(below + 1e-6);
        [least, most]
    }

    /// The grid points of a block from which something that reaches so many pitches below and above them at rest may meet a
    /// box, carried along with particles of the block and of those around it; `None` when there is none.
    fn part_near(&self, block: usize, around: &Bounds, reach: [f64; 2]) -> Option<Part> {
        let mut displaced = Bounds::EMPTY;
        for &neighbour in self.layout.neighbours[block].iter().filter(|&&neighbour| neighbour != NO_BLOCK) {
            self.displaced.iter().for_each(|moment| displaced.include_displaced(&moment[neighbour as usize]));
        }
        let [least, most] = self.grid_range(around, &displaced, reach);
        let corner = self.layout.corner(block);
        let range = |axis: usize| {
            let (corner, size) = (corner[axis] as f64, BLOCK[axis] as f64);
            let from = (least[axis] - corner).ceil().clamp(0.0, size);
            from as usize..((most[axis] - corner).floor() + 1.0).clamp(0.0, size) as usize
        };
        let part = [range(0), range(1), range(2)];
        (!part.iter().any(Range::is_empty)).then_some(part)
    }

    /// Displacement in a slot at the beginning and at the end [m].
    pub(super) fn displacements(&self, slot: usize) -> [Vector3; 2] {
        let [[x, y, z], [u, v, w]] = self.moments;
        let place = |x: f32, y: f32, z: f32| Vector3::new(f64::from(x), f64::from(y), f64::from(z));
        [place(x[slot], y[slot], z[slot]), place(u[slot], v[slot], w[slot])]
    }

    /// Place of a grid point of a block or beside it (indices from -1 to the block's size) at the beginning and at the end [m].
    pub(super) fn places(&self, block: usize, at: [i64; 3]) -> [Vector3; 2] {
        let corner = self.layout.corner(block);
        let rest = Vector3::from([0, 1, 2].map(|axis| (corner[axis] + at[axis]) as f64)) * self.lattice.pitch;
        match self.layout.slot_beside(block, at) {
            None => [rest; 2],
            Some(slot) => self.displacements(slot).map(|moved| rest + moved),
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
