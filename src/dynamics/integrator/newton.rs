//! The lowest point of the energy of a step: Newton's iteration with conjugate gradients, for the implicit methods.
//!
//! An implicit step looks for the free places at which
//!
//! ```text
//! Phi(u) = E(u) + 1/2 s sum m |u - w|^2 - sum (f + m g).u
//! ```
//!
//! is least: `E` the elastic energy and what dampers take in the step, `s = 1 / dt^2` and `w` where inertia alone would lead (`s = 0`
//! for a settled shape), `f` the loads. Each iteration takes the tangent `H` of the energy (never negative, see
//! [`crate::kernel::precise`]), solves `H p = -dPhi/du` by conjugate gradients, preconditioned by the 3 x 3 blocks of the
//! diagonal and as exactly as pays, and goes along `p` until `Phi` has come down enough. Because `H` is never negative `p` always leads down, so it
//! converges from any shape: random places, a block pressed flat.
//!
//! It ends when the step `p` that Newton's equation asks for is shorter than the tolerance everywhere, and takes it. Near the
//! end `Phi` changes by less than its rounding; then the slope decides instead, as Hager and Zhang do.
//!
//! All sums are taken block by block and then in order: the same bits at any number of threads.
//!
//! Source: J. Nocedal and S. J. Wright, "Numerical Optimization", 2006, algorithm 7.1; W. W. Hager and H. Zhang, "A new conjugate
//! gradient method with guaranteed descent and an efficient line search", 2005, for the last digits.

use rayon::prelude::*;

use super::field::{Field, add, combine, fit, largest, product};
use super::precise_lattice::PreciseLattice;
use crate::lattice::layout::BLOCK_LEN;

/// Newton iterations of a step.
const MOST_ITERATIONS: u32 = 300;
/// Conjugate gradients of an iteration.
const MOST_GRADIENTS: u32 = 5000;
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

/// What it took.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Effort {
    /// Newton iterations.
    pub iterations: u64,
    /// Products of the tangent and a vector.
    pub products: u64,
    /// Evaluations of the forces.
    pub evaluations: u64,
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
        for _ in 0..MOST_ITERATIONS {
            self.effort.iterations += 1;
            lattice.take_tangent(place, wanted.before, wanted.dt);
            self.invert(lattice, wanted.inertia);
            // As exact as it pays: more so as the iteration comes closer.
            let share = (self.remaining() / first).sqrt().clamp(1e-4, 0.1);
            combine(&mut self.residual, &self.zero, [(-1.0, &self.gradient)]);
            self.solve(lattice, wanted.inertia, share);
            length = largest([(1.0, &self.direction)]);
            if length <= wanted.tolerance {
                add(place, [(1.0, &self.direction)]);
                return Ok(());
            }
            let slope = product(&self.gradient, &self.direction);
            if !slope.is_finite() {
                break;
            }
            // Nothing is left that `Phi` could tell.
            if slope.abs() <= ROUNDING * value.scale * 1e-2 {
                return Ok(());
            }
            let Some(next) = self.search_along(lattice, place, value, slope, wanted) else { break };
            value = next;
        }
        let squared = |slot: usize| (0..3).map(|axis| self.direction[axis][slot].powi(2)).sum::<f64>();
        let slot = (0..slots).max_by(|&a, &b| squared(a).total_cmp(&squared(b))).unwrap_or(0);
        Err(Unsettled { step: length, slot, iterations: MOST_ITERATIONS })
    }

    /// Goes along the direction until `Phi` has come down enough; `None` where it does not.
    fn search_along(
        &mut self,
        lattice: &mut PreciseLattice,
        place: &mut Field<f64>,
        value: Value,
        slope: f64,
        wanted: Wanted<'_>,
    ) -> Option<Value> {
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
                found = Some(next);
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
        lattice.take_tangent(place, wanted.before, wanted.dt);
        self.invert(lattice, wanted.inertia);
        lattice.apply(shift, &mut self.tangent);
        combine(&mut self.residual, &self.zero, [(-1.0, &self.gradient), (-1.0, &self.tangent)]);
        mask(lattice, &mut self.residual);
        self.solve(lattice, wanted.inertia, 0.05);
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

    /// Inverts the diagonal blocks of tangent and inertia.
    fn invert(&mut self, lattice: &PreciseLattice, inertia: f64) {
        self.inverse.resize(lattice.slots(), [0.0; 6]);
        let (diagonal, mass, free) = (lattice.diagonal(), lattice.mass(), lattice.free());
        self.inverse.par_iter_mut().enumerate().with_min_len(BLOCK_LEN).for_each(|(slot, inverse)| {
            let [mut xx, mut yy, mut zz, yz, xz, xy] = diagonal.each_ref().map(|entry| entry[slot]);
            // A chain of springs resists in one direction only.
            let all = inertia * mass[slot] + 1e-9 * (xx + yy + zz);
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
    fn solve(&mut self, lattice: &mut PreciseLattice, inertia: f64, share: f64) {
        let Self { direction, residual, search, scaled, tangent, inverse, effort, .. } = self;
        direction.iter_mut().for_each(|axis| axis.par_chunks_mut(BLOCK_LEN).for_each(|own| own.fill(0.0)));
        precondition(inverse, residual, scaled);
        for axis in 0..3 {
            search[axis].clone_from(&scaled[axis]);
        }
        let mut size = product(residual, scaled);
        let enough = share * share * size;
        for _ in 0..MOST_GRADIENTS {
            if size <= enough {
                return;
            }
            effort.products += 1;
            lattice.apply(search, tangent);
            add_inertia(lattice, inertia, search, tangent);
            let curvature = product(search, tangent);
            if curvature <= 0.0 || !curvature.is_finite() {
                return;
            }
            let factor = size / curvature;
            add(direction, [(factor, &*search)]);
            add(residual, [(-factor, &*tangent)]);
            precondition(inverse, residual, scaled);
            let next = product(residual, scaled);
            let turned = next / size;
            for axis in 0..3 {
                let both = search[axis].par_iter_mut().zip(&scaled[axis]).with_min_len(BLOCK_LEN);
                both.for_each(|(search, scaled)| *search = scaled + turned * *search);
            }
            size = next;
        }
    }
}

/// Sets to 0 what is not free.
fn mask(lattice: &PreciseLattice, field: &mut Field<f64>) {
    for axis in field {
        let both = axis.par_iter_mut().zip(lattice.free()).with_min_len(BLOCK_LEN);
        both.for_each(|(value, free)| *value = if *free > 0.0 { *value } else { 0.0 });
    }
}

/// Adds `s m` times a vector, and sets to 0 what is not free.
fn add_inertia(lattice: &PreciseLattice, inertia: f64, vector: &Field<f64>, out: &mut Field<f64>) {
    for axis in 0..3 {
        let of_slot = lattice.free().par_iter().zip(lattice.mass()).zip(&vector[axis]);
        out[axis].par_iter_mut().zip(of_slot).with_min_len(BLOCK_LEN).for_each(|(out, ((free, mass), vector))| {
            *out = if *free > 0.0 { *out + inertia * mass * vector } else { 0.0 };
        });
    }
}

/// Inverse diagonal blocks times a vector.
fn precondition(inverse: &[[f64; 6]], vector: &Field<f64>, out: &mut Field<f64>) {
    let [x, y, z] = out.each_mut().map(|axis| axis.par_chunks_mut(BLOCK_LEN));
    (x, y, z).into_par_iter().enumerate().for_each(|(block, (x, y, z))| {
        for own in 0..BLOCK_LEN {
            let slot = block * BLOCK_LEN + own;
            let [xx, yy, zz, yz, xz, xy] = inverse[slot];
            let [a, b, c] = [vector[0][slot], vector[1][slot], vector[2][slot]];
            x[own] = xx * a + xy * b + xz * c;
            y[own] = xy * a + yy * b + yz * c;
            z[own] = xz * a + yz * b + zz * c;
        }
    });
}
