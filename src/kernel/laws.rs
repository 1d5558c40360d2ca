//! Where the constants of springs come from, and which springs live. Chosen per block, never inside a loop.

use super::halo::{HALO_LEN, HALO_ROW, Halo};
use super::rows::{Around, LANES, column_of, row_of, row_of_block, rows_around};
use super::simd::Vector;
use crate::lattice::layout::{BLOCK, BLOCK_LEN};
use crate::lattice::neighbours::{OFFSETS, family};

/// How far apart neighbours are in an array.
pub trait Strides {
    /// Along x, y and z.
    const STRIDES: [isize; 3];
}

/// Halos.
pub struct HaloStrides;

impl Strides for HaloStrides {
    const STRIDES: [isize; 3] = [1, HALO_ROW as isize, (HALO_ROW * (BLOCK[1] + 2)) as isize];
}

/// From a place to the one at an offset.
pub const fn away<S: Strides>(offset: [i32; 3]) -> isize {
    offset[0] as isize * S::STRIDES[0] + offset[1] as isize * S::STRIDES[1] + offset[2] as isize * S::STRIDES[2]
}

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
    /// What it is made from, with halo; empty where nothing is.
    fn values(&self) -> &[f32];
    /// The constants of the springs in direction `D` of as many particles as there are lanes.
    ///
    /// - `values`: [`SpringConstant::values`], or a part of them laid out as `S` says; `base`: place of the first particle.
    fn lanes<V: Vector, S: Strides, const D: usize>(self, values: &[f32], base: usize) -> V;
}

/// Where the constant of the damper beside a spring comes from. Chosen per block, never inside the loop.
pub trait DamperConstant: Copy {
    /// False when nothing damps, so that nothing is loaded or computed.
    const PRESENT: bool;
    /// What it is made from, with halo; empty where nothing is.
    fn values(&self) -> &[f32];
    /// The constants of the dampers beside springs of a stiffness; otherwise as [`SpringConstant::lanes`].
    fn beside<V: Vector, S: Strides, const D: usize>(self, stiffness: V, values: &[f32], base: usize) -> V;
}

/// A constant of its own, whatever the stiffness.
impl<C: SpringConstant> DamperConstant for C {
    const PRESENT: bool = C::PRESENT;
    #[inline(always)]
    fn values(&self) -> &[f32] {
        SpringConstant::values(self)
    }
    #[inline(always)]
    fn beside<V: Vector, S: Strides, const D: usize>(self, _: V, values: &[f32], base: usize) -> V {
        self.lanes::<V, S, D>(values, base)
    }
}

/// So many times the stiffness, everywhere: nothing is loaded.
#[derive(Clone, Copy)]
pub struct InProportion {
    /// Damping over stiffness [s].
    pub time: f32,
}

impl DamperConstant for InProportion {
    const PRESENT: bool = true;
    #[inline(always)]
    fn values(&self) -> &[f32] {
        &[]
    }
    #[inline(always)]
    fn beside<V: Vector, S: Strides, const D: usize>(self, stiffness: V, _: &[f32], _: usize) -> V {
        stiffness * V::splat(self.time)
    }
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
    #[inline(always)]
    fn values(&self) -> &[f32] {
        &[]
    }
    #[inline(always)]
    fn lanes<V: Vector, S: Strides, const D: usize>(self, _: &[f32], _: usize) -> V {
        V::splat(0.0)
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
    #[inline(always)]
    fn values(&self) -> &[f32] {
        &[]
    }
    #[inline(always)]
    fn lanes<V: Vector, S: Strides, const D: usize>(self, _: &[f32], _: usize) -> V {
        V::splat(self.by_family[const { family(D) } - 1])
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
    type Row = Around<'a>;
    #[inline(always)]
    fn row(self, y: usize, z: usize) -> Self::Row {
        rows_around(self.particle, y, z)
    }
    #[inline(always)]
    fn of<const D: usize>(row: &Self::Row, lane: usize) -> f32 {
        0.5 * (row[4][lane + 1] + row[const { row_of(D) }][lane + const { column_of(D) }])
    }
    #[inline(always)]
    fn values(&self) -> &[f32] {
        self.particle
    }
    #[inline(always)]
    fn lanes<V: Vector, S: Strides, const D: usize>(self, values: &[f32], base: usize) -> V {
        let far = V::load(values, base.wrapping_add_signed(const { away::<S>(OFFSETS[D]) }));
        V::splat(0.5) * (V::load(values, base) + far)
    }
}

/// The sum over the cells that share the spring in direction `$d`, in an order that both of its ends agree on. `$cell` gives the
/// value of the cell on a side (sx, sy, sz) of the particle, each 0 towards minus, 1 towards plus; a macro, because only
/// cells that are there may be asked for.
macro_rules! sum_of_cells {
    ($d:ident, |$sx:ident, $sy:ident, $sz:ident| $value:expr) => {{
        macro_rules! cell {
            ($x:expr, $y:expr, $z:expr) => {{
                let ($sx, $sy, $sz): (usize, usize, usize) = ($x, $y, $z);
                $value
            }};
        }
        let [dx, dy, dz] = const { OFFSETS[$d] };
        let (sx, sy, sz) = (usize::from(dx > 0), usize::from(dy > 0), usize::from(dz > 0));
        match (dx != 0, dy != 0, dz != 0) {
            (true, true, true) => cell!(sx, sy, sz),
            (true, true, false) => cell!(sx, sy, 0) + cell!(sx, sy, 1),
            (true, false, true) => cell!(sx, 0, sz) + cell!(sx, 1, sz),
            (false, true, true) => cell!(0, sy, sz) + cell!(1, sy, sz),
            (true, false, false) => (cell!(sx, 0, 0) + cell!(sx, 1, 0)) + (cell!(sx, 0, 1) + cell!(sx, 1, 1)),
            (false, true, false) => (cell!(0, sy, 0) + cell!(1, sy, 0)) + (cell!(0, sy, 1) + cell!(1, sy, 1)),
            (false, false, _) => (cell!(0, 0, sz) + cell!(1, 0, sz)) + (cell!(0, 1, sz) + cell!(1, 1, sz)),
        }
    }};
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
    type Row = (Around<'a>, [f32; 3]);
    #[inline(always)]
    fn row(self, y: usize, z: usize) -> Self::Row {
        (rows_around(self.cell, y, z), self.weight)
    }
    #[inline(always)]
    fn of<const D: usize>((rows, weight): &Self::Row, lane: usize) -> f32 {
        weight[const { family(D) } - 1] * sum_of_cells!(D, |sx, sy, sz| rows[sz * 3 + sy][lane + sx])
    }
    #[inline(always)]
    fn values(&self) -> &[f32] {
        self.cell
    }
    #[inline(always)]
    fn lanes<V: Vector, S: Strides, const D: usize>(self, values: &[f32], base: usize) -> V {
        let weight = V::splat(self.weight[const { family(D) } - 1]);
        let below = base.wrapping_add_signed(const { away::<S>([-1, -1, -1]) });
        let [x, y, z] = const { [S::STRIDES[0] as usize, S::STRIDES[1] as usize, S::STRIDES[2] as usize] };
        weight * sum_of_cells!(D, |sx, sy, sz| V::load(values, below.wrapping_add(sx * x + sy * y + sz * z)))
    }
}

/// Which springs of a block are alive. Chosen per block.
pub trait Alive: Copy {
    /// What the loop keeps per row.
    type Row;
    /// Called once per row.
    fn row(self, y: usize, z: usize) -> Self::Row;
    /// Some spring of the row may be alive.
    fn any(row: &Self::Row) -> bool;
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
    fn any((): &()) -> bool {
        true
    }
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
    fn any(row: &Self::Row) -> bool {
        row.iter().any(|&springs| springs != 0)
    }
    #[inline(always)]
    fn keep<const D: usize>(row: &Self::Row, lane: usize, constant: f32) -> f32 {
        // All ones or all zeros: an AND instead of a branch.
        f32::from_bits(constant.to_bits() & ((row[lane] >> D) & 1).wrapping_neg())
    }
}

/// Which springs around a block live, for the loop that takes each spring once.
pub trait Living: Copy {
    /// Living springs of each grid point with halo, one bit per direction; empty where all live.
    fn words(&self) -> &[u32];
    /// `factor` where the spring in direction `D` lives, else 0. See [`SpringConstant::lanes`].
    fn keep<V: Vector, const D: usize>(words: &[u32], base: usize, factor: V) -> V;
}

impl Living for Intact {
    fn words(&self) -> &[u32] {
        &[]
    }
    #[inline(always)]
    fn keep<V: Vector, const D: usize>(_: &[u32], _: usize, factor: V) -> V {
        factor
    }
}

/// One bit per spring, with halo.
#[derive(Clone, Copy)]
pub struct HaloBits<'a> {
    /// Living springs of each grid point, one bit per direction.
    pub alive: &'a [u32; HALO_LEN],
}

impl Living for HaloBits<'_> {
    fn words(&self) -> &[u32] {
        self.alive
    }
    #[inline(always)]
    fn keep<V: Vector, const D: usize>(words: &[u32], base: usize, factor: V) -> V {
        factor.keep(words, base, D as u32)
    }
}
