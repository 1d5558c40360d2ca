//! Hard cases: each ends in a finite state or in a clear refusal, never in NaN.

#[path = "../support/mod.rs"]
mod support;

mod alternation;
mod guard;
mod limits;
mod tangent;

use support::*;
use yawara::dynamics::{StepError, World};
use yawara::geometry::Vector3;
use yawara::lattice::build::NO_ORGAN;
use yawara::material::paper::PaperBody;
use yawara::material::tissue::{Damping, TissueBody};

/// Steps until the number is reached or the state diverges; whatever happens, all places are finite, after every step.
fn survive(name: &str, world: &mut World, steps: usize) -> Option<StepError> {
    for step in 0..steps {
        let result = world.step();
        let finite = world.displacements_mm().iter().flatten().all(|x| x.is_finite());
        assert!(finite, "{name}: a place is not finite after step {step}");
        if let Err(error) = result {
            let text = error.to_string();
            assert!(text.contains("diverged") && !text.contains("NaN"), "{name}: {text}");
            return Some(error);
        }
    }
    None
}

/// Both models, with and without dampers.
fn blocks() -> Vec<(String, World)> {
    let mut worlds = Vec::new();
    for damped in [false, true] {
        let ratio = if damped { 0.4 } else { 0.0 };
        let paper = PaperBody { damping: 2e-3 * ratio, ..PAPER };
        let tissue = TissueBody { damping: Damping::Ratio(ratio), ..TISSUE };
        worlds.push((format!("paper, damped: {damped}"), world(paper_lattice(&block([7, 6, 6]), &[Some(paper)]))));
        worlds.push((format!("tissue, damped: {damped}"), world(tissue_lattice(&block([6, 5, 5]), &[Some(tissue)]))));
    }
    worlds
}

fn reshape(world: &mut World, place: impl Fn(u32, Vector3) -> Vector3) {
    for (p, rest) in particles(world).into_iter().zip(rest_places(world)) {
        world.set_displacement(p, place(p, rest) - rest);
    }
}

#[test]
fn mangled_blocks_stay_finite() {
    let mut diverged = Vec::new();
    for (name, rest) in blocks() {
        let h = rest.lattice().pitch;
        let centre = rest_places(&rest).iter().sum::<Vector3>() / rest.lattice().len() as f64;
        let scattered: Vec<Vector3> = {
            let mut random = Random::new(1);
            particles(&rest).iter().map(|_| centre + random.vector() * 3.5 * h).collect()
        };
        type Shape<'a> = (&'a str, &'a dyn Fn(u32, Vector3) -> Vector3);
        let shapes: [Shape<'_>; 7] = [
            ("at random places in its box", &|p, _| scattered[p as usize]),
            ("flattened to a plane", &|_, r| Vector3::new(r.x, r.y, centre.z)),
            ("squeezed to a line", &|_, r| Vector3::new(r.x, centre.y, centre.z)),
            ("at one point", &|_, _| centre),
            ("inside out", &|_, r| Vector3::new(2.0 * centre.x - r.x, r.y, r.z)),
            ("turned by half", &|_, r| 2.0 * centre - r),
            ("blown up a hundredfold", &|_, r| centre + (r - centre) * 100.0),
        ];
        for (shape, place) in shapes {
            let mut world = rest.clone();
            reshape(&mut world, place);
            if let Some(error) = survive(&format!("{name}, {shape}"), &mut world, 400) {
                diverged.push(format!("{name}, {shape}: {error}"));
            }
        }
        // Two neighbours at one place, one cell inverted.
        for push in [1.0, 1.5] {
            let mut world = rest.clone();
            let middle = world.lattice().particle_at[world.lattice().grid.shape.linear([3, 3, 3])];
            world.set_displacement(middle, Vector3::x() * push * h);
            assert_eq!(survive(&name, &mut world, 400), None, "{name}: one particle displaced by {push} pitches");
        }
    }
    println!("{} mangled blocks diverged: {diverged:#?}", diverged.len());
    // Torn or crushed without dampers may be refused; turned inside out is a state of rest like any other.
    let turned = |text: &&String| text.contains("inside out") || text.contains("turned by half");
    assert_eq!(diverged.iter().find(turned), None);
    assert!(diverged.len() <= 14, "{diverged:#?}");
}

#[test]
fn lone_voxels_and_chains() {
    let checkered = organ_map([9, 9, 9], |ijk| if ijk.iter().all(|i| i % 2 == 0) { 0 } else { NO_ORGAN });
    for (name, map, springs) in
        [("one voxel", block([1, 1, 1]), 0), ("a chain", block([40, 1, 1]), 39), ("lone voxels", checkered, 0)]
    {
        for tissue in [false, true] {
            let lattice =
                if tissue { tissue_lattice(&map, &[Some(TISSUE)]) } else { paper_lattice(&map, &[Some(PAPER)]) };
            assert!(tissue || lattice.0.spring_count() == springs);
            let free = lattice.0.spring_count() == 0;
            // Nothing limits the step of particles without springs.
            let mut world = if free { World::new(lattice.0, lattice.1, 0.01) } else { world(lattice) };
            world.set_gravity(Vector3::new(0.0, 0.0, -9.81));
            assert_eq!(survive(name, &mut world, 500), None, "{name}, tissue: {tissue}");
            let n = 500.0;
            let fallen = -9.81 * 0.5 * n * (n + 1.0) * world.dt().powi(2);
            for p in particles(&world) {
                assert!((world.displacement(p).z / fallen - 1.0).abs() < 1e-5, "{name}: {}", world.displacement(p).z);
            }
        }
    }
}

/// How fast a body moves as a whole is nobody's business: 20 pitches in a step, turning.
#[test]
fn a_body_in_flight_is_not_a_diverged_one() {
    for (name, mut world) in blocks() {
        let speed = 20.0 * world.lattice().pitch / world.dt();
        let flight = Vector3::new(0.6, 0.0, -0.8) * speed;
        let spin = Vector3::new(1.0, 2.0, 0.5) * (0.02 / world.dt());
        let centre = rest_places(&world).iter().sum::<Vector3>() / world.lattice().len() as f64;
        for (p, rest) in particles(&world).into_iter().zip(rest_places(&world)) {
            world.set_velocity(p, flight + spin.cross(&(rest - centre)));
        }
        assert_eq!(survive(&name, &mut world, 300), None, "{name}");
        let still: Vec<u32> = particles(&world).into_iter().take(20).collect();
        world.hold(&still);
        let error = survive(&name, &mut world, 300).expect("half a body stopped dead at 20 pitches a step is torn");
        assert!(error.to_string().contains("a force or a grabbed region"), "{error}");
    }
}

#[test]
fn violent_drives_are_refused_before_they_do_harm() {
    for (name, rest) in blocks() {
        let h = rest.lattice().pitch;
        let some: Vec<u32> = particles(&rest).into_iter().filter(|&p| rest.lattice().ijk(p)[0] < 3).collect();
        let others: Vec<u32> = particles(&rest).into_iter().filter(|p| !some.contains(p)).collect();

        let mut world = rest.clone();
        let grab = world.grab(&some);
        world.move_grab(grab, Vector3::new(0.0, 10.0 * h * 1e3, 0.0));
        let error = survive(&name, &mut world, 50).expect("ten pitches in one step tear the tissue");
        let StepError::Diverged { step, moves, cause, .. } = &error else { panic!("{error}") };
        assert!(*step == 1 && (*moves - 10.0).abs() < 1e-3, "{error}");
        assert!(cause.contains("grabbed region"), "{error}");
        assert!(displacements(&world).iter().all(|u| *u == Vector3::zeros()), "{name}: the last good state is kept");

        // The whole body may go as fast as it likes.
        let mut world = rest.clone();
        let grab = world.grab(&particles(&rest));
        world.move_grab(grab, Vector3::new(0.0, 10.0 * h * 1e3, 0.0));
        assert_eq!(survive(&name, &mut world, 50), None);
        assert!(displacements(&world).iter().all(|u| (u.y / (10.0 * h) - 1.0).abs() < 1e-5));

        for force in [1e6, 1e30, 1e300, f64::NAN, f64::INFINITY] {
            for region in [&some, &others] {
                let mut world = rest.clone();
                let push = world.push(region);
                world.set_force(push, Vector3::new(0.0, force, 0.0));
                let error = survive(&name, &mut world, 50).expect("a meganewton tears the tissue");
                let StepError::Diverged { step, .. } = &error else { panic!("{error}") };
                assert_eq!(*step, 1, "{name}, {force} N: {error}");
            }
        }
    }
}

#[test]
fn a_place_that_is_not_a_number_is_found() {
    for (name, rest) in blocks() {
        for bad in [f64::NAN, f64::INFINITY, 1e30] {
            let mut world = rest.clone();
            world.set_displacement(7, Vector3::new(0.0, bad, 0.0));
            let error = world.step().expect_err("the neighbours feel it");
            assert!(matches!(error, StepError::Diverged { step: 1, .. }), "{name}: {error}");
            let mut world = rest.clone();
            world.set_velocity(7, Vector3::new(0.0, 0.0, bad));
            assert!(matches!(world.step(), Err(StepError::Diverged { .. })), "{name}");
            assert!(world.step().is_err(), "{name}: it does not go away by itself");
        }
    }
}

/// A bone that was moved stays where it was let go.
#[test]
fn bone_does_not_fly_on() {
    let map = organ_map([6, 4, 4], |[i, ..]| u8::from(i < 2));
    let mut world = world(tissue_lattice(&map, &[Some(TISSUE), None]));
    let bone: Vec<u32> = particles(&world).into_iter().filter(|&p| world.mass()[p as usize] == 0.0).collect();
    assert_eq!(bone.len(), 75, "three layers of 5 x 5 corners");
    let grab = world.grab(&bone);
    for step in 1..=20 {
        world.move_grab(grab, Vector3::new(0.05 * f64::from(step), 0.0, 0.0));
        world.step().unwrap();
    }
    world.release(grab);
    let place = world.displacement(bone[3]);
    assert!((place.x - 1e-3).abs() < 1e-8);
    assert_eq!(survive("bone", &mut world, 200), None);
    assert_eq!(world.displacement(bone[3]), place);
}
