//! Which springs are alive, and when and where the others were severed.

use super::{Lattice, neighbours};

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
    alive: Vec<u32>,
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
        self.alive[spring.particle as usize] &= !(1 << direction);
        self.alive[other as usize] &= !(1 << neighbours::opposite(direction));
        self.severed.push(spring);
        true
    }
}
