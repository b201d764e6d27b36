//! Learns an appearance model from intact rope.

use super::drive::Drive;
use super::model_file::{Model, ViewAppearance};
use super::{Acquisition, FrameSource, PipelineError, Progress};
use crate::vision::aligner::AlignedStretch;
use crate::vision::appearance::Appearance;
use crate::vision::camera::Camera;
use crate::vision::evidence::{self, Evidence, block_lines};
use crate::vision::histogram::Histogram;
use crate::vision::scoring::{CalibrationSums, score};
use crate::vision::threshold::for_budget;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::Path;

pub use super::model_file::read_report;

/// What to learn from.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TrainOptions {
    /// Rope metre from which on the rope is intact; `None`: from the start.
    pub from_m: Option<f64>,
    /// Rope metre up to which it is; `None`: to the end.
    pub to_m: Option<f64>,
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
    /// Wall-clock seconds of the run.
    pub seconds: f64,
    /// What else a person should know, as sentences.
    pub notes: Vec<String>,
}

/// False defects per 100 m that the threshold is made for.
const BUDGET_PER_100M: f64 = 2.0;
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
    let line = |position_m: f64| {
        ((position_m - acquisition.start_m) * 1000.0 / acquisition.line_pitch_mm).round().max(0.0) as usize
    };
    let range = options.from_m.map_or(0, line)..options.to_m.map_or(usize::MAX, line);
    let views = acquisition.view_angles_rad.len();
    let pitch_mm = acquisition.line_pitch_mm;
    let rope = &acquisition.rope;

    // First pass: the histogram of intact rope.
    let drive = |stage| Drive { acquisition, source, range: range.clone(), given_contours: None, stage, progress };
    let learning = drive("learn");
    let mut reader = learning.reader()?;
    let used = reader.range();
    let mut histograms = vec![Histogram::default(); views];
    let mut learnt_view_m = 0.0;
    let mut numbered = 0;
    learning.run(&mut reader, |stretch, cameras| {
        let held_back = held_back(numbered);
        numbered += 1;
        if !held_back {
            learnt_view_m += learn(acquisition, &stretch, cameras, &mut histograms);
        }
        Ok(())
    })?;
    let aligned_m = learnt_view_m / views as f64;
    if aligned_m < LEAST_M {
        return Err(PipelineError::TooLittleRope { aligned_m, needed_m: LEAST_M });
    }
    let appearances: Vec<Appearance> = histograms.par_iter().map(Appearance::learn).collect();
    drop(histograms);

    // Second pass: evidence of what was held back.
    let calibrating = drive("calibrate");
    let mut evidence: Vec<Vec<Evidence>> = vec![Vec::new(); views];
    let mut numbered = 0;
    calibrating.run(&mut calibrating.reader()?, |stretch, cameras| {
        let wanted = held_back(numbered) && evidence[0].len() < MOST_HELD_BACK;
        numbered += 1;
        if let (true, Ok(estimates)) = (wanted, &stretch.estimates) {
            let gathered: Vec<Option<Evidence>> = (0..views)
                .into_par_iter()
                .map(|v| {
                    let view = &stretch.views[v];
                    let gather =
                        || Evidence::gather(rope, &cameras[v], estimates, view, &appearances[v], block_lines(pitch_mm));
                    view.usable().then(gather)
                })
                .collect();
            for (all, one) in evidence.iter_mut().zip(gathered) {
                all.extend(one);
            }
        }
        Ok(())
    })?;
    let mut learnt = Vec::new();
    let mut block_scores: Vec<f32> = Vec::new();
    for (appearance, evidence) in appearances.into_iter().zip(&evidence) {
        let mut sums = CalibrationSums::default();
        evidence.iter().for_each(|e| sums.add(e, pitch_mm));
        let calibration =
            sums.calibrate().ok_or(PipelineError::TooLittleRope { aligned_m, needed_m: 2.0 * LEAST_M })?;
        block_scores
            .extend(evidence.par_iter().map(|e| score(e, &calibration, pitch_mm).blocks).collect::<Vec<_>>().concat());
        learnt.push(ViewAppearance { appearance, calibration });
    }
    let blocks_per_100m = views as f64 * 1e5 / (block_lines(pitch_mm) as f64 * pitch_mm);
    let threshold = for_budget(&block_scores, blocks_per_100m, BUDGET_PER_100M)
        .ok_or(PipelineError::TooLittleRope { aligned_m, needed_m: 2.0 * LEAST_M })?;
    let report = TrainReport {
        construction: acquisition.construction(),
        from_m: acquisition.position_m(used.start),
        to_m: acquisition.position_m(used.end),
        learnt_view_m,
        threshold: threshold.line_score,
        threshold_origin: format!(
            "{:.1} m of held-back intact rope, exponential tail, {BUDGET_PER_100M} false defects per 100 m",
            evidence[0].len() as f64 * 0.2
        ),
        seconds: started.elapsed().as_secs_f64(),
        notes: Vec::new(),
    };
    Model::new(acquisition, report.clone(), learnt).write(model_path)?;
    Ok(report)
}

fn held_back(number: usize) -> bool {
    number % HELD_BACK_EVERY == HELD_BACK_EVERY - 1
}

/// Adds a stretch to the histograms of its views; answers the metres times views that were learnt from.
fn learn(acquisition: &Acquisition, stretch: &AlignedStretch, cameras: &[Camera], histograms: &mut [Histogram]) -> f64 {
    let Ok(estimates) = &stretch.estimates else { return 0.0 };
    let used: Vec<f64> = histograms
        .par_iter_mut()
        .enumerate()
        .map(|(v, histogram)| {
            let view = &stretch.views[v];
            if !view.usable() {
                return 0.0;
            }
            evidence::learn(&acquisition.rope, &cameras[v], estimates, view, histogram);
            stretch.lines as f64 * acquisition.line_pitch_mm / 1000.0
        })
        .collect();
    used.iter().sum()
}
