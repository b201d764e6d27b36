//! Learns an appearance model from intact rope.

use super::budget::{Budget, BudgetFit};
use super::drive::{Drive, aligner_spec};
use super::fit::{IntactRope, IntactScores};
use super::held_back::{Held, cross_scored};
use super::learning_curve::{GrowingGray, LearningPoint, curve};
use super::model_file::Model;
use super::results::Threshold;
use super::stretches::STRETCH_LINES;
use super::{Acquisition, FrameSource, PipelineError, Progress};
use crate::vision::appearance::Appearance;
use crate::vision::evidence::{Evidence, block_lines};
use crate::vision::factor::FACTORS;
use crate::vision::histogram::Histogram;
use crate::vision::inspection_model::{AlignedView, ViewAppearance};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::Path;

pub use super::model_file::{is_model, read_report};

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
/// Every so many stretches one is held back for calibration and threshold.
const HELD_BACK_EVERY: usize = 3;
/// Most stretches that are held back: more tell nothing new, and their evidence stays in memory.
const MOST_HELD_BACK: usize = 16;

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
    let used = drive("learn").reader()?.range();

    // First pass: gray values of intact rope.
    let stretches = used.len().div_ceil(aligner_spec(acquisition).stretch_lines(STRETCH_LINES));
    let learnt_stretches = (0..stretches).filter(|&number| !held_back(number)).count();
    let mut gray = vec![GrowingGray::new(learnt_stretches); views];
    each_view(&drive("learn"), &mut gray, |_| true, |number, aligned, gray| gray.take(&aligned, held_back(number)))?;
    let learnt_view_m: f64 = gray.iter().map(|view| view.metres).sum();
    let aligned_m = learnt_view_m / views as f64;
    if aligned_m < LEAST_M {
        return Err(PipelineError::TooLittleRope { aligned_m, needed_m: LEAST_M });
    }
    let (gray, learning_curve) = curve(gray);

    // Second pass: the further factors, relative to the gray that is expected.
    let mut factors: Vec<(&Appearance, [Histogram; FACTORS.len()])> =
        gray.iter().map(|g| (g, Default::default())).collect();
    each_view(
        &drive("learn more"),
        &mut factors,
        |k| !held_back(k),
        |_, aligned, (gray, histograms)| {
            aligned.learn_factors(gray, histograms);
        },
    )?;
    let learnt: Vec<ViewAppearance> = factors.par_iter().map(|(g, h)| ViewAppearance::new((*g).clone(), h)).collect();

    // Third pass: evidence of what was held back, for calibration and threshold.
    let mut evidence: Vec<(&ViewAppearance, Vec<Vec<Evidence>>)> = learnt.iter().map(|v| (v, Vec::new())).collect();
    each_view(&drive("calibrate"), &mut evidence, held_back, |_, aligned, (model, stretches)| {
        if stretches.len() < MOST_HELD_BACK {
            stretches.push(aligned.evidence(model));
        }
    })?;
    let held: Held = evidence.into_iter().map(|(_, stretches)| stretches).collect();
    let too_little = || PipelineError::TooLittleRope { aligned_m, needed_m: 2.0 * LEAST_M };
    let mut learnt = learnt;
    let scored = cross_scored(&learnt, &held, acquisition.rope.strands(), pitch_mm).ok_or_else(too_little)?;
    for (view, stretches) in learnt.iter_mut().zip(&held) {
        if !view.calibrate(stretches, pitch_mm) {
            return Err(too_little());
        }
    }
    let block_mm = block_lines(pitch_mm) as f64 * pitch_mm;
    let mut intact = IntactRope::default();
    scored.iter().for_each(|views| intact.add(views, f64::INFINITY, block_mm));
    let budget = BudgetFit::of(options.budget, per_100m, intact.peaks(), intact.metres()).ok_or_else(too_little)?;
    let mut notes = Vec::new();
    if scored.len() == 1 {
        notes.push("only one stretch could be held back, so its scores are those of rope that calibrated them and the threshold is too low: train on 2 m or more".to_owned());
    }
    if budget.left_out > 0 {
        notes.push(format!(
            "{} places of the held-back rope look like defects and were left out of the threshold: inspect the range with this model and \
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

fn held_back(number: usize) -> bool {
    number % HELD_BACK_EVERY == HELD_BACK_EVERY - 1
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
