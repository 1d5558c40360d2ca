//! Which pitches are tried.

use crate::run::inputs::Inputs;
use crate::run::organs::{filled_box, own_pitch_mm, whole_cells};
use crate::run::prepare::PrepareError;
use crate::scene::resolved::Scene;

/// In spacings of the volume. A quarter apart at most, mostly: a step costs as much again or twice, as time goes with the fourth power.
const SHARES: [f64; 16] = [16.0, 12.0, 10.0, 8.0, 6.0, 5.0, 4.0, 3.0, 2.5, 2.0, 1.5, 1.25, 1.0, 0.75, 0.625, 0.5];
/// A box is made of whole cells unless it is more cells thick.
const THICK: f64 = 8.0;
/// So many cells along the thinnest edge of a box at most are sought to be whole.
const MOST_WHOLE: u32 = 16;
/// Pitches of a box are at least so far from each other.
const APART: f64 = 1.1;
/// A lattice says something about the error of one that is so much finer.
const CLEARLY: f64 = 1.4;

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
        let shares = SHARES.iter().map(|share| share * own_mm);
        let Some(body) = filled_box(scene, inputs)? else {
            return Ok(Self { own_mm, all: shares.collect() });
        };
        let (voxels, spacing) = (body.shape.dims(), body.affine.spacing());
        let thinnest = (0..3).map(|axis| voxels[axis] as f64 * spacing[axis]).fold(f64::INFINITY, f64::min);
        let whole = (1..=MOST_WHOLE).map(|cells| thinnest / f64::from(cells));
        let whole = whole.filter(|pitch_mm| whole_cells(voxels, spacing, *pitch_mm));
        let thin = shares.filter(|pitch_mm| thinnest > THICK * pitch_mm);
        let finest = SHARES[SHARES.len() - 1] * own_mm;
        let mut all = vec![own_mm];
        for pitch_mm in whole.chain(thin).filter(|pitch_mm| *pitch_mm > 0.999 * finest) {
            if all.iter().all(|known| (known / pitch_mm).max(pitch_mm / known) > APART) {
                all.push(pitch_mm);
            }
        }
        all.sort_by(|a, b| b.total_cmp(a));
        Ok(Self { own_mm, all })
    }

    /// All of them [mm].
    pub(super) fn all(&self) -> &[f64] {
        &self.all
    }

    /// Those that any body may have, coarsest first, whether a box is whole there or not [mm].
    pub(super) fn of_any_body(&self) -> impl Iterator<Item = f64> {
        SHARES.iter().map(|share| share * self.own_mm)
    }

    /// The smallest [mm].
    pub(super) fn finest(&self) -> f64 {
        self.all.last().copied().unwrap_or(self.own_mm)
    }

    /// The next below one, or the smallest of those below it that are still at least `toward` \[mm\]. `None` below the smallest.
    pub(super) fn below(&self, pitch_mm: f64, toward_mm: f64) -> Option<f64> {
        let mut finer = self.all.iter().copied().filter(|own| *own < 0.999 * pitch_mm);
        let next = finer.next()?;
        Some(finer.take_while(|own| *own > 0.999 * toward_mm).last().unwrap_or(next))
    }

    /// One that a pitch can be compared with, though nothing may be whole there [mm].
    pub(super) fn clearly_above(&self, pitch_mm: f64) -> f64 {
        let coarser = self.all.iter().copied().rfind(|own| *own > CLEARLY * pitch_mm);
        coarser.unwrap_or(2.0 * pitch_mm)
    }
}
