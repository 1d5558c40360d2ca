//! The fast bodies compiled for several instruction sets, and the choice among them at run time.
#![allow(unsafe_code)]

use std::hint::black_box;
use std::str::FromStr;
use std::sync::OnceLock;

use multiversion::multiversion;

use super::block::{BlockState, Work, kick_block};
use super::halo::Halo;
use super::laws::{DamperConstant, Living, SpringConstant};
use super::parting::widest_cell;
use super::rows::LANES;
use super::simd::Vector;
#[cfg(target_arch = "aarch64")]
use super::simd::neon::Neon;
use super::simd::plain::Plain;
#[cfg(target_arch = "x86_64")]
use super::simd::{avx2::Avx2, avx512::Avx512};
use super::volume::{CellConstant, CellPlanes, CellStep, block_volume_forces};
use crate::lattice::layout::BLOCK_LEN;

/// Whether this machine has some features.
#[cfg(target_arch = "x86_64")]
macro_rules! has { ($($feature:tt)*) => { $(std::arch::is_x86_feature_detected!($feature))&&* } }

/// An instruction set the hot loop is compiled for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum InstructionSet {
    /// Plain code, as any machine can run it; always exact.
    Baseline,
    /// NEON of 64-bit ARM.
    Neon,
    /// AVX2 and FMA.
    Avx2,
    /// AVX-512 F, VL, DQ and BW.
    Avx512,
}

impl InstructionSet {
    /// All of them, the fastest last.
    pub const ALL: [Self; 4] = [Self::Baseline, Self::Neon, Self::Avx2, Self::Avx512];

    /// Whether this machine has it.
    pub fn available(self) -> bool {
        match self {
            Self::Baseline => true,
            Self::Neon => cfg!(target_arch = "aarch64"),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => has!("avx2" "fma"),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => has!("avx2" "fma" "avx512f" "avx512vl" "avx512dq" "avx512bw"),
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx2 | Self::Avx512 => false,
        }
    }

    /// The one named in the environment by `YAWARA_INSTRUCTION_SET`, if any is.
    ///
    /// # Errors
    /// If it is none of them, or this machine does not have it.
    pub fn asked_for() -> Result<Option<Self>, String> {
        let Some(name) = std::env::var_os("YAWARA_INSTRUCTION_SET") else { return Ok(None) };
        let set: Self = name.to_string_lossy().parse().map_err(|error| format!("YAWARA_INSTRUCTION_SET: {error}"))?;
        if !set.available() {
            return Err(format!(
                "YAWARA_INSTRUCTION_SET is {}, which this machine does not have; unset it",
                set.name()
            ));
        }
        Ok(Some(set))
    }

    /// The one [asked for](Self::asked_for), or else the fastest this machine has.
    pub fn best() -> Self {
        static BEST: OnceLock<InstructionSet> = OnceLock::new();
        *BEST.get_or_init(|| {
            let fastest = Self::ALL.into_iter().rfind(|set| set.available()).unwrap_or(Self::Baseline);
            Self::asked_for().ok().flatten().unwrap_or(fastest)
        })
    }

    /// As it is written in commands and reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Baseline => "baseline",
            Self::Neon => "neon",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }
}

impl FromStr for InstructionSet {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|set| set.name() == name)
            .ok_or_else(|| format!("\"{name}\" is not an instruction set; expected baseline, neon, avx2 or avx512"))
    }
}

/// How the hot loop computes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Arithmetic {
    /// The instruction set; [`Arithmetic::new`] sees to it that the machine has it.
    set: InstructionSet,
    /// Nothing fused, true square roots: the bits are the same on every instruction set.
    exact: bool,
}

impl Default for Arithmetic {
    /// Fast, on the best instruction set.
    fn default() -> Self {
        Self { set: InstructionSet::best(), exact: false }
    }
}

impl Arithmetic {
    /// # Panics
    /// If the machine does not have the instruction set.
    pub fn new(set: InstructionSet, exact: bool) -> Self {
        assert!(set.available(), "this machine has no {}", set.name());
        Self { set, exact }
    }

    /// The instruction set.
    pub fn set(self) -> InstructionSet {
        self.set
    }

    /// Whether the bits are those of every instruction set.
    pub fn exact(self) -> bool {
        self.exact
    }
}

/// A fast body, to be run with the registers of some instruction set.
trait Job {
    /// What it gives.
    type Output;
    /// Runs it. To be inlined always: it belongs into a function compiled for the instruction set.
    fn run<V: Vector>(self) -> Self::Output;
}

/// Runs a job on an instruction set.
///
/// # Panics
/// If the machine does not have it.
fn run_on<J: Job>(set: InstructionSet, job: J) -> J::Output {
    match set {
        InstructionSet::Baseline => job.run::<Plain>(),
        _ => enter(set, job),
    }
}

/// Runs a job on one of the larger instruction sets; the only place where one is entered.
///
/// # Panics
/// If the machine does not have it, or it is the baseline.
fn enter<J: Job>(set: InstructionSet, job: J) -> J::Output {
    assert!(set.available(), "this machine has no {}", set.name());
    match set {
        #[cfg(target_arch = "aarch64")]
        InstructionSet::Neon => job.run::<Neon>(),
        // SAFETY: asked for above.
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx512 => unsafe { run_on_avx512(job) },
        // SAFETY: the same.
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx2 => unsafe { run_on_avx2(job) },
        _ => unreachable!("the baseline is not entered"),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,avx512f,avx512vl,avx512dq,avx512bw")]
fn run_on_avx512<J: Job>(job: J) -> J::Output {
    job.run::<Avx512>()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn run_on_avx2<J: Job>(job: J) -> J::Output {
    job.run::<Avx2>()
}

/// [`kick_block`] as `arithmetic` says.
pub fn kick<K: SpringConstant, C: DamperConstant, A: Living>(
    arithmetic: Arithmetic,
    stiffness: K,
    damping: C,
    alive: A,
    state: BlockState<'_>,
    work: &mut Work,
    velocity: [&mut [f32; BLOCK_LEN]; 3],
) -> f32 {
    let Arithmetic { set, exact } = arithmetic;
    let kick = Kick { stiffness, damping, alive, state, work, velocity };
    match (set, exact) {
        // It fuses nothing: fast would be no faster, and one body more to compile.
        (InstructionSet::Baseline, _) => Exact(kick).run::<Plain>(),
        (_, true) => enter(set, Exact(kick)),
        (_, false) => enter(set, kick),
    }
}

struct Kick<'a, K, C, A> {
    stiffness: K,
    damping: C,
    alive: A,
    state: BlockState<'a>,
    work: &'a mut Work,
    velocity: [&'a mut [f32; BLOCK_LEN]; 3],
}

/// The same in exact arithmetic.
struct Exact<T>(T);

impl<K: SpringConstant, C: DamperConstant, A: Living> Job for Kick<'_, K, C, A> {
    type Output = f32;
    #[inline(always)]
    fn run<V: Vector>(self) -> f32 {
        let Self { stiffness, damping, alive, state, work, velocity } = self;
        kick_block::<V, false, K, C, A>(stiffness, damping, alive, state, work, velocity)
    }
}

impl<K: SpringConstant, C: DamperConstant, A: Living> Job for Exact<Kick<'_, K, C, A>> {
    type Output = f32;
    #[inline(always)]
    fn run<V: Vector>(self) -> f32 {
        let Kick { stiffness, damping, alive, state, work, velocity } = self.0;
        kick_block::<V, true, K, C, A>(stiffness, damping, alive, state, work, velocity)
    }
}

/// Twelve chains of multiplications with addition, `steps` long: what the arithmetic of one thread can reach. Returns their
/// number, a lane counted as one.
///
/// # Panics
/// If the machine does not have the instruction set.
pub fn multiply_add_chains(set: InstructionSet, steps: usize) -> usize {
    run_on(set, Chains { steps })
}

struct Chains {
    steps: usize,
}

impl Job for Chains {
    type Output = usize;
    #[inline(always)]
    fn run<V: Vector>(self) -> usize {
        const CHAINS: usize = 12;
        let factor = V::splat(black_box(0.999));
        let mut chains = [V::splat(black_box(1.0)); CHAINS];
        for _ in 0..self.steps {
            for chain in &mut chains {
                *chain = chain.mul_add(factor, factor);
            }
        }
        let mut out = [0.0; LANES];
        for chain in chains {
            chain.store(&mut out, 0);
            black_box(&out);
        }
        self.steps * CHAINS * V::LANES
    }
}

/// The largest squared difference of velocities in the cells of a block, see [`super::parting`]. Same bits on every
/// instruction set.
///
/// # Panics
/// If the machine does not have the instruction set.
pub fn widest_cell_of_block(set: InstructionSet, velocity: [&Halo; 3], present: &Halo) -> f32 {
    run_on(set, WidestCell { velocity, present })
}

struct WidestCell<'a> {
    velocity: [&'a Halo; 3],
    present: &'a Halo,
}

impl Job for WidestCell<'_> {
    type Output = f32;
    #[inline(always)]
    fn run<V: Vector>(self) -> f32 {
        widest_cell::<V>(self.velocity, self.present)
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::block::StepConstants;
    use crate::kernel::halo::{HALO_LEN, HALO_ROW, Halo};
    use crate::kernel::laws::{Absent, HaloBits, InProportion, Intact, MeanOfEnds, SumOfCells, Uniform};
    use crate::kernel::volume::{EachCell, SameCells};
    use crate::lattice::layout::BLOCK;

    /// A halo of numbers in `low..high`, told apart by `seed`.
    fn random(seed: u32, low: f32, high: f32) -> Halo {
        let mut state = seed;
        std::array::from_fn(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            low + (high - low) * (state >> 8) as f32 / (1 << 24) as f32
        })
    }

    /// Every law on every instruction set this machine has: exact arithmetic bit for bit, fast arithmetic within rounding.
    #[test]
    fn every_law_is_the_same_on_every_instruction_set() {
        let step = StepConstants::new(3e-3, 1e-4, [0.0, 1.0, -9.81]);
        let displacement = [1, 2, 3].map(|seed| random(seed, -3e-4, 3e-4));
        let velocity = [4, 5, 6].map(|seed| random(seed, -0.1, 0.1));
        let (stiffness, damping) = (random(7, 1.0, 9.0), random(8, 1e-3, 2e-3));
        let weights: [f32; BLOCK_LEN] =
            random(9, -0.5, 2.0).map(|w| 1e-2 * w.max(0.0))[..BLOCK_LEN].try_into().unwrap();
        let noise = random(10, 0.0, 1.0);
        let alive: [u32; HALO_LEN] = noise.map(f32::to_bits);
        let force: [[f32; BLOCK_LEN]; 3] =
            [11, 12, 13].map(|seed| random(seed, -1e-3, 1e-3)[..BLOCK_LEN].try_into().unwrap());
        let mut compared = 0;
        macro_rules! compare { ($($stiffness:expr, $damping:expr, $alive:expr, $known:expr;)*) => { $(
            let state = BlockState {
                step,
                displacement: displacement.each_ref(),
                velocity: velocity.each_ref(),
                known_force: $known,
                dt_over_mass: &weights,
                ahead: &[],
            };
            let run = |set, exact| {
                let mut out = [[0.25_f32; BLOCK_LEN]; 3];
                let fastest = kick(Arithmetic::new(set, exact), $stiffness, $damping, $alive, state, &mut Work::default(), out.each_mut());
                (fastest, out)
            };
            let (fastest, expected) = run(InstructionSet::Baseline, true);
            assert!(expected.iter().flatten().filter(|&&v| v != 0.25).count() > BLOCK_LEN, "something moved");
            for set in InstructionSet::ALL.into_iter().filter(|set| set.available()) {
                let case = stringify!($stiffness, $damping, $alive, $known);
                let (fastest_here, exact) = run(set, true);
                assert!(fastest_here.to_bits() == fastest.to_bits(), "{case} on {set:?}");
                assert!(exact.map(|axis| axis.map(f32::to_bits)) == expected.map(|axis| axis.map(f32::to_bits)), "{case} on {set:?}");
                let (fastest_here, fast) = run(set, false);
                // 26 forces up to 4e-3 N whose lengths are rounded to 1e-7, weighed with up to 0.02.
                assert!((fastest_here / fastest - 1.0).abs() < 1e-5, "{case} on {set:?}");
                for (fast, exact) in fast.iter().flatten().zip(exact.iter().flatten()) {
                    assert!((fast - exact).abs() < 3e-7, "{fast} is not {exact}: {case} on {set:?}");
                }
                compared += 1;
            }
        )* } }
        let uniform = Uniform { by_family: [5.0, 4.0, 3.0] };
        let damper = Uniform { by_family: [5e-3, 4e-3, 3e-3] };
        let ends = |particle| MeanOfEnds { particle };
        let cells = |cell| SumOfCells { cell, weight: [0.16, 0.09, 0.17] };
        let bits = HaloBits { alive: &alive };
        let known = Some(&force);
        compare! {
            uniform, Absent, Intact, None;
            uniform, damper, Intact, None;
            uniform, Absent, bits, None;
            uniform, damper, bits, None;
            ends(&stiffness), Absent, bits, None;
            ends(&stiffness), ends(&damping), bits, None;
            cells(&stiffness), Absent, bits, None;
            cells(&stiffness), cells(&damping), bits, None;
            uniform, Absent, Intact, known;
            uniform, damper, Intact, known;
            cells(&stiffness), Absent, bits, known;
            cells(&stiffness), cells(&damping), bits, known;
            cells(&stiffness), InProportion { time: 2e-4 }, bits, known;
        }
        let sets = InstructionSet::ALL.into_iter().filter(|set| set.available()).count();
        assert_eq!(compared, 13 * sets);
    }

    /// No force where nothing is strained, wherever the lattice is; a velocity that is not a number is found.
    #[test]
    fn rest_is_rest_and_nonsense_is_found() {
        let step = StepConstants::new(3e-3, 1e-4, [0.0; 3]);
        let weights = [1.0; BLOCK_LEN];
        for set in InstructionSet::ALL.into_iter().filter(|set| set.available()) {
            for exact in [false, true] {
                let run = |displacement: [&Halo; 3], start: f32| {
                    let mut out = [[start; BLOCK_LEN]; 3];
                    let state = BlockState {
                        step,
                        displacement,
                        velocity: displacement,
                        known_force: None,
                        dt_over_mass: &weights,
                        ahead: &[],
                    };
                    let damper = Uniform { by_family: [0.1; 3] };
                    let arithmetic = Arithmetic::new(set, exact);
                    let stiffness = Uniform { by_family: [1e6, 2e6, 3e6] };
                    let fastest =
                        kick(arithmetic, stiffness, damper, Intact, state, &mut Work::default(), out.each_mut());
                    (fastest, out)
                };
                let moved = [[0.123; HALO_LEN], [-4.5; HALO_LEN], [67.8; HALO_LEN]];
                let (fastest, out) = run(moved.each_ref(), 0.0);
                assert_eq!(fastest, 0.0, "{set:?}, exact {exact}");
                assert!(out.iter().flatten().all(|&v| v == 0.0), "{set:?}, exact {exact}");
                assert_eq!(run(moved.each_ref(), f32::NAN).0, f32::INFINITY);
                let mut one_wrong = moved;
                one_wrong[1][HALO_LEN / 2] = f32::NAN;
                assert_eq!(run(one_wrong.each_ref(), 0.0).0, f32::INFINITY);
                // All in one point: no direction to pull in, and no force that is not a number.
                let mut flat = [[0.0; HALO_LEN]; 3];
                for (place, _) in [0.0; HALO_LEN].iter().enumerate() {
                    let row = place / HALO_ROW;
                    let ijk = [place % HALO_ROW, row % (BLOCK[1] + 2), row / (BLOCK[1] + 2)];
                    for axis in 0..3 {
                        flat[axis][place] = -(ijk[axis] as f32 * 3e-3);
                    }
                }
                assert!(run(flat.each_ref(), 0.0).0.is_finite(), "{set:?}, exact {exact}");
            }
        }
    }

    /// Velocities around a block may be anything where nothing damps: they are not read.
    #[test]
    fn without_dampers_velocities_are_not_read() {
        let step = StepConstants::new(3e-3, 1e-4, [0.0; 3]);
        let displacement = [1, 2, 3].map(|seed| random(seed, -3e-4, 3e-4));
        let weights = [1e-2; BLOCK_LEN];
        let stiffness = Uniform { by_family: [5.0, 4.0, 3.0] };
        for set in InstructionSet::ALL.into_iter().filter(|set| set.available()) {
            for exact in [false, true] {
                let run = |around: f32, damping: Option<f32>| {
                    let velocity = [[around; HALO_LEN]; 3];
                    let state = BlockState {
                        step,
                        displacement: displacement.each_ref(),
                        velocity: velocity.each_ref(),
                        known_force: None,
                        dt_over_mass: &weights,
                        ahead: &[],
                    };
                    let (arithmetic, mut work) = (Arithmetic::new(set, exact), Work::default());
                    let mut out = [[0.25_f32; BLOCK_LEN]; 3];
                    let fastest = match damping {
                        None => kick(arithmetic, stiffness, Absent, Intact, state, &mut work, out.each_mut()),
                        Some(damping) => {
                            let damper = Uniform { by_family: [damping; 3] };
                            kick(arithmetic, stiffness, damper, Intact, state, &mut work, out.each_mut())
                        }
                    };
                    (fastest, out)
                };
                assert_eq!(run(f32::NAN, None), run(0.0, None), "{set:?}, exact {exact}");
                assert_eq!(run(f32::NAN, Some(1e-3)).0, f32::INFINITY, "{set:?}, exact {exact}: dampers read them");
            }
        }
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
            assert!(run(true) == run(false), "{}", stringify!($modulus, $viscosity));
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
