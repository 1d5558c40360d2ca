//! The fast body: one block, every spring of it once.
//!
//! A spring is taken at the end with the smaller x (or y, or z where these are equal): its force is added to that particle's
//! sum and taken from the other's. Of the 26 springs of a particle 13 start there. Rows of sixteen particles are stepped at
//! once, so springs that lead to the next particle along x reach one particle beyond the row; their forces are summed in
//! rows of their own that are shifted by one particle in the end, and what enters the block through its first column is
//! computed apart. Springs through the border of a block are computed in both blocks, from the same numbers in the same
//! order: the two ends feel exactly opposite forces everywhere.

use super::halo::{HALO_ROW, Halo, halo_row};
use super::laws::{DamperConstant, HaloStrides, Living, SpringConstant, Strides, away};
use super::rows::{LANES, row_of_block, row_of_block_mut};
use super::simd::{Vector, fetch};
use super::spring::{Damper, Rest, factor};
use crate::lattice::layout::{BLOCK, BLOCK_LEN};
use crate::lattice::neighbours::{OFFSETS, direction_of, family};

/// What a block is stepped from.
#[derive(Clone, Copy)]
pub struct BlockState<'a> {
    /// The numbers of the step.
    pub step: StepConstants,
    /// Displacement x, y, z with halo [m].
    pub displacement: [&'a Halo; 3],
    /// Velocity x, y, z with halo [m/s]; read only with a damper.
    pub velocity: [&'a Halo; 3],
    /// Forces x, y, z that are known before the springs are summed [N].
    pub known_force: Option<&'a [[f32; BLOCK_LEN]; 3]>,
    /// Time step over mass [s/kg]; 0 for particles that are held and for empty slots.
    pub dt_over_mass: &'a [f32; BLOCK_LEN],
    /// What the next blocks will be stepped from, to be asked for meanwhile.
    pub ahead: &'a [&'a [f32; BLOCK_LEN]],
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

/// Rows of a plane of grid points, halo included.
const PLANE_ROWS: usize = BLOCK[1] + 2;
/// Planes in which forces are being summed: those before and after the present one, and one more to keep the count even.
const PLANES: usize = 4;
/// What stands before the first row, so that it can be read one particle early.
const LEAD: usize = LANES;
/// Values of a ring of planes.
const RING: usize = LEAD + PLANES * PLANE_ROWS * LANES;
/// Grid points of the two columns at the border towards smaller x, each with room for a register beyond its end.
const COLUMN: usize = PLANE_ROWS * (BLOCK[2] + 2) + 2 * LANES;

/// The columns: the one before the block's first, then that.
type Columns<T> = [T; 2 * COLUMN];

struct ColumnStrides;

impl Strides for ColumnStrides {
    const STRIDES: [isize; 3] = [COLUMN as isize, 1, PLANE_ROWS as isize];
}

/// Buffers of [`kick_block`]; nothing in them is kept.
pub struct Work {
    /// Sums of forces on the particles of a row, x, y, z.
    own: [[f32; RING]; 3],
    /// The same on the particles one further along x.
    next: [[f32; RING]; 3],
    /// Forces through the first column.
    entering: [[f32; COLUMN]; 3],
    displacement: [Columns<f32>; 3],
    velocity: [Columns<f32>; 3],
    stiffness: Columns<f32>,
    damping: Columns<f32>,
    words: Columns<u32>,
}

impl Default for Work {
    fn default() -> Self {
        Self {
            own: [[0.0; RING]; 3],
            next: [[0.0; RING]; 3],
            entering: [[0.0; COLUMN]; 3],
            displacement: [[0.0; 2 * COLUMN]; 3],
            velocity: [[0.0; 2 * COLUMN]; 3],
            stiffness: [0.0; 2 * COLUMN],
            damping: [0.0; 2 * COLUMN],
            words: [0; 2 * COLUMN],
        }
    }
}

/// Start of the row at (y, z), each from -1 to the block's size, in a ring.
#[inline(always)]
fn ring_row(y: isize, z: isize) -> usize {
    LEAD + (((z + 1) as usize % PLANES) * PLANE_ROWS + (y + 1) as usize) * LANES
}

/// Calls a macro with every pair of an offset (dy, dz) for which springs start at a particle, and whether one of them leads
/// straight there.
macro_rules! for_rows_ahead {
    ($call:ident) => {
        $call!(-1, -1, false);
        $call!(0, -1, false);
        $call!(1, -1, false);
        $call!(-1, 0, false);
        $call!(0, 0, false);
        $call!(1, 0, true);
        $call!(-1, 1, true);
        $call!(0, 1, true);
        $call!(1, 1, true);
    };
}

/// Advances the velocities of one block by one step of symplectic Euler.
///
/// - `velocity` x, y, z [m/s]: the block's own slots, old on entry, new on return.
/// - Returns the largest squared speed of the block [m^2/s^2], infinite when any velocity is not finite.
#[inline(always)]
pub fn kick_block<V: Vector, const EXACT: bool, K: SpringConstant, C: DamperConstant, A: Living>(
    stiffness: K,
    damping: C,
    alive: A,
    state: BlockState<'_>,
    work: &mut Work,
    mut velocity: [&mut [f32; BLOCK_LEN]; 3],
) -> f32 {
    let step = state.step;
    let springs = Springs::<V, K, C> {
        pitch: V::splat(step.pitch),
        rest: rests(&step),
        dt: V::splat(step.dt),
        stiffness,
        damping,
    };
    let moving = moving_rows(state.dt_over_mass);
    springs.enter::<EXACT, A>(alive, &moving, &state, work);
    let halos = Fields {
        displacement: [state.displacement[0], state.displacement[1], state.displacement[2]],
        velocity: [state.velocity[0], state.velocity[1], state.velocity[2]],
        stiffness: stiffness.values(),
        damping: damping.values(),
        words: alive.words(),
    };
    let mut fastest = Fastest { squared: V::splat(0.0), doubt: V::splat(0.0) };
    open_plane(work, state.known_force, -1);
    for z in -1..=BLOCK[2] as isize {
        open_plane(work, state.known_force, z + 1);
        for y in -1..=BLOCK[1] as isize {
            if z >= 0 && y >= 0 && z < BLOCK[2] as isize && y < BLOCK[1] as isize {
                for values in state.ahead {
                    fetch(&values[..], (z as usize * BLOCK[1] + y as usize) * LANES);
                }
            }
            springs.start_at::<EXACT, A>(&halos, &moving, work, [y, z]);
        }
        if z >= 1 {
            close_plane::<V, EXACT>(&step, state.dt_over_mass, work, &moving, z - 1, &mut velocity, &mut fastest);
        }
    }
    fastest.squared()
}

/// Which rows, halo included, have a particle that moves.
type Moving = [[bool; PLANE_ROWS]; BLOCK[2] + 2];

#[inline(always)]
fn moving_rows(dt_over_mass: &[f32; BLOCK_LEN]) -> Moving {
    let mut moving = [[false; PLANE_ROWS]; BLOCK[2] + 2];
    for z in 0..BLOCK[2] {
        for y in 0..BLOCK[1] {
            moving[z + 1][y + 1] = row_of_block(dt_over_mass, y, z).iter().any(|&w| w != 0.0);
        }
    }
    moving
}

#[inline(always)]
fn rests<V: Vector>(step: &StepConstants) -> [Rest<V>; 3] {
    let (zero, pitch) = (V::splat(0.0), V::splat(step.pitch));
    [
        Rest::new([pitch, zero, zero], step.rest_length[0]),
        Rest::new([pitch, pitch, zero], step.rest_length[1]),
        Rest::new([pitch, pitch, pitch], step.rest_length[2]),
    ]
}

/// Begins the sums of a plane with the forces that are known.
#[inline(always)]
fn open_plane(work: &mut Work, known: Option<&[[f32; BLOCK_LEN]; 3]>, z: isize) {
    if z > BLOCK[2] as isize {
        return;
    }
    let start = ring_row(-1, z);
    for axis in 0..3 {
        for sums in [&mut work.own[axis], &mut work.next[axis]] {
            *sums[start..].first_chunk_mut().expect("a plane of the ring") = [0.0; PLANE_ROWS * LANES];
        }
        if let Some(known) = known
            && (0..BLOCK[2] as isize).contains(&z)
        {
            for y in 0..BLOCK[1] {
                let row = ring_row(y as isize, z);
                work.own[axis][row..row + LANES].copy_from_slice(row_of_block(&known[axis], y, z as usize));
            }
        }
    }
}

/// Velocities from the sums of a plane that are complete.
#[inline(always)]
fn close_plane<V: Vector, const EXACT: bool>(
    step: &StepConstants,
    dt_over_mass: &[f32; BLOCK_LEN],
    work: &mut Work,
    moving: &Moving,
    z: isize,
    velocity: &mut [&mut [f32; BLOCK_LEN]; 3],
    fastest: &mut Fastest<V>,
) {
    // What was summed for the particle after a row's last belongs to the next block: its place is taken by what enters
    // before the first particle of the row after.
    for axis in 0..3 {
        for y in 0..BLOCK[1] {
            work.next[axis][ring_row(y as isize, z) - 1] = work.entering[axis][(z + 1) as usize * PLANE_ROWS + y + 1];
        }
    }
    for y in 0..BLOCK[1] {
        if !moving[(z + 1) as usize][y + 1] {
            continue;
        }
        let weights = row_of_block(dt_over_mass, y, z as usize);
        let row = ring_row(y as isize, z);
        for at in (0..LANES).step_by(V::LANES) {
            let weight = V::load(weights, at);
            let mut squared = V::splat(0.0);
            for axis in 0..3 {
                let force = V::load(&work.own[axis], row + at) + V::load(&work.next[axis], row + at - 1);
                let own = row_of_block_mut(velocity[axis], y, z as usize);
                let old = V::load(own, at);
                let pull = V::splat(step.gravity_dt[axis]).where_positive(weight);
                let new = if EXACT { old + (force * weight + pull) } else { force.mul_add(weight, old + pull) };
                new.store(own, at);
                squared = if EXACT { squared + new * new } else { new.mul_add(new, squared) };
            }
            fastest.see(squared);
        }
    }
}

/// The largest squared speed so far.
struct Fastest<V> {
    squared: V,
    /// 0, or not a number once a speed was not finite: [`Vector::max`] would forget it.
    doubt: V,
}

impl<V: Vector> Fastest<V> {
    #[inline(always)]
    fn see(&mut self, squared: V) {
        self.doubt = squared.mul_add(V::splat(0.0), self.doubt);
        self.squared = squared.max(self.squared);
    }

    #[inline(always)]
    fn squared(self) -> f32 {
        let [mut squared, mut doubt] = [[0.0; LANES]; 2];
        self.squared.store(&mut squared, 0);
        self.doubt.store(&mut doubt, 0);
        if doubt.iter().all(|&doubt| doubt == 0.0) { squared.into_iter().fold(0.0, f32::max) } else { f32::INFINITY }
    }
}

/// Where springs are computed from: halos, or columns.
#[derive(Clone, Copy)]
struct Fields<'a> {
    displacement: [&'a [f32]; 3],
    velocity: [&'a [f32]; 3],
    stiffness: &'a [f32],
    damping: &'a [f32],
    words: &'a [u32],
}

/// The laws of a block, and what is the same for all its springs.
struct Springs<V, K, C> {
    pitch: V,
    rest: [Rest<V>; 3],
    dt: V,
    stiffness: K,
    damping: C,
}

/// The values around a particle, three at a time.
#[inline(always)]
fn load<V: Vector>(field: &[&[f32]; 3], place: usize) -> [V; 3] {
    [V::load(field[0], place), V::load(field[1], place), V::load(field[2], place)]
}

impl<V: Vector, K: SpringConstant, C: DamperConstant> Springs<V, K, C> {
    /// The springs of a row, in the block or beside it, that start at its particles.
    #[inline(always)]
    fn start_at<const EXACT: bool, A: Living>(
        &self,
        fields: &Fields<'_>,
        moving: &Moving,
        work: &mut Work,
        [y, z]: [isize; 2],
    ) {
        let moves = |y: isize, z: isize| {
            moving.get((z + 1) as usize).and_then(|rows| rows.get((y + 1) as usize)).is_some_and(|&moves| moves)
        };
        let here = moves(y, z);
        if !here && !(-1..=1).any(|dz| (-1..=1).any(|dy| moves(y + dy, z + dz))) {
            return;
        }
        for at in (0..LANES).step_by(V::LANES) {
            let base = halo_row(y, z) + 1 + at;
            let own = load::<V>(&fields.displacement, base);
            let own_velocity = if C::PRESENT { load::<V>(&fields.velocity, base) } else { own };
            let mut sum = [V::splat(0.0); 3];
            macro_rules! ahead {
                ($dy:literal, $dz:literal, $straight:literal) => {
                    if here || moves(y + $dy, z + $dz) {
                        let far = ring_row(y + $dy, z + $dz) + at;
                        const ONWARD: usize = direction_of([1, $dy, $dz]);
                        let force =
                            self.force::<EXACT, HaloStrides, A, ONWARD>(fields, base, own, own_velocity, &mut sum);
                        take::<V, EXACT>(&mut work.next, far, force);
                        if $straight {
                            const STRAIGHT: usize = direction_of(if $straight { [0, $dy, $dz] } else { [0, 0, 1] });
                            let force = self.force::<EXACT, HaloStrides, A, STRAIGHT>(
                                fields,
                                base,
                                own,
                                own_velocity,
                                &mut sum,
                            );
                            take::<V, EXACT>(&mut work.own, far, force);
                        }
                    }
                };
            }
            for_rows_ahead!(ahead);
            if here {
                let row = ring_row(y, z) + at;
                for axis in 0..3 {
                    (V::load(&work.own[axis], row) + sum[axis]).store(&mut work.own[axis], row);
                }
            }
        }
    }

    /// The springs that lead into the first column of the block from the one before.
    #[inline(always)]
    fn enter<const EXACT: bool, A: Living>(&self, alive: A, moving: &Moving, state: &BlockState<'_>, work: &mut Work) {
        for axis in 0..3 {
            columns(&state.displacement[axis][..], &mut work.displacement[axis]);
            if C::PRESENT {
                columns(&state.velocity[axis][..], &mut work.velocity[axis]);
            }
        }
        columns(self.stiffness.values(), &mut work.stiffness);
        columns(self.damping.values(), &mut work.damping);
        columns(alive.words(), &mut work.words);
        let Work { entering, displacement, velocity, stiffness, damping, words, .. } = work;
        let fields = Fields {
            displacement: [&displacement[0], &displacement[1], &displacement[2]],
            velocity: [&velocity[0], &velocity[1], &velocity[2]],
            stiffness,
            damping,
            words,
        };
        // From the first grid point inside the halo to the last; lanes on its border are never read.
        let (first, last) = (PLANE_ROWS + 1, PLANE_ROWS * (BLOCK[2] + 1) - 1);
        let moving = moving.as_flattened();
        for target in (first..last).step_by(V::LANES) {
            if !moving[target..moving.len().min(target + V::LANES)].iter().any(|&moves| moves) {
                continue;
            }
            let mut sum = [V::splat(0.0); 3];
            macro_rules! ahead {
                ($dy:literal, $dz:literal, $straight:literal) => {{
                    const ONWARD: usize = direction_of([1, $dy, $dz]);
                    let base = target.wrapping_add_signed(const { -away::<ColumnStrides>([0, $dy, $dz]) });
                    let own = load::<V>(&fields.displacement, base);
                    let own_velocity = if C::PRESENT { load::<V>(&fields.velocity, base) } else { own };
                    let mut other = [V::splat(0.0); 3];
                    let force =
                        self.force::<EXACT, ColumnStrides, A, ONWARD>(&fields, base, own, own_velocity, &mut other);
                    for axis in 0..3 {
                        sum[axis] = less::<V, EXACT>(sum[axis], force, axis);
                    }
                }};
            }
            for_rows_ahead!(ahead);
            for axis in 0..3 {
                sum[axis].store(&mut entering[axis], target);
            }
        }
    }

    /// The force of the spring in direction `D` from the particle at `base`, as a factor and a vector; added to `sum`.
    #[inline(always)]
    fn force<const EXACT: bool, S: Strides, A: Living, const D: usize>(
        &self,
        fields: &Fields<'_>,
        base: usize,
        own: [V; 3],
        own_velocity: [V; 3],
        sum: &mut [V; 3],
    ) -> Force<V> {
        let far = base.wrapping_add_signed(const { away::<S>(OFFSETS[D]) });
        let there = load::<V>(&fields.displacement, far);
        let mut d = own;
        for axis in 0..3 {
            d[axis] = there[axis] - own[axis];
            match const { OFFSETS[D] }[axis] {
                0 => {}
                1 => d[axis] = d[axis] + self.pitch,
                _ => d[axis] = d[axis] - self.pitch,
            }
        }
        let stiffness = self.stiffness.lanes::<V, S, D>(fields.stiffness, base);
        let damper = if C::PRESENT {
            let there = load::<V>(&fields.velocity, far);
            let w = [there[0] - own_velocity[0], there[1] - own_velocity[1], there[2] - own_velocity[2]];
            let constant = self.damping.beside::<V, S, D>(stiffness, fields.damping, base);
            Some(Damper { constant, w, dt: self.dt })
        } else {
            None
        };
        let keep = |factor| A::keep::<V, D>(fields.words, base, factor);
        let factor = factor::<V, EXACT>(d, stiffness, self.rest[const { family(D) } - 1], damper, keep);
        for axis in 0..3 {
            sum[axis] = if EXACT { sum[axis] + factor * d[axis] } else { factor.mul_add(d[axis], sum[axis]) };
        }
        Force { factor, d }
    }
}

/// A force along a spring.
#[derive(Clone, Copy)]
struct Force<V> {
    factor: V,
    d: [V; 3],
}

#[inline(always)]
fn less<V: Vector, const EXACT: bool>(sum: V, force: Force<V>, axis: usize) -> V {
    if EXACT { sum - force.factor * force.d[axis] } else { force.factor.negative_mul_add(force.d[axis], sum) }
}

/// Takes a force from the sums of a row.
#[inline(always)]
fn take<V: Vector, const EXACT: bool>(sums: &mut [[f32; RING]; 3], row: usize, force: Force<V>) {
    for axis in 0..3 {
        less::<V, EXACT>(V::load(&sums[axis], row), force, axis).store(&mut sums[axis], row);
    }
}

/// Copies the two columns out of a halo; nothing where there is none.
#[inline(always)]
fn columns<T: Copy>(halo: &[T], columns: &mut Columns<T>) {
    for (place, row) in halo.as_chunks::<HALO_ROW>().0.iter().enumerate() {
        columns[place] = row[0];
        columns[COLUMN + place] = row[1];
    }
}
