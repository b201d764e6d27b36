//! How far views that see one rope at once disagree about its strands' lay, against what their stated deviations promise.
//!
//! What a registration errs by goes together along the rope, and how far is guessed with caution; views err each by itself. So the
//! difference between the lay length of one view and that of all is compared with the deviation that both state for it.

use super::estimates::LayEstimate;

/// What a stretch leaves of the weight of those before it.
const FADING: f64 = 0.97;
/// So many comparisons that agree exactly as stated are taken to have been made before the first.
const BEFORE: f64 = 8.0;
/// A difference of more deviations counts as this many: a view that lost its way says nothing of the others.
const FARTHEST: f64 = 3.0;
/// A view whose deviation is not larger than that of all by this factor is nearly all that is seen.
const APART: f64 = 1.1;

/// Sums over the comparisons that were made.
#[derive(Debug, Clone, Default)]
pub struct Agreement {
    squares: f64,
    comparisons: f64,
}

impl Agreement {
    /// Compares what the views say of a stretch with what all together do.
    pub fn learn<'a>(&mut self, all: &LayEstimate, views: impl Iterator<Item = &'a LayEstimate>) {
        self.squares *= FADING;
        self.comparisons *= FADING;
        for view in views.filter(|view| view.lay_sd_mm > APART * all.lay_sd_mm) {
            // All contain the view: the variance of the difference is the difference of the variances.
            let variance = view.lay_sd_mm.powi(2) - all.lay_sd_mm.powi(2);
            self.squares += ((view.lay_mm - all.lay_mm).powi(2) / variance).min(FARTHEST.powi(2));
            self.comparisons += 1.0;
        }
    }

    /// Factor on the stated standard deviations.
    pub fn scale(&self) -> f64 {
        ((self.squares + BEFORE) / (self.comparisons + BEFORE)).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn estimate(lay_mm: f64, lay_sd_mm: f64) -> LayEstimate {
        LayEstimate { lay_mm, lay_sd_mm, phase_rad: 0.0, phase_sd_rad: 0.0, score: 1.0 }
    }

    #[test]
    fn deviations_are_scaled_to_what_the_views_differ_by() {
        let all = estimate(200.0, 0.3);
        for (differ_mm, expected) in [(0.4, 1.0), (0.2, 0.5), (0.8, 2.0)] {
            let mut agreement = Agreement::default();
            for _ in 0..200 {
                let views = [estimate(200.0 + differ_mm, 0.5), estimate(200.0 - differ_mm, 0.5)];
                agreement.learn(&all, views.iter());
            }
            // What was taken to have been seen before still weighs an eighth.
            assert!((agreement.scale() - expected).abs() < 0.15, "{} for {expected}", agreement.scale());
        }
    }

    #[test]
    fn a_single_view_leaves_what_is_stated() {
        let mut agreement = Agreement::default();
        agreement.learn(&estimate(200.0, 0.5), [estimate(200.0, 0.5)].iter());
        assert_eq!(agreement.scale(), 1.0);
    }
}
