//! Learns an appearance model from intact rope.

use super::budget::{Budget, BudgetFit};
use super::fit::{IntactRope, IntactScores};
use super::folds::fold_of;
use super::held_back::{Held, cross_scored};
use super::learning_curve::{GrowingGray, LearningPoint, curve};
use super::learning_view::{LearningView, LearntView};
use super::model_file::Model;
use super::passes::{Pass, Used};
use super::results::Threshold;
use super::training_range::{self, LearntFrom, TrainingRange};
use super::{PipelineError, Progress};
use crate::vision::evidence::block_lines;
use crate::vision::factor::FACTORS;
use crate::vision::inspection_model::ViewAppearance;
use crate::vision::kept_evidence::KeptEvidence;
use crate::vision::lasting::Lasting;
use crate::vision::surface_map::PLACES_PER_WIRE;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
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
pub(super) const LEAST_M: f64 = 0.8;
/// Memory for the evidence of stretches that calibrate; what is made of it takes half as much again.
const MOST_EVIDENCE_BYTES: usize = 350_000_000;
/// Fewest stretches that are kept, if there are as many.
const LEAST_KEPT: usize = 6;

/// Trains on intact rope of one acquisition or of several, pooled, and writes the model to `model_path`, whole or not at all.
pub fn train(
    ranges: &[TrainingRange<'_>],
    budget: Budget,
    model_path: &Path,
    progress: &dyn Progress,
) -> Result<TrainReport, PipelineError> {
    let started = std::time::Instant::now();
    let per_100m = budget.false_defects().map_err(PipelineError::Budget)?;
    let too_little = |aligned_m, needed_m| PipelineError::TooLittleRope { aligned_m, needed_m };
    let acquisition = ranges.first().ok_or_else(|| too_little(0.0, LEAST_M))?.acquisition;
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
        return Err(too_little(aligned_m, LEAST_M));
    }
    let learning_curve = curve(&gray);

    // Second pass: the further factors, relative to the gray that is expected by what the other folds taught.
    let mut learning: Vec<LearningView> = gray.into_par_iter().map(|gray| LearningView::new(gray.folds)).collect();
    pass(PASSES[1]).each_view(&mut learning, |_| true, |number, aligned, view| view.take(number, &aligned))?;
    let learnt: Vec<LearntView> = learning.into_par_iter().map(LearningView::learnt).collect();

    // Third pass: evidence of every fold by the others, for calibration and threshold.
    let kept = kept_stretches(&used, stretches);
    let mut evidence: Vec<(&LearntView, Vec<(usize, Vec<KeptEvidence>)>)> =
        learnt.iter().map(|v| (v, Vec::new())).collect();
    let keeps = |number: usize| number * kept / stretches != (number + 1) * kept / stretches;
    pass(PASSES[2]).each_view(&mut evidence, keeps, |number, aligned, (view, stretches)| {
        let evidence = aligned.evidence(&view.by_others[fold_of(number)]);
        stretches.push((number, evidence.into_iter().map(KeptEvidence::from).collect()));
    })?;
    // Views are joined stretch by stretch: where one has lost its lines, the others do not count either.
    let numbers = |(_, stretches): &(_, Vec<(usize, _)>)| stretches.iter().map(|(number, _)| *number).collect();
    let of_views: Vec<BTreeSet<usize>> = evidence.iter().map(numbers).collect();
    let in_all = |number: &usize| of_views.iter().all(|numbers| numbers.contains(number));
    let held: Vec<Held> = evidence
        .into_iter()
        .map(|(_, stretches)| {
            stretches.into_iter().filter(|(number, _)| in_all(number)).map(|(_, kept)| kept).collect()
        })
        .map(|stretches| Held::new(stretches, pitch_mm))
        .collect();
    let too_little = || too_little(aligned_m, 2.0 * LEAST_M);
    let mut learnt: Vec<ViewAppearance> = learnt.into_iter().map(|view| view.whole).collect();
    let mut scored = cross_scored(&learnt, &held, acquisition.rope.strands(), pitch_mm).ok_or_else(too_little)?;
    for (view, held) in learnt.iter_mut().zip(&held) {
        if !held.calibrate(view, |_| true) {
            return Err(too_little());
        }
    }
    let block_mm = block_lines(pitch_mm) as f64 * pitch_mm;
    let lasting = Lasting::calibrate(scored.iter().flatten().flatten(), block_mm).ok_or_else(too_little)?;
    scored.iter_mut().flatten().flatten().for_each(|scores| lasting.raise(scores, block_mm));
    let mut intact = IntactRope::default();
    scored.iter().for_each(|views| intact.add(views, f64::INFINITY, block_mm));
    let budget = BudgetFit::of(budget, per_100m, intact.peaks(), intact.metres()).ok_or_else(too_little)?;
    let mut notes = Vec::new();
    let mut learnt_from = Vec::new();
    if used.len() > 1 {
        learnt_from = used.iter().zip(given_view_m).map(|(used, view_m)| used.gave(view_m)).collect();
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
        learnt_view_m,
        threshold: budget.alarm.line_score,
        threshold_origin: budget.origin(),
        budget: Some(budget),
        intact: intact.scores(),
        learning_curve,
        seconds: started.elapsed().as_secs_f64(),
        notes,
    };
    Model::new(acquisition, report.clone(), learnt, lasting).write(model_path)?;
    Ok(report)
}

/// How many stretches are kept for calibration and threshold: their evidence stays in memory.
fn kept_stretches(used: &[Used<'_>], stretches: usize) -> usize {
    let bytes = |used: &Used<'_>| {
        let acquisition = used.range.acquisition;
        let places = acquisition.rope.strands() * acquisition.rope.wires() * PLACES_PER_WIRE;
        let cells = used.stretch_lines().div_ceil(block_lines(acquisition.line_pitch_mm)) * places;
        cells * KeptEvidence::BYTES_PER_PLACE * (FACTORS.len() + 1) * acquisition.view_angles_rad.len()
    };
    let most_bytes = used.iter().map(bytes).max().unwrap_or(1);
    stretches.min((MOST_EVIDENCE_BYTES / most_bytes).max(LEAST_KEPT))
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
            learnt_from: Vec::new(),
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
