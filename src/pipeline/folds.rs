//! Cross-fitting: every stretch of intact rope is judged by what was learnt from the others, and teaches them in turn.
//!
//! Rope that a model has learnt from looks more intact to it than any other; rope that is only held back teaches nothing. So the
//! stretches are dealt to folds, and what is learnt from the other folds judges each.

use crate::vision::histogram::Histogram;

/// Number of folds.
pub(super) const FOLDS: usize = 3;

/// The fold of a stretch. Neighbours are in different folds.
pub(super) fn fold_of(number: usize) -> usize {
    number % FOLDS
}

/// What all folds but one saw.
pub(super) fn without(folds: &[Histogram; FOLDS], fold: usize) -> Histogram {
    sum(folds.iter().enumerate().filter(|(f, _)| *f != fold).map(|(_, histogram)| histogram))
}

/// The sum of histograms.
pub(super) fn sum<'a>(histograms: impl Iterator<Item = &'a Histogram>) -> Histogram {
    histograms.fold(Histogram::default(), |mut total, histogram| {
        total.merge(histogram);
        total
    })
}
