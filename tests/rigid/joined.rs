//! Bone joined to soft tissue.

use yawara::dynamics::World;
use yawara::dynamics::measure::balance;
use yawara::dynamics::stable_dt::{SAFETY, stable_dt};
use yawara::geometry::Vector3;
use yawara::lattice::Topology;
use yawara::material::paper::PaperBody;
use yawara::material::tissue::{Damping, TissueBody};

use crate::parts::*;
use crate::support::*;

fn shaken(lattice: (yawara::lattice::Lattice, yawara::material::Assembly)) -> World {
    let mut world = world(lattice);
    let mut random = Random::new(7);
    let h = world.lattice().pitch;
    for p in particles(&world) {
        if world.rigid_body_of(p).is_none() {
            world.set_displacement(p, random.vector() * 0.1 * h);
            world.set_velocity(p, random.vector() * 0.2);
        }
    }
    world.set_rigid_motion(0, Vector3::new(0.1, -0.2, 0.05), Vector3::new(5.0, -8.0, 12.0));
    world
}

#[test]
fn momentum_of_bone_and_tissue_together_is_kept_to_rounding() {
    let damped = PaperBody { damping: 1e-3, ..PAPER };
    let tissue = TissueBody { damping: Damping::Ratio(0.3), ..TISSUE };
    for (name, lattice) in [
        ("paper", paper_bone(&bar_in_tissue(), PAPER)),
        ("damped paper", paper_bone(&bar_in_tissue(), damped)),
        ("tissue", tissue_bone(&bar_in_tissue(), TISSUE)),
        ("damped tissue", tissue_bone(&bar_in_tissue(), tissue)),
    ] {
        let mut world = shaken(lattice);
        assert_eq!(world.rigid_bodies().len(), 1, "{name}");
        let before = balance(&world);
        let scale: f64 =
            particles(&world).iter().map(|&p| f64::from(world.mass()[p as usize]) * world.velocity(p).norm()).sum();
        let arm = rest_places(&world).iter().map(Vector3::norm).fold(0.0, f64::max);
        let (mut bone_moved, start) = (0.0_f64, world.rigid_bodies()[0].momentum());
        for _ in 0..500 {
            world.step().unwrap();
            bone_moved = bone_moved.max((world.rigid_bodies()[0].momentum() - start).norm());
        }
        let after = balance(&world);
        let linear = relative(after.momentum - before.momentum, scale);
        let angular = relative(after.angular_momentum - before.angular_momentum, scale * arm);
        eprintln!("{name}: momentum {linear:.1e}, angular momentum {angular:.1e}, bone took {:.2}", bone_moved / scale);
        assert!(bone_moved > 1e-3 * scale, "{name}: the tissue moves the bone");
        // As for soft tissue alone: every velocity is rounded once a step.
        assert!(linear < 1e-6, "{name}: momentum changed by {linear:e}");
        assert!(angular < 1e-6, "{name}: angular momentum changed by {angular:e}");
        let shape = distortion(&world, &world.rigid_bodies()[0]) / world.lattice().pitch;
        assert!(shape < 1e-6, "{name}: shape {shape:e} pitches");
    }
}

#[test]
fn energy_stays_bounded_at_the_bound_of_the_step() {
    let (lattice, assembly) = paper_bone(&bar_in_tissue(), PAPER);
    let bound = stable_dt(&lattice, &Topology::new(&lattice), &assembly);
    let run = |dt: f64, light: bool| {
        let mut assembly = assembly.clone();
        if light {
            // Bone a tenth as heavy as tissue.
            for (m, p) in assembly.mass.iter_mut().zip(0..) {
                *m = if lattice.organ[p] == 1 { 3e-6 } else { *m };
            }
        }
        let bound = stable_dt(&lattice, &Topology::new(&lattice), &assembly);
        let mut world = World::new(lattice.clone(), assembly, dt * bound);
        let mut random = Random::new(3);
        for p in particles(&world).into_iter().filter(|&p| world.rigid_body_of(p).is_none()).collect::<Vec<_>>() {
            world.set_displacement(p, random.vector() * 1e-3 * 3e-3);
        }
        let before = balance(&world);
        let most = (0..400)
            .map(|_| {
                for _ in 0..11 {
                    world.step().unwrap();
                }
                let now = balance(&world);
                now.kinetic + now.elastic
            })
            .fold(0.0, f64::max);
        most / (before.kinetic + before.elastic)
    };
    assert!(bound > 0.0);
    for light in [false, true] {
        let most = run(SAFETY, light);
        eprintln!("light {light}: energy up to {most:.2} of the start");
        assert!(most < 3.0, "light {light}: {most}");
    }
}

/// One layer of springs between held tissue and a block of bone: a mass on a spring, in closed form.
#[test]
fn bone_hangs_and_swings_on_its_springs() {
    // Soft top layer, bone below: with the soft layer held, nothing moves but the bone.
    let map = organ_map([5, 5, 5], |[_, _, k]| u8::from(k < 4));
    let (lattice, assembly) = paper_bone(&map, PAPER);
    let dt = 0.02 * stable_dt(&lattice, &Topology::new(&lattice), &assembly);
    let mut world = World::new(lattice, assembly, dt);
    let top: Vec<u32> = particles(&world).into_iter().filter(|&p| world.lattice().organ[p as usize] == 0).collect();
    world.hold(&top);
    // Stiffness along z of the springs from bone to tissue: k cos^2 each.
    let mut stiffness = 0.0;
    for &p in &top {
        for d in (0..26).filter(|d| world.topology().alive()[p as usize] >> d & 1 == 1) {
            let other = world.lattice().neighbour(p, d).unwrap();
            if world.rigid_body_of(other).is_some() {
                let [x, y, z] = yawara::lattice::neighbours::OFFSETS[d].map(f64::from);
                stiffness += PAPER.stiffness * z * z / (x * x + y * y + z * z);
            }
        }
    }
    let mass = world.rigid_bodies()[0].mass();
    assert!((mass - 100.0 * BONE * 2.7e-8).abs() < 1e-8);
    let start = Vector3::new(0.0, 0.0, -3e-4 * world.lattice().pitch);
    let bone = *world.rigid_bodies()[0].particles().first().unwrap();
    world.set_displacement(bone, start);
    assert!(world.rigid_bodies()[0].particles().iter().all(|&p| (world.displacement(p) - start).norm() < 1e-12));
    // Symplectic Euler: s_n = s_0 cos((n + 1/2) a) / cos(a / 2), 2 sin(a / 2) = w dt.
    let a = 2.0 * (0.5 * (stiffness / mass).sqrt() * dt).asin();
    let steps = (4.0 * std::f64::consts::TAU / a) as i32;
    let mut worst = 0.0_f64;
    for n in 1..=steps {
        world.step().unwrap();
        let expected = start.z * ((f64::from(n) + 0.5) * a).cos() / (0.5 * a).cos();
        worst = worst.max((world.displacement(bone).z - expected).abs() / start.z.abs());
    }
    eprintln!("four swings of {steps} steps: within {worst:.1e} of the amplitude");
    // Oblique springs bend the law by the stretch itself, 3e-4; forces are f32 differences of lengths, 6e-8 of the length
    // against a stretch of 3e-4, each.
    assert!(worst < 1e-3, "{worst:e}");
}

/// Seconds of a swing of heavy bone on a bar of `n` layers of tissue, over those of a mass on a spring `E A / l` with a third
/// of the bar's mass (Rayleigh).
fn swing_on_a_bar(n: usize) -> f64 {
    let map = organ_map([3, 3, n + 3], |[_, _, k]| u8::from(k < 3));
    let mut world = world(tissue_with_bone_of(20.0 * BONE, &map, TISSUE));
    let h = world.lattice().pitch;
    // Bone ends at layer 4, tissue at n + 4.
    let top: Vec<u32> = particles(&world).into_iter().filter(|&p| world.lattice().ijk(p)[2] == n + 4).collect();
    assert_eq!(top.len(), 16);
    world.hold(&top);
    let bone = world.rigid_bodies()[0].particles()[0];
    world.set_rigid_motion(0, Vector3::new(0.0, 0.0, -1e-3), Vector3::zeros());
    let (mut crossings, mut before) = (Vec::new(), 0.0_f64);
    while crossings.len() < 3 && world.steps() < 100_000 {
        world.step().unwrap();
        let now = world.displacement(bone).z;
        if before * now < 0.0 {
            crossings.push(world.time() - world.dt() * now / (now - before));
        }
        before = now;
    }
    let (length, area) = (n as f64 * h, 9.0 * h * h);
    // Half a layer of the bar is counted with the bone.
    let mass = world.rigid_bodies()[0].mass() - TISSUE.density * area * h / 2.0 + TISSUE.density * area * length / 3.0;
    let expected = std::f64::consts::TAU * (mass * length / (TISSUE.youngs_modulus * area)).sqrt();
    (crossings[2] - crossings[0]) / expected
}

#[test]
fn bone_swings_on_a_bar_of_tissue() {
    let (short, long) = (swing_on_a_bar(8) - 1.0, swing_on_a_bar(16) - 1.0);
    eprintln!("period over a bar's: 1 + {short:.4} at 8 pitches, 1 + {long:.4} at 16");
    // Both ends keep the bar from narrowing, which stiffens it over a part of its width, whatever its length.
    assert!((-0.04..0.0).contains(&short), "{short}");
    assert!((0.3..0.7).contains(&(long / short)), "the ends' share halves: {short} to {long}");
}

#[test]
fn same_bits_at_any_number_of_threads() {
    let damped = PaperBody { damping: 1e-3, ..PAPER };
    let map = organ_map([40, 12, 12], |[i, j, k]| u8::from((j + k / 3) % 7 < 3 && i % 14 > 2 && k > 2));
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut world = shaken(paper_bone(&map, damped));
            world.set_gravity(Vector3::new(0.0, 0.0, -9.81));
            assert!(world.rigid_bodies().len() > 2);
            for _ in 0..60 {
                world.step().unwrap();
            }
            (displacements(&world), velocities(&world), world.rigid_bodies()[0].momentum())
        })
    };
    let one = run(1);
    assert!(one == run(2) && one == run(4));
}
