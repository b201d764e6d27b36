//! Downhill simplex optimisation (Nelder & Mead), as the paper uses it. [Wacker13, sec. 3.3]
//!
//! Own, small and deterministic: bounded evaluations, no chance, and stopping is a result with a reason.

/// Why the optimiser stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Termination {
    /// The simplex became smaller than the tolerances.
    Converged,
    /// The evaluations were used up.
    EvaluationsUsedUp,
}

/// A minimum, and how it was reached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Minimum<const D: usize> {
    /// Best parameters.
    pub at: [f64; D],
    /// Cost there.
    pub cost: f64,
    /// Number of cost evaluations.
    pub evaluations: usize,
    /// Why it stopped.
    pub termination: Termination,
}

/// Minimises `cost` from `start`; `step` spans the first simplex. Stops when every parameter's spread is below `tolerance` times
/// its step, or after `most_evaluations`. A cost that is not a number counts as infinitely bad.
pub fn minimise<const D: usize>(
    mut cost: impl FnMut(&[f64; D]) -> f64,
    start: [f64; D],
    step: [f64; D],
    tolerance: f64,
    most_evaluations: usize,
) -> Minimum<D> {
    let evaluations = std::cell::Cell::new(0);
    let mut evaluate = |at: &[f64; D]| {
        evaluations.set(evaluations.get() + 1);
        let c = cost(at);
        if c.is_nan() { f64::INFINITY } else { c }
    };
    let mut simplex: Vec<([f64; D], f64)> = Vec::with_capacity(D + 1);
    for corner in 0..=D {
        let mut at = start;
        if corner > 0 {
            at[corner - 1] += step[corner - 1];
        }
        simplex.push((at, evaluate(&at)));
    }
    loop {
        simplex.sort_by(|a, b| a.1.total_cmp(&b.1));
        let spread = |d: usize| {
            let values = simplex.iter().map(|s| s.0[d]);
            let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
            high - low
        };
        let converged = (0..D).all(|d| spread(d) <= tolerance * step[d].abs());
        if converged || evaluations.get() >= most_evaluations {
            let (at, cost) = simplex[0];
            let termination = if converged { Termination::Converged } else { Termination::EvaluationsUsedUp };
            return Minimum { at, cost, evaluations: evaluations.get(), termination };
        }
        let mut centre = [0.0; D];
        for (at, _) in &simplex[..D] {
            for d in 0..D {
                centre[d] += at[d] / D as f64;
            }
        }
        let worst = simplex[D];
        let along = |t: f64| {
            let mut at = [0.0; D];
            for d in 0..D {
                at[d] = centre[d] + t * (worst.0[d] - centre[d]);
            }
            at
        };
        let reflected = along(-1.0);
        let reflected_cost = evaluate(&reflected);
        let replacement = if reflected_cost < simplex[0].1 {
            let expanded = along(-2.0);
            let expanded_cost = evaluate(&expanded);
            Some(if expanded_cost < reflected_cost { (expanded, expanded_cost) } else { (reflected, reflected_cost) })
        } else if reflected_cost < simplex[D - 1].1 {
            Some((reflected, reflected_cost))
        } else {
            let contracted = along(if reflected_cost < worst.1 { -0.5 } else { 0.5 });
            let contracted_cost = evaluate(&contracted);
            (contracted_cost < worst.1.min(reflected_cost)).then_some((contracted, contracted_cost))
        };
        match replacement {
            Some(corner) => simplex[D] = corner,
            None => {
                let best = simplex[0].0;
                for corner in simplex.iter_mut().skip(1) {
                    for (value, best) in corner.0.iter_mut().zip(best) {
                        *value = best + 0.5 * (*value - best);
                    }
                    corner.1 = evaluate(&corner.0);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_minimum_of_rosenbrocks_valley() {
        let rosenbrock = |p: &[f64; 2]| (1.0 - p[0]).powi(2) + 100.0 * (p[1] - p[0] * p[0]).powi(2);
        let minimum = minimise(rosenbrock, [-1.2, 1.0], [0.5, 0.5], 1e-8, 1000);
        assert_eq!(minimum.termination, Termination::Converged);
        assert!((minimum.at[0] - 1.0).abs() < 1e-6 && (minimum.at[1] - 1.0).abs() < 1e-6);
    }

    #[test]
    fn stops_with_a_reason_when_evaluations_run_out() {
        let minimum = minimise(|p: &[f64; 1]| p[0].abs(), [100.0], [1.0], 1e-12, 10);
        assert_eq!(minimum.termination, Termination::EvaluationsUsedUp);
    }

    #[test]
    fn a_cost_that_is_not_a_number_is_never_the_answer() {
        let minimum = minimise(|p: &[f64; 1]| if p[0] < 1.0 { f64::NAN } else { p[0] }, [3.0], [-0.5], 1e-9, 500);
        assert!((minimum.at[0] - 1.0).abs() < 1e-3);
    }
}
