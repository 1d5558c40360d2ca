//! From materials to masses and spring constants.
//!
//! Two laws: [`paper`] gives every spring and particle the constants of the scene; [`tissue`] assembles them by cells
//! from Young's modulus and density. Both end in an [`Assembly`].

pub mod ct_density;
pub mod elastic;
mod fibres;
mod inelastic;
pub mod library;
pub mod paper;
mod rigid;
pub mod tissue;

pub use fibres::{FibreTerm, Fibres};
pub use inelastic::{Inelastic, OrganInelastic, PlasticTerm, Plasticity, Relaxation, RelaxationTerm, TearingTerm};
pub use rigid::{RigidKind, RigidParts};

use crate::lattice::Lattice;
use crate::lattice::neighbours::family;

/// A constant (stiffness [N/m] or damping [N s/m]) for every spring of a lattice.
#[derive(Debug, Clone, PartialEq)]
pub enum SpringConstants {
    /// The same for every spring.
    Uniform(f32),
    /// The mean of the two ends' values. Shape `[particles]`.
    MeanOfEnds(Vec<f32>),
    /// `weight[family]` times the sum of the values of the cells that share the spring; the cell of a particle is the
    /// cube above it, towards +x, +y, +z, and 0 where there is none.
    SumOfCells {
        /// Value of the cell above each particle. Shape `[particles]`.
        cell: Vec<f32>,
        /// What a cell of value 1 gives to each face, face-diagonal and body-diagonal spring.
        weight: [f32; 3],
    },
}

/// Masses and spring constants of a lattice.
#[derive(Debug, Clone, PartialEq)]
pub struct Assembly {
    /// Mass of each particle [kg]; 0 marks particles of rigid organs that nothing but an operation moves.
    pub mass: Vec<f32>,
    /// Stiffness of every spring [N/m].
    pub stiffness: SpringConstants,
    /// Damping of every spring [N s/m]; `None` when nothing damps.
    pub damping: Option<SpringConstants>,
    /// What cells add against a change of their volume; `None` when no cell adds anything.
    pub volume: Option<VolumeTerm>,
    /// Fibres of the cells; `None` when no cell has any.
    pub fibres: Option<FibreTerm>,
    /// What springs do beyond elasticity; `None` when they do nothing.
    pub inelastic: Option<Inelastic>,
    /// Rigid parts that move; `None` when every rigid organ stays where it is.
    pub rigid: Option<RigidParts>,
}

/// Energy `1/2 lambda h^3 (J - 1)^2` of every cell, with `J` the determinant of the cell's mean deformation gradient: what
/// springs alone, whose Poisson's ratio is 1/4, lack. The cell of a particle is the cube above it.
#[derive(Debug, Clone, PartialEq)]
pub struct VolumeTerm {
    /// `lambda` of each cell, already scaled by how much of it is tissue [Pa]; negative below a Poisson's ratio of 1/4.
    /// Shape `[particles]`.
    pub modulus: Vec<f32>,
    /// The same for the rate of change of volume [Pa s], never negative; `None` when nothing damps. Shape `[particles]`.
    pub viscosity: Option<Vec<f32>>,
}

impl SpringConstants {
    /// Bytes of the values that are kept one by one.
    pub(crate) fn bytes(&self) -> usize {
        match self {
            Self::Uniform(_) => 0,
            Self::MeanOfEnds(values) | Self::SumOfCells { cell: values, .. } => 4 * values.len(),
        }
    }

    /// One value per particle whose mean over both ends is the constant of a spring.
    ///
    /// # Panics
    /// For constants summed over cells, which have no such form.
    pub fn per_particle(&self, particles: usize) -> Vec<f32> {
        match self {
            Self::Uniform(value) => vec![*value; particles],
            Self::MeanOfEnds(values) => values.clone(),
            Self::SumOfCells { .. } => panic!("cells and particles are not mixed in one assembly"),
        }
    }

    /// The constant of the spring of `particle` in `direction`, alive or not; in f64 for what judges.
    ///
    /// # Panics
    /// If there is no particle in that direction.
    pub fn of(&self, lattice: &Lattice, particle: u32, direction: usize) -> f64 {
        match self {
            Self::Uniform(value) => f64::from(*value),
            Self::MeanOfEnds(value) => {
                let other = lattice.neighbour(particle, direction).expect("the spring has two ends");
                0.5 * (f64::from(value[particle as usize]) + f64::from(value[other as usize]))
            }
            Self::SumOfCells { cell, weight } => {
                let cells = lattice.cells_of_spring(particle, direction);
                let sum: f64 = cells.map(|corner| f64::from(cell[corner as usize])).sum();
                f64::from(weight[family(direction) - 1]) * sum
            }
        }
    }
}
