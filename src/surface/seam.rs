//! What severed springs change of the surface: the edges a cut has parted, the patches of the cells beside them, and where both are
//! in order. [`super::gaps`] finds them.

use rayon::prelude::*;

use super::blade::Blades;
use super::gaps::{CellState, Gaps};
use super::junction::{FrontPlace, RimCrossing, RimPlace};
use super::marching_cubes::bits::InsideBits;
use super::marching_cubes::cell::Patch;
use crate::geometry::GridShape;
use crate::lattice::{Lattice, Topology};

/// An edge whose ends a cut has parted.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SeamEdge {
    /// Lower end of the edge, padded indices.
    pub(crate) low: [u32; 3],
    /// Axis of the edge.
    pub(crate) axis: u8,
    /// Particles at the lower and the upper end.
    pub(crate) ends: [u32; 2],
    /// Distance of each lip from its own end, as a fraction of the edge.
    pub(crate) lips: [f32; 2],
    /// Crack fronts in the order of their face slots.
    pub(crate) fronts: Vec<FrontPlace>,
    /// Rims in the order of face slot, then end.
    pub(crate) rims: Vec<RimPlace>,
    pub(super) front_slots: u8,
    pub(super) rim_slots: u8,
}

impl SeamEdge {
    /// Number of vertices: lips, fronts, rims, in this order.
    pub(crate) fn vertex_count(&self) -> usize {
        2 + self.fronts.len() + self.rims.len()
    }

    /// Place of a crack front among the vertices of this edge.
    pub(crate) fn front_place(&self, slot: u8) -> u32 {
        debug_assert!(self.front_slots >> slot & 1 == 1, "no crack front at slot {slot}");
        2 + (self.front_slots & ((1 << slot) - 1)).count_ones()
    }

    /// Place of a rim among the vertices of this edge.
    pub(crate) fn rim_place(&self, slot: u8, end: u8) -> u32 {
        debug_assert!(self.rim_slots >> (2 * slot + end) & 1 == 1, "no rim at slot {slot}, end {end}");
        let before = (1_u8 << (2 * slot + end)) - 1;
        (2 + self.fronts.len()) as u32 + (self.rim_slots & before).count_ones()
    }

    /// Slot of the face a rim lies in.
    pub(super) fn slot_of(&self, rim: &RimPlace) -> u8 {
        2 * ((rim.skin_axis + 2 - self.axis) % 3) + u8::from(!rim.skin_upward)
    }

    /// Its place in the order of edges.
    pub(crate) fn key(&self, shape: GridShape) -> u64 {
        edge_key(shape, self.low.map(i64::from), self.axis)
    }
}

/// A cell with a dead spring.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SeamCell {
    /// Lower corner, padded indices.
    pub(crate) low: [u32; 3],
    /// Its triangles.
    pub(crate) patch: Patch,
    /// Its seam edges: edge of the cell, index into [`Seam::edges`].
    pub(crate) seam_edges: Vec<(u8, u32)>,
}

impl SeamCell {
    /// Padded index along x.
    pub(crate) fn column(&self) -> usize {
        self.low[0] as usize
    }
}

/// Everything a set of severed springs changes.
#[derive(Debug, Clone, Default)]
pub(crate) struct Seam {
    /// Ascending by layer, row, column and axis.
    pub(crate) edges: Vec<SeamEdge>,
    /// Ascending by layer, row and column.
    pub(crate) cells: Vec<SeamCell>,
    /// As in [`super::gaps::Gaps`].
    pub(crate) rim_crossings: Vec<RimCrossing>,
}

impl Seam {
    /// No dead spring.
    pub(crate) fn none() -> Self {
        Self::default()
    }

    /// Finds what the dead springs between inside points change.
    pub(crate) fn find(
        lattice: &Lattice,
        topology: &Topology,
        blades: &Blades,
        bits: &InsideBits,
        values: &[f32],
    ) -> Self {
        let Gaps { edges, cells, rim_crossings } = Gaps::find(lattice, topology, blades, bits, values, None);
        let drawn =
            |state: CellState| SeamCell { low: state.low, patch: state.cell.patch(), seam_edges: state.seam_edges };
        Self { edges, cells: cells.into_par_iter().map(drawn).collect(), rim_crossings }
    }

    /// Seam edges that start in a padded layer.
    pub(crate) fn edges_of_layer(&self, k: usize) -> &[SeamEdge] {
        let from = self.edges.partition_point(|edge| (edge.low[2] as usize) < k);
        let to = self.edges.partition_point(|edge| (edge.low[2] as usize) <= k);
        &self.edges[from..to]
    }

    /// Seam cells of a layer of cells.
    pub(crate) fn cells_of_layer(&self, k: usize) -> &[SeamCell] {
        let from = self.cells.partition_point(|cell| (cell.low[2] as usize) < k);
        let to = self.cells.partition_point(|cell| (cell.low[2] as usize) <= k);
        &self.cells[from..to]
    }

    /// Index range of the seam cells of one row.
    pub(crate) fn cells_of_row(&self, j: usize, k: usize) -> (usize, usize) {
        let row = |cell: &SeamCell| (cell.low[2] as usize, cell.low[1] as usize);
        let from = self.cells.partition_point(|cell| row(cell) < (k, j));
        let to = from + self.cells[from..].partition_point(|cell| row(cell) <= (k, j));
        (from, to)
    }
}

/// Linear index of a padded point.
pub(crate) fn point_key(shape: GridShape, at: [i64; 3]) -> u64 {
    let (nx, ny) = (shape.nx as u64 + 2, shape.ny as u64 + 2);
    (at[2] as u64 * ny + at[1] as u64) * nx + at[0] as u64
}

pub(crate) fn point_of_key(shape: GridShape, key: u64) -> [i64; 3] {
    let (nx, ny) = (shape.nx as u64 + 2, shape.ny as u64 + 2);
    [(key % nx) as i64, (key / nx % ny) as i64, (key / (nx * ny)) as i64]
}

pub(crate) fn edge_key(shape: GridShape, low: [i64; 3], axis: u8) -> u64 {
    3 * point_key(shape, low) + u64::from(axis)
}
