//! The fast body: one block, row by row, written as plain loops that the compiler turns into vector code.
//!
//! For the spring from particle i to its neighbour j, with `u` the displacements, `R` the rest vector and `d = R + u_j - u_i`:
//!
//! ```text
//! l       = |d|                                   present length
//! l'      = |d - dt (v_j - v_i)|                  length one step earlier
//! force_i = k (1 - L / l) d  +  c (l - l') / dt * d / l
//! ```
//!
//! The damper is Hattori and Kaneko's: it acts on the difference of two lengths, so a rigid rotation, however fast, does
//! not feel it. `l - l'` is computed as `dt (v_j - v_i) . (2 d - dt (v_j - v_i)) / (l + l')`, which loses no digits.
//!
//! Only additions, multiplications, true square roots and divisions are used, never fused: the bits are the same on
//! every instruction set.

use super::halo::{HALO_ROW, Halo, halo_row};
use crate::lattice::layout::{BLOCK, BLOCK_LEN};
use crate::lattice::neighbours::{OFFSETS, family};

/// Particles of a row.
pub const LANES: usize = BLOCK[0];
/// One value per particle of a row.
pub type Lanes = [f32; LANES];
/// Squared length below which a spring is taken as having this length: keeps a collapsed spring finite [m^2].
pub(super) const SHORTEST_SQUARED: f32 = 1e-30;

/// Where the constant of a spring (stiffness or damping) comes from. Chosen per block, never inside the loop.
pub trait SpringConstant: Copy {
    /// False when the constant is zero for every spring, so that nothing is loaded or computed.
    const PRESENT: bool;
    /// What the loop keeps per row.
    type Row;
    /// Called once per row.
    fn row(self, y: usize, z: usize) -> Self::Row;
    /// The constant of the spring in direction `D` of the particle in `lane`.
    fn of<const D: usize>(row: &Self::Row, lane: usize) -> f32;
}

/// No spring has it.
#[derive(Clone, Copy)]
pub struct Absent;

impl SpringConstant for Absent {
    const PRESENT: bool = false;
    type Row = ();
    #[inline(always)]
    fn row(self, _: usize, _: usize) {}
    #[inline(always)]
    fn of<const D: usize>(_: &(), _: usize) -> f32 {
        0.0
    }
}

/// The same for all springs of a family (face, face diagonal, body diagonal).
#[derive(Clone, Copy)]
pub struct Uniform {
    /// Face, face diagonal, body diagonal.
    pub by_family: [f32; 3],
}

impl SpringConstant for Uniform {
    const PRESENT: bool = true;
    type Row = [f32; 3];
    #[inline(always)]
    fn row(self, _: usize, _: usize) -> [f32; 3] {
        self.by_family
    }
    #[inline(always)]
    fn of<const D: usize>(row: &[f32; 3], _: usize) -> f32 {
        row[const { family(D) } - 1]
    }
}

/// The mean of the two ends' constants (model `paper` with several organs).
#[derive(Clone, Copy)]
pub struct MeanOfEnds<'a> {
    /// Constant of each particle, with halo.
    pub particle: &'a Halo,
}

impl<'a> SpringConstant for MeanOfEnds<'a> {
    const PRESENT: bool = true;
    type Row = [&'a [f32; HALO_ROW]; 9];
    #[inline(always)]
    fn row(self, y: usize, z: usize) -> Self::Row {
        rows_around(self.particle, y, z)
    }
    #[inline(always)]
    fn of<const D: usize>(row: &Self::Row, lane: usize) -> f32 {
        0.5 * (row[4][lane + 1] + row[const { row_of(D) }][lane + const { column_of(D) }])
    }
}

/// The sum over the cells that share the spring (model `tissue`): 4 for a face, 2 for a face diagonal, 1 for a body
/// diagonal.
#[derive(Clone, Copy)]
pub struct SumOfCells<'a> {
    /// Modulus of the cell above each grid point (towards +x, +y, +z), with halo.
    pub cell: &'a Halo,
    /// What a cell of modulus 1 gives to a spring of each family.
    pub weight: [f32; 3],
}

impl<'a> SpringConstant for SumOfCells<'a> {
    const PRESENT: bool = true;
    type Row = ([&'a [f32; HALO_ROW]; 9], [f32; 3]);
    #[inline(always)]
    fn row(self, y: usize, z: usize) -> Self::Row {
        (rows_around(self.cell, y, z), self.weight)
    }
    #[inline(always)]
    fn of<const D: usize>((rows, weight): &Self::Row, lane: usize) -> f32 {
        // Cell on the side (sx, sy, sz), each 0 towards minus, 1 towards plus.
        let cell = |sx: usize, sy: usize, sz: usize| rows[sz * 3 + sy][lane + sx];
        let [dx, dy, dz] = OFFSETS[D];
        let side = |d: i32| usize::from(d > 0);
        let sum = match (dx != 0, dy != 0, dz != 0) {
            (true, true, true) => cell(side(dx), side(dy), side(dz)),
            (true, true, false) => cell(side(dx), side(dy), 0) + cell(side(dx), side(dy), 1),
            (true, false, true) => cell(side(dx), 0, side(dz)) + cell(side(dx), 1, side(dz)),
            (false, true, true) => cell(0, side(dy), side(dz)) + cell(1, side(dy), side(dz)),
            (true, false, false) => {
                let s = side(dx);
                (cell(s, 0, 0) + cell(s, 1, 0)) + (cell(s, 0, 1) + cell(s, 1, 1))
            }
            (false, true, false) => {
                let s = side(dy);
                (cell(0, s, 0) + cell(1, s, 0)) + (cell(0, s, 1) + cell(1, s, 1))
            }
            (false, false, true) => {
                let s = side(dz);
                (cell(0, 0, s) + cell(1, 0, s)) + (cell(0, 1, s) + cell(1, 1, s))
            }
            (false, false, false) => 0.0,
        };
        weight[const { family(D) } - 1] * sum
    }
}

/// Which springs of a block are alive. Chosen per block.
pub trait Alive: Copy {
    /// What the loop keeps per row.
    type Row;
    /// Called once per row.
    fn row(self, y: usize, z: usize) -> Self::Row;
    /// `constant` when the spring in direction `D` of `lane` is alive, else exactly 0.
    fn keep<const D: usize>(row: &Self::Row, lane: usize, constant: f32) -> f32;
}

/// Every grid point of the block and around it holds a particle, and no spring is severed.
#[derive(Clone, Copy)]
pub struct Intact;

impl Alive for Intact {
    type Row = ();
    #[inline(always)]
    fn row(self, _: usize, _: usize) {}
    #[inline(always)]
    fn keep<const D: usize>(_: &(), _: usize, constant: f32) -> f32 {
        constant
    }
}

/// One bit per spring.
#[derive(Clone, Copy)]
pub struct Bits<'a> {
    /// Living springs of each slot, one bit per direction.
    pub alive: &'a [u32; BLOCK_LEN],
}

impl<'a> Alive for Bits<'a> {
    type Row = &'a [u32; LANES];
    #[inline(always)]
    fn row(self, y: usize, z: usize) -> Self::Row {
        row_of_block(self.alive, y, z)
    }
    #[inline(always)]
    fn keep<const D: usize>(row: &Self::Row, lane: usize, constant: f32) -> f32 {
        // All ones or all zeros: an AND instead of a branch.
        f32::from_bits(constant.to_bits() & ((row[lane] >> D) & 1).wrapping_neg())
    }
}

/// Forces that are known before the springs are summed. Chosen per block.
pub trait KnownForce: Copy {
    /// What the loop keeps per row.
    type Row;
    /// Called once per row.
    fn row(self, y: usize, z: usize) -> Self::Row;
    /// Force on the particle in `lane` [N]; the springs' are added to it.
    fn of(row: &Self::Row, lane: usize) -> [f32; 3];
}

impl KnownForce for Absent {
    type Row = ();
    #[inline(always)]
    fn row(self, _: usize, _: usize) {}
    #[inline(always)]
    fn of(_: &(), _: usize) -> [f32; 3] {
        [0.0; 3]
    }
}

/// One force per particle.
#[derive(Clone, Copy)]
pub struct Known<'a> {
    /// Force x, y, z of each slot [N].
    pub force: &'a [[f32; BLOCK_LEN]; 3],
}

impl<'a> KnownForce for Known<'a> {
    type Row = [&'a Lanes; 3];
    #[inline(always)]
    fn row(self, y: usize, z: usize) -> Self::Row {
        self.force.each_ref().map(|axis| row_of_block(axis, y, z))
    }
    #[inline(always)]
    fn of(row: &Self::Row, lane: usize) -> [f32; 3] {
        [row[0][lane], row[1][lane], row[2][lane]]
    }
}

/// What a block is stepped from.
#[derive(Clone, Copy)]
pub struct BlockState<'a> {
    /// Displacement x, y, z with halo [m].
    pub displacement: [&'a Halo; 3],
    /// Velocity x, y, z with halo [m/s]; read only with a damper.
    pub velocity: [&'a Halo; 3],
    /// Time step over mass [s/kg]; 0 for particles that are held and for empty slots.
    pub dt_over_mass: &'a [f32; BLOCK_LEN],
}

/// Numbers that are the same for every block of a step.
#[derive(Debug, Clone, Copy)]
pub struct StepConstants {
    /// Distance of neighbouring particles [m].
    pub pitch: f32,
    /// Rest length of face, face-diagonal and body-diagonal springs [m].
    pub rest_length: [f32; 3],
    /// Time step [s].
    pub dt: f32,
    /// What gravity adds to the velocity of a free particle in one step [m/s].
    pub gravity_dt: [f32; 3],
}

impl StepConstants {
    /// - `pitch` [m], `dt` [s], `gravity` in lattice axes [m/s^2].
    ///
    /// Rest lengths are computed as the loop computes lengths, so that a lattice at rest has no force at all.
    pub fn new(pitch: f64, dt: f64, gravity: [f64; 3]) -> Self {
        let pitch = pitch as f32;
        let square = pitch * pitch;
        Self {
            pitch,
            rest_length: [pitch, (square + square).sqrt(), (square + square + square).sqrt()],
            dt: dt as f32,
            gravity_dt: gravity.map(|g| (g * dt) as f32),
        }
    }
}

/// Advances the velocities of one block by one step of symplectic Euler.
///
/// - `velocity` x, y, z [m/s]: the block's own slots, old on entry, new on return.
/// - Returns the largest squared speed of the block [m^2/s^2], infinite when any velocity is not finite.
#[inline(always)]
pub fn kick_block<K: SpringConstant, C: SpringConstant, A: Alive, F: KnownForce>(
    step: StepConstants,
    stiffness: K,
    damping: C,
    alive: A,
    known: F,
    state: BlockState<'_>,
    velocity: [&mut [f32; BLOCK_LEN]; 3],
) -> f32 {
    let [velocity_x, velocity_y, velocity_z] = velocity;
    let mut fastest = 0.0_f32;
    for z in 0..BLOCK[2] {
        for y in 0..BLOCK[1] {
            let dt_over_mass = row_of_block(state.dt_over_mass, y, z);
            if dt_over_mass.iter().all(|&w| w == 0.0) {
                continue;
            }
            let row = Row {
                step,
                displacement: state.displacement.map(|halo| rows_around(halo, y, z)),
                velocity: state.velocity.map(|halo| rows_around(halo, y, z)),
                stiffness: stiffness.row(y, z),
                damping: damping.row(y, z),
                alive: alive.row(y, z),
                known: known.row(y, z),
                dt_over_mass,
            };
            let speeds = kick_row::<K, C, A, F>(
                &row,
                row_of_block_mut(velocity_x, y, z),
                row_of_block_mut(velocity_y, y, z),
                row_of_block_mut(velocity_z, y, z),
            );
            for speed in speeds {
                // Written so that NaN counts as infinite.
                fastest = if speed <= fastest {
                    fastest
                } else if speed < f32::MAX {
                    speed
                } else {
                    f32::INFINITY
                };
            }
        }
    }
    fastest
}

struct Row<'a, K: SpringConstant, C: SpringConstant, A: Alive, F: KnownForce> {
    step: StepConstants,
    displacement: [[&'a [f32; HALO_ROW]; 9]; 3],
    velocity: [[&'a [f32; HALO_ROW]; 9]; 3],
    stiffness: K::Row,
    damping: C::Row,
    alive: A::Row,
    known: F::Row,
    dt_over_mass: &'a [f32; LANES],
}

#[inline(always)]
fn kick_row<K: SpringConstant, C: SpringConstant, A: Alive, F: KnownForce>(
    row: &Row<'_, K, C, A, F>,
    velocity_x: &mut Lanes,
    velocity_y: &mut Lanes,
    velocity_z: &mut Lanes,
) -> Lanes {
    let mut speeds = [0.0; LANES];
    for lane in 0..LANES {
        let mut force = F::of(&row.known, lane);
        macro_rules! springs { ($($direction:literal)*) => { $( add_spring::<$direction, K, C, A, F>(row, lane, &mut force); )* } }
        springs!(0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25);
        let weight = row.dt_over_mass[lane];
        let free = if weight > 0.0 { 1.0 } else { 0.0 };
        let vx = velocity_x[lane] + (force[0] * weight + row.step.gravity_dt[0] * free);
        let vy = velocity_y[lane] + (force[1] * weight + row.step.gravity_dt[1] * free);
        let vz = velocity_z[lane] + (force[2] * weight + row.step.gravity_dt[2] * free);
        velocity_x[lane] = vx;
        velocity_y[lane] = vy;
        velocity_z[lane] = vz;
        speeds[lane] = vx * vx + vy * vy + vz * vz;
    }
    speeds
}

#[inline(always)]
fn add_spring<const D: usize, K: SpringConstant, C: SpringConstant, A: Alive, F: KnownForce>(
    row: &Row<'_, K, C, A, F>,
    lane: usize,
    force: &mut [f32; 3],
) {
    let (near, far) = (lane + 1, lane + const { column_of(D) });
    let rest = const { rest_of(D) };
    let mut d = [0.0_f32; 3];
    for axis in 0..3 {
        let rows = &row.displacement[axis];
        d[axis] = rest[axis] * row.step.pitch + (rows[const { row_of(D) }][far] - rows[4][near]);
    }
    let length_squared = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).max(SHORTEST_SQUARED);
    let length = length_squared.sqrt();
    let rest_length = row.step.rest_length[const { family(D) } - 1];
    let stiffness = A::keep::<D>(&row.alive, lane, K::of::<D>(&row.stiffness, lane));
    let mut factor = stiffness * (1.0 - rest_length / length);
    if C::PRESENT {
        let damping = A::keep::<D>(&row.alive, lane, C::of::<D>(&row.damping, lane));
        let mut w = [0.0_f32; 3];
        let mut earlier_squared = 0.0_f32;
        let mut approach = 0.0_f32;
        for axis in 0..3 {
            let rows = &row.velocity[axis];
            w[axis] = rows[const { row_of(D) }][far] - rows[4][near];
            let earlier = d[axis] - row.step.dt * w[axis];
            earlier_squared += earlier * earlier;
            approach += w[axis] * (d[axis] + earlier);
        }
        // (l - l') / dt, and over l to turn d into a unit vector.
        factor += damping * approach / ((length + earlier_squared.sqrt()) * length);
    }
    force[0] += factor * d[0];
    force[1] += factor * d[1];
    force[2] += factor * d[2];
}

/// Which of the nine rows around (x fastest taken out) holds the neighbour in direction `d`.
pub(super) const fn row_of(d: usize) -> usize {
    ((OFFSETS[d][2] + 1) * 3 + OFFSETS[d][1] + 1) as usize
}

/// Column of the neighbour of lane 0 in its halo row.
pub(super) const fn column_of(d: usize) -> usize {
    (OFFSETS[d][0] + 1) as usize
}

const fn rest_of(d: usize) -> [f32; 3] {
    [OFFSETS[d][0] as f32, OFFSETS[d][1] as f32, OFFSETS[d][2] as f32]
}

#[inline(always)]
pub(super) fn rows_around(halo: &Halo, y: usize, z: usize) -> [&[f32; HALO_ROW]; 9] {
    std::array::from_fn(|place| {
        let start = halo_row(y as isize + (place % 3) as isize - 1, z as isize + (place / 3) as isize - 1);
        halo[start..start + HALO_ROW].try_into().expect("a row's length")
    })
}

#[inline(always)]
pub(super) fn row_of_block<T>(block: &[T; BLOCK_LEN], y: usize, z: usize) -> &[T; LANES] {
    let start = (z * BLOCK[1] + y) * LANES;
    block[start..start + LANES].try_into().expect("a row's length")
}

#[inline(always)]
pub(super) fn row_of_block_mut<T>(block: &mut [T; BLOCK_LEN], y: usize, z: usize) -> &mut [T; LANES] {
    let start = (z * BLOCK[1] + y) * LANES;
    (&mut block[start..start + LANES]).try_into().expect("a row's length")
}
