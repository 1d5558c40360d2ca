//! What a run may choose: integrator, pitch, step or tolerance, arithmetic.
//!
//! Every integrator's finenesses count from the longest step that it takes itself ([`longest`]), so that none is charged for the
//! limit of another: of explicit ones that is their own largest stable step, of backward Euler, which has none, [`LONG_STEP`] plain
//! steps. Bogacki and Shampine's method chooses its steps by its own error: its fineness `f` asks for a tolerance of [`TOLERANCE`]
//! pitches over `f^3`, which makes steps `f` times shorter where the tolerance decides.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::dynamics::integrator::{Integrator, Method, Precision};
use crate::lattice::Topology;
use crate::run::prepare::{PrepareError, Prepared, Schedule};
use crate::scene::resolved::{Scene, needs_plain_step};

/// The integrators that are tried: all that follow a motion. Those that others may be judged by come first, by their order.
pub const METHODS: &[Method] =
    &[Method::SymplecticEuler, Method::Verlet, Method::Rk4, Method::BogackiShampine, Method::BackwardEuler];

/// Plain steps that the longest step of a method stands for that is stable at any.
pub const LONG_STEP: f64 = 20.0;

/// Tolerance of Bogacki and Shampine's method at a fineness of 1 \[pitches\]. A part of its largest stable step errs by about so much where
/// a lattice moves as fast as its waves, and by less elsewhere: what asks for less changes nothing, for there stability decides. A fineness
/// of 8 asks for 2e-8, about what f32 can tell.
pub const TOLERANCE: f64 = 1e-5;

/// Those that a scene can be stepped with.
pub fn methods_for(scene: &Scene) -> &'static [Method] {
    if needs_plain_step(&scene.organs, &scene.operations, scene.sleep).is_some() { &METHODS[..1] } else { METHODS }
}

/// Whether the error of a method goes with a power of a step that is the same all along: only by such a one others are judged.
pub fn may_judge(method: Method) -> bool {
    method.evaluations().is_some()
}

/// How numbers are kept and forces computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Arithmetic {
    /// f32, as fast as it goes.
    Fast,
    /// f32 with true square roots and nothing fused, as `exact = true` in a scene.
    Exact,
    /// The state in f64: some three times slower and more.
    Double,
}

impl Arithmetic {
    /// All of them, the usual one first.
    pub const ALL: [Self; 3] = [Self::Fast, Self::Exact, Self::Double];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fast => "fast",
            Self::Exact => "exact",
            Self::Double => "double",
        }
    }
}

impl fmt::Display for Arithmetic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Those that a scene can be stepped in: f64 knows no more than the other integrators do.
pub fn arithmetic_for(scene: &Scene) -> &'static [Arithmetic] {
    if needs_plain_step(&scene.organs, &scene.operations, scene.sleep).is_some() {
        &Arithmetic::ALL[..2]
    } else {
        &Arithmetic::ALL
    }
}

/// One point of the grid of choices.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Choice {
    /// The integrator, one of [`METHODS`].
    pub integrator: Method,
    /// Distance of neighbouring particles [mm].
    pub pitch_mm: f64,
    /// How many times shorter the step is than the longest one that the integrator takes at this pitch, see the module.
    pub fineness: f64,
    /// The numbers.
    pub arithmetic: Arithmetic,
}

impl Choice {
    /// A name that can be a folder's.
    pub fn key(&self) -> String {
        let Self { integrator, pitch_mm, fineness, arithmetic } = self;
        format!("{}-{pitch_mm}mm-x{fineness}-{arithmetic}", integrator.name())
    }

    /// The same integrator, pitch and step in other numbers.
    pub fn in_arithmetic(&self, arithmetic: Arithmetic) -> Self {
        Self { arithmetic, ..self.clone() }
    }

    /// What a part of a step may err by \[m\], where the integrator asks for that in place of a step.
    pub fn tolerance(&self) -> Option<f64> {
        (self.integrator == Method::BogackiShampine).then(|| TOLERANCE * self.pitch_mm * 1e-3 / self.fineness.powi(3))
    }

    /// How its world goes on in time.
    pub fn way(&self) -> Integrator {
        let usual = Integrator::new(self.integrator);
        let precision = if self.arithmetic == Arithmetic::Double { Precision::Double } else { Precision::Single };
        Integrator { tolerance: self.tolerance().unwrap_or(usual.tolerance), precision, ..usual }
    }

    /// A [`plain`] scene, whose own pitch this is \[mm\], with this choice made; the step is left to [`Choice::schedule`], and what scenes
    /// do not ask for to [`Choice::way`].
    pub fn apply(&self, plain: &Scene, own_mm: f64) -> Scene {
        let mut scene = plain.at_pitch(own_mm * 1e-3, self.pitch_mm * 1e-3);
        scene.time.exact = self.arithmetic == Arithmetic::Exact;
        scene.time.tolerance = self.tolerance();
        scene.time.integrator = self.integrator;
        scene
    }

    /// Steps of this choice, from the [`longest`] of its integrator. Instants lie at the same times whatever the fineness.
    pub fn schedule(&self, longest: &Schedule) -> Schedule {
        // A tolerance divides steps while they are taken.
        let fineness = if self.tolerance().is_some() { 1.0 } else { self.fineness };
        longest.finer(fineness)
    }
}

/// The longest steps of a method on a lattice that was prepared for the plain step.
///
/// # Errors
/// If they are so short that a run would never end.
pub fn longest(method: Method, prepared: &Prepared, scene: &Scene) -> Result<Schedule, PrepareError> {
    let Prepared { lattice, assembly, schedule: plain, .. } = prepared;
    if method == Method::SymplecticEuler {
        return Ok(*plain);
    }
    let topology = Topology::new(lattice);
    let (at_rest, sharpen) = method.limits(lattice, &topology, assembly, scene.drag.unwrap_or(0.0));
    if method.is_stable_at_any_step() {
        let longest = plain.finer(LONG_STEP.recip());
        return Ok(Schedule { stable_dt: at_rest.sharp, limits: at_rest, ..longest });
    }
    Schedule::new(&scene.time, at_rest, sharpen)
}

/// A scene at its own pitch, under the plain step, with the step left to the program and so many frames.
pub fn plain(scene: &Scene, instants: usize) -> Scene {
    let mut scene = scene.clone();
    scene.time.dt = None;
    scene.time.frames = instants;
    scene.time.integrator = Method::SymplecticEuler;
    scene.time.tolerance = None;
    scene
}
