//! What is known of every cell of a lattice as a host before any point is asked for: which of its corners carry, wherever in it a point
//! lies.

use rayon::prelude::*;

use super::knife::Knife;
use crate::geometry::GridShape;
use crate::lattice::build::corners;
use crate::lattice::cells::cells_of_spring;
use crate::lattice::neighbours::{OFFSETS, direction_of};
use crate::lattice::{Lattice, NO_PARTICLE, Topology};

/// All eight corners.
pub(super) const ALL: u8 = u8::MAX;

/// What is known of a cell as a host.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct HostCell(u16);

/// All 28 springs live and no blade went in.
const WHOLE: u16 = 1 << 8;
/// A blade went in or a spring in it was severed.
const TOUCHED: u16 = 1 << 9;
/// It has corners, and which of them carry depends on where the point is.
const SIDED: u16 = 1 << 10;

impl HostCell {
    /// No corner is a particle.
    pub(super) fn is_void(self) -> bool {
        self.0 & (u16::from(ALL) | SIDED) == 0
    }

    /// All 28 springs between its corners are alive, and no blade went in.
    pub(super) fn is_whole(self) -> bool {
        self.0 & WHOLE != 0
    }

    /// The corners that carry every point of it (one bit each, x fastest); `None` when points have sides to choose.
    pub(super) fn carrying(self) -> Option<u8> {
        (self.0 & SIDED == 0).then_some(self.0 as u8)
    }
}

/// The states of all cells with a corner on the grid.
pub(super) struct HostCells {
    /// One cell more than points along each axis: the first cells begin one point before the grid.
    shape: GridShape,
    states: Vec<HostCell>,
}

impl HostCells {
    pub(super) fn new(lattice: &Lattice, topology: &Topology, knife: &Knife) -> Self {
        let points = lattice.grid.shape;
        let shape = GridShape::new(points.nx + 1, points.ny + 1, points.nz + 1);
        let mut states = vec![HostCell::default(); shape.len()];
        let mut touch = |cell: [i32; 3]| {
            if let Some(at) = place(shape, cell) {
                states[at].0 |= TOUCHED;
            }
        };
        knife.cells().for_each(&mut touch);
        for spring in topology.severed() {
            let offset = OFFSETS[usize::from(spring.direction)];
            let cells = cells_of_spring(points, lattice.ijk(spring.particle), offset);
            cells.for_each(|low| touch(points.ijk(low).map(|i| i as i32)));
        }
        let layer = shape.nx * shape.ny;
        states.par_chunks_mut(layer).enumerate().for_each(|(k, layer)| {
            for (at, state) in layer.iter_mut().enumerate() {
                let cell = [at % shape.nx, at / shape.nx, k].map(|i| i as i32 - 1);
                *state = state_of(lattice, topology, cell, *state);
            }
        });
        Self { shape, states }
    }

    /// The state of a cell by its lowest corner.
    pub(super) fn of(&self, cell: [i32; 3]) -> HostCell {
        place(self.shape, cell).map_or_else(HostCell::default, |at| self.states[at])
    }
}

fn place(shape: GridShape, cell: [i32; 3]) -> Option<usize> {
    let dims = shape.dims();
    let at = cell.map(|i| i64::from(i) + 1);
    let within = (0..3).all(|axis| at[axis] >= 0 && at[axis] < dims[axis] as i64);
    within.then(|| shape.linear(at.map(|i| i as usize)))
}

fn state_of(lattice: &Lattice, topology: &Topology, cell: [i32; 3], mut state: HostCell) -> HostCell {
    let particles = particles_of(lattice, cell);
    let present = present(&particles);
    if present == 0 {
        return HostCell::default();
    }
    let touched = state.0 & TOUCHED != 0;
    if present == ALL && !touched && topology.whole_cell(lattice, particles[0]).is_some() {
        state.0 |= WHOLE;
    }
    let knows = state.is_whole() || !touched && piece_of(topology, &particles, present) == present;
    state.0 |= if knows { u16::from(present) } else { SIDED };
    state
}

/// Particles of a cell's corners; [`NO_PARTICLE`] where there is none.
pub(super) fn particles_of(lattice: &Lattice, cell: [i32; 3]) -> [u32; 8] {
    let shape = lattice.grid.shape;
    let dims = shape.dims();
    if (0..3).all(|axis| cell[axis] >= 0 && (cell[axis] as usize) + 1 < dims[axis]) {
        return corners(shape, shape.linear(cell.map(|i| i as usize))).map(|point| lattice.particle_at[point]);
    }
    std::array::from_fn(|corner| {
        let point = [0, 1, 2].map(|axis| i64::from(cell[axis]) + (corner >> axis & 1) as i64);
        let within = (0..3).all(|axis| point[axis] >= 0 && point[axis] < dims[axis] as i64);
        if within { lattice.particle_at[shape.linear(point.map(|i| i as usize))] } else { NO_PARTICLE }
    })
}

/// Which corners are particles.
pub(super) fn present(particles: &[u32; 8]) -> u8 {
    (0..8).filter(|&corner| particles[corner] != NO_PARTICLE).fold(0, |bits, corner| bits | 1 << corner)
}

/// Of some corners of a cell those that living springs join to the first of them, directly or through others.
pub(super) fn piece_of(topology: &Topology, particles: &[u32; 8], left: u8) -> u8 {
    let mut piece = left & left.wrapping_neg();
    loop {
        let mut grown = piece;
        for near in (0..8).filter(|near| piece >> near & 1 == 1) {
            for far in (0..8).filter(|far| left >> far & 1 == 1) {
                let offset = [0, 1, 2].map(|axis| (far >> axis & 1) - (near >> axis & 1));
                let joined =
                    near != far && topology.alive()[particles[near as usize] as usize] >> direction_of(offset) & 1 == 1;
                grown |= u8::from(joined) << far;
            }
        }
        if grown == piece {
            return piece;
        }
        piece = grown;
    }
}
