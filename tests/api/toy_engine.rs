//! Stands in for vision: an engine that does as it is told.

use ropescope::pipeline::bandwidths::BandwidthsFit;
use ropescope::pipeline::budget::{self, BudgetFit};
use ropescope::pipeline::fit::ModelFit;
use ropescope::pipeline::found::{Found, FoundDefects};
use ropescope::pipeline::lay_length_table::LayLengthTable;
use ropescope::pipeline::learning_curve::LearningPoint;
use ropescope::pipeline::results::{
    AlarmRow, DefectRow, Kind, LayLengthRow, Level, NotCovered, Suggestion, Summary, Threshold, WireEstimate,
};
use ropescope::pipeline::training_range::LearntFrom;
use ropescope::pipeline::{
    Acquisition, BandwidthsBy, Budget, FrameSource, InspectOptions, PipelineError, Progress, ProgressReport,
    TrainOptions, TrainReport, TrainingRange,
};
use ropescope::workers::Engine;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crate::app::{LINES, SENSOR_PX};

/// Threshold of the models of tests.
pub const TRAINED_THRESHOLD: f64 = 6.0;

/// Score from which on places are worth looking at again there.
pub const TRAINED_LOOK_AGAIN: f64 = 4.8;

/// What the toy's training on a budget knows of false alarms: 40 peaks on 1.6 m, over 4 as often as an exponential law has it.
pub fn toy_budget(budget: Budget) -> BudgetFit {
    let level = |line_score: f64, per_100m: f64| budget::Level {
        line_score,
        false_defects_per_100m: per_100m,
        at_least_per_100m: per_100m / 3.0,
        at_most_per_100m: per_100m * 3.0,
        reinspect_m_per_100m: per_100m * 0.06,
    };
    let per_100m = budget.false_defects().unwrap();
    BudgetFit {
        budget,
        alarm: level(TRAINED_THRESHOLD, per_100m),
        look_again: level(TRAINED_LOOK_AGAIN, 5.0 * per_100m),
        held_back_m: 1.6,
        peaks: 40,
        left_out: 0,
        tail_from: 4.0,
        tail_peaks: (0..40).rev().map(|k| 4.0 - 0.6 * ((k as f32 + 0.5) / 40.0).ln()).collect(),
        closer_look: false,
    }
}

fn toy_bandwidths(by: BandwidthsBy) -> BandwidthsFit {
    let gained_nats_per_pixel = if by == BandwidthsBy::HeldOut { 0.05 } else { 0.0 };
    BandwidthsFit { by, sigma_bins: [0.6, 1.0, 0.8, 0.5], gray_bins: 32, gained_nats_per_pixel }
}

/// The toy's models never fit.
fn toy_fit() -> ModelFit {
    ModelFit {
        fits: false,
        budget_per_100m: 2.0,
        false_defects_per_100m: Some(31.4),
        at_least_per_100m: Some(20.0),
        at_most_per_100m: Some(48.0),
        metres: 0.02,
        alarmed_share: 0.0,
        views: vec![],
    }
}

/// Stands in for vision: writes a small results folder, or waits to be stopped.
#[derive(Default)]
pub struct ToyEngine {
    /// While true, jobs run until they are told to stop.
    pub hold: AtomicBool,
    /// While true, models are as earlier versions trained them, without the tail of intact rope.
    pub earlier: AtomicBool,
}

impl ToyEngine {
    fn work(&self, progress: &dyn Progress) -> Result<(), PipelineError> {
        progress.report(ProgressReport { stage: "align", done_m: 0.01, total_m: 0.02 });
        while self.hold.load(Ordering::SeqCst) {
            if progress.cancelled() {
                return Err(PipelineError::Cancelled);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        progress.report(ProgressReport { stage: "write", done_m: 0.02, total_m: 0.02 });
        Ok(())
    }
}

impl Engine for ToyEngine {
    fn train(
        &self,
        ranges: &[TrainingRange<'_>],
        options: TrainOptions,
        model_path: &Path,
        progress: &dyn Progress,
    ) -> Result<TrainReport, PipelineError> {
        for range in ranges {
            range.source.load(0, 0)?;
        }
        self.work(progress)?;
        let learnt_from = |range: &TrainingRange<'_>| LearntFrom {
            acquisition: range.name.to_owned(),
            from_m: range.from_m.unwrap_or(0.0),
            to_m: range.to_m.unwrap_or(1.0),
            learnt_view_m: 1.0,
        };
        let first = learnt_from(&ranges[0]);
        let mut budget = toy_budget(options.budget);
        if self.earlier.load(Ordering::SeqCst) {
            budget.tail_peaks.clear();
        }
        std::fs::write(model_path, b"a model").unwrap();
        Ok(TrainReport {
            construction: ranges[0].acquisition.construction(),
            from_m: first.from_m,
            to_m: first.to_m,
            learnt_from: if ranges.len() > 1 { ranges.iter().map(learnt_from).collect() } else { vec![] },
            learnt_view_m: 1.0,
            threshold: TRAINED_THRESHOLD,
            threshold_origin: "a toy".into(),
            budget: Some(budget),
            intact: vec![],
            bandwidths: Some(toy_bandwidths(options.bandwidths)),
            learning_curve: [0.5, 1.0]
                .map(|metres| LearningPoint { metres, nats_per_pixel: 1.0 - 0.1 / metres })
                .to_vec(),
            seconds: 0.1,
            notes: vec![],
        })
    }

    fn inspect(
        &self,
        acquisition: &Acquisition,
        source: &dyn FrameSource,
        options: &InspectOptions,
        results: &Path,
        progress: &dyn Progress,
    ) -> Result<Summary, PipelineError> {
        self.work(progress)?;
        let mut frames = 0;
        while source.wait_for(0, frames)? {
            progress.found(found(acquisition, frames, options.model_path.is_some()));
            frames += 1;
        }
        std::fs::create_dir_all(results).unwrap();
        let mut table =
            LayLengthTable::create(results.join("lay_lengths.csv"), acquisition.rope.strands()).expect("a new file");
        for view in [None, Some(0)] {
            for frame in 0..source.frames(0) {
                table.write(&lay_length(acquisition, view, frame)).unwrap();
            }
        }
        table.finish().unwrap();
        let mut found = None;
        if options.model_path.is_some() {
            let defects = [defect(acquisition)];
            std::fs::write(results.join("defects.json"), serde_json::to_vec(&defects).unwrap()).unwrap();
            found = Some(defects.len());
            let again = [look_again(acquisition, source.frames(0) * LINES as usize - 1)];
            std::fs::write(results.join("look_again.json"), serde_json::to_vec(&again).unwrap()).unwrap();
            for view in 0..source.views() {
                let folder = results.join(format!("maps/view{view}"));
                std::fs::create_dir_all(&folder).unwrap();
                let mut scores = Vec::new();
                for frame in 0..source.frames(view) {
                    let pixels = source.load(view, frame)?;
                    let mut map = image::GrayImage::from_pixel(SENSOR_PX, pixels.lines as u32, image::Luma([200]));
                    if frame == 0 {
                        map.put_pixel(15, 42, image::Luma([3]));
                    }
                    map.save(folder.join(format!("frame_{frame:06}.png"))).unwrap();
                    for line in 0..pixels.lines {
                        let score = if frame == 0 && line == 42 {
                            9.0
                        } else if frame == 2 && line == LINES as usize - 1 {
                            5.0 // under the threshold
                        } else if frame == 1 {
                            f32::NAN
                        } else {
                            1.0
                        };
                        scores.extend(f32::to_le_bytes(score));
                    }
                }
                std::fs::write(results.join(format!("line_scores_view{view}.f32")), scores).unwrap();
            }
        }
        Ok(Summary {
            ropescope_version: "test".into(),
            model: options.model_path.as_ref().map(|_| "toy".into()),
            construction: acquisition.construction(),
            lines: source.frames(0) * LINES as usize,
            metres: 0.03,
            covered_view_m: 0.01,
            not_covered: vec![NotCovered {
                view: 0,
                from_m: acquisition.position_m(LINES as usize),
                to_m: acquisition.position_m(2 * LINES as usize),
                reason: "too dark".into(),
            }],
            threshold: options.model_path.as_ref().map(|_| {
                options.threshold.clone().unwrap_or_else(|| Threshold {
                    line_score: TRAINED_THRESHOLD,
                    look_again_line_score: Some(TRAINED_LOOK_AGAIN),
                    origin: "a toy".into(),
                })
            }),
            defects: found,
            look_again: found,
            diameter: None,
            fit: options.model_path.as_ref().map(|_| toy_fit()),
            seconds: 0.1,
            metres_per_second: 1.0,
            notes: vec![],
        })
    }
}

/// What the toy engine measures in a frame; one stretch could not be measured.
fn lay_length(acquisition: &Acquisition, view: Option<usize>, frame: usize) -> LayLengthRow {
    let first_line = frame * LINES as usize;
    let half_m = 0.5 * f64::from(LINES) * acquisition.line_pitch_mm / 1000.0;
    let strands = acquisition.rope.strands();
    let row = LayLengthRow {
        view,
        first_line,
        last_line: first_line + LINES as usize - 1,
        position_m: acquisition.position_m(first_line) + half_m,
        wires: vec![WireEstimate::default(); strands],
        reason: Some("too dark".into()),
        ..LayLengthRow::default()
    };
    if frame == 1 {
        return row;
    }
    let wire = WireEstimate {
        lay_mm: Some(-70.5),
        lay_sd_mm: Some(0.2),
        phase_rad: Some(0.1),
        phase_sd_rad: Some(0.004),
        score: Some(0.8),
    };
    LayLengthRow {
        strand_lay_mm: Some(137.0 + frame as f64),
        strand_lay_sd_mm: Some(0.1),
        strand_phase_rad: Some(0.5),
        strand_phase_sd_rad: Some(0.002),
        strand_score: Some(0.9),
        strand_spread_rad: Some(0.01),
        strand_spread_sd_rad: Some(0.001),
        diameter_mm: Some(20.0),
        diameter_sd_mm: Some(0.2),
        ovality_percent: Some(0.8),
        ovality_sd_percent: Some(0.3),
        wires: vec![wire; strands],
        reason: None,
        ..row
    }
}

/// The defect that the toy engine finds in every rope.
fn defect(acquisition: &Acquisition) -> DefectRow {
    let alarm = AlarmRow {
        view: 0,
        strand: Some(2),
        first_line: 40,
        last_line: 44,
        first_column: 10,
        last_column: 20,
        peak_score: 9.0,
    };
    DefectRow {
        id: 0,
        level: Level::Alarm,
        from_m: acquisition.position_m(40),
        to_m: acquisition.position_m(45),
        strand: Some(2),
        wire: None,
        angle_deg: Some(300.0),
        peak_score: 9.0,
        rank: Some(1),
        suggestion: Some(Suggestion {
            kind: Kind::Gap,
            why: "dark over 4 mm".into(),
            length_mm: 4.0,
            width_wires: 1.0,
            area_mm2: 5.5,
            gray_steps: -6.0,
            texture: 1.2,
            beyond_outline_mm: 0.0,
        }),
        alarms: vec![alarm],
    }
}

/// The place that it would look at again: the last line.
fn look_again(acquisition: &Acquisition, line: usize) -> DefectRow {
    let alarm = AlarmRow {
        view: 0,
        strand: Some(2),
        first_line: line,
        last_line: line,
        first_column: 4,
        last_column: 5,
        peak_score: 5.0,
    };
    DefectRow {
        id: 1,
        level: Level::LookAgain,
        from_m: acquisition.position_m(line),
        to_m: acquisition.position_m(line + 1),
        peak_score: 5.0,
        rank: Some(1),
        alarms: vec![alarm],
        ..DefectRow::default()
    }
}

/// What the toy engine finds in a frame.
fn found(acquisition: &Acquisition, frame: usize, with_model: bool) -> Found {
    let first_line = frame * LINES as usize;
    let row = LayLengthRow {
        view: None,
        first_line,
        last_line: first_line + LINES as usize - 1,
        position_m: acquisition.position_m(first_line + LINES as usize / 2),
        strand_lay_mm: Some(137.0 + frame as f64),
        ..LayLengthRow::default()
    };
    let rows = if with_model { vec![defect(acquisition)] } else { vec![] };
    Found { lay_lengths: vec![row], defects: Some(FoundDefects { from: 0, rows }) }
}
