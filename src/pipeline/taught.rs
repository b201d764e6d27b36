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
        let too_little = |aligned_m| PipelineError::TooLittleRope { aligned_m, needed_m: LEAST_M };
        let acquisition = ranges.first().ok_or_else(|| too_little(0.0))?.acquisition;
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
        let learnt_view_m: f64 = gray.iter().map(|view| view.metres).sum();
        let aligned_m = learnt_view_m / views as f64;
        if aligned_m < LEAST_M {
            return Err(too_little(aligned_m));
        }
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
