//! What the hot loop computes, written plainly and in f64: the oracle of every fast variant.

use super::inner_length::MOST_YIELDED;
use super::reference_table::{LivingSprings, VolumeCells};
use crate::geometry::{Matrix3, Vector3};
use crate::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS, OFFSETS, family};
use crate::lattice::{Lattice, Topology};
use crate::material::{Assembly, FibreTerm, VolumeTerm};

/// Force of all living springs on each particle, lattice axes [N]. Shape `[particles]`.
///
/// - `displacement` [m], `velocity` [m/s]: shape `[particles]`, lattice axes.
/// - `dt` [s]: the damper compares the present length of a spring with that one step earlier, `|d - dt w|` with `w` the
///   difference of the ends' velocities.
///
/// # Panics
/// Never: a living spring has two ends.
///
/// # Source
/// Hattori and Kaneko, "3-D model of soft organs": spring `-k (l - L) u`, damper `-d (l - l') u` with `d = c / dt`.
pub fn spring_forces(
    lattice: &Lattice,
    topology: &Topology,
    assembly: &Assembly,
    displacement: &[Vector3],
    velocity: &[Vector3],
    dt: f64,
) -> Vec<Vector3> {
    LivingSprings::new(lattice, topology, assembly).forces(displacement, velocity, dt)
}

/// Force of all cells' volume terms on each particle, lattice axes [N]. Shape `[particles]`; see [`spring_forces`] for the
/// arguments and [`super::volume`] for the law. Cells with a severed spring or a missing corner add nothing.
pub fn volume_forces(
    lattice: &Lattice,
    topology: &Topology,
    assembly: &Assembly,
    displacement: &[Vector3],
    velocity: &[Vector3],
    dt: f64,
) -> Vec<Vector3> {
    VolumeCells::new(lattice, topology, assembly).forces(displacement, velocity, dt)
}

/// What the springs that start at each particle hold back, forward direction by forward direction [m]: flown in their Maxwell
/// branches, or yielded. See [`super::inner_length`] for both laws.
pub type HeldBack = Vec<[f64; NEIGHBOURS - FIRST_FORWARD]>;

/// Force of all living springs' Maxwell branches on each particle and of what springs have yielded, lattice axes [N]. Shape
/// `[particles]`.
///
/// - `displacement` [m]: shape `[particles]`, lattice axes; `relaxed`, `yielded`: read where the assembly has the term.
///
/// # Panics
/// Never: a living spring has two ends.
pub fn inelastic_forces(
    lattice: &Lattice,
    topology: &Topology,
    assembly: &Assembly,
    displacement: &[Vector3],
    relaxed: &HeldBack,
    yielded: &HeldBack,
) -> Vec<Vector3> {
    let mut force = vec![Vector3::zeros(); lattice.len()];
    let Some(inelastic) = &assembly.inelastic else { return force };
    for (particle, direction, other, d, stretch) in forward_springs(lattice, topology, displacement) {
        let (p, start) = (particle as usize, direction - FIRST_FORWARD);
        let mut tension = 0.0;
        if let Some(term) = &inelastic.relaxation {
            tension += term.stiffness.of(lattice, particle, direction) * (stretch - relaxed[p][start]);
        }
        if let Some(term) = &inelastic.plasticity {
            tension -= term.stiffness.of(lattice, particle, direction) * yielded[p][start];
        }
        let pull = tension * d.normalize();
        force[p] += pull;
        force[other as usize] -= pull;
    }
    force
}

/// Lets all springs relax and yield for one step `dt` [s] by backward Euler.
///
/// # Panics
/// Never: a living spring has two ends.
pub fn flow(
    lattice: &Lattice,
    topology: &Topology,
    assembly: &Assembly,
    displacement: &[Vector3],
    dt: f64,
    relaxed: &mut HeldBack,
    yielded: &mut HeldBack,
) {
    let Some(inelastic) = &assembly.inelastic else { return };
    for (particle, direction, _, d, stretch) in forward_springs(lattice, topology, displacement) {
        let (p, start) = (particle as usize, direction - FIRST_FORWARD);
        let rest = (f64::from(family(direction) as u32)).sqrt() * lattice.pitch;
        debug_assert!((d.norm() - rest - stretch).abs() < 1e-6 * d.norm().max(rest));
        if let Some(term) = &inelastic.relaxation {
            let stiffness = term.stiffness.of(lattice, particle, direction);
            if stiffness > 0.0 {
                let x = dt * term.rate.of(lattice, particle, direction) / stiffness;
                relaxed[p][start] = (relaxed[p][start] + x * stretch) / (1.0 + x);
            }
        }
        if let Some(term) = &inelastic.plasticity {
            let stiffness = term.stiffness.of(lattice, particle, direction);
            let yields_at = rest * term.threshold.of(lattice, particle, direction) / stiffness;
            let elastic = stretch - yielded[p][start];
            if elastic.abs() > yields_at {
                let x = dt * term.rate.of(lattice, particle, direction) / stiffness;
                let beyond = (elastic.abs() - yields_at) * (1.0 - 1.0 / (1.0 + x));
                let most = f64::from(MOST_YIELDED) * rest;
                yielded[p][start] = (yielded[p][start] + beyond * elastic.signum()).clamp(-most, most);
            }
        }
    }
}

/// Every living spring once: its ends (particle, forward direction, other particle), the vector along it and by how much it is
/// longer than at rest [m].
fn forward_springs<'a>(
    lattice: &'a Lattice,
    topology: &'a Topology,
    displacement: &'a [Vector3],
) -> impl Iterator<Item = (u32, usize, u32, Vector3, f64)> + 'a {
    (0..lattice.len() as u32).flat_map(move |particle| {
        let alive = topology.alive()[particle as usize];
        (FIRST_FORWARD..NEIGHBOURS).filter(move |d| alive >> d & 1 == 1).map(move |direction| {
            let other = lattice.neighbour(particle, direction).expect("a living spring has two ends");
            let rest = Vector3::from(OFFSETS[direction].map(f64::from)) * lattice.pitch;
            let moved = displacement[other as usize] - displacement[particle as usize];
            let d = rest + moved;
            (particle, direction, other, d, moved.dot(&(d + rest)) / (d.norm() + rest.norm()))
        })
    })
}

/// Energy of the volume term of the cell above a particle [J]; 0 when the cell is not whole.
///
/// - `displacement` of a particle [m], lattice axes.
pub fn cell_volume_energy(
    lattice: &Lattice,
    topology: &Topology,
    term: &VolumeTerm,
    cell: u32,
    displacement: impl Fn(u32) -> Vector3,
) -> f64 {
    let modulus = f64::from(term.modulus[cell as usize]);
    let Some(corners) = topology.whole_cell(lattice, cell).filter(|_| modulus != 0.0) else { return 0.0 };
    let h = lattice.pitch;
    let change = (Matrix3::identity() + mean_gradient(h, |c| displacement(corners[c]))).determinant() - 1.0;
    let bound = if modulus < 0.0 { 1.0 + change * change } else { 1.0 };
    0.5 * modulus * h.powi(3) * change * change / bound
}

/// Force of all cells' fibres on each particle, lattice axes [N]. Shape `[particles]`; see [`crate::material::FibreTerm`] for
/// the law. Cells with a severed spring or a missing corner add nothing.
///
/// - `displacement` [m]: shape `[particles]`, lattice axes.
pub fn fibre_forces(
    lattice: &Lattice,
    topology: &Topology,
    assembly: &Assembly,
    displacement: &[Vector3],
) -> Vec<Vector3> {
    let mut force = vec![Vector3::zeros(); lattice.len()];
    let Some(term) = &assembly.fibres else { return force };
    let h = lattice.pitch;
    for cell in 0..lattice.len() as u32 {
        let root = Vector3::from(term.root[cell as usize].map(f64::from));
        let Some(corners) = topology.whole_cell(lattice, cell).filter(|_| root != Vector3::zeros()) else { continue };
        let now = (Matrix3::identity() + mean_gradient(h, |c| displacement[corners[c] as usize])) * root;
        let stretch = now.norm() - root.norm();
        if stretch > 0.0 {
            for (c, &corner) in corners.iter().enumerate() {
                force[corner as usize] -= now.normalize() * (stretch * h.powi(3) * root.dot(&shape_gradient(h, c)));
            }
        }
    }
    force
}

/// Energy of the fibres of the cell above a particle [J]; 0 when they are slack or the cell is not whole.
///
/// - `displacement` of a particle [m], lattice axes.
pub fn cell_fibre_energy(
    lattice: &Lattice,
    topology: &Topology,
    term: &FibreTerm,
    cell: u32,
    displacement: impl Fn(u32) -> Vector3,
) -> f64 {
    let root = Vector3::from(term.root[cell as usize].map(f64::from));
    let Some(corners) = topology.whole_cell(lattice, cell).filter(|_| root != Vector3::zeros()) else { return 0.0 };
    let h = lattice.pitch;
    let moved = mean_gradient(h, |c| displacement(corners[c])) * root;
    // |b + G b| - |b| without cancellation.
    let change = moved.dot(&(2.0 * root + moved));
    let stretch = change / ((root + moved).norm() + root.norm());
    0.5 * h.powi(3) * stretch.max(0.0).powi(2)
}

/// Mean gradient over a cell of the field with these values at its corners (x fastest).
pub(super) fn mean_gradient(h: f64, values: impl Fn(usize) -> Vector3) -> Matrix3 {
    (0..8).map(|c| values(c) * shape_gradient(h, c).transpose()).sum()
}

/// Derivative of the mean gradient with respect to the value at a corner: `(+-1, +-1, +-1) / 4h`.
pub(super) fn shape_gradient(h: f64, corner: usize) -> Vector3 {
    Vector3::from_fn(|axis, _| if corner >> axis & 1 == 1 { 0.25 / h } else { -0.25 / h })
}

/// The derivative of the determinant.
pub(super) fn cofactor(f: &Matrix3) -> Matrix3 {
    let [x, y, z] = [0, 1, 2].map(|axis| f.column(axis).into_owned());
    Matrix3::from_columns(&[y.cross(&z), z.cross(&x), x.cross(&y)])
}
