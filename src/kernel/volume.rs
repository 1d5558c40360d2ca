//! The fast body of the cells' volume term: the force against a change of their volume, one block at a time.
//!
//! A cell is the cube between eight particles. With `G` the mean gradient of the displacements over it (of each axis, the
//! mean of four differences along edges, over the pitch `h`), `F = I + G` and `e = det F - 1`:
//!
//! ```text
//! W       = 1/2 L h^3 e^2                    for L >= 0
//! W       = 1/2 L h^3 e^2 / (1 + e^2)        for L < 0
//! p       = (dW/de) / h^3  +  eta (e - e') / dt
//! force_c = -p h^3 cof(F) g_c                on corner c, with g_c = (+-1, +-1, +-1) / 4h
//! ```
//!
//! - A negative modulus `L` (a Poisson's ratio below 1/4) has a negative energy. Quadratic, it would outgrow the springs'
//!   at a large change of volume and tear the tissue apart; with the quotient it stays above `1/2 L h^3` and agrees with
//!   the quadratic to a relative `e^2`.
//! - The viscosity `eta` resists the change of `e` since the step before, taken along the same straight lines as the
//!   spring damper takes a spring's earlier length: `e' = det(F - A) - 1` with `A = dt` times the mean gradient of the
//!   velocities. A rigid rotation, however fast, does not feel it, because both determinants are 1.
//! - Neither difference is taken between rounded determinants:
//!   `e = tr G + tr cof(G) + det G` and `e - e' = cof(F):A - F:cof(A) + det A`.
//!
//! The body runs over planes of cells: nine numbers `p h^2/4 cof(F)` per cell of one plane, then the forces of the plane of
//! particles between it and the plane before. Particles gather, so that the result depends neither on the number of
//! threads nor on how blocks follow each other. The forces on a cell's eight corners cancel to rounding, and so do their
//! moments, as `cof(F) F^T` is symmetric.
//!
//! Fibres, where a block has any, add their stress to the nine numbers of their cells, see [`super::fibres`].
//!
//! Only additions, multiplications and divisions are used, never fused: the bits are the same on every instruction set.
//!
//! Not guaranteed: no resistance to hourglass modes, which leave `G` alone (springs resist them), and a finite energy at
//! `det F <= 0`, so cells can be turned inside out by force.
//!
//! Source: the mean-gradient form is the B-bar idea of Hughes (1980), which keeps nearly incompressible cubes from locking.

use super::fibres::{Fibres, pull};
use super::halo::{HALO_ROW, Halo};
use super::laws::Absent;
use super::rows::{LANES, Lanes};
use crate::lattice::layout::{BLOCK, BLOCK_LEN};

/// Values in a plane of the halo buffer.
const HALO_PLANE: usize = HALO_ROW * (BLOCK[1] + 2);
/// Grid points of a halo plane that can be the lowest corner of a cell, taken as one run over all rows. The last column of
/// each row is no cell: what is computed there is never used.
const CELL_PLANE: usize = HALO_ROW * (BLOCK[1] + 1);
/// Where the last full group of lanes that ends with the plane's last cell begins.
const LAST_GROUP: usize = CELL_PLANE - 1 - LANES;
/// Groups of lanes that cover a plane of cells; the last two overlap.
const CELL_GROUPS: usize = LAST_GROUP.div_ceil(LANES) + 1;
/// Run over the rows of a plane of particles in halo columns.
const PARTICLE_PLANE: usize = HALO_ROW * BLOCK[1];

/// `p h^2/4 cof(F)` of one plane of cells: row a, column b of the matrix at `3 a + b`.
type CellPlane = [[f32; CELL_PLANE]; 9];
/// One number for each particle of a plane, in halo columns.
type ParticlePlane = [f32; PARTICLE_PLANE];

/// Where a constant of the cells (modulus or viscosity) comes from. Chosen per block.
pub trait CellConstant: Copy {
    /// False when it is zero for every cell, so that nothing is loaded or computed.
    const PRESENT: bool;
    /// The constants of the cells above [`LANES`] grid points of the halo from `first` on.
    fn lanes(&self, first: usize) -> &Lanes;
}

impl CellConstant for Absent {
    const PRESENT: bool = false;
    #[inline(always)]
    fn lanes(&self, _: usize) -> &Lanes {
        &[0.0; LANES]
    }
}

/// The same for every cell that touches the block.
#[derive(Clone, Copy)]
pub struct SameCells {
    lanes: Lanes,
}

impl SameCells {
    /// Cells that all have this value.
    pub fn new(value: f32) -> Self {
        Self { lanes: [value; LANES] }
    }
}

impl CellConstant for SameCells {
    const PRESENT: bool = true;
    #[inline(always)]
    fn lanes(&self, _: usize) -> &Lanes {
        &self.lanes
    }
}

/// A value for the cell above each grid point; 0 where a cell adds nothing.
#[derive(Clone, Copy)]
pub struct EachCell<'a> {
    /// With halo.
    pub cell: &'a Halo,
}

impl CellConstant for EachCell<'_> {
    const PRESENT: bool = true;
    #[inline(always)]
    fn lanes(&self, first: usize) -> &Lanes {
        group(self.cell, first)
    }
}

/// Numbers that are the same for every cell of a step.
#[derive(Debug, Clone, Copy)]
pub struct CellStep {
    /// Turns a sum of four differences along edges into a mean gradient: `1 / 4h` [1/m].
    gradient: f32,
    /// The same for velocities, times the time step [s/m].
    earlier: f32,
    /// `1 / dt` [1/s].
    per_step: f32,
    /// Area on which the pressure on a corner acts: `h^2 / 4` [m^2].
    area: f32,
}

impl CellStep {
    /// - `pitch` [m], `dt` [s].
    pub fn new(pitch: f64, dt: f64) -> Self {
        Self {
            gradient: (0.25 / pitch) as f32,
            earlier: (0.25 * dt / pitch) as f32,
            per_step: (1.0 / dt) as f32,
            area: (0.25 * pitch * pitch) as f32,
        }
    }
}

/// Buffers between the passes over a block. Holds no state.
#[derive(Debug, Clone)]
pub struct CellPlanes {
    /// Planes of cells below and above a plane of particles, in turn.
    planes: [CellPlane; 2],
    /// Sums over the cells around a plane of particles across x: for each axis of the force, two.
    sums: [[ParticlePlane; 2]; 3],
}

impl CellPlanes {
    /// Empty buffers.
    pub const fn new() -> Self {
        Self { planes: [[[0.0; CELL_PLANE]; 9]; 2], sums: [[[0.0; PARTICLE_PLANE]; 2]; 3] }
    }
}

impl Default for CellPlanes {
    fn default() -> Self {
        Self::new()
    }
}

/// Forces of the volume terms of all cells that touch a block on the block's particles.
///
/// - `displacement` [m], `velocity` [m/s]: x, y, z with halo; velocities are read only with a viscosity.
/// - `modulus` [Pa], `viscosity` [Pa s, never negative]: see [`CellConstant`].
/// - `force` x, y, z [N]: overwritten. Without meaning in slots that hold no particle.
#[inline(always)]
pub fn block_volume_forces<M: CellConstant, V: CellConstant>(
    step: CellStep,
    modulus: M,
    viscosity: V,
    displacement: [&Halo; 3],
    velocity: [&Halo; 3],
    work: &mut CellPlanes,
    force: &mut [[f32; BLOCK_LEN]; 3],
) {
    block_cell_forces(step, (modulus, viscosity, Absent), displacement, velocity, work, force);
}

/// The same with the forces of the cells' fibres: modulus, viscosity and fibres of the cells.
#[inline(always)]
pub fn block_cell_forces<M: CellConstant, V: CellConstant, F: Fibres>(
    step: CellStep,
    of_cells: (M, V, F),
    displacement: [&Halo; 3],
    velocity: [&Halo; 3],
    work: &mut CellPlanes,
    force: &mut [[f32; BLOCK_LEN]; 3],
) {
    let CellPlanes { planes: [even, odd], sums } = work;
    cell_plane(step, &of_cells, displacement, velocity, 0, even);
    for z in 0..BLOCK[2] {
        let (below, above) = if z % 2 == 0 { (&*even, &mut *odd) } else { (&*odd, &mut *even) };
        cell_plane(step, &of_cells, displacement, velocity, z + 1, above);
        particle_plane(below, above, sums, z, force);
    }
}

/// The nine numbers of every cell whose lowest corners lie in one plane of the halo.
#[inline(always)]
fn cell_plane<M: CellConstant, V: CellConstant, F: Fibres>(
    step: CellStep,
    (modulus, viscosity, fibres): &(M, V, F),
    displacement: [&Halo; 3],
    velocity: [&Halo; 3],
    plane: usize,
    out: &mut CellPlane,
) {
    for place in 0..CELL_GROUPS {
        let start = (place * LANES).min(LAST_GROUP);
        let first = plane * HALO_PLANE + start;
        let (modulus, fibres) = (modulus.lanes(first), fibres.lanes(first));
        let slack = !F::PRESENT || fibres.iter().all(|axis| axis.iter().all(|&value| value == 0.0));
        if slack && modulus.iter().all(|&value| value == 0.0) {
            for number in out.iter_mut() {
                *group_mut(number, start) = [0.0; LANES];
            }
            continue;
        }
        let cells = Cells {
            displacement: [
                corner_groups(displacement[0], first),
                corner_groups(displacement[1], first),
                corner_groups(displacement[2], first),
            ],
            velocity: [
                corner_groups(velocity[0], first),
                corner_groups(velocity[1], first),
                corner_groups(velocity[2], first),
            ],
            modulus,
            viscosity: viscosity.lanes(first),
            fibres,
        };
        let numbers = cell_group::<M, V, F>(step, &cells);
        for number in 0..9 {
            *group_mut(&mut out[number], start) = numbers[number];
        }
    }
}

/// What [`LANES`] cells are computed from; corners x fastest.
struct Cells<'a> {
    displacement: [[&'a Lanes; 8]; 3],
    velocity: [[&'a Lanes; 8]; 3],
    modulus: &'a Lanes,
    viscosity: &'a Lanes,
    fibres: [&'a Lanes; 3],
}

#[inline(always)]
fn cell_group<M: CellConstant, V: CellConstant, F: Fibres>(step: CellStep, cells: &Cells<'_>) -> [Lanes; 9] {
    let mut out = [[0.0; LANES]; 9];
    for lane in 0..LANES {
        let [u, v, w] = &cells.displacement;
        let g = [gradient(u, lane, step.gradient), gradient(v, lane, step.gradient), gradient(w, lane, step.gradient)];
        if F::PRESENT {
            let root = [cells.fibres[0][lane], cells.fibres[1][lane], cells.fibres[2][lane]];
            let [x, y, z] = pull(&g, root);
            let along = [step.area * x, step.area * y, step.area * z];
            macro_rules! store { ($($number:literal)*) => { $( out[$number][lane] = along[$number / 3] * root[$number % 3]; )* } }
            store!(0 1 2 3 4 5 6 7 8);
        }
        if !M::PRESENT {
            continue;
        }
        let small = cofactor(&g);
        let trace = g[0][0] + g[1][1] + g[2][2];
        let change = trace + (small[0][0] + small[1][1] + small[2][2]) + contract(&g[0], &small[0]);
        // cof(I + G) = (1 + tr G) I - G^T + cof(G).
        let unit = 1.0 + trace;
        let cof = [
            [unit - g[0][0] + small[0][0], small[0][1] - g[1][0], small[0][2] - g[2][0]],
            [small[1][0] - g[0][1], unit - g[1][1] + small[1][1], small[1][2] - g[2][1]],
            [small[2][0] - g[0][2], small[2][1] - g[1][2], unit - g[2][2] + small[2][2]],
        ];
        let modulus = cells.modulus[lane];
        let bound = 1.0 / (1.0 + change * change);
        let bound = if modulus < 0.0 { bound * bound } else { 1.0 };
        let mut pressure = modulus * (change * bound);
        if V::PRESENT {
            let [u, v, w] = &cells.velocity;
            let a = [gradient(u, lane, step.earlier), gradient(v, lane, step.earlier), gradient(w, lane, step.earlier)];
            let turned = cofactor(&a);
            let linear = contract(&cof[0], &a[0]) + contract(&cof[1], &a[1]) + contract(&cof[2], &a[2]);
            let square = (turned[0][0] + turned[1][1] + turned[2][2])
                + (contract(&g[0], &turned[0]) + contract(&g[1], &turned[1]) + contract(&g[2], &turned[2]));
            let since = linear - square + contract(&a[0], &turned[0]);
            pressure += cells.viscosity[lane] * (since * step.per_step);
        }
        // A cell that is not whole can have a corner anywhere: nothing of what was computed from it may pass.
        let scale = if modulus == 0.0 { 0.0 } else { pressure * step.area };
        macro_rules! store { ($($number:literal)*) => { $( {
            let number = scale * cof[$number / 3][$number % 3];
            out[$number][lane] = if F::PRESENT { out[$number][lane] + number } else { number };
        } )* } }
        store!(0 1 2 3 4 5 6 7 8);
    }
    out
}

/// Forces on a plane of particles from the cells below and above it.
///
/// A particle is the corner on the side + of the cell at its side -, so along each axis the difference of both cells acts
/// on it; across the axis the two on either side add.
#[inline(always)]
fn particle_plane(
    below: &CellPlane,
    above: &CellPlane,
    sums: &mut [[ParticlePlane; 2]; 3],
    z: usize,
    force: &mut [[f32; BLOCK_LEN]; 3],
) {
    // What is left to do along x: `differ` to subtract, `add` to add up. All axes first: rows that were only just
    // stored would have to be waited for.
    for (axis, [differ, add]) in sums.iter_mut().enumerate() {
        // The cells of one number below and above the particles, on their near and far side along y.
        let around = |number: usize| {
            let (low, high) = (&below[3 * axis + number], &above[3 * axis + number]);
            [near_rows(low), near_rows(high), far_rows(low), far_rows(high)]
        };
        let (x, y, z) = (around(0), around(1), around(2));
        for place in 0..PARTICLE_PLANE {
            differ[place] = (x[0][place] + x[1][place]) + (x[2][place] + x[3][place]);
        }
        for place in 0..PARTICLE_PLANE {
            add[place] = ((y[2][place] + y[3][place]) - (y[0][place] + y[1][place]))
                + ((z[1][place] - z[0][place]) + (z[3][place] - z[2][place]));
        }
    }
    for ([differ, add], force) in sums.iter().zip(force) {
        for y in 0..BLOCK[1] {
            let row = y * HALO_ROW;
            let differ: &[f32; HALO_ROW] = differ[row..row + HALO_ROW].try_into().expect("a row's length");
            let add: &[f32; HALO_ROW] = add[row..row + HALO_ROW].try_into().expect("a row's length");
            let start = (z * BLOCK[1] + y) * LANES;
            let out: &mut Lanes = (&mut force[start..start + LANES]).try_into().expect("a row's length");
            for lane in 0..LANES {
                out[lane] = (differ[lane + 1] - differ[lane]) + (add[lane] + add[lane + 1]);
            }
        }
    }
}

#[inline(always)]
fn near_rows(plane: &[f32; CELL_PLANE]) -> &ParticlePlane {
    plane[..PARTICLE_PLANE].try_into().expect("all rows but the last")
}

#[inline(always)]
fn far_rows(plane: &[f32; CELL_PLANE]) -> &ParticlePlane {
    plane[HALO_ROW..].try_into().expect("all rows but the first")
}

/// Derivatives along x, y, z of a field given at a cell's corners: differences first, so that where the cell is as a whole
/// costs no digits.
#[inline(always)]
fn gradient(corner: &[&Lanes; 8], lane: usize, scale: f32) -> [f32; 3] {
    let (a, b, c, d) = (corner[0][lane], corner[1][lane], corner[2][lane], corner[3][lane]);
    let (e, f, g, h) = (corner[4][lane], corner[5][lane], corner[6][lane], corner[7][lane]);
    [
        (((b - a) + (d - c)) + ((f - e) + (h - g))) * scale,
        (((c - a) + (d - b)) + ((g - e) + (h - f))) * scale,
        (((e - a) + (f - b)) + ((g - c) + (h - d))) * scale,
    ]
}

#[inline(always)]
fn cofactor(m: &[[f32; 3]; 3]) -> [[f32; 3]; 3] {
    [cross(&m[1], &m[2]), cross(&m[2], &m[0]), cross(&m[0], &m[1])]
}

#[inline(always)]
fn cross(a: &[f32; 3], b: &[f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
fn contract(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The values at the eight corners (x fastest) of the cells above a group of grid points.
#[inline(always)]
fn corner_groups(halo: &Halo, first: usize) -> [&Lanes; 8] {
    let (y, z) = (first + HALO_ROW, first + HALO_PLANE);
    let yz = y + HALO_PLANE;
    [
        group(halo, first),
        group(halo, first + 1),
        group(halo, y),
        group(halo, y + 1),
        group(halo, z),
        group(halo, z + 1),
        group(halo, yz),
        group(halo, yz + 1),
    ]
}

#[inline(always)]
fn group_mut(plane: &mut [f32; CELL_PLANE], start: usize) -> &mut Lanes {
    (&mut plane[start..start + LANES]).try_into().expect("a group's length")
}

#[inline(always)]
fn group(halo: &Halo, first: usize) -> &Lanes {
    halo[first..first + LANES].try_into().expect("a group's length")
}
