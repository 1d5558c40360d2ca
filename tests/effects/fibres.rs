//! Fibres: fast body against reference, force against energy, bars against closed forms, and the stable step.

use std::path::Path;

use nalgebra::{DMatrix, Rotation3, Unit};
use yawara::dynamics::World;
use yawara::dynamics::measure::balance;
use yawara::dynamics::reference_world::ReferenceWorld;
use yawara::dynamics::stable_dt::Limits;
use yawara::dynamics::step_control::StepControl;
use yawara::geometry::{Affine, Matrix3, Vector3};
use yawara::kernel::reference::{cell_fibre_energy, fibre_forces, spring_forces, volume_forces};
use yawara::lattice::build::OrganMap;
use yawara::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS};
use yawara::lattice::{Lattice, SeveredSpring, Topology};
use yawara::material::tissue::{Damping, TissueBody};
use yawara::material::{Assembly, FibreTerm, Fibres};
use yawara::run::label_lookup::Files;
use yawara::scene;

use crate::support::*;

/// Extra modulus along the fibres [Pa].
const STIFF: f64 = 2e4;

fn along(direction: [f64; 3], modulus: f64) -> Option<Fibres> {
    Some(Fibres { direction: direction.into(), modulus })
}

fn fibrous(map: &OrganMap, bodies: &[Option<TissueBody>], fibres: &[Option<Fibres>]) -> (Lattice, Assembly) {
    let (lattice, mut assembly) = tissue_lattice(map, bodies);
    assembly.fibres = FibreTerm::new(&lattice, fibres);
    assert!(assembly.fibres.is_some());
    (lattice, assembly)
}

fn body(poissons_ratio: f64, damping: f64) -> TissueBody {
    TissueBody { poissons_ratio, damping: Damping::Ratio(damping), ..TISSUE }
}

/// Springs and volume terms, then fibres.
fn reference_forces(world: &World) -> (Vec<Vector3>, Vec<Vector3>) {
    let (u, v) = (displacements(world), velocities(world));
    let (lattice, topology, assembly) = (world.lattice(), world.topology(), world.assembly());
    let springs = spring_forces(lattice, topology, assembly, &u, &v, world.dt());
    let volume = volume_forces(lattice, topology, assembly, &u, &v, world.dt());
    let others = springs.iter().zip(&volume).map(|(a, b)| a + b).collect();
    (others, fibre_forces(lattice, topology, assembly, &u))
}

fn largest(forces: &[Vector3]) -> f64 {
    forces.iter().map(Vector3::norm).fold(0.0, f64::max)
}

/// Fast and general bodies, with and without volume terms and viscosity, beside organs without fibres and bone.
fn worlds() -> Vec<(String, World)> {
    let full = block([40, 20, 20]);
    let ragged = |seed| blob([21, 19, 17], 0.6, seed);
    let (oblique, edge) = (along([1.0, -2.0, 0.5], STIFF), along([0.0, 0.0, 1.0], 5e3));
    let both = [oblique, edge];
    [
        ("block", fibrous(&full, &[Some(body(0.25, 0.0))], &[oblique])),
        ("block, damped", fibrous(&full, &[Some(body(0.25, 0.3))], &[edge])),
        ("block, volume", fibrous(&full, &[Some(body(0.45, 0.0))], &[oblique])),
        ("block, viscous volume", fibrous(&full, &[Some(body(0.45, 0.3))], &[oblique])),
        ("blob", fibrous(&ragged(1), &[Some(body(0.25, 0.0)); 2], &both)),
        ("blob, volume", fibrous(&ragged(2), &[Some(body(0.4, 0.0)), Some(TISSUE)], &[None, edge])),
        ("blob, viscous volume", fibrous(&ragged(3), &[Some(body(0.45, 0.3)), Some(body(0.25, 0.1))], &both)),
        ("bone beside", fibrous(&ragged(4), &[Some(body(0.45, 0.3)), None], &[oblique, None])),
    ]
    .into_iter()
    .map(|(name, lattice)| (name.to_owned(), world(lattice)))
    .collect()
}

fn some_springs(world: &World, share: f64, seed: u64) -> Vec<SeveredSpring> {
    let mut random = Random::new(seed);
    let mut springs = Vec::new();
    for particle in particles(world) {
        for direction in FIRST_FORWARD..NEIGHBOURS {
            if world.topology().alive()[particle as usize] >> direction & 1 == 1 && random.unit() < share {
                springs.push(SeveredSpring { particle, direction: direction as u8, at: 0.5, time: 0.0 });
            }
        }
    }
    springs
}

fn check_against_reference(name: &str, world: &mut World) {
    let before = velocities(world);
    let (others, fibres) = reference_forces(world);
    assert!(largest(&fibres) > 0.02 * largest(&others), "{name}: the fibres matter");
    world.step().unwrap_or_else(|error| panic!("{name}: {error}"));
    let expected: Vec<Vector3> = others.iter().zip(&fibres).map(|(a, b)| a + b).collect();
    let mut worst = 0.0_f64;
    for (particle, before) in before.iter().enumerate() {
        let mass = f64::from(world.mass()[particle]);
        let change = world.velocity(particle as u32) - before;
        if mass == 0.0 {
            assert_eq!(change, Vector3::zeros(), "{name}: bone moved");
            continue;
        }
        // The velocity itself is rounded to f32: 6e-8 of its size, seen as a force.
        let rounding = 1e-7 * before.norm() * mass / world.dt();
        worst = worst.max((change * mass / world.dt() - expected[particle]).norm() - rounding);
    }
    assert!(worst <= 2e-5 * largest(&expected), "{name}: off by {worst:e} N of {:e} N", largest(&expected));
}

#[test]
fn the_fast_body_agrees_with_the_reference() {
    for (name, mut world) in worlds() {
        shake(&mut world, 0.15, 0.02, 7);
        check_against_reference(&name, &mut world);
        let severed = some_springs(&world, 0.05, 8);
        assert_eq!(world.sever(severed.clone()), severed.len());
        check_against_reference(&format!("{name}, severed"), &mut world);
    }
}

#[test]
fn the_fast_world_is_its_twin() {
    let map = blob([7, 6, 5], 0.8, 5);
    let fibres = [along([1.0, 1.0, 0.0], STIFF), along([0.0, 1.0, 2.0], STIFF)];
    let mut world = world(fibrous(&map, &[Some(body(0.4, 0.1)), Some(body(0.25, 0.0))], &fibres));
    shake(&mut world, 0.05, 0.05, 6);
    let mut twin = ReferenceWorld::of(&world);
    let before = twin.energy();
    for _ in 0..60 {
        world.step().unwrap();
        twin.step().unwrap();
    }
    let off = displacements(&world).iter().zip(twin.displacement()).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    println!("off by {:e} pitches", off / world.lattice().pitch);
    assert!(off < 1e-5 * world.lattice().pitch, "{off:e}");
    assert!(twin.energy() < before, "dampers take energy");
}

#[test]
fn bits_do_not_depend_on_the_body_or_the_threads() {
    for (name, world) in worlds() {
        let run = |threads: usize, general: bool| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut world = world.clone();
                if general {
                    world.forget_alike_blocks();
                }
                shake(&mut world, 0.1, 0.02, 10);
                for step in 0..6 {
                    if step == 3 {
                        world.sever(some_springs(&world, 0.01, 11));
                    }
                    world.step().unwrap();
                }
                (displacements(&world), velocities(&world))
            })
        };
        let one = run(1, false);
        assert!(one == run(2, false), "{name}: 2 threads");
        assert!(one == run(4, true), "{name}: general body, 4 threads");
    }
}

#[test]
fn cells_without_fibres_leave_every_bit() {
    let (lattice, assembly) = tissue_lattice(&block([20, 10, 10]), &[Some(body(0.45, 0.2))]);
    let none = FibreTerm { root: vec![[0.0; 3]; lattice.len()] };
    let run = |assembly: Assembly| {
        let mut world = world((lattice.clone(), assembly));
        shake(&mut world, 0.1, 0.05, 12);
        (0..5).for_each(|_| world.step().unwrap());
        (displacements(&world), velocities(&world))
    };
    assert!(run(assembly.clone()) == run(Assembly { fibres: Some(none), ..assembly }));
}

#[test]
fn the_force_is_minus_the_gradient_of_the_energy() {
    let fibres = [along([1.0, -2.0, 0.5], STIFF), along([0.0, 0.0, 1.0], 5e3)];
    let (lattice, assembly) = fibrous(&blob([3, 3, 3], 0.8, 1), &[Some(TISSUE), Some(TISSUE)], &fibres);
    let (topology, term) = (Topology::new(&lattice), assembly.fibres.clone().unwrap());
    let h = lattice.pitch;
    let energy = |u: &[Vector3]| -> f64 {
        (0..lattice.len() as u32).map(|c| cell_fibre_energy(&lattice, &topology, &term, c, |p| u[p as usize])).sum()
    };
    // Drawn out by half, so that all are taut, and as it comes, some slack.
    for even in [0.5, 0.0] {
        let mut random = Random::new(2);
        let place = |p: usize| Vector3::from(lattice.ijk(p as u32).map(|n| n as f64)) * h;
        let mut u: Vec<Vector3> = (0..lattice.len()).map(|p| place(p) * even + random.vector() * 0.3 * h).collect();
        let force = fibre_forces(&lattice, &topology, &assembly, &u);
        let mut worst = 0.0_f64;
        let step = 1e-3 * h;
        for particle in 0..lattice.len() {
            for axis in 0..3 {
                let start = u[particle][axis];
                let mut at = |offset: f64| {
                    u[particle][axis] = start + offset * step;
                    energy(&u)
                };
                let slope = (8.0 * (at(1.0) - at(-1.0)) - (at(2.0) - at(-2.0))) / (12.0 * step);
                u[particle][axis] = start;
                worst = worst.max((force[particle][axis] + slope).abs() / largest(&force));
            }
        }
        println!("stretched by {even}: force against energy {worst:e}");
        assert!(worst < 1e-8, "{worst:e}");
    }
}

#[test]
fn a_rigid_rotation_has_no_force() {
    let axis = Unit::new_normalize(Vector3::new(1.0, -2.0, 0.5));
    for degrees in [1.0_f64, 30.0, 90.0, 179.0] {
        let turn = Rotation3::from_axis_angle(&axis, degrees.to_radians()).into_inner();
        let mut world = world(fibrous(&block([9, 8, 7]), &[Some(TISSUE)], &[along([2.0, 1.0, -1.0], STIFF)]));
        let rest = rest_places(&world);
        particles(&world)
            .into_iter()
            .for_each(|p| world.set_displacement(p, (turn - Matrix3::identity()) * rest[p as usize]));
        // What one per cent of stretch would give.
        let grown: Vec<Vector3> = rest.iter().map(|r| r * 0.01).collect();
        let scale = largest(&fibre_forces(world.lattice(), world.topology(), world.assembly(), &grown));
        assert!(largest(&reference_forces(&world).1) < 1e-3 * scale, "{degrees} degrees");
        world.step().unwrap();
        let kick = particles(&world)
            .into_iter()
            .map(|p| world.velocity(p).norm() * f64::from(world.mass()[p as usize]) / world.dt())
            .fold(0.0, f64::max);
        assert!(kick < 1e-3 * scale, "{degrees} degrees: {:e}", kick / scale);
    }
}

#[test]
fn momentum_and_energy_are_kept() {
    let fibres = [along([1.0, -2.0, 0.5], STIFF), along([0.0, 0.0, 1.0], 5e3)];
    let map = blob([12, 12, 12], 0.6, 2);
    let mut world = world(fibrous(&map, &[Some(body(0.4, 0.0)), Some(TISSUE)], &fibres));
    shake(&mut world, 0.03, 0.02, 3);
    let before = balance(&world);
    let without = {
        let assembly = Assembly { fibres: None, ..world.assembly().clone() };
        let mut bare = World::new(world.lattice().clone(), assembly, world.dt());
        particles(&world).into_iter().for_each(|p| bare.set_displacement(p, world.displacement(p)));
        balance(&bare).elastic
    };
    assert!(before.elastic > 1.05 * without, "the fibres hold energy: {} of {}", without, before.elastic);
    let scale: f64 =
        particles(&world).iter().map(|&p| f64::from(world.mass()[p as usize]) * world.velocity(p).norm()).sum();
    let arm = rest_places(&world).iter().map(Vector3::norm).fold(0.0, f64::max);
    let mut total = Vec::new();
    for _ in 0..1500 {
        world.step().unwrap();
        let now = balance(&world);
        total.push((now.kinetic + now.elastic) / (before.kinetic + before.elastic));
    }
    let after = balance(&world);
    let linear = (after.momentum - before.momentum).norm() / scale;
    let angular = (after.angular_momentum - before.angular_momentum).norm() / (scale * arm);
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    let (early, late) = (mean(&total[..300]), mean(&total[1200..]));
    println!("momentum {linear:e}, angular momentum {angular:e}, energy {early:.4} then {late:.4}");
    assert!(linear < 2e-6 && angular < 2e-6, "{linear:e} {angular:e}");
    assert!((late / early - 1.0).abs() < 0.03, "energy drifts from {early} to {late}");
}

/// A free bar under opposite tractions at its ends, at rest. Its slope: stress over strain, extrapolated to no load.
struct Bar {
    body: TissueBody,
    /// Cells across, and along.
    cells: [usize; 2],
    fibres: Option<Fibres>,
    /// Of the whole bar in the patient's axes.
    turn: Matrix3,
    /// Of the load and the bar as it is pulled.
    swing: Matrix3,
}

impl Bar {
    fn slope(&self, stress: f64) -> f64 {
        2.0 * self.secant(stress) - self.secant(2.0 * stress)
    }

    /// Size 18 x 6 x 6 mm.
    fn secant(&self, stress: f64) -> f64 {
        let [across, length] = self.cells;
        let pitch = 6.0 / across as f64;
        let affine = Affine::from_parts(self.turn * pitch, Vector3::new(5.0, -8.0, 3.0)).unwrap();
        let (lattice, mut assembly) =
            tissue_lattice(&block_placed(affine, [length, across, across]), &[Some(self.body)]);
        assembly.fibres = self.fibres.and_then(|fibres| FibreTerm::new(&lattice, &[Some(fibres)]));
        let topology = Topology::new(&lattice);
        let dt = 0.8 * Limits::at_rest(&lattice, &topology, &assembly).promise;
        let mut world = World::new(lattice, assembly, dt);
        let end = |world: &World, i: usize| -> Vec<u32> {
            particles(world).into_iter().filter(|&p| world.lattice().ijk(p)[0] == i).collect()
        };
        let ends = [end(&world, 1), end(&world, length + 1)];
        let rest = rest_places(&world);
        for p in particles(&world) {
            world.set_displacement(p, (self.swing - Matrix3::identity()) * rest[p as usize]);
        }
        // Shared by mass, so by the area of each corner.
        let force = self.turn * self.swing * Vector3::x() * (stress * 36e-6);
        for (particles, sign) in ends.iter().zip([-1.0, 1.0]) {
            let push = world.push(particles);
            world.set_force(push, force * sign);
        }
        let speed = (self.body.youngs_modulus / self.body.density).sqrt();
        // Twice the angular frequency of the slowest stretch.
        let rate = 2.0 * std::f64::consts::PI * speed / 18e-3;
        world.set_drag(rate);
        // Bending is overdamped at this rate.
        while world.time() < 120.0 / rate {
            world.step().unwrap();
        }
        let mean = |particles: &[u32]| {
            particles.iter().map(|&p| rest[p as usize] + world.displacement(p)).sum::<Vector3>()
                / particles.len() as f64
        };
        let pulled = (mean(&ends[1]) - mean(&ends[0])).norm();
        stress / (pulled / 18e-3 - 1.0)
    }
}

/// Young's modulus of a bar whose fibres run at an angle to it, while they are taut: isotropic compliance less a form of rank
/// one (Sherman and Morrison).
fn oblique_modulus(young: f64, nu: f64, fibres: f64, cosine: f64) -> f64 {
    let part = ((1.0 + nu) * cosine * cosine - nu) / young;
    1.0 / (1.0 / young - fibres * part * part / (1.0 + fibres / young))
}

#[test]
fn a_bar_is_stiffer_along_its_fibres_and_not_across_at_every_pitch() {
    let young = TISSUE.youngs_modulus;
    for nu in [0.25, 0.4] {
        for across in [2, 3, 4] {
            let bar = |fibres| Bar {
                body: body(nu, 0.0),
                cells: [across, 3 * across],
                fibres,
                turn: Matrix3::identity(),
                swing: Matrix3::identity(),
            };
            let pull = 1e-3 * young;
            let found = [
                ("no fibres", bar(None).slope(pull), young),
                ("along", bar(along([1.0, 0.0, 0.0], STIFF)).slope(4.0 * pull), young + STIFF),
                ("across", bar(along([0.0, 0.6, 0.8], STIFF)).slope(pull), young),
                ("pressed along", bar(along([1.0, 0.0, 0.0], STIFF)).slope(-pull), young),
                (
                    "at 45 degrees",
                    bar(along([1.0, 1.0, 0.0], STIFF)).slope(pull),
                    oblique_modulus(young, nu, STIFF, 0.5_f64.sqrt()),
                ),
                (
                    "along the diagonal",
                    bar(along([1.0, 1.0, 1.0], STIFF)).slope(pull),
                    oblique_modulus(young, nu, STIFF, (1.0_f64 / 3.0).sqrt()),
                ),
            ];
            for (name, slope, expected) in found {
                println!("nu {nu}, {across} cells, {name}: {slope:.1} Pa, expected {expected:.1}");
                assert!((slope / expected - 1.0).abs() < 3e-3, "nu {nu}, {across} cells, {name}: {slope} {expected}");
            }
        }
    }
}

#[test]
fn a_turned_bar_is_the_same() {
    let turn = Rotation3::from_euler_angles(0.4, -1.1, 2.0).into_inner();
    let along_it = |turn: Matrix3| Some(Fibres { direction: turn * Vector3::x(), modulus: STIFF });
    let slope = |placed: Matrix3, swing: Matrix3| {
        Bar { body: TISSUE, cells: [2, 6], fibres: along_it(placed), turn: placed, swing }.slope(100.0)
    };
    let straight = slope(Matrix3::identity(), Matrix3::identity());
    let (placed, swung) = (slope(turn, Matrix3::identity()), slope(Matrix3::identity(), turn));
    println!("{straight:.1} Pa as it lies, {placed:.1} on a turned grid, {swung:.1} turned after it was made");
    assert!((straight / (TISSUE.youngs_modulus + STIFF) - 1.0).abs() < 3e-3);
    assert!((placed / straight - 1.0).abs() < 3e-3 && (swung / straight - 1.0).abs() < 5e-3);
}

/// Largest eigenvalue of `M^-1/2 K M^-1/2`, by differences of the reference's forces.
fn largest_eigenvalue(world: &World, u: &[Vector3]) -> f64 {
    let (lattice, topology, assembly) = (world.lattice(), world.topology(), world.assembly());
    let still = vec![Vector3::zeros(); u.len()];
    let forces = |u: &[Vector3]| -> Vec<Vector3> {
        let springs = spring_forces(lattice, topology, assembly, u, &still, 1.0);
        let volume = volume_forces(lattice, topology, assembly, u, &still, 1.0);
        let fibres = fibre_forces(lattice, topology, assembly, u);
        springs.iter().zip(&volume).zip(&fibres).map(|((a, b), c)| a + b + c).collect()
    };
    let n = 3 * u.len();
    let root = |i: usize| f64::from(assembly.mass[i / 3]).sqrt();
    let step = 1e-6 * lattice.pitch;
    let mut matrix = DMatrix::zeros(n, n);
    for column in 0..n {
        let at = |sign: f64| {
            let mut moved = u.to_vec();
            moved[column / 3][column % 3] += sign * step;
            forces(&moved)
        };
        let (plus, minus) = (at(1.0), at(-1.0));
        for row in 0..n {
            let slope = (minus[row / 3][row % 3] - plus[row / 3][row % 3]) / (2.0 * step);
            matrix[(row, column)] = slope / (root(row) * root(column));
        }
    }
    let symmetric = (&matrix + matrix.transpose()) * 0.5;
    symmetric.symmetric_eigenvalues().max()
}

#[test]
fn the_limits_hold_against_dense_eigenvalues() {
    let mut closest = [0.0_f64; 3];
    for seed in 0..12 {
        let mut random = Random::new(seed);
        let direction = random.vector();
        let modulus = 5e3 * 10_f64.powf(2.0 * random.unit() - 0.5);
        let nu = [0.25, 0.45][seed as usize % 2];
        let map = blob([3, 2, 2], 0.9, seed);
        let fibres = [along(direction.into(), modulus), along([0.0, 0.0, 1.0], modulus)];
        let lattice = fibrous(&map, &[Some(body(nu, 0.0)), Some(TISSUE)], &fibres);
        let topology = Topology::new(&lattice.0);
        let limits = Limits::at_rest(&lattice.0, &topology, &lattice.1);
        let bare = Limits::at_rest(&lattice.0, &topology, &Assembly { fibres: None, ..lattice.1.clone() });
        assert!(limits.rest < bare.rest && limits.promise < bare.promise, "{seed}: fibres are felt");
        let sharp = limits.sharpen(&lattice.0, &topology, &lattice.1, 1e5).sharp;
        let mut world = World::new(lattice.0, lattice.1, 1e-4);
        // As good as at rest, but taut.
        let rest = rest_places(&world);
        let taut: Vec<Vector3> = rest.iter().map(|r| r * 1e-5).collect();
        let exact = 2.0 / largest_eigenvalue(&world, &taut).sqrt();
        for (name, limit) in [("promise", limits.promise), ("rest", limits.rest), ("sharp", sharp)] {
            assert!(limit <= exact * (1.0 + 1e-4), "{seed}: {name} {limit:e} above {exact:e}");
        }
        closest[0] = closest[0].max(limits.rest / exact);
        closest[1] = closest[1].max(sharp / exact);
        // Drawn out unevenly: every fibre taut, and some turned. What twists a cell has its own differences.
        let control = StepControl::new(&world, limits);
        let mut control = control;
        let even = Matrix3::from_fn(|r, c| if r == c { 0.7 } else { 0.4 * (random.unit() - 0.5) });
        for p in particles(&world) {
            world.set_displacement(p, even * rest[p as usize] + random.vector() * 0.08 * world.lattice().pitch);
        }
        let exact = 2.0 / largest_eigenvalue(&world, &displacements(&world)).sqrt();
        let blocks = control.blocks_limit(&world);
        assert!(blocks <= exact * (1.0 + 1e-4), "{seed}: blocks {blocks:e} above {exact:e}");
        if nu == 0.25 {
            assert!(limits.promise <= exact * (1.0 + 1e-4), "{seed}: the promise holds at any stretch");
        }
        closest[2] = closest[2].max(blocks / exact);
    }
    println!(
        "of the true limit, at most: rest {:.3}, sharp {:.3}, blocks of drawn shapes {:.3}",
        closest[0], closest[1], closest[2]
    );
    assert!(closest[1] > 0.95 && closest[2] > 0.5, "{closest:?}");
}

/// Pulled at its ends, fibres stay taut and the limit is that of a linear lattice. At rest they go slack and taut in turn, which
/// hands a little energy to the motion of each step: the least damping takes it away.
#[test]
fn steps_at_the_limit_are_stable() {
    // Stress [Pa], damping ratio, share of the limit.
    let cases = [(400.0, 0.0, 0.99), (400.0, 0.3, 0.99), (0.0, 0.01, 0.99), (0.0, 0.3, 0.99), (0.0, 1e-3, 0.8)];
    for (stress, damping, share) in cases {
        let along_it = along([1.0, 0.3, 0.0], 5e4);
        let (lattice, assembly) = fibrous(&block([3, 3, 3]), &[Some(body(0.25, damping))], &[along_it]);
        let topology = Topology::new(&lattice);
        let limits = Limits::at_rest(&lattice, &topology, &assembly).sharpen(&lattice, &topology, &assembly, 1e5);
        let mut settled = World::new(lattice, assembly, 0.5 * limits.promise);
        for (i, sign) in [(1, -1.0), (4, 1.0)] {
            let end: Vec<u32> = particles(&settled).into_iter().filter(|&p| settled.lattice().ijk(p)[0] == i).collect();
            let push = settled.push(&end);
            settled.set_force(push, Vector3::new(sign * stress * 81e-6, 0.0, 0.0));
        }
        settled.set_drag(500.0);
        while settled.time() < 0.5 {
            settled.step().unwrap();
        }
        settled.set_drag(0.0);
        let limit = StepControl::new(&settled, limits).look(&settled);
        // The furthest any particle gets, from a start at random [pitches].
        let run = |share: f64| {
            let (mut world, start, h) = (settled.clone(), displacements(&settled), settled.lattice().pitch);
            world.set_dt(share * limit);
            let mut random = Random::new(9);
            for p in particles(&world) {
                world.set_displacement(p, start[p as usize] + random.vector() * 1e-4 * h);
                world.set_velocity(p, Vector3::zeros());
            }
            let mut most = 0.0_f64;
            for step in 0..20_000 {
                if world.step().is_err() {
                    return f64::INFINITY;
                }
                if step % 20 == 0 {
                    let off = |p: u32| (world.displacement(p) - start[p as usize]).norm() / h;
                    most = particles(&world).into_iter().map(off).fold(most, f64::max);
                }
            }
            most
        };
        let below = run(share);
        println!("{stress} Pa, damping {damping}: {below:.1e} pitches at {share} of the limit");
        assert!(below < 0.01, "{stress} Pa, damping {damping}: {below}");
        if stress > 0.0 && damping == 0.0 {
            let above = run(1.02);
            println!("{above:.1e} pitches above it");
            assert!(above > 10.0 * below, "{above} pitches above the limit: it is no limit");
        }
    }
}

#[test]
fn a_scene_gives_organs_their_fibres() {
    let text = "[volume]\nphantom = \"cube\"\nspacing = 6\n[[organ]]\nname = \"cube\"\nlabel = \"cube\"\nmaterial = \"muscle\"\n\
                fibres = { direction = [0, 3, 4], modulus = 2e4 }\n[time]\nduration = 0.1\n";
    let scene = scene::parse(text, Path::new("s.toml"), Path::new("/"), &Files).unwrap().0;
    let fibres = scene.organs[0].fibres.expect("fibres");
    assert!((fibres.direction - Vector3::new(0.0, 0.6, 0.8)).norm() < 1e-15 && fibres.modulus == 2e4);
    let prepared = yawara::run::prepare::prepare(&scene, &yawara::run::inputs::load(&scene).unwrap()).unwrap();
    let term = prepared.assembly.fibres.as_ref().expect("fibres");
    let longest = term.root.iter().map(|b| b.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>()).fold(0.0, f64::max);
    assert!((longest / 2e4 - 1.0).abs() < 1e-6);
    // Without dampers a scene is warned, not refused.
    for (damping, warned) in [("damping_ratio = 0.0", true), ("viscosity = 0", true), ("damping_ratio = 0.05", false)] {
        let text = text.replace("material =", &format!("{damping}\nmaterial ="));
        let text = format!("{text}[gravity]\nacceleration = [0, 0, -9.81]\n[[fix]]\nregion = {{ organ = \"cube\" }}\n");
        let warnings = scene::parse(&text, Path::new("s.toml"), Path::new("/"), &Files).unwrap().1;
        let found = warnings.iter().any(|warning| warning.to_string().contains("slack and taut in turn"));
        assert_eq!((found, warnings.len()), (warned, usize::from(warned)), "{damping}");
    }
}
