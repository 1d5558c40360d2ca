//! Which springs are alive, and when and where the others were severed.

use std::sync::Arc;

use super::build::corners;
use super::neighbours::{self, direction_of};
use super::{Lattice, NO_PARTICLE};

/// For each corner of a cell (x fastest) its seven springs inside the cell, one bit per direction.
const CELL_SPRINGS: [u32; 8] = cell_springs();

const fn cell_springs() -> [u32; 8] {
    let mut springs = [0; 8];
    let mut pair = 0;
    while pair < 64 {
        let (near, far) = (pair / 8, pair % 8);
        if near != far {
            let x = (far & 1) as i32 - (near & 1) as i32;
            let y = (far >> 1 & 1) as i32 - (near >> 1 & 1) as i32;
            let z = (far >> 2) as i32 - (near >> 2) as i32;
            springs[near] |= 1 << direction_of([x, y, z]);
        }
        pair += 1;
    }
    springs
}

/// A spring that a blade went through.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeveredSpring {
    /// The end with the lower particle number.
    pub particle: u32,
    /// Forward direction (13 to 25) from that end, see [`neighbours`].
    pub direction: u8,
    /// Where the blade crossed: 0 at `particle`, 1 at the other end.
    pub at: f32,
    /// When [s].
    pub time: f64,
}

/// A severed spring that does not fit the lattice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "severed spring {index} (particle {particle}, direction {direction}) is not a living spring of this lattice; \
     the springs and the lattice come from different runs"
)]
#[non_exhaustive]
pub struct ReplayError {
    /// Its place in the list.
    pub index: usize,
    /// The particle it names.
    pub particle: u32,
    /// The direction it names.
    pub direction: u8,
}

/// The living springs of a lattice. Only cutting changes it, and only by removing springs.
#[derive(Debug, Clone)]
pub struct Topology {
    /// Living springs of each particle, one bit per direction; kept symmetric. Shape `[particles]`.
    alive: Arc<Vec<u32>>,
    /// Every severed spring in the order of severing.
    severed: Vec<SeveredSpring>,
}

impl Topology {
    /// All springs of the lattice at rest.
    pub fn new(lattice: &Lattice) -> Self {
        Self { alive: lattice.springs.clone(), severed: Vec::new() }
    }

    /// The topology after severing these springs in order.
    ///
    /// # Errors
    /// If a spring is not a living spring of the lattice at its turn, or is not named by its forward direction.
    pub fn replay(lattice: &Lattice, severed: &[SeveredSpring]) -> Result<Self, ReplayError> {
        let mut topology = Self::new(lattice);
        for (index, &spring) in severed.iter().enumerate() {
            let SeveredSpring { particle, direction, .. } = spring;
            let forward = (neighbours::FIRST_FORWARD..neighbours::NEIGHBOURS).contains(&usize::from(direction));
            if !forward || particle as usize >= lattice.len() || !topology.sever(lattice, spring) {
                return Err(ReplayError { index, particle, direction });
            }
        }
        Ok(topology)
    }

    /// Living springs of each particle, one bit per direction of [`neighbours::OFFSETS`]. Shape `[particles]`.
    pub fn alive(&self) -> &[u32] {
        &self.alive
    }

    /// Every severed spring in the order of severing.
    pub fn severed(&self) -> &[SeveredSpring] {
        &self.severed
    }

    /// The eight corners (x fastest) of the cell above a particle, towards +x, +y, +z, when all 28 springs between them
    /// are alive; `None` when one is not, or a corner is missing.
    pub fn whole_cell(&self, lattice: &Lattice, particle: u32) -> Option<[u32; 8]> {
        let intact =
            |corner: usize, particle: u32| self.alive[particle as usize] & CELL_SPRINGS[corner] == CELL_SPRINGS[corner];
        // A corner with its seven springs has the seven others for neighbours, so none of them lies outside the grid.
        if !intact(0, particle) {
            return None;
        }
        let corner = corners(lattice.grid.shape, lattice.points[particle as usize] as usize)
            .map(|point| lattice.particle_at[point]);
        debug_assert!(!corner.contains(&NO_PARTICLE));
        (1..8).all(|c| intact(c, corner[c])).then_some(corner)
    }

    /// How many of the 28 springs of the cell above a particle were severed; 0 where there is no cell.
    pub fn severed_in_cell(&self, lattice: &Lattice, particle: u32) -> u32 {
        let corners = lattice.cell(particle).into_iter().flatten().enumerate();
        let ends = corners.map(|(corner, particle)| {
            let rest = lattice.springs[particle as usize] & CELL_SPRINGS[corner];
            (rest & !self.alive[particle as usize]).count_ones()
        });
        ends.sum::<u32>() / 2
    }

    /// Removes a spring; returns false when it was not alive (cutting twice changes nothing).
    ///
    /// # Panics
    /// If `spring.direction` is not a forward direction.
    pub fn sever(&mut self, lattice: &Lattice, spring: SeveredSpring) -> bool {
        let direction = usize::from(spring.direction);
        assert!((neighbours::FIRST_FORWARD..neighbours::NEIGHBOURS).contains(&direction));
        if self.alive[spring.particle as usize] & (1 << direction) == 0 {
            return false;
        }
        let other = lattice.neighbour(spring.particle, direction).expect("a living spring has two ends");
        // Copied from the lattice at the first cut.
        let alive = Arc::make_mut(&mut self.alive);
        alive[spring.particle as usize] &= !(1 << direction);
        alive[other as usize] &= !(1 << neighbours::opposite(direction));
        self.severed.push(spring);
        true
    }
}
