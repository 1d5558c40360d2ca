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

use super::host_cells::{ALL, HostCells, particles_of, piece_of, present};
use super::knife::Knife;
use crate::geometry::{CellMap, Vector3};
use crate::lattice::neighbours::direction_of;
use crate::lattice::{Lattice, Topology};

/// A cell and the corners (one bit each, x fastest) that carry.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct Host {
    /// Grid index of the lowest corner.
    pub(super) cell: [i32; 3],
    pub(super) carrying: u8,
}

/// Finds hosts.
pub(super) struct Hosts<'a> {
    lattice: &'a Lattice,
    topology: &'a Topology,
    knife: &'a Knife,
    cells: HostCells,
}

impl<'a> Hosts<'a> {
    pub(super) fn new(lattice: &'a Lattice, topology: &'a Topology, knife: &'a Knife) -> Self {
        Self { lattice, topology, knife, cells: HostCells::new(lattice, topology, knife) }
    }

    /// The host of a point, by its index coordinates in the lattice.
    pub(super) fn host(&self, point: Vector3) -> Host {
        let cell = self.cell(point);
        let carrying = self.cells.of(cell).carrying().unwrap_or_else(|| self.side(cell, point));
        Host { cell, carrying }
    }

    /// For a point in a cell without a particle: the cell that carries it.
    pub(super) fn stray(&self, point: Vector3) -> Option<[i32; 3]> {
        let cell = self.cell(point);
        (cell != cell_of(point)).then_some(cell)
    }

    /// The host of a vertex: that of a point on its inside, or the cell that holds the vertex itself where no side is to be
    /// chosen there. Beyond its own cell a map is continued, which is a few times less accurate.
    pub(super) fn host_of_vertex(&self, inside: Vector3, vertex: Vector3) -> Host {
        let cell = cell_of(vertex);
        if self.cells.of(cell).is_whole() {
            return Host { cell, carrying: ALL };
        }
        self.host(inside)
    }

    /// A cell with all the corners it has; `None` where living springs do not join them all.
    pub(super) fn all_of(&self, cell: [i32; 3]) -> Option<Host> {
        let particles = self.corners(cell);
        let carrying = present(&particles);
        (carrying != 0 && piece_of(self.topology, &particles, carrying) == carrying).then_some(Host { cell, carrying })
    }

    /// Whether springs have parted two hosts: no corner that carries is in both, and of the springs that joined one of the first to one of
    /// the second at rest, there being any, none lives. Corners that no spring joined, at the border of the tissue, say nothing.
    pub(super) fn are_parted(&self, a: Host, b: Host) -> bool {
        let carrying = |host: Host| {
            let corners = self.corners(host.cell);
            (0..8).filter(move |corner| host.carrying >> corner & 1 == 1).map(move |corner| corners[corner])
        };
        let mut severed = false;
        for ours in carrying(a) {
            let here = self.lattice.ijk(ours).map(|i| i as i32);
            for theirs in carrying(b) {
                if ours == theirs {
                    return false;
                }
                let there = self.lattice.ijk(theirs).map(|i| i as i32);
                let offset = [0, 1, 2].map(|axis| there[axis] - here[axis]);
                if offset.iter().any(|step| step.abs() > 1) {
                    continue;
                }
                let spring = 1 << direction_of(offset);
                if self.topology.alive()[ours as usize] & spring != 0 {
                    return false;
                }
                severed |= self.lattice.springs[ours as usize] & spring != 0;
            }
        }
        severed
    }

    /// Particles of a cell's corners; [`crate::lattice::NO_PARTICLE`] where there is none.
    pub(super) fn corners(&self, cell: [i32; 3]) -> [u32; 8] {
        particles_of(self.lattice, cell)
    }

    /// The cell that holds a point, or where none of its corners is a particle, the nearest cell of which one is.
    fn cell(&self, point: Vector3) -> [i32; 3] {
        let own = cell_of(point);
        if !self.cells.of(own).is_void() {
            return own;
        }
        let dims = self.lattice.grid.shape.dims();
        let farthest = 1 + (0..3).map(|axis| dims[axis] as i32 + own[axis].abs()).max().unwrap_or(0);
        for ring in 1..=farthest {
            let mut best: Option<(f64, [i32; 3])> = None;
            for step in ring_of(ring) {
                let cell = [0, 1, 2].map(|axis| own[axis] + step[axis]);
                if !self.cells.of(cell).is_void() {
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
    fn side(&self, cell: [i32; 3], point: Vector3) -> u8 {
        let particles = self.corners(cell);
        let present = present(&particles);
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
        let (mut left, mut best) = (present, None);
        while left != 0 {
            let piece = piece_of(self.topology, &particles, left);
            left &= !piece;
            let carries = piece & choice;
            if carries != 0 && best.is_none_or(|best| weight(carries) > weight(best)) {
                best = Some(carries);
            }
        }
        best.unwrap_or(present)
    }
}

/// The cell that holds a point.
pub(super) fn cell_of(point: Vector3) -> [i32; 3] {
    [0, 1, 2].map(|axis| point[axis].floor() as i32)
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
    numbers: CellMap<Host, u32>,
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
