//! The fast bodies of fibres: their stress within the cells' pass, and their part of the stable step.
//!
//! A cell's fibres are one vector `b = sqrt(E_f) a`, `a` their direction at rest. With `G` the cell's mean displacement gradient
//! (see [`super::volume`]) and `m = b + G b`:
//!
//! ```text
//! W       = 1/2 h^3 (|m| - |b|)^2            for |m| > |b|, else 0
//! force_c = -h^3 (|m| - |b|) / |m|  m (b . g_c)      on corner c, with g_c = (+-1, +-1, +-1) / 4h
//! ```
//!
//! which is the exact gradient of the energy. `|m| - |b|` is `(2 b . G b + |G b|^2) / (|m| + |b|)`, so that no digit is lost at
//! small stretch. The nine numbers of a cell, `h^2/4` times its stress, are added to those of its volume term: gathering them
//! costs nothing more.
//!
//! Second derivative: `E_f [n n^T + (1 - 1 / lambda) (I - n n^T)]` in `F a`, with `n = m / |m|`, at most `E_f I` at any stretch and
//! rotation. `F a` moves by `sum_c s_c u_c` with `s_c = a . g_c`, and `|sum s_c x_c|^2 <= (sum |s_d|) sum |s_c| x_c^2`, so a
//! corner sees at most `h^3 |s_c| sum |s_d|` times that: block by block, a bound that is exact in modes that turn every second
//! plane against the next. Slack fibres are counted as if they were drawn straight, because they may be in the next step.
//!
//! Only additions, multiplications, true square roots and divisions are used, never fused: the bits are the same on every
//! instruction set.

use multiversion::multiversion;

use super::halo::{HALO_LEN, Halo, halo_row};
use super::laws::Absent;
use super::rows::{LANES, Lanes, row_of_block_mut, rows_around};
use super::spring::SHORTEST_SQUARED;
use super::volume::{CellConstant, CellPlanes, CellStep, block_cell_forces};
use crate::lattice::layout::{BLOCK, BLOCK_LEN};

/// Where the fibres of the cells come from. Chosen per block.
pub trait Fibres: Copy {
    /// False when no cell has any, so that nothing is loaded or computed.
    const PRESENT: bool;
    /// `b` of the cells above [`LANES`] grid points of the halo from `first` on: x, y, z.
    fn lanes(&self, first: usize) -> [&Lanes; 3];
}

impl Fibres for Absent {
    const PRESENT: bool = false;
    #[inline(always)]
    fn lanes(&self, _: usize) -> [&Lanes; 3] {
        [&[0.0; LANES]; 3]
    }
}

/// The same for every cell that touches the block.
#[derive(Clone, Copy)]
pub struct SameFibres {
    lanes: [Lanes; 3],
}

impl SameFibres {
    /// Cells that all have this `b` [Pa^1/2].
    pub fn new(root: [f32; 3]) -> Self {
        Self { lanes: root.map(|part| [part; LANES]) }
    }
}

impl Fibres for SameFibres {
    const PRESENT: bool = true;
    #[inline(always)]
    fn lanes(&self, _: usize) -> [&Lanes; 3] {
        self.lanes.each_ref()
    }
}

/// `b` of the cell above each grid point; 0 where it has no fibres.
#[derive(Clone, Copy)]
pub struct EachFibres<'a> {
    /// x, y, z with halo [Pa^1/2].
    pub cell: [&'a Halo; 3],
}

impl Fibres for EachFibres<'_> {
    const PRESENT: bool = true;
    #[inline(always)]
    fn lanes(&self, first: usize) -> [&Lanes; 3] {
        self.cell.map(|halo| halo[first..first + LANES].try_into().expect("a group's length"))
    }
}

/// `(|m| - |b|) / |m| m` of one cell, 0 when it is slack: the stress is its dyad with `b`.
#[inline(always)]
pub(super) fn pull(g: &[[f32; 3]; 3], b: [f32; 3]) -> [f32; 3] {
    let moved = [
        g[0][0] * b[0] + g[0][1] * b[1] + g[0][2] * b[2],
        g[1][0] * b[0] + g[1][1] * b[1] + g[1][2] * b[2],
        g[2][0] * b[0] + g[2][1] * b[1] + g[2][2] * b[2],
    ];
    let rest_squared = b[0] * b[0] + b[1] * b[1] + b[2] * b[2];
    let change = 2.0 * (b[0] * moved[0] + b[1] * moved[1] + b[2] * moved[2])
        + (moved[0] * moved[0] + moved[1] * moved[1] + moved[2] * moved[2]);
    let length = (rest_squared + change).max(SHORTEST_SQUARED).sqrt();
    let share = change / ((length + rest_squared.sqrt()) * length);
    // A cell that is not whole can have a corner anywhere: nothing of what was computed from it may pass.
    let taut = change > 0.0 && rest_squared > 0.0;
    let [x, y, z] = [share * (b[0] + moved[0]), share * (b[1] + moved[1]), share * (b[2] + moved[2])];
    if taut { [x, y, z] } else { [0.0; 3] }
}

/// [`block_cell_forces`] on the best instruction set of this machine. Same bits on all of them.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw+avx2+fma", "x86_64+avx2+fma"), dispatcher = "direct")]
pub fn cell_forces<M: CellConstant, V: CellConstant, F: Fibres>(
    step: CellStep,
    of_cells: (M, V, F),
    displacement: [&Halo; 3],
    velocity: [&Halo; 3],
    work: &mut CellPlanes,
    force: &mut [[f32; BLOCK_LEN]; 3],
) {
    block_cell_forces(step, of_cells, displacement, velocity, work, force);
}

/// Adds `K u` of one block for fibres drawn straight, at rest, to `out`.
///
/// - `u` x, y, z with halo; `out` x, y, z.
/// - `root`: `E_f^1/4 a` of the cell above each grid point, with halo, 0 where a spring of the cell is severed: the form is
///   `h^3 (root . G root)^2`.
/// - `work`: buffer for what each cell pulls with.
///
/// # Accuracy
/// f32, each row within 1e-5 of its largest entry times the vector.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw+avx2+fma", "x86_64+avx2+fma"), dispatcher = "direct")]
pub fn add_linear(root: [&Halo; 3], pitch: f32, u: [&Halo; 3], work: &mut [Halo; 3], out: [&mut [f32; BLOCK_LEN]; 3]) {
    // h^3 over (4 h)^2.
    let scale = pitch / 16.0;
    for z in -1..BLOCK[2] as isize {
        for y in -1..BLOCK[1] as isize {
            let own = halo_row(y, z);
            let rows = [own, halo_row(y + 1, z), halo_row(y, z + 1), halo_row(y + 1, z + 1)];
            for lane in 0..=LANES {
                let q = root.map(|halo| halo[own + lane]);
                let mut rate = 0.0_f32;
                for corner in 0..8 {
                    let side = [corner & 1, corner >> 1 & 1, corner >> 2];
                    let place = rows[side[2] * 2 + side[1]] + lane + side[0];
                    let along = q[0] * u[0][place] + q[1] * u[1][place] + q[2] * u[2][place];
                    rate += signed(q, side) * along;
                }
                for axis in 0..3 {
                    work[axis][own + lane] = scale * rate * q[axis];
                }
            }
        }
    }
    let [out_x, out_y, out_z] = out;
    for z in 0..BLOCK[2] {
        for y in 0..BLOCK[1] {
            let (q, pull) = (root.map(|halo| rows_around(halo, y, z)), work.each_ref().map(|h| rows_around(h, y, z)));
            let mut sum = [[0.0_f32; LANES]; 3];
            for octant in 0..8 {
                let side = [octant & 1, octant >> 1 & 1, octant >> 2];
                let row = side[2] * 3 + side[1];
                for lane in 0..LANES {
                    let place = lane + side[0];
                    // A particle is a lower corner of the cell above it.
                    let share = -signed([q[0][row][place], q[1][row][place], q[2][row][place]], side);
                    for axis in 0..3 {
                        sum[axis][lane] += share * pull[axis][row][place];
                    }
                }
            }
            for (out, sum) in [&mut *out_x, &mut *out_y, &mut *out_z].into_iter().zip(&sum) {
                row_of_block_mut(out, y, z).iter_mut().zip(sum).for_each(|(out, sum)| *out += sum);
            }
        }
    }
}

/// `vector . (+-1, +-1, +-1)`, plus where a side is 1.
#[inline(always)]
fn signed(vector: [f32; 3], side: [usize; 3]) -> f32 {
    let part = |axis: usize| if side[axis] == 1 { vector[axis] } else { -vector[axis] };
    part(0) + part(1) + part(2)
}

/// What the cells' fibres add to the blocks of their corners, each times `|b . signs of the corner|`.
#[derive(Debug, Clone)]
pub struct FibreTangents {
    /// The dyad of these is the stiffness along the fibre, beyond `every`.
    along: [Halo; 3],
    /// In every direction.
    every: Halo,
}

impl FibreTangents {
    /// Empty buffers.
    pub fn new() -> Box<Self> {
        Box::new(Self { along: [[0.0; HALO_LEN]; 3], every: [0.0; HALO_LEN] })
    }
}

/// Fills the cells that touch a block, for the present shape; see the module.
#[inline(always)]
pub(super) fn fill_tangents(root: [&Halo; 3], displacement: [&Halo; 3], pitch: f32, cells: &mut FibreTangents) {
    // Mean of four differences over one pitch.
    let scale = 0.25 / pitch;
    for z in -1..BLOCK[2] as isize {
        for y in -1..BLOCK[1] as isize {
            let own = halo_row(y, z);
            let rows = [own, halo_row(y + 1, z), halo_row(y, z + 1), halo_row(y + 1, z + 1)];
            for lane in 0..=LANES {
                let b = root.map(|halo| halo[own + lane]);
                let mut m = b;
                let mut all = 0.0_f32;
                for corner in 0..8 {
                    let side = [corner & 1, corner >> 1 & 1, corner >> 2];
                    let place = rows[side[2] * 2 + side[1]] + lane + side[0];
                    let share = signed(b, side);
                    all += share.abs();
                    for axis in 0..3 {
                        m[axis] += scale * share * displacement[axis][place];
                    }
                }
                let squared = b[0] * b[0] + b[1] * b[1] + b[2] * b[2];
                let length_squared = (m[0] * m[0] + m[1] * m[1] + m[2] * m[2]).max(SHORTEST_SQUARED);
                let across = (1.0 - (squared / length_squared).sqrt()).max(0.0);
                // h^3 E_f |s_c| sum |s_d| but for |b . signs of c|: E_f is in both factors of b.
                let stiffness = pitch / 16.0 * all;
                let root = (stiffness * (1.0 - across) / length_squared).sqrt();
                for axis in 0..3 {
                    cells.along[axis][own + lane] = root * m[axis];
                }
                cells.every[own + lane] = stiffness * across;
            }
        }
    }
}

/// Adds them to the blocks of a row of particles: entries xx, yy, zz, yz, xz, xy.
#[inline(always)]
pub(super) fn add_tangents(root: [&Halo; 3], cells: &FibreTangents, y: usize, z: usize, block: &mut [Lanes; 6]) {
    let every = rows_around(&cells.every, y, z);
    let along = cells.along.each_ref().map(|halo| rows_around(halo, y, z));
    let root = root.map(|halo| rows_around(halo, y, z));
    for octant in 0..8 {
        let side = [octant & 1, octant >> 1 & 1, octant >> 2];
        let row = side[2] * 3 + side[1];
        for lane in 0..LANES {
            let place = lane + side[0];
            let share = signed([root[0][row][place], root[1][row][place], root[2][row][place]], side).abs();
            let w = [along[0][row][place], along[1][row][place], along[2][row][place]];
            let every = every[row][place];
            block[0][lane] += share * (w[0] * w[0] + every);
            block[1][lane] += share * (w[1] * w[1] + every);
            block[2][lane] += share * (w[2] * w[2] + every);
            block[3][lane] += share * (w[1] * w[2]);
            block[4][lane] += share * (w[0] * w[2]);
            block[5][lane] += share * (w[0] * w[1]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::dispatch::InstructionSet;
    use crate::kernel::volume::{EachCell, SameCells};

    fn random(seed: u32, low: f32, high: f32) -> Halo {
        let mut state = seed;
        std::array::from_fn(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            low + (high - low) * (state >> 8) as f32 / (1 << 24) as f32
        })
    }

    /// The test program is compiled for the baseline.
    #[test]
    fn every_set_of_fibres_gives_the_bits_of_the_baseline() {
        let step = CellStep::new(3e-3, 1e-4);
        let displacement = [11, 12, 13].map(|seed| random(seed, -1e-3, 1e-3));
        let velocity = [14, 15, 16].map(|seed| random(seed, -0.5, 0.5));
        let mut modulus = random(17, -2e3, 8e4);
        let viscosity = random(18, 0.0, 40.0);
        let mut root = [19, 20, 21].map(|seed| random(seed, -150.0, 150.0));
        // Cells without one or the other: runs longer than a group of lanes, and single ones.
        modulus[400..450].fill(0.0);
        modulus.iter_mut().step_by(7).for_each(|value| *value = 0.0);
        for axis in &mut root {
            axis[430..480].fill(0.0);
            axis.iter_mut().step_by(5).for_each(|value| *value = 0.0);
        }
        let each = EachFibres { cell: root.each_ref() };
        let same = SameFibres::new([70.0, -50.0, 120.0]);
        let mut compared = 0;
        macro_rules! compare { ($($modulus:expr, $viscosity:expr, $fibres:expr;)*) => { $(
            let run = |best: bool| {
                let mut force = [[f32::NAN; BLOCK_LEN]; 3];
                let mut work = CellPlanes::new();
                let (u, v) = (displacement.each_ref(), velocity.each_ref());
                if best {
                    cell_forces(step, ($modulus, $viscosity, $fibres), u, v, &mut work, &mut force);
                } else {
                    block_cell_forces(step, ($modulus, $viscosity, $fibres), u, v, &mut work, &mut force);
                }
                force.map(|axis| axis.map(f32::to_bits))
            };
            assert!(run(true) == run(false), "{} on {}", stringify!($modulus, $viscosity, $fibres), InstructionSet::best().name());
            assert!(run(true).iter().flatten().all(|&bits| f32::from_bits(bits).is_finite()));
            assert!(run(true).iter().flatten().any(|&bits| f32::from_bits(bits) != 0.0));
            compared += 1;
        )* } }
        compare! {
            Absent, Absent, same;
            Absent, Absent, each;
            SameCells::new(5e4), Absent, same;
            SameCells::new(5e4), SameCells::new(12.0), same;
            EachCell { cell: &modulus }, Absent, each;
            EachCell { cell: &modulus }, EachCell { cell: &viscosity }, each;
        }
        assert_eq!(compared, 6);
    }
}
