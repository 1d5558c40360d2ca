//! The embedded pair of Bogacki and Shampine, order 3 with an error estimate of order 2, and the control of its step.
//!
//! ```text
//! a1 = a(u, v)      a2 = a(u + h/2 v, v + h/2 a1)      a3 = a(u + 3/4 h v + 3/8 h^2 a1, v + 3/4 h a2)
//! u' = u + h v + h^2 (a1 / 6 + a2 / 3)                 v' = v + h (2 a1 + 3 a2 + 4 a3) / 9        a4 = a(u', v')
//! error of u = h^2 (a1 / 72 + a2 / 24 - a3 / 18)       error of v = h (-5/72 a1 + a2 / 12 + a3 / 9 - a4 / 8)
//! ```
//!
//! A step of the world is divided into parts `h`, each of which is accepted when no particle's error is larger than the
//! **tolerance, a length**: the distance by which the two solutions of the pair place it differently after that part, an error in
//! velocity counting as the distance it leads to in the time the fastest mode takes for a radian. A part that is too
//! long is taken again, shorter; the next one is `0.9 (tolerance / error)^(1/3)` times as long, at least a fifth and at most five times
//! that. The error at the end is what all parts add up to. Divided steps share their last evaluation: four for a step, three for
//! each further part.
//!
//! Stable while `w dt < sqrt(3)`, undamped, and in the whole half disc of that radius: that caps the step, and the control divides
//! what is left of it.
//!
//! Why this pair and not Dormand and Prince's 5(4): in a lattice the step is bounded by stability long before it is by
//! accuracy, and per evaluation Bogacki and Shampine's reaches 0.58 of a radian of the fastest undamped mode, Dormand and Prince's 0.17.
//!
//! An undamped mode loses `(w h)^4 / 12` of its energy per step.
//!
//! Source: P. Bogacki and L. F. Shampine, "A 3(2) pair of Runge-Kutta formulas", 1989.

use super::Mechanics;
use super::field::{Field, Real, combine, fit, largest};
use super::newton::Effort;

/// A step is not divided into more parts than this.
const MOST_PARTS: u32 = 100_000;

/// Buffers, and the part to try next.
#[derive(Debug, Clone, Default)]
pub(super) struct BogackiShampine<R> {
    a: [Field<R>; 4],
    stage: [Field<R>; 2],
    /// [s]; 0 before the first.
    next: f64,
    effort: Effort,
}

/// A step that could not be divided finely enough.
pub(super) struct TooManyParts {
    /// The part that still had too large an error [s].
    pub(super) part: f64,
    /// Largest number of parts.
    pub(super) most_parts: u32,
}

impl<R: Real> BogackiShampine<R> {
    /// - `tolerance`: largest error of a part [m]; `radian`: time the fastest mode takes for a radian [s].
    pub(super) fn advance<M: Mechanics<Real = R>>(
        &mut self,
        mechanics: &mut M,
        displacement: &mut Field<R>,
        velocity: &mut Field<R>,
        dt: f64,
        [tolerance, radian]: [f64; 2],
    ) -> Result<(), TooManyParts> {
        let Self { a: [a1, a2, a3, a4], stage: [u, v], next, effort } = self;
        for buffer in [&mut *a1, a2, a3, a4, u, v] {
            fit(buffer, displacement[0].len());
        }
        mechanics.accelerations(0.0, displacement, velocity, a1);
        effort.evaluations += 1;
        let (mut left, mut parts) = (dt, 0);
        if *next <= 0.0 {
            *next = dt;
        }
        while left > 0.0 {
            // No sliver at the end.
            let h = if *next >= left { left } else { next.min(0.5 * left) };
            let kick = h / mechanics.unit();
            let share = |part: f64| 1.0 - (left - part * h) / dt;
            combine(u, displacement, [(0.5 * h, velocity)]);
            combine(v, velocity, [(0.5 * kick, a1)]);
            mechanics.accelerations(share(0.5), u, v, a2);
            combine(u, displacement, [(0.75 * h, velocity), (0.375 * h * kick, a1)]);
            combine(v, velocity, [(0.75 * kick, a2)]);
            mechanics.accelerations(share(0.75), u, v, a3);
            combine(u, displacement, [(h, velocity), (h * kick / 6.0, a1), (h * kick / 3.0, a2)]);
            combine(v, velocity, [(kick * 2.0 / 9.0, a1), (kick / 3.0, a2), (kick * 4.0 / 9.0, a3)]);
            mechanics.accelerations(share(1.0), u, v, a4);
            effort.evaluations += 3;
            let of_place = {
                let scale = h * kick;
                largest([(scale / 72.0, a1), (scale / 24.0, a2), (-scale / 18.0, a3)])
            };
            let of_velocity =
                largest([(kick * -5.0 / 72.0, a1), (kick / 12.0, a2), (kick / 9.0, a3), (-0.125 * kick, a4)]);
            let error = of_place.max(of_velocity * radian) / tolerance;
            let factor =
                if error.is_finite() { (0.9 * error.max(1e-12).powf(-1.0 / 3.0)).clamp(0.2, 5.0) } else { 0.2 };
            parts += 1;
            if error <= 1.0 {
                effort.parts += 1;
                std::mem::swap(displacement, u);
                std::mem::swap(velocity, v);
                std::mem::swap(a1, a4);
                left = if h == left { 0.0 } else { left - h };
                // A part cut short by the end of the step says little about the next.
                *next = if left > 0.0 { h * factor } else { next.max(h * factor) };
            } else if parts >= MOST_PARTS {
                return Err(TooManyParts { part: h, most_parts: MOST_PARTS });
            } else {
                *next = h * factor.min(0.9);
            }
        }
        *next = next.min(dt);
        Ok(())
    }

    /// Evaluations of all parts, those that were taken again included; parts that were accepted.
    pub(super) fn effort(&self) -> Effort {
        self.effort
    }
}
