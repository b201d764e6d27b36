//! Whether more rope would have taught a model more: how well held-back rope is predicted by parts of what was learnt from.

use super::folds::{FOLDS, fold_of, without};
use super::train::LEAST_M;
use crate::vision::appearance::Appearance;
use crate::vision::bandwidths::Bandwidths;
use crate::vision::histogram::{CELLS, Histogram};
use crate::vision::inspection_model::AlignedView;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// The fold that judges the others; little rope fills only the first ones.
const JUDGE: usize = 1;
/// Shares of the rope after which the model is looked at.
const SHARES: [f64; 3] = [0.125, 0.25, 0.5];
/// Nats per pixel that are not worth more rope: of some 1.5 that a model of metres knows.
const ENOUGH_NATS: f64 = 0.01;

/// What a model of so many metres knows of rope that it has not seen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LearningPoint {
    /// Metres learnt from, mean of the views.
    pub metres: f64,
    /// Mean logarithm of the likelihood of a held-back pixel, over that of knowing nothing, in nats.
    pub nats_per_pixel: f64,
}

/// Metres that would have been enough to know the grays, if it was; never less than training asks for.
pub fn enough_m(curve: &[LearningPoint]) -> Option<f64> {
    let (last, before) = curve.split_last()?;
    before.iter().find(|p| p.nats_per_pixel >= last.nats_per_pixel - ENOUGH_NATS).map(|p| p.metres.max(LEAST_M))
}

/// The curve as a sentence; `None` with fewer than two points.
pub fn sentence(curve: &[LearningPoint]) -> Option<String> {
    let [.., before, last] = curve else { return None };
    Some(match enough_m(curve) {
        Some(metres) => format!(
            "{metres:.1} m would have been enough to know the grays; the threshold is the surer, the more intact rope it rests on"
        ),
        None => format!(
            "more rope would help: the last {:.1} m still brought {:.3} nats per pixel",
            last.metres - before.metres,
            last.nats_per_pixel - before.nats_per_pixel
        ),
    })
}

/// Gray values of one view as they grow, by folds of stretches.
#[derive(Debug, Clone)]
pub(super) struct GrowingGray {
    /// Every so many stretches one belongs to the same fold.
    pub folds: [Histogram; FOLDS],
    /// Metres of all.
    pub metres: f64,
    learnt_m: f64,
    stretches: usize,
    of_stretches: usize,
    parts: Vec<(f64, Histogram)>,
}

impl GrowingGray {
    /// Nothing yet, of so many stretches that will come.
    pub fn new(of_stretches: usize) -> Self {
        Self {
            folds: Default::default(),
            metres: 0.0,
            learnt_m: 0.0,
            stretches: 0,
            of_stretches: (0..of_stretches).filter(|&number| fold_of(number) != JUDGE).count(),
            parts: Vec::new(),
        }
    }

    /// Adds a stretch.
    pub fn take(&mut self, number: usize, aligned: &AlignedView<'_>) {
        aligned.learn_gray(&mut self.folds[fold_of(number)]);
        let metres = aligned.view.lines_seen() as f64 * aligned.pitch_mm / 1000.0;
        self.metres += metres;
        if fold_of(number) == JUDGE {
            return; // the curve is judged by it
        }
        self.learnt_m += metres;
        self.stretches += 1;
        if SHARES.iter().any(|share| (share * self.of_stretches as f64).ceil() as usize == self.stretches) {
            self.parts.push((self.learnt_m, without(&self.folds, JUDGE)));
        }
    }
}

/// The learning curve over all views: learnt from all folds but one, which judges.
pub(super) fn curve(views: &[GrowingGray], bandwidths: Bandwidths) -> Vec<LearningPoint> {
    let of_view: Vec<Vec<LearningPoint>> = views.par_iter().map(|view| of_view(view, bandwidths)).collect();
    let points = of_view.iter().map(Vec::len).min().unwrap_or(0);
    // A view that missed stretches has fewer points: the last ones belong together.
    let mean = |number: usize| {
        let n = of_view.len() as f64;
        let of = |value: fn(&LearningPoint) -> f64| {
            of_view.iter().map(|p| value(&p[p.len() - points + number])).sum::<f64>() / n
        };
        LearningPoint { metres: of(|p| p.metres), nats_per_pixel: of(|p| p.nats_per_pixel) }
    };
    (0..points).map(mean).collect()
}

fn of_view(gray: &GrowingGray, bandwidths: Bandwidths) -> Vec<LearningPoint> {
    let point = |metres: f64, part: &Histogram| LearningPoint {
        metres,
        nats_per_pixel: nats_per_pixel(&Appearance::learn(part, bandwidths), &gray.folds[JUDGE]),
    };
    let parts = gray.parts.par_iter().filter(|(metres, _)| *metres < gray.learnt_m);
    let mut points: Vec<LearningPoint> = parts.map(|(metres, part)| point(*metres, part)).collect();
    points.push(point(gray.learnt_m, &without(&gray.folds, JUDGE)));
    points
}

/// Mean logarithm of the likelihood of the pixels of a histogram. What a model cannot tell counts as known nothing about: 0.
pub(super) fn nats_per_pixel(appearance: &Appearance, pixels: &Histogram) -> f64 {
    let of_cell = |cell: usize| {
        let known = pixels.of_cell(cell).iter().zip(appearance.likelihood(cell)).filter(|(_, p)| **p > 0.0);
        known.map(|(&n, &p)| f64::from(n) * f64::from(p).ln()).sum::<f64>()
    };
    (0..CELLS).map(of_cell).sum::<f64>() / pixels.total().max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::histogram::cell;

    /// So many pixels a cell, spread over five gray values about one of the cell's own.
    fn gray(stretches: usize, of_stretches: usize) -> GrowingGray {
        let mut gray = GrowingGray::new(of_stretches);
        let fill = |histogram: &mut Histogram, from: usize, n: usize| {
            for strand in 8..24 {
                for wire in 0..24 {
                    for distance in 0..8 {
                        for k in from..from + n {
                            let spread = (k * 7 + strand * 5 + wire * 3 + distance) % 5;
                            histogram.add(cell(strand, wire, distance), 8 + strand / 2 + spread);
                        }
                    }
                }
            }
        };
        for stretch in 0..stretches {
            fill(&mut gray.folds[0], 10 * stretch, 10);
            gray.parts.push((0.2 * (stretch + 1) as f64, gray.folds[0].clone()));
        }
        gray.learnt_m = 0.2 * stretches as f64;
        fill(&mut gray.folds[JUDGE], 1000, 20);
        gray
    }

    #[test]
    fn held_back_rope_is_predicted_the_better_the_more_was_learnt_until_it_was_enough() {
        let points = curve(&[gray(8, 8), gray(8, 8)], Bandwidths::FIXED);
        assert!(
            points.windows(2).all(|p| p[0].metres < p[1].metres && p[0].nats_per_pixel <= p[1].nats_per_pixel + 1e-3)
        );
        assert!(points[0].nats_per_pixel < points[7].nats_per_pixel - 0.05, "{points:?}");
        let enough = enough_m(&points).unwrap();
        assert!((LEAST_M..1.6).contains(&enough), "{points:?}");
        assert!(
            sentence(&points).unwrap().starts_with(&format!("{enough:.1} m would have been enough to know the grays;"))
        );
    }

    #[test]
    fn nobody_is_told_that_less_is_enough_than_training_accepts() {
        let point = |metres: f64| LearningPoint { metres, nats_per_pixel: 1.35 };
        assert_eq!(enough_m(&[point(0.3), point(0.6), point(3.4)]), Some(LEAST_M));
        assert_eq!(enough_m(&[point(1.2), point(3.4)]), Some(1.2));
    }

    #[test]
    fn a_curve_that_still_rises_asks_for_more_rope() {
        let point = |metres: f64, nats_per_pixel: f64| LearningPoint { metres, nats_per_pixel };
        let curve = [point(0.4, 0.8), point(0.8, 1.0), point(1.6, 1.1)];
        assert_eq!(enough_m(&curve), None);
        assert_eq!(
            sentence(&curve).unwrap(),
            "more rope would help: the last 0.8 m still brought 0.100 nats per pixel"
        );
        assert_eq!(sentence(&curve[..1]), None);
    }

    #[test]
    fn a_view_that_missed_stretches_does_not_spoil_the_curve() {
        let points = curve(&[gray(8, 8), gray(5, 8)], Bandwidths::FIXED);
        assert_eq!(points.len(), 5);
    }
}
