//! What springs do beyond elasticity: their share in every organ, from the scene's numbers to constants of springs.
//!
//! All three are constants that add up over the cells (or ends) a spring belongs to, as stiffness does, so that a spring at the
//! wall of two organs is a bundle of what both would have there: forces of Maxwell branches add, and so do the tensions at
//! which the parts of the bundle give way.

use std::borrow::Cow;

use super::{Assembly, SpringConstants};
use crate::lattice::Lattice;
use crate::lattice::neighbours::NEIGHBOURS;

/// A Maxwell branch in parallel to an organ's springs, see [`crate::dynamics::effects::relaxation`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relaxation {
    /// Stiffness of the branch over that of the springs.
    pub ratio: f64,
    /// Time in which its tension falls to `1 / e` [s].
    pub time: f64,
}

/// How an organ's springs yield, see [`crate::dynamics::effects::plasticity`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plasticity {
    /// Elastic strain beyond which they yield, in tension and under pressure.
    pub yield_strain: f64,
    /// Time in which what exceeds it falls to `1 / e` [s]; 0 for at once.
    pub time: f64,
}

/// What the springs of a lattice do beyond elasticity; `None` for what none of them does.
#[derive(Debug, Clone, PartialEq)]
pub struct Inelastic {
    /// Maxwell branches.
    pub relaxation: Option<RelaxationTerm>,
    /// Yielding.
    pub plasticity: Option<PlasticTerm>,
    /// Tearing.
    pub tearing: Option<TearingTerm>,
}

impl Inelastic {
    /// Bytes of its constants.
    pub(crate) fn bytes(&self) -> usize {
        let Self { relaxation, plasticity, tearing } = self;
        let relaxation = relaxation.iter().flat_map(|term| [&term.stiffness, &term.rate]);
        let plasticity = plasticity.iter().flat_map(|term| [&term.stiffness, &term.threshold, &term.rate]);
        let tearing = tearing.iter().flat_map(|term| [&term.stiffness, &term.threshold]);
        relaxation.chain(plasticity).chain(tearing).map(SpringConstants::bytes).sum()
    }
}

/// Maxwell branches of all springs. The constants of a term are all sums over cells, or all means of ends.
#[derive(Debug, Clone, PartialEq)]
pub struct RelaxationTerm {
    /// Stiffness of the branch [N/m].
    pub stiffness: SpringConstants,
    /// The same over its time [N/(m s)].
    pub rate: SpringConstants,
}

/// Yielding of all springs.
#[derive(Debug, Clone, PartialEq)]
pub struct PlasticTerm {
    /// Stiffness of the springs [N/m].
    pub stiffness: SpringConstants,
    /// Stiffness times yield strain [N/m]; infinite where nothing yields.
    pub threshold: SpringConstants,
    /// Stiffness over the time of yielding [N/(m s)]; infinite for at once.
    pub rate: SpringConstants,
}

/// Tearing of all springs.
#[derive(Debug, Clone, PartialEq)]
pub struct TearingTerm {
    /// Stiffness of the springs [N/m].
    pub stiffness: SpringConstants,
    /// Stiffness times the strain at which they tear [N/m]; infinite where none does.
    pub threshold: SpringConstants,
}

/// What one organ's springs do beyond elasticity.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct OrganInelastic {
    /// Its Maxwell branch.
    pub relaxation: Option<Relaxation>,
    /// How it yields.
    pub plasticity: Option<Plasticity>,
    /// Strain at which its springs tear.
    pub tear_strain: Option<f64>,
}

impl Inelastic {
    /// `None` when no organ does any of it.
    ///
    /// - `stiffness` of the lattice's springs; `organs`: `None` for a rigid one. Shape `[organs]`.
    pub fn new(lattice: &Lattice, stiffness: &SpringConstants, organs: &[Option<OrganInelastic>]) -> Option<Self> {
        let any = |does: fn(&OrganInelastic) -> bool| organs.iter().flatten().any(does);
        let times = |factor: fn(&OrganInelastic) -> f64| {
            let factors: Vec<Option<f64>> = organs.iter().map(|organ| organ.as_ref().map(factor)).collect();
            stiffness.times_of_organs(lattice, &factors)
        };
        let relaxation = any(|organ| organ.relaxation.is_some()).then(|| RelaxationTerm {
            stiffness: times(|organ| organ.relaxation.map_or(0.0, |own| own.ratio)),
            rate: times(|organ| organ.relaxation.map_or(0.0, |own| own.ratio / own.time)),
        });
        let plasticity = any(|organ| organ.plasticity.is_some()).then(|| PlasticTerm {
            stiffness: times(|_| 1.0),
            threshold: times(|organ| organ.plasticity.map_or(f64::INFINITY, |own| own.yield_strain)),
            rate: times(|organ| organ.plasticity.map_or(0.0, |own| 1.0 / own.time)),
        });
        let tearing = any(|organ| organ.tear_strain.is_some()).then(|| TearingTerm {
            stiffness: times(|_| 1.0),
            threshold: times(|organ| organ.tear_strain.unwrap_or(f64::INFINITY)),
        });
        let anything = relaxation.is_some() || plasticity.is_some() || tearing.is_some();
        anything.then_some(Self { relaxation, plasticity, tearing })
    }
}

impl SpringConstants {
    /// The same constants with the share of every organ times a factor of its own; what is 0 stays 0. Never uniform.
    ///
    /// - `factors`: `None` for a rigid organ, whose particles (model `paper`) take that of their first soft neighbour. Shape
    ///   `[organs]`.
    fn times_of_organs(&self, lattice: &Lattice, factors: &[Option<f64>]) -> Self {
        let scaled = |value: f32, factor: Option<f64>| {
            factor.filter(|_| value != 0.0).map_or(0.0, |factor| (f64::from(value) * factor) as f32)
        };
        match self {
            Self::Uniform(_) | Self::MeanOfEnds(_) => {
                let of = |particle: u32| factors[usize::from(lattice.organ[particle as usize])];
                let nearest = |particle: u32| {
                    let around = (0..NEIGHBOURS).find_map(|d| lattice.neighbour(particle, d).and_then(of));
                    of(particle).or(around)
                };
                let values = (0..).zip(self.per_particle(lattice.len()));
                Self::MeanOfEnds(values.map(|(particle, value)| scaled(value, nearest(particle))).collect())
            }
            Self::SumOfCells { cell, weight } => {
                let of = |organ: u8| factors.get(usize::from(organ)).copied().flatten();
                let cells = cell.iter().zip(&lattice.cell_organ);
                Self::SumOfCells {
                    cell: cells.map(|(&value, &organ)| scaled(value, of(organ))).collect(),
                    weight: *weight,
                }
            }
        }
    }

    /// The sum of two constants of the same springs.
    ///
    /// # Panics
    /// If one is summed over cells and the other is not.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        let add = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a + b).collect();
        match (self, other) {
            (Self::Uniform(a), Self::Uniform(b)) => Self::Uniform(a + b),
            (Self::SumOfCells { cell: a, weight }, Self::SumOfCells { cell: b, .. }) => {
                Self::SumOfCells { cell: add(a, b), weight: *weight }
            }
            (Self::MeanOfEnds(values), other) | (other, Self::MeanOfEnds(values)) => {
                Self::MeanOfEnds(add(values, &other.per_particle(values.len())))
            }
            _ => panic!("cells and particles are not mixed in one assembly"),
        }
    }
}

impl Assembly {
    /// How stiff springs are to motion too fast for anything to flow [N/m]: with their Maxwell branches.
    pub fn instant_stiffness(&self) -> Cow<'_, SpringConstants> {
        match self.inelastic.as_ref().and_then(|inelastic| inelastic.relaxation.as_ref()) {
            None => Cow::Borrowed(&self.stiffness),
            Some(term) => Cow::Owned(self.stiffness.plus(&term.stiffness)),
        }
    }
}
