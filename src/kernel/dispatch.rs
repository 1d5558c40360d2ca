//! The fast bodies compiled for several instruction sets; the best one this machine has is picked at run time.

use multiversion::multiversion;

use super::halo::Halo;
use super::rows::{Alive, BlockState, KnownForce, SpringConstant, StepConstants, kick_block};
use super::volume::{CellConstant, CellPlanes, CellStep, block_volume_forces};
use crate::lattice::layout::BLOCK_LEN;

/// [`kick_block`] on the best instruction set of this machine. Same bits on all of them.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw+avx2+fma", "x86_64+avx2+fma"), dispatcher = "direct")]
pub fn kick<K: SpringConstant, C: SpringConstant, A: Alive, F: KnownForce>(
    step: StepConstants,
    stiffness: K,
    damping: C,
    alive: A,
    known: F,
    state: BlockState<'_>,
    velocity: [&mut [f32; BLOCK_LEN]; 3],
) -> f32 {
    kick_block(step, stiffness, damping, alive, known, state, velocity)
}

/// [`block_volume_forces`] on the best instruction set of this machine. Same bits on all of them.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw+avx2+fma", "x86_64+avx2+fma"), dispatcher = "direct")]
pub fn volume_forces<M: CellConstant, V: CellConstant>(
    step: CellStep,
    modulus: M,
    viscosity: V,
    displacement: [&Halo; 3],
    velocity: [&Halo; 3],
    work: &mut CellPlanes,
    force: &mut [[f32; BLOCK_LEN]; 3],
) {
    block_volume_forces(step, modulus, viscosity, displacement, velocity, work, force);
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
    use crate::kernel::rows::{Absent, Bits, Intact, Known, MeanOfEnds, SumOfCells, Uniform};
    use crate::kernel::volume::{EachCell, SameCells};

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
        macro_rules! compare { ($($stiffness:expr, $damping:expr, $alive:expr, $known:expr;)*) => { $(
            let run = |best: bool| {
                let mut out = [[0.25_f32; BLOCK_LEN]; 3];
                let fastest = if best {
                    kick(step, $stiffness, $damping, $alive, $known, state, out.each_mut())
                } else {
                    kick_block(step, $stiffness, $damping, $alive, $known, state, out.each_mut())
                };
                (fastest.to_bits(), out.map(|axis| axis.map(f32::to_bits)))
            };
            assert!(run(true) == run(false), "{} on {}", stringify!($stiffness, $damping, $alive, $known), instruction_set());
            assert!(run(true).1.iter().flatten().any(|&bits| bits != 0.25_f32.to_bits()), "something moved");
            compared += 1;
        )* } }
        let uniform = Uniform { by_family: [5.0, 4.0, 3.0] };
        let ends = |particle| MeanOfEnds { particle };
        let cells = |cell| SumOfCells { cell, weight: [0.16, 0.09, 0.17] };
        let bits = Bits { alive: &alive };
        let force: [[f32; BLOCK_LEN]; 3] =
            [11, 12, 13].map(|seed| random(seed, -1e-3, 1e-3)[..BLOCK_LEN].try_into().unwrap());
        let known = Known { force: &force };
        compare! {
            uniform, Absent, Intact, Absent;
            uniform, uniform, Intact, Absent;
            uniform, Absent, bits, Absent;
            uniform, uniform, bits, Absent;
            ends(&stiffness), Absent, bits, Absent;
            ends(&stiffness), ends(&damping), bits, Absent;
            cells(&stiffness), Absent, bits, Absent;
            cells(&stiffness), cells(&damping), bits, Absent;
            uniform, Absent, Intact, known;
            uniform, uniform, Intact, known;
            cells(&stiffness), Absent, bits, known;
            cells(&stiffness), cells(&damping), bits, known;
        }
        assert_eq!(compared, 12);
    }

    #[test]
    fn every_volume_term_gives_the_bits_of_the_baseline() {
        let step = CellStep::new(3e-3, 1e-4);
        let displacement = [11, 12, 13].map(|seed| random(seed, -1e-3, 1e-3));
        let velocity = [14, 15, 16].map(|seed| random(seed, -0.5, 0.5));
        let mut modulus = random(17, -2e3, 8e4);
        let viscosity = random(18, 0.0, 40.0);
        // Cells that are not whole: a run longer than a group of lanes, and single ones.
        modulus[400..450].fill(0.0);
        modulus.iter_mut().step_by(7).for_each(|value| *value = 0.0);
        let mut compared = 0;
        macro_rules! compare { ($($modulus:expr, $viscosity:expr;)*) => { $(
            let run = |best: bool| {
                let mut force = [[f32::NAN; BLOCK_LEN]; 3];
                let mut work = CellPlanes::new();
                let (u, v) = (displacement.each_ref(), velocity.each_ref());
                if best {
                    volume_forces(step, $modulus, $viscosity, u, v, &mut work, &mut force);
                } else {
                    block_volume_forces(step, $modulus, $viscosity, u, v, &mut work, &mut force);
                }
                force.map(|axis| axis.map(f32::to_bits))
            };
            assert!(run(true) == run(false), "{} on {}", stringify!($modulus, $viscosity), instruction_set());
            assert!(run(true).iter().flatten().all(|&bits| f32::from_bits(bits).is_finite()));
            compared += 1;
        )* } }
        compare! {
            SameCells::new(5e4), Absent;
            SameCells::new(-1e3), SameCells::new(12.0);
            EachCell { cell: &modulus }, Absent;
            EachCell { cell: &modulus }, EachCell { cell: &viscosity };
        }
        assert_eq!(compared, 4);
    }
}
