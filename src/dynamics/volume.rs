//! The cells' volume term in block order, and which blocks may take the fast body.
//!
//! A cell with a severed spring drops its term, modulus and viscosity, for good: its corners belong to two pieces that part
//! without a change of any tissue's volume, and a pressure that went on between them would push or pull across the open
//! cut. Only the force goes; each particle keeps its mass. The energy the cell held at that moment goes with it.

use super::slot_constants::proportion;
use super::springs::{Scratch, alike};
use crate::kernel::dispatch::volume_forces;
use crate::kernel::halo::{HALO_LEN, Halo, gather_rows};
use crate::kernel::laws::Absent;
use crate::kernel::volume::{CellPlanes, CellStep, EachCell, SameCells};
use crate::lattice::build::corners;
use crate::lattice::layout::{BLOCK_LEN, BlockLayout};
use crate::lattice::{Lattice, NO_PARTICLE, Topology};
use crate::material::VolumeTerm;

/// Buffers of one worker thread.
pub(super) struct CellScratch {
    pub(super) modulus: Halo,
    pub(super) viscosity: Halo,
    pub(super) planes: CellPlanes,
    pub(super) force: [[f32; BLOCK_LEN]; 3],
}

impl CellScratch {
    pub(super) fn new() -> Box<Self> {
        Box::new(Self {
            modulus: [0.0; HALO_LEN],
            viscosity: [0.0; HALO_LEN],
            planes: CellPlanes::new(),
            force: [[0.0; BLOCK_LEN]; 3],
        })
    }
}

/// Which body steps a block.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum BlockKind {
    /// No cell that touches the block has a term, now or later.
    Nothing,
    /// Every cell that touches the block has these constants; viscosity 0 when nothing damps.
    Alike { modulus: f32, viscosity: f32 },
    /// Anything else.
    General,
}

/// The volume terms of all cells of a world, in block order.
#[derive(Debug, Clone)]
pub(super) struct CellVolumes {
    step: CellStep,
    /// Modulus of the cell above each slot [Pa]; 0 where it adds nothing: not whole, or never had a modulus.
    modulus: Vec<f32>,
    viscosity: Viscosity,
    kind: Vec<BlockKind>,
}

/// Viscosity of the cells [Pa s]; 0 wherever the modulus is.
#[derive(Debug, Clone)]
enum Viscosity {
    Nothing,
    /// So many times the modulus where that is above 0, and 0 elsewhere [s].
    InProportion(f32),
    /// Of the cell above each slot.
    Own(Vec<f32>),
}

impl CellVolumes {
    pub(super) fn new(
        lattice: &Lattice,
        layout: &BlockLayout,
        topology: &Topology,
        term: &VolumeTerm,
        dt: f64,
    ) -> Self {
        let adds = |cell: u32| term.modulus[cell as usize] != 0.0 && topology.whole_cell(lattice, cell).is_some();
        let to_slots = |values: &[f32]| {
            assert_eq!(values.len(), lattice.len(), "one value per cell");
            let mut slots = vec![0.0; layout.slots()];
            for cell in (0..lattice.len() as u32).filter(|&cell| adds(cell)) {
                slots[layout.slot[cell as usize] as usize] = values[cell as usize];
            }
            slots
        };
        let modulus = to_slots(&term.modulus);
        let viscosity = match &term.viscosity {
            None => Viscosity::Nothing,
            Some(viscosity) => match proportion(viscosity, &term.modulus) {
                Some(time) => Viscosity::InProportion(time),
                None => Viscosity::Own(to_slots(viscosity)),
            },
        };
        let kind = (0..layout.blocks.len())
            .map(|block| {
                let Some(modulus) = alike(&modulus, layout, block) else { return BlockKind::General };
                let viscosity = match &viscosity {
                    _ if modulus == 0.0 => return BlockKind::Nothing,
                    Viscosity::Nothing => Some(0.0),
                    Viscosity::InProportion(time) => Some(time * modulus.max(0.0)),
                    Viscosity::Own(values) => alike(values, layout, block),
                };
                viscosity.map_or(BlockKind::General, |viscosity| BlockKind::Alike { modulus, viscosity })
            })
            .collect();
        Self { step: CellStep::new(lattice.pitch, dt), modulus, viscosity, kind }
    }

    /// Takes another time step from now on. [m, s]
    pub(super) fn set_dt(&mut self, pitch: f64, dt: f64) {
        self.step = CellStep::new(pitch, dt);
    }

    /// Takes the term from the cell above a particle; nothing happens when it has none.
    pub(super) fn drop_cell(&mut self, lattice: &Lattice, layout: &BlockLayout, cell: u32) {
        let slot = layout.slot[cell as usize] as usize;
        if self.modulus[slot] == 0.0 {
            return;
        }
        self.modulus[slot] = 0.0;
        if let Viscosity::Own(viscosity) = &mut self.viscosity {
            viscosity[slot] = 0.0;
        }
        // Cells with a term have all their corners; the blocks of these are the ones the cell touches.
        for point in corners(lattice.grid.shape, lattice.points[cell as usize] as usize) {
            let corner = lattice.particle_at[point];
            debug_assert_ne!(corner, NO_PARTICLE);
            self.kind[layout.slot[corner as usize] as usize / BLOCK_LEN] = BlockKind::General;
        }
    }

    /// Lets every block that has cells take the general body.
    pub(super) fn forget_alike_blocks(&mut self) {
        for kind in self.kind.iter_mut().filter(|kind| **kind != BlockKind::Nothing) {
            *kind = BlockKind::General;
        }
    }

    /// Which body steps a block.
    pub(super) fn kind(&self, block: usize) -> BlockKind {
        self.kind[block]
    }

    /// True when some cell has a viscosity.
    pub(super) fn viscous(&self) -> bool {
        !matches!(self.viscosity, Viscosity::Nothing)
    }

    /// Copies modulus and viscosity of a block's cells with halo.
    pub(super) fn gather(&self, layout: &BlockLayout, block: usize, own: &mut CellScratch) {
        let (neighbours, rows) = (&layout.neighbours[block], layout.rows[block]);
        gather_rows(&self.modulus, neighbours, rows, &mut own.modulus);
        match &self.viscosity {
            Viscosity::Nothing => {}
            Viscosity::InProportion(time) => {
                own.viscosity.iter_mut().zip(&own.modulus).for_each(|(to, modulus)| *to = time * modulus.max(0.0));
            }
            Viscosity::Own(viscosity) => gather_rows(viscosity, neighbours, rows, &mut own.viscosity),
        }
    }

    /// Bytes held by the arrays of the cells.
    pub(super) fn bytes(&self) -> usize {
        let viscosity = if let Viscosity::Own(viscosity) = &self.viscosity { viscosity.len() } else { 0 };
        4 * (self.modulus.len() + viscosity)
    }

    /// Force of the cells on each slot of a block [N]; `None` when no cell touches it. See
    /// [`crate::kernel::volume::block_volume_forces`].
    ///
    /// `scratch` holds the block's displacement (and velocity, when there is viscosity) with halo.
    pub(super) fn forces<'a>(
        &self,
        layout: &BlockLayout,
        block: usize,
        scratch: &Scratch,
        own: &'a mut CellScratch,
    ) -> Option<&'a mut [[f32; BLOCK_LEN]; 3]> {
        let (displacement, velocity) = (scratch.displacement.each_ref(), scratch.velocity.each_ref());
        let step = self.step;
        if self.kind[block] == BlockKind::General {
            self.gather(layout, block, own);
        }
        let CellScratch { modulus, viscosity, planes, force } = own;
        let (each_modulus, each_viscosity) = (EachCell { cell: modulus }, EachCell { cell: viscosity });
        macro_rules! forces_with {
            ($modulus:expr, $viscosity:expr) => {
                volume_forces(step, $modulus, $viscosity, displacement, velocity, planes, force)
            };
        }
        match (self.kind[block], self.viscous()) {
            (BlockKind::Nothing, _) => return None,
            (BlockKind::Alike { modulus, .. }, false) => forces_with!(SameCells::new(modulus), Absent),
            (BlockKind::Alike { modulus, viscosity }, true) => {
                forces_with!(SameCells::new(modulus), SameCells::new(viscosity))
            }
            (BlockKind::General, false) => forces_with!(each_modulus, Absent),
            (BlockKind::General, true) => forces_with!(each_modulus, each_viscosity),
        }
        Some(force)
    }
}
