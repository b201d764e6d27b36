//! What the line counter gets wrong: the encoder's slow error, seen as what all strands and wires have in common.
//!
//! A line that lies farther along the rope than the encoder says shows every strand and every wire turned on, each by its own rate.
//! A rope does not do that: wires keep their lay, each its own, and strands stray one by one. So the error is estimated from all of
//! them together, as a course that is straight between nodes, and each strand's own courses are what remains. Left in, it would pass
//! for an error of the strands: wires are held stiff, and what they cannot follow moves the strands. How fast the error
//! wanders is learnt from the rope (type II maximum likelihood).

use super::smoothing::Chain;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Knots from node to node, about a rope diameter: encoders err slowly.
const KNOTS_PER_NODE: usize = 8;
/// How fast the error may wander: spectral density of the change of its slope in mm^2/mm^3. The first is as good as none.
const WANDERS: [f64; 7] = [1e-11, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5];
/// Standard deviation of the error in mm, and of its slope: a constant share cannot be told from another lay length, and need not.
const FARTHEST_MM: f64 = 1.0;
const STEEPEST: f64 = 3e-3;
/// Half the circumference of an encoder's wheel, about: over less the error is rough, over more smooth.
const WHEEL_MM: f64 = 100.0;

/// Logarithm of how likely what was measured is under each of [`WANDERS`], up to a constant.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct EncoderEvidence([f64; WANDERS.len()]);

impl EncoderEvidence {
    /// What earlier rope said fades, and a share of what was said now is added: stretches are looked at more than once.
    pub fn learn(&mut self, now: &Self, fading: f64, share: f64) {
        for (sum, now) in self.0.iter_mut().zip(now.0) {
            *sum = fading * *sum + share * now;
        }
    }

    fn most_likely(&self, other: &Self) -> f64 {
        let sums = self.0.iter().zip(other.0).map(|(a, b)| a + b);
        let best = sums
            .zip(WANDERS)
            .fold((f64::NEG_INFINITY, WANDERS[0]), |best, now| if now.0 > best.0 { now } else { best });
        best.1
    }
}

/// The encoder's error along a few stretches, with its uncertainty.
#[derive(Debug, Clone)]
pub struct EncoderCourse {
    spacing_mm: f64,
    knots: usize,
    nodes_mm: DVector<f64>,
    covariance: DMatrix<f64>,
    /// What this rope says of how fast the error wanders.
    pub evidence: EncoderEvidence,
}

/// The node before a knot, and how far the knot is on the way to the next.
fn node(knot: usize) -> (usize, f64) {
    (knot / KNOTS_PER_NODE, (knot % KNOTS_PER_NODE) as f64 / KNOTS_PER_NODE as f64)
}

/// Sums of what belongs to knots, at the nodes on either side.
fn at_nodes(knots: usize, of_knot: impl Fn(usize) -> f64) -> DVector<f64> {
    let mut nodes = DVector::zeros(nodes_of(knots));
    for knot in 0..knots {
        let (value, (before, share)) = (of_knot(knot), node(knot));
        nodes[before] += (1.0 - share) * value;
        nodes[before + 1] += share * value;
    }
    nodes
}

fn nodes_of(knots: usize) -> usize {
    knots.saturating_sub(1) / KNOTS_PER_NODE + 2
}

/// Share that a node has in the course at a knot.
fn share_of(number: usize, knot: usize) -> f64 {
    let (before, share) = node(knot);
    match number.checked_sub(before) {
        Some(0) => 1.0 - share,
        Some(1) => share,
        _ => 0.0,
    }
}

/// The course through nodes at a knot.
fn along(nodes_mm: &DVector<f64>, knot: usize) -> f64 {
    let (before, share) = node(knot);
    nodes_mm[before] + share * (nodes_mm[before + 1] - nodes_mm[before])
}

impl EncoderCourse {
    /// Estimates the error from the courses of all strands, `known` being what earlier rope said of its wander. `None` without courses.
    pub(super) fn estimate<const S: usize>(chains: &[&Chain<S>], known: &EncoderEvidence) -> Option<Self> {
        let (knots, spacing_mm) = (chains.first()?.knots(), chains.first()?.spacing_mm());
        let nodes = nodes_of(knots);
        // Normal equations for the nodes, the states of every strand being free to follow (Schur complement).
        let said: Vec<(DMatrix<f64>, DVector<f64>)> = chains
            .par_iter()
            .map(|chain| {
                let of_knots: Vec<(f64, f64)> = (0..knots).map(|knot| chain.of_encoder(knot)).collect();
                let mut information = DMatrix::zeros(nodes, nodes);
                for column in 0..nodes {
                    let change = chain.change(|knot| share_of(column, knot));
                    let left =
                        |knot: usize| of_knots[knot].0 * share_of(column, knot) + chain.taken_away(knot, &change[knot]);
                    information.set_column(column, &at_nodes(knots, left));
                }
                (information, at_nodes(knots, |knot| of_knots[knot].1))
            })
            .collect();
        let (information, weighted) =
            said.into_iter().reduce(|(information, weighted), (more, by)| (information + more, weighted + by))?;
        let node_mm = KNOTS_PER_NODE as f64 * spacing_mm;
        let solved = |wander: f64| -> Option<(Cholesky<f64, Dyn>, f64)> {
            let prior = precision(nodes, node_mm, wander)?;
            let posterior = (&prior + &information).cholesky()?;
            let fit = weighted.dot(&posterior.solve(&weighted));
            let evidence = (prior.cholesky()?.ln_determinant() - posterior.ln_determinant() + fit) / 2.0;
            Some((posterior, evidence))
        };
        let mut evidence = EncoderEvidence::default();
        for (evidence, wander) in evidence.0.iter_mut().zip(WANDERS) {
            *evidence = solved(wander)?.1;
        }
        let posterior = solved(evidence.most_likely(known))?.0;
        Some(Self {
            spacing_mm,
            knots,
            nodes_mm: posterior.solve(&weighted),
            covariance: posterior.inverse(),
            evidence,
        })
    }

    /// How much farther along the rope a knot lies than the encoder says, in mm.
    pub fn error_mm(&self, knot: usize) -> f64 {
        along(&self.nodes_mm, knot)
    }

    /// Slope of the error at a knot.
    pub fn error_per_mm(&self, knot: usize) -> f64 {
        let (before, after) = (knot.saturating_sub(1), (knot + 1).min(self.knots - 1));
        (self.error_mm(after) - self.error_mm(before)) / ((after - before).max(1) as f64 * self.spacing_mm)
    }

    /// Sums of what belongs to knots, at the nodes on either side.
    pub fn at_nodes(&self, of_knot: impl Fn(usize) -> f64) -> DVector<f64> {
        at_nodes(self.knots, of_knot)
    }

    /// The share that each node has in the error at a knot.
    pub fn shares(&self) -> impl Iterator<Item = impl Fn(usize) -> f64> {
        (0..self.nodes_mm.len()).map(|number| move |knot| share_of(number, knot))
    }

    /// Variance of a sum over the nodes.
    pub fn variance(&self, weights: &DVector<f64>) -> f64 {
        weights.dot(&(&self.covariance * weights))
    }
}

/// What is known of the nodes before measuring, as an inverse covariance. `None` if this cannot be computed.
///
/// The error's slope wanders, and so does the error itself: within [`WHEEL_MM`], half a turn of an encoder's wheel, its course
/// is rougher than beyond. Level and slope are known weakly.
fn precision(nodes: usize, node_mm: f64, wander: f64) -> Option<DMatrix<f64>> {
    let mut precision = DMatrix::identity(nodes, nodes) / (nodes as f64 * FARTHEST_MM.powi(2));
    let mut add = |first: usize, differences: &[f64], weight: f64| {
        for (a, x) in differences.iter().enumerate() {
            for (b, y) in differences.iter().enumerate() {
                precision[(first + a, first + b)] += weight * x * y;
            }
        }
    };
    let slope = 1.0 / (nodes as f64 * (STEEPEST * node_mm).powi(2));
    (1..nodes).for_each(|k| add(k - 1, &[-1.0, 1.0], slope));
    // Variance of a second difference of an integrated random walk.
    let bend = 1.0 / (2.0 / 3.0 * wander * node_mm.powi(3));
    (2..nodes).for_each(|k| add(k - 2, &[1.0, -2.0, 1.0], bend));
    let step = wander * (WHEEL_MM / PI).powi(2) * node_mm;
    let walk = DMatrix::from_fn(nodes, nodes, |a, b| step * a.min(b) as f64);
    Some((precision.cholesky()?.inverse() + walk).cholesky()?.inverse())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::course::Course;
    use crate::vision::smoothing::{CoursePrior, Measurement, Observation};

    const KNOTS: usize = 120;
    const SPACING_MM: f64 = 5.0;
    const STRAND: f64 = 0.0286;

    /// Six strands with their wires, all measured at lines that lie `error_mm(knot)` farther than the encoder says.
    fn chains(error_mm: impl Fn(usize) -> f64) -> Vec<Chain<4>> {
        let prior = |rate_rad_per_mm: f64, wander| CoursePrior {
            spacing_mm: SPACING_MM,
            wander,
            rate_rad_per_mm,
            rate_sd: 0.05 * rate_rad_per_mm.abs(),
        };
        let noise = |k: usize, j: usize, sd: f64| sd * 1.7 * ((k * 7919 + j * 1193) % 101) as f64 / 50.0 - 1.7 * sd;
        (0..6)
            .map(|j| {
                let wire = -0.066 * (1.0 + 0.01 * j as f64);
                let observation = |k: usize| {
                    let x = k as f64 * SPACING_MM + error_mm(k);
                    let measured = |value: f64, seed: usize, sd: f64| Measurement {
                        value_rad: value + noise(k, seed, sd),
                        information: sd.powi(-2),
                    };
                    let mut observation = Observation::default();
                    observation.add(&[1.0, 0.0], measured(STRAND * x, j, 0.01));
                    // As the strand passes before a camera its wires turn with it more and less.
                    let share = 0.1 * ((k + 3 * j) % 20) as f64;
                    observation.add(&[share, 1.0], measured((wire + share * STRAND) * x, j + 6, 0.005));
                    observation
                };
                Chain::new((0..KNOTS).map(observation).collect(), &[prior(STRAND, 3e-9), prior(wire, 1e-10)]).unwrap()
            })
            .collect()
    }

    /// Scatter of a course about its own straight line: a constant share is another lay length.
    fn scatter(of: impl Fn(usize) -> f64) -> f64 {
        let middle = (KNOTS as f64 - 1.0) / 2.0;
        let mean = (0..KNOTS).map(&of).sum::<f64>() / KNOTS as f64;
        let (xy, xx) = (0..KNOTS).fold((0.0, 0.0), |(xy, xx), k| {
            let x = k as f64 - middle;
            (xy + x * of(k), xx + x * x)
        });
        let off = |k: usize| of(k) - mean - xy / xx * (k as f64 - middle);
        ((0..KNOTS).map(|k| off(k).powi(2)).sum::<f64>() / KNOTS as f64).sqrt()
    }

    #[test]
    fn an_error_that_all_strands_share_is_found_and_left_in_their_lay_lengths() {
        let error_mm = |k: usize| 0.1 * (k as f64 / 12.0).sin();
        let chains = chains(error_mm);
        let encoder = EncoderCourse::estimate(&chains.iter().collect::<Vec<_>>(), &EncoderEvidence::default()).unwrap();
        // What strands may stray by is the rest: a third of the error would be too much.
        let left = scatter(|k| encoder.error_mm(k) - error_mm(k));
        assert!(left < 0.022, "{left} of {}", scatter(error_mm));
        let encoder = std::sync::Arc::new(encoder);
        let strands: Vec<Course> = chains.into_iter().map(|chain| chain.courses(Some(&encoder)).remove(0)).collect();
        let knots = 40..80;
        let slope = strands.iter().map(|strand| strand.slope_rad_per_mm(knots.clone())).sum::<f64>() / 6.0;
        let x = |k: usize| k as f64 * SPACING_MM;
        let (xy, xx) = knots.clone().fold((0.0, 0.0), |(xy, xx), k| {
            let off_mm = x(k) - 59.5 * SPACING_MM;
            (xy + off_mm * STRAND * (x(k) + error_mm(k)), xx + off_mm * off_mm)
        });
        let all: Vec<&Course> = strands.iter().collect();
        let sd = Course::mean_slope_variance(&all, knots.clone()).sqrt();
        assert!((slope - xy / xx).abs() < 3.0 * sd, "{slope} instead of {}, sd {sd}", xy / xx);
        // What all share does not average out: six strands are less certain than six that know nothing of each other.
        let alone = strands[0].slope_variance(knots).sqrt() / 6f64.sqrt();
        assert!(sd > 1.04 * alone, "{sd} and {alone}");
    }

    #[test]
    fn variances_of_all_knots_are_those_of_each_alone() {
        let chains = || chains(|k| 0.1 * (k as f64 / 12.0).sin());
        let encoder = EncoderCourse::estimate(&chains().iter().collect::<Vec<_>>(), &EncoderEvidence::default());
        let with_encoder = chains().remove(0).courses(encoder.map(std::sync::Arc::new).as_ref());
        let without = chains().remove(0).courses(None);
        for course in with_encoder.iter().chain(&without) {
            let together = course.phase_variances();
            assert_eq!(together.len(), KNOTS);
            assert!((0..KNOTS).all(|k| (together[k] / course.phase_variance(k) - 1.0).abs() < 1e-6));
        }
        let [less, more] = [&without, &with_encoder].map(|courses| courses[1].phase_variance(60));
        assert!(more > 1.05 * less, "what all share counts: {more} and {less}");
    }

    #[test]
    fn an_encoder_without_error_is_left_alone() {
        let chains = chains(|_| 0.0);
        let encoder = EncoderCourse::estimate(&chains.iter().collect::<Vec<_>>(), &EncoderEvidence::default()).unwrap();
        assert!(scatter(|k| encoder.error_mm(k)) < 0.01, "{}", scatter(|k| encoder.error_mm(k)));
        assert!(encoder.evidence.most_likely(&EncoderEvidence::default()) <= 1e-8, "{:?}", encoder.evidence);
    }

    #[test]
    fn what_was_learnt_before_decides_where_a_stretch_says_little() {
        let mut known = EncoderEvidence::default();
        let mut now = EncoderEvidence::default();
        now.0[5] = 10.0;
        known.learn(&now, 0.9, 0.5);
        assert_eq!(known.most_likely(&EncoderEvidence::default()), WANDERS[5]);
        let mut little = EncoderEvidence::default();
        little.0[2] = 1.0;
        assert_eq!(known.most_likely(&little), WANDERS[5]);
    }
}
