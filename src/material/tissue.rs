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
//! Any other Poisson's ratio: the springs are sized for the shear modulus, and every cell adds the energy
//! `1/2 (lambda - mu) h^3 (J - 1)^2` of its mean change of volume (see [`VolumeTerm`]).
//!
//! Cells are voxels, so mass, cross-section and interfaces of organs are those of the voxels, exactly; a voxel that is
//! partly tissue has so much less of everything.
//!
//! Source: the stiffness tensor of a central-force lattice is Born's, `C = 1/(2V) sum k L^2 n n n n`; equal constants for
//! edge and diagonals, as commonly used, give a Young's modulus that differs twofold between directions.

use rayon::prelude::*;

use super::{Assembly, RigidKind, RigidParts, SpringConstants, VolumeTerm};
use crate::lattice::Lattice;
use crate::lattice::build::NO_ORGAN;

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

/// Masses and spring constants of a lattice of cells. `bodies[organ]` is `None` for a rigid organ.
///
/// Every corner of a rigid cell is rigid and stays where it is; soft cells beside it are as stiff as elsewhere.
///
/// # Panics
/// If the lattice has no cells.
pub fn assemble(lattice: &Lattice, bodies: &[Option<TissueBody>]) -> Assembly {
    assemble_varied(lattice, bodies, &vec![None; bodies.len()], |_| CellValues::default())
}

/// What one cell is made of, where that differs from its organ: `None` for what does not. Of the tissue in the cell; how much
/// of the cell is tissue is for [`assemble_varied`] to count.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CellValues {
    /// Young's modulus [Pa]; of no meaning in a rigid cell.
    pub youngs_modulus: Option<f64>,
    /// Density [kg/m^3]; of no meaning in a rigid cell that stays where it is.
    pub density: Option<f64>,
}

/// The same with rigid organs that move, and with moduli and densities that differ from cell to cell.
///
/// - `rigid_density[organ]`: density of a rigid organ that moves freely [kg/m^3]; `None` for one that stays where it is, and
///   for soft ones. A corner of both kinds stays.
/// - `values(particle)`: of the cell above a particle.
///
/// # Panics
/// If the lattice has no cells.
pub fn assemble_varied(
    lattice: &Lattice,
    bodies: &[Option<TissueBody>],
    rigid_density: &[Option<f64>],
    values: impl Fn(u32) -> CellValues + Sync,
) -> Assembly {
    assert!(lattice.has_cells(), "tissue is made of cells");
    let body_of = |particle: u32| {
        let organ = lattice.cell_organ[particle as usize];
        if organ == NO_ORGAN { None } else { bodies[usize::from(organ)] }
    };
    let cells: Vec<Cell> = (0..lattice.len() as u32)
        .into_par_iter()
        .map(|particle| {
            body_of(particle).map_or(Cell::default(), |body| {
                let values = values(particle);
                let youngs_modulus = values.youngs_modulus.unwrap_or(body.youngs_modulus);
                let density = values.density.unwrap_or(body.density);
                let fill = f64::from(lattice.cell_fill[particle as usize]);
                Cell::new(&TissueBody { youngs_modulus, density, ..body }, fill, lattice.pitch)
            })
        })
        .collect();

    // Gathered, not scattered: the sum runs over the up to eight cells around a particle in a fixed order.
    let (kind, mass): (Vec<RigidKind>, Vec<f32>) = (0..lattice.len() as u32)
        .into_par_iter()
        .map(|particle| {
            let (mut kind, mut density) = (RigidKind::Soft, 0.0);
            for corner in lattice.cells_around(particle) {
                if lattice.cell_organ[corner as usize] == NO_ORGAN {
                    continue;
                }
                let organ = usize::from(lattice.cell_organ[corner as usize]);
                density += match (bodies[organ], rigid_density[organ]) {
                    (Some(_), _) => cells[corner as usize].density,
                    (None, Some(density)) => {
                        kind = RigidKind::Free;
                        values(corner).density.unwrap_or(density) * f64::from(lattice.cell_fill[corner as usize])
                    }
                    (None, None) => return (RigidKind::Anchored, 0.0),
                };
            }
            (kind, (density * lattice.pitch.powi(3) / 8.0) as f32)
        })
        .unzip();

    let weight = cell_weights(lattice.pitch);
    let of_cells = |value: fn(&Cell) -> f64| cells.iter().map(|cell| value(cell) as f32).collect::<Vec<f32>>();
    let damped = cells.iter().any(|cell| cell.viscosity > 0.0);
    Assembly {
        mass,
        stiffness: SpringConstants::SumOfCells { cell: of_cells(|cell| cell.modulus), weight },
        damping: damped.then(|| SpringConstants::SumOfCells { cell: of_cells(|cell| cell.viscosity), weight }),
        volume: cells.iter().any(|cell| cell.volume_modulus != 0.0).then(|| VolumeTerm {
            modulus: of_cells(|cell| cell.volume_modulus),
            viscosity: damped.then(|| of_cells(|cell| cell.volume_viscosity)),
        }),
        fibres: None,
        inelastic: None,
        rigid: RigidParts::new(kind),
    }
}

/// What a cell is made of, already scaled by how much of it is tissue.
#[derive(Clone, Copy, Default)]
struct Cell {
    /// Of the springs [Pa].
    modulus: f64,
    /// Modulus times damping time [Pa s].
    viscosity: f64,
    /// Of the volume term [Pa].
    volume_modulus: f64,
    /// The same times damping time, where it damps at all [Pa s].
    volume_viscosity: f64,
    /// [kg/m^3]
    density: f64,
}

impl Cell {
    fn new(body: &TissueBody, fill: f64, pitch: f64) -> Self {
        let damping_time = body.damping_time(pitch);
        let (modulus, volume_modulus) = (fill * body.spring_modulus(), fill * body.volume_modulus());
        Self {
            modulus,
            viscosity: modulus * damping_time,
            volume_modulus,
            // Below a Poisson's ratio of 1/4 a damper in proportion would drive, not damp.
            volume_viscosity: volume_modulus.max(0.0) * damping_time,
            density: fill * body.density,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Affine, Grid, GridShape, Vector3};
    use crate::lattice::build::OrganMap;
    use crate::lattice::cells::build_cells;
    use crate::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS, OFFSETS};
    use crate::volume::Volume;

    const BODY: TissueBody =
        TissueBody { youngs_modulus: 5e3, poissons_ratio: 0.25, density: 1060.0, damping: Damping::Ratio(0.2) };

    fn block(n: usize) -> Lattice {
        let grid = Grid { shape: GridShape::new(n, n, n), affine: Affine::from_spacing([3.0; 3], [0.0; 3]).unwrap() };
        build_cells(&OrganMap::from_vec(grid, vec![0; n * n * n]), None).unwrap()
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
    fn cells_are_scaled_by_their_tissue() {
        let grid = Grid { shape: GridShape::new(2, 1, 1), affine: Affine::from_spacing([2.0; 3], [0.0; 3]).unwrap() };
        let fill = Volume::from_vec(grid, vec![1.0, 0.25]);
        let lattice = build_cells(&OrganMap::from_vec(grid, vec![0; 2]), Some(&fill)).unwrap();
        let assembly = assemble(&lattice, &[Some(BODY)]);
        let SpringConstants::SumOfCells { cell, .. } = &assembly.stiffness else { panic!("tissue sums cells") };
        let filled: Vec<f32> = cell.iter().copied().filter(|&modulus| modulus > 0.0).collect();
        assert_eq!(filled, [5e3, 1.25e3]);
        let total: f64 = assembly.mass.iter().map(|&m| f64::from(m)).sum();
        assert!((total / (1060.0 * 1.25 * 8e-9) - 1.0).abs() < 1e-6);
        assert_eq!(assembly.volume, None, "at a quarter, springs are enough");
    }

    #[test]
    fn moduli_of_any_poissons_ratio() {
        for nu in [0.0, 0.1, 0.25, 0.3, 0.45, 0.49] {
            let body = TissueBody { poissons_ratio: nu, ..BODY };
            let (mu, lambda) = (5e3 / (2.0 * (1.0 + nu)), 5e3 * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)));
            assert!((body.spring_modulus() / 2.5 - mu).abs() < 1e-9 * mu);
            assert!((body.volume_modulus() - (lambda - mu)).abs() < 1e-9 * mu.max(lambda), "{nu}");
        }
    }

    #[test]
    fn free_bone_has_the_mass_of_its_cells_and_a_share_of_its_neighbours() {
        let grid = Grid { shape: GridShape::new(2, 1, 1), affine: Affine::from_spacing([2.0; 3], [0.0; 3]).unwrap() };
        let lattice = build_cells(&OrganMap::from_vec(grid, vec![0, 1]), None).unwrap();
        let assembly = assemble_varied(&lattice, &[Some(BODY), None], &[None, Some(1900.0)], |_| CellValues::default());
        let total: f64 = assembly.mass.iter().map(|&m| f64::from(m)).sum();
        assert!((total / ((1060.0 + 1900.0) * 8e-9) - 1.0).abs() < 1e-6);
        let kinds = assembly.rigid.expect("bone moves").kind().to_vec();
        assert_eq!(kinds.iter().filter(|&&kind| kind == RigidKind::Free).count(), 8);
    }

    /// Partly filled, soft and rigid: what a particle weighs is an eighth of each cell around it, written out here.
    #[test]
    fn every_cell_has_the_mass_of_its_own_density() {
        let grid = Grid { shape: GridShape::new(4, 3, 2), affine: Affine::from_spacing([2.0; 3], [0.0; 3]).unwrap() };
        let organs = (0..24).map(|voxel| u8::from(voxel % 4 >= 2)).collect();
        let fill = Volume::from_vec(grid, (0..24).map(|voxel| 0.25 + (voxel % 7) as f32 / 8.0).collect());
        let lattice = build_cells(&OrganMap::from_vec(grid, organs), Some(&fill)).unwrap();
        let density = |cell: u32| 900.0 + 37.0 * f64::from(cell);
        let values = |cell| CellValues { density: Some(density(cell)), ..CellValues::default() };
        let assembly = assemble_varied(&lattice, &[Some(BODY), None], &[None, Some(1.0)], values);
        let mut expected = 0.0;
        for particle in 0..lattice.len() as u32 {
            let around = lattice.cells_around(particle).filter(|&cell| lattice.cell_organ[cell as usize] != NO_ORGAN);
            let sum: f64 =
                around.map(|cell| density(cell) * f64::from(lattice.cell_fill[cell as usize]) * 8e-9 / 8.0).sum();
            assert!((f64::from(assembly.mass[particle as usize]) / sum - 1.0).abs() < 1e-6, "particle {particle}");
            expected += sum;
        }
        let total: f64 = assembly.mass.iter().map(|&mass| f64::from(mass)).sum();
        assert!((total / expected - 1.0).abs() < 1e-6);

        // A damping ratio is relative to the cell's own frequency, which goes with its own density.
        let plain = assemble(&lattice, &[Some(BODY), None]);
        let damping = |assembly: &Assembly, cell: usize| match &assembly.damping {
            Some(SpringConstants::SumOfCells { cell: values, .. }) => f64::from(values[cell]),
            _ => panic!("tissue sums cells"),
        };
        for cell in (0..lattice.len()).filter(|&cell| lattice.cell_organ[cell] == 0) {
            let ratio = damping(&assembly, cell) / damping(&plain, cell);
            assert!((ratio - (density(cell as u32) / BODY.density).sqrt()).abs() < 1e-6, "{ratio}");
        }
    }

    #[test]
    fn rigid_cells_hold_their_corners() {
        let grid = Grid { shape: GridShape::new(2, 1, 1), affine: Affine::from_spacing([2.0; 3], [0.0; 3]).unwrap() };
        let lattice = build_cells(&OrganMap::from_vec(grid, vec![0, 1]), None).unwrap();
        let assembly = assemble(&lattice, &[Some(BODY), None]);
        assert_eq!(assembly.mass.iter().filter(|&&mass| mass == 0.0).count(), 8);
        let soft: f32 = assembly.mass.iter().sum();
        assert!((f64::from(soft) / (1060.0 * 8e-9) - 0.5).abs() < 1e-6, "half of the soft cell hangs on free corners");
    }
}
