//! Learns an appearance model from intact rope.

use super::bandwidths::{BandwidthsBy, BandwidthsFit};
use super::budget::{Budget, BudgetFit};
use super::fit::{IntactRope, IntactScores};
use super::held_back::cross_scored;
use super::learning_curve::LearningPoint;
use super::model_file::Model;
use super::results::Threshold;
use super::taught::Taught;
use super::training_range::{self, LearntFrom, TrainingRange};
use super::{PipelineError, Progress};
use crate::vision::appearance::GrayScore;
use crate::vision::evidence::block_lines;
use crate::vision::inspection_model::ViewAppearance;
use crate::vision::judging::Judging;
use crate::vision::lasting::Lasting;
use crate::vision::margins::MARGIN_BLOCKS;
use serde::{Deserialize, Serialize};
use std::path::Path;

pub use super::model_file::{is_model, read_report};

/// The passes over the rope that a training makes, as its progress names them.
pub const PASSES: [&str; 3] = ["learn", "learn more", "calibrate"];

/// What a model was trained on and what came of it. Stored with the model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrainReport {
    /// Construction of the rope.
    pub construction: String,
    /// Rope metres used; of several ranges, the least.
    pub from_m: f64,
    /// Rope metres used; of several ranges, the greatest.
    pub to_m: f64,
    /// What each of several ranges gave. Empty if there was one, and in models of earlier versions.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub learnt_from: Vec<LearntFrom>,
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
    /// Bandwidths of the gray density; `None` in models of earlier versions.
    #[serde(default)]
    pub bandwidths: Option<BandwidthsFit>,
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

/// Least rope that must be aligned in every view, in m.
pub(super) const LEAST_M: f64 = 0.8;
/// What can be chosen in a training.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct TrainOptions {
    /// What false alarms may cost.
    pub budget: Budget,
    /// Who chooses the bandwidths of the gray density.
    pub bandwidths: BandwidthsBy,
}

/// Trains on intact rope of one acquisition or of several, pooled, and writes the model to `model_path`, whole or not at all.
pub fn train(
    ranges: &[TrainingRange<'_>],
    options: TrainOptions,
    model_path: &Path,
    progress: &dyn Progress,
) -> Result<TrainReport, PipelineError> {
    let started = std::time::Instant::now();
    options.budget.false_defects().map_err(PipelineError::Budget)?; // before minutes are spent
    let taught = Taught::by(ranges, options.bandwidths, GrayScore::Surprise, progress)?;
    let mut model = taught.model(options.budget, &Judging::WHOLE)?;
    model.report.seconds = started.elapsed().as_secs_f64();
    model.write(model_path)?;
    Ok(model.report)
}

impl Taught<'_> {
    /// Calibrates a way to judge, and finds its thresholds for a budget. The seconds of its report are 0.
    pub fn model(&self, budget: Budget, judging: &Judging) -> Result<Model, PipelineError> {
        let per_100m = budget.false_defects().map_err(PipelineError::Budget)?;
        let (acquisition, used, held) = (self.acquisition, &self.used, &self.held);
        let pitch_mm = acquisition.line_pitch_mm;
        let views = acquisition.view_angles_rad.len();
        let too_few = || self.not_calibrated("are too few");
        let mut learnt: Vec<ViewAppearance> = self.learnt.iter().map(|view| judging.cut(view)).collect();
        let mut scored = cross_scored(&learnt, held, &acquisition.rope, pitch_mm, judging).ok_or_else(too_few)?;
        for (view, held) in learnt.iter_mut().zip(held) {
            if !held.calibrate(view, |_| true) {
                return Err(too_few());
            }
        }
        let block_mm = block_lines(pitch_mm) as f64 * pitch_mm;
        let lasting = if judging.lasting {
            let unjudged = || self.not_calibrated("have no line that could be judged");
            Lasting::calibrate(scored.iter().flatten().flatten(), block_mm).ok_or_else(unjudged)?
        } else {
            Lasting::NEVER
        };
        for scores in scored.iter_mut().flatten().flatten() {
            lasting.raise(scores, block_mm);
            scores.add_closer_look();
            scores.cut_margins(MARGIN_BLOCKS);
        }
        let mut intact = IntactRope::default();
        scored.iter().for_each(|views| intact.add(views, f64::INFINITY, block_mm));
        let known = judging.known_tail(&learnt, pitch_mm);
        let budget = BudgetFit::of(budget, per_100m, intact.peaks(), intact.metres(), known)
            .ok_or_else(|| self.not_calibrated("have too few peaks of the score to find a threshold"))?;
        let mut notes = Vec::new();
        let mut learnt_from = Vec::new();
        if used.len() > 1 {
            learnt_from = used.iter().zip(&self.given_view_m).map(|(used, view_m)| used.gave(*view_m)).collect();
            notes.push(training_range::sentence(&learnt_from, views));
        }
        if scored.len() == 1 {
            notes.push("only one stretch could be used, so its scores are those of rope that calibrated them and the threshold is too low: train on 2 m or more".to_owned());
        }
        if budget.left_out > 0 {
            let places = match budget.left_out {
                1 => "1 place of the rope looks like a defect and was".to_owned(),
                more => format!("{more} places of the rope look like defects and were"),
            };
            notes.push(format!(
                "{places} left out of the threshold: inspect the range with this model and look at what it reports"
            ));
        }
        let report = TrainReport {
            construction: acquisition.construction(),
            from_m: used.iter().map(|used| used.range_m().0).fold(f64::INFINITY, f64::min),
            to_m: used.iter().map(|used| used.range_m().1).fold(f64::NEG_INFINITY, f64::max),
            learnt_from,
            learnt_view_m: self.learnt_view_m,
            threshold: budget.alarm.line_score,
            threshold_origin: budget.origin(),
            budget: Some(budget),
            intact: intact.scores(),
            bandwidths: Some(self.bandwidths),
            learning_curve: self.learning_curve.clone(),
            seconds: 0.0,
            notes,
        };
        Ok(Model::new(acquisition, report, learnt, lasting))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report() -> TrainReport {
        let peaks: Vec<f32> = (0..80).map(|k| 4.0 - 0.6 * ((k as f32 + 0.5) / 80.0).ln()).collect();
        let budget = BudgetFit::of(Budget::default(), 2.0, &peaks, 2.0, None).unwrap();
        TrainReport {
            construction: "6x9".into(),
            from_m: 0.0,
            to_m: 5.0,
            learnt_from: Vec::new(),
            learnt_view_m: 5.0,
            threshold: budget.alarm.line_score,
            threshold_origin: budget.origin(),
            budget: Some(budget),
            intact: Vec::new(),
            bandwidths: None,
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
    fn only_a_training_on_several_ranges_writes_what_each_gave_and_reports_of_earlier_versions_are_read() {
        let alone = serde_json::to_value(report()).unwrap();
        assert!(alone.get("learnt_from").is_none(), "a model of one range is what it was");
        assert_eq!(serde_json::from_value::<TrainReport>(alone).unwrap(), report());
        let from = LearntFrom { acquisition: "may".into(), from_m: 0.0, to_m: 2.5, learnt_view_m: 9.8 };
        let several = TrainReport { learnt_from: vec![from.clone(), from], ..report() };
        let written = serde_json::to_value(&several).unwrap();
        assert_eq!(written["learnt_from"][1]["acquisition"], "may");
        assert_eq!(serde_json::from_value::<TrainReport>(written).unwrap(), several);
    }

    #[test]
    fn a_model_of_an_earlier_version_has_one_level() {
        let report = TrainReport { budget: None, ..report() };
        assert_eq!(report.decides_by(None).look_again_line_score, None);
    }
}
