//! What stepping costs: the error of each integrator on one lattice, and the cheapest that keeps a bound.
//!
//! On one lattice the error of an integrator of order `p` is `C dt^p`. Two runs with different steps tell `C` (Richardson, 1911): they
//! are `C (dt^p - dt'^p)` apart. Another integrator with the same steps would not do: the plain step and Verlet's have the same error of
//! phase.

use super::trial::Trial;
use crate::dynamics::integrator::Method;

/// Integrators that are tried, each better than the one before.
const TRIED: [Method; 3] = [Method::SymplecticEuler, Method::Verlet, Method::Rk4];
/// What an evaluation costs that is not fused with the step, in plain steps: a fifth goes to the fields it is summed in.
const UNFUSED: f64 = 1.2;
/// Steps are chosen this much shorter than the law asks for,
const ROOM: f64 = 0.8;
/// and at most so many times shorter than the largest that is stable.
pub(super) const MOST_FINENESS: f64 = 256.0;

/// The power of the step with which the error of a run is trusted to be smaller than that of one with longer steps: rounding, divided steps and ramps that end within a step do
/// not fall with a higher one.
const MOST_ORDER: f64 = 2.0;

/// The known error of an integrator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Law {
    pub(super) method: Method,
    /// A step [s].
    pub(super) dt: f64,
    /// Its error [mm].
    pub(super) error_mm: f64,
}

pub(super) fn order(method: Method) -> f64 {
    f64::from(method.order().unwrap_or(1))
}

/// The next integrator that is better than one, if there is one.
pub(super) fn better(method: Method) -> Option<Method> {
    let place = TRIED.iter().position(|tried| *tried == method)?;
    TRIED.get(place + 1).copied()
}

/// The error of a run [mm], by one of the same integrator with other steps on the same lattice. `None` where the steps are almost the
/// same, or the integrators are not.
pub(super) fn error_mm(run: &Trial, other: &Trial) -> Option<f64> {
    if run.choice.method != other.choice.method {
        return None;
    }
    let apart = run.distance(other)?.rms_mm;
    let shorter = run.dt / other.dt;
    let order = order(run.choice.method);
    let ratio = shorter.powf(if shorter < 1.0 { order.min(MOST_ORDER) } else { order });
    ((ratio - 1.0).abs() > 0.2).then(|| apart * ratio / (ratio - 1.0).abs())
}

impl Law {
    /// How much shorter than `dt` the steps have to be for an error of at most `bound_mm`; 1 at least, [`MOST_FINENESS`] at most.
    pub(super) fn fineness(&self, dt: f64, bound_mm: f64) -> f64 {
        let here = self.error_mm(dt);
        if here <= bound_mm {
            return 1.0;
        }
        (here / (ROOM * bound_mm)).powf(order(self.method).recip()).min(MOST_FINENESS)
    }

    /// The error of steps of `dt` [mm].
    pub(super) fn error_mm(&self, dt: f64) -> f64 {
        self.error_mm * (dt / self.dt).powf(order(self.method))
    }

    /// Time that reaches a bound [plain steps per second of simulated time], with the largest stable step `dt`.
    pub(super) fn price(&self, dt: f64, bound_mm: f64) -> f64 {
        least_price(self.method, dt) * self.fineness(dt, bound_mm)
    }
}

/// What the largest stable step `dt` of an integrator costs [plain steps per second of simulated time].
pub(super) fn least_price(method: Method, dt: f64) -> f64 {
    let evaluations = method.evaluations().unwrap_or(1) as f64;
    let price = if method == Method::SymplecticEuler { evaluations } else { UNFUSED * evaluations };
    price / dt
}
