//! Where each particle lives in memory: blocks of 16 x 8 x 8 grid points, only those that hold particles.
//!
//! Organs fill a third of their bounding box, so arrays over the whole box would be mostly air. A block is small enough
//! for its arrays to stay in the first-level cache while it is stepped, and its rows are one AVX-512 register long.
//! Inside a block, and from block to block, x runs fastest.

use super::block_lead::best_lead;
use super::{Lattice, NO_PARTICLE};

/// Grid points along each axis of a block.
pub const BLOCK: [usize; 3] = [16, 8, 8];
/// Grid points of a block.
pub const BLOCK_LEN: usize = BLOCK[0] * BLOCK[1] * BLOCK[2];
/// Marks a neighbouring block that holds no particle.
pub const NO_BLOCK: u32 = u32::MAX;

/// The map from particles to slots in block order.
///
/// Arrays in block order have `blocks.len() * BLOCK_LEN` slots; slots of grid points without a particle are unused.
#[derive(Debug, Clone)]
pub struct BlockLayout {
    /// For each block the block at each of the 27 offsets (x fastest, itself at 13), or [`NO_BLOCK`].
    pub neighbours: Vec<[u32; 27]>,
    /// For each block the rows, halo included, that can matter to its particles: those that hold one, and all beside them. Bit
    /// `(z + 1) * (BLOCK[1] + 2) + (y + 1)` for the row at (y, z), each from -1 to the block's size.
    pub rows: Vec<u128>,
    /// Block coordinates (block index along x, y, z) of each block, ascending with x fastest.
    pub blocks: Vec<[u32; 3]>,
    /// Grid index of the first grid point of block (0, 0, 0): at or before the smallest of any particle along each axis, where
    /// blocks are best filled.
    pub origin: [i64; 3],
    /// Slot of each particle. Shape `[particles]`.
    pub slot: Vec<u32>,
}

impl BlockLayout {
    /// Lays out a lattice.
    ///
    /// # Panics
    /// If the lattice would need more than 2^32 slots (about 4 billion grid points).
    pub fn new(lattice: &Lattice) -> Self {
        let shape = lattice.grid.shape;
        let mut first = shape.dims();
        let mut end = [0; 3];
        for &point in &lattice.points {
            let ijk = shape.ijk(point as usize);
            for axis in 0..3 {
                first[axis] = first[axis].min(ijk[axis]);
                end[axis] = end[axis].max(ijk[axis] + 1);
            }
        }
        let within = |point: u32| {
            let ijk = shape.ijk(point as usize);
            [0, 1, 2].map(|axis| ijk[axis] - first[axis])
        };
        let extent = [0, 1, 2].map(|axis| end[axis].saturating_sub(first[axis]));
        let lead = best_lead(extent, lattice.points.iter().map(|&point| within(point)));
        let origin = [0, 1, 2].map(|axis| first[axis] as i64 - lead[axis] as i64);
        let local = |point: u32| {
            let within = within(point);
            [0, 1, 2].map(|axis| within[axis] + lead[axis])
        };
        let counts = [0, 1, 2].map(|axis| (extent[axis] + lead[axis]).div_ceil(BLOCK[axis]));
        let table_index = |b: [usize; 3]| (b[2] * counts[1] + b[1]) * counts[0] + b[0];
        let mut table = vec![NO_BLOCK; counts.iter().product()];
        for &point in &lattice.points {
            let ijk = local(point);
            table[table_index([0, 1, 2].map(|axis| ijk[axis] / BLOCK[axis]))] = 0;
        }
        let mut blocks = Vec::new();
        for z in 0..counts[2] {
            for y in 0..counts[1] {
                for x in 0..counts[0] {
                    let entry = &mut table[table_index([x, y, z])];
                    if *entry != NO_BLOCK {
                        *entry = blocks.len() as u32;
                        blocks.push([x as u32, y as u32, z as u32]);
                    }
                }
            }
        }
        assert!(blocks.len() * BLOCK_LEN < u32::MAX as usize, "a lattice has fewer than 2^32 slots");
        let neighbours = blocks
            .iter()
            .map(|block| {
                std::array::from_fn(|place| {
                    let offset = [place % 3, place / 3 % 3, place / 9];
                    let at = [0, 1, 2].map(|axis| (block[axis] as usize + offset[axis]).wrapping_sub(1));
                    if (0..3).all(|axis| at[axis] < counts[axis]) { table[table_index(at)] } else { NO_BLOCK }
                })
            })
            .collect();
        let slot: Vec<u32> = lattice
            .points
            .iter()
            .map(|&point| {
                let ijk = local(point);
                let block = table[table_index([0, 1, 2].map(|axis| ijk[axis] / BLOCK[axis]))];
                block * BLOCK_LEN as u32 + slot_in_block([0, 1, 2].map(|axis| ijk[axis] % BLOCK[axis])) as u32
            })
            .collect();
        let mut rows = vec![0; blocks.len()];
        for &slot in &slot {
            let (block, inside) = (slot as usize / BLOCK_LEN, slot as usize % BLOCK_LEN);
            rows[block] |= rows_beside(inside / BLOCK[0] % BLOCK[1], inside / (BLOCK[0] * BLOCK[1]));
        }
        Self { neighbours, rows, blocks, origin, slot }
    }

    /// Number of slots of an array in block order.
    pub fn slots(&self) -> usize {
        self.blocks.len() * BLOCK_LEN
    }

    /// Grid index of a block's first grid point; blocks at the border can begin before the grid.
    pub fn corner(&self, block: usize) -> [i64; 3] {
        [0, 1, 2].map(|axis| self.origin[axis] + i64::from(self.blocks[block][axis]) * BLOCK[axis] as i64)
    }

    /// Grid index of a slot's grid point; slots at the border can lie outside the grid.
    pub fn ijk_of_slot(&self, slot: usize) -> [i64; 3] {
        let corner = self.corner(slot / BLOCK_LEN);
        let inside = slot % BLOCK_LEN;
        let local = [inside % BLOCK[0], inside / BLOCK[0] % BLOCK[1], inside / (BLOCK[0] * BLOCK[1])];
        [0, 1, 2].map(|axis| corner[axis] + local[axis] as i64)
    }

    /// Slot of a grid point of a block or beside it (indices from -1 to the block's size); `None` where there is no block.
    pub fn slot_beside(&self, block: usize, at: [i64; 3]) -> Option<usize> {
        let (mut beside, mut inside) = (0, [0; 3]);
        for axis in (0..3).rev() {
            let size = BLOCK[axis] as i64;
            beside = 3 * beside + (at[axis].div_euclid(size) + 1) as usize;
            inside[axis] = at[axis].rem_euclid(size) as usize;
        }
        let neighbour = self.neighbours[block][beside];
        (neighbour != NO_BLOCK).then(|| neighbour as usize * BLOCK_LEN + slot_in_block(inside))
    }

    /// The particle in a slot, if any.
    pub fn particle_of_slot(&self, lattice: &Lattice, slot: usize) -> Option<u32> {
        let ijk = self.ijk_of_slot(slot);
        let dims = lattice.grid.shape.dims();
        if (0..3).any(|axis| !(0..dims[axis] as i64).contains(&ijk[axis])) {
            return None;
        }
        let point = lattice.grid.shape.linear(ijk.map(|index| index as usize));
        Some(lattice.particle_at[point]).filter(|&particle| particle != NO_PARTICLE)
    }
}

/// The row at (y, z) of a block and the eight around it, see [`BlockLayout::rows`].
const fn rows_beside(y: usize, z: usize) -> u128 {
    const PLANE: usize = BLOCK[1] + 2;
    let three_rows = 0b111 << y;
    (three_rows | three_rows << PLANE | three_rows << (2 * PLANE)) << (z * PLANE)
}

/// Slot of a local grid index inside its block.
pub const fn slot_in_block([i, j, k]: [usize; 3]) -> usize {
    (k * BLOCK[1] + j) * BLOCK[0] + i
}
