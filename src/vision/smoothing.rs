//! Joins measurements of a slowly varying phase along the rope into one smooth course, with its uncertainty.
//!
//! The paper estimates every frame on its own. Here neighbouring stretches share a slowly varying state: phase and rate follow an
//! integrated random walk (a cubic smoothing spline), so that ramps pass unchanged and a step of the lay length is followed
//! within a few knots. The posterior is solved exactly as a banded least-squares problem, and any linear function of it, such
//! as the slope over a stretch, gets its own standard deviation.

use nalgebra::{Matrix2, Vector2};

/// A measured phase at one knot: the information form of "phase = value, with variance 1/information".
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Measurement {
    /// Phase in rad; meaningless where `information` is 0.
    pub value_rad: f64,
    /// Inverse variance in 1/rad^2; 0 where nothing was measured.
    pub information: f64,
}

/// What is known of the course before measuring.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CoursePrior {
    /// Distance of the knots in mm.
    pub spacing_mm: f64,
    /// Spectral density of the change of rate in rad^2/mm^3.
    pub wander: f64,
    /// Expected rate in rad/mm, and how far it may be off.
    pub rate_rad_per_mm: f64,
    /// Standard deviation of the expected rate in rad/mm.
    pub rate_sd: f64,
}

/// Smoothed phase at every knot, and the factors that answer for its uncertainty.
#[derive(Debug, Clone)]
pub struct Course {
    spacing_mm: f64,
    states: Vec<Vector2<f64>>,
    /// Inverse of the diagonal blocks of the block LDL^T factor, and the sub-diagonal multipliers.
    pivots: Vec<Matrix2<f64>>,
    links: Vec<Matrix2<f64>>,
}

/// Process noise of an integrated random walk over `h` mm, inverted.
fn inverse_process_noise(h: f64, wander: f64) -> Matrix2<f64> {
    let scale = 12.0 / (wander * h * h * h);
    Matrix2::new(1.0, -h / 2.0, -h / 2.0, h * h / 3.0) * scale
}

/// Solves for the course. `None` if fewer than two knots were measured: nothing is known then.
pub fn smooth(measurements: &[Measurement], prior: CoursePrior) -> Option<Course> {
    if measurements.iter().filter(|m| m.information > 0.0).count() < 2 {
        return None;
    }
    let n = measurements.len();
    let h = prior.spacing_mm;
    // x_k+1 = F x_k + noise; rates are kept as deviations from the expected one, phases as measured.
    let transition = Matrix2::new(1.0, h, 0.0, 1.0);
    let precision = inverse_process_noise(h, prior.wander);
    let drift = Vector2::new(prior.rate_rad_per_mm * h, 0.0);
    let mut diagonal = vec![Matrix2::zeros(); n];
    let mut right = vec![Vector2::zeros(); n];
    for (k, m) in measurements.iter().enumerate() {
        diagonal[k][(0, 0)] += m.information;
        right[k][0] += m.information * m.value_rad;
        diagonal[k][(1, 1)] += prior.rate_sd.powi(-2) / n as f64; // one weak statement, spread over all knots
        if k + 1 < n {
            diagonal[k] += transition.transpose() * precision * transition;
            diagonal[k + 1] += precision;
            right[k] -= transition.transpose() * precision * drift;
            right[k + 1] += precision * drift;
        }
    }
    let off = -precision * transition; // block (k+1, k)
    let mut pivots = Vec::with_capacity(n);
    let mut links = Vec::with_capacity(n);
    for k in 0..n {
        let mut d = diagonal[k];
        if k > 0 {
            let link: Matrix2<f64> = off * pivots[k - 1];
            d -= link * off.transpose();
            links.push(link);
        }
        pivots.push(d.try_inverse()?);
    }
    let mut course = Course { spacing_mm: h, states: Vec::new(), pivots, links };
    course.states = course.solve(right);
    for state in &mut course.states {
        state[1] += prior.rate_rad_per_mm;
    }
    Some(course)
}

impl Course {
    fn solve(&self, mut b: Vec<Vector2<f64>>) -> Vec<Vector2<f64>> {
        for k in 1..b.len() {
            let carried = self.links[k - 1] * b[k - 1];
            b[k] -= carried;
        }
        for k in (0..b.len()).rev() {
            b[k] = self.pivots[k] * b[k];
            if k + 1 < b.len() {
                let carried = self.links[k].transpose() * b[k + 1];
                b[k] -= carried;
            }
        }
        b
    }

    /// Number of knots.
    pub fn len(&self) -> usize {
        self.states.len()
    }

    /// True without knots.
    pub fn is_empty(&self) -> bool {
        self.states.is_empty()
    }

    /// Phase at a knot in rad.
    pub fn phase_rad(&self, knot: usize) -> f64 {
        self.states[knot][0]
    }

    /// Rate at a knot in rad/mm.
    pub fn rate_rad_per_mm(&self, knot: usize) -> f64 {
        self.states[knot][1]
    }

    /// Regression slope of the phase over `knots` in rad/mm: what a lay length is (2 pi/slope).
    pub fn slope_rad_per_mm(&self, knots: std::ops::Range<usize>) -> f64 {
        slope_weights(knots.len(), self.spacing_mm).zip(knots).map(|(w, k)| w * self.states[k][0]).sum()
    }

    /// Variance of the phase at a knot in rad^2.
    pub fn phase_variance(&self, knot: usize) -> f64 {
        let mut b = vec![Vector2::zeros(); self.len()];
        b[knot][0] = 1.0;
        self.solve(b)[knot][0]
    }

    /// Variance of [`Self::slope_rad_per_mm`] in rad^2/mm^2.
    pub fn slope_variance(&self, knots: std::ops::Range<usize>) -> f64 {
        let mut b = vec![Vector2::zeros(); self.len()];
        for (w, k) in slope_weights(knots.len(), self.spacing_mm).zip(knots.clone()) {
            b[k][0] = w;
        }
        let solved = self.solve(b);
        slope_weights(knots.len(), self.spacing_mm).zip(knots).map(|(w, k)| w * solved[k][0]).sum()
    }
}

/// Weights that turn equally spaced values into their regression slope.
pub fn slope_weights(n: usize, spacing_mm: f64) -> impl Iterator<Item = f64> {
    let middle = (n as f64 - 1.0) / 2.0;
    let squares = n as f64 * (n as f64 * n as f64 - 1.0) / 12.0;
    (0..n).map(move |k| (k as f64 - middle) / (squares * spacing_mm))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn prior() -> CoursePrior {
        CoursePrior { spacing_mm: 5.0, wander: 1e-8, rate_rad_per_mm: 0.0, rate_sd: 0.1 }
    }

    #[test]
    fn a_straight_course_comes_back_exactly_even_over_gaps() {
        let measured: Vec<Measurement> = (0..60)
            .map(|k| Measurement {
                value_rad: 0.3 + 0.02 * 5.0 * f64::from(k),
                information: if (20..40).contains(&k) { 0.0 } else { 1e4 },
            })
            .collect();
        let course = smooth(&measured, CoursePrior { rate_sd: 1e3, ..prior() }).unwrap();
        assert!((course.slope_rad_per_mm(0..60) - 0.02).abs() < 1e-9);
        assert!((course.phase_rad(30) - 3.3).abs() < 1e-6);
    }

    #[test]
    fn the_stated_uncertainty_is_that_of_least_squares_when_nothing_wanders() {
        let measured = vec![Measurement { value_rad: 0.0, information: 100.0 }; 40];
        let course = smooth(&measured, CoursePrior { wander: 1e-16, rate_sd: 1e3, ..prior() }).unwrap();
        let squares = 25.0 * 40.0 * (1600.0 - 1.0) / 12.0;
        let expected = 1.0 / (100.0 * squares);
        assert!((course.slope_variance(0..40) / expected - 1.0).abs() < 1e-3);
    }

    #[test]
    fn without_measurements_there_is_no_course() {
        assert!(smooth(&[Measurement::default(); 9], prior()).is_none());
    }
}
