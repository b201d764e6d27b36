//! Several ways to judge one rope, side by side: it is read and aligned once, because alignment does not depend on who judges.

use super::detection::Detection;
use super::drive::Drive;
use super::inspect::write_json;
use super::model_file::Model;
use super::tables::LineValues;
use super::{Acquisition, FrameSource, PipelineError, Progress};
use crate::vision::judging::Judging;
use rayon::prelude::*;
use std::path::Path;
use std::sync::Arc;

/// Somebody who judges, and where the findings go.
pub struct Judge<'a> {
    /// By what: calibrated for this way to judge.
    pub model: &'a Model,
    /// How.
    pub judging: Judging,
    /// Folder for line scores (binary), `defects.json`, and `summary.json` with nothing but lines and threshold.
    pub results: &'a Path,
}

/// Inspects `source` as [`inspect`](super::inspect()) does, once for all judges, each by its own threshold. Lay lengths are not written.
pub fn judge_all(
    acquisition: &Acquisition,
    source: &dyn FrameSource,
    judges: &[Judge<'_>],
    progress: &dyn Progress,
) -> Result<(), PipelineError> {
    let drive = Drive { acquisition, source, range: 0..usize::MAX, given_contours: None, stage: "inspect", progress };
    let mut reader = drive.reader()?;
    let views = acquisition.view_angles_rad.len();
    let mut detections = Vec::new();
    for Judge { model, judging, results } in judges {
        model.check(acquisition)?;
        let line_scores = LineValues::create(results, views)?;
        detections.push(Detection::new(acquisition, (model, *judging), &model.report.decides_by(None), line_scores));
    }
    drive.run(&mut reader, |stretch, cameras| {
        let stretch = Arc::new(stretch);
        detections.par_iter_mut().try_for_each(|detection| detection.take(stretch.clone(), cameras, false).map(drop))
    })?;
    for (judge, mut detection) in judges.iter().zip(detections) {
        detection.take_last(false)?;
        let (found, line_scores) = detection.finish();
        line_scores.write_binary("line_scores")?;
        write_json(&judge.results.join("defects.json"), &found.defects)?;
        let decided = serde_json::json!({ "lines": reader.lines(), "threshold": judge.model.report.decides_by(None) });
        write_json(&judge.results.join("summary.json"), &decided)?;
    }
    Ok(())
}
