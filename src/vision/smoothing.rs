//! Joins measurements of a slowly varying phase along the rope into one smooth course, with its uncertainty.
//!
//! The paper estimates every frame on its own. Here neighbouring stretches share a slowly varying state: phase and rate follow an
//! integrated random walk (a cubic smoothing spline), so that ramps pass unchanged and a step of the lay length is followed
//! within a few knots. The posterior is solved exactly as a banded least-squares problem, and any linear function of it, such
//! as the slope over a stretch, gets its own standard deviation.

use super::banded::Banded;
use super::course::{Course, Spread};
use super::encoder::EncoderCourse;
use nalgebra::{DMatrix, DVector, Matrix2, SMatrix, SVector, Vector2};
use std::sync::Arc;

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

/// What is measured at one knot of S/2 courses side by side. The state is (phase, rate) of the first, then of the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation<const S: usize> {
    information: SMatrix<f64, S, S>,
    weighted: SVector<f64, S>,
}

impl<const S: usize> Default for Observation<S> {
    fn default() -> Self {
        Self { information: SMatrix::zeros(), weighted: SVector::zeros() }
    }
}

impl<const S: usize> Observation<S> {
    /// Adds that the sum of `share * phase` over the courses was measured.
    pub fn add(&mut self, shares: &[f64], measured: Measurement) {
        for (a, &share) in shares.iter().enumerate() {
            self.weighted[2 * a] += share * measured.information * measured.value_rad;
            for (b, &other) in shares.iter().enumerate() {
                self.information[(2 * a, 2 * b)] += share * other * measured.information;
            }
        }
    }

    fn says_something(&self) -> bool {
        self.information.trace() > 0.0
    }
}

/// Process noise of an integrated random walk over `h` mm, inverted.
fn inverse_process_noise(h: f64, wander: f64) -> Matrix2<f64> {
    let scale = 12.0 / (wander * h * h * h);
    Matrix2::new(1.0, -h / 2.0, -h / 2.0, h * h / 3.0) * scale
}

/// Solves for one course. `None` if fewer than two knots were measured: nothing is known then.
pub fn smooth(measurements: &[Measurement], prior: CoursePrior) -> Option<Course> {
    let observations: Vec<Observation<2>> = measurements
        .iter()
        .map(|&measured| {
            let mut observation = Observation::default();
            observation.add(&[1.0], measured);
            observation
        })
        .collect();
    Chain::new(observations, &[prior])?.courses(None).pop()
}

/// S/2 courses that were measured together, solved as if every line were where the encoder says.
#[derive(Debug)]
pub(super) struct Chain<const S: usize> {
    priors: Vec<CoursePrior>,
    factor: Banded<S>,
    states: Vec<SVector<f64, S>>,
    observations: Vec<Observation<S>>,
    /// How the state changes with the position: the expected rates.
    per_mm: SVector<f64, S>,
}

impl<const S: usize> Chain<S> {
    /// Solves. `None` if fewer than two knots were measured.
    pub fn new(observations: Vec<Observation<S>>, priors: &[CoursePrior]) -> Option<Self> {
        if observations.iter().filter(|o| o.says_something()).count() < 2 {
            return None;
        }
        let n = observations.len();
        let h = priors.first()?.spacing_mm;
        // x_k+1 = F x_k + noise; rates are kept as deviations from the expected one, phases as measured.
        let mut transition = SMatrix::<f64, S, S>::identity();
        let mut precision = SMatrix::<f64, S, S>::zeros();
        let mut drift = SVector::<f64, S>::zeros();
        let mut per_mm = SVector::<f64, S>::zeros();
        for (part, prior) in priors.iter().enumerate() {
            transition[(2 * part, 2 * part + 1)] = h;
            precision.fixed_view_mut::<2, 2>(2 * part, 2 * part).copy_from(&inverse_process_noise(h, prior.wander));
            drift[2 * part] = prior.rate_rad_per_mm * h;
            per_mm[2 * part] = prior.rate_rad_per_mm;
        }
        let mut diagonal: Vec<_> = observations.iter().map(|o| o.information).collect();
        let mut right: Vec<_> = observations.iter().map(|o| o.weighted).collect();
        for k in 0..n {
            for (part, prior) in priors.iter().enumerate() {
                // One weak statement, spread over all knots.
                diagonal[k][(2 * part + 1, 2 * part + 1)] += prior.rate_sd.powi(-2) / n as f64;
            }
            if k + 1 < n {
                diagonal[k] += transition.transpose() * precision * transition;
                diagonal[k + 1] += precision;
                right[k] -= transition.transpose() * precision * drift;
                right[k + 1] += precision * drift;
            }
        }
        let factor = Banded::new(&diagonal, -precision * transition)?;
        let states = factor.solve(right);
        Some(Self { priors: priors.to_vec(), factor, states, observations, per_mm })
    }

    pub fn knots(&self) -> usize {
        self.states.len()
    }

    pub fn spacing_mm(&self) -> f64 {
        self.priors[0].spacing_mm
    }

    /// What the measurements at a knot say of the encoder's error there, the states being as they were solved: information, and
    /// information times error.
    pub fn of_encoder(&self, knot: usize) -> (f64, f64) {
        let Observation { information, weighted } = &self.observations[knot];
        (self.per_mm.dot(&(information * self.per_mm)), self.per_mm.dot(&(weighted - information * self.states[knot])))
    }

    /// How the states change with an encoder's error of `error_mm(knot)`, which takes part of the phases.
    pub fn change(&self, error_mm: impl Fn(usize) -> f64) -> Vec<SVector<f64, S>> {
        let right = |(k, o): (usize, &Observation<S>)| -(o.information * self.per_mm) * error_mm(k);
        self.factor.solve(self.observations.iter().enumerate().map(right).collect())
    }

    /// What those changes say of the encoder's error at a knot: information that the states take away, as a share of it.
    pub fn taken_away(&self, knot: usize, change: &SVector<f64, S>) -> f64 {
        self.per_mm.dot(&(self.observations[knot].information * change))
    }

    /// The courses, with the encoder's error added to where they were measured.
    pub fn courses(self, encoder: Option<&Arc<EncoderCourse>>) -> Vec<Course>
    where
        Self: 'static,
    {
        let changes = encoder.map(|encoder| self.change(|knot| encoder.error_mm(knot)));
        let of = |part: usize, prior: &CoursePrior| -> Vec<Vector2<f64>> {
            let state = |(k, x): (usize, &SVector<f64, S>)| {
                let mut state = Vector2::new(x[2 * part], x[2 * part + 1] + prior.rate_rad_per_mm);
                if let (Some(encoder), Some(changes)) = (encoder, &changes) {
                    state[0] += changes[k][2 * part] + prior.rate_rad_per_mm * encoder.error_mm(k);
                    state[1] += changes[k][2 * part + 1] + prior.rate_rad_per_mm * encoder.error_per_mm(k);
                }
                state
            };
            self.states.iter().enumerate().map(state).collect()
        };
        let states: Vec<_> = self.priors.iter().enumerate().map(|(part, prior)| of(part, prior)).collect();
        let spacing_mm = self.spacing_mm();
        let chain: Arc<dyn Spread> = Arc::new(self);
        let course = |(part, states)| Course::new(spacing_mm, states, chain.clone(), encoder.cloned(), part);
        states.into_iter().enumerate().map(course).collect()
    }
}

impl<const S: usize> Spread for Chain<S> {
    fn spread(
        &self,
        part: usize,
        first: usize,
        weights: &[f64],
        encoder: Option<&EncoderCourse>,
    ) -> (f64, DVector<f64>) {
        let mut b = vec![SVector::<f64, S>::zeros(); self.knots()];
        for (k, w) in weights.iter().enumerate() {
            b[first + k][2 * part] = *w;
        }
        let solved = self.factor.solve(b);
        let variance = weights.iter().enumerate().map(|(k, w)| w * solved[first + k][2 * part]).sum();
        let Some(encoder) = encoder else { return (variance, DVector::zeros(0)) };
        let changes = encoder.at_nodes(|knot| {
            let own = knot.checked_sub(first).and_then(|k| weights.get(k)).map_or(0.0, |w| w * self.per_mm[2 * part]);
            own - self.taken_away(knot, &solved[knot])
        });
        (variance, changes)
    }

    fn variances(&self, part: usize, encoder: Option<&EncoderCourse>) -> Vec<f64> {
        let own = self.factor.diagonal_of_inverse().into_iter().map(|block| block[(2 * part, 2 * part)]);
        let Some(encoder) = encoder else { return own.collect() };
        // How the phases change with every node: of these there are fewer than knots.
        let of_node = |share: &dyn Fn(usize) -> f64| -> Vec<f64> {
            let changes = self.change(share).into_iter().enumerate();
            changes.map(|(knot, change)| change[2 * part] + self.per_mm[2 * part] * share(knot)).collect()
        };
        let of_nodes: Vec<Vec<f64>> = encoder.shares().map(|share| of_node(&share)).collect();
        let shared = |knot: usize| encoder.variance(&DVector::from_fn(of_nodes.len(), |node, _| of_nodes[node][knot]));
        own.enumerate().map(|(knot, own)| own + shared(knot)).collect()
    }

    fn covariance(&self, part: usize, knots: &[usize]) -> DMatrix<f64> {
        let mut covariance = DMatrix::zeros(knots.len(), knots.len());
        for (column, &knot) in knots.iter().enumerate() {
            let mut unit = vec![SVector::<f64, S>::zeros(); self.knots()];
            unit[knot][2 * part] = 1.0;
            let solved = self.factor.solve(unit);
            for (row, &other) in knots.iter().enumerate() {
                covariance[(row, column)] = solved[other][2 * part];
            }
        }
        covariance
    }
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
