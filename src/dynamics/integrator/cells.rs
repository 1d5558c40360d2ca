//! Volume terms and fibres of the cells in f64: forces, energy and tangent, cell by cell.
//!
//! The laws are those of [`crate::kernel::volume`] and [`crate::kernel::fibres`]. A cell turns the displacements of its corners into
//! one mean gradient `G`, that into one stress `S`, and gives `-h^3 S g_c` to each corner; particles gather from the cells around
//! them, so the result depends on no thread. Over a step of an implicit method the viscosity resists `e - e'`, the change of
//! volume since the step began, and adds `eta / (2 dt) h^3 (e - e')^2` to the energy.
//!
//! The tangent is `h^3 q (cof F) (cof F)^T` of a volume term, with `q = L + eta / dt`, and the exact one of the fibres. Exact, it has
//! the change of `cof F` itself as well (a pressure times the curvature of the volume), and negative moduli; without these
//! it is never negative.

use rayon::prelude::*;

use super::field::{Field, Real};
use crate::geometry::{Matrix3, Vector3};
use crate::lattice::layout::{BLOCK_LEN, BlockLayout};
use crate::lattice::{Lattice, Topology};
use crate::material::Assembly;

/// Cells that one task works through.
const CHUNK: usize = 1024;
/// No cell.
const NONE: u32 = u32::MAX;

/// One cell with a volume term or fibres.
#[derive(Debug, Clone)]
struct Cell {
    /// Slots of its corners, x fastest.
    corners: [u32; 8],
    /// Volume modulus [Pa] and viscosity [Pa s].
    modulus: f64,
    viscosity: f64,
    /// Fibres [Pa^1/2].
    root: Vector3,
}

/// What the tangent of a cell is made of.
#[derive(Debug, Clone, Copy, Default)]
struct CellTangent {
    /// `F` and its cofactor.
    deformation: Matrix3,
    cofactor: Matrix3,
    /// `q h^3`, and the pressure times `h^3` where the tangent is exact [N m].
    stiffness: f64,
    pressure: f64,
    /// Of taut fibres.
    taut: Matrix3,
}

/// What the cells resist besides a change of shape.
#[derive(Clone, Copy)]
pub(super) enum CellRate<'a> {
    /// Nothing.
    None,
    /// Velocities [m/s].
    Velocity(&'a Field<f64>),
    /// The change since the step of so many per second began at these displacements [m].
    Earlier(&'a Field<f64>, f64),
}

/// All cells of a lattice that have a volume term or fibres.
#[derive(Debug, Clone)]
pub(super) struct Cells {
    pitch: f64,
    cells: Vec<Cell>,
    /// Number among the cells of the cell above each particle.
    above: Vec<u32>,
    /// Where the list of each slot begins, and eight times the cell plus the corner.
    first: Vec<u32>,
    around: Vec<u32>,
    stress: Vec<Matrix3>,
    tangent: Vec<CellTangent>,
}

impl Cells {
    pub(super) fn new(
        lattice: &Lattice,
        topology: &Topology,
        layout: &BlockLayout,
        assembly: &Assembly,
    ) -> Option<Self> {
        let (volume, fibres) = (assembly.volume.as_ref(), assembly.fibres.as_ref());
        if volume.is_none() && fibres.is_none() {
            return None;
        }
        let mut above = vec![NONE; lattice.len()];
        let mut cells = Vec::new();
        for particle in 0..lattice.len() as u32 {
            let p = particle as usize;
            let modulus = volume.map_or(0.0, |term| f64::from(term.modulus[p]));
            let viscosity = volume.and_then(|term| term.viscosity.as_ref()).map_or(0.0, |eta| f64::from(eta[p]));
            let root = fibres.map_or(Vector3::zeros(), |term| Vector3::from(term.root[p].map(f64::from)));
            if modulus == 0.0 && root == Vector3::zeros() {
                continue;
            }
            let Some(corners) = topology.whole_cell(lattice, particle) else { continue };
            above[p] = cells.len() as u32;
            let corners = corners.map(|corner| layout.slot[corner as usize]);
            // As in the fast body: what has no modulus has no viscosity either.
            let viscosity = if modulus == 0.0 { 0.0 } else { viscosity };
            cells.push(Cell { corners, modulus, viscosity, root });
        }
        let mut first = vec![0_u32; layout.slots() + 1];
        for slot in cells.iter().flat_map(|cell| cell.corners) {
            first[slot as usize + 1] += 1;
        }
        for slot in 0..layout.slots() {
            first[slot + 1] += first[slot];
        }
        let mut next = first.clone();
        let mut around = vec![0; 8 * cells.len()];
        for (number, cell) in cells.iter().enumerate() {
            for (corner, &slot) in cell.corners.iter().enumerate() {
                around[next[slot as usize] as usize] = (8 * number + corner) as u32;
                next[slot as usize] += 1;
            }
        }
        let none = vec![Matrix3::zeros(); cells.len()];
        Some(Self { pitch: lattice.pitch, cells, above, first, around, stress: none, tangent: Vec::new() })
    }

    /// Bytes held, with a tangent.
    pub(super) fn bytes(&self) -> usize {
        self.cells.len() * (size_of::<Cell>() + 32 + size_of::<Matrix3>() + size_of::<CellTangent>())
            + 4 * (self.above.len() + self.first.len())
    }

    /// Takes its term and its fibres from the cell above a particle.
    pub(super) fn drop_cell(&mut self, particle: u32) {
        let number = std::mem::replace(&mut self.above[particle as usize], NONE);
        if number != NONE {
            let cell = &mut self.cells[number as usize];
            (cell.modulus, cell.viscosity, cell.root) = (0.0, 0.0, Vector3::zeros());
        }
    }

    /// Adds the forces of the cells [N]; returns their energy [J].
    pub(super) fn add_forces(&mut self, displacement: &Field<f64>, rate: CellRate<'_>, force: &mut Field<f64>) -> f64 {
        let h = self.pitch;
        let cube = h.powi(3);
        let of_cell = |cell: &Cell, stress: &mut Matrix3| -> f64 {
            let g = gradient(h, cell, displacement);
            let f = Matrix3::identity() + g;
            let change = volume_change(&g);
            let (mut pressure, mut energy) = (cell.modulus * change, 0.5 * cell.modulus * change * change);
            if cell.modulus < 0.0 {
                let bound = 1.0 + change * change;
                pressure /= bound * bound;
                energy /= bound;
            }
            let cofactor = cofactor(&f);
            if cell.viscosity > 0.0 {
                match rate {
                    CellRate::None => {}
                    CellRate::Velocity(velocity) => {
                        pressure += cell.viscosity * cofactor.dot(&gradient(h, cell, velocity));
                    }
                    CellRate::Earlier(before, per_step) => {
                        let grown = change - volume_change(&gradient(h, cell, before));
                        pressure += cell.viscosity * per_step * grown;
                        energy += 0.5 * cell.viscosity * per_step * grown * grown;
                    }
                }
            }
            *stress = cofactor * (pressure * cube);
            if cell.root != Vector3::zeros() {
                let (moved, stretch) = drawn(&cell.root, &g);
                if stretch > 0.0 {
                    *stress += moved.normalize() * cell.root.transpose() * (stretch * cube);
                    energy += 0.5 * stretch * stretch;
                }
            }
            energy * cube
        };
        let chunks = self.stress.par_chunks_mut(CHUNK).zip(self.cells.par_chunks(CHUNK));
        let energies: Vec<f64> = chunks
            .map(|(stress, cells)| cells.iter().zip(stress).map(|(cell, stress)| of_cell(cell, stress)).sum())
            .collect();
        self.gather(force, -1.0);
        energies.into_iter().sum()
    }

    /// Takes the tangent at these displacements and adds its diagonal blocks, these without what is negative: xx, yy, zz, yz,
    /// xz, xy [N/m].
    pub(super) fn take_tangent(
        &mut self,
        displacement: &Field<f64>,
        rate: CellRate<'_>,
        exact: bool,
        diagonal: &mut [Vec<f64>; 6],
    ) {
        let h = self.pitch;
        let cube = h.powi(3);
        self.tangent.resize(self.cells.len(), CellTangent::default());
        self.tangent.par_iter_mut().zip(&self.cells).with_min_len(CHUNK).for_each(|(tangent, cell)| {
            let g = gradient(h, cell, displacement);
            let deformation = Matrix3::identity() + g;
            let change = volume_change(&g);
            let (mut stiffness, mut pressure) = (cell.modulus, cell.modulus * change);
            if cell.modulus < 0.0 {
                let square = change * change;
                pressure /= (1.0 + square).powi(2);
                stiffness *= (1.0 - 3.0 * square) / (1.0 + square).powi(3);
            }
            if let CellRate::Earlier(before, per_step) = rate
                && cell.viscosity > 0.0
            {
                stiffness += cell.viscosity * per_step;
                pressure += cell.viscosity * per_step * (change - volume_change(&gradient(h, cell, before)));
            }
            if !exact {
                (stiffness, pressure) = (stiffness.max(0.0), 0.0);
            }
            let mut taut = Matrix3::zeros();
            if cell.root != Vector3::zeros() {
                let (moved, stretch) = drawn(&cell.root, &g);
                if stretch > 0.0 {
                    let along = moved.normalize();
                    let across = stretch / moved.norm();
                    taut = (along * along.transpose() * (1.0 - across) + Matrix3::identity() * across) * cube;
                }
            }
            let cofactor = cofactor(&deformation);
            *tangent =
                CellTangent { deformation, cofactor, stiffness: stiffness * cube, pressure: pressure * cube, taut };
        });
        let [xx, yy, zz, yz, xz, xy] = diagonal.each_mut().map(|entry| entry.par_chunks_mut(BLOCK_LEN));
        let blocks = ((xx, yy, zz), (yz, xz, xy)).into_par_iter().enumerate();
        blocks.for_each(|(block, ((xx, yy, zz), (yz, xz, xy)))| {
            for own in 0..BLOCK_LEN {
                for (number, corner) in self.around(block * BLOCK_LEN + own) {
                    let shape = shape_gradient(h, corner);
                    let CellTangent { cofactor, stiffness, taut, .. } = &self.tangent[number];
                    let (w, q) = (cofactor * shape, stiffness.max(0.0));
                    let fibre = taut * self.cells[number].root.dot(&shape).powi(2);
                    xx[own] += q * w.x * w.x + fibre[(0, 0)];
                    yy[own] += q * w.y * w.y + fibre[(1, 1)];
                    zz[own] += q * w.z * w.z + fibre[(2, 2)];
                    yz[own] += q * w.y * w.z + fibre[(1, 2)];
                    xz[own] += q * w.x * w.z + fibre[(0, 2)];
                    xy[own] += q * w.x * w.y + fibre[(0, 1)];
                }
            }
        });
    }

    /// Adds the tangent taken last times a vector.
    pub(super) fn add_product(&mut self, vector: &Field<f64>, product: &mut Field<f64>) {
        let h = self.pitch;
        let parts = self.stress.par_iter_mut().zip(&self.cells).zip(&self.tangent);
        parts.with_min_len(CHUNK).for_each(|((stress, cell), tangent)| {
            let g = gradient(h, cell, vector);
            *stress = tangent.cofactor * (tangent.stiffness * tangent.cofactor.dot(&g));
            if tangent.pressure != 0.0 {
                *stress += cofactor_change(&tangent.deformation, &g) * tangent.pressure;
            }
            if cell.root != Vector3::zeros() {
                *stress += tangent.taut * (g * cell.root) * cell.root.transpose();
            }
        });
        self.gather(product, 1.0);
    }

    /// Adds `factor S g_c` of every cell around to each slot.
    fn gather(&self, out: &mut Field<f64>, factor: f64) {
        let [x, y, z] = out.each_mut().map(|axis| axis.par_chunks_mut(BLOCK_LEN));
        (x, y, z).into_par_iter().enumerate().for_each(|(block, (x, y, z))| {
            for own in 0..BLOCK_LEN {
                let mut sum = Vector3::zeros();
                for (number, corner) in self.around(block * BLOCK_LEN + own) {
                    sum += self.stress[number] * shape_gradient(self.pitch, corner);
                }
                x[own] += factor * sum.x;
                y[own] += factor * sum.y;
                z[own] += factor * sum.z;
            }
        });
    }

    /// The cells around a slot, each with the corner the slot is.
    fn around(&self, slot: usize) -> impl Iterator<Item = (usize, usize)> {
        let own = &self.around[self.first[slot] as usize..self.first[slot + 1] as usize];
        own.iter().map(|&place| (place as usize / 8, place as usize % 8))
    }
}

/// Mean gradient of a field over a cell.
fn gradient(h: f64, cell: &Cell, field: &Field<f64>) -> Matrix3 {
    let mut g = Matrix3::zeros();
    for axis in 0..3 {
        let value = cell.corners.map(|slot| field[axis][slot as usize].wide());
        let [a, b, c, d, e, f, p, q] = value;
        g[(axis, 0)] = (b - a) + (d - c) + (f - e) + (q - p);
        g[(axis, 1)] = (c - a) + (d - b) + (p - e) + (q - f);
        g[(axis, 2)] = (e - a) + (f - b) + (p - c) + (q - d);
    }
    g * (0.25 / h)
}

/// Derivative of the mean gradient with respect to the value at a corner: `(+-1, +-1, +-1) / 4h`.
fn shape_gradient(h: f64, corner: usize) -> Vector3 {
    Vector3::from_fn(|axis, _| if corner >> axis & 1 == 1 { 0.25 / h } else { -0.25 / h })
}

/// `det(I + G) - 1` without cancellation.
fn volume_change(g: &Matrix3) -> f64 {
    g.trace() + cofactor(g).trace() + g.determinant()
}

/// The derivative of the determinant.
fn cofactor(f: &Matrix3) -> Matrix3 {
    let [x, y, z] = [0, 1, 2].map(|axis| f.column(axis).into_owned());
    Matrix3::from_columns(&[y.cross(&z), z.cross(&x), x.cross(&y)])
}

/// The change of [`cofactor`] with a change of its matrix.
fn cofactor_change(f: &Matrix3, change: &Matrix3) -> Matrix3 {
    let [x, y, z] = [0, 1, 2].map(|axis| f.column(axis).into_owned());
    let [a, b, c] = [0, 1, 2].map(|axis| change.column(axis).into_owned());
    Matrix3::from_columns(&[b.cross(&z) + y.cross(&c), c.cross(&x) + z.cross(&a), a.cross(&y) + x.cross(&b)])
}

/// `b + G b`, and by how much it is longer than `b`.
fn drawn(root: &Vector3, g: &Matrix3) -> (Vector3, f64) {
    let change = g * root;
    let moved = root + change;
    (moved, change.dot(&(2.0 * root + change)) / (moved.norm() + root.norm()))
}
