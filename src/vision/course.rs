//! A smooth course along the rope, and how sure it and everything read off it is.
//!
//! Whatever is linear in the phases, such as their slope over a stretch, has a standard deviation of its own: neighbouring phases err
//! together.

use super::encoder::EncoderCourse;
use nalgebra::{DMatrix, DVector, Vector2};
use std::sync::Arc;

/// Answers for the uncertainty of what was smoothed together.
pub(super) trait Spread: std::fmt::Debug + Send + Sync {
    /// Variance of the sum of `weight * phase of part at knot` over consecutive knots from `first` on, were the encoder's error known,
    /// and how this sum changes with the nodes of that error.
    fn spread(
        &self,
        part: usize,
        first: usize,
        weights: &[f64],
        encoder: Option<&EncoderCourse>,
    ) -> (f64, DVector<f64>);

    /// Variance of the phase of a part at every knot, the encoder's error included.
    fn variances(&self, part: usize, encoder: Option<&EncoderCourse>) -> Vec<f64>;

    /// Covariance of the phases of a part at some knots, were the encoder's error known.
    fn covariance(&self, part: usize, knots: &[usize]) -> DMatrix<f64>;
}

/// Smoothed phase at every knot, and what answers for its uncertainty.
#[derive(Debug, Clone)]
pub struct Course {
    spacing_mm: f64,
    states: Vec<Vector2<f64>>,
    /// Shared by the courses that were smoothed together; this is the one of number `part`.
    chain: Arc<dyn Spread>,
    encoder: Option<Arc<EncoderCourse>>,
    part: usize,
}

impl Course {
    /// The part of this number of what `chain` smoothed.
    pub(super) fn new(
        spacing_mm: f64,
        states: Vec<Vector2<f64>>,
        chain: Arc<dyn Spread>,
        encoder: Option<Arc<EncoderCourse>>,
        part: usize,
    ) -> Self {
        Self { spacing_mm, states, chain, encoder, part }
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
        Self::mean_variance(&[self], knot, &[1.0])
    }

    /// The same at every knot: a solve for every node of the encoder's error instead of one for every knot.
    pub fn phase_variances(&self) -> Vec<f64> {
        self.chain.variances(self.part, self.encoder.as_deref())
    }

    /// Covariance of the phases at some knots in rad^2, but for the encoder's error, which is the same for all courses.
    pub fn phase_covariance(&self, knots: &[usize]) -> DMatrix<f64> {
        self.chain.covariance(self.part, knots)
    }

    /// Variance of the mean phase of several courses at a knot in rad^2.
    pub fn mean_phase_variance(courses: &[&Self], knot: usize) -> f64 {
        Self::mean_variance(courses, knot, &[1.0])
    }

    /// Variance of [`Self::slope_rad_per_mm`] in rad^2/mm^2.
    pub fn slope_variance(&self, knots: std::ops::Range<usize>) -> f64 {
        Self::mean_slope_variance(&[self], knots)
    }

    /// Variance of the mean slope of several courses in rad^2/mm^2. The encoder's error is the same for all, so it does not average out.
    pub fn mean_slope_variance(courses: &[&Self], knots: std::ops::Range<usize>) -> f64 {
        let Some(first) = courses.first() else { return f64::INFINITY };
        let weights: Vec<f64> = slope_weights(knots.len(), first.spacing_mm).collect();
        Self::mean_variance(courses, knots.start, &weights)
    }

    fn mean_variance(courses: &[&Self], first: usize, weights: &[f64]) -> f64 {
        let n = courses.len() as f64;
        let mut variance = 0.0;
        let mut shared: Option<(&EncoderCourse, DVector<f64>)> = None;
        for course in courses {
            let encoder = course.encoder.as_deref();
            let (own, changes) = course.chain.spread(course.part, first, weights, encoder);
            variance += own / (n * n);
            match (&mut shared, encoder) {
                (Some((_, sum)), Some(_)) => *sum += changes / n,
                (shared, Some(encoder)) => *shared = Some((encoder, changes / n)),
                (_, None) => {}
            }
        }
        variance + shared.map_or(0.0, |(encoder, changes)| encoder.variance(&changes))
    }
}

/// Weights that turn equally spaced values into their regression slope.
pub fn slope_weights(n: usize, spacing_mm: f64) -> impl Iterator<Item = f64> {
    let middle = (n as f64 - 1.0) / 2.0;
    let squares = n as f64 * (n as f64 * n as f64 - 1.0) / 12.0;
    (0..n).map(move |k| (k as f64 - middle) / (squares * spacing_mm))
}
