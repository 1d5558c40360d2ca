//! Spring constants and living springs in block order, and which blocks may take the fast body.

use bytemuck::must_cast_ref;

use super::slot_constants::{proportion, to_slots};
use crate::kernel::block::{BlockState, StepConstants, Work};
use crate::kernel::dispatch::{Arithmetic, kick};
use crate::kernel::halo::{HALO_LEN, Halo, gather, gather_rows, halo_row};
use crate::kernel::laws::{Absent, HaloBits, InProportion, Intact, MeanOfEnds, SumOfCells, Uniform};
use crate::lattice::layout::{BLOCK, BLOCK_LEN, BlockLayout};
use crate::lattice::neighbours::ALL_ALIVE;
use crate::material::{Assembly, SpringConstants};

/// Buffers of one worker thread: a block of each field with its halo.
pub(super) struct Scratch {
    pub(super) displacement: [Halo; 3],
    pub(super) velocity: [Halo; 3],
    stiffness: Halo,
    damping: Halo,
    alive: [u32; HALO_LEN],
    work: Work,
}

impl Scratch {
    pub(super) fn new() -> Box<Self> {
        Box::new(Self {
            displacement: [[0.0; HALO_LEN]; 3],
            velocity: [[0.0; HALO_LEN]; 3],
            stiffness: [0.0; HALO_LEN],
            damping: [0.0; HALO_LEN],
            alive: [0; HALO_LEN],
            work: Work::default(),
        })
    }
}

/// What a block is kicked by.
pub(super) struct BlockInput<'a> {
    /// The block's displacement (and velocity, when damped) with halo.
    pub(super) scratch: &'a mut Scratch,
    /// Force of the cells on each slot [N]; only with springs that are sums over cells.
    pub(super) cells: Option<&'a [[f32; BLOCK_LEN]; 3]>,
    /// Step over mass of each slot [s/kg].
    pub(super) dt_over_mass: &'a [f32; BLOCK_LEN],
    /// State of the next blocks.
    pub(super) ahead: &'a [&'a [f32; BLOCK_LEN]],
}

/// Which body steps a block.
#[derive(Debug, Clone, Copy)]
enum BlockKind {
    /// Every spring alive and alike: constants by family, damping 0 when nothing damps.
    Alike { stiffness: [f32; 3], damping: [f32; 3] },
    /// Anything else.
    General,
}

/// The law of a lattice; decided once, when the world is made.
#[derive(Debug, Clone)]
enum Law {
    /// The same constants for all springs; general blocks only need the bits of the living ones.
    Uniform { stiffness: f32, damping: Option<f32> },
    /// Slots hold each particle's constants.
    MeanOfEnds { stiffness: Vec<f32>, damping: Option<Vec<f32>> },
    /// Slots hold the constants of the cell above each particle.
    SumOfCells { stiffness: Vec<f32>, damping: CellDamping, weight: [f32; 3] },
}

/// How the springs of cells are damped.
#[derive(Debug, Clone)]
enum CellDamping {
    Nothing,
    /// All cells by the same time, damping over stiffness [s]: one tissue, or several that die out alike.
    InProportion(f32),
    /// Constants of their own, by slots.
    Own(Vec<f32>),
}

/// All springs of a world, in block order.
#[derive(Debug, Clone)]
pub(super) struct BlockSprings {
    law: Law,
    /// Living springs of each slot; 0 for empty slots.
    alive: Vec<u32>,
    kind: Vec<BlockKind>,
}

impl BlockSprings {
    pub(super) fn new(layout: &BlockLayout, assembly: &Assembly, alive_of_particle: &[u32]) -> Self {
        let mut alive = vec![0; layout.slots()];
        for (&slot, &bits) in layout.slot.iter().zip(alive_of_particle) {
            alive[slot as usize] = bits;
        }
        let law = Law::new(layout, assembly);
        let kind = (0..layout.blocks.len()).map(|block| law.kind(layout, &alive, block)).collect();
        Self { law, alive, kind }
    }

    /// True when velocities of neighbours are read.
    pub(super) fn damped(&self) -> bool {
        match &self.law {
            Law::Uniform { damping, .. } => damping.is_some(),
            Law::MeanOfEnds { damping, .. } => damping.is_some(),
            Law::SumOfCells { damping, .. } => !matches!(damping, CellDamping::Nothing),
        }
    }

    /// Removes a spring's bit from the slots of its two ends.
    pub(super) fn sever(&mut self, near: u32, near_direction: usize, far: u32, far_direction: usize) {
        for (slot, direction) in [(near, near_direction), (far, far_direction)] {
            self.alive[slot as usize] &= !(1 << direction);
            self.kind[slot as usize / BLOCK_LEN] = BlockKind::General;
        }
    }

    /// Living springs of a block's slots, one bit per direction.
    pub(super) fn alive(&self, block: usize) -> &[u32; BLOCK_LEN] {
        block_of(&self.alive, block)
    }

    /// What the springs of a block are computed from besides places and velocities, to be asked for before they are.
    pub(super) fn ahead(&self, block: usize) -> impl Iterator<Item = &[f32; BLOCK_LEN]> {
        let general = matches!(self.kind[block], BlockKind::General);
        let alive: &[f32; BLOCK_LEN] = must_cast_ref(block_of(&self.alive, block));
        let constants = self.law.constants().into_iter().flatten().map(move |values| block_of(values, block));
        constants.chain([alive]).filter(move |_| general)
    }

    /// Living springs of every slot.
    pub(super) fn alive_slots(&self) -> &[u32] {
        &self.alive
    }

    /// Number of blocks that take the fast body, for reports.
    pub(super) fn alike_blocks(&self) -> usize {
        self.kind.iter().filter(|kind| matches!(kind, BlockKind::Alike { .. })).count()
    }

    /// Lets every block take the general body.
    pub(super) fn forget_alike_blocks(&mut self) {
        self.kind.fill(BlockKind::General);
    }

    /// Bytes held by the spring arrays.
    pub(super) fn bytes(&self) -> usize {
        let constants = self.law.constants().into_iter().flatten().map(Vec::len).sum::<usize>();
        4 * (constants + self.alive.len())
    }

    /// Advances the velocities of one block; see [`crate::kernel::rows::kick_block`].
    pub(super) fn kick(
        &self,
        arithmetic: Arithmetic,
        step: StepConstants,
        layout: &BlockLayout,
        block: usize,
        input: BlockInput<'_>,
        velocity_out: [&mut [f32; BLOCK_LEN]; 3],
    ) -> f32 {
        let BlockInput { scratch, cells, dt_over_mass, ahead } = input;
        let Scratch { displacement, velocity, stiffness: stiffness_halo, damping: damping_halo, alive, work } = scratch;
        let state = BlockState {
            step,
            displacement: displacement.each_ref(),
            velocity: velocity.each_ref(),
            known_force: cells,
            dt_over_mass,
            ahead,
        };
        let (neighbours, rows) = (&layout.neighbours[block], layout.rows[block]);
        if let BlockKind::General = self.kind[block] {
            gather_rows(&self.alive, neighbours, rows, alive);
        }
        let bits = HaloBits { alive };
        macro_rules! kick_with {
            ($stiffness:expr, $damping:expr, $alive:expr) => {
                kick(arithmetic, $stiffness, $damping, $alive, state, work, velocity_out)
            };
        }
        match (&self.law, self.kind[block]) {
            (_, BlockKind::Alike { stiffness, damping }) => {
                let stiffness = Uniform { by_family: stiffness };
                if self.damped() {
                    kick_with!(stiffness, Uniform { by_family: damping }, Intact)
                } else {
                    kick_with!(stiffness, Absent, Intact)
                }
            }
            (Law::Uniform { stiffness, damping }, BlockKind::General) => {
                let stiffness = Uniform { by_family: [*stiffness; 3] };
                match damping {
                    Some(damping) => kick_with!(stiffness, Uniform { by_family: [*damping; 3] }, bits),
                    None => kick_with!(stiffness, Absent, bits),
                }
            }
            (Law::MeanOfEnds { stiffness, damping }, BlockKind::General) => {
                gather_rows(stiffness, neighbours, rows, stiffness_halo);
                let stiffness = MeanOfEnds { particle: stiffness_halo };
                match damping {
                    Some(damping) => {
                        gather_rows(damping, neighbours, rows, damping_halo);
                        kick_with!(stiffness, MeanOfEnds { particle: damping_halo }, bits)
                    }
                    None => kick_with!(stiffness, Absent, bits),
                }
            }
            (Law::SumOfCells { stiffness, damping, weight }, BlockKind::General) => {
                gather_rows(stiffness, neighbours, rows, stiffness_halo);
                let stiffness = SumOfCells { cell: stiffness_halo, weight: *weight };
                match damping {
                    CellDamping::Nothing => kick_with!(stiffness, Absent, bits),
                    CellDamping::InProportion(time) => kick_with!(stiffness, InProportion { time: *time }, bits),
                    CellDamping::Own(damping) => {
                        gather_rows(damping, neighbours, rows, damping_halo);
                        kick_with!(stiffness, SumOfCells { cell: damping_halo, weight: *weight }, bits)
                    }
                }
            }
        }
    }
}

impl Law {
    fn new(layout: &BlockLayout, assembly: &Assembly) -> Self {
        let to_slots = |values: &[f32]| to_slots(layout, values);
        match (&assembly.stiffness, assembly.damping.as_ref()) {
            (SpringConstants::Uniform(stiffness), None) => Self::Uniform { stiffness: *stiffness, damping: None },
            (SpringConstants::Uniform(stiffness), Some(SpringConstants::Uniform(damping))) => {
                Self::Uniform { stiffness: *stiffness, damping: Some(*damping) }
            }
            (SpringConstants::SumOfCells { cell, weight }, None) => {
                Self::SumOfCells { stiffness: to_slots(cell), damping: CellDamping::Nothing, weight: *weight }
            }
            (SpringConstants::SumOfCells { cell, weight }, Some(SpringConstants::SumOfCells { cell: damping, .. })) => {
                let damping = match proportion(damping, cell) {
                    Some(time) => CellDamping::InProportion(time),
                    None => CellDamping::Own(to_slots(damping)),
                };
                Self::SumOfCells { stiffness: to_slots(cell), damping, weight: *weight }
            }
            // Organs that share one constant but not the other: both become one value per particle.
            (stiffness, damping) => Self::MeanOfEnds {
                stiffness: to_slots(&stiffness.per_particle(layout.slot.len())),
                damping: damping.map(|damping| to_slots(&damping.per_particle(layout.slot.len()))),
            },
        }
    }

    /// What slots hold.
    fn constants(&self) -> [Option<&Vec<f32>>; 2] {
        match self {
            Self::Uniform { .. } => [None, None],
            Self::MeanOfEnds { stiffness, damping } => [Some(stiffness), damping.as_ref()],
            Self::SumOfCells { stiffness, damping: CellDamping::Own(damping), .. } => [Some(stiffness), Some(damping)],
            Self::SumOfCells { stiffness, .. } => [Some(stiffness), None],
        }
    }

    fn kind(&self, layout: &BlockLayout, alive: &[u32], block: usize) -> BlockKind {
        if block_of(alive, block).iter().any(|&bits| bits != ALL_ALIVE) {
            return BlockKind::General;
        }
        match self {
            Self::Uniform { stiffness, damping } => {
                BlockKind::Alike { stiffness: [*stiffness; 3], damping: [damping.unwrap_or(0.0); 3] }
            }
            Self::MeanOfEnds { .. } => BlockKind::General,
            Self::SumOfCells { stiffness, damping, weight } => {
                // The same sums as the general body, so that both give the same bits.
                let by_family = |cell: f32| {
                    [weight[0] * ((cell + cell) + (cell + cell)), weight[1] * (cell + cell), weight[2] * cell]
                };
                let Some(stiffness) = self::alike(stiffness, layout, block).map(by_family) else {
                    return BlockKind::General;
                };
                let damping = match damping {
                    CellDamping::Nothing => Some([0.0; 3]),
                    CellDamping::InProportion(time) => Some(stiffness.map(|stiffness| stiffness * time)),
                    CellDamping::Own(damping) => self::alike(damping, layout, block).map(by_family),
                };
                damping.map_or(BlockKind::General, |damping| BlockKind::Alike { stiffness, damping })
            }
        }
    }
}

/// The value of every cell that touches the block, when it is one and the same: the block's own and one layer below it.
pub(super) fn alike(cell: &[f32], layout: &BlockLayout, block: usize) -> Option<f32> {
    let mut halo = [0.0; HALO_LEN];
    gather(cell, &layout.neighbours[block], &mut halo);
    let value = cell[block * BLOCK_LEN];
    for z in -1..BLOCK[2] as isize {
        for y in -1..BLOCK[1] as isize {
            let start = halo_row(y, z);
            if halo[start..=start + BLOCK[0]].iter().any(|&other| other != value) {
                return None;
            }
        }
    }
    Some(value)
}

pub(super) fn block_of<T>(slots: &[T], block: usize) -> &[T; BLOCK_LEN] {
    slots[block * BLOCK_LEN..][..BLOCK_LEN].try_into().expect("whole blocks")
}
