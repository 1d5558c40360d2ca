//! The cells' fibres in block order, and which blocks may take the fast body. They are stepped in one pass with the volume
//! term, where a block has one.
//!
//! A cell with a severed spring drops its fibres for good, as it drops its volume term: its corners belong to two pieces, and
//! a fibre between them would pull across the open cut. The energy it held at that moment goes with it.

use crate::dynamics::springs::{Scratch, alike};
use crate::dynamics::volume::{BlockKind as VolumeKind, CellScratch, CellVolumes};
use crate::kernel::fibres::{EachFibres, SameFibres, cell_forces};
use crate::kernel::halo::{HALO_LEN, Halo, gather_rows};
use crate::kernel::laws::Absent;
use crate::kernel::volume::{CellStep, EachCell, SameCells};
use crate::lattice::build::corners;
use crate::lattice::layout::{BLOCK_LEN, BlockLayout};
use crate::lattice::{Lattice, Topology};
use crate::material::FibreTerm;

/// `b` of a block's cells with halo: the buffer of one worker thread.
pub(in crate::dynamics) struct FibreScratch {
    root: [Halo; 3],
}

impl FibreScratch {
    pub(in crate::dynamics) fn new() -> Box<Self> {
        Box::new(Self { root: [[0.0; HALO_LEN]; 3] })
    }
}

/// Which body steps a block.
#[derive(Debug, Clone, Copy, PartialEq)]
enum BlockKind {
    /// No cell that touches the block has fibres, now or later.
    Nothing,
    /// Every cell that touches the block has these [Pa^1/2].
    Alike([f32; 3]),
    /// Anything else.
    General,
}

/// The fibres of all cells of a world, in block order.
#[derive(Debug, Clone)]
pub(in crate::dynamics) struct CellFibres {
    step: CellStep,
    /// Direction times the root of the modulus, of the cell above each slot [Pa^1/2]; 0 where it has none.
    root: [Vec<f32>; 3],
    kind: Vec<BlockKind>,
}

impl CellFibres {
    pub(in crate::dynamics) fn new(
        lattice: &Lattice,
        layout: &BlockLayout,
        topology: &Topology,
        term: &FibreTerm,
        dt: f64,
    ) -> Self {
        let root = in_slots(lattice, layout, topology, term);
        let kind = |block| {
            let [x, y, z] = root.each_ref().map(|axis| alike(axis, layout, block));
            match (x, y, z) {
                (Some(0.0), Some(0.0), Some(0.0)) => BlockKind::Nothing,
                (Some(x), Some(y), Some(z)) => BlockKind::Alike([x, y, z]),
                _ => BlockKind::General,
            }
        };
        let kind = (0..layout.blocks.len()).map(kind).collect();
        Self { step: CellStep::new(lattice.pitch, dt), root, kind }
    }

    /// Takes another time step from now on. [m, s]
    pub(in crate::dynamics) fn set_dt(&mut self, pitch: f64, dt: f64) {
        self.step = CellStep::new(pitch, dt);
    }

    /// Takes the fibres from the cell above a particle; nothing happens when it has none.
    pub(in crate::dynamics) fn drop_cell(&mut self, lattice: &Lattice, layout: &BlockLayout, cell: u32) {
        let slot = layout.slot[cell as usize] as usize;
        if self.root.iter().all(|axis| axis[slot] == 0.0) {
            return;
        }
        self.root.iter_mut().for_each(|axis| axis[slot] = 0.0);
        // Cells with fibres have all their corners; the blocks of these are the ones the cell touches.
        for point in corners(lattice.grid.shape, lattice.points[cell as usize] as usize) {
            let corner = lattice.particle_at[point];
            self.kind[layout.slot[corner as usize] as usize / BLOCK_LEN] = BlockKind::General;
        }
    }

    /// Lets every block that has fibres take the general body.
    pub(in crate::dynamics) fn forget_alike_blocks(&mut self) {
        for kind in self.kind.iter_mut().filter(|kind| **kind != BlockKind::Nothing) {
            *kind = BlockKind::General;
        }
    }

    /// Bytes held by the arrays of the cells.
    pub(in crate::dynamics) fn bytes(&self) -> usize {
        12 * self.root[0].len()
    }

    /// Force of the cells on each slot of a block [N], of their volume terms and of their fibres; `None` when no cell
    /// touches it. Otherwise as [`CellVolumes::forces`].
    pub(in crate::dynamics) fn forces<'a>(
        &self,
        volumes: Option<&CellVolumes>,
        layout: &BlockLayout,
        block: usize,
        scratch: &Scratch,
        own: &'a mut CellScratch,
        fibres: &mut FibreScratch,
    ) -> Option<&'a mut [[f32; BLOCK_LEN]; 3]> {
        let (neighbours, rows) = (&layout.neighbours[block], layout.rows[block]);
        let volumes = volumes.filter(|volumes| volumes.kind(block) != VolumeKind::Nothing);
        let volume_kind = volumes.map(|volumes| volumes.kind(block));
        if self.kind[block] == BlockKind::Nothing {
            return volumes?.forces(layout, block, scratch, own);
        }
        let (step, u, v) = (self.step, scratch.displacement.each_ref(), scratch.velocity.each_ref());
        let viscous = volumes.is_some_and(CellVolumes::viscous);
        if let (BlockKind::Alike(root), None | Some(VolumeKind::Alike { .. })) = (self.kind[block], volume_kind) {
            let CellScratch { planes, force, .. } = own;
            let root = SameFibres::new(root);
            match volume_kind {
                Some(VolumeKind::Alike { modulus, viscosity }) if viscous => {
                    let (modulus, viscosity) = (SameCells::new(modulus), SameCells::new(viscosity));
                    cell_forces(step, (modulus, viscosity, root), u, v, planes, force);
                }
                Some(VolumeKind::Alike { modulus, .. }) => {
                    cell_forces(step, (SameCells::new(modulus), Absent, root), u, v, planes, force);
                }
                _ => cell_forces(step, (Absent, Absent, root), u, v, planes, force),
            }
            return Some(&mut own.force);
        }
        for (axis, halo) in self.root.iter().zip(&mut fibres.root) {
            gather_rows(axis, neighbours, rows, halo);
        }
        if let Some(volumes) = volumes {
            volumes.gather(layout, block, own);
        }
        let CellScratch { modulus, viscosity, planes, force } = own;
        let root = EachFibres { cell: fibres.root.each_ref() };
        let (modulus, viscosity) = (EachCell { cell: modulus }, EachCell { cell: viscosity });
        match (volumes.is_some(), viscous) {
            (false, _) => cell_forces(step, (Absent, Absent, root), u, v, planes, force),
            (true, false) => cell_forces(step, (modulus, Absent, root), u, v, planes, force),
            (true, true) => cell_forces(step, (modulus, viscosity, root), u, v, planes, force),
        }
        Some(force)
    }
}

/// Fibres of the cells whose 28 springs are all alive, moved to their slots; 0 elsewhere [Pa^1/2].
pub(in crate::dynamics) fn in_slots(
    lattice: &Lattice,
    layout: &BlockLayout,
    topology: &Topology,
    term: &FibreTerm,
) -> [Vec<f32>; 3] {
    assert_eq!(term.root.len(), lattice.len(), "one value per cell");
    let mut slots = [0, 1, 2].map(|_| vec![0.0; layout.slots()]);
    for (cell, root) in (0..).zip(&term.root) {
        if *root != [0.0; 3] && topology.whole_cell(lattice, cell).is_some() {
            for axis in 0..3 {
                slots[axis][layout.slot[cell as usize] as usize] = root[axis];
            }
        }
    }
    slots
}
