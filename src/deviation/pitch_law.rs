//! The error of a pitch, from how far each pitch is from the finest.
//!
//! The finest pitch is no truth. If errors go with a power of the pitch, then `D(h) = c (h^q - H^q)` is what is seen of pitch `h` against
//! the finest pitch `H`, and `c h^q` is the error. `q` and `c` are fitted to all pitches; few and noisy distances leave the
//! power open, and then one near 1 is taken, which is that of a border drawn in cubes.

use super::findings::{Level, Sizes, SpaceLaw};

/// Estimates the error of every level, coarsest first. `None`, and no estimate, with one level.
pub fn space_errors(levels: &mut [Level]) -> Option<SpaceLaw> {
    /// Regions and cuts take in a little more or less tissue at each pitch: distances are known to about this share.
    const NOISE: f64 = 0.07;
    /// What distances that noisy leave open is settled for powers near 1, within about this share.
    const NEAR_ONE: f64 = 0.4;
    /// A power that leaves distances this far from it, relative, is none.
    const NO_POWER: f64 = 0.2;
    let finest = levels.last()?.pitch_mm;
    let seen: Vec<[f64; 3]> = levels
        .iter()
        .filter_map(|level| Some([level.pitch_mm, level.from_finest?.rms_mm, level.from_finest?.max_mm]))
        .filter(|seen| seen[1] > 0.0 && seen[1].is_finite())
        .collect();
    if seen.is_empty() {
        return None;
    }
    // The factors that each pitch asks for agree best at the right power.
    let spread = |order: f64| {
        let logs: Vec<f64> = seen.iter().map(|[h, rms, _]| (rms / (h.powf(order) - finest.powf(order))).ln()).collect();
        let mean = logs.iter().sum::<f64>() / logs.len() as f64;
        logs.iter().map(|log| (log - mean).powi(2)).sum::<f64>()
    };
    let unlikely = |order: f64| spread(order) / NOISE.powi(2) + (order.ln() / NEAR_ONE).powi(2);
    let orders = (40..=400).map(|n| f64::from(n) * 0.01);
    let best = orders.min_by(|&a, &b| unlikely(a).total_cmp(&unlikely(b))).unwrap_or(1.0);
    let found = seen.len() > 1 && spread(best) < NO_POWER.powi(2) * seen.len() as f64;
    let order = if found { best } else { 1.0 };
    let factor = |part: usize| {
        let logs = seen.iter().map(|seen| (seen[part] / (seen[0].powf(order) - finest.powf(order))).ln());
        (logs.sum::<f64>() / seen.len() as f64).exp()
    };
    let [rms, max] = [factor(1), factor(2)];
    for level in levels.iter_mut() {
        let power = level.pitch_mm.powf(order);
        level.space_error = Some(Sizes { max_mm: max * power, rms_mm: rms * power });
    }
    Some(SpaceLaw { order, found, pitches: seen.len() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::deviation::Deviation;

    fn level(pitch_mm: f64, off: Option<f64>) -> Level {
        let of = |off| Deviation { max_mm: 5.0 * off, most_mm: 2.0 * off, rms_mm: off, points: 9, left_out: 0 };
        Level {
            pitch_mm,
            particles: 9,
            extrapolated: true,
            doubt: None,
            time_orders: Vec::new(),
            from_finest: off.map(of),
            space_error: None,
        }
    }

    #[test]
    fn the_error_of_a_pitch_is_more_than_what_is_seen_against_the_finest() {
        let error = |h: f64| 0.02 * h.powf(1.5);
        let seen = |h: f64| level(h, Some(error(h) - error(2.25)));
        let mut levels = [seen(6.0), seen(4.5), seen(3.0), level(2.25, None)];
        let law = space_errors(&mut levels).unwrap();
        assert!(law.found && (law.order - 1.5).abs() < 0.12, "{law:?}");
        for level in levels {
            let Sizes { max_mm, rms_mm } = level.space_error.unwrap();
            // Leaning towards a power of 1 makes errors a little too large.
            let ratio = rms_mm / error(level.pitch_mm);
            assert!(ratio > 0.97 && ratio < 1.15, "{ratio}");
            assert!((max_mm / rms_mm - 5.0).abs() < 1e-9);
        }
    }

    #[test]
    fn one_pitch_tells_no_power() {
        let mut levels = [level(4.0, Some(0.1)), level(2.0, None)];
        let law = space_errors(&mut levels).unwrap();
        assert!(!law.found && law.order == 1.0);
        assert!((levels[0].space_error.unwrap().rms_mm - 0.2).abs() < 1e-12);
        assert_eq!(space_errors(&mut [level(3.0, None)]), None);
        // Nearer at a coarser pitch: no power does that.
        let mut levels = [level(20.0, Some(9.1)), level(15.0, Some(2.6)), level(10.0, Some(3.2)), level(7.5, None)];
        assert!(!space_errors(&mut levels).unwrap().found);
    }
}
