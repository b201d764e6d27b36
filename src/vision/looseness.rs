//! Looseness: how far the strands are from their regular places, and how sure that is.
//!
//! The strands of a rope under tension stand a regular step apart. What the smoother tells of their deviations is the mean of what
//! they may be: it is drawn to a regular rope by as much as is uncertain. So noise does not make it look loose, and the mean square of what
//! the deviations may be is that of their means and their variance. Without the variance, a view that sees badly would call every
//! rope tight.

use super::course::Course;
use super::diameter::WithSd;
use nalgebra::DMatrix;

/// Places of a stretch at which the courses' covariances are asked: deviations change over a few rope diameters.
const PLACES: usize = 5;

/// Share of its deviation that a single strand is followed by, and how far that is known: registration takes neighbours to stand still,
/// which hide and shade it. Measured on simulated ropes of 12 constructions: 0.89 to 1.01.
const FOLLOWED: f64 = 0.95;
const FOLLOWED_SD: f64 = 0.065;

/// Root mean square of the strands' deviations from their regular places in rad over `knots`. `phases_rad[knot * strands + j]` are those of the
/// stretch; `None` if not all strands are known. `scale` is the factor on the courses' standard deviations.
pub(super) fn spread(
    courses: &[&Course],
    knots: std::ops::Range<usize>,
    phases_rad: &[f64],
    step_rad: f64,
    scale: f64,
) -> Option<WithSd> {
    let n = courses.len();
    if n < 2 || knots.len() < PLACES || phases_rad.len() != knots.len() * n {
        return None;
    }
    let deviations = |knot: usize| -> Vec<f64> {
        let row = &phases_rad[knot * n..(knot + 1) * n];
        let off: Vec<f64> = row.iter().enumerate().map(|(j, phase)| phase - j as f64 * step_rad).collect();
        let mean = off.iter().sum::<f64>() / n as f64;
        off.iter().map(|off| off - mean).collect()
    };
    let squares: f64 = (0..knots.len()).flat_map(deviations).map(|d| d * d).sum::<f64>() / phases_rad.len() as f64;
    let places: Vec<usize> = (0..PLACES).map(|p| (2 * p + 1) * knots.len() / (2 * PLACES)).collect();
    let at_places: Vec<Vec<f64>> = places.iter().map(|&knot| deviations(knot)).collect();
    let knots: Vec<usize> = places.iter().map(|&place| knots.start + place).collect();
    // Variance of the mean square: 4 d'Cd + 2 tr(CC), C being the covariance of the deviations d.
    let (mut uncertain, mut variance) = (0.0, 0.0);
    let entries = (n * PLACES) as f64;
    let left = (n as f64 - 1.0) / n as f64; // the mean over the strands is taken out
    for (j, course) in courses.iter().enumerate() {
        let covariance: DMatrix<f64> = course.phase_covariance(&knots) * (scale * scale * left);
        uncertain += covariance.trace() / entries;
        variance += 2.0 * covariance.norm_squared() / entries.powi(2);
        for (a, b) in (0..PLACES).flat_map(|a| (0..PLACES).map(move |b| (a, b))) {
            variance += 4.0 * at_places[a][j] * covariance[(a, b)] * at_places[b][j] / entries.powi(2);
        }
    }
    let value = (squares + uncertain).sqrt();
    let sd = variance.sqrt() / (2.0 * value); // d(root) = d(square) / 2 root
    Some(WithSd { value: value / FOLLOWED, sd: (sd / FOLLOWED).hypot(FOLLOWED_SD * value) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::smoothing::{CoursePrior, Measurement, smooth};

    const STEP: f64 = 1.0;
    const KNOTS: usize = 60;

    /// Looseness of three strands of which the first is `off_rad` from its place, measured with this standard deviation.
    fn looseness(off_rad: f64, sd: f64) -> WithSd {
        let prior = CoursePrior { spacing_mm: 5.0, wander: 1e-9, rate_rad_per_mm: 0.03, rate_sd: 1e-3 };
        let courses: Vec<Course> = (0..3)
            .map(|j| {
                let off = if j == 0 { off_rad } else { 0.0 };
                let value = |k: usize| 0.15 * k as f64 + j as f64 * STEP + off;
                let measured = |k| Measurement { value_rad: value(k), information: sd.powi(-2) };
                smooth(&(0..KNOTS).map(measured).collect::<Vec<_>>(), prior).unwrap()
            })
            .collect();
        let knots = 10..50;
        let phases: Vec<f64> = knots.clone().flat_map(|k| courses.iter().map(move |c| c.phase_rad(k))).collect();
        spread(&courses.iter().collect::<Vec<_>>(), knots, &phases, STEP, 1.0).unwrap()
    }

    #[test]
    fn it_is_the_spread_of_the_strands_about_their_regular_places() {
        // One of three off by d: deviations 2/3 d, -1/3 d, -1/3 d, whose root mean square is sqrt(2)/3 d.
        let (found, expected) = (looseness(0.03, 1e-4), 0.03 * 2f64.sqrt() / 3.0 / FOLLOWED);
        assert!((found.value / expected - 1.0).abs() < 1e-3, "{found:?}");
    }

    #[test]
    fn what_was_measured_badly_may_be_looser_and_is_less_certain() {
        let (well, badly) = (looseness(0.003, 1e-3), looseness(0.003, 2e-2));
        assert!(badly.value > well.value && badly.sd > 3.0 * well.sd, "{well:?} {badly:?}");
    }
}
