//! Same bits at any number of threads, and without what does not touch.

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
    let all = particles(&world);
    for &p in &all {
        world.set_displacement(p, Vector3::new(0.0, 0.0, -0.51));
    }
    for &p in &all {
        world.set_velocity(
            p,
            Vector3::new(0.0, 0.0, -0.9 * (world.lattice().rest_place(p).z - 10.0) * 1e-3 / world.dt()),
        );
    }
    world.step().unwrap();
    assert!(world.tool_force(table).z < 0.0);
    assert!(places_mm(&world).iter().all(|place| place.z > -500.0 - 1e-4));
}
