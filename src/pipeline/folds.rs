//! Cross-fitting: every stretch of intact rope is judged by what was learnt from the others, and teaches them in turn.
//!
//! Rope that a model has learnt from looks more intact to it than any other; rope that is only held back teaches nothing. So the
//! stretches are dealt to folds, and what is learnt from the other folds judges each.

use std::ops::AddAssign;

/// Number of folds. With three, what judges knows a third less rope than what inspects, and thresholds come out a tenth to a fifth too
/// high.
pub(super) const FOLDS: usize = 8;

/// The fold of a stretch. Neighbours are in different folds.
pub(super) fn fold_of(number: usize) -> usize {
    number % FOLDS
}

/// What all folds but one saw.
pub(super) fn without<T: Default + for<'a> AddAssign<&'a T>>(folds: &[T; FOLDS], fold: usize) -> T {
    sum(folds.iter().enumerate().filter(|(f, _)| *f != fold).map(|(_, saw)| saw))
}

/// What several folds saw.
pub(super) fn sum<'a, T: Default + AddAssign<&'a T> + 'a>(folds: impl Iterator<Item = &'a T>) -> T {
    folds.fold(T::default(), |mut total, saw| {
        total += saw;
        total
    })
}
