//! The force of one spring and its damper, in every lane.
//!
//! For the spring from particle i to its neighbour j, with `u` the displacements, `R` the rest vector and `d = R + u_j - u_i`:
//!
//! ```text
//! l       = |d|                                   present length
//! l'      = |d - dt (v_j - v_i)|                  length one step earlier
//! force_i = k (1 - L / l) d  +  c (l - l') / dt * d / l
//! ```
//!
//! The damper is Hattori and Kaneko's: it acts on the difference of two lengths, so a rigid rotation, however fast, does
//! not feel it. `l^2 - l'^2` is computed as `dt m` with `m = (v_j - v_i) . (2 d - dt (v_j - v_i))`, which loses no digits.
//!
//! There are two arithmetics. `EXACT` adds, multiplies, divides and takes square roots as written, never fused: the bits are
//! the same on every instruction set. Otherwise multiplications and additions are fused and `1 / l` is computed as such; the
//! spring is then `k L (1 / L - 1 / l) d`, with `1 / L` computed like `1 / l`. That is faster, as accurate (both round
//! lengths to about 1e-7 of theirs), and its last bits belong to the instruction set. In both a lattice at rest has no force
//! at all.

use super::simd::Vector;

/// Squared length below which a spring is taken as having this length: keeps a collapsed spring finite [m^2].
pub(super) const SHORTEST_SQUARED: f32 = 1e-30;

/// What a spring is without strain.
#[derive(Clone, Copy)]
pub(super) struct Rest<V> {
    /// [m]
    pub(super) length: V,
    /// One over length, computed like one over present length [1/m].
    pub(super) inverse: V,
}

impl<V: Vector> Rest<V> {
    /// The rest of a spring along a vector [m] that was measured to be `length` long.
    #[inline(always)]
    pub(super) fn new(vector: [V; 3], length: f32) -> Self {
        Self { length: V::splat(length), inverse: squared_length(vector).inverse_sqrt() }
    }
}

/// A damper in parallel to a spring.
#[derive(Clone, Copy)]
pub(super) struct Damper<V> {
    /// [N s/m]
    pub(super) constant: V,
    /// Velocity of the far end relative to the near one [m/s].
    pub(super) w: [V; 3],
    /// Time step [s].
    pub(super) dt: V,
}

/// Force on the near end over the vector `d` along the spring [N/m]; 0 in lanes that `keep` leaves out.
///
/// - `keep`: the lanes of living springs, 0 in the others.
#[inline(always)]
pub(super) fn factor<V: Vector, const EXACT: bool>(
    d: [V; 3],
    stiffness: V,
    rest: Rest<V>,
    damper: Option<Damper<V>>,
    keep: impl Fn(V) -> V,
) -> V {
    if EXACT { keep(exact_factor(d, stiffness, rest, damper)) } else { fused_factor(d, stiffness, rest, damper, keep) }
}

#[inline(always)]
fn exact_factor<V: Vector>([x, y, z]: [V; 3], stiffness: V, rest: Rest<V>, damper: Option<Damper<V>>) -> V {
    let length = (x * x + y * y + z * z).max(V::splat(SHORTEST_SQUARED)).sqrt();
    let spring = stiffness * (V::splat(1.0) - rest.length / length);
    let Some(Damper { constant, w, dt }) = damper else { return spring };
    let mut earlier_squared = V::splat(0.0);
    let mut m = V::splat(0.0);
    for (d, w) in [x, y, z].into_iter().zip(w) {
        let earlier = d - dt * w;
        earlier_squared = earlier_squared + earlier * earlier;
        m = m + w * (d + earlier);
    }
    // (l - l') / dt, and over l to turn d into a unit vector.
    spring + constant * m / ((length + earlier_squared.sqrt()) * length)
}

/// A step changes `l^2` by the share `q = dt m / l^2`, and `(l - l') / dt / l = m / 2 l^2 * 2 / (1 + sqrt(1 - q))`, whose
/// quotient is a short series as long as `q` is small.
#[inline(always)]
fn fused_factor<V: Vector>(
    d: [V; 3],
    stiffness: V,
    rest: Rest<V>,
    damper: Option<Damper<V>>,
    keep: impl Fn(V) -> V,
) -> V {
    let inverse = squared_length(d).inverse_sqrt();
    let spring = (stiffness * rest.length) * (rest.inverse - inverse);
    let Some(Damper { constant, w, dt }) = damper else { return keep(spring) };
    let along = w[0].mul_add(d[0], w[1].mul_add(d[1], w[2] * d[2]));
    let speed_squared = w[0].mul_add(w[0], w[1].mul_add(w[1], w[2] * w[2]));
    let half_m = (V::splat(0.5) * dt).negative_mul_add(speed_squared, along);
    // Springs that are not there may change as they like.
    let half_p = keep(half_m * (inverse * inverse));
    let q = (dt + dt) * half_p;
    let series = q.mul_add(V::splat(5.0 / 64.0), V::splat(0.125)).mul_add(q, V::splat(0.25)).mul_add(q, V::splat(1.0));
    let quotient = if q.all_within(SMALL_CHANGE) { series } else { series.where_within(q, SMALL_CHANGE, quotient(q)) };
    keep((constant * half_p).mul_add(quotient, spring))
}

/// Up to here `2 / (1 + sqrt(1 - q))` is `1 + q / 4 + q^2 / 8 + 5 q^3 / 64` within 4e-9.
const SMALL_CHANGE: f32 = 1.0 / 64.0;

/// `2 / (1 + sqrt(1 - q))` for any change, that from nothing at all included.
#[inline(always)]
fn quotient<V: Vector>(q: V) -> V {
    let one = V::splat(1.0);
    (one + one) / (one + (one - q).max(V::splat(0.0)).sqrt())
}

/// Fused, and never 0.
#[inline(always)]
fn squared_length<V: Vector>([x, y, z]: [V; 3]) -> V {
    x.mul_add(x, y.mul_add(y, z.mul_add(z, V::splat(SHORTEST_SQUARED))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::simd::plain::Plain;

    /// Both arithmetics against the formula in f64, for changes of length from none to all of it in one step.
    #[test]
    fn a_damper_is_the_difference_of_two_lengths() {
        const PITCH: f64 = 3e-3;
        const DT: f64 = 2e-4;
        let (stiffness, constant) = (0.0, 2e-3);
        let mut state = 1_u32;
        let mut random = |low: f64, high: f64| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            low + (high - low) * f64::from(state >> 8) / f64::from(1 << 24)
        };
        let (mut small, mut large) = (0, 0);
        for _ in 0..20_000 {
            let d = [PITCH, 0.0, PITCH].map(|rest| rest + random(-0.3, 0.3) * PITCH);
            let speed = 10_f64.powf(random(-4.0, 1.5));
            let w = [0; 3].map(|_| speed * random(-1.0, 1.0));
            let [d, w] = [d, w].map(|vector| vector.map(|value| value as f32));
            let length = |by: f64| (0..3).map(|a| (f64::from(d[a]) - by * f64::from(w[a])).powi(2)).sum::<f64>().sqrt();
            let (now, earlier) = (length(0.0), length(DT));
            let expected = constant * (now - earlier) / DT / now;
            // Both lengths are rounded, and their difference is taken over the step.
            let tolerance = constant * 1e-6 * (speed / now + (1.0 - earlier / now).abs() / DT);
            if (1.0 - (earlier / now).powi(2)).abs() < f64::from(SMALL_CHANGE) {
                small += 1
            } else {
                large += 1
            }
            let lanes = |vector: [f32; 3]| vector.map(Plain::splat);
            let damper = Damper { constant: Plain::splat(constant as f32), w: lanes(w), dt: Plain::splat(DT as f32) };
            let rest = Rest::new(lanes([PITCH as f32; 3]), PITCH as f32);
            let stiffness = Plain::splat(stiffness);
            for factor in [
                factor::<Plain, true>(lanes(d), stiffness, rest, Some(damper), |lanes| lanes),
                factor::<Plain, false>(lanes(d), stiffness, rest, Some(damper), |lanes| lanes),
            ] {
                let mut found = [0.0; 4];
                factor.store(&mut found, 0);
                let off = (f64::from(found[0]) - expected).abs();
                assert!(off < tolerance, "{found:?} is not {expected}, {off:e} over {tolerance:e}: {d:?}, {w:?}");
            }
        }
        assert!(small > 5_000 && large > 5_000, "{small} small, {large} large");
    }
}
