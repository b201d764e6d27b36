//! The bound of a smoothed sequence: neighbouring frames know something of each other, as far as the lay does not drift.
//!
//! The phase is a Gaussian process: unknown phase, unknown mean lay, and a drift of the lay with known statistics. Its posterior
//! variance, given the contours' information at every place, bounds every estimator on average over such ropes.

use super::lay::{contour_information, lay_sd_mm};
use super::seen::SeenRope;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::TAU;

/// How the lay drifts: waves of random phase whose lengths are spread evenly on a logarithmic scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drift {
    /// Standard deviation of the turn per mm that the waves make together, in rad/mm.
    pub rate_sd: f64,
    /// Shortest and longest wave in mm.
    pub waves_mm: (f64, f64),
}

/// Lengths of waves that stand for all.
const WAVES: usize = 24;
/// Places a stretch at which the phase is a variable.
const PLACES: usize = 40;
/// Variance of a phase of which nothing is known, in rad^2.
const UNKNOWN_PHASE: f64 = 10.0;
/// Variance of the mean turn per mm, as a share of its square: a tenth of the lay is unknown beforehand.
const UNKNOWN_LAY: f64 = 0.01;

impl Drift {
    /// Covariance of the drift's part of the phase at two places, both counted from the same origin, in mm.
    fn covariance(&self, a: f64, b: f64) -> f64 {
        let ratio = self.waves_mm.1 / self.waves_mm.0;
        let wave = |n: usize| TAU / (self.waves_mm.0 * ratio.powf((n as f64 + 0.5) / WAVES as f64));
        let of = |k: f64| (1.0 - (k * a).cos() - (k * b).cos() + (k * (a - b)).cos()) / (k * k);
        self.rate_sd * self.rate_sd * (0..WAVES).map(|n| of(wave(n))).sum::<f64>() / WAVES as f64
    }
}

/// Least standard deviation in mm of the strand lay of the middle one of `stretches` (an odd number) of `lines` each, from the
/// contours of one view of all of them. `None` if the numbers make no solvable problem.
pub fn sequence_bound_mm(
    rope: &SeenRope,
    lay_mm: f64,
    (stretches, lines): (usize, usize),
    pitch_mm: f64,
    contour_noise_px: f64,
    drift: Drift,
) -> Option<f64> {
    let step_mm = lines as f64 * pitch_mm / PLACES as f64;
    let places = stretches * PLACES;
    let at_mm = |k: usize| (k as f64 + 0.5 - places as f64 / 2.0) * step_mm;
    let lay_variance = UNKNOWN_LAY * (TAU / lay_mm).powi(2);
    let prior = DMatrix::from_fn(places, places, |a, b| {
        let (a, b) = (at_mm(a), at_mm(b));
        UNKNOWN_PHASE + lay_variance * a * b + drift.covariance(a, b)
    });
    let per_place = lines as f64 / PLACES as f64;
    let information = DVector::from_fn(places, |k, _| {
        // the mean over the place: information is zero in single points only
        const PARTS: usize = 8;
        let part = |p: usize| at_mm(k) + step_mm * ((p as f64 + 0.5) / PARTS as f64 - 0.5);
        let mean = (0..PARTS).map(|p| contour_information(rope, part(p) * TAU / lay_mm, contour_noise_px)).sum::<f64>();
        per_place * mean / PARTS as f64
    });
    // (K^-1 + J)^-1 = K (1 + J K)^-1, which needs no inverse of the nearly singular K
    let mut system = DMatrix::from_fn(places, places, |a, b| information[a] * prior[(a, b)]);
    for k in 0..places {
        system[(k, k)] += 1.0;
    }
    // the lay of a stretch is the regression slope of its phases
    let first = stretches / 2 * PLACES;
    let squares: f64 = (first..first + PLACES).map(|k| at_mm(k).powi(2)).sum();
    let slope =
        DVector::from_fn(places, |k, _| if (first..first + PLACES).contains(&k) { at_mm(k) / squares } else { 0.0 });
    let reached = system.lu().solve(&DMatrix::identity(places, places))?;
    let variance = (slope.transpose() * (&prior * reached) * &slope)[(0, 0)];
    (variance > 0.0).then(|| lay_sd_mm(lay_mm, variance.sqrt()))
}

#[cfg(test)]
mod tests {
    use super::super::lay::usual_contour_bound_mm;
    use super::*;

    const NONE: Drift = Drift { rate_sd: 0.0, waves_mm: (6000.0, 60_000.0) };

    fn rope() -> SeenRope {
        SeenRope::new(6, 9, 20.46, 380.0, 143.0)
    }

    #[test]
    fn a_single_stretch_knows_what_a_frame_knows() {
        let alone = sequence_bound_mm(&rope(), 137.5, (1, 2000), 0.1, 1.0, NONE).unwrap();
        let frame = usual_contour_bound_mm(&rope(), 137.5, (2000, 0.1), 1.0);
        assert!((alone / frame - 1.0).abs() < 0.12, "{alone} {frame}"); // this beginning against the mean of all
    }

    #[test]
    fn neighbours_help_and_the_more_so_the_less_the_lay_drifts() {
        let bound = |stretches, rate_sd| {
            sequence_bound_mm(&rope(), 137.5, (stretches, 2000), 0.1, 1.0, Drift { rate_sd, ..NONE }).unwrap()
        };
        assert!(bound(3, 0.0) < 0.25 * bound(1, 0.0)); // constant lay: 3^1.5 = 5.2 times as much is known
        assert!(bound(3, 2e-3) < bound(1, 2e-3) && bound(3, 2e-3) > 1.5 * bound(3, 0.0));
    }
}
