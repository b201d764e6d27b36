//! Whether a model still fits the rope: scores of an inspection, defects left out, against those of the training's held-back rope.
//!
//! Dirt, water, another light make sound rope look unlike what was learnt. Long before that shows in single alarms, all scores move.
//! The tail of the inspection's own scores under the threshold tells how many false defects lie over it.

use super::budget::BudgetFit;
use crate::vision::stretch_scores::StretchScores;
use crate::vision::tail::{Tail, base_of, peaks};
use serde::{Deserialize, Serialize};

/// How many times the budget may be exceeded before it is said: less is not known better from metres of training.
const BEYOND_BUDGET: f64 = 3.0;
/// Rope beside an alarm that is left out, in mm: filters along the wire reach so far, the longest twice.
const BESIDE_ALARM_MM: f64 = 40.0;
/// Share of the rope over the threshold, or beside it, from which on that is no matter of defects.
const MOST_ALARMED: f64 = 0.5;
/// Least rope without alarms that is judged by its scores, in m.
const LEAST_M: f64 = 1.0;
/// Line scores are counted in bins: width, lowest, and number.
const BIN: f64 = 0.05;
const LOWEST: f64 = -5.0;
const BINS: usize = 800;

/// Line scores of one view where the rope is intact.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct IntactScores {
    /// Half of the lines score less.
    pub median: f64,
    /// 9 of 10 do.
    pub nine_of_10: f64,
    /// 99 of 100 do.
    pub of_100_99: f64,
}

/// One view of an inspection beside the training.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ViewFit {
    /// The view.
    pub view: usize,
    /// Scores of held-back rope.
    pub trained: IntactScores,
    /// Scores of this inspection, alarms left out.
    pub here: IntactScores,
}

/// Whether a model fits the rope of an inspection.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelFit {
    /// False: retrain. True also where nothing can be told, see [`ModelFit::cannot_tell`].
    pub fits: bool,
    /// False defects per 100 m that the trained threshold was made for.
    pub budget_per_100m: f64,
    /// How many this rope gives at that threshold, by the tail of its own scores; `None` if it is too short to tell.
    pub false_defects_per_100m: Option<f64>,
    /// The least that these may be in truth: 95 % lie between this and the next.
    pub at_least_per_100m: Option<f64>,
    /// The most that these may be in truth.
    pub at_most_per_100m: Option<f64>,
    /// Metres of rope without alarms that this rests on.
    pub metres: f64,
    /// Share of the rope over the threshold or beside it, where nothing is compared.
    #[serde(default)]
    pub alarmed_share: f64,
    /// The views that were seen.
    pub views: Vec<ViewFit>,
}

impl ModelFit {
    /// Whether nothing contradicts the model, but nothing speaks for it, either: this rope is too short to have a tail, or promises more false
    /// defects than a fitting model may have while chance may be the reason.
    pub fn cannot_tell(&self) -> bool {
        self.fits && self.false_defects_per_100m.is_none_or(|rate| rate > BEYOND_BUDGET * self.budget_per_100m)
    }

    /// What a person should know; `None` while the model fits.
    pub fn warning(&self) -> Option<String> {
        if !self.fits && self.alarmed_share > MOST_ALARMED {
            return Some(format!(
                "this model no longer fits this rope: {:.0} % of it are over the threshold or beside such places, which is no matter of \
                 defects: retrain on intact rope as it looks now",
                100.0 * self.alarmed_share
            ));
        }
        let (rate, low, high) = (self.false_defects_per_100m?, self.at_least_per_100m?, self.at_most_per_100m?);
        let budget = self.budget_per_100m;
        (!self.fits).then(|| {
            format!(
                "this model no longer fits this rope: intact rope scores higher than in training, so that about {rate:.0} false defects per \
                 100 m ({low:.0} to {high:.0} with 95 %) are to be expected instead of {budget}: retrain on intact rope as it looks now"
            )
        })
    }
}

/// Counts of line scores.
#[derive(Debug, Clone, PartialEq)]
struct Counts(Vec<u64>);

impl Default for Counts {
    fn default() -> Self {
        Self(vec![0; BINS])
    }
}

impl Counts {
    fn add(&mut self, score: f32) {
        if score.is_finite() {
            let bin = ((f64::from(score) - LOWEST) / BIN).max(0.0) as usize;
            self.0[bin.min(BINS - 1)] += 1;
        }
    }

    fn quantile(&self, share: f64) -> Option<f64> {
        let all: u64 = self.0.iter().sum();
        let mut below = 0;
        let bin = self.0.iter().position(|n| {
            below += n;
            below > 0 && below as f64 >= share * all as f64
        });
        bin.map(|bin| LOWEST + (bin as f64 + 0.5) * BIN)
    }

    fn scores(&self) -> Option<IntactScores> {
        Some(IntactScores {
            median: self.quantile(0.5)?,
            nine_of_10: self.quantile(0.9)?,
            of_100_99: self.quantile(0.99)?,
        })
    }
}

/// Gathers scores of intact rope, stretch by stretch.
#[derive(Debug, Clone, Default)]
pub(super) struct IntactRope {
    views: Vec<Counts>,
    peaks: Vec<f32>,
    metres: f64,
    seen_m: f64,
}

impl IntactRope {
    /// Adds a stretch in all views, without what is over `threshold` and the rope beside it.
    pub fn add(&mut self, views: &[Option<StretchScores>], threshold: f64, block_mm: f64) {
        let mut over_views = over_views(views);
        let metres = |blocks: &[f32]| blocks.iter().filter(|s| s.is_finite()).count() as f64 * block_mm / 1000.0;
        self.seen_m += metres(&over_views);
        let reach = (BESIDE_ALARM_MM / block_mm).ceil() as usize;
        let alarmed: Vec<usize> = (0..over_views.len()).filter(|&b| f64::from(over_views[b]) > threshold).collect();
        for block in alarmed {
            let end = (block + reach + 1).min(over_views.len());
            over_views[block.saturating_sub(reach)..end].fill(f32::NAN);
        }
        self.views.resize_with(self.views.len().max(views.len()), Counts::default);
        for (counts, view) in self.views.iter_mut().zip(views) {
            let Some(view) = view else { continue };
            let intact = view.blocks.iter().zip(&over_views).filter(|(_, over)| over.is_finite());
            intact.for_each(|(&score, _)| counts.add(score));
        }
        self.peaks.extend(peaks(&over_views, block_mm).into_iter().map(|(_, score)| score));
        self.metres += metres(&over_views);
    }

    /// Highest scores, one an event.
    pub fn peaks(&self) -> &[f32] {
        &self.peaks
    }

    /// Metres that any view saw.
    pub fn metres(&self) -> f64 {
        self.metres
    }

    /// Scores of every view; `None` for a view without.
    pub fn scores(&self) -> Vec<Option<IntactScores>> {
        self.views.iter().map(Counts::scores).collect()
    }

    /// How this rope fits a training.
    pub fn fit(&self, budget: &BudgetFit, trained: &[Option<IntactScores>]) -> ModelFit {
        let threshold = budget.alarm.line_score;
        let tail = Some(self.metres).filter(|&metres| metres >= LEAST_M).and_then(|metres| {
            // Where all peaks are higher, the tail begins higher, too.
            let under: Vec<f32> = self.peaks.iter().copied().filter(|&p| f64::from(p) < threshold).collect();
            let base = base_of(&under)?.max(budget.tail_from);
            Tail::over(base, &under, threshold, metres, budget.known())
        });
        let rate = tail.as_ref().map(|tail| 100.0 * tail.rate(threshold));
        let between = tail.as_ref().map(|tail| tail.rate_between(threshold));
        let allowed = budget.alarm.false_defects_per_100m;
        let beyond = rate.is_some_and(|rate| rate > BEYOND_BUDGET * allowed)
            && between.is_some_and(|(low, _)| 100.0 * low > allowed);
        let views = trained.iter().zip(self.scores()).enumerate();
        let alarmed_share = if self.seen_m >= LEAST_M { 1.0 - self.metres / self.seen_m } else { 0.0 };
        ModelFit {
            fits: !beyond && alarmed_share <= MOST_ALARMED,
            alarmed_share,
            budget_per_100m: allowed,
            false_defects_per_100m: rate,
            at_least_per_100m: between.map(|(low, _)| 100.0 * low),
            at_most_per_100m: between.map(|(_, high)| 100.0 * high),
            metres: self.metres,
            views: views
                .filter_map(|(view, (trained, here))| Some(ViewFit { view, trained: (*trained)?, here: here? }))
                .collect(),
        }
    }
}

/// Highest score of every block over all views.
fn over_views(views: &[Option<StretchScores>]) -> Vec<f32> {
    let blocks = views.iter().flatten().map(|v| v.blocks.len()).max().unwrap_or(0);
    (0..blocks)
        .map(|b| views.iter().flatten().filter_map(|v| v.blocks.get(b)).fold(f32::NAN, |high, &s| high.max(s)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::Budget;

    const BLOCK_MM: f64 = 0.5;

    /// Stretches of 0.2 m with a peak every 25 mm, `lift` over where it would be; exponential with mean `spread`.
    fn rope(metres: f64, lift: f64, spread: f64, defects: bool) -> IntactRope {
        let mut rope = IntactRope::default();
        let n = (metres * 40.0) as usize;
        let peak = |k: usize| {
            let share = (((k * 7919) % n) as f64 + 0.5) / n as f64;
            (4.0 + lift - spread * share.ln()) as f32
        };
        for stretch in 0..n / 8 {
            let mut blocks = vec![(2.0 + lift) as f32; 400];
            (0..8).for_each(|k| blocks[20 + 50 * k] = peak(8 * stretch + k));
            if defects && stretch % 5 == 0 {
                blocks[200..260].fill(25.0);
            }
            let scores = StretchScores {
                added: Vec::new(),
                looks: Vec::new(),
                cells: Vec::new(),
                visibility: Vec::new(),
                peaks: vec![(0, 0); blocks.len()],
                blocks,
                block_lines: 5,
                places: 45,
            };
            rope.add(&[Some(scores), None], 9.0, BLOCK_MM);
        }
        rope
    }

    fn trained() -> (BudgetFit, Vec<Option<IntactScores>>) {
        let rope = rope(4.0, 0.0, 0.6, false);
        (BudgetFit::of(Budget::default(), 2.0, rope.peaks(), rope.metres(), None).unwrap(), rope.scores())
    }

    #[test]
    fn more_of_the_same_rope_fits_also_with_defects_in_it() {
        let (budget, scores) = trained();
        for defects in [false, true] {
            let fit = rope(30.0, 0.0, 0.6, defects).fit(&budget, &scores);
            assert!(fit.fits && fit.warning().is_none(), "{fit:?}");
            assert_eq!(fit.views.len(), 1, "a view that saw nothing is not compared");
            assert!((fit.views[0].here.median - fit.views[0].trained.median).abs() < 0.1);
            let rate = fit.false_defects_per_100m.unwrap();
            assert!((0.5..5.0).contains(&rate), "{rate}, made for 2");
        }
    }

    #[test]
    fn rope_that_scores_higher_all_over_or_wider_does_not_fit_and_the_warning_has_figures() {
        let (budget, scores) = trained();
        for (lift, spread) in [(1.6, 0.6), (0.0, 0.9)] {
            let fit = rope(10.0, lift, spread, true).fit(&budget, &scores);
            assert!(!fit.fits, "{fit:?}");
            assert!(fit.views[0].here.of_100_99 > fit.views[0].trained.of_100_99);
            let warning = fit.warning().unwrap();
            assert!(warning.contains("no longer fits") && warning.contains("instead of 2"), "{warning}");
        }
    }

    #[test]
    fn rope_that_is_over_the_threshold_all_along_does_not_fit_although_nothing_is_left_to_compare() {
        let (budget, scores) = trained();
        let fit = rope(10.0, 30.0, 0.6, false).fit(&budget, &scores);
        assert!(!fit.fits && fit.metres == 0.0, "{fit:?}");
        assert!(fit.warning().unwrap().contains("100 % of it"), "{:?}", fit.warning());
    }

    #[test]
    fn far_over_the_budget_on_so_little_rope_that_it_may_be_chance_is_neither_fit_nor_misfit() {
        let (budget, scores) = trained();
        let fit = rope(10.0, 0.0, 0.6, false).fit(&budget, &scores);
        assert!(fit.fits && !fit.cannot_tell(), "{fit:?}");
        let unsure = ModelFit { false_defects_per_100m: Some(9.0), at_least_per_100m: Some(1.1), ..fit };
        assert!(unsure.cannot_tell() && unsure.warning().is_none());
        assert!(!ModelFit { fits: false, ..unsure }.cannot_tell());
    }

    #[test]
    fn too_little_rope_says_nothing_against_a_model_and_nothing_for_it() {
        let (budget, scores) = trained();
        let fit = rope(0.6, 2.0, 0.9, false).fit(&budget, &scores);
        assert!(fit.fits && fit.false_defects_per_100m.is_none());
        assert!(fit.cannot_tell() && fit.warning().is_none());
        let few_peaks = IntactRope { peaks: vec![4.0, 4.5, 5.0], metres: 3.0, seen_m: 3.0, ..IntactRope::default() };
        let fit = few_peaks.fit(&budget, &scores);
        assert!(fit.fits && fit.false_defects_per_100m.is_none() && fit.cannot_tell(), "{fit:?}");
    }
}
