//! The lowest point of the energy of a step: Newton's iteration with conjugate gradients, for the implicit methods.
//!
//! An implicit step looks for the free places at which
//!
//! ```text
//! Phi(u) = E(u) + 1/2 s sum m |u - w|^2 - sum (f + m g).u
//! ```
//!
//! is least: `E` the elastic energy and what dampers take in the step, `s = 1 / dt^2` and `w` where inertia alone would lead (`s = 0`
//! for a settled shape), `f` the loads. Each iteration takes the tangent `H` of the energy, solves `H p = -dPhi/du` by conjugate
//! gradients, preconditioned by the 3 x 3 blocks of the diagonal and as exactly as pays, and goes along `p` until `Phi` has come down
//! enough. The first [`GENTLE`] iterations, and those after one that was shortened, take the tangent that is never negative (see
//! [`crate::kernel::precise`]), which leads down by much from any shape: random places, a block pressed flat. Where springs are pressed in
//! the shape that is looked for it gains little by little in the end; so from then on the tangent is exact, and
//! conjugate gradients stop where they meet negative curvature. Their direction leads down all the same.
//!
//! For a settled shape there is no inertia to say where a piece goes that its springs leave free; there, and after steps that
//! had to be shortened a lot, a share of the diagonal is added to `H` (Levenberg's and Marquardt's damping), less and less as steps are taken
//! whole. It changes the way to the lowest point, not the point.
//!
//! It ends when the step `p` that Newton's equation asks for is shorter than the tolerance everywhere, and takes it. Near the
//! end `Phi` changes by less than its rounding; then the slope decides instead, as Hager and Zhang do.
//!
//! All sums are taken block by block and then in order: the same bits at any number of threads.
//!
//! Source: J. Nocedal and S. J. Wright, "Numerical Optimization", 2006, algorithm 7.1; W. W. Hager and H. Zhang, "A new conjugate
//! gradient method with guaranteed descent and an efficient line search", 2005, for the last digits.

use rayon::prelude::*;
use rayon::slice::ChunksMut;

use super::field::{Field, add, combine, fit, largest, product};
use super::precise_lattice::PreciseLattice;
use crate::lattice::layout::BLOCK_LEN;

/// Iterations with the tangent that is never negative.
const GENTLE: u32 = 4;
/// Newton iterations of a step.
const MOST_ITERATIONS: u32 = 80;
/// Conjugate gradients of an iteration.
const MOST_GRADIENTS: u32 = 2000;
/// Damping of the iterations, as a share of the trace of the diagonal blocks: that of a settled shape's first, and after a step
/// that was shortened a lot.
const FIRST_DAMPING: f64 = 1e-3;
/// It does not grow beyond this.
const MOST_DAMPING: f64 = 1.0;
/// No step is the last with more: it would be shorter than Newton's. What resists less than this share of a particle's own stiffness
/// may be left where it is.
const MOST_AT_THE_END: f64 = 1e-5;
/// What remains for a settled shape.
const LEAST_DAMPING: f64 = 1e-8;
/// A step must bring `Phi` down by this share of what its slope promises.
const ENOUGH: f64 = 1e-4;
/// How often a step is shortened.
const MOST_HALVINGS: u32 = 50;
/// Relative rounding of `Phi`.
const ROUNDING: f64 = 1e-12;

/// What a step asks for.
#[derive(Clone, Copy)]
pub(super) struct Wanted<'a> {
    /// Where it begins [m].
    pub(super) before: &'a Field<f64>,
    /// Where inertia alone would lead [m].
    pub(super) inertial: &'a Field<f64>,
    /// `s` [1/s^2].
    pub(super) inertia: f64,
    /// [s]; infinite for a settled shape.
    pub(super) dt: f64,
    /// What is prescribed moves by this in the step [m].
    pub(super) shift: Option<&'a Field<f64>>,
    /// [m]
    pub(super) tolerance: f64,
}

/// `Phi`, and the size of the numbers it is the sum of [J].
#[derive(Debug, Clone, Copy)]
struct Value {
    phi: f64,
    scale: f64,
}

/// How conjugate gradients ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Outcome {
    /// As exact as they were asked to be.
    Solved,
    /// They met negative curvature.
    BendsDown,
    /// They were not done within [`MOST_GRADIENTS`].
    OutOfTime,
}

/// What it took.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Effort {
    /// Newton iterations.
    pub iterations: u64,
    /// Products of the tangent and a vector.
    pub products: u64,
    /// Evaluations of the forces.
    pub evaluations: u64,
    /// Parts that were taken: one for each step that was not divided. Settled shapes have none.
    pub parts: u64,
}

/// The iteration did not end.
#[derive(Debug, Clone, Copy)]
pub(super) struct Unsettled {
    /// Longest step that was still asked for [m], and the slot.
    pub(super) step: f64,
    pub(super) slot: usize,
    pub(super) iterations: u32,
}

/// Buffers of the solver, and what it took so far.
#[derive(Debug, Clone, Default)]
pub(super) struct Newton {
    gradient: Field<f64>,
    direction: Field<f64>,
    residual: Field<f64>,
    search: Field<f64>,
    scaled: Field<f64>,
    tangent: Field<f64>,
    trial: Field<f64>,
    /// Stays 0.
    zero: Field<f64>,
    /// Inverse diagonal blocks: xx, yy, zz, yz, xz, xy [m/N]. Shape `[slots]`.
    inverse: Vec<[f64; 6]>,
    /// Inertia and damping [N/m]; negative where nothing is free.
    weight: Vec<f64>,
    pub(super) effort: Effort,
}

impl Newton {
    /// Moves `place` from where the step begins to the lowest point.
    pub(super) fn settle(
        &mut self,
        lattice: &mut PreciseLattice,
        place: &mut Field<f64>,
        wanted: Wanted<'_>,
    ) -> Result<(), Unsettled> {
        let slots = lattice.slots();
        let Self { gradient, direction, residual, search, scaled, tangent, trial, zero, .. } = &mut *self;
        for buffer in [gradient, direction, residual, search, scaled, tangent, trial, zero] {
            fit(buffer, slots);
        }
        let mut value = self.value(lattice, place, wanted);
        if let Some(shift) = wanted.shift {
            value = self.follow(lattice, place, shift, wanted);
        }
        let first = self.remaining().max(f64::MIN_POSITIVE);
        let mut length = f64::INFINITY;
        let mut trusted = true;
        // What floats or hangs by a thread is not told where to go by its springs: that is for the damping.
        let mut least = if wanted.inertia > 0.0 { 0.0 } else { LEAST_DAMPING };
        let mut damping = if wanted.inertia > 0.0 { 0.0 } else { FIRST_DAMPING };
        for iteration in 0..MOST_ITERATIONS {
            self.effort.iterations += 1;
            let exact = iteration >= GENTLE && trusted;
            lattice.take_tangent(place, wanted.before, wanted.dt, exact);
            self.invert(lattice, wanted.inertia, damping);
            // As exact as it pays: more so as the iteration comes closer.
            let share = (self.remaining() / first).sqrt().clamp(1e-4, 0.1);
            combine(&mut self.residual, &self.zero, [(-1.0, &self.gradient)]);
            let outcome = self.solve(lattice, share);
            let solved = outcome == Outcome::Solved;
            if outcome == Outcome::OutOfTime {
                // Too soft somewhere to be told: that is left to more damping from now on.
                least = (10.0 * least).clamp(LEAST_DAMPING, MOST_AT_THE_END);
                damping = damping.max(least);
            }
            length = largest([(1.0, &self.direction)]);
            if solved && length <= wanted.tolerance && damping <= MOST_AT_THE_END {
                add(place, [(1.0, &self.direction)]);
                return Ok(());
            }
            let slope = product(&self.gradient, &self.direction);
            if !slope.is_finite() {
                break;
            }
            // Nothing is left that `Phi` could tell.
            if solved && slope.abs() <= ROUNDING * value.scale * 1e-2 {
                return Ok(());
            }
            let Some((next, factor)) = self.search_along(lattice, place, value, slope, wanted) else {
                if exact {
                    trusted = false;
                    value = self.value(lattice, place, wanted);
                    continue;
                }
                break;
            };
            trusted = solved && factor == 1.0;
            if factor == 1.0 {
                damping = (0.1 * damping).max(least);
            } else if factor < 0.2 {
                damping = (10.0 * damping).clamp(FIRST_DAMPING, MOST_DAMPING);
            }
            value = next;
        }
        let squared = |slot: usize| (0..3).map(|axis| self.direction[axis][slot].powi(2)).sum::<f64>();
        let slot = (0..slots).max_by(|&a, &b| squared(a).total_cmp(&squared(b))).unwrap_or(0);
        Err(Unsettled { step: length, slot, iterations: MOST_ITERATIONS })
    }

    /// Goes along the direction until `Phi` has come down enough, and by which share; `None` where it does not.
    fn search_along(
        &mut self,
        lattice: &mut PreciseLattice,
        place: &mut Field<f64>,
        value: Value,
        slope: f64,
        wanted: Wanted<'_>,
    ) -> Option<(Value, f64)> {
        let mut trial = std::mem::take(&mut self.trial);
        let mut factor = 1.0;
        let mut found = None;
        for _ in 0..MOST_HALVINGS {
            combine(&mut trial, place, [(factor, &self.direction)]);
            let next = self.value(lattice, &trial, wanted);
            let enough = next.phi <= value.phi + ENOUGH * factor * slope;
            let flat = || product(&self.gradient, &self.direction).abs() <= 0.9 * slope.abs();
            if enough || ((next.phi - value.phi).abs() <= ROUNDING * value.scale && flat()) {
                std::mem::swap(place, &mut trial);
                found = Some((next, factor));
                break;
            }
            factor *= 0.5;
        }
        self.trial = trial;
        found
    }

    /// Moves what is prescribed, and the rest with it as far as one linear step can tell; leaves the better of that, of the rest
    /// staying and of it going on by inertia.
    fn follow(
        &mut self,
        lattice: &mut PreciseLattice,
        place: &mut Field<f64>,
        shift: &Field<f64>,
        wanted: Wanted<'_>,
    ) -> Value {
        lattice.take_tangent(place, wanted.before, wanted.dt, false);
        self.invert(lattice, wanted.inertia, FIRST_DAMPING);
        lattice.apply(shift, &mut self.tangent);
        combine(&mut self.residual, &self.zero, [(-1.0, &self.gradient), (-1.0, &self.tangent)]);
        mask(lattice, &mut self.residual);
        self.solve(lattice, 0.05);
        add(place, [(1.0, shift)]);
        let mut best = self.value(lattice, place, wanted);
        let mut trial = std::mem::take(&mut self.trial);
        combine(&mut trial, place, [(1.0, &self.direction)]);
        let next = self.value(lattice, &trial, wanted);
        if next.phi < best.phi {
            std::mem::swap(place, &mut trial);
            best = next;
        } else {
            // The gradient belongs to the best.
            best = self.value(lattice, place, wanted);
        }
        self.trial = trial;
        best
    }

    /// `Phi` of some places, and its gradient where particles are free.
    fn value(&mut self, lattice: &mut PreciseLattice, place: &Field<f64>, wanted: Wanted<'_>) -> Value {
        self.effort.evaluations += 1;
        let energy = lattice.forces_over(place, wanted.before, wanted.dt, &mut self.gradient);
        let (gravity, inertia) = (lattice.gravity(), wanted.inertia);
        let mut value = Value { phi: energy, scale: energy.abs() };
        for axis in 0..3 {
            let blocks = self.gradient[axis].par_chunks_mut(BLOCK_LEN).enumerate();
            let parts: Vec<[f64; 2]> = blocks
                .map(|(block, gradient)| {
                    let slots = block * BLOCK_LEN..(block + 1) * BLOCK_LEN;
                    let (place, inertial) = (&place[axis][slots.clone()], &wanted.inertial[axis][slots.clone()]);
                    let (mass, free) = (&lattice.mass()[slots.clone()], &lattice.free()[slots.clone()]);
                    let load = &lattice.load[axis][slots];
                    let (mut phi, mut scale) = (0.0, 0.0);
                    for own in 0..gradient.len() {
                        if free[own] == 0.0 {
                            gradient[own] = 0.0;
                            continue;
                        }
                        let away = place[own] - inertial[own];
                        let weight = load[own] + mass[own] * gravity[axis];
                        let (kinetic, work) = (0.5 * inertia * mass[own] * away * away, weight * place[own]);
                        gradient[own] = inertia * mass[own] * away - gradient[own] - weight;
                        phi += kinetic - work;
                        scale += kinetic + work.abs();
                    }
                    [phi, scale]
                })
                .collect();
            for [phi, scale] in parts {
                value.phi += phi;
                value.scale += scale;
            }
        }
        if !value.phi.is_finite() {
            value.phi = f64::INFINITY;
        }
        value
    }

    /// Size of the gradient [N].
    fn remaining(&self) -> f64 {
        product(&self.gradient, &self.gradient).sqrt()
    }

    /// Adds inertia and damping to the diagonal blocks of the tangent, and inverts them.
    fn invert(&mut self, lattice: &PreciseLattice, inertia: f64, damping: f64) {
        self.inverse.resize(lattice.slots(), [0.0; 6]);
        self.weight.resize(lattice.slots(), 0.0);
        let (diagonal, mass, free) = (lattice.diagonal(), lattice.mass(), lattice.free());
        let both = self.inverse.par_iter_mut().zip(&mut self.weight).enumerate();
        both.with_min_len(BLOCK_LEN).for_each(|(slot, (inverse, weight))| {
            let [mut xx, mut yy, mut zz, yz, xz, xy] = diagonal.each_ref().map(|entry| entry[slot]);
            let trace = xx + yy + zz;
            *weight = if free[slot] > 0.0 { inertia * mass[slot] + damping * trace } else { -1.0 };
            // A chain of springs resists in one direction only.
            let all = inertia * mass[slot] + damping * trace + 1e-9 * trace;
            (xx, yy, zz) = (xx + all, yy + all, zz + all);
            let minors = [
                yy * zz - yz * yz,
                xx * zz - xz * xz,
                xx * yy - xy * xy,
                xy * xz - xx * yz,
                xy * yz - yy * xz,
                xz * yz - zz * xy,
            ];
            let determinant = xx * minors[0] + xy * minors[5] + xz * minors[4];
            let regular = free[slot] > 0.0 && determinant > 0.0;
            *inverse = if regular { minors.map(|minor| minor / determinant) } else { [0.0; 6] };
        });
    }

    /// Preconditioned conjugate gradients from zero: `direction` such that tangent and inertia turn it into `residual`, but for a
    /// share of what the preconditioner makes of that.
    fn solve(&mut self, lattice: &mut PreciseLattice, share: f64) -> Outcome {
        let Self { direction, residual, search, scaled, tangent, inverse, weight, effort, .. } = self;
        precondition(inverse, residual, search);
        direction.iter_mut().for_each(|axis| axis.par_chunks_mut(BLOCK_LEN).for_each(|own| own.fill(0.0)));
        let mut size = product(residual, search);
        let enough = share * share * size;
        for round in 0..MOST_GRADIENTS {
            if size <= enough {
                return Outcome::Solved;
            }
            effort.products += 1;
            lattice.apply(search, tangent);
            let curvature = add_weight(weight, search, tangent);
            if curvature <= 0.0 || !curvature.is_finite() {
                if round == 0 {
                    add(direction, [(1.0, &*search)]);
                }
                return Outcome::BendsDown;
            }
            let next = advance(inverse, size / curvature, [search, tangent], [direction, residual, scaled]);
            let turned = next / size;
            let [x, y, z] = chunks(search);
            (x, y, z).into_par_iter().enumerate().for_each(|(block, (x, y, z))| {
                for (axis, search) in [x, y, z].into_iter().enumerate() {
                    let scaled = &scaled[axis][block * BLOCK_LEN..(block + 1) * BLOCK_LEN];
                    search.iter_mut().zip(scaled).for_each(|(search, scaled)| *search = scaled + turned * *search);
                }
            });
            size = next;
        }
        Outcome::OutOfTime
    }
}

/// A field block by block.
fn chunks(field: &mut Field<f64>) -> [ChunksMut<'_, f64>; 3] {
    field.each_mut().map(|axis| axis.par_chunks_mut(BLOCK_LEN))
}

/// A step of conjugate gradients: direction and residual go on, and what the preconditioner makes of the residual is written; returns the
/// product of the two.
fn advance(
    inverse: &[[f64; 6]],
    factor: f64,
    [search, tangent]: [&Field<f64>; 2],
    [direction, residual, scaled]: [&mut Field<f64>; 3],
) -> f64 {
    let ([px, py, pz], [rx, ry, rz], [zx, zy, zz]) = (chunks(direction), chunks(residual), chunks(scaled));
    let blocks = ((px, py, pz), (rx, ry, rz), (zx, zy, zz)).into_par_iter().enumerate();
    let parts: Vec<f64> = blocks
        .map(|(block, ((px, py, pz), (rx, ry, rz), (zx, zy, zz)))| {
            let (direction, residual, scaled) = ([px, py, pz], [rx, ry, rz], [zx, zy, zz]);
            let slots = block * BLOCK_LEN..(block + 1) * BLOCK_LEN;
            for axis in 0..3 {
                let (search, tangent) = (&search[axis][slots.clone()], &tangent[axis][slots.clone()]);
                for own in 0..BLOCK_LEN {
                    direction[axis][own] += factor * search[own];
                    residual[axis][own] -= factor * tangent[own];
                }
            }
            let mut sum = 0.0;
            for (own, inverse) in inverse[slots].iter().enumerate() {
                let r = [residual[0][own], residual[1][own], residual[2][own]];
                let z = times(inverse, r);
                for axis in 0..3 {
                    scaled[axis][own] = z[axis];
                    sum += r[axis] * z[axis];
                }
            }
            sum
        })
        .collect();
    parts.into_iter().sum()
}

/// Adds a weight times a vector, and sets to 0 what has none because it is not free; returns the product of the vector and the outcome.
fn add_weight(weight: &[f64], vector: &Field<f64>, out: &mut Field<f64>) -> f64 {
    let [x, y, z] = chunks(out);
    let parts: Vec<f64> = (x, y, z)
        .into_par_iter()
        .enumerate()
        .map(|(block, (x, y, z))| {
            let slots = block * BLOCK_LEN..(block + 1) * BLOCK_LEN;
            let weight = &weight[slots.clone()];
            let mut sum = 0.0;
            for (axis, out) in [x, y, z].into_iter().enumerate() {
                let vector = &vector[axis][slots.clone()];
                for own in 0..BLOCK_LEN {
                    out[own] = if weight[own] >= 0.0 { out[own] + weight[own] * vector[own] } else { 0.0 };
                    sum += out[own] * vector[own];
                }
            }
            sum
        })
        .collect();
    parts.into_iter().sum()
}

/// A symmetric block, xx, yy, zz, yz, xz, xy, times a vector.
fn times([xx, yy, zz, yz, xz, xy]: &[f64; 6], [a, b, c]: [f64; 3]) -> [f64; 3] {
    [xx * a + xy * b + xz * c, xy * a + yy * b + yz * c, xz * a + yz * b + zz * c]
}

/// Sets to 0 what is not free.
fn mask(lattice: &PreciseLattice, field: &mut Field<f64>) {
    for axis in field {
        let both = axis.par_iter_mut().zip(lattice.free()).with_min_len(BLOCK_LEN);
        both.for_each(|(value, free)| *value = if *free > 0.0 { *value } else { 0.0 });
    }
}

/// Inverse diagonal blocks times a vector.
fn precondition(inverse: &[[f64; 6]], vector: &Field<f64>, out: &mut Field<f64>) {
    let [x, y, z] = chunks(out);
    (x, y, z).into_par_iter().enumerate().for_each(|(block, (x, y, z))| {
        for own in 0..BLOCK_LEN {
            let slot = block * BLOCK_LEN + own;
            [x[own], y[own], z[own]] = times(&inverse[slot], [vector[0][slot], vector[1][slot], vector[2][slot]]);
        }
    });
}
