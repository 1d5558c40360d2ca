//! Small deflections at rest, solved in f64: the answer that stepping would settle to, without waiting for it.
//!
//! The forces are those of [`crate::kernel::reference`], linearised about rest.

use rayon::prelude::*;

use super::lattices::Solid;
use crate::geometry::Vector3;
use crate::lattice::cells::cells_around;
use crate::lattice::neighbours::{NEIGHBOURS, OFFSETS};
use crate::lattice::{Lattice, NO_PARTICLE, Topology};

/// Conjugate gradients stop when the residual has fallen by this much.
const RESIDUAL: f64 = 1e-11;

/// A lattice of springs and cells near rest.
pub(super) struct Statics<'a> {
    lattice: &'a Lattice,
    /// Along a spring of each direction.
    along: [Vector3; NEIGHBOURS],
    /// [`gradient`] of each corner.
    gradient: [Vector3; 8],
    /// No cell has a modulus.
    without_cells: bool,
    /// Neighbour and spring constant [N/m] in each direction; the constant is 0 where there is no spring.
    springs: Vec<[(u32, f64); NEIGHBOURS]>,
    /// Modulus times volume of the cell above each particle [N m], and its corners.
    cells: Vec<(f64, [u32; 8])>,
    /// The cells around each particle, by the particle below them, and which corner it is.
    around: Vec<Vec<(u32, usize)>>,
}

/// What is known beforehand about each component of each particle's displacement.
pub(super) struct Supports {
    given: Vec<[Option<f64>; 3]>,
}

impl Supports {
    pub(super) fn none(lattice: &Lattice) -> Self {
        Self { given: vec![[None; 3]; lattice.len()] }
    }

    /// Gives a component of a particle's displacement [m].
    pub(super) fn give(&mut self, particle: u32, axis: usize, displacement: f64) {
        self.given[particle as usize][axis] = Some(displacement);
    }
}

impl<'a> Statics<'a> {
    pub(super) fn new(solid: &'a Solid) -> Self {
        let Solid { lattice, assembly } = solid;
        let topology = Topology::new(lattice);
        let springs = (0..lattice.len() as u32)
            .into_par_iter()
            .map(|particle| {
                std::array::from_fn(|direction| match lattice.neighbour(particle, direction) {
                    Some(other) if topology.alive()[particle as usize] >> direction & 1 == 1 => {
                        (other, assembly.stiffness.of(lattice, particle, direction))
                    }
                    _ => (particle, 0.0),
                })
            })
            .collect();
        let modulus =
            |particle: u32| assembly.volume.as_ref().map_or(0.0, |term| term.modulus[particle as usize].into());
        let cells = (0..lattice.len() as u32)
            .map(|particle| match topology.whole_cell(lattice, particle) {
                Some(corners) => (modulus(particle) * lattice.pitch.powi(3), corners),
                None => (0.0, [particle; 8]),
            })
            .collect();
        let shape = lattice.grid.shape;
        let around = (0..lattice.len() as u32)
            .map(|particle| {
                let own = lattice.ijk(particle);
                cells_around(shape, lattice.points[particle as usize] as usize)
                    .filter_map(|cell| {
                        let below = shape.ijk(cell);
                        let corner = (0..3).map(|axis| (own[axis] - below[axis]) << axis).sum();
                        Some((lattice.particle_at[cell], corner)).filter(|&(cell, _)| cell != NO_PARTICLE)
                    })
                    .collect()
            })
            .collect();
        let along = OFFSETS.map(|offset| Vector3::from(offset.map(f64::from)).normalize());
        let gradient = std::array::from_fn(|corner| gradient(lattice.pitch, corner));
        let without_cells = assembly.volume.is_none();
        Self { lattice, along, gradient, without_cells, springs, cells, around }
    }

    /// Force that holds each particle where it is [N], for small displacements [m].
    pub(super) fn holding_forces(&self, displacement: &[Vector3]) -> Vec<Vector3> {
        let of_cell = |(modulus, corners): &(f64, [u32; 8])| {
            if *modulus == 0.0 {
                return 0.0;
            }
            modulus * (0..8).map(|c| self.gradient[c].dot(&displacement[corners[c] as usize])).sum::<f64>()
        };
        let pressure: Vec<f64> =
            if self.without_cells { Vec::new() } else { self.cells.par_iter().map(of_cell).collect() };
        (0..self.lattice.len())
            .into_par_iter()
            .with_min_len(64)
            .map(|particle| {
                let mut force = Vector3::zeros();
                for (along, &(other, constant)) in self.along.iter().zip(&self.springs[particle]) {
                    if constant != 0.0 {
                        let parted = displacement[particle] - displacement[other as usize];
                        force += along * (constant * along.dot(&parted));
                    }
                }
                if !self.without_cells {
                    for &(cell, corner) in &self.around[particle] {
                        force += self.gradient[corner] * pressure[cell as usize];
                    }
                }
                force
            })
            .collect()
    }

    /// Displacements [m] under supports and forces [N], by conjugate gradients. Where nothing supports it, the body stays
    /// where it is on average, if the forces balance.
    pub(super) fn solve(&self, supports: &Supports, force: &[Vector3]) -> Vec<Vector3> {
        let free = |values: &mut Vec<Vector3>| {
            values.par_iter_mut().zip(&supports.given).for_each(|(value, given)| {
                (0..3).filter(|&axis| given[axis].is_some()).for_each(|axis| value[axis] = 0.0);
            });
        };
        let dot = |a: &[Vector3], b: &[Vector3]| a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<f64>();
        let scale: Vec<f64> = self
            .springs
            .iter()
            .map(|springs| {
                let sum: f64 = springs.iter().map(|spring| spring.1).sum();
                if sum > 0.0 { 3.0 / sum } else { 0.0 }
            })
            .collect();
        let scaled = |values: &[Vector3]| values.iter().zip(&scale).map(|(v, s)| v * *s).collect::<Vec<_>>();

        let mut displacement: Vec<Vector3> =
            supports.given.iter().map(|given| Vector3::from(given.map(|value| value.unwrap_or(0.0)))).collect();
        let held = self.holding_forces(&displacement);
        let mut residual: Vec<Vector3> = force.iter().zip(&held).map(|(force, held)| force - held).collect();
        free(&mut residual);
        let mut search = scaled(&residual);
        let mut rho = dot(&residual, &search);
        let target = rho * RESIDUAL * RESIDUAL;
        for _ in 0..20 * self.lattice.len().max(1000) {
            if rho <= target {
                break;
            }
            let mut image = self.holding_forces(&search);
            free(&mut image);
            let step = rho / dot(&search, &image);
            for p in 0..displacement.len() {
                displacement[p] += step * search[p];
                residual[p] -= step * image[p];
            }
            let next = scaled(&residual);
            let new_rho = dot(&residual, &next);
            let share = new_rho / rho;
            rho = new_rho;
            for (search, next) in search.iter_mut().zip(&next) {
                *search = next + share * *search;
            }
        }
        displacement
    }
}

/// Derivative of the cell's mean change of volume by the place of a corner [1/m].
fn gradient(h: f64, corner: usize) -> Vector3 {
    Vector3::from_fn(|axis, _| if corner >> axis & 1 == 1 { 0.25 / h } else { -0.25 / h })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::reference::{spring_forces, volume_forces};
    use crate::verify::lattices::{MATERIAL, bar};

    /// Against the forces of the reference, by central differences.
    #[test]
    fn these_are_the_reference_forces_near_rest() {
        for nu in [0.0, 0.25, 0.45] {
            let solid = bar([3, 4, 5], crate::material::tissue::TissueBody { poissons_ratio: nu, ..MATERIAL });
            let statics = Statics::new(&solid);
            let h = solid.lattice.pitch;
            let shape: Vec<Vector3> = (0..solid.lattice.len())
                .map(|p| Vector3::new((7.3 * p as f64).sin(), (3.1 * p as f64).cos(), (1.7 * p as f64).sin()) * h)
                .collect();
            let topology = Topology::new(&solid.lattice);
            let still = vec![Vector3::zeros(); shape.len()];
            let forces = |scale: f64| {
                let moved: Vec<Vector3> = shape.iter().map(|u| u * scale).collect();
                let (lattice, assembly) = (&solid.lattice, &solid.assembly);
                let springs = spring_forces(lattice, &topology, assembly, &moved, &still, 1.0);
                let cells = volume_forces(lattice, &topology, assembly, &moved, &still, 1.0);
                springs.into_iter().zip(cells).map(|(a, b)| a + b).collect::<Vec<_>>()
            };
            let (plus, minus, linear) = (forces(1e-5), forces(-1e-5), statics.holding_forces(&shape));
            let largest = linear.iter().map(Vector3::norm).fold(0.0, f64::max);
            for p in 0..shape.len() {
                let slope = (minus[p] - plus[p]) / 2e-5;
                assert!((slope - linear[p]).norm() < 1e-6 * largest, "{nu}: particle {p}");
            }
        }
    }
}
