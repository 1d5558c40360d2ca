//! Observed orders: with which power one thing follows another.

/// A power law `y = factor x^slope`, fitted by least squares of the logarithms.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct PowerLaw {
    /// The power.
    pub slope: f64,
    /// The value at `x = 1`.
    pub factor: f64,
}

/// Fits a power law through points with positive coordinates; others are left out. `None` for fewer than two different x.
pub fn fit(points: &[[f64; 2]]) -> Option<PowerLaw> {
    let usable = |p: &&[f64; 2]| p.iter().all(|&x| x > 0.0 && x.is_finite());
    let logs: Vec<[f64; 2]> = points.iter().filter(usable).map(|p| p.map(f64::ln)).collect();
    let mean = |axis: usize| logs.iter().map(|p| p[axis]).sum::<f64>() / logs.len() as f64;
    let (x, y) = (mean(0), mean(1));
    let spread: f64 = logs.iter().map(|p| (p[0] - x).powi(2)).sum();
    if logs.len() < 2 || spread < 1e-12 {
        return None;
    }
    let slope = logs.iter().map(|p| (p[0] - x) * (p[1] - y)).sum::<f64>() / spread;
    Some(PowerLaw { slope, factor: (y - slope * x).exp() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_power_law_is_found_again() {
        let points: Vec<[f64; 2]> = [0.1, 0.2, 0.5, 1.0].map(|x: f64| [x, 3.0 * x.powf(1.25)]).to_vec();
        let law = fit(&points).unwrap();
        assert!((law.slope - 1.25).abs() < 1e-12 && (law.factor - 3.0).abs() < 1e-12);
        assert_eq!(fit(&points[..1]), None);
        assert_eq!(fit(&[[1.0, 2.0], [1.0, 3.0], [2.0, 0.0]]), None);
    }
}
