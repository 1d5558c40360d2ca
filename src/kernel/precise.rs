//! Springs in f64, block by block: forces and energy, the tangent, and the tangent times a vector.
//!
//! What judges the fast body and what is solved for needs f64 and the second derivative of the energy; both are here, over the
//! same blocks and halos. Every spring has its own constant in every slot, 0 where it is severed or leads nowhere, so no law
//! and no bits are looked at, and the compiler makes registers of the rows. Each particle sums its 26 springs in the order of
//! the directions: the same bits at any number of threads.
//!
//! For the spring from particle i to its neighbour j, with `R` the rest vector, `L` its length, `d = R + u_j - u_i`, `l = |d|` and
//! `n = d / l`:
//!
//! ```text
//! force_i = T n            T = k (l - L) + c n.(v_j - v_i)            as time goes on
//!                          T = k (l - L) + c (l - l') / dt            over a step dt that began with the length l'
//! tangent = K n n^T + max(T / l, 0) (I - n n^T)                       K = k, over a step k + c / dt
//! ```
//!
//! The force over a step is the exact gradient of `1/2 k (l - L)^2 + c / (2 dt) (l - l')^2`; the tangent is its exact second
//! derivative but for the negative part of a spring that is pressed, so that it is never negative; or with that part. `l - L` is
//! `(l^2 - L^2) / (l + L)`, which loses no digits at small strain.
//!
//! Square roots and divisions as written and nothing fused: the same bits on every instruction set.

use multiversion::multiversion;

use super::halo::{HALO_LEN, halo_row};
use super::rows::LANES;
use crate::lattice::layout::{BLOCK, BLOCK_LEN};
use crate::lattice::neighbours::{NEIGHBOURS, OFFSETS};

/// A block of one field with its halo.
pub type WideHalo = [f64; HALO_LEN];
/// One value for each slot of a block.
pub type Slots = [f64; BLOCK_LEN];
/// Values for the springs of a block: direction by direction, slot by slot.
pub const SPRINGS_LEN: usize = NEIGHBOURS * BLOCK_LEN;

/// Squared length below which a spring is taken as having this length [m^2].
const SHORTEST_SQUARED: f64 = 1e-30;
/// In the tangent, a spring is at least this share of its rest length long: its constants stay within f32.
const SHORTEST_SHARE: f64 = 1e-6;

/// What dampers resist.
#[derive(Clone, Copy)]
pub enum Rate<'a> {
    /// There are none.
    None,
    /// Velocities.
    Velocity {
        /// Damping of each spring [N s/m].
        damping: &'a [f64],
        /// x, y, z [m/s].
        velocity: [&'a WideHalo; 3],
    },
    /// A change of length since a step began.
    Earlier {
        /// Damping of each spring over the step [N/m].
        damping: &'a [f64],
        /// Displacement x, y, z when it began [m].
        displacement: [&'a WideHalo; 3],
    },
}

/// Lanes of a row.
type Row = [f64; LANES];

#[inline(always)]
fn row_at(values: &[f64], start: usize) -> &Row {
    values[start..start + LANES].try_into().expect("a row's length")
}

/// A spring direction: rest vector, squared rest length [m, m^2].
#[inline(always)]
fn rest_of(direction: usize, pitch: f64) -> ([f64; 3], f64) {
    let rest = OFFSETS[direction].map(|offset| f64::from(offset) * pitch);
    (rest, rest[0] * rest[0] + rest[1] * rest[1] + rest[2] * rest[2])
}

/// Change of squared length from rest.
#[inline(always)]
fn longer(e: [f64; 3], rest: [f64; 3]) -> f64 {
    e[0] * (2.0 * rest[0] + e[0]) + e[1] * (2.0 * rest[1] + e[1]) + e[2] * (2.0 * rest[2] + e[2])
}

#[inline(always)]
fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Tension of the springs of a row in one direction [N], and their energy [J]: half of it, as each spring has two ends.
#[inline(always)]
fn tensions(
    direction: usize,
    pitch: f64,
    places: [usize; 2],
    stiffness: &Row,
    rate: Rate<'_>,
    displacement: [&WideHalo; 3],
    slots: usize,
) -> ([Row; 3], Row, Row, Row) {
    let [here, there] = places;
    let (rest, rest_squared) = rest_of(direction, pitch);
    let rest_length = rest_squared.sqrt();
    let own = displacement.map(|field| row_at(field, here));
    let far = displacement.map(|field| row_at(field, there));
    let (mut d, mut length, mut tension, mut energy) = ([[0.0; LANES]; 3], [0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for lane in 0..LANES {
        let e = [far[0][lane] - own[0][lane], far[1][lane] - own[1][lane], far[2][lane] - own[2][lane]];
        let change = longer(e, rest);
        let l = (rest_squared + change).max(SHORTEST_SQUARED).sqrt();
        let stretch = change / (l + rest_length);
        length[lane] = l;
        tension[lane] = stiffness[lane] * stretch;
        energy[lane] = 0.25 * stiffness[lane] * stretch * stretch;
        for axis in 0..3 {
            d[axis][lane] = rest[axis] + e[axis];
        }
    }
    match rate {
        Rate::None => {}
        Rate::Velocity { damping, velocity } => {
            let damping = row_at(damping, slots);
            let own = velocity.map(|field| row_at(field, here));
            let far = velocity.map(|field| row_at(field, there));
            for lane in 0..LANES {
                let w = [far[0][lane] - own[0][lane], far[1][lane] - own[1][lane], far[2][lane] - own[2][lane]];
                let along = dot([d[0][lane], d[1][lane], d[2][lane]], w);
                tension[lane] += damping[lane] * along / length[lane];
            }
        }
        Rate::Earlier { damping, displacement: before } => {
            let damping = row_at(damping, slots);
            let then = before.map(|field| row_at(field, here));
            let then_far = before.map(|field| row_at(field, there));
            for lane in 0..LANES {
                let e = [0, 1, 2].map(|axis| d[axis][lane] - rest[axis]);
                let earlier = [0, 1, 2].map(|axis| then_far[axis][lane] - then[axis][lane]);
                // l^2 - l'^2 = (e - e') . (2 R + e + e').
                let change = (e[0] - earlier[0]) * (2.0 * rest[0] + e[0] + earlier[0])
                    + (e[1] - earlier[1]) * (2.0 * rest[1] + e[1] + earlier[1])
                    + (e[2] - earlier[2]) * (2.0 * rest[2] + e[2] + earlier[2]);
                let l = (rest_squared + longer(earlier, rest)).max(SHORTEST_SQUARED).sqrt();
                let longer = change / (length[lane] + l);
                tension[lane] += damping[lane] * longer;
                energy[lane] += 0.25 * damping[lane] * longer * longer;
            }
        }
    }
    (d, length, tension, energy)
}

/// Calls a closure for every row of a block: where it begins among the slots, and where in a halo.
#[inline(always)]
fn for_rows(mut row: impl FnMut(usize, isize, isize)) {
    for z in 0..BLOCK[2] {
        for y in 0..BLOCK[1] {
            row((z * BLOCK[1] + y) * LANES, y as isize, z as isize);
        }
    }
}

/// Where the row at (y, z) and that of its neighbours in a direction begin in a halo.
#[inline(always)]
fn places(direction: usize, y: isize, z: isize) -> [usize; 2] {
    let [dx, dy, dz] = OFFSETS[direction].map(|offset| offset as isize);
    [halo_row(y, z) + 1, (halo_row(y + dy, z + dz) + 1).wrapping_add_signed(dx)]
}

/// Forces x, y, z of the springs on the particles of a block [N], overwritten, and their energy, each spring's half [J].
///
/// - `stiffness`: of every spring [N/m]; [`SPRINGS_LEN`] values.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw+avx2+fma", "x86_64+avx2+fma"), dispatcher = "direct")]
pub fn spring_forces(
    pitch: f64,
    stiffness: &[f64],
    rate: Rate<'_>,
    displacement: [&WideHalo; 3],
    force: [&mut Slots; 3],
) -> f64 {
    let mut energy = [0.0; LANES];
    for_rows(|start, y, z| {
        let mut sum = [[0.0; LANES]; 3];
        for direction in 0..NEIGHBOURS {
            let slots = direction * BLOCK_LEN + start;
            let stiffness = row_at(stiffness, slots);
            if stiffness.iter().all(|&k| k == 0.0) {
                continue;
            }
            let places = places(direction, y, z);
            let (d, length, tension, own) = tensions(direction, pitch, places, stiffness, rate, displacement, slots);
            for lane in 0..LANES {
                let factor = tension[lane] / length[lane];
                energy[lane] += own[lane];
                for axis in 0..3 {
                    sum[axis][lane] += factor * d[axis][lane];
                }
            }
        }
        for axis in 0..3 {
            force[axis][start..start + LANES].copy_from_slice(&sum[axis]);
        }
    });
    energy.iter().sum()
}

/// The tangent of the springs of a block, each as `a d d^T + b I`, and its diagonal blocks, these without what is negative.
///
/// - `exact`: with the negative part of springs that are pressed.
/// - `along`: `a` [N/m^3], `across`: `b` [N/m]; [`SPRINGS_LEN`] values, overwritten.
/// - `diagonal` xx, yy, zz, yz, xz, xy [N/m]: overwritten.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw+avx2+fma", "x86_64+avx2+fma"), dispatcher = "direct")]
pub fn spring_tangents(
    pitch: f64,
    stiffness: &[f64],
    rate: Rate<'_>,
    displacement: [&WideHalo; 3],
    exact: bool,
    [along, across]: [&mut [f32]; 2],
    diagonal: [&mut Slots; 6],
) {
    for_rows(|start, y, z| {
        let mut sum = [[0.0; LANES]; 6];
        for direction in 0..NEIGHBOURS {
            let slots = direction * BLOCK_LEN + start;
            let stiffness = row_at(stiffness, slots);
            let (along, across) = (&mut along[slots..slots + LANES], &mut across[slots..slots + LANES]);
            if stiffness.iter().all(|&k| k == 0.0) {
                along.fill(0.0);
                across.fill(0.0);
                continue;
            }
            let places = places(direction, y, z);
            let (d, length, tension, _) = tensions(direction, pitch, places, stiffness, rate, displacement, slots);
            let damping = match rate {
                Rate::Earlier { damping, .. } => *row_at(damping, slots),
                _ => [0.0; LANES],
            };
            let shortest = SHORTEST_SHARE * rest_of(direction, pitch).1.sqrt();
            for lane in 0..LANES {
                let length = length[lane].max(shortest);
                let whole = tension[lane] / length;
                let b = whole.max(0.0);
                let stiff = stiffness[lane] + damping[lane];
                // Never negative: where the spring is drawn out, b is less than k.
                let a = (stiff - b).max(0.0) / (length * length);
                let taken = if exact { whole } else { b };
                across[lane] = taken as f32;
                along[lane] = ((stiff - taken).max(0.0) / (length * length)) as f32;
                let [x, y, z] = [d[0][lane], d[1][lane], d[2][lane]];
                sum[0][lane] += a * x * x + b;
                sum[1][lane] += a * y * y + b;
                sum[2][lane] += a * z * z + b;
                sum[3][lane] += a * y * z;
                sum[4][lane] += a * x * z;
                sum[5][lane] += a * x * y;
            }
        }
        for entry in 0..6 {
            diagonal[entry][start..start + LANES].copy_from_slice(&sum[entry]);
        }
    });
}

/// The tangent of [`spring_tangents`] times a vector, x, y, z, overwritten.
///
/// - `displacement`: where the tangent was taken [m]; `vector`: with halo.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw+avx2+fma", "x86_64+avx2+fma"), dispatcher = "direct")]
pub fn apply_tangents(
    pitch: f64,
    along: &[f32],
    across: &[f32],
    displacement: [&WideHalo; 3],
    vector: [&WideHalo; 3],
    product: [&mut Slots; 3],
) {
    for_rows(|start, y, z| {
        let mut sum = [[0.0; LANES]; 3];
        for direction in 0..NEIGHBOURS {
            let slots = direction * BLOCK_LEN + start;
            let [here, there] = places(direction, y, z);
            let (rest, _) = rest_of(direction, pitch);
            let along: &[f32; LANES] = along[slots..slots + LANES].try_into().expect("a row's length");
            let across: &[f32; LANES] = across[slots..slots + LANES].try_into().expect("a row's length");
            if along.iter().zip(across).all(|(a, b)| *a == 0.0 && *b == 0.0) {
                continue;
            }
            let own = displacement.map(|field| row_at(field, here));
            let far = displacement.map(|field| row_at(field, there));
            let x = vector.map(|field| row_at(field, here));
            let x_far = vector.map(|field| row_at(field, there));
            for lane in 0..LANES {
                let d = [
                    rest[0] + (far[0][lane] - own[0][lane]),
                    rest[1] + (far[1][lane] - own[1][lane]),
                    rest[2] + (far[2][lane] - own[2][lane]),
                ];
                let w = [x[0][lane] - x_far[0][lane], x[1][lane] - x_far[1][lane], x[2][lane] - x_far[2][lane]];
                let (a, b) = (f64::from(along[lane]), f64::from(across[lane]));
                let s = a * dot(d, w);
                for axis in 0..3 {
                    sum[axis][lane] += s * d[axis] + b * w[axis];
                }
            }
        }
        for axis in 0..3 {
            product[axis][start..start + LANES].copy_from_slice(&sum[axis]);
        }
    });
}
