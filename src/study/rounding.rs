//! What f32 costs: the last state of a run stepped on in f32 and in f64.
//!
//! [`ReferenceWorld`] knows springs, volume terms, fibres, dampers, holds, gravity and drag. So both go on from the last state with these
//! alone: tools, forces, grabs and pressures let go. Nothing is measured where bone moves as a free body.

use std::time::{Duration, Instant};

use super::ledger::RoundingLine;
use crate::dynamics::World;
use crate::dynamics::reference_world::ReferenceWorld;
use crate::scene::resolved::Scene;

/// Steps that are compared at most.
const MOST_STEPS: u64 = 100;

/// Steps a world on in both precisions, for about so long. `None` where the f64 world does not know all there is.
pub fn measure(world: &World, scene: &Scene, run: &str, most: Duration) -> Option<RoundingLine> {
    if world.rigid_bodies().iter().any(|body| !body.held()) {
        return None;
    }
    let mut twin = World::new(world.lattice().clone(), world.assembly().clone(), world.dt());
    twin.set_arithmetic(world.arithmetic());
    twin.set_gravity(scene.gravity);
    twin.set_drag(scene.drag.unwrap_or(0.0));
    let all = 0..world.lattice().len() as u32;
    let held: Vec<u32> = all.clone().filter(|&particle| world.is_held(particle)).collect();
    for particle in all.clone().filter(|&particle| world.rigid_body_of(particle).is_none()) {
        twin.set_displacement(particle, world.displacement(particle));
        twin.set_velocity(particle, world.velocity(particle));
    }
    twin.sever(world.topology().severed().iter().copied());
    twin.hold(&held);
    let start: Vec<_> = all.clone().map(|particle| twin.displacement(particle)).collect();
    let mut judge = ReferenceWorld::of(&twin);
    let begun = Instant::now();
    let (mut steps, mut fast) = (0, Duration::ZERO);
    while steps < MOST_STEPS && (steps == 0 || begun.elapsed() < most) {
        judge.step().ok()?;
        let now = Instant::now();
        twin.step().ok()?;
        fast += now.elapsed();
        steps += 1;
    }
    let slow = begun.elapsed().saturating_sub(fast);
    let (mut moved_mm, mut max_mm, mut squares) = (0.0_f64, 0.0_f64, 0.0);
    for particle in all {
        let (p, now) = (particle as usize, judge.displacement()[particle as usize] * 1e3);
        let off = (twin.displacement(particle) * 1e3 - now).norm();
        moved_mm = moved_mm.max((now - start[p] * 1e3).norm());
        max_mm = max_mm.max(off);
        squares += off * off;
    }
    Some(RoundingLine {
        run: run.to_owned(),
        steps,
        moved_mm,
        max_mm,
        rms_mm: (squares / start.len() as f64).sqrt(),
        times_slower: slow.as_secs_f64() / fast.as_secs_f64().max(1e-9),
    })
}
