//! Which cell of the lattice carries a point, and with which of its corners.
//!
//! A point rides in the cell that holds it, by trilinear interpolation of the corners' displacements. Where a blade went, a
//! corner carries only the points of its own side: those it sees without looking through the sheet, as far as living springs
//! of the cell join it to most of the others they see. The other corners are replaced by virtual ones, continued from those
//! that carry, so that each side of a cut moves as if the tissue went on, and the sides part evenly towards the end of the cut.
//!
//! # Source
//! The corners that are seen: Belytschko, Lu and Gu, Element-free Galerkin methods, 1994 ("visibility criterion"). The corners
//! that are continued: Molino, Bao and Fedkiw, A virtual node algorithm for changing mesh topology during simulation, 2004.

use std::collections::HashMap;

use super::knife::Knife;
use crate::geometry::{CellSet, Vector3};
use crate::lattice::build::corners;
use crate::lattice::cells::cells_of_spring;
use crate::lattice::neighbours::{OFFSETS, direction_of};
use crate::lattice::{Lattice, NO_PARTICLE, Topology};

/// A cell and the corners (one bit each, x fastest) that carry.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct Host {
    /// Grid index of the lowest corner.
    pub(super) cell: [i32; 3],
    pub(super) carrying: u8,
}

/// All eight corners.
const ALL: u8 = u8::MAX;

/// Finds hosts.
pub(super) struct Hosts<'a> {
    lattice: &'a Lattice,
    topology: &'a Topology,
    knife: &'a Knife,
    /// Cells a blade went into, by its sheet or by a severed spring.
    touched: CellSet<[i32; 3]>,
}

impl<'a> Hosts<'a> {
    pub(super) fn new(lattice: &'a Lattice, topology: &'a Topology, knife: &'a Knife) -> Self {
        let mut touched: CellSet<[i32; 3]> = knife.cells().collect();
        let shape = lattice.grid.shape;
        for spring in topology.severed() {
            let offset = OFFSETS[usize::from(spring.direction)];
            let cells = cells_of_spring(shape, lattice.ijk(spring.particle), offset);
            touched.extend(cells.map(|low| shape.ijk(low).map(|i| i as i32)));
        }
        Self { lattice, topology, knife, touched }
    }

    /// The host of a point, by its index coordinates in the lattice.
    pub(super) fn host(&self, point: Vector3) -> Host {
        let cell = self.cell(point);
        let carrying = if self.is_whole(cell) { ALL } else { self.side(cell, self.present(cell), point) };
        Host { cell, carrying }
    }

    /// Whether the cell that holds a point is whole: then the point hangs together with every neighbour whose cell is.
    pub(super) fn is_plain(&self, point: Vector3) -> bool {
        self.is_whole([0, 1, 2].map(|axis| point[axis].floor() as i32))
    }

    /// Whether no blade went into a cell, and all 28 springs between its corners are alive.
    fn is_whole(&self, cell: [i32; 3]) -> bool {
        let low = self.corners(cell)[0];
        low != NO_PARTICLE && !self.touched.contains(&cell) && self.topology.whole_cell(self.lattice, low).is_some()
    }

    /// The host of a vertex: that of a point on its inside, or the cell that holds the vertex itself where no side is to be
    /// chosen there. Beyond its own cell a map is continued, which is a few times less accurate.
    pub(super) fn host_of_vertex(&self, inside: Vector3, vertex: Vector3) -> Host {
        if self.is_plain(vertex) {
            return Host { cell: [0, 1, 2].map(|axis| vertex[axis].floor() as i32), carrying: ALL };
        }
        self.host(inside)
    }

    /// Whether two hosts have nothing to do with each other: no corner that carries is in both, and no living spring joins one
    /// of the first to one of the second.
    pub(super) fn are_apart(&self, a: Host, b: Host) -> bool {
        let carrying = |host: Host| {
            let corners = self.corners(host.cell);
            (0..8).filter(move |corner| host.carrying >> corner & 1 == 1).map(move |corner| corners[corner])
        };
        carrying(a).all(|ours| {
            let here = self.lattice.ijk(ours).map(|i| i as i32);
            carrying(b).all(|theirs| {
                let there = self.lattice.ijk(theirs).map(|i| i as i32);
                let offset = [0, 1, 2].map(|axis| there[axis] - here[axis]);
                let near = ours != theirs && offset.iter().all(|step| step.abs() <= 1);
                let joined = near && self.topology.alive()[ours as usize] >> direction_of(offset) & 1 == 1;
                ours != theirs && !joined
            })
        })
    }

    /// Particles of a cell's corners; [`NO_PARTICLE`] where there is none.
    pub(super) fn corners(&self, cell: [i32; 3]) -> [u32; 8] {
        let dims = self.lattice.grid.shape.dims();
        if (0..3).all(|axis| cell[axis] >= 0 && (cell[axis] as usize) + 1 < dims[axis]) {
            let low = self.lattice.grid.shape.linear(cell.map(|i| i as usize));
            return corners(self.lattice.grid.shape, low).map(|point| self.lattice.particle_at[point]);
        }
        std::array::from_fn(|corner| {
            let point = [0, 1, 2].map(|axis| i64::from(cell[axis]) + (corner >> axis & 1) as i64);
            let within = (0..3).all(|axis| point[axis] >= 0 && point[axis] < dims[axis] as i64);
            if within {
                self.lattice.particle_at[self.lattice.grid.shape.linear(point.map(|i| i as usize))]
            } else {
                NO_PARTICLE
            }
        })
    }

    fn present(&self, cell: [i32; 3]) -> u8 {
        let corners = self.corners(cell);
        (0..8).filter(|&corner| corners[corner] != NO_PARTICLE).fold(0, |bits, corner| bits | 1 << corner)
    }

    /// The cell that holds a point, or where none of its corners is a particle, the nearest cell of which one is.
    fn cell(&self, point: Vector3) -> [i32; 3] {
        let own = [0, 1, 2].map(|axis| point[axis].floor() as i32);
        if self.present(own) != 0 {
            return own;
        }
        let dims = self.lattice.grid.shape.dims();
        let farthest = 1 + (0..3).map(|axis| dims[axis] as i32 + own[axis].abs()).max().unwrap_or(0);
        for ring in 1..=farthest {
            let mut best: Option<(f64, [i32; 3])> = None;
            for step in ring_of(ring) {
                let cell = [0, 1, 2].map(|axis| own[axis] + step[axis]);
                if self.present(cell) != 0 {
                    let middle = Vector3::from(cell.map(|i| f64::from(i) + 0.5));
                    let distance = (point - middle).norm_squared();
                    if best.is_none_or(|(nearest, _)| distance < nearest) {
                        best = Some((distance, cell));
                    }
                }
            }
            if let Some((_, cell)) = best {
                return cell;
            }
        }
        own
    }

    /// The corners on a point's side of the blades in its cell.
    fn side(&self, cell: [i32; 3], present: u8, point: Vector3) -> u8 {
        let low = Vector3::from(cell.map(f64::from));
        let corner_of = |corner: usize| low + Vector3::from([0, 1, 2].map(|axis| (corner >> axis & 1) as f64));
        let seen = (0..8)
            .filter(|corner| present >> corner & 1 == 1 && !self.knife.parts(cell, point, corner_of(*corner)))
            .fold(0_u8, |bits, corner| bits | 1 << corner);
        let local = (point - low).map(|x| x.clamp(0.0, 1.0));
        let weight = |bits: u8| -> f64 {
            let weight = |corner: usize| -> f64 {
                let along = |axis: usize| if corner >> axis & 1 == 1 { local[axis] } else { 1.0 - local[axis] };
                // No corner that carries counts for nothing.
                along(0) * along(1) * along(2) + 1e-6
            };
            (0..8).filter(|corner| bits >> corner & 1 == 1).map(weight).sum()
        };
        // A point behind blades on all sides goes with the piece of the cell it is nearest to.
        let choice = if seen == 0 { present } else { seen };
        let pieces = self.pieces(cell, present);
        let most = pieces.into_iter().map(|piece| piece & choice).filter(|&piece| piece != 0);
        most.reduce(|best, piece| if weight(piece) > weight(best) { piece } else { best }).unwrap_or(present)
    }

    /// The corners of a cell in groups that its living springs hold together.
    fn pieces(&self, cell: [i32; 3], present: u8) -> Vec<u8> {
        let corners = self.corners(cell);
        let mut left = present;
        let mut pieces = Vec::new();
        while left != 0 {
            let mut piece = 1_u8 << left.trailing_zeros();
            loop {
                let mut grown = piece;
                for near in (0..8).filter(|near| piece >> near & 1 == 1) {
                    for far in (0..8).filter(|far| left >> far & 1 == 1) {
                        let offset = [0, 1, 2].map(|axis| (far >> axis & 1) - (near >> axis & 1));
                        let joined = near != far
                            && self.topology.alive()[corners[near as usize] as usize] >> direction_of(offset) & 1 == 1;
                        grown |= u8::from(joined) << far;
                    }
                }
                if grown == piece {
                    break;
                }
                piece = grown;
            }
            left &= !piece;
            pieces.push(piece);
        }
        pieces
    }
}

/// Steps of largest coordinate `ring`, in fixed order.
fn ring_of(ring: i32) -> impl Iterator<Item = [i32; 3]> {
    let range = -ring..=ring;
    range.clone().flat_map(move |k| {
        let range = range.clone();
        range.clone().flat_map(move |j| {
            let inner = k.abs() != ring && j.abs() != ring;
            let steps = if inner { vec![-ring, ring] } else { range.clone().collect() };
            steps.into_iter().map(move |i| [i, j, k])
        })
    })
}

/// Hosts numbered in the order they are first asked for.
#[derive(Debug, Default)]
pub(super) struct Numbered {
    numbers: HashMap<Host, u32>,
    pub(super) list: Vec<Host>,
}

impl Numbered {
    pub(super) fn number(&mut self, host: Host) -> u32 {
        *self.numbers.entry(host).or_insert_with(|| {
            self.list.push(host);
            self.list.len() as u32 - 1
        })
    }
}
