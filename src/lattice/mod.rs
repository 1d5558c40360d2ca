//! The lattice: one particle per grid point of the organs, joined to its 26 neighbours by springs.
//!
//! A [`Lattice`] is the rest state and never changes. What changes is kept apart: displacements in
//! [`crate::dynamics::World`], living springs in [`Topology`].

mod block_lead;
pub mod build;
pub mod cells;
pub mod layout;
pub mod neighbours;
pub mod region;
mod topology;

pub use topology::{ReplayError, SeveredSpring, Topology};

use std::sync::Arc;

use crate::geometry::{Grid, Point3};

/// Marks a grid point without a particle in [`Lattice::particle_at`].
pub const NO_PARTICLE: u32 = u32::MAX;

/// Organ of a particle beyond the border that is drawn, less than half of whose surroundings is tissue: it has mass and
/// springs, and the surface passes between it and the organ. See [`cells`].
pub const FRINGE: u8 = u8::MAX;

/// The rest state of a lattice: which grid points hold a particle, to which organ it belongs, and which springs join it.
///
/// Particles are numbered by ascending linear grid index (x fastest); every per-particle array follows that order.
#[derive(Debug, Clone)]
pub struct Lattice {
    /// Lattice points in patient space [mm]. The three axes are orthogonal and one [`Lattice::pitch`] long.
    pub grid: Grid,
    /// Distance of neighbouring particles along an axis [m].
    pub pitch: f64,
    /// Linear grid index of each particle, ascending. Shape `[particles]`.
    pub points: Vec<u32>,
    /// Particle of each grid point, or [`NO_PARTICLE`]. Shape `[grid points]`.
    pub particle_at: Vec<u32>,
    /// Organ of each particle: index into the scene's organs, or [`FRINGE`]. Shape `[particles]`.
    pub organ: Vec<u8>,
    /// Living springs of each particle at rest, one bit per direction of [`neighbours::OFFSETS`]. Shape `[particles]`;
    /// shared with every [`Topology`] in which nothing is severed.
    pub springs: Arc<Vec<u32>>,
    /// Organ of the cell above each particle (the cube towards +x, +y, +z), or [`build::NO_ORGAN`] where there is none.
    /// Shape `[particles]`; empty where the voxels are particles and not cells (model `paper`).
    pub cell_organ: Vec<u8>,
    /// How much of that cell is tissue, 0 to 1. Shape `[particles]`, or empty.
    pub cell_fill: Vec<f32>,
}

impl Lattice {
    /// Number of particles.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// True when there is no particle (the builder refuses such lattices).
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Number of springs at rest, each counted once.
    pub fn spring_count(&self) -> usize {
        self.springs.iter().map(|bits| bits.count_ones() as usize).sum::<usize>() / 2
    }

    /// True when the voxels are cells of material and the particles their corners (model `tissue`).
    pub fn has_cells(&self) -> bool {
        !self.cell_organ.is_empty()
    }

    /// The corners of the cell above a particle, x fastest, when there is material in it.
    pub fn cell(&self, particle: u32) -> Option<[u32; 8]> {
        let organ = self.cell_organ.get(particle as usize)?;
        (*organ != build::NO_ORGAN).then(|| {
            build::corners(self.grid.shape, self.points[particle as usize] as usize)
                .map(|point| self.particle_at[point])
        })
    }

    /// Grid index (i, j, k) of a particle.
    pub fn ijk(&self, particle: u32) -> [usize; 3] {
        self.grid.shape.ijk(self.points[particle as usize] as usize)
    }

    /// Rest place of a particle, RAS+ [mm].
    pub fn rest_place(&self, particle: u32) -> Point3 {
        self.grid.place(self.points[particle as usize] as usize)
    }

    /// The particle one step away in `direction`, spring or not.
    pub fn neighbour(&self, particle: u32, direction: usize) -> Option<u32> {
        let offset = neighbours::OFFSETS[direction];
        let point = self.grid.shape.neighbour(self.ijk(particle), offset)?;
        Some(self.particle_at[point]).filter(|&other| other != NO_PARTICLE)
    }

    /// The cells that share the spring of `particle` in `direction`, by their lowest corners, where these hold a particle:
    /// up to 4 for a face spring, 2 for a face diagonal, 1 for a body diagonal.
    pub fn cells_of_spring(&self, particle: u32, direction: usize) -> impl Iterator<Item = u32> {
        let points = cells::cells_of_spring(self.grid.shape, self.ijk(particle), neighbours::OFFSETS[direction]);
        points.map(|point| self.particle_at[point]).filter(|&corner| corner != NO_PARTICLE)
    }

    /// The cells that have a particle as a corner, by their lowest corners, where these hold a particle: up to 8.
    pub fn cells_around(&self, particle: u32) -> impl Iterator<Item = u32> {
        let points = cells::cells_around(self.grid.shape, self.points[particle as usize] as usize);
        points.map(|point| self.particle_at[point]).filter(|&corner| corner != NO_PARTICLE)
    }
}
