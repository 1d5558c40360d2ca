//! Soft tissue against what it may not enter: tools, planes, bone.

#[path = "../support/mod.rs"]
mod support;

mod bits;
mod bone;
mod gentle;
mod hertz;
mod incline;
mod itself;
mod moved_bone;
mod outside;
mod scenes;

use support::*;
use yawara::dynamics::World;
use yawara::geometry::{Point3, Vector3};
use yawara::material::tissue::{Damping, TissueBody};

/// Soft tissue that comes to rest soon.
const DAMPED: TissueBody = TissueBody { damping: Damping::Ratio(0.5), ..TISSUE };

/// Present places of all particles, RAS+ [mm].
fn places_mm(world: &World) -> Vec<Point3> {
    let moved = world.displacements_mm();
    let place = |p: u32| world.lattice().rest_place(p) + Vector3::from(moved[p as usize].map(f64::from));
    particles(world).into_iter().map(place).collect()
}

/// Steps a world for a time [s].
fn run(world: &mut World, duration: f64) {
    let until = world.time() + duration;
    while world.time() < until {
        world.step().unwrap();
    }
}

/// Mass of all particles [kg].
fn total_mass(world: &World) -> f64 {
    world.mass().iter().map(|&m| f64::from(m)).sum()
}

/// Mean velocity of the mass, RAS+ [m/s].
fn mean_velocity(world: &World) -> Vector3 {
    let momentum: Vector3 =
        particles(world).into_iter().map(|p| world.velocity(p) * f64::from(world.mass()[p as usize])).sum();
    world.to_patient_axes(momentum / total_mass(world))
}
