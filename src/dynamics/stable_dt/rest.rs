//! Bounds from the 3 x 3 blocks of the stiffness matrix, particle by particle, in f64.

use std::borrow::Cow;
use std::ops::Range;

use rayon::prelude::*;

use crate::lattice::neighbours::{NEIGHBOURS, OFFSETS, family};
use crate::lattice::{Lattice, NO_PARTICLE, Topology};
use crate::material::{Assembly, FibreTerm, SpringConstants};

/// A symmetric 3 x 3 matrix: xx, yy, zz, yz, xz, xy.
type Symmetric = [f64; 6];

/// Particles that one task works through.
const CHUNK: u32 = 4096;

/// Promise and rest limit [s].
pub(super) fn limits(lattice: &Lattice, topology: &Topology, assembly: &Assembly) -> (f64, f64) {
    let blocks = Blocks::new(lattice, topology, assembly);
    let smaller = |a: (f64, f64), b: (f64, f64)| (a.0.min(b.0), a.1.min(b.1));
    let of_chunk = |particles: Range<u32>| {
        let mut largest = Largest::default();
        particles.fold((f64::INFINITY, f64::INFINITY), |least, particle| {
            let mass = f64::from(assembly.mass[particle as usize]);
            if mass <= 0.0 {
                return least;
            }
            let around = Around::of(lattice, particle);
            let (stiffness, damping) = (blocks.stiffness(particle, &around), blocks.damping(particle, &around));
            let promise = largest_dt(trace(&stiffness) / mass, trace(&damping) / mass);
            let [k, c] = largest.of(stiffness, damping);
            smaller(least, (promise, largest_dt(k / mass, c / mass)))
        })
    };
    chunks(lattice).into_par_iter().map(of_chunk).reduce(|| (f64::INFINITY, f64::INFINITY), smaller)
}

/// How long each particle's damping remembers: damping over stiffness of its block at rest [s].
pub(crate) enum DampingTimes {
    /// Nothing damps, or all by the same time.
    Same(f32),
    /// Shape `[particles]`.
    PerParticle(Vec<f32>),
}

/// Damping over stiffness of every particle's block at rest.
pub(crate) fn damping_times(lattice: &Lattice, topology: &Topology, assembly: &Assembly) -> DampingTimes {
    let viscous = assembly.volume.as_ref().is_some_and(|volume| volume.viscosity.is_some());
    if assembly.damping.is_none() && !viscous {
        return DampingTimes::Same(0.0);
    }
    let blocks = Blocks::new(lattice, topology, assembly);
    let of_chunk = |particles: Range<u32>| -> Vec<f32> {
        let mut largest = Largest::default();
        let time = |particle| {
            let around = Around::of(lattice, particle);
            let [k, c] = largest.of(blocks.stiffness(particle, &around), blocks.damping(particle, &around));
            if k > 0.0 { (c / k) as f32 } else { 0.0 }
        };
        particles.map(time).collect()
    };
    DampingTimes::PerParticle(chunks(lattice).into_par_iter().flat_map_iter(of_chunk).collect())
}

fn chunks(lattice: &Lattice) -> Vec<Range<u32>> {
    let particles = lattice.len() as u32;
    (0..particles).step_by(CHUNK as usize).map(|first| first..particles.min(first.saturating_add(CHUNK))).collect()
}

/// Largest eigenvalues of pairs of blocks; inside an organ most are those of the particle before.
#[derive(Default)]
struct Largest {
    blocks: [Symmetric; 2],
    found: [f64; 2],
}

impl Largest {
    fn of(&mut self, stiffness: Symmetric, damping: Symmetric) -> [f64; 2] {
        let blocks = [stiffness, damping];
        if blocks != self.blocks {
            *self = Self { blocks, found: blocks.each_ref().map(largest_eigenvalue) };
        }
        self.found
    }
}

/// `a dt^2 + 2 b dt = 4`, solved without cancellation.
fn largest_dt(a: f64, b: f64) -> f64 {
    if a <= 0.0 && b <= 0.0 { f64::INFINITY } else { 4.0 / (b + (b * b + 4.0 * a).sqrt()) }
}

/// Twice what a particle's springs and eight times what its cells' volume terms add to its block, and the bound of their fibres.
struct Blocks<'a> {
    lattice: &'a Lattice,
    alive: &'a [u32],
    /// No spring is severed: one that shares no cell has no constant either.
    uncut: bool,
    assembly: &'a Assembly,
    modulus: Option<Vec<f32>>,
    /// With what flows only in time.
    stiffness: Cow<'a, SpringConstants>,
    /// Fibres of the whole cells [Pa^1/2].
    fibres: Option<Vec<[f32; 3]>>,
    viscosity: Option<Vec<f32>>,
}

impl<'a> Blocks<'a> {
    fn new(lattice: &'a Lattice, topology: &'a Topology, assembly: &'a Assembly) -> Self {
        let whole = |values: &[f32]| whole_moduli(lattice, topology, values);
        let volume = assembly.volume.as_ref();
        Self {
            lattice,
            alive: topology.alive(),
            uncut: topology.severed().is_empty(),
            assembly,
            stiffness: assembly.instant_stiffness(),
            modulus: volume.map(|volume| whole(&volume.modulus)),
            fibres: assembly.fibres.as_ref().map(|term| whole_fibres(lattice, topology, term)),
            viscosity: volume.and_then(|volume| volume.viscosity.as_deref().map(whole)),
        }
    }

    /// [N/m]
    fn stiffness(&self, particle: u32, around: &Around) -> Symmetric {
        let mut block = self.block(particle, around, Some(&*self.stiffness), self.modulus.as_deref());
        if let Some(fibres) = &self.fibres {
            self.add_fibres(fibres, around, &mut block);
        }
        block
    }

    /// [N s/m]
    fn damping(&self, particle: u32, around: &Around) -> Symmetric {
        self.block(particle, around, self.assembly.damping.as_ref(), self.viscosity.as_deref())
    }

    /// What taut fibres of the cells add, see [`crate::kernel::fibres`].
    fn add_fibres(&self, fibres: &[[f32; 3]], around: &Around, block: &mut Symmetric) {
        for (octant, &cell) in around.cells.iter().enumerate() {
            let Some(&[x, y, z]) = fibres.get(cell as usize).filter(|root| **root != [0.0; 3]) else { continue };
            let [x, y, z] = [x, y, z].map(f64::from);
            let along = |corner: usize| {
                let signed = |axis: usize, part: f64| if corner >> axis & 1 == 1 { part } else { -part };
                (signed(0, x) + signed(1, y) + signed(2, z)).abs()
            };
            let all: f64 = (0..8).map(along).sum();
            // Opposite corners have the same share.
            let share = self.lattice.pitch / 16.0 * all * along(octant) / (x * x + y * y + z * z);
            for (entry, dyad) in block.iter_mut().zip([x * x, y * y, z * z, y * z, x * z, x * y]) {
                *entry += share * dyad;
            }
        }
    }

    fn block(
        &self,
        particle: u32,
        around: &Around,
        springs: Option<&SpringConstants>,
        cells: Option<&[f32]>,
    ) -> Symmetric {
        let mut block = [0.0; 6];
        if let (true, Some(SpringConstants::SumOfCells { cell, weight })) = (self.uncut, springs) {
            // Cell by cell, all springs of a cell and family at once.
            for (corner, dyads) in around.cells.iter().zip(&OCTANT_DYADS) {
                let value = 2.0 * cell.get(*corner as usize).map_or(0.0, |&value| f64::from(value));
                for (weight, dyad) in weight.iter().zip(dyads) {
                    let k = value * f64::from(*weight);
                    for (entry, share) in block.iter_mut().zip(dyad) {
                        *entry += k * share;
                    }
                }
            }
        } else if let Some(springs) = springs {
            let alive = self.alive[particle as usize];
            around.for_each_spring(self.lattice, particle, springs, alive, |direction, k| {
                for (entry, share) in block.iter_mut().zip(&DYADS[direction]) {
                    *entry += 2.0 * k * share;
                }
            });
        }
        if let Some(cells) = cells {
            // 8 h^3 g g^T is half a pitch times the dyad of the signs.
            let half = 0.5 * self.lattice.pitch;
            for (octant, corner) in around.cells.iter().enumerate() {
                let modulus = cells.get(*corner as usize).map_or(0.0, |&value| f64::from(value).max(0.0));
                let [x, y, z] = [0, 1, 2].map(|axis| if octant >> axis & 1 == 1 { 1.0 } else { -1.0 });
                for (entry, sign) in block.iter_mut().zip([1.0, 1.0, 1.0, y * z, x * z, x * y]) {
                    *entry += half * modulus * sign;
                }
            }
        }
        block
    }
}

/// `n n^T` of each direction.
const DYADS: [Symmetric; NEIGHBOURS] = dyads();

const fn dyads() -> [Symmetric; NEIGHBOURS] {
    let mut dyads = [[0.0; 6]; NEIGHBOURS];
    let mut d = 0;
    while d < NEIGHBOURS {
        let [x, y, z] = OFFSETS[d];
        let square = family(d) as f64;
        dyads[d] = [
            (x * x) as f64 / square,
            (y * y) as f64 / square,
            (z * z) as f64 / square,
            (y * z) as f64 / square,
            (x * z) as f64 / square,
            (x * y) as f64 / square,
        ];
        d += 1;
    }
    dyads
}

/// The cells around a particle: octant x + 2 y + 4 z, each 0 towards minus and 1 towards plus, named by their lowest
/// corner.
struct Around {
    cells: [u32; 8],
    point: usize,
}

impl Around {
    fn of(lattice: &Lattice, particle: u32) -> Self {
        let shape = lattice.grid.shape;
        let point = lattice.points[particle as usize] as usize;
        let ijk = shape.ijk(point);
        let cells = std::array::from_fn(|octant| {
            let side = [octant & 1, octant >> 1 & 1, octant >> 2];
            if (0..3).any(|axis| ijk[axis] + side[axis] == 0) {
                return NO_PARTICLE;
            }
            lattice.particle_at[shape.linear([0, 1, 2].map(|axis| ijk[axis] + side[axis] - 1))]
        });
        Self { cells, point }
    }

    /// Hands on the constant of every living spring; the same values as [`SpringConstants::of`], without its look-ups.
    fn for_each_spring(
        &self,
        lattice: &Lattice,
        particle: u32,
        constants: &SpringConstants,
        alive: u32,
        mut each: impl FnMut(usize, f64),
    ) {
        let mut living = alive;
        let mut next = || {
            let direction = living.trailing_zeros() as usize;
            living &= living.wrapping_sub(1);
            (direction < NEIGHBOURS).then_some(direction)
        };
        match constants {
            SpringConstants::Uniform(value) => {
                while let Some(direction) = next() {
                    each(direction, f64::from(*value));
                }
            }
            SpringConstants::MeanOfEnds(values) => {
                let shape = lattice.grid.shape;
                let own = f64::from(values[particle as usize]);
                while let Some(direction) = next() {
                    // A living spring has two ends inside the grid.
                    let [i, j, k] = OFFSETS[direction].map(|o| o as isize);
                    let step = (k * shape.ny as isize + j) * shape.nx as isize + i;
                    let other = lattice.particle_at[self.point.wrapping_add_signed(step)];
                    each(direction, 0.5 * (own + f64::from(values[other as usize])));
                }
            }
            SpringConstants::SumOfCells { cell, weight } => {
                let value = self.cells.map(|corner| cell.get(corner as usize).map_or(0.0, |&v| f64::from(v)));
                let weight = weight.map(f64::from);
                while let Some(direction) = next() {
                    let mut octants = OCTANTS[direction];
                    let mut sum = 0.0;
                    while octants != 0 {
                        sum += value[octants.trailing_zeros() as usize];
                        octants &= octants - 1;
                    }
                    each(direction, weight[family(direction) - 1] * sum);
                }
            }
        }
    }
}

/// One bit per cell around a particle that holds the spring of a direction.
const OCTANTS: [u8; NEIGHBOURS] = octants();

const fn octants() -> [u8; NEIGHBOURS] {
    let mut masks = [0; NEIGHBOURS];
    let mut d = 0;
    while d < NEIGHBOURS {
        let mut octant = 0;
        while octant < 8 {
            let mut axis = 0;
            let mut holds = true;
            while axis < 3 {
                let plus = octant >> axis & 1 == 1;
                holds &= OFFSETS[d][axis] == 0 || (OFFSETS[d][axis] > 0) == plus;
                axis += 1;
            }
            if holds {
                masks[d] |= 1 << octant;
            }
            octant += 1;
        }
        d += 1;
    }
    masks
}

/// Sum of `n n^T` over the springs of each family that a particle has in the cell of an octant.
const OCTANT_DYADS: [[Symmetric; 3]; 8] = octant_dyads();

const fn octant_dyads() -> [[Symmetric; 3]; 8] {
    let mut sums = [[[0.0; 6]; 3]; 8];
    let mut octant = 0;
    while octant < 8 {
        let mut d = 0;
        while d < NEIGHBOURS {
            if OCTANTS[d] >> octant & 1 == 1 {
                let mut entry = 0;
                while entry < 6 {
                    sums[octant][family(d) - 1][entry] += DYADS[d][entry];
                    entry += 1;
                }
            }
            d += 1;
        }
        octant += 1;
    }
    sums
}

/// The values of the cells whose 28 springs are all alive; 0 for the others. Shape `[particles]`.
pub(crate) fn whole_moduli(lattice: &Lattice, topology: &Topology, values: &[f32]) -> Vec<f32> {
    let whole = |cell: u32| topology.whole_cell(lattice, cell).is_some();
    let kept = |(&value, cell)| if value != 0.0 && whole(cell) { value } else { 0.0 };
    values.par_iter().zip(0..lattice.len() as u32).map(kept).collect()
}

/// The same for fibres.
pub(crate) fn whole_fibres(lattice: &Lattice, topology: &Topology, term: &FibreTerm) -> Vec<[f32; 3]> {
    let whole = |cell: u32| topology.whole_cell(lattice, cell).is_some();
    let kept = |(&root, cell)| if root != [0.0; 3] && whole(cell) { root } else { [0.0; 3] };
    term.root.par_iter().zip(0..lattice.len() as u32).map(kept).collect()
}

fn trace(m: &Symmetric) -> f64 {
    m[0] + m[1] + m[2]
}

/// Never below the largest eigenvalue of a matrix without negative ones, and within 1e-9 of it except beside double roots,
/// where it is within 2e-3.
///
/// Newton's iteration on the characteristic polynomial from above the largest root, where it is convex: it comes down to
/// the root and never passes it.
pub(super) fn largest_eigenvalue(m: &Symmetric) -> f64 {
    let [xx, yy, zz, yz, xz, xy] = *m;
    let mean = (xx + yy + zz) / 3.0;
    let [x, y, z] = [xx - mean, yy - mean, zz - mean];
    // lambda = mean + 2 p cos(phi), with phi in 0..pi/3, so mean + 2 p is above it.
    let square = (x * x + y * y + z * z + 2.0 * (yz * yz + xz * xz + xy * xy)) / 6.0;
    let p = square.sqrt();
    if p <= 1e-12 * mean {
        return mean + 2.0 * p;
    }
    let determinant = x * (y * z - yz * yz) - xy * (xy * z - yz * xz) + xz * (xy * yz - y * xz);
    // r^3 - 3 r = d in units of p, d in -2..2, largest root in 1..2.
    let d = determinant / (square * p);
    let mut r = 2.0_f64;
    for _ in 0..8 {
        let slope = 3.0 * (r * r - 1.0);
        if slope < 1e-6 {
            break;
        }
        r -= ((r * r - 3.0) * r - d).max(0.0) / slope;
    }
    mean + p * r * (1.0 + 1e-12)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix3;

    #[test]
    fn the_largest_eigenvalue_is_never_underestimated() {
        let mut state = 1_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(1_u32 << 31) - 0.5
        };
        for round in 0..2000 {
            // Rank 1, 2, 3 and diagonal ones, whose roots may be double.
            let mut m = Matrix3::zeros();
            for axis in 0..=round % 3 {
                let v = if round % 7 == 0 {
                    Matrix3::identity().column(axis).into_owned()
                } else {
                    nalgebra::Vector3::from_fn(|_, _| random())
                };
                m += v * v.transpose();
            }
            let expected = m.symmetric_eigenvalues().max();
            let found = largest_eigenvalue(&[m.m11, m.m22, m.m33, m.m23, m.m13, m.m12]);
            assert!(found >= expected * (1.0 - 1e-13), "{round}: {found} {expected}");
            assert!(found <= expected * (1.0 + 2e-3), "{round}: {found} {expected} {m}");
        }
    }
}
