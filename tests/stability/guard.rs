//! Steps divided while the tissue is deformed: what would diverge does not.

use super::support::*;
use yawara::dynamics::measure::balance;
use yawara::dynamics::stable_dt::{Limits, SAFETY};
use yawara::dynamics::step_control::{Interval, MOST_PARTS, StepControl, StepCounts};
use yawara::dynamics::{StepError, World};
use yawara::geometry::Vector3;
use yawara::lattice::{Lattice, Topology};
use yawara::material::Assembly;
use yawara::material::paper::PaperBody;
use yawara::material::tissue::{Damping, TissueBody};

/// A world at the sharpest step there is, and its limits.
pub(super) fn sharp((lattice, assembly): (Lattice, Assembly)) -> (World, Limits) {
    let topology = Topology::new(&lattice);
    let limits = Limits::at_rest(&lattice, &topology, &assembly).sharpen(&lattice, &topology, &assembly, 1e5);
    let world = World::new(lattice, assembly, SAFETY * limits.sharp);
    (world, limits)
}

/// Steps a number of frames of ten planned steps; `each` acts before every step.
pub(super) fn guarded(
    world: &mut World,
    limits: Limits,
    frames: u64,
    mut each: impl FnMut(&mut World),
) -> Result<StepCounts, StepError> {
    let mut control = StepControl::new(world, limits);
    let (dt, start) = (world.dt(), world.time());
    for frame in 1..=frames {
        let until = start + 10.0 * frame as f64 * dt;
        let mut interval = Interval::new(until, dt, 10);
        while control.plan(world, &mut interval)? {
            each(world);
            world.step()?;
            control.stepped(world, &mut interval);
        }
        assert!((world.time() / until - 1.0).abs() < 1e-9, "frames come when they are due");
    }
    Ok(control.counts())
}

/// The energy that symplectic Euler keeps of a linear lattice: elastic energy, and kinetic from the velocities on both
/// sides of a step. Plain sums swing by a factor of 40 in modes next to the limit. Infinite when the step diverges.
fn energy(world: &World) -> f64 {
    let mut after = world.clone();
    if after.step().is_err() {
        return f64::INFINITY;
    }
    let (old, new) = (velocities(world), velocities(&after));
    let mass = world.mass().iter().map(|&m| f64::from(m));
    let kinetic = mass.zip(old.iter().zip(&new)).map(|(mass, (old, new))| 0.5 * mass * old.dot(new));
    balance(world).elastic + kinetic.sum::<f64>()
}

fn deform(world: &mut World, map: impl Fn(Vector3) -> Vector3) {
    let mut random = Random::new(3);
    let h = world.lattice().pitch;
    let centre = rest_places(world).iter().sum::<Vector3>() / world.lattice().len() as f64;
    for (p, rest) in particles(world).into_iter().zip(rest_places(world)) {
        let moved = map(rest - centre) + random.vector() * 1e-3 * h;
        world.set_displacement(p, centre + moved - rest);
    }
}

#[test]
fn strong_deformations_are_stepped_in_parts() {
    let mut saved = 0;
    let (mut divided, mut tried) = (0, 0);
    for ratio in [0.0, 0.3] {
        let paper = PaperBody { damping: 2.0 * ratio * (PAPER.stiffness * PAPER.mass).sqrt(), ..PAPER };
        let tissue = TissueBody { damping: Damping::Ratio(ratio), ..TISSUE };
        for (model, lattice) in [
            ("paper", paper_lattice(&block([6, 6, 6]), &[Some(paper)])),
            ("tissue", tissue_lattice(&block([5, 5, 5]), &[Some(tissue)])),
        ] {
            let (rest, limits) = sharp(lattice);
            type Map = fn(Vector3) -> Vector3;
            let maps: [(&str, Map); 4] = [
                ("stretched threefold", |r| Vector3::new(3.0 * r.x, r.y, r.z)),
                ("blown up by a half", |r| 1.5 * r),
                ("compressed to a third", |r| Vector3::new(r.x, r.y, r.z / 3.0)),
                ("sheared", |r| Vector3::new(r.x + 2.0 * r.y, r.y, r.z)),
            ];
            for (name, map) in maps {
                let mut world = rest.clone();
                deform(&mut world, map);
                let before = balance(&world).elastic;
                let mut plain = world.clone();
                let mut peak = 0.0_f64;
                let counts = guarded(&mut world, limits, 20, |world| peak = peak.max(energy(world)))
                    .unwrap_or_else(|error| panic!("{model}, {ratio}, {name}: {error}"));
                assert!(peak < 1.25 * before, "{model}, {ratio}, {name}: energy {before:.3e} J rose to {peak:.3e} J");
                let mut worst = 0.0_f64;
                let diverged = (0..200).any(|_| {
                    let failed = plain.step().is_err();
                    worst = if failed { f64::INFINITY } else { worst.max(energy(&plain)) };
                    failed
                });
                println!(
                    "{model}, {ratio}, {name}: {} steps for 200, {} divided, up to {:.2} parts, {} looks, energy at most \
                     {:.3} of the start; without the guard {:.2e}, diverged: {diverged}",
                    counts.steps,
                    counts.divided,
                    counts.most_parts,
                    counts.looks,
                    peak / before,
                    worst / before
                );
                saved += usize::from(diverged || worst > 2.0 * before);
                divided += usize::from(counts.divided > 0);
                tried += 1;
            }
        }
    }
    assert!(tried == 16 && divided >= 8, "{divided} of {tried} needed more steps");
    assert!(saved >= 4, "{saved} of {tried} would have gone wrong");
}

#[test]
fn a_quiet_run_takes_its_steps_as_planned() {
    let (mut world, limits) = sharp(tissue_lattice(&block([5, 5, 5]), &[Some(TISSUE)]));
    let mut plain = world.clone();
    for world in [&mut world, &mut plain] {
        shake(world, 3e-4, 0.0, 4);
    }
    let counts = guarded(&mut world, limits, 30, |_| {}).unwrap();
    assert_eq!((counts.steps, counts.divided, counts.most_parts), (300, 0, 1.0));
    assert!(counts.looks < 60, "{counts:?}");
    (0..300).for_each(|_| plain.step().unwrap());
    assert_eq!(world.displacements_mm(), plain.displacements_mm(), "watching changes nothing");
}

#[test]
fn beyond_reason_is_refused_with_the_place() {
    let (lattice, mut assembly) = tissue_lattice(&block([4, 4, 4]), &[Some(TISSUE)]);
    let modulus = assembly.mass.iter().map(|_| 2e4).collect();
    assembly.volume = Some(yawara::material::VolumeTerm { modulus, viscosity: None });
    let (mut world, limits) = sharp((lattice, assembly));
    deform(&mut world, |r| 30.0 * r);
    let error = guarded(&mut world, limits, 1, |_| {}).unwrap_err();
    let StepError::TooStiff { limit, most_parts, .. } = &error else { panic!("{error}") };
    assert!(*most_parts == MOST_PARTS && *limit < limits.sharp / 64.0, "{error}");
    assert!(error.to_string().contains("too stiff") && error.to_string().contains("64 parts"), "{error}");
}

#[test]
fn the_same_at_any_number_of_threads() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let (mut world, limits) = sharp(tissue_lattice(&blob([40, 9, 9], 0.9, 3), &[Some(TISSUE), Some(TISSUE)]));
            deform(&mut world, |r| Vector3::new(1.3 * r.x, 0.9 * r.y, r.z));
            let counts = guarded(&mut world, limits, 6, |_| {}).unwrap();
            (limits.sharp.to_bits(), counts, world.displacements_mm())
        })
    };
    let one = run(1);
    assert!(one.1.divided > 0 && one == run(3));
}

/// A grab that is asked for its place before every step moves evenly through divided ones.
#[test]
fn a_grab_moves_smoothly_through_divided_steps() {
    let (mut world, limits) = sharp(tissue_lattice(&block([5, 4, 4]), &[Some(TISSUE)]));
    deform(&mut world, |r| 2.0 * r);
    let some: Vec<u32> = particles(&world).into_iter().filter(|&p| world.lattice().ijk(p)[0] < 2).collect();
    let grab = world.grab(&some);
    let speed = 20.0;
    let mut fastest = 0.0_f64;
    let counts = guarded(&mut world, limits, 10, |world| {
        let offset = Vector3::y() * speed * (world.time() + world.dt());
        world.move_grab(grab, offset);
        fastest = fastest.max(world.velocity(some[0]).norm() * 1e3);
    })
    .unwrap();
    assert!(counts.divided > 0);
    assert!(fastest < 1.02 * speed, "{fastest} mm/s");
}
