//! Tissue on bone that stays where it is.

use yawara::dynamics::effects::contact::Shape;
use yawara::lattice::build::NO_ORGAN;
use yawara::lattice::region::Region;

use super::*;

/// A soft block two voxels above a plate of bone that is one voxel thin; at the left they are joined by a pillar of tissue,
/// or not.
fn above_bone(joined: bool) -> World {
    let map = organ_map([12, 9, 10], |[i, _, k]| match k {
        2 => 1,
        3 | 4 if joined && i < 2 => 0,
        5..=8 if i < 9 => 0,
        _ => NO_ORGAN,
    });
    let mut world = world(tissue_lattice(&map, &[Some(DAMPED), None]));
    world.set_gravity(Vector3::new(0.0, 0.0, -9.81));
    world
}

fn bone(world: &World) -> Shape {
    Shape::rigid_organs(world.lattice(), &[1]).unwrap()
}

/// Soft particles and how far they are from bone [mm].
fn distances(world: &World) -> Vec<f64> {
    let bone = bone(world);
    let soft = particles(world).into_iter().filter(|&p| world.mass()[p as usize] > 0.0);
    soft.map(|p| bone.signed_distance(Point3::from(places(world)[p as usize] * 1e3)) * 1e3).collect()
}

#[test]
fn no_soft_particle_is_inside_at_rest() {
    for joined in [false, true] {
        let world = above_bone(joined);
        assert!(distances(&world).iter().all(|&d| d > 0.0));
        // Middle of the plate: half a voxel deep, and as far above it as it looks.
        let bone = bone(&world);
        let at = |z: f64| {
            let local = world.to_lattice_axes(Point3::new(5.0, 15.0, z) - world.lattice().grid.affine.origin());
            bone.signed_distance(Point3::from(local)) * 1e3
        };
        // Voxels k = 2 have their middle at 26 mm.
        for (z, expected) in [(26.0, -1.5), (27.5, 0.0), (24.5, 0.0), (29.0, 1.5), (32.0, 4.5), (23.0, 1.5)] {
            assert!((at(z) - expected).abs() < 1e-5, "{z}: {}", at(z));
        }
    }
}

#[test]
fn a_block_falls_on_bone_and_lies_there() {
    let mut world = above_bone(false);
    let shape = bone(&world);
    let plate = world.add_obstacle("bone", shape, 0.5);
    run(&mut world, 0.8);
    let weight = total_mass(&world) * 9.81;
    let force = world.tool_force(plate);
    assert!((force + Vector3::new(0.0, 0.0, weight)).norm() < 0.01 * weight, "{force} {weight}");
    let nearest = distances(&world).into_iter().fold(f64::INFINITY, f64::min);
    assert!(nearest.abs() < 1e-4, "{nearest} mm");
}

#[test]
fn a_joined_block_bends_down_on_bone() {
    let mut world = above_bone(true);
    world.set_gravity(Vector3::new(0.0, 0.0, -40.0));
    // The plate ends at 27.5 mm; what is not joined to it hangs beside the pillar.
    let lowest =
        |world: &World| places_mm(world).iter().filter(|place| place.x > 3.0).map(|p| p.z).fold(60.0, f64::min);
    let soft = |world: &World| distances(world).into_iter().fold(f64::INFINITY, f64::min);
    let mut through = world.clone();
    run(&mut through, 0.6);
    let shape = bone(&world);
    let plate = world.add_obstacle("bone", shape, 0.0);
    run(&mut world, 0.6);
    println!("lowest {:.3} mm, without contact {:.3} mm", lowest(&world), lowest(&through));
    assert!(lowest(&through) < 24.0 && soft(&world) > -1e-4, "{} {}", lowest(&through), soft(&world));
    assert!(world.tool_force(plate).z < 0.0);
    // Bone itself is no obstacle to itself.
    let rigid = Region::Organ(1).select(world.lattice());
    assert!(rigid.iter().all(|&p| world.displacement(p).norm() == 0.0));
}

/// Model `paper`: voxels are particles.
#[test]
fn voxels_of_bone_are_met_in_model_paper() {
    let map = organ_map([9, 9, 9], |[i, j, k]| match k {
        1 => 1,
        4..=7 if (2..7).contains(&i) && (2..7).contains(&j) => 0,
        _ => NO_ORGAN,
    });
    let body = yawara::material::paper::PaperBody { damping: 0.02, ..PAPER };
    let mut world = world(paper_lattice(&map, &[Some(body), None]));
    world.set_gravity(Vector3::new(0.0, 0.0, -9.81));
    let shape = bone(&world);
    let plate = world.add_obstacle("bone", shape, 0.0);
    run(&mut world, 0.8);
    let before = world.tool_impulse(plate);
    run(&mut world, 0.1);
    let force = (world.tool_impulse(plate) - before).z / 0.1;
    let weight = total_mass(&world) * 9.81;
    assert!((force / weight + 1.0).abs() < 0.02, "{force} {weight}");
    assert!(distances(&world).iter().all(|&d| d > -1e-4));
    // Nothing pushes it aside.
    let aside = displacements(&world).iter().map(|u| u.xy().norm()).fold(0.0, f64::max);
    assert!(aside < 3e-4, "{aside}");
}

#[test]
fn an_organ_without_voxels_is_no_shape() {
    assert!(Shape::rigid_organs(above_bone(false).lattice(), &[7]).is_none());
}
