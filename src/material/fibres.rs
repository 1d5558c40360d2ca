//! Fibres of one direction that stiffen a tissue when it is drawn out along them.
//!
//! Every cell adds, to its springs and its volume term,
//!
//! ```text
//! W = 1/2 E_f h^3 (lambda - 1)^2    for lambda > 1, else 0        lambda = |F a|
//! ```
//!
//! with `F` the cell's mean deformation gradient and `a` the direction of its fibres at rest: a bar pulled along them has the
//! slope `E + E_f`, one pulled across them keeps `E`. Fibres that are pressed buckle and do nothing, so along them a bar is
//! stiffer in tension than under pressure. A rotation leaves `lambda` at 1, so it has no force.
//!
//! The tension sets in with a kink at rest. Motion that crosses it again and again gains a little energy from the steps, about
//! 2e-4 of it a step near rest: dampers take that away many times over (a damping ratio of 0.001 is enough), without any it
//! grows. Fibres do not damp by themselves.
//!
//! Source: the fibre stretch as the measure and no stress below 1 are those of Weiss, Maker and Govindjee, "Finite element
//! implementation of incompressible, transversely isotropic hyperelasticity" (1996), and of Holzapfel, Gasser and Ogden, "A
//! new constitutive framework for arterial wall mechanics" (2000). Of Weiss' law this is the part of straight fibres, whose
//! tension is linear in the stretch, from the beginning: crimped fibres, whose tension rises exponentially at first, would
//! have a stable step that shrinks without end.

use crate::geometry::Vector3;
use crate::lattice::Lattice;
use crate::lattice::build::NO_ORGAN;

/// Fibres of an organ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fibres {
    /// Their direction at rest, RAS+; of any length but 0.
    pub direction: Vector3,
    /// What they add to Young's modulus along them [Pa].
    pub modulus: f64,
}

/// Fibres of every cell. The cell of a particle is the cube above it.
#[derive(Debug, Clone, PartialEq)]
pub struct FibreTerm {
    /// Their direction, lattice axes, times the root of their modulus, already scaled by how much of the cell is tissue
    /// [Pa^1/2]; 0 in a cell without. Shape `[particles]`.
    pub root: Vec<[f32; 3]>,
}

impl FibreTerm {
    /// The fibres of a lattice of cells; `None` when no organ has any. Shape of `fibres`: `[organs]`.
    ///
    /// # Panics
    /// If the lattice has no cells.
    pub fn new(lattice: &Lattice, fibres: &[Option<Fibres>]) -> Option<Self> {
        assert!(lattice.has_cells(), "fibres run through cells");
        let axes = lattice.grid.affine.linear().transpose();
        let of_organ: Vec<Option<Vector3>> = fibres
            .iter()
            .map(|fibres| fibres.map(|Fibres { direction, modulus }| (axes * direction).normalize() * modulus.sqrt()))
            .collect();
        if of_organ.iter().all(Option::is_none) {
            return None;
        }
        let of_cell = |(&organ, &fill): (&u8, &f32)| {
            let own = if organ == NO_ORGAN { None } else { of_organ[usize::from(organ)] };
            own.map_or([0.0; 3], |root| (root * f64::from(fill).sqrt()).map(|part| part as f32).into())
        };
        Some(Self { root: lattice.cell_organ.iter().zip(&lattice.cell_fill).map(of_cell).collect() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Affine, Grid, GridShape};
    use crate::lattice::build::OrganMap;
    use crate::lattice::cells::build_cells;
    use crate::volume::Volume;

    /// On a grid whose axes are turned against the patient's, with a cell that is a quarter tissue.
    #[test]
    fn directions_are_turned_into_the_lattice_and_moduli_follow_the_fill() {
        let turn = nalgebra::Rotation3::from_euler_angles(0.3, -0.7, 1.1).into_inner();
        let affine = Affine::from_parts(turn * 2.0, Vector3::zeros()).unwrap();
        let grid = Grid { shape: GridShape::new(2, 1, 1), affine };
        let fill = Volume::from_vec(grid, vec![1.0, 0.25]);
        let lattice = build_cells(&OrganMap::from_vec(grid, vec![0, 1]), Some(&fill)).unwrap();
        let fibres = Fibres { direction: Vector3::new(3.0, 0.0, -4.0), modulus: 2e4 };
        let term = FibreTerm::new(&lattice, &[Some(fibres), Some(fibres)]).unwrap();
        let found: Vec<Vector3> =
            term.root.iter().map(|root| Vector3::from(root.map(f64::from))).filter(|root| root.norm() > 0.0).collect();
        assert_eq!(found.len(), 2);
        for (root, modulus) in found.iter().zip([2e4, 5e3]) {
            assert!((root.norm_squared() / modulus - 1.0).abs() < 1e-6);
            assert!((turn * root.normalize() - Vector3::new(0.6, 0.0, -0.8)).norm() < 1e-6);
        }
        assert_eq!(FibreTerm::new(&lattice, &[None, None]), None);
        let one = FibreTerm::new(&lattice, &[None, Some(fibres)]).unwrap();
        assert_eq!(one.root.iter().filter(|root| **root != [0.0; 3]).count(), 1);
    }
}
