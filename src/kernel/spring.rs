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

/// Force on the near end over the vector `d` along the spring [N/m].
#[inline(always)]
pub(super) fn factor<V: Vector, const EXACT: bool>(
    d: [V; 3],
    stiffness: V,
    rest: Rest<V>,
    damper: Option<Damper<V>>,
) -> V {
    if EXACT { exact_factor(d, stiffness, rest, damper) } else { fused_factor(d, stiffness, rest, damper) }
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

#[inline(always)]
fn fused_factor<V: Vector>(d: [V; 3], stiffness: V, rest: Rest<V>, damper: Option<Damper<V>>) -> V {
    let squared = squared_length(d);
    let inverse = squared.inverse_sqrt();
    let spring = (stiffness * rest.length) * (rest.inverse - inverse);
    let Some(Damper { constant, w, dt }) = damper else { return spring };
    let along = w[0].mul_add(d[0], w[1].mul_add(d[1], w[2] * d[2]));
    let speed_squared = w[0].mul_add(w[0], w[1].mul_add(w[1], w[2] * w[2]));
    let m = dt.negative_mul_add(speed_squared, along + along);
    let earlier_squared = dt.negative_mul_add(m, squared).max(V::splat(SHORTEST_SQUARED));
    let both = squared.mul_add(inverse, earlier_squared * earlier_squared.inverse_sqrt());
    (constant * m).mul_add(inverse * both.inverse(), spring)
}

/// Fused, and never 0.
#[inline(always)]
fn squared_length<V: Vector>([x, y, z]: [V; 3]) -> V {
    x.mul_add(x, y.mul_add(y, z.mul_add(z, V::splat(SHORTEST_SQUARED))))
}
