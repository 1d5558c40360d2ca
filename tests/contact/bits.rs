//! Same bits at any number of threads, and without what does not touch; what it costs.

use yawara::dynamics::effects::contact::Shape;

use super::*;

/// Several blocks of memory, a tool that slides over them, a table below.
fn busy(threads: usize) -> (Vec<Vector3>, Vec<Vector3>, [Vector3; 2]) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let mut world = world(tissue_lattice(&block([40, 20, 20]), &[Some(DAMPED)]));
        world.set_gravity(Vector3::new(0.0, 0.0, -9.81));
        let table = world.add_obstacle("table", Shape::plane(Point3::new(0.0, 0.0, 18.5), Vector3::z()), 0.3);
        let rod = Shape::capsule(Point3::new(20.0, -20.0, 84.5), Point3::new(20.0, 90.0, 84.5), 6.0);
        let tool = world.add_obstacle("rod", rod, 0.5);
        for _ in 0..150 {
            let then = world.time() + world.dt();
            world.move_obstacle(tool, Vector3::new(200.0, 50.0, -60.0) * then);
            world.step().unwrap();
        }
        (displacements(&world), velocities(&world), [table, tool].map(|handle| world.tool_impulse(handle)))
    })
}

#[test]
fn threads_change_no_bit() {
    let one = busy(1);
    assert!(one.2.iter().all(|impulse| impulse.norm() > 0.0));
    for threads in [2, 3, 4] {
        assert!(busy(threads) == one, "{threads} threads");
    }
}

#[test]
fn what_never_touches_changes_no_bit() {
    let start = world(tissue_lattice(&blob([30, 17, 9], 0.8, 5), &[Some(DAMPED), Some(TISSUE)]));
    let mut runs = Vec::new();
    for case in 0..4 {
        let mut world = start.clone();
        shake(&mut world, 0.05, 0.05, 3);
        let near = Shape::sphere(Point3::new(20.0, 20.0, 30.0), 20.0);
        let far = Shape::sphere(Point3::new(900.0, 0.0, 0.0), 20.0);
        match case {
            0 => {}
            // Taken away before anything moves.
            1 => {
                let tool = world.add_obstacle("tool", near, 0.5);
                world.release(tool);
                assert_eq!(world.obstacles().map(|facts| facts.impulse.norm()).sum::<f64>(), 0.0);
            }
            2 => {
                world.add_obstacle("tool", far, 0.5);
            }
            // It comes and goes, but never near.
            _ => {
                let tool = world.add_obstacle("tool", far, 0.5);
                for step in 0..100 {
                    world.move_obstacle(tool, Vector3::new(-7.0 * f64::from(step), 0.0, 0.0));
                    world.step().unwrap();
                }
                assert_eq!(world.tool_impulse(tool), Vector3::zeros());
            }
        }
        while world.steps() < 100 {
            world.step().unwrap();
        }
        runs.push((displacements(&world), velocities(&world)));
    }
    assert!(runs.iter().all(|run| *run == runs[0]));
}

/// A particle that is put somewhere is looked at again, however far its block was.
#[test]
fn what_is_put_near_is_noticed() {
    let mut world = world(tissue_lattice(&block([4, 4, 4]), &[Some(TISSUE)]));
    let table = world.add_obstacle("table", Shape::plane(Point3::new(0.0, 0.0, -500.0), Vector3::z()), 0.0);
    world.step().unwrap();
    assert_eq!(world.tool_impulse(table), Vector3::zeros());
    let all = particles(&world);
    let lowest = places_mm(&world).iter().map(|place| place.z).fold(f64::INFINITY, f64::min);
    for &p in &all {
        // The lowest are a hundredth of a millimetre above the table, and fall.
        world.set_displacement(p, Vector3::new(0.0, 0.0, (-500.0 + 0.01 - lowest) * 1e-3));
        world.set_velocity(p, Vector3::new(0.0, 0.0, -0.1));
    }
    world.step().unwrap();
    assert!(world.tool_force(table).z < 0.0);
    assert!(places_mm(&world).iter().all(|place| place.z > -500.0 - 1e-4));
}

/// Counted in blocks whose particles are looked at, for time is another's matter.
#[test]
fn contact_costs_by_what_it_touches() {
    // 62 x 42 x 42 grid points with their margin: 4 x 6 x 6 blocks of memory.
    let start = world(tissue_lattice(&block([60, 39, 39]), &[Some(DAMPED)]));
    let blocks = 100;
    let looks = |center: Point3, path: &dyn Fn(f64) -> Vector3, steps: u64| {
        let mut world = start.clone();
        let ball = world.add_obstacle("ball", Shape::sphere(center, 12.0), 0.0);
        for _ in 0..steps {
            let then = world.time() + world.dt();
            world.move_obstacle(ball, path(then));
            world.step().unwrap();
        }
        (world.contact_looks(), world.tool_impulse(ball).norm())
    };
    // Far away: every block once, to know how far.
    assert_eq!(looks(Point3::new(0.0, 0.0, 900.0), &|_| Vector3::zeros(), 200), (blocks, 0.0));
    // It passes by at two metres a second: now and then.
    let (passing, impulse) = looks(Point3::new(-60.0, 60.0, 168.0), &|time| Vector3::new(2000.0 * time, 0.0, 0.0), 200);
    println!("passing: {passing} looks at blocks in 200 steps of {blocks} blocks");
    assert!(impulse == 0.0 && passing < 20 * blocks, "{passing}");
    // It presses the middle of one block's top: that and little else.
    let (pressing, impulse) = looks(Point3::new(64.0, 64.0, 147.5), &|time| Vector3::new(0.0, 0.0, -20.0 * time), 200);
    println!("pressing: {pressing} looks at blocks in 200 steps of {blocks} blocks");
    assert!(impulse > 0.0 && pressing < 6 * 200 + 5 * blocks, "{pressing}");
}
