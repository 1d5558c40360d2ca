//! What the machine reaches without a lattice: lane operations and memory traffic, measured with as many threads.

use std::hint::black_box;
use std::time::Instant;

use rayon::prelude::*;

use super::super::super::args::BenchLaw;
use super::Measured;
use crate::kernel::dispatch::{InstructionSet, multiply_add_chains};

/// Best of this many tries is reported.
const TRIES: usize = 5;
/// Steps of each chain in a try.
const CHAIN: usize = 4_000_000;
/// Floats of each array that memory is measured with: larger than most caches.
const FLOATS: usize = 32 << 20;

/// What the machine reached.
pub(super) struct Machine {
    /// Multiplications with addition, one per lane [1/s].
    pub(super) lane_operations_per_s: f64,
    /// Bytes read and written by `a = b + s c` [B/s].
    pub(super) memory_bytes_per_s: f64,
}

impl Machine {
    pub(super) fn measured(set: InstructionSet) -> Self {
        let threads = rayon::current_num_threads();
        let best = |work: &dyn Fn() -> f64| (0..TRIES).map(|_| work()).fold(0.0, f64::max);
        let arithmetic = || {
            let began = Instant::now();
            let operations: usize = (0..threads).into_par_iter().map(|_| multiply_add_chains(set, CHAIN)).sum();
            operations as f64 / began.elapsed().as_secs_f64()
        };
        let [mut a, b, c] = [0.0, 1.0, 2.0].map(|value| vec![value; FLOATS]);
        let mut triad = || {
            let began = Instant::now();
            let part = FLOATS / threads;
            a.par_chunks_mut(part).zip(b.par_chunks(part)).zip(c.par_chunks(part)).for_each(|((a, b), c)| {
                for ((a, b), c) in a.iter_mut().zip(b).zip(c) {
                    *a = b + 3.0 * c;
                }
            });
            black_box(&a);
            // Two are read; the third is read before it is written.
            (4 * size_of::<f32>() * FLOATS) as f64 / began.elapsed().as_secs_f64()
        };
        let memory_bytes_per_s = (0..TRIES).map(|_| triad()).fold(0.0, f64::max);
        Self { lane_operations_per_s: best(&arithmetic), memory_bytes_per_s }
    }

    /// How much of the machine's arithmetic and of its memory a run used.
    pub(super) fn shares(&self, run: &Measured, law: BenchLaw) -> [f64; 2] {
        // Counted in `kernel::rows`, fast arithmetic, an instruction with sixteen lanes as sixteen. Per spring and end:
        // differences 3, rest vector 54/26, squared length 3, inverse root 5, factor 2, force 3.
        let spring = 3.0 + 54.0 / 26.0 + 3.0 + 5.0 + 2.0 + 3.0;
        // A damper: differences 3, products 6, earlier length 3, its root 6, the sum 1, its inverse 3, factor 3; constants of
        // two organs 2 each, the living spring 2.
        let everything = spring + 3.0 + 6.0 + 3.0 + 6.0 + 1.0 + 3.0 + 3.0 + 4.0 + 2.0;
        // Displacement and velocity are read and written, velocity twice read, weight read; with dampers velocities are kept
        // twice, and springs and the two constants are read.
        let (operations, bytes) = match law {
            BenchLaw::Bare => (26.0 * spring, 4.0 * (3.0 + 6.0 + 1.0 + 9.0)),
            BenchLaw::Everything => (26.0 * everything, 4.0 * (3.0 + 3.0 + 6.0 + 1.0 + 9.0 + 3.0)),
        };
        [
            run.particle_steps_per_s * operations / self.lane_operations_per_s,
            run.particle_steps_per_s * bytes / self.memory_bytes_per_s,
        ]
    }
}
