//! The appearance of one view while it is learnt, by folds of stretches.

use super::folds::{FOLDS, fold_of, sum, without};
use crate::vision::appearance::{Appearance, GrayScore};
use crate::vision::bandwidths::Bandwidths;
use crate::vision::factor::FACTORS;
use crate::vision::histogram::Histogram;
use crate::vision::inspection_model::{AlignedView, ViewAppearance};
use crate::vision::usual::Moments;

/// Gray values are learnt, further factors are gathered.
#[derive(Debug)]
pub(super) struct LearningView {
    /// What all folds taught.
    gray: Appearance,
    /// `[fold]`: what the others taught.
    gray_by_others: [Appearance; FOLDS],
    factors: [[Moments; FACTORS.len()]; FOLDS],
}

/// Everything is learnt, nothing calibrated.
#[derive(Debug)]
pub(super) struct LearntView {
    /// From all folds.
    pub whole: ViewAppearance,
    /// `[fold]`: from the others.
    pub by_others: [ViewAppearance; FOLDS],
}

impl LearningView {
    /// Learns the gray values of the folds.
    pub fn new(gray: [Histogram; FOLDS], bandwidths: Bandwidths, gray_score: GrayScore) -> Self {
        let learn = |histogram: &Histogram| Appearance::learn_scoring(histogram, bandwidths, gray_score);
        Self {
            gray: learn(&sum(gray.iter())),
            gray_by_others: std::array::from_fn(|fold| learn(&without(&gray, fold))),
            factors: Default::default(),
        }
    }

    /// Adds the further factors of a stretch, relative to the gray that the other folds expect.
    pub fn take(&mut self, number: usize, aligned: &AlignedView<'_>) {
        let fold = fold_of(number);
        aligned.learn_factors(&self.gray_by_others[fold], &mut self.factors[fold]);
    }

    /// Learns the further factors.
    pub fn learnt(self) -> LearntView {
        let others = |except: usize| -> Vec<Moments> {
            let of_factor =
                |factor: usize| sum((0..FOLDS).filter(|&fold| fold != except).map(|fold| &self.factors[fold][factor]));
            (0..FACTORS.len()).map(of_factor).collect()
        };
        LearntView {
            whole: ViewAppearance::new(self.gray.clone(), &others(FOLDS)),
            by_others: std::array::from_fn(|fold| {
                ViewAppearance::new(self.gray_by_others[fold].clone(), &others(fold))
            }),
        }
    }
}
