//! A curve that drifts smoothly along the rope: a constant and a few sine waves, so that slope and integral are exact.

use rand::Rng;
use std::f64::consts::TAU;
use std::ops::Range;

/// value(x) = constant + sum of amplitude * sin(per_mm * x + phase).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SmoothCurve {
    constant: f64,
    terms: Vec<Term>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Term {
    amplitude: f64,
    per_mm: f64,
    phase: f64,
}

impl SmoothCurve {
    /// The same value everywhere.
    pub fn constant(value: f64) -> Self {
        Self { constant: value, terms: Vec::new() }
    }

    /// Waves that together never leave `centre` by more than `reach`; wavelengths are spread over `wavelengths_mm`.
    pub fn waves(rng: &mut impl Rng, centre: f64, reach: f64, wavelengths_mm: Range<f64>, terms: usize) -> Self {
        let weights: Vec<f64> = (0..terms).map(|_| 0.3 + rng.random::<f64>()).collect();
        let sum: f64 = weights.iter().sum();
        let span = (wavelengths_mm.end / wavelengths_mm.start).ln();
        let terms = weights
            .into_iter()
            .enumerate()
            .map(|(n, weight)| {
                // one wave a part of the interval, evenly on a logarithmic scale
                let at = (n as f64 + rng.random::<f64>()) / terms as f64;
                Term {
                    amplitude: reach * weight / sum,
                    per_mm: TAU / (wavelengths_mm.start * (span * at).exp()),
                    phase: rng.random::<f64>() * TAU,
                }
            })
            .collect();
        Self { constant: centre, terms }
    }

    /// The same curve moved so that it starts at zero.
    pub fn from_zero(mut self) -> Self {
        self.constant -= self.value(0.0);
        self
    }

    /// Value at `x_mm`.
    pub fn value(&self, x_mm: f64) -> f64 {
        self.constant + self.terms.iter().map(|t| t.amplitude * (t.per_mm * x_mm + t.phase).sin()).sum::<f64>()
    }

    /// Change per mm at `x_mm`.
    pub fn slope(&self, x_mm: f64) -> f64 {
        self.terms.iter().map(|t| t.amplitude * t.per_mm * (t.per_mm * x_mm + t.phase).cos()).sum()
    }

    /// Integral from 0 to `x_mm`.
    pub fn integral(&self, x_mm: f64) -> f64 {
        let waves: f64 = self
            .terms
            .iter()
            .map(|t| t.amplitude / t.per_mm * (t.phase.cos() - (t.per_mm * x_mm + t.phase).cos()))
            .sum();
        self.constant * x_mm + waves
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn integral_and_slope_belong_to_the_value() {
        let curve = SmoothCurve::waves(&mut ChaCha8Rng::seed_from_u64(1), 3.0, 2.0, 50.0..900.0, 4);
        let (x, h) = (321.0, 1e-3);
        assert!(((curve.integral(x + h) - curve.integral(x - h)) / (2.0 * h) - curve.value(x)).abs() < 1e-6);
        assert!(((curve.value(x + h) - curve.value(x - h)) / (2.0 * h) - curve.slope(x)).abs() < 1e-6);
        assert_eq!(curve.integral(0.0), 0.0);
    }

    #[test]
    fn a_curve_stays_within_its_reach() {
        let curve = SmoothCurve::waves(&mut ChaCha8Rng::seed_from_u64(7), 10.0, 2.0, 50.0..900.0, 5);
        assert!((0..20_000).map(|x| curve.value(f64::from(x))).all(|v| (8.0..=12.0).contains(&v)));
        assert!(curve.from_zero().value(0.0).abs() < 1e-12);
    }
}
