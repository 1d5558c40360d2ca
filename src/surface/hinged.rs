//! Particles that a cut has left hinged, and where they are drawn.
//!
//! A blade that runs between the last particles and the skin cuts cells whose other side has no cell behind it. What is left of them there
//! is a strip of particles whose springs all lie in one plane: nothing resists when it swings about its hinge, and it is soon
//! anywhere, often folded flat over the tissue beside it. Tissue as thick as that would stand on. So such particles are drawn
//! where the tissue they hang on is continued to; how they swing is the run's, and stays there.
//!
//! ```text
//! steady    its springs span space
//! loose     they did before the cut and do not now: they lie in a plane, or in less
//! hinged    loose, and so are all that it hangs together with short of steady ones, none of them more than two springs from those:
//!           a wider sheet is a membrane, which moves as its springs say
//! drawn at  the mean of what the nearest steady particles and the deformation round them continue to, the nearer the more
//! ```

use std::borrow::Cow;

use super::gradient::{Gradients, spans};
use crate::lattice::neighbours::{NEIGHBOURS, opposite};
use crate::lattice::{Lattice, Topology};

/// A strip is hinged up to so many particles wide.
const WIDEST: usize = 2;

/// The hinged particles of a lattice as it is cut.
#[derive(Debug, Clone, Default)]
pub(crate) struct Hinged {
    particles: Vec<Hanging>,
    /// Of the particles they hang on, without regard to what is hinged.
    gradients: Gradients,
}

/// A hinged particle.
#[derive(Debug, Clone)]
struct Hanging {
    particle: u32,
    /// The steady particles it is continued from: particle, its gradient, weight, and steps along the grid axes from it.
    sources: Vec<(u32, u32, f32, [f32; 3])>,
}

impl Hinged {
    /// Finds them: O(severed springs), and where there are any, a pass over all springs.
    pub(crate) fn find(lattice: &Lattice, topology: &Topology) -> Self {
        let alive = topology.alive();
        let hung = hung(lattice, topology);
        if hung.is_empty() {
            return Self::default();
        }
        let mut asked: Vec<u32> = hung.iter().flat_map(|(_, sources)| sources).copied().collect();
        asked.sort_unstable();
        asked.dedup();
        let mut held = alive.to_vec();
        for &(particle, _) in &hung {
            for (direction, other) in linked(lattice, alive, particle) {
                held[other as usize] &= !(1 << opposite(direction));
            }
        }
        let (gradients, index) = Gradients::new(lattice, &held, &asked);
        let hanging = |(particle, sources): (u32, Vec<u32>)| {
            let here = lattice.ijk(particle);
            let steps = |source: u32| {
                let there = lattice.ijk(source);
                [0, 1, 2].map(|axis| here[axis] as f32 - there[axis] as f32)
            };
            let weight = |steps: [f32; 3]| 1.0 / steps.iter().map(|step| step * step).sum::<f32>();
            let total: f32 = sources.iter().map(|&source| weight(steps(source))).sum();
            let source = |source: u32| {
                let gradient = index[asked.binary_search(&source).expect("asked for")];
                (source, gradient, weight(steps(source)) / total, steps(source))
            };
            Hanging { particle, sources: sources.into_iter().map(source).collect() }
        };
        Self { particles: hung.into_iter().map(hanging).collect(), gradients }
    }

    /// Displacements to draw \[mm\]: those given, but for hinged particles. Shape `[particles]`.
    pub(crate) fn steadied<'a>(&self, lattice: &Lattice, displacements: &'a [[f32; 3]]) -> Cow<'a, [[f32; 3]]> {
        if self.particles.is_empty() {
            return Cow::Borrowed(displacements);
        }
        let gradients = self.gradients.evaluate(lattice, displacements);
        let mut steadied = displacements.to_vec();
        for Hanging { particle, sources } in &self.particles {
            let mut sum = [0.0; 3];
            for &(source, gradient, weight, steps) in sources {
                let (own, slopes) = (displacements[source as usize], &gradients[gradient as usize]);
                for axis in 0..3 {
                    let along: f32 = (0..3).map(|step| steps[step] * slopes[step][axis]).sum();
                    sum[axis] += weight * (own[axis] + along);
                }
            }
            steadied[*particle as usize] = sum;
        }
        Cow::Owned(steadied)
    }
}

/// The hinged particles, ascending, each with the steady ones that are fewest springs away.
fn hung(lattice: &Lattice, topology: &Topology) -> Vec<(u32, Vec<u32>)> {
    let alive = topology.alive();
    let steady = |particle: u32| spans(alive[particle as usize]);
    let others = |particle: u32| linked(lattice, alive, particle).map(|(_, other)| other);
    // Whoever is loose has lost a spring.
    let ends = topology.severed().iter().flat_map(|spring| {
        let other = lattice.neighbour(spring.particle, usize::from(spring.direction));
        [Some(spring.particle), other].into_iter().flatten()
    });
    let mut loose: Vec<u32> = ends.collect();
    loose.sort_unstable();
    loose.dedup();
    loose.retain(|&end| spans(lattice.springs[end as usize]) && !steady(end));
    let place = |particle: u32| loose.binary_search(&particle).ok();
    let mut sources: Vec<Vec<u32>> =
        loose.iter().map(|&end| others(end).filter(|&other| steady(other)).collect()).collect();
    for _ in 1..WIDEST {
        let further = |(&end, own): (&u32, &Vec<u32>)| {
            if !own.is_empty() {
                return own.clone();
            }
            let mut found: Vec<u32> = others(end).filter_map(place).flat_map(|near| &sources[near]).copied().collect();
            found.sort_unstable();
            found.dedup();
            found
        };
        sources = loose.iter().zip(&sources).map(further).collect();
    }
    // What hangs together with something too far away, or with a sheet that was one before, is none.
    let mut wide: Vec<usize> = (0..loose.len())
        .filter(|&at| sources[at].is_empty() || others(loose[at]).any(|other| !steady(other) && place(other).is_none()))
        .collect();
    let mut is_wide = vec![false; loose.len()];
    while let Some(at) = wide.pop() {
        if !std::mem::replace(&mut is_wide[at], true) {
            wide.extend(others(loose[at]).filter_map(place));
        }
    }
    let hung = loose.into_iter().zip(sources).zip(is_wide);
    hung.filter(|(_, is_wide)| !is_wide).map(|(found, _)| found).collect()
}

/// Directions and particles at the other ends of the living springs of a particle.
fn linked(lattice: &Lattice, alive: &[u32], particle: u32) -> impl Iterator<Item = (usize, u32)> {
    let alive = alive[particle as usize];
    let directions = (0..NEIGHBOURS).filter(move |direction| alive >> direction & 1 == 1);
    directions.filter_map(move |direction| Some((direction, lattice.neighbour(particle, direction)?)))
}
