//! A bound on the stiffness that each particle sees as the lattice stands now, one block at a time.
//!
//! A spring of length `l` with unit vector `n` has the tangent `k [n n^T + (1 - L / l) (I - n n^T)]`; a negative part
//! (the spring is compressed) is left out. A cell has `lambda h^3 [(cof F g)(cof F g)^T + (J - 1) d2J]`, and since
//! `J(F + H)` is at most `|F| |H|^2` away from its linear part, the second term adds at most `|lambda| h |J - 1| |F|` to each
//! corner. As at rest, springs count twice and the rank-one part of a cell eight times; what fibres add stands in
//! [`super::fibres`].
//!
//! A particle far from balance is moved past its neighbours before any tangent means something: a force that would carry
//! it further than [`LEAP`] counts as the stiffness that would do the same.

use multiversion::multiversion;

use super::fibres::{FibreTangents, add_tangents, fill_tangents};
use super::halo::{HALO_LEN, Halo, halo_row};
use super::laws::{Alive, SpringConstant};
use super::rows::{LANES, Lanes, column_of, row_of, row_of_block, rows_around};
use super::spring::SHORTEST_SQUARED;
use crate::lattice::layout::{BLOCK, BLOCK_LEN};
use crate::lattice::neighbours::{OFFSETS, family};

/// How far the springs' force may carry a particle from rest in a step `dt`, `|a| dt^2` [pitches].
pub const LEAP: f32 = 0.5;

/// What the cells around a block add: `cof F` scaled so that its dyad is the stiffness (nine entries, by column: `cof F`
/// times the x, y and z signs of a corner), and what they add to every direction.
#[derive(Debug, Clone)]
pub struct CellTangents {
    cofactor: [Halo; 9],
    pressure: Halo,
    /// Only where there are fibres.
    fibres: Option<Box<FibreTangents>>,
}

impl Default for CellTangents {
    fn default() -> Self {
        Self { cofactor: [[0.0; HALO_LEN]; 9], pressure: [0.0; HALO_LEN], fibres: None }
    }
}

/// What a block's tangent is computed from.
#[derive(Clone, Copy)]
pub struct TangentState<'a> {
    /// Displacement x, y, z with halo [m].
    pub displacement: [&'a Halo; 3],
    /// One over mass [1/kg]; 0 for empty slots and rigid organs.
    pub inverse_mass: &'a [f32; BLOCK_LEN],
    /// Volume modulus of the cell above each grid point with halo [Pa], 0 where a spring of the cell is severed.
    pub modulus: Option<&'a Halo>,
    /// Fibres of the same cells, x, y, z [Pa^1/2]; see [`super::fibres`].
    pub fibres: Option<[&'a Halo; 3]>,
    /// Distance of neighbouring particles [m].
    pub pitch: f32,
    /// Rest length of face, face-diagonal and body-diagonal springs [m].
    pub rest_length: [f32; 3],
}

/// Writes, for every particle of a block, an upper bound of the largest eigenvalue of its part of `M^-1 K` [1/s^2].
/// Same bits on every instruction set.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw+avx2+fma", "x86_64+avx2+fma"), dispatcher = "direct")]
pub fn stiffest<K: SpringConstant, A: Alive>(
    stiffness: K,
    alive: A,
    state: TangentState<'_>,
    cells: &mut CellTangents,
    out: &mut [f32; BLOCK_LEN],
) {
    if let Some(modulus) = state.modulus {
        cell_tangents(modulus, &state, cells);
    }
    if let Some(root) = state.fibres {
        let fibres = cells.fibres.get_or_insert_with(FibreTangents::new);
        fill_tangents(root, state.displacement, state.pitch, fibres);
    }
    for z in 0..BLOCK[2] {
        for y in 0..BLOCK[1] {
            let start = (z * BLOCK[1] + y) * LANES;
            let inverse_mass = row_of_block(state.inverse_mass, y, z);
            if inverse_mass.iter().all(|&w| w == 0.0) {
                out[start..start + LANES].fill(0.0);
                continue;
            }
            let mut block = [[0.0_f32; LANES]; 6];
            let mut force = [[0.0_f32; LANES]; 3];
            add_springs::<K, A>(&stiffness.row(y, z), &alive.row(y, z), &state, [y, z], &mut block, &mut force);
            if state.modulus.is_some() {
                add_cells(cells, y, z, &mut block);
            }
            if let (Some(root), Some(fibres)) = (state.fibres, &cells.fibres) {
                add_tangents(root, fibres, y, z, &mut block);
            }
            for lane in 0..LANES {
                let [x, y, z] = [force[0][lane], force[1][lane], force[2][lane]];
                let leap = (4.0 / LEAP / state.pitch) * (x * x + y * y + z * z).sqrt();
                out[start + lane] = inverse_mass[lane] * largest_eigenvalue(&block, lane).max(leap);
            }
        }
    }
}

/// Entries: xx, yy, zz, yz, xz, xy.
#[inline(always)]
fn add_springs<K: SpringConstant, A: Alive>(
    stiffness: &K::Row,
    alive: &A::Row,
    state: &TangentState<'_>,
    [y, z]: [usize; 2],
    block: &mut [Lanes; 6],
    force: &mut [Lanes; 3],
) {
    let around = state.displacement.map(|halo| rows_around(halo, y, z));
    for lane in 0..LANES {
        let mut sum = [0.0_f32; 6];
        let mut every = 0.0_f32;
        let mut pull = [0.0_f32; 3];
        macro_rules! springs { ($($d:literal)*) => { $( {
            const OFFSET: [f32; 3] = [OFFSETS[$d][0] as f32, OFFSETS[$d][1] as f32, OFFSETS[$d][2] as f32];
            let mut d = [0.0_f32; 3];
            for axis in 0..3 {
                let rows = &around[axis];
                d[axis] = OFFSET[axis] * state.pitch
                    + (rows[const { row_of($d) }][lane + const { column_of($d) }] - rows[4][lane + 1]);
            }
            let squared = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).max(SHORTEST_SQUARED);
            let inverse = 1.0 / squared;
            let across = (1.0 - state.rest_length[const { family($d) - 1 }] * inverse.sqrt());
            let k = 2.0 * A::keep::<$d>(alive, lane, K::of::<$d>(stiffness, lane));
            for axis in 0..3 {
                pull[axis] += 0.5 * k * across * d[axis];
            }
            let across = across.max(0.0);
            every += k * across;
            let along = k * (1.0 - across) * inverse;
            let [ax, ay, az] = [along * d[0], along * d[1], along * d[2]];
            sum[0] += ax * d[0];
            sum[1] += ay * d[1];
            sum[2] += az * d[2];
            sum[3] += ay * d[2];
            sum[4] += ax * d[2];
            sum[5] += ax * d[1];
        } )* } }
        springs!(0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25);
        for axis in 0..3 {
            force[axis][lane] = pull[axis];
        }
        for entry in 0..6 {
            block[entry][lane] = sum[entry] + if entry < 3 { every } else { 0.0 };
        }
    }
}

#[inline(always)]
fn add_cells(cells: &CellTangents, y: usize, z: usize, block: &mut [Lanes; 6]) {
    let pressure = rows_around(&cells.pressure, y, z);
    let cofactor = cells.cofactor.each_ref().map(|entry| rows_around(entry, y, z));
    for octant in 0..8 {
        let side = [octant & 1, octant >> 1 & 1, octant >> 2];
        let row = side[2] * 3 + side[1];
        for lane in 0..LANES {
            let place = lane + side[0];
            let mut w = [0.0_f32; 3];
            for axis in 0..3 {
                for column in 0..3 {
                    let entry = cofactor[column * 3 + axis][row][place];
                    w[axis] += if side[column] == 1 { entry } else { -entry };
                }
            }
            let every = pressure[row][place];
            block[0][lane] += w[0] * w[0] + every;
            block[1][lane] += w[1] * w[1] + every;
            block[2][lane] += w[2] * w[2] + every;
            block[3][lane] += w[1] * w[2];
            block[4][lane] += w[0] * w[2];
            block[5][lane] += w[0] * w[1];
        }
    }
}

/// Fills the cells that touch the block.
#[inline(always)]
fn cell_tangents(modulus: &Halo, state: &TangentState<'_>, cells: &mut CellTangents) {
    let pitch = state.pitch;
    // Mean of four differences over one pitch.
    let scale = 0.25 / pitch;
    for z in -1..BLOCK[2] as isize {
        for y in -1..BLOCK[1] as isize {
            let own = halo_row(y, z);
            if modulus[own..=own + LANES].iter().all(|&modulus| modulus == 0.0) {
                for values in cells.cofactor.iter_mut().chain([&mut cells.pressure]) {
                    values[own..=own + LANES].fill(0.0);
                }
                continue;
            }
            let rows = [own, halo_row(y + 1, z), halo_row(y, z + 1), halo_row(y + 1, z + 1)];
            for lane in 0..=LANES {
                // f[column][axis]: derivative of axis along column.
                let mut f = [[0.0_f32; 3]; 3];
                for axis in 0..3 {
                    for corner in 0..8 {
                        let side = [corner & 1, corner >> 1 & 1, corner >> 2];
                        let u = state.displacement[axis][rows[side[2] * 2 + side[1]] + lane + side[0]];
                        for column in 0..3 {
                            f[column][axis] += if side[column] == 1 { u } else { -u };
                        }
                    }
                    for column in 0..3 {
                        f[column][axis] = scale * f[column][axis] + if column == axis { 1.0 } else { 0.0 };
                    }
                }
                let value = modulus[own + lane];
                // 8 h^3 over (4 h)^2.
                let root = (0.5 * pitch * value.max(0.0)).sqrt();
                let cofactor = [cross(f[1], f[2]), cross(f[2], f[0]), cross(f[0], f[1])];
                let mut volume = 0.0_f32;
                let mut size = 0.0_f32;
                for axis in 0..3 {
                    volume += f[0][axis] * cofactor[0][axis];
                    for column in 0..3 {
                        size += f[column][axis] * f[column][axis];
                        cells.cofactor[column * 3 + axis][own + lane] = root * cofactor[column][axis];
                    }
                }
                cells.pressure[own + lane] = value.abs() * pitch * (volume - 1.0).abs() * size.sqrt();
            }
        }
    }
}

#[inline(always)]
fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Never below the largest eigenvalue but for rounding: Newton's iteration from above on the characteristic polynomial.
#[inline(always)]
fn largest_eigenvalue(block: &[Lanes; 6], lane: usize) -> f32 {
    let [xx, yy, zz] = [block[0][lane], block[1][lane], block[2][lane]];
    let [yz, xz, xy] = [block[3][lane], block[4][lane], block[5][lane]];
    let mean = (xx + yy + zz) * (1.0 / 3.0);
    let [x, y, z] = [xx - mean, yy - mean, zz - mean];
    let square = (x * x + y * y + z * z + 2.0 * (yz * yz + xz * xz + xy * xy)) * (1.0 / 6.0);
    let p = square.sqrt();
    let determinant = x * (y * z - yz * yz) - xy * (xy * z - yz * xz) + xz * (xy * yz - y * xz);
    let d = determinant / (square * p).max(f32::MIN_POSITIVE);
    // r^3 - 3 r = d, largest root in 1..2; the slope is kept away from 0, where steps only get shorter.
    let mut r = 2.0_f32;
    for _ in 0..4 {
        r -= ((r * r - 3.0) * r - d).max(0.0) / (3.0 * (r * r - 1.0)).max(0.1);
    }
    mean + p * r
}
