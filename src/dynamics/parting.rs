//! How fast and how far neighbours have parted, block by block: what tells which blocks' shapes may have changed.
//!
//! However fast a body flies or swings, its shape and with it its stable step stay; so velocities are compared within cells
//! and along springs. Measuring costs about a tenth of a step (`kernel::parting`), and nothing where all is slow.

use rayon::prelude::*;

use super::world::World;
use crate::kernel::dispatch::{InstructionSet, widest_cell_of_block};
use crate::kernel::halo::{HALO_LEN, HALO_ROW, Halo, gather, gather_rows};
use crate::kernel::parting::fastest_spring;
use crate::lattice::layout::{BLOCK_LEN, NO_BLOCK};
use crate::lattice::neighbours::NEIGHBOURS;

/// Places among the 27 blocks around of a block and those below it along one axis or more.
const BELOW: [usize; 8] = [0, 1, 3, 4, 9, 10, 12, 13];
/// The same of a block and those above it.
const ABOVE: [usize; 8] = [13, 14, 16, 17, 22, 23, 25, 26];

/// Parting of the neighbours in each block of a world.
pub(super) struct Parting {
    /// 1 where a particle is, else 0.
    present: Vec<f32>,
    /// Rows of each block's halo that hold a particle.
    rows: Vec<u128>,
    /// Cells do not tell how fast the block's neighbours part: a spring has been severed, so that some hold particles that part
    /// as they like, or a cell has its lowest corner where there is no block.
    by_springs: Vec<bool>,
    /// Severed springs that `by_springs` knows of.
    severed: usize,
    /// Twice the fastest particle of the block and of those around it [m/s]: no two part faster.
    at_most: Vec<f64>,
    /// Corners of the cells whose lowest one is in the block part at most so fast [m/s].
    cells: Vec<f64>,
    /// Neighbours of the block part at most so fast [m/s].
    speed: Vec<f64>,
    /// They may have parted by so much since the block was last forgotten [m].
    moved: Vec<f64>,
}

impl Parting {
    pub(super) fn new(world: &World) -> Self {
        let blocks = world.layout.blocks.len();
        let mut present = vec![0.0; world.layout.slots()];
        for &slot in &world.layout.slot {
            present[slot as usize] = 1.0;
        }
        let by_springs = world.layout.neighbours.iter().map(has_lost_cells).collect();
        let mut halo = Box::new([0.0; HALO_LEN]);
        let rows = world.layout.neighbours.iter().map(|neighbours| {
            gather(&present, neighbours, &mut halo);
            let held = halo.as_chunks::<HALO_ROW>().0.iter().map(|row| row.iter().any(|&held| held > 0.0));
            held.enumerate().fold(0, |rows, (row, held)| rows | u128::from(held) << row)
        });
        Self {
            rows: rows.collect(),
            present,
            by_springs,
            severed: 0,
            at_most: vec![0.0; blocks],
            cells: vec![0.0; blocks],
            speed: vec![0.0; blocks],
            moved: vec![0.0; blocks],
        }
    }

    pub(super) fn blocks(&self) -> usize {
        self.speed.len()
    }

    /// Takes note of a step just taken. Neighbours in blocks where no particle moved further than half of `short` [m] are not
    /// compared, but taken to part as fast as they can.
    pub(super) fn stepped(&mut self, world: &World, short: f64) {
        self.notice_cuts(world);
        let dt = world.dt();
        let set = world.arithmetic().set();
        let Self { present, rows, by_springs, at_most, cells, speed, moved, .. } = self;
        for (block, at_most) in at_most.iter_mut().enumerate() {
            let around = world.layout.neighbours[block].iter().filter(|&&neighbour| neighbour != NO_BLOCK);
            let squared = around.map(|&other| world.fastest_of_blocks()[other as usize]).fold(0.0, f32::max);
            *at_most = 2.0 * f64::from(squared).sqrt();
        }
        let (present, rows, by_springs, at_most) = (&*present, &*rows, &*by_springs, &*at_most);
        let slow = |block: usize| at_most[block] * dt <= short;
        cells.par_iter_mut().enumerate().with_min_len(4).for_each_init(Buffers::new, |buffers, (block, cells)| {
            if slow(block) {
                *cells = at_most[block];
                return;
            }
            let touched = ABOVE.iter().map(|&place| world.layout.neighbours[block][place]);
            let by_cells = |other: u32| other != NO_BLOCK && !by_springs[other as usize] && !slow(other as usize);
            // Nobody asks otherwise.
            if touched.into_iter().any(by_cells) {
                *cells = buffers.widest_cell(set, world, present, rows[block], block);
            }
        });
        let cells = &*cells;
        speed.par_iter_mut().zip(moved).enumerate().with_min_len(4).for_each_init(
            Buffers::new,
            |buffers, (block, to)| {
                let (speed, moved) = to;
                *speed = if slow(block) {
                    at_most[block]
                } else if by_springs[block] {
                    buffers.fastest_spring(world, block)
                } else {
                    // Its own cells and those of the seven blocks below are all that touch it.
                    let touching = BELOW.iter().map(|&place| world.layout.neighbours[block][place]);
                    let widest = touching.filter(|&other| other != NO_BLOCK).map(|other| cells[other as usize]);
                    at_most[block].min(widest.fold(0.0, f64::max))
                };
                *moved += *speed * dt;
            },
        );
    }

    /// Neighbours of a block may have parted by so much since it was forgotten [m].
    pub(super) fn moved(&self, block: usize) -> f64 {
        self.moved[block]
    }

    pub(super) fn forget(&mut self, block: usize) {
        self.moved[block] = 0.0;
    }

    /// The largest speed at which joined particles part or meet [m/s]; `slow` when none is faster than that.
    pub(super) fn fastest(&self, world: &World, slow: f64) -> f64 {
        let fast: Vec<usize> = (0..self.speed.len()).filter(|&block| self.speed[block] > slow).collect();
        let exact = |buffers: &mut Box<Buffers>, block| buffers.fastest_spring(world, block);
        fast.into_par_iter().map_init(Buffers::new, exact).reduce(|| slow, f64::max)
    }

    fn notice_cuts(&mut self, world: &World) {
        let severed = world.topology().severed();
        let lattice = world.lattice();
        for spring in &severed[self.severed..] {
            let far = lattice.neighbour(spring.particle, usize::from(spring.direction));
            for end in [Some(spring.particle), far].into_iter().flatten() {
                // The corners of the spring's cells are neighbours of its ends.
                let around = (0..NEIGHBOURS).filter_map(|direction| lattice.neighbour(end, direction));
                for corner in around.chain([end]) {
                    self.by_springs[world.layout.slot[corner as usize] as usize / BLOCK_LEN] = true;
                }
            }
        }
        self.severed = severed.len();
    }
}

/// Whether a spring can join the block to one at another edge while the lowest corner of their only common cell lies in a block
/// that does not exist.
fn has_lost_cells(neighbours: &[u32; 27]) -> bool {
    (0..27).filter(|&place| neighbours[place] != NO_BLOCK).any(|place| {
        // Of the two blocks the lower along each axis.
        let lowest: usize =
            [place % 3, place / 3 % 3, place / 9].iter().zip([1, 3, 9]).map(|(&at, s)| at.min(1) * s).sum();
        neighbours[lowest] == NO_BLOCK
    })
}

struct Buffers {
    velocity: [Halo; 3],
    present: Halo,
}

impl Buffers {
    fn new() -> Box<Self> {
        Box::new(Self { velocity: [[0.0; HALO_LEN]; 3], present: [0.0; HALO_LEN] })
    }

    /// The velocity of some rows, the others read as 0.
    fn gather_velocity(&mut self, world: &World, block: usize, rows: u128) {
        for (field, halo) in world.velocity.iter().zip(&mut self.velocity) {
            gather_rows(field, &world.layout.neighbours[block], rows, halo);
        }
    }

    fn widest_cell(&mut self, set: InstructionSet, world: &World, present: &[f32], rows: u128, block: usize) -> f64 {
        self.gather_velocity(world, block, rows);
        gather_rows(present, &world.layout.neighbours[block], rows, &mut self.present);
        f64::from(widest_cell_of_block(set, self.velocity.each_ref(), &self.present)).sqrt()
    }

    fn fastest_spring(&mut self, world: &World, block: usize) -> f64 {
        self.gather_velocity(world, block, world.layout.rows[block]);
        f64::from(fastest_spring(self.velocity.each_ref(), world.living_springs(block))).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Affine, Grid, GridShape, Point3, Vector3};
    use crate::lattice::build::{NO_ORGAN, build};
    use crate::lattice::layout::BLOCK;
    use crate::material::paper::{PaperBody, assemble};
    use crate::volume::Volume;

    /// Two particles that meet at the edge of their blocks; the lowest corner of their cell lies where there is no block.
    #[test]
    fn a_spring_over_the_edge_of_two_blocks_is_seen() {
        let shape = GridShape::new(64, 32, 1);
        let grid = Grid { shape, affine: Affine::from_spacing([1.0; 3], [0.0; 3]).unwrap() };
        // Full, so that blocks begin where these do.
        let blocks = [[1, 0], [0, 1], [3, 3]];
        let full = |[i, j, _]: [usize; 3]| blocks.contains(&[i / BLOCK[0], j / BLOCK[1]]);
        let organs = (0..shape.len()).map(|l| if full(shape.ijk(l)) { 0 } else { NO_ORGAN }).collect();
        let lattice = build(&Volume::from_vec(grid, organs)).unwrap();
        let at = |place: [f64; 3]| (0..lattice.len() as u32).find(|&p| lattice.rest_place(p) == Point3::from(place));
        let [left, right, far] = [[16.0, 7.0, 0.0], [15.0, 8.0, 0.0], [48.0, 24.0, 0.0]].map(|ijk| at(ijk).unwrap());
        let assembly = assemble(&lattice, &[Some(PaperBody { stiffness: 1e-9, damping: 0.0, mass: 1.0 })]);
        let mut world = World::new(lattice, assembly, 0.01);
        assert_eq!(world.layout.blocks.len(), 3);
        world.set_velocity(left, Vector3::new(0.0, 3e-3, 0.0));
        world.set_velocity(right, Vector3::new(0.0, -4e-3, 0.0));
        let mut parting = Parting::new(&world);
        world.step().unwrap();
        parting.stepped(&world, 0.0);
        let block = |particle: u32| world.layout.slot[particle as usize] as usize / BLOCK_LEN;
        for particle in [left, right] {
            assert!((parting.moved(block(particle)) / (7e-3 * 0.01) - 1.0).abs() < 1e-5);
        }
        assert_eq!(parting.moved(block(far)), 0.0);
    }
}
