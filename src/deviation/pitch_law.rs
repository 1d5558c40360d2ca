//! The error of a pitch, from how far each pitch is from the finest.
//!
//! The finest pitch is no truth. If errors go with a power of the pitch, then `D(h) = c (h^q - H^q)` is what is seen of pitch `h` against
//! the finest pitch `H`, and `c h^q` is the error. `q` and `c` are fitted to all pitches. Errors of two runs do not point the same way
//! everywhere, so a pitch near the finest says little. Distances that agree on a power are believed; those that agree on none
//! leave it open, and then one near 1.2 is taken, which lies between those of a border drawn in cubes and of smooth tissue, 1 and 2.
//! Against far finer runs (`tests/accuracy`), errors are then mostly estimated too large, by half in the mean.

use super::{Deviation, Sizes};

/// Errors that follow a law are off it by about this share of their own.
const NOISE: f64 = 0.02;
/// What distances leave open is settled for powers near this one,
const USUAL: f64 = 1.2;
/// within about this share.
const NEAR: f64 = 0.3;
/// A power that errors are off by this share of their own is none.
const NO_POWER: f64 = 0.2;
/// Springs and cells are of second order at most where the tissue is smooth [hundredths].
const MOST_ORDER: u32 = 200;

/// How errors go with the pitch: `c h^q`.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct PitchLaw {
    /// The power `q`.
    pub order: f64,
    /// Whether it was found in the runs, or taken as usual because there are too few pitches or no power fits.
    pub found: bool,
    /// Pitches that were compared with the finest.
    pub pitches: usize,
    /// Of a pitch of 1 mm: `c` \[mm^(1 - q)\].
    pub factor: Sizes,
}

impl PitchLaw {
    /// Where nothing moves.
    pub const NO_ERROR: Self =
        Self { order: 1.0, found: false, pitches: 0, factor: Sizes { max_mm: 0.0, rms_mm: 0.0 } };

    /// From how far runs at coarser pitches \[mm\] are from one at the finest. `None` where no distance tells anything.
    pub fn fit(coarser: &[(f64, Deviation)], finest_mm: f64) -> Option<Self> {
        let seen: Vec<[f64; 3]> = coarser
            .iter()
            .map(|(pitch_mm, off)| [*pitch_mm, off.rms_mm, off.max_mm])
            .filter(|seen| seen[1] > 0.0 && seen[1].is_finite())
            .collect();
        if seen.is_empty() {
            return None;
        }
        // The factors that each pitch asks for agree best at the right power.
        let logs = |order: f64, part: usize| -> Vec<f64> {
            seen.iter().map(|seen| (seen[part] / (seen[0].powf(order) - finest_mm.powf(order))).ln()).collect()
        };
        // What is off by a share of the error is off by more of a distance, the nearer the finest pitch is.
        let weights = |order: f64| -> Vec<f64> {
            seen.iter().map(|seen| (1.0 - (finest_mm / seen[0]).powf(order)).powi(2)).collect()
        };
        let mean = |order: f64, part: usize| {
            let weights = weights(order);
            let sum: f64 = logs(order, part).iter().zip(&weights).map(|(log, weight)| log * weight).sum();
            sum / weights.iter().sum::<f64>()
        };
        let spread = |order: f64| {
            let mean = mean(order, 1);
            let logs = logs(order, 1).into_iter().zip(weights(order));
            logs.map(|(log, weight)| weight * (log - mean).powi(2)).sum::<f64>()
        };
        // Student's distribution of the spread: far from every power, one says little more than another.
        let unlikely = |order: f64| (spread(order) / NOISE.powi(2)).ln_1p() + ((order / USUAL).ln() / NEAR).powi(2);
        let orders = (40..=MOST_ORDER).map(|n| f64::from(n) * 0.01);
        let best = orders.min_by(|&a, &b| unlikely(a).total_cmp(&unlikely(b))).unwrap_or(USUAL);
        let found = seen.len() > 1 && spread(best) < NO_POWER.powi(2) * seen.len() as f64;
        let order = if found { best } else { USUAL };
        let factor = |part: usize| mean(order, part).exp();
        let factor = Sizes { max_mm: factor(2), rms_mm: factor(1) };
        Some(Self { order, found, pitches: seen.len(), factor })
    }

    /// The error of a pitch \[mm\].
    pub fn error(&self, pitch_mm: f64) -> Sizes {
        let power = pitch_mm.powf(self.order);
        Sizes { max_mm: self.factor.max_mm * power, rms_mm: self.factor.rms_mm * power }
    }

    /// The pitch whose error is this \[mm\], root mean square \[mm\].
    pub fn pitch(&self, rms_mm: f64) -> f64 {
        (rms_mm / self.factor.rms_mm).powf(self.order.recip())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn off(pitch_mm: f64, off: f64) -> (f64, Deviation) {
        (pitch_mm, Deviation { max_mm: 5.0 * off, most_mm: 2.0 * off, rms_mm: off, points: 9, left_out: 0 })
    }

    #[test]
    fn the_error_of_a_pitch_is_more_than_what_is_seen_against_the_finest() {
        for (power, least, most) in [(0.8, 0.79, 1.0), (1.2, 1.19, 1.21), (1.7, 1.6, 1.71)] {
            let error = |h: f64| 0.02 * h.powf(power);
            let seen = [9.0, 6.0, 4.5, 3.0].map(|h| off(h, error(h) - error(2.25)));
            let law = PitchLaw::fit(&seen, 2.25).unwrap();
            // Leaning towards the usual power.
            assert!(law.found && (least..=most).contains(&law.order), "{power}: {law:?}");
            for pitch_mm in [6.0, 4.5, 3.0, 2.25] {
                let Sizes { max_mm, rms_mm } = law.error(pitch_mm);
                let ratio = rms_mm / error(pitch_mm);
                assert!(ratio > 0.8 && ratio < 1.2, "{power}: {ratio}");
                assert!((max_mm / rms_mm - 5.0).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn one_pitch_tells_no_power() {
        let law = PitchLaw::fit(&[off(4.0, 0.1)], 2.0).unwrap();
        assert!(!law.found && law.order == USUAL);
        assert!((law.error(4.0).rms_mm - law.error(2.0).rms_mm - 0.1).abs() < 1e-12);
        assert!((law.pitch(law.error(3.0).rms_mm) - 3.0).abs() < 1e-12);
        assert_eq!(PitchLaw::fit(&[], 3.0), None);
        // Nearer at a coarser pitch: no power does that.
        assert!(!PitchLaw::fit(&[off(20.0, 9.1), off(15.0, 2.6), off(10.0, 3.2)], 7.5).unwrap().found);
    }
}
