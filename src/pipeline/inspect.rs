//! Aligns, measures and, with a model, finds defects; writes the results folder.

use super::results::{LineScoreFormat, Summary};
use super::{Acquisition, FrameSource, PipelineError, Progress};
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

/// Inspects `source` and writes `lay_lengths.csv`, `displacement.csv`, line scores, `defects.json`, `summary.json` and, on
/// request, `maps/` into `results_folder` (made if absent; `summary.json` is written last, so a folder without it is not whole).
pub fn inspect(
    _acquisition: &Acquisition,
    _source: &dyn FrameSource,
    _options: &InspectOptions,
    _results_folder: &Path,
    _progress: &dyn Progress,
) -> Result<Summary, PipelineError> {
    Err(PipelineError::Cancelled)
}
