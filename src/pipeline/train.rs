//! Learns an appearance model from intact rope.

use super::budget::{Budget, BudgetFit};
use super::drive::{Drive, aligner_spec};
use super::fit::{IntactRope, IntactScores};
use super::folds::fold_of;
use super::held_back::{Held, cross_scored};
use super::learning_curve::{GrowingGray, LearningPoint, curve};
use super::learning_view::{LearningView, LearntView};
use super::model_file::Model;
use super::results::Threshold;
use super::stretches::STRETCH_LINES;
use super::{Acquisition, FrameSource, PipelineError, Progress};
use crate::vision::evidence::{Evidence, block_lines};
use crate::vision::factor::FACTORS;
use crate::vision::inspection_model::{AlignedView, ViewAppearance};
use crate::vision::surface_map::PLACES_PER_WIRE;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::Path;

pub use super::model_file::{is_model, read_report};

/// The passes over the rope that a training makes, as its progress names them.
pub const PASSES: [&str; 3] = ["learn", "learn more", "calibrate"];

/// What to learn from.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TrainOptions {
    /// Rope metre from which on the rope is intact; `None`: from the start.
    pub from_m: Option<f64>,
    /// Rope metre up to which it is; `None`: to the end.
    pub to_m: Option<f64>,
    /// What false alarms may cost.
    pub budget: Budget,
}

/// What a model was trained on and what came of it. Stored with the model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrainReport {
    /// Construction of the rope.
    pub construction: String,
    /// Rope metres used.
    pub from_m: f64,
    /// Rope metres used.
    pub to_m: f64,
    /// Metres of rope that were aligned and learnt from, summed over the views.
    pub learnt_view_m: f64,
    /// Line score above which a line is an alarm, found on held-back intact rope.
    pub threshold: f64,
    /// How the threshold was found.
    pub threshold_origin: String,
    /// Both thresholds with the budget that they are made for; `None` in models of earlier versions.
    #[serde(default)]
    pub budget: Option<BudgetFit>,
    /// Scores of held-back rope, one entry a view: what those of an inspection are compared with. Empty in models of earlier versions.
    #[serde(default)]
    pub intact: Vec<Option<IntactScores>>,
    /// What the model would have known with less rope. Empty in models of earlier versions.
    #[serde(default)]
    pub learning_curve: Vec<LearningPoint>,
    /// Wall-clock seconds of the run.
    pub seconds: f64,
    /// What else a person should know, as sentences.
    pub notes: Vec<String>,
}

impl TrainReport {
    /// The threshold of an inspection: the one that somebody set, or what the training found.
    pub fn decides_by(&self, set: Option<&Threshold>) -> Threshold {
        let below = self.budget.as_ref().map(BudgetFit::look_again_below);
        let threshold = set.cloned().unwrap_or_else(|| Threshold {
            line_score: self.threshold,
            look_again_line_score: None,
            origin: self.threshold_origin.clone(),
        });
        let usual = below.map(|below| threshold.line_score - below);
        Threshold { look_again_line_score: threshold.look_again_line_score.or(usual), ..threshold }
    }
}

/// Least rope that must be aligned, in m.
const LEAST_M: f64 = 0.8;
/// Memory for the evidence of stretches that calibrate.
const MOST_EVIDENCE_BYTES: usize = 300_000_000;
/// What evidence takes for a place of the unrolled rope: sum, count, region.
const BYTES_PER_CELL: usize = 9;
/// Fewest stretches that are kept, if there are as many.
const LEAST_KEPT: usize = 6;

/// Trains on `source` and writes the model to `model_path`, whole or not at all.
pub fn train(
    acquisition: &Acquisition,
    source: &dyn FrameSource,
    options: TrainOptions,
    model_path: &Path,
    progress: &dyn Progress,
) -> Result<TrainReport, PipelineError> {
    let started = std::time::Instant::now();
    let per_100m = options.budget.false_defects().map_err(PipelineError::Budget)?;
    let line = |position_m: f64| {
        ((position_m - acquisition.start_m) * 1000.0 / acquisition.line_pitch_mm).round().max(0.0) as usize
    };
    let range = options.from_m.map_or(0, line)..options.to_m.map_or(usize::MAX, line);
    let views = acquisition.view_angles_rad.len();
    let pitch_mm = acquisition.line_pitch_mm;

    let drive = |stage| Drive { acquisition, source, range: range.clone(), given_contours: None, stage, progress };
    let used = drive(PASSES[0]).reader()?.range();

    // First pass: gray values of intact rope.
    let stretches = used.len().div_ceil(aligner_spec(acquisition).stretch_lines(STRETCH_LINES));
    let mut gray = vec![GrowingGray::new(stretches); views];
    each_view(&drive(PASSES[0]), &mut gray, |_| true, |number, aligned, gray| gray.take(number, &aligned))?;
    let learnt_view_m: f64 = gray.iter().map(|view| view.metres).sum();
    let aligned_m = learnt_view_m / views as f64;
    if aligned_m < LEAST_M {
        return Err(PipelineError::TooLittleRope { aligned_m, needed_m: LEAST_M });
    }
    let learning_curve = curve(&gray);

    // Second pass: the further factors, relative to the gray that is expected by what the other folds taught.
    let mut learning: Vec<LearningView> = gray.into_par_iter().map(|gray| LearningView::new(gray.folds)).collect();
    each_view(&drive(PASSES[1]), &mut learning, |_| true, |number, aligned, view| view.take(number, &aligned))?;
    let learnt: Vec<LearntView> = learning.into_par_iter().map(LearningView::learnt).collect();

    // Third pass: evidence of every fold by the others, for calibration and threshold.
    let kept = kept_stretches(acquisition, stretches);
    let mut evidence: Vec<(&LearntView, Vec<Vec<Evidence>>)> = learnt.iter().map(|v| (v, Vec::new())).collect();
    let keeps = |number: usize| number * kept / stretches != (number + 1) * kept / stretches;
    each_view(&drive(PASSES[2]), &mut evidence, keeps, |number, aligned, (view, stretches)| {
        stretches.push(aligned.evidence(&view.by_others[fold_of(number)]));
    })?;
    let held: Vec<Held> = evidence.into_iter().map(|(_, stretches)| Held::new(stretches, pitch_mm)).collect();
    let too_little = || PipelineError::TooLittleRope { aligned_m, needed_m: 2.0 * LEAST_M };
    let mut learnt: Vec<ViewAppearance> = learnt.into_iter().map(|view| view.whole).collect();
    let scored = cross_scored(&learnt, &held, acquisition.rope.strands(), pitch_mm).ok_or_else(too_little)?;
    for (view, held) in learnt.iter_mut().zip(&held) {
        if !held.calibrate(view, |_| true) {
            return Err(too_little());
        }
    }
    let block_mm = block_lines(pitch_mm) as f64 * pitch_mm;
    let mut intact = IntactRope::default();
    scored.iter().for_each(|views| intact.add(views, f64::INFINITY, block_mm));
    let budget = BudgetFit::of(options.budget, per_100m, intact.peaks(), intact.metres()).ok_or_else(too_little)?;
    let mut notes = Vec::new();
    if scored.len() == 1 {
        notes.push("only one stretch could be used, so its scores are those of rope that calibrated them and the threshold is too low: train on 2 m or more".to_owned());
    }
    if budget.left_out > 0 {
        notes.push(format!(
            "{} places of the rope look like defects and were left out of the threshold: inspect the range with this model and \
             look at what it reports",
            budget.left_out
        ));
    }
    let report = TrainReport {
        construction: acquisition.construction(),
        from_m: acquisition.position_m(used.start),
        to_m: acquisition.position_m(used.end),
        learnt_view_m,
        threshold: budget.alarm.line_score,
        threshold_origin: budget.origin(),
        budget: Some(budget),
        intact: intact.scores(),
        learning_curve,
        seconds: started.elapsed().as_secs_f64(),
        notes,
    };
    Model::new(acquisition, report.clone(), learnt).write(model_path)?;
    Ok(report)
}

/// How many stretches are kept for calibration and threshold: their evidence stays in memory.
fn kept_stretches(acquisition: &Acquisition, stretches: usize) -> usize {
    let lines = aligner_spec(acquisition).stretch_lines(STRETCH_LINES);
    let places = acquisition.rope.strands() * acquisition.rope.wires() * PLACES_PER_WIRE;
    let cells = lines.div_ceil(block_lines(acquisition.line_pitch_mm)) * places;
    let bytes = cells * BYTES_PER_CELL * (FACTORS.len() + 1) * acquisition.view_angles_rad.len();
    stretches.min((MOST_EVIDENCE_BYTES / bytes).max(LEAST_KEPT))
}

/// Aligns the range and hands every usable view of the stretches that are `wanted` (by number) to `take`, with its number and what
/// that view gathers; all views at once.
fn each_view<T: Send>(
    drive: &Drive<'_>,
    gathered: &mut [T],
    wanted: impl Fn(usize) -> bool,
    take: impl Fn(usize, AlignedView<'_>, &mut T) + Sync,
) -> Result<(), PipelineError> {
    let pitch_mm = drive.acquisition.line_pitch_mm;
    let rope = &drive.acquisition.rope;
    let mut number = 0;
    drive.run(&mut drive.reader()?, |stretch, cameras| {
        let this = number;
        number += 1;
        if let (true, Ok(estimates)) = (wanted(this), &stretch.estimates) {
            gathered.par_iter_mut().enumerate().for_each(|(v, gathered)| {
                let view = &stretch.views[v];
                if view.usable() {
                    let block_lines = block_lines(pitch_mm);
                    take(
                        this,
                        AlignedView { rope, camera: &cameras[v], estimates, view, block_lines, pitch_mm },
                        gathered,
                    );
                }
            });
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report() -> TrainReport {
        let peaks: Vec<f32> = (0..80).map(|k| 4.0 - 0.6 * ((k as f32 + 0.5) / 80.0).ln()).collect();
        let budget = BudgetFit::of(Budget::default(), 2.0, &peaks, 2.0).unwrap();
        TrainReport {
            construction: "6x9".into(),
            from_m: 0.0,
            to_m: 5.0,
            learnt_view_m: 5.0,
            threshold: budget.alarm.line_score,
            threshold_origin: budget.origin(),
            budget: Some(budget),
            intact: Vec::new(),
            learning_curve: Vec::new(),
            seconds: 1.0,
            notes: Vec::new(),
        }
    }

    #[test]
    fn a_threshold_keeps_its_origin_and_its_second_level_lies_as_far_below_as_the_trained_one() {
        let report = report();
        let trained = report.decides_by(None);
        assert!(trained.origin.starts_with("automatic, budget 2 false defects"), "{}", trained.origin);
        let below = trained.line_score - trained.look_again_line_score.unwrap();
        assert!(below > 0.3, "{below}");
        let numbered =
            Threshold { line_score: 9.0, look_again_line_score: None, origin: "version 3, A. Inspector".into() };
        let decides = report.decides_by(Some(&numbered));
        assert_eq!((decides.line_score, decides.origin.as_str()), (9.0, "version 3, A. Inspector"));
        assert!((9.0 - decides.look_again_line_score.unwrap() - below).abs() < 1e-9);
        let own = Threshold { look_again_line_score: Some(5.0), ..Threshold::by_hand(9.0) };
        assert_eq!(report.decides_by(Some(&own)).look_again_line_score, Some(5.0));
    }

    #[test]
    fn a_model_of_an_earlier_version_has_one_level() {
        let report = TrainReport { budget: None, ..report() };
        assert_eq!(report.decides_by(None).look_again_line_score, None);
    }
}
