//! How far the tissue is strained: one number per particle, from the displacements of a frame.
//!
//! ```text
//! cell      mean displacement gradient G over the cell: the four edges along each axis, exact for trilinear displacement
//!           Green-Lagrange strain E = (G + G^T + G^T G) / 2
//! particle  mean of E over the whole cells around it
//!           none is whole: G by least squares over the living springs, as the surface is carried
//! then      equivalent strain sqrt(2/3 dev E : dev E)
//! ```
//! E is zero under every rigid motion and stays finite in a crushed or inverted cell, where logarithmic strain does not. At
//! small strain the equivalent strain of a pulled incompressible bar is its elongation, and that of simple shear by `g` is
//! `g / sqrt(3)`. It says nothing of a change of volume alone.
//!
//! Source: Green-Lagrange strain as in Bonet and Wood, Nonlinear continuum mechanics for finite element analysis, 2nd ed.
//! (2008), chapter 4; the equivalent is von Mises' measure with the factor customary for strain.

use nalgebra::SMatrix;
use rayon::prelude::*;

use crate::geometry::{Affine, Matrix3, Vector3};
use crate::lattice::{Lattice, Topology};
use crate::surface::gradient::Gradients;
use crate::surface::hinged::Hinged;

/// Particles per parallel task.
const PARTICLES_PER_TASK: usize = 1 << 12;

/// A symmetric tensor: xx, yy, zz, xy, xz, yz.
type Symmetric = [f32; 6];

/// Equivalent Green-Lagrange strain of the tissue around each particle, without unit.
///
/// - `displacements_mm`: from rest, RAS+ \[mm\]. Shape `[particles, 3]`.
/// - Cells with a severed spring count for nothing, so an open cut does not look like a stretch; nor do particles that a cut has
///   left hinged, which count as the surface draws them.
///
/// O(particles), parallel, the same bits at any number of threads.
///
/// # Panics
/// If there is not one displacement per particle.
///
/// # Accuracy
/// f64 between displacements and strains of cells, f32 afterwards: 0 to within 1e-6 under rigid motions by up to some
/// hundred pitches, where the rounding of the displacements themselves takes over.
pub fn equivalent_strains(lattice: &Lattice, topology: &Topology, displacements_mm: &[[f32; 3]]) -> Vec<f32> {
    assert_eq!(displacements_mm.len(), lattice.len(), "one displacement per particle");
    let displacements_mm = &*Hinged::find(lattice, topology).steadied(lattice, displacements_mm);
    let to_index = inverse_axes(&lattice.grid.affine);
    let cells: Vec<Option<Symmetric>> = (0..lattice.len() as u32)
        .into_par_iter()
        .with_min_len(PARTICLES_PER_TASK)
        .map(|particle| {
            let corners = topology.whole_cell(lattice, particle)?;
            Some(green_lagrange(&(cell_gradient(corners.map(|c| displacements_mm[c as usize])) * to_index)))
        })
        .collect();
    let mut strains: Vec<f32> = (0..lattice.len() as u32)
        .into_par_iter()
        .with_min_len(PARTICLES_PER_TASK)
        .map(|particle| {
            let whole = lattice.cells_around(particle).filter_map(|cell| cells[cell as usize].as_ref());
            let (mut sum, mut count) = ([0.0_f64; 6], 0);
            for strain in whole {
                count += 1;
                sum.iter_mut().zip(strain).for_each(|(sum, part)| *sum += f64::from(*part));
            }
            // NaN: no whole cell.
            equivalent(sum.map(|part| part / f64::from(count)))
        })
        .collect();
    let left: Vec<u32> = (0..lattice.len() as u32).filter(|&p| strains[p as usize].is_nan()).collect();
    let (gradients, index) = Gradients::new(lattice, topology.alive(), &left);
    let gradients = gradients.evaluate(lattice, displacements_mm);
    for (&particle, &at) in left.iter().zip(&index) {
        let columns = gradients[at as usize].map(|column| Vector3::from(column.map(f64::from)));
        let strain = green_lagrange(&(Matrix3::from_columns(&columns) * to_index));
        strains[particle as usize] = equivalent(strain.map(f64::from));
    }
    strains
}

/// Mean change of the displacement over a cell per step along each grid axis \[mm\], as columns. Corners x fastest.
fn cell_gradient(corners: [[f32; 3]; 8]) -> Matrix3 {
    let corners = SMatrix::<f64, 3, 8>::from_fn(|row, corner| f64::from(corners[corner][row]));
    Matrix3::from_columns(&[0, 1, 2].map(|axis| {
        let sign = |corner: usize| if corner >> axis & 1 == 1 { 0.25 } else { -0.25 };
        (0..8).map(|corner| corners.column(corner) * sign(corner)).sum::<Vector3>()
    }))
}

fn green_lagrange(gradient: &Matrix3) -> Symmetric {
    let e = 0.5 * (gradient + gradient.transpose() + gradient.transpose() * gradient);
    [e[(0, 0)], e[(1, 1)], e[(2, 2)], e[(0, 1)], e[(0, 2)], e[(1, 2)]].map(|part| part as f32)
}

fn equivalent([xx, yy, zz, xy, xz, yz]: [f64; 6]) -> f32 {
    let mean = (xx + yy + zz) / 3.0;
    let squares = [xx, yy, zz].map(|part| (part - mean).powi(2)).iter().sum::<f64>()
        + 2.0 * [xy, xz, yz].map(|part| part.powi(2)).iter().sum::<f64>();
    (squares * 2.0 / 3.0).sqrt() as f32
}

fn inverse_axes(affine: &Affine) -> Matrix3 {
    Matrix3::from_columns(&[Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| affine.index_vector_of(axis)))
}
