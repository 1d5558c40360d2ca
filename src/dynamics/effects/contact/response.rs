//! What contact does to one particle in one step.

use super::placed::Placed;
use crate::geometry::Vector3;

/// A particle that is inside an obstacle already is led out at this speed [m/s], relative to the obstacle: a fiftieth of how
/// fast shear waves run in soft tissue (2 to 3 m/s), so that what it displaces can follow.
pub const PUSH_OUT_SPEED: f64 = 0.05;

/// Deeper than this before a step is inside already [pitches]; rounding of places in f32 stays far below.
const INSIDE: f64 = 1e-3;
/// Pushed out of one obstacle a particle may be inside the next, or of a curved one still inside: tried so often.
const ROUNDS: usize = 12;
/// Friction acts in so many of them; the last ones only lead out.
const ROUNDS_WITH_FRICTION: usize = 8;
/// After the first round, less than this is outside [pitches].
const TOUCHES: f64 = 1e-6;
/// A sampled distance is hardly less steep than this; where two sides are equally near it may be.
const LEAST_SLOPE: f64 = 0.3;

/// A particle before its drift, lattice axes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Particle {
    /// Where it is [m].
    pub(super) place: Vector3,
    /// [m/s].
    pub(super) velocity: Vector3,
}

/// The velocity that keeps a particle out of all obstacles.
///
/// - `changes`: the change of velocity by each obstacle is added here [m/s].
///
/// One obstacle alone never leaves a particle inside that was outside: where rounds do not lead out, it moves with the
/// obstacle for this step.
pub(super) fn respond(
    particle: Particle,
    obstacles: &[Placed],
    (dt, pitch): (f64, f64),
    changes: &mut [Vector3],
) -> Vector3 {
    let Particle { place, mut velocity } = particle;
    // How far inside it may still be after the step.
    let allowed = |obstacle: &Placed| {
        let now = obstacle.value(place, obstacle.offset);
        if now < -INSIDE * pitch { (now + PUSH_OUT_SPEED * dt).min(0.0) } else { 0.0 }
    };
    for round in 0..=ROUNDS {
        let mut touched = false;
        for (obstacle, change) in obstacles.iter().zip(&mut *changes) {
            if !obstacle.present {
                continue;
            }
            let target = place + velocity * dt;
            let value = obstacle.value(target, obstacle.target);
            let slack = if round == 0 { 0.0 } else { TOUCHES * pitch };
            let inside = value < -slack;
            let missing = if inside { allowed(obstacle) - value } else { 0.0 };
            if missing <= slack {
                continue;
            }
            touched = true;
            let before = velocity;
            let carried = (obstacle.target - obstacle.offset) / dt;
            if round == ROUNDS {
                velocity = carried;
                *change += velocity - before;
                continue;
            }
            let gradient = obstacle.gradient(target, obstacle.target);
            let slope = gradient.norm();
            let normal = if slope > 0.0 { gradient / slope } else { Vector3::z() };
            let push = missing / (dt * slope.max(LEAST_SLOPE));
            velocity += normal * push;
            if obstacle.friction > 0.0 && round < ROUNDS_WITH_FRICTION {
                let relative = velocity - carried;
                let tangential = relative - normal * relative.dot(&normal);
                let speed = tangential.norm();
                if speed > 0.0 {
                    velocity -= tangential * ((obstacle.friction * push).min(speed) / speed);
                }
            }
            *change += velocity - before;
        }
        if !touched {
            break;
        }
    }
    velocity
}
