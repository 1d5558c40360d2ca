//! What a run may choose: integrator, pitch, step, arithmetic.

use serde::{Deserialize, Serialize};

use crate::dynamics::integrator;
use crate::run::prepare::Schedule;
use crate::scene::resolved::{Scene, needs_plain_step};

/// A way to step through time, as far as a study has to know it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Method {
    /// Which.
    pub integrator: integrator::Method,
    /// Its error goes with this power of the step.
    pub order: f64,
    /// Forces are computed so often in a step.
    pub evaluations: u64,
}

impl Method {
    /// Its name in scenes.
    pub fn name(&self) -> &'static str {
        self.integrator.name()
    }
}

/// The integrators whose error goes with a power of the step and whose step costs the same everywhere: those that a grid of
/// steps says something about. The others choose steps or iterations themselves.
pub const METHODS: &[Method] = &[
    Method { integrator: integrator::Method::SymplecticEuler, order: 1.0, evaluations: 1 },
    Method { integrator: integrator::Method::Verlet, order: 2.0, evaluations: 1 },
    Method { integrator: integrator::Method::Rk4, order: 4.0, evaluations: 4 },
];

/// Those that a scene can be stepped with.
pub fn methods_for(scene: &Scene) -> &'static [Method] {
    if needs_plain_step(&scene.organs, &scene.operations).is_some() { &METHODS[..1] } else { METHODS }
}

/// One point of the grid of choices.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Choice {
    /// Name of the integrator, one of [`METHODS`].
    pub integrator: String,
    /// Distance of neighbouring particles [mm].
    pub pitch_mm: f64,
    /// How many times shorter the step is than the one the program would choose at this pitch, the largest stable one.
    pub fineness: f64,
    /// True square roots and nothing fused, as `exact = true` in a scene.
    pub exact: bool,
}

impl Choice {
    /// A name that can be a folder's.
    pub fn key(&self) -> String {
        let Self { integrator, pitch_mm, fineness, exact } = self;
        format!("{integrator}-{pitch_mm}mm-x{fineness}-{}", if *exact { "exact" } else { "fast" })
    }

    /// Its integrator.
    pub fn method(&self) -> Option<&'static Method> {
        METHODS.iter().find(|method| method.name() == self.integrator)
    }

    /// The scene with this choice made and so many instants as frames; the step is left to [`Choice::schedule`].
    pub fn apply(&self, scene: &Scene, instants: usize) -> Scene {
        let mut scene = at_pitch(scene, self.pitch_mm, instants);
        scene.time.exact = self.exact;
        scene.time.tolerance = None;
        scene.time.integrator = self.method().map_or_else(integrator::Method::default, |method| method.integrator);
        scene
    }

    /// Steps of this choice, from those the program would choose. Instants lie at the same times whatever the fineness.
    pub fn schedule(&self, chosen: &Schedule) -> Schedule {
        let per_instant = (chosen.steps as f64 / chosen.frames as f64 * self.fineness - 1e-9).ceil().max(1.0) as u64;
        let steps = per_instant * chosen.frames;
        let duration = chosen.dt * chosen.steps as f64;
        Schedule { dt: duration / steps as f64, steps, ..*chosen }
    }
}

/// A scene at a pitch, with its step left to the program and so many frames.
pub fn at_pitch(scene: &Scene, pitch_mm: f64, instants: usize) -> Scene {
    let mut scene = scene.clone();
    scene.lattice.pitch = Some(pitch_mm * 1e-3);
    scene.time.dt = None;
    scene.time.frames = instants;
    scene
}
