//! Axis ranges and round tick values.

/// Ticks of an axis.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Ticks {
    /// Range of the axis, in the unit of the data.
    pub(super) range: [f64; 2],
    /// Values with a label.
    pub(super) major: Vec<(f64, Label)>,
    /// Values with a faint line alone.
    pub(super) minor: Vec<f64>,
    /// The labels are to be multiplied by this power of ten; 0 when they are plain.
    pub(super) exponent: i32,
}

/// What stands at a tick.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Label {
    /// A number as it is.
    Number(String),
    /// A power of ten.
    Power(i32),
}

/// Ticks at multiples of 1, 2 or 5 times a power of ten, about `wanted` of them; with `widen`, the range ends on ticks.
pub(super) fn linear(low: f64, high: f64, wanted: usize, widen: bool) -> Ticks {
    let (low, high) = if high > low {
        (low, high)
    } else {
        // A flat line lies in the middle of a range of its own size.
        let half = if low == 0.0 { 1.0 } else { 0.5 * low.abs() };
        (low - half, high + half)
    };
    let rough = (high - low) / wanted.max(1) as f64;
    let power = 10f64.powi(rough.log10().floor() as i32);
    let step = power * [1.0, 2.0, 5.0, 10.0].into_iter().find(|m| m * power >= rough * 0.999).unwrap_or(10.0);
    // A hair of slack: a range that ends on a tick but for rounding keeps it.
    let (first, last) = if widen {
        ((low / step + 1e-9).floor(), (high / step - 1e-9).ceil())
    } else {
        ((low / step - 1e-9).ceil(), (high / step + 1e-9).floor())
    };
    let range = if widen { [first * step, last * step] } else { [low, high] };
    let largest = range[0].abs().max(range[1].abs());
    let magnitude = largest.log10().floor() as i32;
    let exponent = if (-3..5).contains(&magnitude) { 0 } else { magnitude };
    let unit = 10f64.powi(exponent);
    let decimals = (-(step / unit * 1.000_001).log10().floor()).max(0.0) as usize;
    let count = (last - first).max(0.0) as usize;
    let value = |at: usize| (first + at as f64) * step;
    let label = |value: f64| {
        let text = format!("{:.decimals$}", value / unit);
        // Rounding may leave "-0".
        if text.trim_start_matches('-').chars().all(|c| matches!(c, '0' | '.')) { text.replace('-', "") } else { text }
    };
    let major = (0..=count).map(|at| (value(at), Label::Number(label(value(at))))).collect();
    Ticks { range, major, minor: Vec::new(), exponent }
}

/// Ticks at powers of ten, and at 2 and 5 between them when there are few; `low` and `high` are positive.
pub(super) fn logarithmic(low: f64, high: f64, wanted: usize) -> Ticks {
    let (mut low, mut high) = (low.log10(), high.log10());
    let margin = (0.04 * (high - low)).max(0.05);
    // Kept within what a double can hold.
    low = (low - margin).max(-307.0);
    high = (high + margin).min(308.0);
    let decades = (low.floor() as i32)..=(high.ceil() as i32);
    let stride = ((high - low) / wanted.max(1) as f64).ceil().max(1.0) as i32;
    let inside = |value: f64| (low..=high).contains(&value.log10());
    let (mut major, mut minor) = (Vec::new(), Vec::new());
    // Two decades in sight would leave the axis almost bare.
    let few = high.floor() - low.ceil() < 2.0;
    for decade in decades {
        let power = 10f64.powi(decade);
        for mantissa in 1..10 {
            let value = f64::from(mantissa) * power;
            if !inside(value) {
                continue;
            }
            let labelled =
                if few { matches!(mantissa, 1 | 2 | 5) } else { mantissa == 1 && decade.rem_euclid(stride) == 0 };
            if !labelled {
                minor.push(value);
            } else if few && (-3..5).contains(&decade) {
                major.push((value, Label::Number(format!("{:.*}", (-decade).max(0) as usize, value))));
            } else if mantissa == 1 {
                major.push((value, Label::Power(decade)));
            } else {
                major.push((value, Label::Number(format!("{mantissa}e{decade}"))));
            }
        }
    }
    Ticks { range: [10f64.powf(low), 10f64.powf(high)], major, minor, exponent: 0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(ticks: &Ticks) -> Vec<String> {
        let text = |label: &Label| match label {
            Label::Number(text) => text.clone(),
            Label::Power(power) => format!("10^{power}"),
        };
        ticks.major.iter().map(|(_, label)| text(label)).collect()
    }

    #[test]
    fn linear_ticks_are_round() {
        assert_eq!(labels(&linear(0.0, 100.0, 5, false)), ["0", "20", "40", "60", "80", "100"]);
        let ticks = linear(-0.83, 0.31, 5, true);
        assert_eq!(labels(&ticks), ["-1.0", "-0.5", "0.0", "0.5"]);
        assert_eq!(ticks.range, [-1.0, 0.5]);
        assert_eq!(labels(&linear(0.0, 3.1e-7, 4, true)), ["0", "1", "2", "3", "4"]);
        assert_eq!(linear(0.0, 3.1e-7, 4, true).exponent, -7);
        assert_eq!(linear(0.0, 2.5e6, 4, true).exponent, 6);
    }

    #[test]
    fn a_flat_line_has_a_range() {
        for value in [0.0, 5.0, -3e-9] {
            let ticks = linear(value, value, 5, true);
            assert!(ticks.range[0] < value && value < ticks.range[1] && ticks.major.len() > 2, "{ticks:?}");
        }
    }

    #[test]
    fn log_ticks_are_decades_or_one_two_five() {
        assert_eq!(labels(&logarithmic(1e-4, 1.0, 8)), ["10^-4", "10^-3", "10^-2", "10^-1", "10^0"]);
        assert_eq!(labels(&logarithmic(1.0, 12.0, 8)), ["1", "2", "5", "10"]);
        assert!(logarithmic(1e-12, 1e3, 5).major.len() <= 6);
        let ticks = logarithmic(3.0, 3.0, 5);
        assert!(ticks.range[0] < 3.0 && ticks.range[1] > 3.0);
    }
}
