//! Relaxation, plasticity and tearing: the fast world against its twin, springs against closed forms.

use std::path::Path;

use yawara::dynamics::World;
use yawara::dynamics::measure::balance;
use yawara::dynamics::reference_world::ReferenceWorld;
use yawara::dynamics::stable_dt::Limits;
use yawara::geometry::Vector3;
use yawara::lattice::{Lattice, SeveredSpring, Topology};
use yawara::material::paper::PaperBody;
use yawara::material::tissue::{Damping, TissueBody};
use yawara::material::{Assembly, Inelastic, OrganInelastic, Plasticity, Relaxation};
use yawara::run::label_lookup::Files;
use yawara::scene;

use crate::support::*;

const RELAXING: Option<Relaxation> = Some(Relaxation { ratio: 0.5, time: 2e-3 });
const YIELDING: Option<Plasticity> = Some(Plasticity { yield_strain: 0.02, time: 1e-3 });

fn with((lattice, mut assembly): (Lattice, Assembly), organs: &[Option<OrganInelastic>]) -> (Lattice, Assembly) {
    assembly.inelastic = Inelastic::new(&lattice, &assembly.stiffness, organs);
    assert!(assembly.inelastic.is_some());
    (lattice, assembly)
}

fn organ(relaxation: Option<Relaxation>, plasticity: Option<Plasticity>) -> Option<OrganInelastic> {
    Some(OrganInelastic { relaxation, plasticity, tear_strain: None })
}

fn tears_at(strain: f64) -> Option<OrganInelastic> {
    Some(OrganInelastic { tear_strain: Some(strain), ..OrganInelastic::default() })
}

/// Two particles, the first held, the other `stretch` [m] further away than at rest along x, and held there if asked.
fn pair(inelastic: Option<OrganInelastic>, dt: f64, stretch: f64) -> World {
    let (lattice, assembly) = with(paper_lattice(&block([2, 1, 1]), &[Some(PAPER)]), &[inelastic]);
    let mut world = World::new(lattice, assembly, dt);
    world.hold(&[0]);
    world.set_displacement(1, Vector3::new(stretch, 0.0, 0.0));
    world
}

/// What pulls the second of a pair back now [N].
fn pull(world: &World) -> f64 {
    let mut next = world.clone();
    next.set_velocity(1, Vector3::zeros());
    next.step().unwrap();
    -next.velocity(1).x * PAPER.mass / world.dt()
}

/// Every law with both effects beside organs without, and bone.
fn worlds() -> Vec<(&'static str, World)> {
    let ragged = |seed| blob([19, 11, 10], 0.6, seed);
    let damped = TissueBody { poissons_ratio: 0.4, damping: Damping::Ratio(0.1), ..TISSUE };
    let other = Some(PaperBody { stiffness: 25.0, damping: 2e-4, mass: 4e-5 });
    let (both, none) = (organ(RELAXING, YIELDING), organ(None, None));
    let at_once = organ(None, Some(Plasticity { yield_strain: 0.05, time: 0.0 }));
    [
        ("one organ of the paper", with(paper_lattice(&ragged(1), &[Some(PAPER); 2]), &[both, both])),
        ("two organs of the paper", with(paper_lattice(&ragged(2), &[Some(PAPER), other]), &[both, at_once])),
        ("bone of the paper", with(paper_lattice(&ragged(3), &[Some(PAPER), None]), &[both, None])),
        ("tissue", with(tissue_lattice(&ragged(4), &[Some(damped), Some(TISSUE)]), &[both, none])),
        ("tissue that yields at once", with(tissue_lattice(&ragged(5), &[Some(TISSUE); 2]), &[at_once, both])),
        (
            "relaxing tissue and bone",
            with(tissue_lattice(&ragged(6), &[Some(TISSUE), None]), &[organ(RELAXING, None), None]),
        ),
    ]
    .map(|(name, lattice)| (name, world(lattice)))
    .into()
}

fn every_twentieth_spring(world: &World) -> Vec<SeveredSpring> {
    let alive = world.topology().alive();
    let starting = |p: u32| (13..26).filter(move |d| alive[p as usize] >> d & 1 == 1).map(move |d| (p, d));
    let chosen = particles(world).into_iter().flat_map(starting).step_by(20);
    chosen.map(|(particle, d)| SeveredSpring { particle, direction: d as u8, at: 0.5, time: 0.0 }).collect()
}

#[test]
fn the_fast_world_is_its_twin() {
    for (name, mut world) in worlds() {
        shake(&mut world, 0.05, 0.05, 7);
        let is_bone: Vec<bool> = world.mass().iter().map(|&mass| mass == 0.0).collect();
        for bone in particles(&world).into_iter().filter(|&p| is_bone[p as usize]) {
            world.set_velocity(bone, Vector3::zeros());
        }
        let severed = every_twentieth_spring(&world);
        assert_eq!(world.sever(severed.clone()), severed.len());
        let mut twin = ReferenceWorld::of(&world);
        let mut elastic = {
            let mut world = world.clone();
            let assembly = Assembly { inelastic: None, ..world.assembly().clone() };
            let (lattice, dt) = (world.lattice().clone(), world.dt());
            let (u, v) = (displacements(&world), velocities(&world));
            world = World::new(lattice, assembly, dt);
            for p in particles(&world) {
                world.set_displacement(p, u[p as usize]);
                world.set_velocity(p, v[p as usize]);
            }
            world.sever(severed);
            world
        };
        for _ in 0..60 {
            world.step().unwrap();
            twin.step().unwrap();
            elastic.step().unwrap();
        }
        let pitch = world.lattice().pitch;
        let off = |other: &[Vector3]| {
            displacements(&world).iter().zip(other).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max) / pitch
        };
        let (off, matters) = (off(twin.displacement()), off(&displacements(&elastic)));
        println!("{name}: off by {off:e} pitches; without, by {matters:e}");
        assert!(off < 1e-5, "{name}: {off:e}");
        assert!(matters > 1e-2, "{name}: nothing flowed");
    }
}

#[test]
fn bits_do_not_depend_on_the_threads_and_rest_is_rest() {
    for (name, start) in worlds() {
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut world = start.clone();
                shake(&mut world, 0.1, 0.02, 10);
                (0..6).for_each(|_| world.step().unwrap());
                (displacements(&world), velocities(&world))
            })
        };
        let one = run(1);
        assert!(one == run(2) && one == run(4), "{name}");
        let mut still = start.clone();
        (0..5).for_each(|_| still.step().unwrap());
        assert!(displacements(&still).iter().all(|&u| u == Vector3::zeros()), "{name}");
    }
}

#[test]
fn a_stretched_spring_relaxes_as_a_standard_linear_solid() {
    let Relaxation { ratio, time } = RELAXING.unwrap();
    let (stretch, dt) = (1e-4, 2e-6);
    let mut world = pair(organ(RELAXING, None), dt, stretch);
    let elastic = PAPER.stiffness * stretch;
    let at_first = pull(&world);
    assert!((at_first / (elastic * (1.0 + ratio)) - 1.0).abs() < 1e-5, "{at_first:e}");
    world.hold(&[1]);
    world.set_displacement(1, Vector3::new(stretch, 0.0, 0.0));
    let mut worst = 0.0_f64;
    for _ in 0..5 {
        (0..800).for_each(|_| world.step().unwrap());
        let left = (-world.time() / time).exp();
        let expected = 0.5 * PAPER.stiffness * stretch * stretch * (1.0 + ratio * left * left);
        worst = worst.max((balance(&world).elastic / expected - 1.0).abs());
    }
    println!("energy off by {worst:e}");
    // Half a step of backward Euler over the time.
    assert!(worst < dt / time, "{worst:e}");
}

/// `m x'' = -k x - ratio k (x - q)`, `q' = (x - q) / time`: against a Runge-Kutta solution, with an error of first order.
#[test]
fn a_relaxing_spring_swings_as_its_equation_says() {
    let Relaxation { ratio, time } = RELAXING.unwrap();
    let (k, m, start) = (PAPER.stiffness, PAPER.mass, 1e-4);
    let end = 0.012;
    let exact = {
        let rate = |[x, v, q]: [f64; 3]| [v, -(k * x + ratio * k * (x - q)) / m, (x - q) / time];
        let along = |s: [f64; 3], r: [f64; 3], h: f64| std::array::from_fn(|i| s[i] + h * r[i]);
        let (mut s, h) = ([start, 0.0, 0.0], end / 1e5);
        for _ in 0..100_000 {
            let a = rate(s);
            let b = rate(along(s, a, 0.5 * h));
            let c = rate(along(s, b, 0.5 * h));
            let d = rate(along(s, c, h));
            s = std::array::from_fn(|i| s[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
        }
        s[0]
    };
    let error = |steps: u32| {
        let mut world = pair(organ(RELAXING, None), end / f64::from(steps), start);
        (0..steps).for_each(|_| world.step().unwrap());
        (world.displacement(1).x - exact).abs() / start
    };
    let errors = [500, 1000, 2000, 4000].map(error);
    println!("at the end {:.3} of the first stretch; errors {errors:?}", exact / start);
    assert!(exact.abs() < 0.5 * start, "it dies down");
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((order - 1.0).abs() < 0.15, "order {order}");
    }
}

#[test]
fn a_spring_yields_beyond_its_strain_and_stays_longer() {
    let pitch = pair(organ(RELAXING, None), 1e-6, 0.0).lattice().pitch;
    let (yields_at, time) = (0.05, 4e-4);
    let limit = yields_at * pitch;
    for way in [1.0, -1.0] {
        // At once.
        let plasticity = Some(Plasticity { yield_strain: yields_at, time: 0.0 });
        let mut world = pair(organ(None, plasticity), 1e-6, way * 0.9 * limit);
        world.step().unwrap();
        assert!((pull(&world) / (way * PAPER.stiffness * 0.9 * limit) - 1.0).abs() < 1e-3, "not yet");
        world.set_displacement(1, Vector3::new(way * 3.0 * limit, 0.0, 0.0));
        world.set_velocity(1, Vector3::zeros());
        world.step().unwrap();
        let place = world.displacement(1).x;
        assert!((pull(&world) / (way * PAPER.stiffness * limit) - 1.0).abs() < 1e-4, "the yield force and no more");
        let stays = place - way * limit;
        assert!((balance(&world).elastic / (0.5 * PAPER.stiffness * limit * limit) - 1.0).abs() < 1e-4);
        world.set_displacement(1, Vector3::new(stays, 0.0, 0.0));
        assert!(pull(&world).abs() < 1e-4 * PAPER.stiffness * limit, "without force where it was drawn out to");
        // In time.
        let plasticity = Some(Plasticity { yield_strain: yields_at, time });
        let dt = 1e-6;
        let mut world = pair(organ(None, plasticity), dt, way * 3.0 * limit);
        world.hold(&[1]);
        (0..400).for_each(|_| world.step().unwrap());
        let strain = 1.0 + 2.0 * (-world.time() / time).exp();
        let expected = 0.5 * PAPER.stiffness * (strain * limit).powi(2);
        let off = balance(&world).elastic / expected - 1.0;
        println!("way {way}: energy off by {off:e}");
        assert!(off.abs() < 2.0 * dt / time, "{off:e}");
    }
    // Never beyond half its length.
    let at_once = organ(None, Some(Plasticity { yield_strain: yields_at, time: 0.0 }));
    let mut world = pair(at_once, 1e-6, 2.0 * pitch);
    world.hold(&[1]);
    world.step().unwrap();
    assert!((balance(&world).elastic / (0.5 * PAPER.stiffness * (1.5 * pitch).powi(2)) - 1.0).abs() < 1e-5);
}

/// A bar is drawn out; it tears where its springs bear least, in the step in which they are stretched that far.
#[test]
fn a_bar_tears_at_its_strain_where_it_is_weakest() {
    let map = organ_map([12, 1, 1], |[i, _, _]| u8::from((5..8).contains(&i)));
    let lattice = paper_lattice(&map, &[Some(PaperBody { damping: 0.02, ..PAPER }); 2]);
    let mut world = world(with(lattice, &[tears_at(0.5), tears_at(0.2)]));
    let pitch = world.lattice().pitch;
    world.hold(&[0]);
    let grab = world.grab(&[11]);
    let mut torn_at = None;
    for step in 1..12_000 {
        world.move_grab(grab, Vector3::new(f64::from(step) * 1e-3, 0.0, 0.0));
        world.step().unwrap();
        if !world.topology().severed().is_empty() {
            torn_at = Some(world.displacement(11).x / (11.0 * pitch));
            break;
        }
    }
    let strain = torn_at.expect("it tears");
    let torn = world.topology().severed();
    println!("torn at a mean strain of {strain:.4}: {torn:?}");
    // Drawn slowly, the strain is the same everywhere but for waves of the dragging end.
    assert!((strain - 0.2).abs() < 0.01, "{strain}");
    // Springs between two of the weak three; those at a wall bear the mean.
    assert!(torn.iter().all(|spring| (5..7).contains(&spring.particle) && spring.at == 0.5));
    assert!(torn.len() <= 2 && world.torn() == Some(torn.len() as u64));
}

/// Tissue that tears beside tissue that does not: the wall holds, and so does what is stretched too little.
#[test]
fn only_what_is_overstretched_tears() {
    let map = organ_map([12, 6, 6], |[i, _, _]| u8::from(i < 6));
    let mut world = world(with(tissue_lattice(&map, &[Some(TISSUE); 2]), &[tears_at(0.1), organ(None, None)]));
    let middle = 7;
    for p in particles(&world) {
        // Drawn out by 8 % along x, by 12 % beyond the middle: the grid has a layer of nothing around the body.
        let x = (world.lattice().ijk(p)[0] as f64 - 1.0) * world.lattice().pitch;
        let wall = f64::from(middle - 1 + 2) * world.lattice().pitch;
        let stretch = 0.08 * x + 0.04 * (x - wall).max(0.0);
        world.set_displacement(p, Vector3::new(stretch, 0.0, 0.0));
    }
    let before = world.topology().alive().to_vec();
    world.step().unwrap();
    let torn = world.topology().severed().to_vec();
    let (mut faces, mut others) = (0, 0);
    for spring in &torn {
        let i = world.lattice().ijk(spring.particle)[0] as i32;
        assert!(i > middle, "torn at {i}");
        let straight = usize::from(spring.direction) == yawara::lattice::neighbours::direction_of([1, 0, 0]);
        if straight { faces += 1 } else { others += 1 }
    }
    // Diagonals are stretched by half of it, and less.
    println!("{faces} springs along x, {others} others");
    assert!(faces > 100 && others == 0, "{faces}, {others}");
    assert_ne!(before, world.topology().alive());
    (0..5).for_each(|_| world.step().unwrap());
}

#[test]
fn the_stable_step_counts_branches() {
    for (name, bare) in [
        ("paper", paper_lattice(&block([9, 8, 7]), &[Some(PAPER)])),
        ("tissue", tissue_lattice(&block([9, 8, 7]), &[Some(TISSUE)])),
    ] {
        let topology = Topology::new(&bare.0);
        let (lattice, assembly) = with(bare, &[organ(Some(Relaxation { ratio: 3.0, time: 1e3 }), None)]);
        let without = Assembly { inelastic: None, ..assembly.clone() };
        let limits = |assembly: &Assembly| {
            Limits::at_rest(&lattice, &topology, assembly).sharpen(&lattice, &topology, assembly, 1e6)
        };
        let (with, without) = (limits(&assembly), limits(&without));
        for (a, b) in [(with.promise, without.promise), (with.rest, without.rest), (with.sharp, without.sharp)] {
            assert!((b / a - 2.0).abs() < 1e-3, "{name}: {a:e} of {b:e}");
        }
        // It holds at 0.99 of the limit, without end.
        let mut world = World::new(lattice.clone(), assembly, 0.99 * with.sharp);
        shake(&mut world, 1e-3, 0.0, 3);
        let before = balance(&world).elastic;
        (0..3000).for_each(|_| world.step().unwrap());
        let after = balance(&world);
        assert!(after.elastic + after.kinetic < 20.0 * before, "{name}");
    }
}

#[test]
fn scenes_are_checked() {
    let scene = |organ: &str, time: &str| {
        let text = format!(
            "[volume]\nphantom = \"cube\"\nspacing = 5.0\n[time]\nduration = 0.1\nframes = 1\n{time}\
             [[organ]]\nname = \"cube\"\nlabel = \"cube\"\n{organ}\n"
        );
        scene::parse(&text, Path::new("s.toml"), Path::new("/"), &Files)
    };
    let tissue = "youngs_modulus = 5e3\ndensity = 1000\n";
    for (organ, key) in [
        ("rigid = true\nrelaxation = { ratio = 0.5, time = 0.1 }", "relaxation"),
        ("rigid = true\ntear_strain = 0.5", "tear_strain"),
        (&format!("{tissue}relaxation = {{ ratio = -1, time = 0.1 }}"), "relaxation.ratio"),
        (&format!("{tissue}relaxation = {{ ratio = 1, time = 0 }}"), "relaxation.time"),
        (&format!("{tissue}plasticity = {{ yield_strain = 0.9 }}"), "plasticity.yield_strain"),
        (&format!("{tissue}plasticity = {{ yield_strain = 0.1, time = -1 }}"), "plasticity.time"),
        (&format!("{tissue}tear_strain = 0"), "tear_strain"),
    ] {
        let error = scene(organ, "").unwrap_err().to_string();
        assert!(error.contains(key), "{organ}: {error}");
    }
    let tears = format!("{tissue}tear_strain = 0.5");
    assert!(scene(&tears, "").is_ok());
    let error = scene(&tears, "integrator = \"verlet\"\n").unwrap_err().to_string();
    assert!(error.contains("time.integrator") && error.contains("tears"), "{error}");
}
