//! Learns an appearance model from intact rope.

use super::{Acquisition, FrameSource, PipelineError, Progress};
use serde::{Deserialize, Serialize};
use std::path::Path;

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

/// Trains on `source` and writes the model to `model_path`, whole or not at all.
pub fn train(
    _acquisition: &Acquisition,
    _source: &dyn FrameSource,
    _options: TrainOptions,
    _model_path: &Path,
    _progress: &dyn Progress,
) -> Result<TrainReport, PipelineError> {
    Err(PipelineError::Cancelled)
}

/// Reads what a model file says of its training, without loading the model.
pub fn read_report(_model_path: &Path) -> Result<TrainReport, PipelineError> {
    Err(PipelineError::Cancelled)
}
