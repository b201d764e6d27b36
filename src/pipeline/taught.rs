//! What intact rope teaches, before anything is decided by it: the appearance of every view, and evidence of rope that did not teach it.

use super::bandwidths::{BandwidthsBy, BandwidthsFit};
use super::held_back::{Held, Holding};
use super::learning_curve::{GrowingGray, LearningPoint, curve};
use super::learning_view::{LearningView, LearntView};
use super::passes::{Pass, Used};
use super::train::{LEAST_M, PASSES};
use super::training_range::{self, TrainingRange};
use super::{Acquisition, PipelineError, Progress};
use crate::vision::appearance::GrayScore;
use crate::vision::evidence::block_lines;
use crate::vision::factor::FACTORS;
use crate::vision::inspection_model::ViewAppearance;
use crate::vision::kept_evidence::KeptSeen;
use crate::vision::margins::MARGIN_BLOCKS;
use crate::vision::surface_map::PLACES_PER_WIRE;
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Memory for the evidence of stretches that calibrate; what is made of it takes half as much again.
const MOST_EVIDENCE_BYTES: usize = 350_000_000;
/// Fewest stretches that are kept, if there are as many.
const LEAST_KEPT: usize = 6;

/// What ranges of intact rope taught. Different ways to judge can be calibrated on it, see [`Taught::model`](Self::model).
pub struct Taught<'a> {
    pub(super) acquisition: &'a Acquisition,
    pub(super) used: Vec<Used<'a>>,
    /// Metres that every range gave, summed over the views.
    pub(super) given_view_m: Vec<f64>,
    /// Metres that were learnt from, summed over the views.
    pub(super) learnt_view_m: f64,
    pub(super) bandwidths: BandwidthsFit,
    pub(super) learning_curve: Vec<LearningPoint>,
    /// One entry a view; not calibrated yet.
    pub(super) learnt: Vec<ViewAppearance>,
    /// One entry a view.
    pub(super) held: Vec<Held>,
}

impl<'a> Taught<'a> {
    /// Reads the ranges, pooled, three times.
    pub fn by(
        ranges: &'a [TrainingRange<'a>],
        bandwidths: BandwidthsBy,
        gray_score: GrayScore,
        progress: &dyn Progress,
    ) -> Result<Self, PipelineError> {
        let nothing = PipelineError::TooLittleRope { aligned_m: 0.0, needed_m: LEAST_M };
        let acquisition = ranges.first().ok_or(nothing)?.acquisition;
        training_range::check(ranges)?;
        let views = acquisition.view_angles_rad.len();
        let pitch_mm = acquisition.line_pitch_mm;
        let used: Vec<Used<'_>> = ranges.iter().map(Used::of).collect::<Result<_, _>>()?;
        let pass = |stage| Pass { used: &used, stage, progress };

        // First pass: gray values of intact rope.
        let stretches = used.iter().map(|used| used.lines.len().div_ceil(used.stretch_lines())).sum();
        let mut gray = vec![GrowingGray::new(stretches); views];
        let given_view_m =
            pass(PASSES[0]).each_view(&mut gray, |_| true, |number, aligned, gray| gray.take(number, &aligned))?;
        let of_views_m: Vec<f64> = gray.iter().map(|view| view.metres).collect();
        every_view_gave_enough(&of_views_m)?;
        let learnt_view_m: f64 = of_views_m.iter().sum();
        let fit = BandwidthsFit::of(bandwidths, &gray);
        let learning_curve = curve(&gray, fit.bandwidths());

        // Second pass: the further factors, relative to the gray that is expected by what the other folds taught.
        let learning = gray.into_par_iter().map(|gray| LearningView::new(gray.folds, fit.bandwidths(), gray_score));
        let mut learning: Vec<LearningView> = learning.collect();
        pass(PASSES[1]).each_view(&mut learning, |_| true, |number, aligned, view| view.take(number, &aligned))?;
        let learnt: Vec<LearntView> = learning.into_par_iter().map(LearningView::learnt).collect();

        // Third pass: evidence of every fold by the others, for calibration and threshold.
        let kept = kept_stretches(&used, stretches);
        let mut holding: Vec<Holding<'_>> = learnt.iter().map(|view| Holding::new(&view.by_others)).collect();
        let keeps = |number: usize| number * kept / stretches != (number + 1) * kept / stretches;
        pass(PASSES[2]).each_view(&mut holding, keeps, |number, aligned, view| view.take(number, &aligned))?;
        let mut kept: Vec<Vec<(usize, KeptSeen)>> = holding.into_iter().map(Holding::finish).collect();
        // Views are joined stretch by stretch: where one has lost its lines, the others do not count either.
        let numbers = |view: &Vec<(usize, KeptSeen)>| view.iter().map(|(number, _)| *number).collect();
        let of_views: Vec<BTreeSet<usize>> = kept.iter().map(numbers).collect();
        let in_all = |number: &usize| of_views.iter().all(|numbers| numbers.contains(number));
        kept.iter_mut().for_each(|view| view.retain(|(number, _)| in_all(number)));
        let held: Vec<Held> = kept.into_iter().map(|view| Held::new(view, pitch_mm)).collect();
        let learnt = learnt.into_iter().map(|view| view.whole).collect();
        Ok(Self { acquisition, used, given_view_m, learnt_view_m, bandwidths: fit, learning_curve, learnt, held })
    }

    /// Metres that were aligned, mean of the views.
    pub(super) fn aligned_m(&self) -> f64 {
        self.learnt_view_m / self.acquisition.view_angles_rad.len() as f64
    }

    /// Why it cannot be calibrated: what the stretches that are kept lack.
    pub(super) fn not_calibrated(&self, lacks: &'static str) -> PipelineError {
        let stretches = self.held.iter().map(Held::stretches).min().unwrap_or(0);
        PipelineError::NotCalibrated { aligned_m: self.aligned_m(), stretches, lacks }
    }
}

/// Refuses a training to which a view gave too few metres. Only what all views show calibrates, so a dead camera would leave nothing, which
/// would be found only after two more passes.
fn every_view_gave_enough(of_views_m: &[f64]) -> Result<(), PipelineError> {
    let best_m = of_views_m.iter().copied().fold(0.0, f64::max);
    if best_m < LEAST_M {
        return Err(PipelineError::TooLittleRope { aligned_m: best_m, needed_m: LEAST_M }); // no fault of a single camera
    }
    let views: Vec<(usize, f64)> =
        of_views_m.iter().copied().enumerate().filter(|(_, metres)| *metres < LEAST_M).collect();
    if views.is_empty() {
        return Ok(());
    }
    Err(PipelineError::ViewsGaveTooLittle { views, best_m, needed_m: LEAST_M })
}

/// How many stretches are kept for calibration and threshold: their evidence stays in memory.
fn kept_stretches(used: &[Used<'_>], stretches: usize) -> usize {
    let bytes = |used: &Used<'_>| {
        let acquisition = used.range.acquisition;
        let places = acquisition.rope.strands() * acquisition.rope.wires() * PLACES_PER_WIRE;
        let blocks = used.stretch_lines().div_ceil(block_lines(acquisition.line_pitch_mm)) + 2 * MARGIN_BLOCKS;
        let cells = blocks * places;
        let image = used.stretch_lines() * acquisition.sensor_px as usize;
        (cells * KeptSeen::bytes_per_place(FACTORS.len() + 1) + image) * acquisition.view_angles_rad.len()
    };
    let most_bytes = used.iter().map(bytes).max().unwrap_or(1);
    stretches.min((MOST_EVIDENCE_BYTES / most_bytes).max(LEAST_KEPT))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::Budget;
    use crate::pipeline::training_range::tests::acquisition;
    use crate::vision::judging::Judging;

    #[test]
    fn views_that_gave_too_little_are_named_unless_all_did() {
        every_view_gave_enough(&[5.0, 0.8]).unwrap();
        let said = |of_views_m: &[f64]| every_view_gave_enough(of_views_m).unwrap_err().to_string();
        let words = "view 1 gave only 0.00 m, view 3 gave only 0.45 m of aligned rope, but training needs at least 0.8 m of every view (the \
                     best gave 5.00 m): mend the camera, or leave that view out";
        assert!(said(&[5.0, 0.0, 4.6, 0.45]).starts_with(words), "{}", said(&[5.0, 0.0, 4.6, 0.45]));
        assert!(said(&[0.7, 0.0]).starts_with("only 0.70 m of the range could be aligned"), "{}", said(&[0.7, 0.0]));
    }

    #[test]
    fn views_that_show_no_stretch_together_are_not_told_that_they_have_less_rope_than_they_need() {
        let acquisition = acquisition(|_| ());
        let taught = Taught {
            acquisition: &acquisition,
            used: Vec::new(),
            given_view_m: Vec::new(),
            learnt_view_m: 7.5,
            bandwidths: BandwidthsFit::of(BandwidthsBy::Fixed, &[]),
            learning_curve: Vec::new(),
            learnt: Vec::new(),
            held: (0..2).map(|_| Held::new(Vec::new(), acquisition.line_pitch_mm)).collect(),
        };
        let said = taught.model(Budget::default(), &Judging::WHOLE).unwrap_err().to_string();
        let words = "3.75 m of rope were learnt from (mean of the views), but of the stretches that all views show 0 were kept to calibrate \
                     scores, and these are too few: widen";
        assert!(said.starts_with(words), "{said}");
    }
}
