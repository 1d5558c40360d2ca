//! The largest step of each integrator, from the limits of the plain step.
//!
//! For every shape `x` of motion, with `k = x.K x / x.M x` and `c = x.C x / x.M x`, the plain step's limit `L` promises `k L^2 + 2 c L <= 4`
//! (see [`crate::dynamics::stable_dt`]). A mode's own rates `z` solve `z^2 + c z + k = 0` with such a pair, so that `|z|` is at most
//! `max(sqrt(k), c)`, which is at most `2 / L`: a method that is stable in a half disc of radius `r` in the left half plane may
//! take `r L / 2`. Verlet's method takes twice the damping of the plain step: its limit is that of a lattice with
//! dampers twice as strong. Drag adds its rate to `c`.

use super::Method;
use crate::dynamics::stable_dt::Limits;
use crate::dynamics::world::World;
use crate::lattice::{Lattice, Topology};
use crate::material::{Assembly, SpringConstants};

/// Runge and Kutta's method of order 4: a half disc with dampers, the imaginary axis without.
const RK4: [f64; 2] = [2.61, 2.82];
/// Bogacki and Shampine's method of order 3.
const BOGACKI_SHAMPINE: f64 = 1.73;

impl Method {
    /// Its largest step over that of the plain step, on a lattice with [`Method::seen_by`]; infinite when any step is stable.
    pub(in crate::dynamics) fn reach(self, damped: bool) -> f64 {
        match self {
            Self::SymplecticEuler | Self::Verlet => 1.0,
            Self::Rk4 => 0.5 * RK4[usize::from(!damped)],
            Self::BogackiShampine => 0.5 * BOGACKI_SHAMPINE,
            Self::BackwardEuler | Self::QuasiStatic => f64::INFINITY,
        }
    }

    /// How much stronger it feels dampers than the plain step does.
    pub(in crate::dynamics) fn damper_share(self) -> f32 {
        if self == Self::Verlet { 2.0 } else { 1.0 }
    }

    /// The rate of drag that its limit has to allow for [1/s]: none in the plain step, which takes the decay of a step whole, nor
    /// where any step is stable.
    pub(in crate::dynamics) fn resolved_drag(self, drag: f64) -> f64 {
        if self == Self::SymplecticEuler || self.is_stable_at_any_step() { 0.0 } else { drag }
    }

    /// The lattice whose plain step has this method's limit, but for [`Method::reach`]; `None` when it is the lattice itself.
    fn seen_by(self, assembly: &Assembly) -> Option<Assembly> {
        let share = self.damper_share();
        let damped = is_damped(assembly);
        (share != 1.0 && damped).then(|| {
            let mut seen = assembly.clone();
            match &mut seen.damping {
                None => {}
                Some(SpringConstants::Uniform(value)) => *value *= share,
                Some(SpringConstants::MeanOfEnds(values) | SpringConstants::SumOfCells { cell: values, .. }) => {
                    values.iter_mut().for_each(|value| *value *= share);
                }
            }
            if let Some(viscosity) = seen.volume.as_mut().and_then(|term| term.viscosity.as_mut()) {
                viscosity.iter_mut().for_each(|value| *value *= share);
            }
            seen
        })
    }

    /// The limits of this method at rest, and how to sharpen them as far as that pays in a run of so many steps.
    ///
    /// - `drag`: its rate [1/s].
    pub fn limits(
        self,
        lattice: &Lattice,
        topology: &Topology,
        assembly: &Assembly,
        drag: f64,
    ) -> (Limits, impl Fn(Limits, f64) -> Limits) {
        let seen = self.seen_by(assembly);
        let reach = self.reach(is_damped(assembly) || drag > 0.0);
        let slowed = self.resolved_drag(drag);
        let of_plain = move |limit: f64| 1.0 / (1.0 / (reach * limit) + slowed);
        let scaled = move |plain: Limits| Limits {
            promise: of_plain(plain.promise),
            rest: of_plain(plain.rest),
            sharp: of_plain(plain.sharp),
        };
        let plain = Limits::at_rest(lattice, topology, seen.as_ref().unwrap_or(assembly));
        let sharpen = move |limits: Limits, steps: f64| {
            if reach.is_infinite() {
                return limits;
            }
            scaled(plain.sharpen(lattice, topology, seen.as_ref().unwrap_or(assembly), steps))
        };
        (scaled(plain), sharpen)
    }
}

/// True when some damper or viscosity acts.
fn is_damped(assembly: &Assembly) -> bool {
    let viscous = assembly.volume.as_ref().is_some_and(|term| term.viscosity.is_some());
    assembly.damping.is_some() || viscous
}

/// The time that the fastest mode of a world at rest takes for a radian, at least [s]; infinite without springs.
pub(super) fn radian(world: &World) -> f64 {
    0.5 * Limits::at_rest(world.lattice(), world.topology(), world.assembly()).rest
}
