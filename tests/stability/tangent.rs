//! The oracle of the stable step: stiffness, damping and mass as dense matrices in f64, at rest or deformed.

use super::support::*;
use nalgebra::{DMatrix, Matrix3};
use yawara::geometry::Vector3;
use yawara::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS, OFFSETS, direction_of};
use yawara::lattice::{Lattice, Topology};
use yawara::material::Assembly;

/// Matrices over the free particles' degrees of freedom, scaled by `M^-1/2` on both sides.
pub(super) struct Dense {
    stiffness: DMatrix<f64>,
    damping: DMatrix<f64>,
}

/// How springs and cells with negative contributions are taken.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Sign {
    /// As they are.
    True,
    /// Compressed springs push nothing aside.
    Positive,
}

impl Dense {
    pub(super) fn new(
        lattice: &Lattice,
        topology: &Topology,
        assembly: &Assembly,
        displacement: &[Vector3],
        sign: Sign,
    ) -> Self {
        let mut free = vec![usize::MAX; lattice.len()];
        let mut count = 0;
        for (_, place) in free.iter_mut().enumerate().filter(|(p, _)| assembly.mass[*p] > 0.0) {
            *place = count;
            count += 1;
        }
        let n = 3 * count;
        let mut dense = Self { stiffness: DMatrix::zeros(n, n), damping: DMatrix::zeros(n, n) };
        let root = |p: u32| f64::from(assembly.mass[p as usize]).sqrt();
        let add = |matrix: &mut DMatrix<f64>, a: u32, b: u32, block: Matrix3<f64>| {
            let (i, j) = (free[a as usize], free[b as usize]);
            if i != usize::MAX && j != usize::MAX {
                let mut view = matrix.fixed_view_mut::<3, 3>(3 * i, 3 * j);
                view += block / (root(a) * root(b));
            }
        };
        let h = lattice.pitch;
        let pair = |matrix: &mut DMatrix<f64>, a: u32, b: u32, block: Matrix3<f64>| {
            add(matrix, a, a, block);
            add(matrix, b, b, block);
            add(matrix, a, b, -block);
            add(matrix, b, a, -block);
        };
        for a in 0..lattice.len() as u32 {
            let alive = topology.alive()[a as usize];
            for direction in (FIRST_FORWARD..NEIGHBOURS).filter(|d| alive >> d & 1 == 1) {
                let b = lattice.neighbour(a, direction).unwrap();
                let rest = Vector3::from(OFFSETS[direction].map(f64::from)) * h;
                let along = rest + displacement[b as usize] - displacement[a as usize];
                let n = along.normalize();
                let mut across = 1.0 - rest.norm() / along.norm();
                if sign == Sign::Positive {
                    across = across.max(0.0);
                }
                let dyad = n * n.transpose();
                let k = assembly.stiffness.of(lattice, a, direction);
                pair(&mut dense.stiffness, a, b, k * (dyad + across * (Matrix3::identity() - dyad)));
                if let Some(damping) = &assembly.damping {
                    pair(&mut dense.damping, a, b, damping.of(lattice, a, direction) * dyad);
                }
            }
        }
        let Some(volume) = &assembly.volume else { return dense };
        for low in 0..lattice.len() as u32 {
            let Some(corner) = whole_cell(lattice, topology, low) else { continue };
            let g: [Vector3; 8] = std::array::from_fn(|c| {
                Vector3::from([0, 1, 2].map(|axis| if c >> axis & 1 == 1 { 0.25 / h } else { -0.25 / h }))
            });
            let mut f = Matrix3::identity();
            for c in 0..8 {
                f += displacement[corner[c] as usize] * g[c].transpose();
            }
            let (x, y, z) = (f.column(0).into_owned(), f.column(1).into_owned(), f.column(2).into_owned());
            let cofactor = Matrix3::from_columns(&[y.cross(&z), z.cross(&x), x.cross(&y)]);
            let change = f.determinant() - 1.0;
            let modulus = f64::from(volume.modulus[low as usize]);
            let viscosity = volume.viscosity.as_ref().map_or(0.0, |v| f64::from(v[low as usize]));
            for c in 0..8 {
                for d in 0..8 {
                    let (p, q) = (cofactor * g[c], cofactor * g[d]);
                    // The second derivative of a determinant: (u x v) . F (g_c x g_d).
                    let turn = -(f * g[c].cross(&g[d])).cross_matrix();
                    let block = p * q.transpose() + change * turn;
                    add(&mut dense.stiffness, corner[c], corner[d], modulus * h.powi(3) * block);
                    add(&mut dense.damping, corner[c], corner[d], viscosity * h.powi(3) * p * q.transpose());
                }
            }
        }
        dense
    }

    /// At rest.
    pub(super) fn at_rest(lattice: &Lattice, topology: &Topology, assembly: &Assembly) -> Self {
        Self::new(lattice, topology, assembly, &vec![Vector3::zeros(); lattice.len()], Sign::True)
    }

    /// Largest eigenvalue of `M^-1 (dt^2 K + 2 dt C)`: stable below 4.
    pub(super) fn lambda(&self, dt: f64) -> f64 {
        let both = &self.stiffness * dt * dt + &self.damping * (2.0 * dt);
        both.symmetric_eigenvalues().max()
    }

    /// The limit of symplectic Euler with dampers read at the old velocity [s].
    pub(super) fn limit(&self, start: f64) -> f64 {
        let mut dt = start;
        for _ in 0..8 {
            let lambda = self.lambda(dt);
            if (lambda / 4.0 - 1.0).abs() < 1e-9 {
                break;
            }
            // Between dt (dampers alone) and dt^2 (springs alone).
            let softer = self.lambda(0.999 * dt);
            let power = (lambda / softer).ln() / (1.0_f64 / 0.999).ln();
            dt *= (4.0 / lambda).powf(1.0 / power);
        }
        dt
    }
}

/// The corners of the cell above a particle, if all 28 springs are alive.
pub(super) fn whole_cell(lattice: &Lattice, topology: &Topology, low: u32) -> Option<[u32; 8]> {
    let side = |c: usize| [c as i32 & 1, c as i32 >> 1 & 1, c as i32 >> 2];
    let mut corner = [low; 8];
    for c in 1..8 {
        corner[c] = lattice.neighbour(low, direction_of(side(c)))?;
    }
    let joined = |a: usize, b: usize| {
        let (from, to) = (side(a), side(b));
        let direction = direction_of([0, 1, 2].map(|axis| to[axis] - from[axis]));
        topology.alive()[corner[a] as usize] >> direction & 1 == 1
    };
    (0..8).all(|a| (a + 1..8).all(|b| joined(a, b))).then_some(corner)
}

/// The oracle against differences of the energy it is the second derivative of.
#[test]
fn the_oracle_is_the_second_derivative_of_the_energy() {
    let (lattice, mut assembly) = tissue_lattice(&block([1, 1, 2]), &[Some(TISSUE)]);
    let mut random = Random::new(5);
    let modulus = (0..lattice.len()).map(|_| (8e3 * random.unit() - 1e3) as f32).collect();
    assembly.volume = Some(yawara::material::VolumeTerm { modulus, viscosity: None });
    let topology = Topology::new(&lattice);
    let h = lattice.pitch;
    let u: Vec<Vector3> = (0..lattice.len()).map(|_| random.vector() * 0.2 * h).collect();
    let energy = |u: &[Vector3]| {
        let mut sum = 0.0;
        for a in 0..lattice.len() as u32 {
            for direction in (FIRST_FORWARD..NEIGHBOURS).filter(|d| topology.alive()[a as usize] >> d & 1 == 1) {
                let b = lattice.neighbour(a, direction).unwrap();
                let rest = Vector3::from(OFFSETS[direction].map(f64::from)) * h;
                let stretch = (rest + u[b as usize] - u[a as usize]).norm() - rest.norm();
                sum += 0.5 * assembly.stiffness.of(&lattice, a, direction) * stretch * stretch;
            }
            if let Some(corner) = whole_cell(&lattice, &topology, a) {
                let mut f = Matrix3::identity();
                for c in 0..8 {
                    let g = Vector3::from([0, 1, 2].map(|axis| if c >> axis & 1 == 1 { 0.25 / h } else { -0.25 / h }));
                    f += u[corner[c] as usize] * g.transpose();
                }
                let modulus = f64::from(assembly.volume.as_ref().unwrap().modulus[a as usize]);
                sum += 0.5 * modulus * h.powi(3) * (f.determinant() - 1.0).powi(2);
            }
        }
        sum
    };
    let dense = Dense::new(&lattice, &topology, &assembly, &u, Sign::True);
    for _ in 0..10 {
        let way: Vec<Vector3> = (0..lattice.len()).map(|_| random.vector() * 1e-3 * h).collect();
        let at = |s: f64| energy(&u.iter().zip(&way).map(|(u, w)| u + s * w).collect::<Vec<_>>());
        let difference = at(1.0) - 2.0 * at(0.0) + at(-1.0);
        let scaled = nalgebra::DVector::from_iterator(
            3 * lattice.len(),
            (0..3 * lattice.len()).map(|i| way[i / 3][i % 3] * f64::from(assembly.mass[i / 3]).sqrt()),
        );
        let form = scaled.dot(&(&dense.stiffness * &scaled));
        assert!((form / difference - 1.0).abs() < 1e-4, "{form} {difference}");
    }
}
