//! Isotropic elastic tissue, assembled by cells.
//!
//! A cell is the cube between eight neighbouring particles. It gives `k1 / 4` to each of its 12 edges, `k2 / 2` to each
//! of its 12 face diagonals, `k3` to each of its 4 body diagonals, and an eighth of its mass to each corner. With
//!
//! ```text
//! C11 = (k1 + 2 k2 + 4/3 k3) / h        C12 = C44 = (k2 + 4/3 k3) / h
//! ```
//!
//! the lattice is isotropic iff `k1 = k2 + 8/3 k3`. Then Lame's constants are equal and Poisson's ratio is 1/4, the
//! limit of any lattice of central forces. Among these, `k2 = k3 = 6 E h / 35` and `k1 = 22 E h / 35`.
//!
//! Cells at an organ's border are partly filled: a voxel gives an eighth of itself to each of the eight cells around
//! its particle, so mass and cross-section of an organ are those of its voxels, exactly.
//!
//! Source: the stiffness tensor of a central-force lattice is Born's, `C = 1/(2V) sum k L^2 n n n n`; equal constants for
//! edge and diagonals, as commonly used, give a Young's modulus that differs twofold between directions.

use rayon::prelude::*;

use super::{Assembly, SpringConstants};
use crate::lattice::build::corners;
use crate::lattice::{FRINGE, Lattice, NO_PARTICLE};

/// Constants of one organ in model `tissue`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TissueBody {
    /// Young's modulus [Pa].
    pub youngs_modulus: f64,
    /// Poisson's ratio, from 0 to 0.49; at 1/4 springs alone are enough.
    pub poissons_ratio: f64,
    /// Density [kg/m^3].
    pub density: f64,
    /// How motion dies out.
    pub damping: Damping,
}

/// Damping in proportion to stiffness, given in one of two ways.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Damping {
    /// Relative to critical at the lattice's own frequency `sqrt(E / density) / pitch`; slower modes are damped less, in
    /// proportion to their frequency. The finer the lattice, the less a mode of given frequency is damped.
    Ratio(f64),
    /// Viscosity of a slowly pulled bar [Pa s]: stress is `E` times strain plus this times the rate of strain. The same
    /// material at every pitch.
    Viscosity(f64),
}

impl TissueBody {
    /// Ratio of damping to stiffness [s].
    pub fn damping_time(&self, pitch: f64) -> f64 {
        match self.damping {
            Damping::Ratio(ratio) => 2.0 * ratio * pitch * (self.density / self.youngs_modulus).sqrt(),
            Damping::Viscosity(viscosity) => viscosity / self.youngs_modulus,
        }
    }

    /// Young's modulus of springs that have this material's shear modulus and a Poisson's ratio of 1/4 [Pa].
    pub fn spring_modulus(&self) -> f64 {
        2.5 * self.youngs_modulus / (2.0 * (1.0 + self.poissons_ratio))
    }

    /// What the volume term adds to the springs' bulk: Lame's first constant less the shear modulus [Pa].
    pub fn volume_modulus(&self) -> f64 {
        let nu = self.poissons_ratio;
        self.youngs_modulus * (4.0 * nu - 1.0) / (2.0 * (1.0 + nu) * (1.0 - 2.0 * nu))
    }
}

/// What a full cell of Young's modulus 1 Pa gives to each face, face-diagonal and body-diagonal spring [m].
pub fn cell_weights(pitch: f64) -> [f32; 3] {
    [22.0 / 140.0, 6.0 / 70.0, 6.0 / 35.0].map(|weight| (weight * pitch) as f32)
}

/// Masses and spring constants of a lattice of model `tissue`. `bodies[organ]` is `None` for a rigid organ.
///
/// A rigid corner counts as the mean of its cell's soft corners, so that an attachment is as stiff as the tissue.
pub fn assemble(lattice: &Lattice, bodies: &[Option<TissueBody>]) -> Assembly {
    let volume = lattice.pitch.powi(3);
    let cells: Vec<Cell> =
        (0..lattice.len() as u32).into_par_iter().map(|particle| Cell::above(lattice, particle, bodies)).collect();

    // Gathered, not scattered: the sum runs over the up to eight cells around a particle in a fixed order.
    let shape = lattice.grid.shape;
    let mass = (0..lattice.len() as u32)
        .into_par_iter()
        .map(|particle| {
            let organ = lattice.organ[particle as usize];
            if organ != FRINGE && bodies[usize::from(organ)].is_none() {
                return 0.0;
            }
            let ijk = lattice.ijk(particle);
            let mut density = 0.0;
            for c in 0..8_i32 {
                let below = [-(c & 1), -(c >> 1 & 1), -(c >> 2)];
                let corner = shape.neighbour(ijk, below).map_or(NO_PARTICLE, |point| lattice.particle_at[point]);
                if corner != NO_PARTICLE {
                    density += cells[corner as usize].density;
                }
            }
            (density * volume / 8.0) as f32
        })
        .collect();

    let weight = cell_weights(lattice.pitch);
    let damped = bodies.iter().flatten().any(|body| body.damping_time(lattice.pitch) > 0.0);
    Assembly {
        mass,
        stiffness: SpringConstants::SumOfCells { cell: cells.iter().map(|cell| cell.modulus as f32).collect(), weight },
        damping: damped.then(|| SpringConstants::SumOfCells {
            cell: cells.iter().map(|cell| cell.viscosity as f32).collect(),
            weight,
        }),
        volume: None,
        rigid: None,
    }
}

/// Averages over a cell, already scaled by how much of it is tissue.
#[derive(Clone, Copy, Default)]
struct Cell {
    /// [Pa]
    modulus: f64,
    /// Modulus times damping time [Pa s].
    viscosity: f64,
    /// [kg/m^3]
    density: f64,
}

impl Cell {
    fn above(lattice: &Lattice, particle: u32, bodies: &[Option<TissueBody>]) -> Self {
        let shape = lattice.grid.shape;
        let ijk = lattice.ijk(particle);
        if (0..3).any(|axis| ijk[axis] + 1 >= shape.dims()[axis]) {
            return Self::default();
        }
        let mut sum = Self::default();
        let (mut soft, mut rigid) = (0.0, 0.0);
        for corner in corners(shape, lattice.points[particle as usize] as usize) {
            let corner = lattice.particle_at[corner];
            if corner == NO_PARTICLE || lattice.organ[corner as usize] == FRINGE {
                continue;
            }
            match &bodies[usize::from(lattice.organ[corner as usize])] {
                Some(body) => {
                    soft += 1.0;
                    sum.modulus += body.youngs_modulus;
                    sum.viscosity += body.youngs_modulus * body.damping_time(lattice.pitch);
                    sum.density += body.density;
                }
                None => rigid += 1.0,
            }
        }
        if soft == 0.0 {
            return Self::default();
        }
        let scale = (soft + rigid) / (8.0 * soft);
        Self { modulus: sum.modulus * scale, viscosity: sum.viscosity * scale, density: sum.density * scale }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Affine, Grid, GridShape, Vector3};
    use crate::lattice::build::{Border, build};
    use crate::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS, OFFSETS};
    use crate::volume::Volume;

    const BODY: TissueBody =
        TissueBody { youngs_modulus: 5e3, poissons_ratio: 0.25, density: 1060.0, damping: Damping::Ratio(0.2) };

    fn block(n: usize) -> Lattice {
        let grid = Grid { shape: GridShape::new(n, n, n), affine: Affine::from_spacing([3.0; 3], [0.0; 3]).unwrap() };
        build(&Volume::from_vec(grid, vec![0; n * n * n]), Border::Cells, &[false]).unwrap()
    }

    #[test]
    fn mass_is_that_of_the_voxels() {
        let lattice = block(5);
        let assembly = assemble(&lattice, &[Some(BODY)]);
        let total: f64 = assembly.mass.iter().map(|&m| f64::from(m)).sum();
        let expected = 1060.0 * 125.0 * 3e-3_f64.powi(3);
        assert!((total / expected - 1.0).abs() < 1e-6, "{total} {expected}");
        assert!(assembly.mass.iter().all(|&m| m > 0.0));
    }

    /// Born's sum over the springs of one interior particle gives the stiffness tensor of the bulk.
    #[test]
    fn the_bulk_is_isotropic_with_poissons_ratio_one_quarter() {
        let lattice = block(5);
        let assembly = assemble(&lattice, &[Some(BODY)]);
        let h = lattice.pitch;
        let middle = lattice.particle_at[lattice.grid.shape.linear([3, 3, 3])];
        let (mut c11, mut c12, mut c44) = (0.0, 0.0, 0.0);
        for direction in FIRST_FORWARD..NEIGHBOURS {
            let k = assembly.stiffness.of(&lattice, middle, direction);
            let r = Vector3::from(OFFSETS[direction].map(f64::from)) * h;
            let n = r.normalize();
            let scale = k * r.norm_squared() / h.powi(3);
            c11 += scale * n.x.powi(4);
            c12 += scale * n.x.powi(2) * n.y.powi(2);
            c44 += scale * n.x.powi(2) * n.y.powi(2);
        }
        let mu = 5e3 / 2.5;
        assert!(
            (c44 / mu - 1.0).abs() < 1e-6 && (c12 / mu - 1.0).abs() < 1e-6 && (c11 / (3.0 * mu) - 1.0).abs() < 1e-6
        );
    }

    #[test]
    fn border_cells_are_scaled_by_their_tissue() {
        let grid = Grid { shape: GridShape::new(1, 1, 1), affine: Affine::from_spacing([2.0; 3], [0.0; 3]).unwrap() };
        let lattice = build(&Volume::from_vec(grid, vec![0]), Border::Cells, &[false]).unwrap();
        let assembly = assemble(&lattice, &[Some(BODY)]);
        let SpringConstants::SumOfCells { cell, .. } = &assembly.stiffness else { panic!("tissue sums cells") };
        assert_eq!(cell.iter().filter(|&&e| e == 5e3 / 8.0).count(), 8);
        assert_eq!(cell.iter().filter(|&&e| e == 0.0).count(), 19);
    }
}
