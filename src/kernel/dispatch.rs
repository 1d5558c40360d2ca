//! The fast body compiled for several instruction sets; the best one this machine has is picked at run time.

use multiversion::multiversion;

use super::rows::{Alive, BlockState, SpringConstant, StepConstants, kick_block};
use crate::lattice::layout::BLOCK_LEN;

/// [`kick_block`] on the best instruction set of this machine. Same bits on all of them.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw+avx2+fma", "x86_64+avx2+fma"), dispatcher = "direct")]
pub fn kick<K: SpringConstant, C: SpringConstant, A: Alive>(
    step: StepConstants,
    stiffness: K,
    damping: C,
    alive: A,
    state: BlockState<'_>,
    velocity: [&mut [f32; BLOCK_LEN]; 3],
) -> f32 {
    kick_block(step, stiffness, damping, alive, state, velocity)
}

/// Name of the instruction set that [`kick`] uses on this machine.
///
/// `multiversion` takes AVX-512 only where it does not slow the clock, which it tells by the extensions of Ice Lake.
pub fn instruction_set() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    {
        macro_rules! has { ($($feature:tt)*) => { $(std::arch::is_x86_feature_detected!($feature))&&* } }
        let avx2 = has!("avx2" "fma");
        let avx512 = has!("avx512f" "avx512vl" "avx512dq" "avx512bw" "avx512cd" "avx512ifma" "avx512vbmi" "avx512vbmi2")
            && has!("avx512vnni" "avx512bitalg" "avx512vpopcntdq" "gfni" "vaes" "vpclmulqdq");
        match (avx512, avx2) {
            (true, true) => "AVX-512",
            (false, true) => "AVX2",
            _ => "SSE2",
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        std::env::consts::ARCH
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::halo::Halo;
    use crate::kernel::rows::{Absent, Bits, Intact, MeanOfEnds, SumOfCells, Uniform};

    /// A halo of numbers in `low..high`, told apart by `seed`.
    fn random(seed: u32, low: f32, high: f32) -> Halo {
        let mut state = seed;
        std::array::from_fn(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            low + (high - low) * (state >> 8) as f32 / (1 << 24) as f32
        })
    }

    /// The test program is compiled for the baseline; `kick` runs on the best set this machine has.
    #[test]
    fn every_law_gives_the_bits_of_the_baseline() {
        let step = StepConstants::new(3e-3, 1e-4, [0.0, 1.0, -9.81]);
        let displacement = [1, 2, 3].map(|seed| random(seed, -3e-4, 3e-4));
        let velocity = [4, 5, 6].map(|seed| random(seed, -0.1, 0.1));
        let (stiffness, damping) = (random(7, 1.0, 9.0), random(8, 1e-3, 2e-3));
        let weights: [f32; BLOCK_LEN] = random(9, 0.5, 2.0)[..BLOCK_LEN].try_into().unwrap();
        let noise = random(10, 0.0, 1.0);
        let alive: [u32; BLOCK_LEN] = std::array::from_fn(|slot| noise[slot].to_bits());
        let state =
            BlockState { displacement: displacement.each_ref(), velocity: velocity.each_ref(), dt_over_mass: &weights };
        let mut compared = 0;
        macro_rules! compare { ($($stiffness:expr, $damping:expr, $alive:expr;)*) => { $(
            let run = |best: bool| {
                let mut out = [[0.25_f32; BLOCK_LEN]; 3];
                let fastest = if best {
                    kick(step, $stiffness, $damping, $alive, state, out.each_mut())
                } else {
                    kick_block(step, $stiffness, $damping, $alive, state, out.each_mut())
                };
                (fastest.to_bits(), out.map(|axis| axis.map(f32::to_bits)))
            };
            assert!(run(true) == run(false), "{} on {}", stringify!($stiffness, $damping, $alive), instruction_set());
            assert!(run(true).1.iter().flatten().any(|&bits| bits != 0.25_f32.to_bits()), "something moved");
            compared += 1;
        )* } }
        let uniform = Uniform { by_family: [5.0, 4.0, 3.0] };
        let ends = |particle| MeanOfEnds { particle };
        let cells = |cell| SumOfCells { cell, weight: [0.16, 0.09, 0.17] };
        let bits = Bits { alive: &alive };
        compare! {
            uniform, Absent, Intact;
            uniform, uniform, Intact;
            uniform, Absent, bits;
            uniform, uniform, bits;
            ends(&stiffness), Absent, bits;
            ends(&stiffness), ends(&damping), bits;
            cells(&stiffness), Absent, bits;
            cells(&stiffness), cells(&damping), bits;
        }
        assert_eq!(compared, 8);
    }
}
