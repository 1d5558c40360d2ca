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
pub fn instruction_set() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    {
        if std::arch::is_x86_feature_detected!("avx512f")
            && std::arch::is_x86_feature_detected!("avx512vl")
            && std::arch::is_x86_feature_detected!("avx512dq")
            && std::arch::is_x86_feature_detected!("avx512bw")
        {
            return "AVX-512";
        }
        if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma") {
            return "AVX2";
        }
        "SSE2"
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        std::env::consts::ARCH
    }
}
