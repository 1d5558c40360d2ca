//! The true limit of the rest state: the largest eigenvalue of the whole lattice by Lanczos' iteration, matrix-free.
//!
//! Vectors are f32 in block order, sums f64. Round-off spoils the orthogonality of the vectors, which repeats converged
//! eigenvalues but does not push any beyond the largest one (C. C. Paige, "Accuracy and effectiveness of the Lanczos
//! algorithm for the symmetric eigenproblem", 1980). The error after `k` steps from a random vector of length `n` is above
//! `e lambda_max` with a probability below `1.648 sqrt(n) exp(-sqrt(e) (2 k - 1))` (J. Kuczynski and H. Wozniakowski,
//! "Estimating the largest eigenvalue by the power and Lanczos algorithms with a random start", 1992).

use std::cell::Cell;

use rayon::prelude::*;

use super::super::effects::fibres::in_slots;
use super::super::slot_constants::{SlotConstants, to_slots, with_law};
use super::whole_moduli;
use crate::kernel::fibres::add_linear;
use crate::kernel::halo::{HALO_LEN, Halo, gather_rows};
use crate::kernel::laws::Bits;
use crate::kernel::linear::apply;
use crate::lattice::layout::{BLOCK_LEN, BlockLayout};
use crate::lattice::{Lattice, Topology};
use crate::material::{Assembly, SpringConstants};
use crate::splitmix::{GOLDEN, mix};

/// Price of an iteration in steps of a run (measured 0.9 to 1.6).
const PRICE: f64 = 1.5;
/// Iterations between two looks at how far it is.
const ROUND: usize = 5;
/// Beyond this many nothing is left to gain.
const MOST: usize = 300;
/// Without proportional damping each round only gets to the root of what is left.
const ROUNDS: usize = 6;
/// The limit may be too large with this probability.
const RISK: f64 = 1e-6;

/// A larger limit than `rest`, as far as looking for it pays in a run of `steps` [s].
pub(super) fn sharpened(lattice: &Lattice, topology: &Topology, assembly: &Assembly, rest: f64, steps: f64) -> f64 {
    let proportional = damping_time(assembly, lattice.len()).is_some();
    let mut limit = rest;
    for _ in 0..if proportional { 1 } else { ROUNDS } {
        let before = limit;
        limit = once(lattice, topology, assembly, before, steps * rest / before);
        if limit < 1.01 * before {
            break;
        }
    }
    limit
}

/// One round from a limit that is known.
fn once(lattice: &Lattice, topology: &Topology, assembly: &Assembly, rest: f64, steps: f64) -> f64 {
    if steps < 4.0 * PRICE * ROUND as f64 {
        return rest;
    }
    let operator = Operator::new(lattice, topology, assembly, rest);
    let free = 3.0 * operator.free as f64;
    let mut lanczos = Lanczos::new(&operator);
    let mut certain = rest;
    loop {
        let finished = !(0..ROUND).all(|_| lanczos.advance(&operator));
        let iterations = lanczos.diagonal.len();
        let found = lanczos.largest();
        let error = if finished && iterations as f64 >= free {
            0.0
        } else {
            ((1.648 * free.sqrt() / RISK).ln() / (2.0 * iterations as f64 - 1.0)).powi(2)
        };
        // f32 sums: see the kernel.
        let bound = if error < 1.0 { found / (1.0 - error) * (1.0 + 1e-4) } else { f64::INFINITY };
        certain = operator.limit(bound).max(certain);
        let best = operator.limit(found).max(certain);
        // The error falls with the square of the iterations: half as many again more than halves it.
        let saved = 0.5 * steps * rest * (1.0 / certain - 1.0 / best);
        if finished || iterations >= MOST || saved < 0.5 * PRICE * iterations as f64 {
            return certain;
        }
    }
}

/// `M^-1/2 (dt^2 K + 2 dt C) M^-1/2` at the rest limit `dt`; its largest eigenvalue is at most 4.
struct Operator {
    layout: BlockLayout,
    pitch: f32,
    alive: Vec<u32>,
    springs: SlotConstants,
    modulus: Option<Vec<f32>>,
    /// Direction of the fibres times the fourth root of their modulus and the root of the step.
    fibres: Option<[Vec<f32>; 3]>,
    /// One over the root of the mass; 0 for rigid organs and empty slots.
    weight: Vec<f32>,
    free: usize,
    dt: f64,
    /// `tau` when `C = tau K` [s].
    damping_time: Option<f64>,
}

impl Operator {
    fn new(lattice: &Lattice, topology: &Topology, assembly: &Assembly, dt: f64) -> Self {
        let layout = BlockLayout::new(lattice);
        let mut alive = vec![0; layout.slots()];
        for (&slot, &bits) in layout.slot.iter().zip(topology.alive()) {
            alive[slot as usize] = bits;
        }
        let weights: Vec<f32> = assembly.mass.iter().map(|&m| if m > 0.0 { m.sqrt().recip() } else { 0.0 }).collect();
        let combined = |k: f32, c: f32| (dt * dt * f64::from(k) + 2.0 * dt * f64::from(c)) as f32;
        let volume = assembly.volume.as_ref().map(|volume| {
            let zeros = vec![0.0; lattice.len()];
            let viscosity = volume.viscosity.as_ref().unwrap_or(&zeros);
            let both: Vec<f32> = volume.modulus.iter().zip(viscosity).map(|(&k, &c)| combined(k, c)).collect();
            to_slots(&layout, &whole_moduli(lattice, topology, &both))
        });
        Self {
            springs: SlotConstants::new(&layout, &combine(assembly, lattice.len(), combined)),
            modulus: volume,
            fibres: assembly.fibres.as_ref().map(|term| {
                let [mut x, mut y, mut z] = in_slots(lattice, &layout, topology, term);
                for ((x, y), z) in x.iter_mut().zip(&mut y).zip(&mut z) {
                    // b is the direction times the root of the modulus, and nothing damps.
                    let length = (f64::from(*x).powi(2) + f64::from(*y).powi(2) + f64::from(*z).powi(2)).sqrt();
                    let factor = if length > 0.0 { (dt / length).sqrt() } else { 0.0 };
                    for part in [x, y, z] {
                        *part = (f64::from(*part) * factor) as f32;
                    }
                }
                [x, y, z]
            }),
            weight: to_slots(&layout, &weights),
            free: assembly.mass.iter().filter(|&&m| m > 0.0).count(),
            pitch: lattice.pitch as f32,
            damping_time: damping_time(assembly, lattice.len()),
            dt,
            alive,
            layout,
        }
    }

    /// The largest step while the largest eigenvalue is `lambda` at `self.dt`.
    fn limit(&self, lambda: f64) -> f64 {
        let share = 4.0 / lambda;
        match self.damping_time {
            Some(tau) => {
                // dt^2 + 2 tau dt grows by the share.
                let aim = share * self.dt * (self.dt + 2.0 * tau);
                aim / (tau + (tau * tau + aim).sqrt())
            }
            // dt^2 K + 2 dt C grows at most with dt^2.
            None => self.dt * share.sqrt(),
        }
    }

    /// `out = A q`; `scaled` is a buffer.
    fn apply(&self, q: &Field, scaled: &mut Field, out: &mut Field) {
        for axis in 0..3 {
            let source = q[axis].par_chunks(BLOCK_LEN).zip(self.weight.par_chunks(BLOCK_LEN));
            scaled[axis].par_chunks_mut(BLOCK_LEN).zip(source).for_each(|(to, (from, weight))| {
                to.iter_mut().zip(from.iter().zip(weight)).for_each(|(to, (from, weight))| *to = from * weight);
            });
        }
        let scaled = &*scaled;
        let [x, y, z] = out.each_mut().map(|axis| axis.par_chunks_exact_mut(BLOCK_LEN));
        (x, y, z).into_par_iter().enumerate().for_each_init(
            || Buffers::new(self.fibres.is_some()),
            |buffers, (block, (x, y, z))| {
                let (neighbours, rows) = (&self.layout.neighbours[block], self.layout.rows[block]);
                let Buffers { u, constants, modulus, cells, fibres } = &mut **buffers;
                for axis in 0..3 {
                    gather_rows(&scaled[axis], neighbours, rows, &mut u[axis]);
                }
                self.springs.gather(neighbours, rows, constants);
                if let Some(values) = &self.modulus {
                    gather_rows(values, neighbours, rows, modulus);
                }
                let alive = Bits { alive: block_of(&self.alive, block) };
                let modulus = self.modulus.is_some().then_some(&*modulus);
                let mut out =
                    [x, y, z].map(|chunk| -> &mut [f32; BLOCK_LEN] { chunk.try_into().expect("whole blocks") });
                with_law!(&self.springs, &*constants, |law| {
                    apply(
                        law,
                        alive,
                        modulus,
                        self.pitch,
                        u.each_ref(),
                        cells,
                        out.each_mut().map(|chunk| &mut **chunk),
                    );
                });
                if let (Some(root), Some(halos)) = (&self.fibres, fibres) {
                    let [root_halos, work] = &mut **halos;
                    for (values, halo) in root.iter().zip(root_halos.iter_mut()) {
                        gather_rows(values, neighbours, rows, halo);
                    }
                    add_linear(
                        root_halos.each_ref(),
                        self.pitch,
                        u.each_ref(),
                        work,
                        out.each_mut().map(|chunk| &mut **chunk),
                    );
                }
                let weight = block_of(&self.weight, block);
                for chunk in out {
                    chunk.iter_mut().zip(weight).for_each(|(value, weight)| *value *= weight);
                }
            },
        );
    }
}

/// Spring constants combined from stiffness and damping; like the step, both summed over cells or neither.
fn combine(assembly: &Assembly, particles: usize, of: impl Fn(f32, f32) -> f32) -> SpringConstants {
    use SpringConstants::{MeanOfEnds, SumOfCells, Uniform};
    let zip = |k: &[f32], c: &[f32]| k.iter().zip(c).map(|(&k, &c)| of(k, c)).collect();
    match (&*assembly.instant_stiffness(), &assembly.damping) {
        (Uniform(k), None) => Uniform(of(*k, 0.0)),
        (Uniform(k), Some(Uniform(c))) => Uniform(of(*k, *c)),
        (SumOfCells { cell, weight }, None) => {
            SumOfCells { cell: cell.iter().map(|&k| of(k, 0.0)).collect(), weight: *weight }
        }
        (SumOfCells { cell: k, weight }, Some(SumOfCells { cell: c, .. })) => {
            SumOfCells { cell: zip(k, c), weight: *weight }
        }
        (k, None) => MeanOfEnds(k.per_particle(particles).iter().map(|&k| of(k, 0.0)).collect()),
        (k, Some(c)) => MeanOfEnds(zip(&k.per_particle(particles), &c.per_particle(particles))),
    }
}

/// `tau` when damping is `tau` times stiffness everywhere [s].
fn damping_time(assembly: &Assembly, particles: usize) -> Option<f64> {
    let range = Cell::new((f64::INFINITY, 0.0_f64));
    let see = |k: f32, c: f32| {
        if k != 0.0 || c != 0.0 {
            let time = f64::from(c) / f64::from(k);
            let (low, high) = range.get();
            range.set((low.min(time), if time >= 0.0 { high.max(time) } else { f64::INFINITY }));
        }
        0.0
    };
    combine(assembly, particles, see);
    if let Some(volume) = &assembly.volume {
        for (place, &k) in volume.modulus.iter().enumerate() {
            see(k, volume.viscosity.as_ref().map_or(0.0, |viscosity| viscosity[place]));
        }
    }
    if let Some(fibres) = &assembly.fibres {
        for root in &fibres.root {
            see(root.iter().map(|part| part * part).sum(), 0.0);
        }
    }
    let (low, high) = range.get();
    // f32 constants.
    (high.is_finite() && high - low <= 1e-5 * high).then_some(high)
}

type Field = [Vec<f32>; 3];

struct Buffers {
    u: [Halo; 3],
    constants: Halo,
    modulus: Halo,
    cells: Halo,
    /// Fibres, and what they pull with.
    fibres: Option<Box<[[Halo; 3]; 2]>>,
}

impl Buffers {
    fn new(fibres: bool) -> Box<Self> {
        let zeros = [0.0; HALO_LEN];
        let fibres = fibres.then(|| Box::new([[zeros; 3]; 2]));
        Box::new(Self { u: [zeros; 3], constants: zeros, modulus: zeros, cells: zeros, fibres })
    }
}

/// The three-term recurrence and the tridiagonal matrix it has made so far.
struct Lanczos {
    previous: Field,
    current: Field,
    next: Field,
    scaled: Field,
    diagonal: Vec<f64>,
    /// `beside[k]` joins entries k and k + 1.
    beside: Vec<f64>,
}

impl Lanczos {
    fn new(operator: &Operator) -> Self {
        let slots = operator.layout.slots();
        let zeros = || [0, 1, 2].map(|_| vec![0.0_f32; slots]);
        let mut current = zeros();
        for (axis, values) in current.iter_mut().enumerate() {
            let free =
                values.par_iter_mut().zip(&operator.weight).enumerate().filter(|(_, (_, weight))| **weight > 0.0);
            free.for_each(|(slot, (value, _))| *value = normal(3 * slot as u64 + axis as u64));
        }
        let mut lanczos =
            Self { previous: zeros(), current, next: zeros(), scaled: zeros(), diagonal: vec![], beside: vec![] };
        let length = dot(&lanczos.current, &lanczos.current).sqrt();
        scale(&mut lanczos.current, 1.0 / length.max(f64::MIN_POSITIVE));
        lanczos
    }

    /// One more row of the tridiagonal matrix; false when the vectors seen so far span all that can be reached.
    fn advance(&mut self, operator: &Operator) -> bool {
        operator.apply(&self.current, &mut self.scaled, &mut self.next);
        let alpha = dot(&self.next, &self.current);
        let beta = self.beside.last().copied().unwrap_or(0.0);
        for axis in 0..3 {
            let known = self.current[axis].par_chunks(BLOCK_LEN).zip(self.previous[axis].par_chunks(BLOCK_LEN));
            self.next[axis].par_chunks_mut(BLOCK_LEN).zip(known).for_each(|(next, (current, previous))| {
                for (next, (current, previous)) in next.iter_mut().zip(current.iter().zip(previous)) {
                    *next -= alpha as f32 * current + beta as f32 * previous;
                }
            });
        }
        let length = dot(&self.next, &self.next).sqrt();
        self.diagonal.push(alpha);
        // The eigenvalues are of the order of 4.
        if length < 1e-6 {
            return false;
        }
        self.beside.push(length);
        scale(&mut self.next, 1.0 / length);
        std::mem::swap(&mut self.previous, &mut self.current);
        std::mem::swap(&mut self.current, &mut self.next);
        true
    }

    /// Largest eigenvalue of the tridiagonal matrix, by bisection on the signs of its Sturm sequence; rounded up.
    fn largest(&self) -> f64 {
        let n = self.diagonal.len();
        let beside = |k: usize| if k < n - 1 { self.beside[k] } else { 0.0 };
        let radius = |k: usize| beside(k) + if k > 0 { beside(k - 1) } else { 0.0 };
        let mut high = (0..n).map(|k| self.diagonal[k] + radius(k)).fold(0.0, f64::max);
        let mut low = self.diagonal.iter().copied().fold(0.0, f64::max);
        let all_below = |x: f64| {
            let mut pivot = 1.0_f64;
            (0..n).all(|k| {
                let square = if k > 0 { beside(k - 1).powi(2) } else { 0.0 };
                pivot = x - self.diagonal[k] - square / pivot;
                pivot > 0.0
            })
        };
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if all_below(middle) {
                high = middle;
            } else {
                low = middle;
            }
        }
        high
    }
}

/// A number of the normal distribution for each place, always the same (SplitMix64 and Box-Muller).
fn normal(place: u64) -> f32 {
    // In 0..=1, without the 0, which has no logarithm.
    let unit = |k: u64| ((mix((2 * place + k + 1).wrapping_mul(GOLDEN)) >> 11) + 1) as f64 / (1_u64 << 53) as f64;
    ((-2.0 * unit(0).ln()).sqrt() * (std::f64::consts::TAU * unit(1)).cos()) as f32
}

/// Summed block by block, then in their order: the same at any number of threads.
fn dot(a: &Field, b: &Field) -> f64 {
    let of_axis = |axis: usize| -> f64 {
        let chunks = a[axis].par_chunks(BLOCK_LEN).zip(b[axis].par_chunks(BLOCK_LEN));
        let partial: Vec<f64> =
            chunks.map(|(a, b)| a.iter().zip(b).map(|(&a, &b)| f64::from(a) * f64::from(b)).sum()).collect();
        partial.iter().sum()
    };
    (0..3).map(of_axis).sum()
}

fn scale(field: &mut Field, factor: f64) {
    for axis in field {
        axis.par_iter_mut().for_each(|value| *value *= factor as f32);
    }
}

fn block_of<T>(slots: &[T], block: usize) -> &[T; BLOCK_LEN] {
    slots[block * BLOCK_LEN..][..BLOCK_LEN].try_into().expect("whole blocks")
}
