//! What contact does to the pairs that touch in one step: projected Gauss-Seidel with Coulomb friction.

use super::SWEEPS;
use crate::geometry::Vector3;

/// Sweeps end when none changed a relative velocity by more than this share of a pitch per step.
const SETTLED: f64 = 1e-5;

/// A particle that touches.
#[derive(Debug, Clone, Copy)]
pub(super) struct Body {
    /// Inverse mass in any unit, the same for all; 0 for what goes where it is told.
    pub(super) weight: f64,
    /// [m/s]; changed.
    pub(super) velocity: Vector3,
    /// Whether anything pushed it.
    pub(super) pushed: bool,
}

/// A pair that touches or nearly does.
#[derive(Debug, Clone, Copy)]
pub(super) struct Contact {
    /// Places among the bodies.
    pub(super) ends: [usize; 2],
    /// Unit vector from the first to the second.
    pub(super) normal: Vector3,
    /// The second leaves the first at least so fast along the normal [m/s]; below zero while there is a gap.
    pub(super) parting: f64,
    /// Impulse so far, along the normal and across, in units of mass over weight.
    pub(super) push: f64,
    pub(super) drag: Vector3,
}

/// Gives the bodies velocities that keep every pair apart; returns how many pairs push.
///
/// - `scale`: a pitch per step [m/s].
pub(super) fn respond(bodies: &mut [Body], contacts: &mut [Contact], friction: f64, scale: f64) -> usize {
    for _ in 0..SWEEPS {
        let mut largest = 0.0_f64;
        for contact in &mut *contacts {
            let Contact { ends: [a, b], normal, parting, .. } = *contact;
            let weight = bodies[a].weight + bodies[b].weight;
            let speed = (bodies[b].velocity - bodies[a].velocity).dot(&normal);
            let push = (contact.push + (parting - speed) / weight).max(0.0);
            let change = push - contact.push;
            if change != 0.0 {
                contact.push = push;
                give(bodies, [a, b], normal * change);
                largest = largest.max(change.abs() * weight);
            }
            if friction > 0.0 && (contact.push > 0.0 || contact.drag != Vector3::zeros()) {
                let relative = bodies[b].velocity - bodies[a].velocity;
                let sliding = relative - normal * relative.dot(&normal);
                let wanted = contact.drag - sliding / weight;
                let (length, most) = (wanted.norm(), friction * contact.push);
                let drag = if length > most { wanted * (most / length) } else { wanted };
                let change = drag - contact.drag;
                contact.drag = drag;
                give(bodies, [a, b], change);
                largest = largest.max(change.norm() * weight);
            }
        }
        if largest <= SETTLED * scale {
            break;
        }
    }
    contacts.iter().filter(|contact| contact.push > 0.0).count()
}

/// An impulse to the second of two bodies and its opposite to the first.
fn give(bodies: &mut [Body], [a, b]: [usize; 2], impulse: Vector3) {
    for (end, impulse) in [(a, -impulse), (b, impulse)] {
        let body = &mut bodies[end];
        body.velocity += impulse * body.weight;
        body.pushed = true;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splitmix::SplitMix;

    fn body(weight: f64, velocity: Vector3) -> Body {
        Body { weight, velocity, pushed: false }
    }

    fn contact(ends: [usize; 2], normal: Vector3, parting: f64) -> Contact {
        Contact { ends, normal: normal.normalize(), parting, push: 0.0, drag: Vector3::zeros() }
    }

    #[test]
    fn a_pair_meets_as_two_lumps_do() {
        // 1 kg at 3 m/s against 2 kg at rest: both go on at 1 m/s.
        let mut bodies = [body(1.0, Vector3::x() * 3.0), body(0.5, Vector3::zeros())];
        let mut contacts = [contact([0, 1], Vector3::x(), 0.0)];
        assert_eq!(respond(&mut bodies, &mut contacts, 0.0, 1.0), 1);
        assert!(bodies.iter().all(|body| body.pushed && (body.velocity - Vector3::x()).norm() < 1e-12));
        // Those that part, and those that stay far enough apart, are left alone.
        for (velocity, parting) in [(-1.0, 0.0), (3.0, -3.5)] {
            let mut bodies = [body(1.0, Vector3::x() * velocity), body(0.5, Vector3::zeros())];
            let mut contacts = [contact([0, 1], Vector3::x(), parting)];
            assert_eq!(respond(&mut bodies, &mut contacts, 0.5, 1.0), 0);
            assert!(bodies.iter().all(|body| !body.pushed) && bodies[0].velocity.x == velocity);
        }
        // What is held gives way to nothing.
        let mut bodies = [body(0.0, Vector3::zeros()), body(1.0, Vector3::new(-2.0, 0.0, 1.0))];
        respond(&mut bodies, &mut [contact([0, 1], Vector3::x(), 0.0)], 0.25, 1.0);
        assert!((bodies[1].velocity - Vector3::new(0.0, 0.0, 0.5)).norm() < 1e-12 && bodies[0].velocity.norm() == 0.0);
    }

    /// Heaps of random pairs: momentum is kept, energy falls, and sweeps leave what they should.
    #[test]
    fn heaps_keep_momentum_and_lose_energy() {
        for seed in 0..50 {
            let mut random = SplitMix::new(seed);
            let mut vector = || Vector3::from([0; 3].map(|_| random.unit() - 0.5));
            let mut bodies: Vec<Body> = (0..30).map(|n| body(1.0 + f64::from(n % 3), vector())).collect();
            let mut contacts: Vec<Contact> = (0..60)
                .map(|n| contact([n % 13, 13 + (n * 7) % 17], Vector3::x() + 0.3 * vector(), -0.2 * (vector().x + 0.5)))
                .collect();
            let momentum = |bodies: &[Body]| -> Vector3 { bodies.iter().map(|b| b.velocity / b.weight).sum() };
            let energy = |bodies: &[Body]| -> f64 { bodies.iter().map(|b| b.velocity.norm_squared() / b.weight).sum() };
            let before = bodies.clone();
            let friction = if seed % 2 == 0 { 0.0 } else { 0.3 };
            assert!(respond(&mut bodies, &mut contacts, friction, 1.0) > 0);
            assert!((momentum(&bodies) - momentum(&before)).norm() < 1e-12);
            assert!(energy(&bodies) < energy(&before), "seed {seed}");
            for contact in &contacts {
                let [a, b] = contact.ends.map(|end| bodies[end].velocity);
                assert!((b - a).dot(&contact.normal) > contact.parting - 0.02, "seed {seed}");
                assert!(contact.push >= 0.0 && contact.drag.norm() <= friction * contact.push + 1e-12);
                assert!(contact.drag.dot(&contact.normal).abs() < 0.5 * contact.push + 1e-9);
            }
        }
    }
}
