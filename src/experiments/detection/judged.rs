//! Everything that is known of one run: curves, defects, costs, decisions.

use super::super::ExperimentError;
use crate::evaluate::EvaluateError;
use crate::evaluate::costs::{Cost, costs};
use crate::evaluate::curves::{Points, ViewCurve, average, curves};
use crate::evaluate::defects::{Decisions, reported, score};
use crate::evaluate::kinds::{Confusion, confusion};
use crate::evaluate::labels::{classify, read_sightings};
use crate::evaluate::line_scores::read_scores;
use crate::evaluate::recall::{DefectRecall, recall};
use crate::evaluate::truth::{RecordingFile, read_json};
use serde::Deserialize;
use std::path::Path;

/// A run beside the labels.
pub(super) struct Judged {
    pub views: usize,
    /// Metres that count.
    pub metres: f64,
    pub curves: Vec<ViewCurve>,
    pub average: Points,
    pub defects: Vec<DefectRecall>,
    pub costs: Vec<Cost>,
    pub decisions: Option<Decisions>,
    pub threshold_origin: Option<String>,
    /// Kinds suggested, by kind of the label.
    pub kinds: Option<Confusion>,
}

#[derive(Deserialize)]
struct SummaryFile {
    threshold: Option<ThresholdFile>,
    lines: usize,
}

#[derive(Deserialize)]
struct ThresholdFile {
    line_score: f64,
    origin: String,
}

impl Judged {
    /// Judges a results folder against the labels beside a recording.
    pub fn read(recording: &Path, results: &Path, skip: usize) -> Result<Self, ExperimentError> {
        let rope = RecordingFile::read(recording)?;
        let summary: SummaryFile = read_json(&results.join("summary.json"))?;
        let (views, lines) = (rope.views.len(), rope.lines.unwrap_or(summary.lines));
        let sightings = read_sightings(recording, lines, views, rope.line_pitch_mm)?;
        let path = results.join("line_scores.csv");
        let scores = read_scores(results, lines, views)?.ok_or_else(|| EvaluateError::Json {
            path: path.clone(),
            reason: "it is not there: inspect with --model, so that lines are scored".into(),
        })?;
        let classes = classify(&sightings, lines, views, skip);
        let curves = curves(&scores, &sightings, &classes, skip);
        if curves.is_empty() {
            let reason = format!("from line {skip} on there is no clear label, or no intact line, with a score");
            return Err(EvaluateError::Json { path, reason }.into());
        }
        let reported = reported(results, &sightings)?;
        let threshold = summary.threshold.as_ref().map(|t| t.line_score);
        let defects = recall(&scores, &sightings, &classes, skip, threshold, reported.as_ref());
        Ok(Self {
            views,
            metres: lines.saturating_sub(skip) as f64 * rope.line_pitch_mm / 1000.0,
            average: average(&curves),
            costs: costs(&scores, (&sightings, &classes), &defects, threshold, skip, rope.line_pitch_mm),
            kinds: confusion(results, &sightings, skip)?,
            decisions: score(results, &sightings, lines, rope.line_pitch_mm, skip)?,
            curves,
            defects,
            threshold_origin: summary.threshold.map(|t| t.origin),
        })
    }

    /// Mean area under the curves of the views.
    pub fn mean_auc(&self) -> f64 {
        self.curves.iter().map(|c| c.auc).sum::<f64>() / self.curves.len() as f64
    }

    /// False rate that recovers half of every one of this share of the defects, in their best views.
    pub fn rate_for(&self, share: f64) -> Option<f64> {
        let mut needed: Vec<f64> = self.defects.iter().map(|d| d.rate_needed).collect();
        needed.sort_by(f64::total_cmp);
        let at = ((share * needed.len() as f64).ceil() as usize).checked_sub(1)?;
        needed.get(at).copied()
    }
}
