//! Which pitches are tried.

use crate::run::inputs::Inputs;
use crate::run::organs::{filled_box, own_pitch_mm, whole_cells};
use crate::run::prepare::PrepareError;
use crate::scene::resolved::Scene;

/// In spacings of the volume: what is made of whole cells at one of them is so at most of them.
const SHARES: [f64; 11] = [16.0, 12.0, 8.0, 6.0, 4.0, 3.0, 2.0, 1.5, 1.0, 0.75, 0.5];
/// A box is made of whole cells unless it is more cells thick.
const THICK: f64 = 8.0;

/// Pitches, coarsest first.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Pitches {
    /// Spacing of the volume, the pitch that a scene has by itself [mm].
    pub(super) own_mm: f64,
    /// [mm].
    all: Vec<f64>,
}

impl Pitches {
    /// For the organs of a scene. Where they are a box, cells that it fills in part lie along a whole face of it, and what holds or
    /// pulls that face does so through them: a cell filled to a tenth, a tenth as stiff, gives as much as ten. So a box is
    /// only divided into whole cells while cells are large.
    ///
    /// # Errors
    /// If an organ is empty.
    pub(super) fn of(scene: &Scene, inputs: &Inputs) -> Result<Self, PrepareError> {
        let own_mm = own_pitch_mm(inputs).unwrap_or(1.0);
        let body = filled_box(scene, inputs)?;
        let fits = |pitch_mm: &f64| {
            body.is_none_or(|body| {
                let (voxels, spacing) = (body.shape.dims(), body.affine.spacing());
                let thinnest = (0..3).map(|axis| voxels[axis] as f64 * spacing[axis]).fold(f64::INFINITY, f64::min);
                whole_cells(voxels, spacing, *pitch_mm) || thinnest > THICK * pitch_mm
            })
        };
        Ok(Self { own_mm, all: SHARES.iter().map(|share| share * own_mm).filter(fits).collect() })
    }

    /// All of them [mm].
    pub(super) fn all(&self) -> &[f64] {
        &self.all
    }

    /// The smallest [mm].
    pub(super) fn finest(&self) -> f64 {
        self.all.last().copied().unwrap_or(self.own_mm)
    }

    /// The largest that is at most so large, or the smallest [mm].
    pub(super) fn at_most(&self, pitch_mm: f64) -> f64 {
        self.all.iter().copied().find(|own| *own <= 1.001 * pitch_mm).unwrap_or(self.finest())
    }

    /// The smallest that is well between two [mm].
    pub(super) fn between(&self, coarse_mm: f64, fine_mm: f64) -> Option<f64> {
        self.all.iter().copied().rfind(|own| *own > 1.1 * fine_mm && 1.1 * *own < coarse_mm)
    }
}
