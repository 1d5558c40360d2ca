//! The lattice against answers known in advance.

#[path = "../support/mod.rs"]
mod support;

use support::*;
use yawara::dynamics::measure::balance;
use yawara::dynamics::stable_dt::Limits;
use yawara::dynamics::{StepError, World};
use yawara::geometry::{Matrix3, Vector3};
use yawara::kernel::reference::spring_forces;
use yawara::material::paper::PaperBody;
use yawara::material::tissue::{Damping, TissueBody};

#[test]
fn free_fall_is_that_of_the_discrete_equation() {
    for lattice in
        [paper_lattice(&block([5, 4, 3]), &[Some(PAPER)]), tissue_lattice(&block([5, 4, 3]), &[Some(TISSUE)])]
    {
        let mut world = world(lattice);
        let gravity = Vector3::new(0.5, -1.0, -9.81);
        world.set_gravity(gravity);
        let steps = 200;
        for _ in 0..steps {
            world.step().unwrap();
        }
        // Symplectic Euler: v_n = n g dt, u_n = n (n + 1) / 2 g dt^2.
        let n = f64::from(steps);
        let expected = gravity * (0.5 * n * (n + 1.0) * world.dt().powi(2));
        for particle in particles(&world) {
            let error = (world.displacement(particle) - expected).norm() / expected.norm();
            assert!(error < 2e-6, "particle {particle}: {error:e}");
            assert_eq!(world.displacement(particle), world.displacement(0), "all particles fall alike");
        }
    }
}

#[test]
fn momentum_is_kept_to_rounding() {
    let damped = PaperBody { damping: 1e-3, ..PAPER };
    let tissue = TissueBody { damping: Damping::Ratio(0.3), ..TISSUE };
    for lattice in [
        paper_lattice(&blob([12, 12, 12], 0.8, 1), &[Some(damped), Some(damped)]),
        tissue_lattice(&blob([12, 12, 12], 0.6, 2), &[Some(tissue), Some(tissue)]),
    ] {
        let mut world = world(lattice);
        shake(&mut world, 0.2, 0.2, 3);
        let before = balance(&world);
        let scale: f64 =
            particles(&world).iter().map(|&p| f64::from(world.mass()[p as usize]) * world.velocity(p).norm()).sum();
        let arm = rest_places(&world).iter().map(Vector3::norm).fold(0.0, f64::max);
        for _ in 0..500 {
            world.step().unwrap();
        }
        let after = balance(&world);
        // Each of the 500 steps rounds every velocity once, at random: 500^0.5 * 6e-8 of the sum of all, and fewer.
        let linear = (after.momentum - before.momentum).norm() / scale;
        assert!(linear < 1e-6, "momentum changed by {linear:e} of the particles' total");
        let angular = (after.angular_momentum - before.angular_momentum).norm() / (scale * arm);
        assert!(angular < 1e-6, "angular momentum changed by {angular:e}");
    }
}

#[test]
fn rigid_rotation_has_no_force() {
    let damped = PaperBody { damping: 2e-3, ..PAPER };
    let tissue = TissueBody { damping: Damping::Ratio(0.5), ..TISSUE };
    for lattice in
        [paper_lattice(&block([9, 8, 7]), &[Some(damped)]), tissue_lattice(&block([9, 8, 7]), &[Some(tissue)])]
    {
        for degrees in [1.0_f64, 30.0, 90.0, 179.0] {
            let mut world = world(lattice.clone());
            let rest = rest_places(&world);
            let turn = |angle: f64| nalgebra::Rotation3::from_axis_angle(&axis(), angle).into_inner();
            // Turning by 2 degrees a step: the places one step ago and now are both on the circle.
            let (now, before) = (turn(degrees.to_radians()), turn((degrees - 2.0).to_radians()));
            for particle in particles(&world) {
                let place = now * rest[particle as usize];
                world.set_displacement(particle, place - rest[particle as usize]);
                world.set_velocity(particle, (place - before * rest[particle as usize]) / world.dt());
            }
            let (displacement, velocity) = (displacements(&world), velocities(&world));
            let forces = spring_forces(
                world.lattice(),
                world.topology(),
                world.assembly(),
                &displacement,
                &velocity,
                world.dt(),
            );
            // What one per cent of stretch would give.
            let middle = world.lattice().particle_at[world.lattice().grid.shape.linear([4, 4, 4])];
            let scale = 0.01 * world.assembly().stiffness.of(world.lattice(), middle, 25) * world.lattice().pitch;
            let ghost = forces.iter().map(Vector3::norm).fold(0.0, f64::max) / scale;
            // f32 places of a turned block 10 pitches large: 1e-6 of a pitch against 1e-2, on 26 springs.
            assert!(ghost < 2e-3, "{degrees} degrees: {ghost:e} of a 1 % stretch");
            let speeds = velocities(&world);
            world.step().unwrap();
            let kick = particles(&world)
                .into_iter()
                .map(|p| (world.velocity(p) - speeds[p as usize]).norm() / speeds[p as usize].norm().max(1e-3))
                .fold(0.0, f64::max);
            assert!(kick < 1e-3, "{degrees} degrees: the fast loop changed a velocity by {kick:e}");
        }
    }
}

fn axis() -> nalgebra::Unit<Vector3> {
    nalgebra::Unit::new_normalize(Vector3::new(1.0, -2.0, 0.5))
}

#[test]
fn one_spring_swings_in_its_closed_form() {
    let (lattice, assembly) = paper_lattice(&block([2, 1, 1]), &[Some(PAPER)]);
    let mut world = World::new(lattice, assembly, 2e-4);
    let start = 1e-2 * world.lattice().pitch;
    world.set_displacement(0, Vector3::new(-0.5 * start, 0.0, 0.0));
    world.set_displacement(1, Vector3::new(0.5 * start, 0.0, 0.0));
    // Symplectic Euler turns s'' = -w^2 s into s_n = s_0 cos((n + 1/2) p) / cos(p / 2) with 2 sin(p / 2) = w dt.
    let omega = (2.0 * PAPER.stiffness / PAPER.mass).sqrt();
    let phase = 2.0 * (0.5 * omega * world.dt()).asin();
    let mut worst = 0.0_f64;
    for n in 1..=2000 {
        world.step().unwrap();
        let stretch = world.displacement(1).x - world.displacement(0).x;
        let expected = start * ((f64::from(n) + 0.5) * phase).cos() / (0.5 * phase).cos();
        worst = worst.max((stretch - expected).abs() / start);
    }
    // f32 places: rounding of 6e-8 / 1e-2 relative to the swing, gathered over 2000 steps.
    assert!(worst < 2e-3, "{worst:e}");
}

/// A block under uniform strain along x with Poisson's ratio 1/4 is in equilibrium and carries E times the strain.
#[test]
fn a_tissue_block_has_the_modulus_that_was_asked_for() {
    let dims = [8, 6, 5];
    for direction in 0..3 {
        let (lattice, assembly) = tissue_lattice(&block(dims), &[Some(TISSUE)]);
        let topology = yawara::lattice::Topology::new(&lattice);
        let strain = 1e-6;
        let mut stretch = Matrix3::from_diagonal_element(-0.25 * strain);
        stretch[(direction, direction)] = strain;
        let rest: Vec<Vector3> = (0..lattice.len() as u32)
            .map(|p| Vector3::from(lattice.ijk(p).map(|n| n as f64)) * lattice.pitch)
            .collect();
        let displacement: Vec<Vector3> = rest.iter().map(|r| stretch * r).collect();
        let still = vec![Vector3::zeros(); lattice.len()];
        let forces = spring_forces(&lattice, &topology, &assembly, &displacement, &still, 1e-4);

        let area =
            dims.iter().enumerate().filter(|&(a, _)| a != direction).map(|(_, &n)| n as f64 * 3e-3).product::<f64>();
        let last = lattice.grid.shape.dims()[direction] - 1;
        let mut pull = 0.0;
        for (particle, force) in forces.iter().enumerate() {
            let at = lattice.ijk(particle as u32)[direction];
            let sideways = (0..3).filter(|&a| a != direction).map(|a| force[a].abs()).fold(0.0, f64::max);
            let scale = TISSUE.youngs_modulus * strain * lattice.pitch * lattice.pitch;
            assert!(sideways < 1e-5 * scale, "sideways force {sideways:e} of {scale:e} N");
            if at + 1 >= last {
                pull -= force[direction];
            } else if at > 1 {
                assert!(force[direction].abs() < 1e-5 * scale);
            }
        }
        let modulus = pull / (area * strain);
        assert!((modulus / TISSUE.youngs_modulus - 1.0).abs() < 1e-4, "axis {direction}: E = {modulus} Pa");
    }
}

/// The same by stepping: a bar held at one end, pulled at the other, left until it rests.
#[test]
fn a_pulled_bar_stretches_as_youngs_modulus_says() {
    let dims = [30, 4, 4];
    let mut world = world(tissue_lattice(&block(dims), &[Some(TissueBody { damping: Damping::Ratio(2.0), ..TISSUE })]));
    let at = |world: &World, i: usize| -> Vec<u32> {
        particles(world).into_iter().filter(|&p| world.lattice().ijk(p)[0] == i).collect()
    };
    let last = world.lattice().grid.shape.nx - 1;
    let held: Vec<u32> = [at(&world, 0), at(&world, 1)].concat();
    world.hold(&held);
    let force = 0.001 * TISSUE.youngs_modulus * (4.0 * 3e-3_f64).powi(2);
    let end: Vec<u32> = [at(&world, last - 1), at(&world, last)].concat();
    let handle = world.push(&end);
    world.set_force(handle, Vector3::new(force, 0.0, 0.0));
    // Twelve decay times of the slowest mode.
    while world.time() < 3.0 {
        world.step().unwrap();
    }
    assert!(balance(&world).kinetic < 1e-9 * balance(&world).elastic, "the bar has come to rest");
    let mean = |i: usize| {
        let section: Vec<u32> = at(&world, i);
        section.iter().map(|&p| world.displacement(p).x).sum::<f64>() / section.len() as f64
    };
    let (a, b) = (11, 21);
    let strain = (mean(b) - mean(a)) / ((b - a) as f64 * world.lattice().pitch);
    let modulus = force / ((4.0 * 3e-3_f64).powi(2) * strain);
    println!("E from a pulled bar: {modulus:.2} Pa of {}", TISSUE.youngs_modulus);
    assert!((modulus / TISSUE.youngs_modulus - 1.0).abs() < 1e-3, "E = {modulus} Pa");
}

/// Model `paper` against the same equations integrated by a classical Runge-Kutta method in f64, written independently.
#[test]
fn paper_converges_to_a_high_order_solution_of_its_equations() {
    let body = PaperBody { stiffness: 12.0, damping: 4e-3, mass: 3e-5 };
    let (lattice, assembly) = paper_lattice(&blob([4, 3, 3], 0.8, 11), &[Some(body), Some(body)]);
    let n = lattice.len();
    let h = lattice.pitch;
    let rest: Vec<Vector3> = (0..n as u32).map(|p| Vector3::from(lattice.ijk(p).map(|i| i as f64)) * h).collect();
    let mut random = Random::new(12);
    let start: Vec<Vector3> = rest.iter().map(|r| r + random.vector() * 0.1 * h).collect();

    // Pairs of particles at most one pitch apart along every axis.
    let pairs: Vec<(usize, usize)> = (0..n)
        .flat_map(|i| (i + 1..n).map(move |j| (i, j)))
        .filter(|&(i, j)| (rest[i] - rest[j]).amax() < 1.5 * h)
        .collect();
    assert_eq!(pairs.len(), lattice.spring_count());
    let acceleration = |x: &[Vector3], v: &[Vector3]| {
        let mut a = vec![Vector3::zeros(); n];
        for &(i, j) in &pairs {
            let d = x[j] - x[i];
            let unit = d.normalize();
            let tension =
                body.stiffness * (d.norm() - (rest[j] - rest[i]).norm()) + body.damping * (v[j] - v[i]).dot(&unit);
            a[i] += unit * (tension / body.mass);
            a[j] -= unit * (tension / body.mass);
        }
        a
    };
    let duration = 4e-3;
    let solve = |steps: usize| {
        let dt = duration / steps as f64;
        let (mut x, mut v) = (start.clone(), vec![Vector3::zeros(); n]);
        let moved = |x: &[Vector3], d: &[Vector3], s: f64| -> Vec<Vector3> {
            x.iter().zip(d).map(|(x, d)| x + d * s).collect()
        };
        for _ in 0..steps {
            let (k1x, k1v) = (v.clone(), acceleration(&x, &v));
            let (v2, x2) = (moved(&v, &k1v, 0.5 * dt), moved(&x, &k1x, 0.5 * dt));
            let (k2x, k2v) = (v2.clone(), acceleration(&x2, &v2));
            let (v3, x3) = (moved(&v, &k2v, 0.5 * dt), moved(&x, &k2x, 0.5 * dt));
            let (k3x, k3v) = (v3.clone(), acceleration(&x3, &v3));
            let (v4, x4) = (moved(&v, &k3v, dt), moved(&x, &k3x, dt));
            let (k4x, k4v) = (v4.clone(), acceleration(&x4, &v4));
            for i in 0..n {
                x[i] += (k1x[i] + 2.0 * k2x[i] + 2.0 * k3x[i] + k4x[i]) * (dt / 6.0);
                v[i] += (k1v[i] + 2.0 * k2v[i] + 2.0 * k3v[i] + k4v[i]) * (dt / 6.0);
            }
        }
        x
    };
    let distance = |a: &[Vector3], b: &[Vector3]| a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    let exact = solve(4000);
    assert!(distance(&exact, &solve(2000)) < 1e-9 * h, "the reference has converged");

    let mut errors = Vec::new();
    for steps in [100, 200, 400, 800, 1600] {
        let mut world = World::new(lattice.clone(), assembly.clone(), duration / f64::from(steps));
        for p in 0..n {
            world.set_displacement(p as u32, start[p] - rest[p]);
        }
        for _ in 0..steps {
            world.step().unwrap();
        }
        let x: Vec<Vector3> = displacements(&world).iter().zip(&rest).map(|(u, r)| r + u).collect();
        errors.push(distance(&x, &exact) / h);
    }
    println!("error against the high-order solution [pitches]: {errors:?}");
    // First order: halving the step halves the error.
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((order - 1.0).abs() < 0.15, "observed order {order}");
    }
    assert!(errors[4] < 1e-3);
}

#[test]
fn a_step_beyond_the_bound_is_caught_with_its_cause() {
    let (lattice, assembly) = tissue_lattice(&block([8, 8, 8]), &[Some(TISSUE)]);
    let topology = yawara::lattice::Topology::new(&lattice);
    // The true limit at rest, as a run of many steps looks for it.
    let bound = Limits::at_rest(&lattice, &topology, &assembly).sharpen(&lattice, &topology, &assembly, 1e4).sharp;
    let mut world = World::new(lattice, assembly, 1.5 * bound);
    shake(&mut world, 1e-4, 0.0, 13);
    let error = (0..2000).find_map(|_| world.step().err()).expect("1.5 times the bound diverges");
    let StepError::Diverged { time, dt, cause, .. } = &error else { panic!("{error:?}") };
    assert!(*time > 0.0 && (*dt - 1.5 * bound).abs() < 1e-12);
    assert!(cause.contains("1.50 times the stable one"), "{error}");
    assert!(displacements(&world).iter().all(|u| u.iter().all(|x| x.is_finite())), "the last good state is kept");
}

#[test]
fn the_chosen_step_stays_bounded() {
    for lattice in [
        paper_lattice(&blob([8, 8, 8], 0.6, 14), &[Some(PAPER), Some(PaperBody { stiffness: 1e3, ..PAPER })]),
        tissue_lattice(&blob([8, 8, 8], 0.4, 15), &[Some(TISSUE), Some(TissueBody { youngs_modulus: 1e6, ..TISSUE })]),
    ] {
        let mut world = world(lattice);
        shake(&mut world, 0.05, 0.0, 16);
        let start = balance(&world);
        for _ in 0..5000 {
            world.step().unwrap();
        }
        let end = balance(&world);
        let ratio = (end.kinetic + end.elastic) / (start.kinetic + start.elastic);
        assert!((0.7..1.3).contains(&ratio), "energy went to {ratio} of what it was");
    }
}

#[test]
fn held_grabbed_and_bone_particles_go_where_they_are_told() {
    let map = organ_map([6, 5, 5], |[i, ..]| u8::from(i == 0));
    let mut world = world(tissue_lattice(&map, &[Some(TISSUE), None]));
    let all = particles(&world);
    let of = |world: &World, i: usize| -> Vec<u32> {
        all.iter().copied().filter(|&p| world.lattice().ijk(p)[0] == i).collect()
    };
    let (bone, grabbed) = (of(&world, 1), of(&world, 7));
    assert_eq!(bone.len(), 36);
    let grab = world.grab(&grabbed);
    let offset = Vector3::new(0.4, 0.1, -0.2);
    for step in 1..=400 {
        world.move_grab(grab, offset * (f64::from(step) / 400.0));
        world.step().unwrap();
    }
    for &p in &grabbed {
        assert!((world.displacement(p) * 1e3 - offset).norm() < 1e-6, "a grabbed particle is at its place");
    }
    for &p in &bone {
        assert_eq!(world.displacement(p), Vector3::zeros(), "bone stays");
    }
    world.release(grab);
    let place = world.displacement(grabbed[12]);
    for _ in 0..50 {
        world.step().unwrap();
    }
    assert!((world.displacement(grabbed[12]) - place).norm() > 1e-6, "a released particle moves");
}
