//! Aligns, measures and, with a model, finds defects; writes the results folder.

use super::results::{LineScoreFormat, NotCovered, Summary};
use super::stretches::{STRETCH_LINES, StretchReader};
use super::tables::{LayLengthTable, LineValues, lay_length_rows, write_error};
use super::{Acquisition, FrameSource, PipelineError, Progress, ProgressReport};
use crate::vision::aligner::{AlignedStretch, Aligner, AlignerSpec};
use std::path::{Path, PathBuf};

/// How to inspect.
#[derive(Debug, Clone, Default)]
pub struct InspectOptions {
    /// Model file; without one, only alignment is done.
    pub model_path: Option<PathBuf>,
    /// Write likelihood maps as `maps/view{v}/frame_{n:06}.png`.
    pub maps: bool,
    /// Line score above which a line is an alarm; `None`: the model's own.
    pub threshold: Option<f64>,
    /// How to store line scores.
    pub line_scores: LineScoreFormat,
    /// Contours measured elsewhere, `contours[view]`: (lower, upper) per line in px; used instead of extraction.
    pub given_contours: Option<Vec<Vec<(f32, f32)>>>,
}

/// The aligner's specification for an acquisition.
pub(super) fn aligner_spec(acquisition: &Acquisition) -> AlignerSpec {
    AlignerSpec::new(
        acquisition.rope.clone(),
        acquisition.line_pitch_mm,
        acquisition.view_angles_rad.clone(),
        acquisition.sensor_px as usize,
        acquisition.rope_width_px,
    )
}

/// Inspects `source` and writes `lay_lengths.csv`, `displacement.csv`, line scores, `defects.json`, `summary.json` and, on
/// request, `maps/` into `results_folder` (made if absent; `summary.json` is written last, so a folder without it is not whole).
pub fn inspect(
    acquisition: &Acquisition,
    source: &dyn FrameSource,
    options: &InspectOptions,
    results_folder: &Path,
    progress: &dyn Progress,
) -> Result<Summary, PipelineError> {
    let started = std::time::Instant::now();
    std::fs::create_dir_all(results_folder).map_err(write_error(results_folder))?;
    let spec = aligner_spec(acquisition);
    let given = options.given_contours.as_deref();
    let mut reader =
        StretchReader::new(source, spec.width_px, spec.stretch_lines(STRETCH_LINES), 0..usize::MAX, given)?;
    let views = acquisition.view_angles_rad.len();
    let mut lay_lengths = LayLengthTable::create(results_folder.join("lay_lengths.csv"), acquisition.rope.strands())?;
    let mut displacement = LineValues::create(results_folder, views)?;
    let total_m = reader.lines() as f64 * acquisition.line_pitch_mm / 1000.0;
    let mut aligner = Aligner::new(spec);
    let mut not_covered: Vec<NotCovered> = Vec::new();
    let mut covered_view_m = 0.0;
    let mut take = |stretch: AlignedStretch| -> Result<(), PipelineError> {
        for row in lay_length_rows(acquisition, &stretch) {
            lay_lengths.write(&row)?;
        }
        for (v, view) in stretch.views.iter().enumerate() {
            let aligned = stretch.estimates.is_ok() && view.usable();
            let axis = |k: usize| if aligned { view.axis_px[k] } else { f32::NAN };
            displacement.append(v, (0..stretch.lines).map(axis))?;
            let (from_m, to_m) = (
                acquisition.position_m(stretch.first_line),
                acquisition.position_m(stretch.first_line + stretch.lines),
            );
            if aligned {
                covered_view_m += to_m - from_m;
            } else {
                let reason = match &stretch.estimates {
                    Err(reason) => reason.to_string(),
                    Ok(_) if view.image.lines() == 0 => "this view has no lines here".into(),
                    Ok(_) => "this view does not show both edges of the rope here".into(),
                };
                not_covered.push(NotCovered { view: v, from_m, to_m, reason });
            }
        }
        progress.report(ProgressReport {
            stage: "inspect",
            done_m: (stretch.first_line + stretch.lines) as f64 * acquisition.line_pitch_mm / 1000.0,
            total_m,
        });
        Ok(())
    };
    while let Some(stretch) = reader.next()? {
        if progress.cancelled() {
            return Err(PipelineError::Cancelled);
        }
        for aligned in aligner.push(stretch) {
            take(aligned)?;
        }
    }
    for aligned in aligner.finish() {
        take(aligned)?;
    }
    lay_lengths.finish()?;
    displacement.write_csv("displacement.csv", "view,line,displacement_px", true, 3)?;
    let seconds = started.elapsed().as_secs_f64();
    let summary = Summary {
        ropescope_version: env!("CARGO_PKG_VERSION").into(),
        model: None,
        construction: acquisition.construction(),
        lines: reader.lines(),
        metres: total_m,
        covered_view_m,
        not_covered,
        threshold: None,
        defects: None,
        seconds,
        metres_per_second: total_m / seconds.max(1e-9),
        notes: Vec::new(),
    };
    let path = results_folder.join("summary.json");
    let text = serde_json::to_string_pretty(&summary).map_err(|e| write_error(&path)(e.into()))?;
    std::fs::write(&path, text).map_err(write_error(&path))?;
    Ok(summary)
}
