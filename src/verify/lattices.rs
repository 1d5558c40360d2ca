//! Small bodies of tissue to try things out on.

use crate::dynamics::World;
use crate::geometry::{Affine, Grid, GridShape, Vector3};
use crate::lattice::Lattice;
use crate::lattice::build::OrganMap;
use crate::lattice::cells::build_cells;
use crate::material::Assembly;
use crate::material::tissue::{Damping, TissueBody, assemble};

/// Pitch of these bodies [mm].
pub(super) const PITCH: f64 = 3.0;

/// Soft tissue without damping.
pub(super) const MATERIAL: TissueBody =
    TissueBody { youngs_modulus: 5e3, poissons_ratio: 0.25, density: 1000.0, damping: Damping::Ratio(0.0) };

/// A lattice with its constants.
pub(super) struct Solid {
    pub(super) lattice: Lattice,
    pub(super) assembly: Assembly,
}

/// A bar of cells of one material.
pub(super) fn bar(cells: [usize; 3], body: TissueBody) -> Solid {
    composite(cells, &[body], |_| 0)
}

/// A bar whose cells are of the material with the number that `organ` gives.
pub(super) fn composite(cells: [usize; 3], bodies: &[TissueBody], organ: impl Fn([usize; 3]) -> u8) -> Solid {
    composite_at(PITCH, cells, bodies, organ)
}

/// The same with another pitch [mm].
pub(super) fn composite_at(
    pitch: f64,
    cells: [usize; 3],
    bodies: &[TissueBody],
    organ: impl Fn([usize; 3]) -> u8,
) -> Solid {
    let shape = GridShape::new(cells[0], cells[1], cells[2]);
    let affine = Affine::from_spacing([pitch; 3], [0.0; 3]).expect("a spacing");
    let organs = (0..shape.len()).map(|voxel| organ(shape.ijk(voxel))).collect();
    let lattice = build_cells(&OrganMap::from_vec(Grid { shape, affine }, organs), None).expect("cells");
    let bodies: Vec<Option<TissueBody>> = bodies.iter().copied().map(Some).collect();
    let assembly = assemble(&lattice, &bodies);
    Solid { lattice, assembly }
}

impl Solid {
    /// Particles `count` cells from the low end along an axis.
    pub(super) fn layer(&self, axis: usize, count: usize) -> Vec<u32> {
        (0..self.lattice.len() as u32).filter(|&p| self.lattice.ijk(p)[axis] == count + 1).collect()
    }

    /// Rest place of a particle from the low corner [m].
    pub(super) fn place(&self, particle: u32) -> Vector3 {
        Vector3::from(self.lattice.ijk(particle).map(|n| n as f64 - 1.0)) * self.lattice.pitch
    }

    /// This body in motion.
    pub(super) fn world(self, dt: f64) -> World {
        World::new(self.lattice, self.assembly, dt)
    }
}
