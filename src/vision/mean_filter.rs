//! The paper's own way to judge a place: the mean of what its pixels say under one filter along the wire. [Wacker13, sec. 5]
//!
//! Inspections ask several filters, each calibrated on intact rope (`scoring`); this is what they are compared with.

use super::calibration::LEAST_SHARE;
use super::evidence::{Evidence, GRAY, UNSEEN};
use super::filtering::{Filtered, Steps};
use super::stretch_scores::StretchScores;

/// Least mean of normalised likelihoods: what was never seen is not infinitely rare.
const LEAST_LIKELIHOOD: f32 = 1e-3;

/// What a mean is the mean of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MeanOf {
    /// Normalised likelihoods (eq. 22), less than zero so that higher is rarer. A score is minus the logarithm of their mean: the same
    /// places are over a threshold, and how rare high scores are can be told from their tail.
    Likelihoods,
    /// Logarithms, which are scores already.
    Surprises,
}

impl MeanOf {
    fn score(self, mean: f32) -> f32 {
        match self {
            Self::Likelihoods => -(-mean).max(LEAST_LIKELIHOOD).ln(),
            Self::Surprises => mean,
        }
    }
}

/// Scores the gray evidence of a stretch by a single filter, by its number in [`FILTERS`](super::evidence::FILTERS), under which `most_pixels`
/// fall. As everywhere, places with a quarter of them are not judged.
pub fn mean_scores(
    evidence: &Evidence,
    filter: usize,
    most_pixels: f64,
    mean_of: MeanOf,
    pitch_mm: f64,
) -> StretchScores {
    let row = evidence.strands * evidence.places;
    let least = LEAST_SHARE * most_pixels as f32;
    let mut cells = vec![f32::NAN; evidence.blocks * row];
    let mut judge = |filtered: Filtered<'_>| {
        if filtered.filter != filter {
            return;
        }
        for (block, (_, sums)) in filtered.stands_for.clone().flat_map(|block| filtered.sums().map(move |s| (block, s)))
        {
            let regions = &evidence.regions[evidence.of(block, filtered.strand)];
            let cells = &mut cells[evidence.of_scores(block, filtered.strand)];
            let under = sums.iter().zip(filtered.pixels);
            for ((cell, &region), (&sum, &pixels)) in cells.iter_mut().zip(regions).zip(under) {
                if region != UNSEEN && pixels >= least && pixels > 0.0 {
                    *cell = mean_of.score(sum / pixels);
                }
            }
        }
    };
    evidence.filtered(pitch_mm, Steps::Thinned, |factor| factor == GRAY, &mut judge);
    StretchScores::new(cells, evidence.visibility(pitch_mm), row, evidence.places, evidence.block_lines)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::evidence::block_lines;

    const PITCH_MM: f64 = 0.1;
    const PLACES: usize = 35;

    /// One strand seen in blocks 20 to 180; a hundred pixels a place, which say `usual`, in a run along one wire `there`.
    fn evidence(usual: f32, there: f32) -> Evidence {
        let mut evidence = Evidence::empty(block_lines(PITCH_MM), 200, 1, PLACES);
        for (block, place) in (20..180).flat_map(|block| (0..PLACES).map(move |place| (block, place))) {
            let says = if (90..110).contains(&block) && (10..15).contains(&place) { there } else { usual };
            evidence.set(block * PLACES + place, 100.0 * says, 100.0, 0);
        }
        evidence
    }

    #[test]
    fn a_score_is_the_mean_under_one_filter_or_minus_the_logarithm_of_mean_likelihoods() {
        let under = |evidence: &Evidence, mean_of| mean_scores(evidence, 1, 4000.0, mean_of, PITCH_MM);
        let surprises = under(&evidence(0.0, 2.0), MeanOf::Surprises);
        let likelihoods = under(&evidence(-1.0, -0.1), MeanOf::Likelihoods);
        for (scores, usual, there) in [(&surprises, 0.0, 2.0), (&likelihoods, 0.0, 10f32.ln())] {
            assert!((scores.cells[100 * PLACES + 12] - there).abs() < 1e-3, "{}", scores.cells[100 * PLACES + 12]);
            assert!((scores.cells[60 * PLACES + 12] - usual).abs() < 1e-3);
            assert!(scores.cells[10 * PLACES + 12].is_nan(), "nobody saw it");
            assert_eq!(scores.peaks[100], (0, 12));
        }
        let never = under(&evidence(-1.0, 0.0), MeanOf::Likelihoods);
        assert!((never.cells[100 * PLACES + 12] + LEAST_LIKELIHOOD.ln()).abs() < 1e-3, "never seen, and finite");
    }

    #[test]
    fn places_with_few_pixels_are_not_judged() {
        let scores = mean_scores(&evidence(0.0, 2.0), 1, 1e6, MeanOf::Surprises, PITCH_MM);
        assert!(scores.cells.iter().all(|cell| cell.is_nan()));
    }
}
