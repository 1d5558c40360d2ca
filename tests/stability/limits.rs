//! The limits of the rest state against dense eigenvalues, and steps on both sides of the true one.

use super::support::*;
use super::tangent::{Dense, Sign};
use yawara::dynamics::stable_dt::Limits;
use yawara::dynamics::step_control::StepControl;
use yawara::dynamics::{StepError, World};
use yawara::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS};
use yawara::lattice::{Lattice, SeveredSpring, Topology};
use yawara::material::paper::PaperBody;
use yawara::material::tissue::{Damping, TissueBody};
use yawara::material::{Assembly, VolumeTerm};

/// f32 constants.
const ROUNDING: f64 = 1e-5;

fn random_lattice(seed: u64) -> (Lattice, Assembly) {
    let mut random = Random::new(1000 + seed);
    let map = blob([4, 3, 3], 0.75, seed);
    let contrast = 10_f64.powf(12.0 * random.unit() - 6.0);
    let ratio = |random: &mut Random| if seed.is_multiple_of(3) { 0.0 } else { 2.0 * random.unit() };
    if seed.is_multiple_of(2) {
        let body = |stiffness: f64, ratio: f64| PaperBody {
            stiffness,
            damping: ratio * (stiffness * PAPER.mass).sqrt(),
            mass: PAPER.mass,
        };
        let (a, b) = (ratio(&mut random), ratio(&mut random));
        return paper_lattice(&map, &[Some(body(10.0, a)), Some(body(10.0 * contrast, b))]);
    }
    let body =
        |youngs_modulus: f64, ratio: f64| TissueBody { youngs_modulus, damping: Damping::Ratio(ratio), ..TISSUE };
    let (a, b) = (ratio(&mut random), ratio(&mut random));
    let (lattice, mut assembly) = tissue_lattice(&map, &[Some(body(5e3, a)), Some(body(5e3 * contrast, b))]);
    add_volume(&mut assembly, &mut random, !seed.is_multiple_of(3));
    (lattice, assembly)
}

/// Cells of Poisson's ratios from below 1/4 to above 0.45, by their springs' stiffness.
fn add_volume(assembly: &mut Assembly, random: &mut Random, viscous: bool) {
    let yawara::material::SpringConstants::SumOfCells { cell, .. } = &assembly.stiffness else { panic!("tissue") };
    let modulus: Vec<f32> = cell.iter().map(|&e| e * (3.0 * random.unit() - 0.2) as f32).collect();
    let viscosity = viscous.then(|| modulus.iter().map(|&l| l.max(0.0) * (1e-3 * random.unit()) as f32).collect());
    assembly.volume = Some(VolumeTerm { modulus, viscosity });
}

#[test]
fn the_limits_of_random_blobs_are_never_too_large() {
    let mut ratios = Vec::new();
    for seed in 0..40 {
        let (lattice, assembly) = random_lattice(seed);
        let topology = Topology::new(&lattice);
        let dense = Dense::at_rest(&lattice, &topology, &assembly);
        let limits = Limits::at_rest(&lattice, &topology, &assembly);
        let sharp = limits.sharpen(&lattice, &topology, &assembly, 1e5).sharp;
        let exact = dense.limit(limits.rest);
        assert!(limits.promise <= limits.rest && limits.rest <= sharp, "{seed}: {limits:?} {sharp}");
        assert!(dense.lambda(limits.rest) <= 4.0 * (1.0 + ROUNDING), "{seed}: {limits:?} {exact}");
        assert!(sharp <= exact * (1.0 + ROUNDING), "{seed}: {sharp} {exact}");
        assert_eq!(limits.sharpen(&lattice, &topology, &assembly, 3.0), limits, "a short run is not worth it");
        ratios.push([limits.promise / exact, limits.rest / exact, sharp / exact]);
    }
    for (name, which) in [("promise", 0), ("rest", 1), ("sharp", 2)] {
        let all: Vec<f64> = ratios.iter().map(|ratio| ratio[which]).collect();
        let (low, high) = all.iter().fold((f64::MAX, 0.0_f64), |(low, high), &r| (low.min(r), high.max(r)));
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        println!("{name}: {low:.3} to {high:.3} of the true limit, mean {mean:.3}");
        assert!(which < 2 || mean > 0.9, "sharpening is worth its name: {mean}");
    }
}

#[test]
fn inside_a_uniform_lattice_the_blocks_are_nearly_exact() {
    let (lattice, assembly) = paper_lattice(&block([7, 7, 7]), &[Some(PAPER)]);
    let topology = Topology::new(&lattice);
    let limits = Limits::at_rest(&lattice, &topology, &assembly);
    // 2 sum k n n^T over 26 equal springs is 52/3 k.
    let expected = 2.0 / (52.0 / 3.0 * PAPER.stiffness / PAPER.mass).sqrt();
    assert!((limits.rest / expected - 1.0).abs() < 1e-6, "{limits:?} {expected}");
    assert!((limits.promise / (expected / 3.0_f64.sqrt()) - 1.0).abs() < 1e-6, "{limits:?} {expected}");
    let sharp = limits.sharpen(&lattice, &topology, &assembly, 1e5).sharp;
    assert!(sharp < 1.1 * limits.rest, "{limits:?} {sharp}");
}

/// A start at random; the largest displacement ever reached, or the error.
fn run(world: &mut World, steps: usize) -> Result<f64, StepError> {
    let h = world.lattice().pitch;
    // Small: close to the limit even a thousandth of a pitch grows until it shifts the limit itself.
    shake(world, 1e-4, 0.0, 9);
    let mut largest = 0.0_f64;
    for step in 0..steps {
        world.step()?;
        if step % 20 == 0 {
            largest = largest.max(displacements(world).iter().map(|u| u.norm()).fold(0.0, f64::max) / h);
        }
    }
    Ok(largest)
}

#[test]
fn steps_below_the_true_limit_hold_and_above_it_diverge() {
    let (mut tried, mut caught) = (0, 0);
    for ratio in [0.0, 0.3] {
        let paper = PaperBody { damping: 2.0 * ratio * (PAPER.stiffness * PAPER.mass).sqrt(), ..PAPER };
        let tissue = TissueBody { damping: Damping::Ratio(ratio), ..TISSUE };
        for (name, (lattice, assembly)) in [
            ("paper", paper_lattice(&block([3, 3, 2]), &[Some(paper)])),
            ("tissue", tissue_lattice(&block([2, 1, 1]), &[Some(tissue)])),
        ] {
            let topology = Topology::new(&lattice);
            let limits = Limits::at_rest(&lattice, &topology, &assembly);
            let exact = Dense::at_rest(&lattice, &topology, &assembly).limit(limits.rest);
            let mut below = World::new(lattice.clone(), assembly.clone(), 0.99 * exact);
            let largest = run(&mut below, 20_000).unwrap_or_else(|error| panic!("{name}, {ratio}: {error}"));
            assert!(largest < 0.1, "{name}, {ratio}: {largest} pitches");
            // Beyond, the fastest mode grows until it is caught or, with dampers, until its own size shifts the limit.
            match run(&mut World::new(lattice, assembly, 1.01 * exact), 20_000) {
                Ok(grown) => {
                    println!("{name}, {ratio}: {largest:.1e} pitches below the limit, {grown:.1e} above");
                    assert!(grown > 100.0 * largest, "{name}, {ratio}: {largest} {grown}");
                }
                Err(error) => {
                    assert!(error.to_string().contains("times the stable one"), "{name}, {ratio}: {error}");
                    caught += 1;
                }
            }
            tried += 1;
        }
    }
    assert!(tried == 4 && caught >= 2, "{caught} of {tried} caught");
}

/// The blocks of the present shape are above the dense tangent at any deformation, volume terms and all.
#[test]
fn the_present_limit_is_rigorous_at_any_shape() {
    let mut closest = 0.0_f64;
    for seed in 0..24 {
        let mut random = Random::new(seed);
        let (lattice, mut assembly) = tissue_lattice(&blob([3, 2, 2], 0.9, seed), &[Some(TISSUE), Some(TISSUE)]);
        if seed % 4 != 0 {
            add_volume(&mut assembly, &mut random, false);
        }
        let limits = Limits::at_rest(&lattice, &Topology::new(&lattice), &assembly);
        let mut world = World::new(lattice, assembly, 1e-4);
        let h = world.lattice().pitch;
        let (even, noise) = (nalgebra::Matrix3::from_fn(|_, _| 1.5 * random.unit() - 0.75), 0.3 * random.unit());
        for (p, rest) in particles(&world).into_iter().zip(rest_places(&world)) {
            world.set_displacement(p, even * rest + random.vector() * noise * h);
        }
        let mut control = StepControl::new(&world, limits);
        cut_some(&mut world, &mut random, if seed % 3 == 0 { 6 } else { 0 });
        let blocks = control.blocks_limit(&world);
        let displacement = displacements(&world);
        let at = |sign| Dense::new(world.lattice(), world.topology(), world.assembly(), &displacement, sign);
        // Negative moduli count as 0 in the bound; in the oracle they only lower it.
        for sign in [Sign::True, Sign::Positive] {
            let exact = at(sign).limit(blocks);
            assert!(blocks <= exact * (1.0 + 1e-4), "{seed}: {blocks} {exact}");
            closest = closest.max(blocks / exact);
        }
    }
    println!("blocks of deformed shapes: up to {closest:.3} of the true limit");
    assert!(closest > 0.5);
}

fn cut_some(world: &mut World, random: &mut Random, count: usize) {
    for _ in 0..count {
        let particle = (random.next() % world.lattice().len() as u64) as u32;
        let alive = world.topology().alive()[particle as usize];
        if let Some(direction) = (FIRST_FORWARD..NEIGHBOURS).find(|d| alive >> d & 1 == 1) {
            world.sever([SeveredSpring { particle, direction: direction as u8, at: 0.5, time: 0.0 }]);
        }
    }
}

#[test]
fn cuts_never_lower_a_limit() {
    for seed in 0..12 {
        let (lattice, assembly) = random_lattice(seed);
        let mut random = Random::new(seed);
        let mut world = World::new(lattice, assembly, 1e-4);
        let of = |world: &World| Limits::at_rest(world.lattice(), world.topology(), world.assembly());
        let mut control = StepControl::new(&world, of(&world));
        let (mut before, mut blocks) = (of(&world), control.blocks_limit(&world));
        for _ in 0..12 {
            cut_some(&mut world, &mut random, 10);
            let (after, now) = (of(&world), control.blocks_limit(&world));
            assert!(after.promise >= before.promise && after.rest >= before.rest, "{seed}: {before:?} {after:?}");
            assert!(now >= blocks, "{seed}: {blocks} {now}");
            // What the control knows of severed cells is what a fresh one finds; damping times are those of the start.
            if world.assembly().damping.is_some() || viscous(&world) {
                (before, blocks) = (after, now);
                continue;
            }
            let fresh = StepControl::new(&world, after).blocks_limit(&world);
            assert!((now / fresh - 1.0).abs() < ROUNDING || now == fresh, "{seed}: {now} {fresh}");
            (before, blocks) = (after, now);
        }
    }
}

fn viscous(world: &World) -> bool {
    world.assembly().volume.as_ref().is_some_and(|volume| volume.viscosity.is_some())
}

#[test]
fn nothing_to_limit() {
    let (lattice, assembly) = paper_lattice(&block([1, 1, 1]), &[Some(PAPER)]);
    let topology = Topology::new(&lattice);
    let limits = Limits::at_rest(&lattice, &topology, &assembly);
    assert!(limits.promise.is_infinite() && limits.rest.is_infinite());
    assert!(limits.sharpen(&lattice, &topology, &assembly, 1e6).sharp.is_infinite());
    let world = World::new(lattice, assembly, 1e-2);
    assert!(StepControl::new(&world, limits).look(&world).is_infinite());
}
