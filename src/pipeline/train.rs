//! Learns an appearance model from intact rope.

use super::drive::Drive;
use super::model_file::Model;
use super::stretches::STRETCH_LINES;
use super::{Acquisition, FrameSource, PipelineError, Progress};
use crate::vision::appearance::Appearance;
use crate::vision::evidence::{Evidence, block_lines};
use crate::vision::factor::FACTORS;
use crate::vision::histogram::Histogram;
use crate::vision::inspection_model::{AlignedView, ViewAppearance};
use crate::vision::scoring::{StretchScores, join_views};
use crate::vision::threshold::for_budget;
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

    let drive = |stage| Drive { acquisition, source, range: range.clone(), given_contours: None, stage, progress };
    let used = drive("learn").reader()?.range();

    // First pass: gray values of intact rope.
    let mut gray = vec![Histogram::default(); views];
    let learnt_view_m =
        each_view(&drive("learn"), &mut gray, |k| !held_back(k), |aligned, histogram| aligned.learn_gray(histogram))?;
    let aligned_m = learnt_view_m / views as f64;
    if aligned_m < LEAST_M {
        return Err(PipelineError::TooLittleRope { aligned_m, needed_m: LEAST_M });
    }
    let gray: Vec<Appearance> = gray.par_iter().map(Appearance::learn).collect();

    // Second pass: the further factors, relative to the gray that is expected.
    let mut factors: Vec<(&Appearance, [Histogram; FACTORS.len()])> =
        gray.iter().map(|g| (g, Default::default())).collect();
    each_view(
        &drive("learn more"),
        &mut factors,
        |k| !held_back(k),
        |aligned, (gray, histograms)| {
            aligned.learn_factors(gray, histograms);
        },
    )?;
    let learnt: Vec<ViewAppearance> = factors.par_iter().map(|(g, h)| ViewAppearance::new((*g).clone(), h)).collect();

    // Third pass: evidence of what was held back, for calibration and threshold.
    let mut evidence: Vec<(&ViewAppearance, Vec<Vec<Evidence>>)> = learnt.iter().map(|v| (v, Vec::new())).collect();
    each_view(&drive("calibrate"), &mut evidence, held_back, |aligned, (model, stretches)| {
        if stretches.len() < MOST_HELD_BACK {
            stretches.push(aligned.evidence(model));
        }
    })?;
    let evidence: Vec<_> = evidence.into_iter().map(|(_, stretches)| stretches).collect();
    let too_little = || PipelineError::TooLittleRope { aligned_m, needed_m: 2.0 * LEAST_M };
    let mut learnt = learnt;
    let held_back_stretches = evidence.first().map_or(0, Vec::len);
    let mut scored: Vec<Vec<Option<StretchScores>>> = Vec::new(); // [view][stretch]
    for (view, stretches) in learnt.iter_mut().zip(evidence) {
        if !view.calibrate(&stretches, pitch_mm) {
            return Err(too_little());
        }
        scored.push(stretches.into_par_iter().map(|s| Some(view.score(s, pitch_mm))).collect());
    }
    // As in an inspection, views share what they see. (A view that missed a stretch is out of step: then each stands alone.)
    if scored.iter().all(|stretches| stretches.len() == held_back_stretches) {
        for stretch in 0..held_back_stretches {
            let mut views: Vec<Option<StretchScores>> = scored.iter_mut().map(|view| view[stretch].take()).collect();
            join_views(&mut views, acquisition.rope.strands());
            for (view, joined) in scored.iter_mut().zip(views) {
                view[stretch] = joined;
            }
        }
    }
    let block_scores: Vec<f32> = scored.iter().flatten().flatten().flat_map(|s| s.blocks.iter().copied()).collect();
    let blocks_per_100m = views as f64 * 1e5 / (block_lines(pitch_mm) as f64 * pitch_mm);
    let threshold = for_budget(&block_scores, blocks_per_100m, BUDGET_PER_100M).ok_or_else(too_little)?;
    let report = TrainReport {
        construction: acquisition.construction(),
        from_m: acquisition.position_m(used.start),
        to_m: acquisition.position_m(used.end),
        learnt_view_m,
        threshold: threshold.line_score,
        threshold_origin: format!(
            "{:.1} m of held-back intact rope, exponential tail, {BUDGET_PER_100M} false defects per 100 m",
            held_back_stretches as f64 * STRETCH_LINES as f64 * pitch_mm / 1000.0
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

/// Aligns the range and hands every usable view of the stretches that are `wanted` (by number) to `take`, with what that view
/// gathers; all views at once. Answers the metres times views that were taken.
fn each_view<T: Send>(
    drive: &Drive<'_>,
    gathered: &mut [T],
    wanted: impl Fn(usize) -> bool,
    take: impl Fn(AlignedView<'_>, &mut T) + Sync,
) -> Result<f64, PipelineError> {
    let pitch_mm = drive.acquisition.line_pitch_mm;
    let rope = &drive.acquisition.rope;
    let mut taken_view_m = 0.0;
    let mut number = 0;
    drive.run(&mut drive.reader()?, |stretch, cameras| {
        let wanted = wanted(number);
        number += 1;
        if let (true, Ok(estimates)) = (wanted, &stretch.estimates) {
            let usable = stretch.views.iter().filter(|v| v.usable()).count();
            taken_view_m += usable as f64 * stretch.lines as f64 * pitch_mm / 1000.0;
            gathered.par_iter_mut().enumerate().for_each(|(v, gathered)| {
                let view = &stretch.views[v];
                if view.usable() {
                    let block_lines = block_lines(pitch_mm);
                    take(AlignedView { rope, camera: &cameras[v], estimates, view, block_lines, pitch_mm }, gathered);
                }
            });
        }
        Ok(())
    })?;
    Ok(taken_view_m)
}
