//! Why a job failed, as a problem that a client can read, and whether another attempt makes sense.

use crate::pipeline::{PipelineError, SourceError};
use crate::store::StoreError;
use serde_json::json;
use std::path::Path;

/// A failed attempt.
#[derive(Debug, Clone, PartialEq)]
pub struct Failure {
    /// JSON problem: `type`, `title`, `detail`.
    pub problem: String,
    /// True when the cause may go away by itself.
    pub retry: bool,
}

impl Failure {
    /// A failure of this kind.
    pub fn new(slug: &str, title: &str, detail: impl std::fmt::Display, retry: bool) -> Self {
        let problem = json!({ "type": format!("/problems/{slug}"), "title": title, "detail": detail.to_string() });
        Self { problem: problem.to_string(), retry }
    }

    /// What the pipeline said. Paths are shown relative to the data folder.
    pub fn of_pipeline(error: &PipelineError, data: &Path) -> Self {
        let text = error.to_string().replace(&format!("{}/", data.display()), "");
        match error {
            PipelineError::Source(SourceError::Abandoned { .. }) => {
                Self::new("acquisition-abandoned", "The acquisition was not completed", text, false)
            }
            PipelineError::Source(_) => Self::new("frame-unreadable", "A stored frame cannot be read", text, false),
            PipelineError::Acquisition(_) => {
                Self::new("acquisition-unusable", "The acquisition cannot be used", text, false)
            }
            PipelineError::ModelOfAnotherRope { .. } => {
                Self::new("model-of-another-rope", "The model was trained on another rope", text, false)
            }
            PipelineError::ModelOfAnotherHead { .. } => Self::new(
                "model-of-another-head",
                "The model was trained on recordings of another camera head",
                text,
                false,
            ),
            PipelineError::Model { .. } => Self::new("model-unusable", "The model cannot be used", text, false),
            PipelineError::TooLittleRope { .. } => {
                Self::new("too-little-rope", "There is too little aligned rope to learn from", text, false)
            }
            PipelineError::ViewsGaveTooLittle { .. } => {
                Self::new("view-without-rope", "A view shows too little of the rope to learn from", text, false)
            }
            PipelineError::NotCalibrated { .. } => {
                Self::new("not-calibrated", "Scores could not be calibrated", text, false)
            }
            PipelineError::NothingInRange { .. } => {
                Self::new("out-of-range", "The range is not in the acquisition", text, false)
            }
            PipelineError::AcquisitionsDiffer { .. } => {
                Self::new("acquisitions-differ", "The acquisitions cannot teach one model", text, false)
            }
            PipelineError::RangesOverlap { .. } => {
                Self::new("ranges-overlap", "The same rope would teach twice", text, false)
            }
            PipelineError::Budget(_) => Self::new("out-of-range", "The budget makes no sense", text, false),
            PipelineError::Write { .. } => {
                Self::new("results-not-written", "The results could not be written", text, true)
            }
            PipelineError::Cancelled => {
                Self::new("stopped", "The job stopped", "it stopped without being asked to", false)
            }
        }
    }

    /// A results folder that does not hold what it should.
    pub fn of_results(detail: impl std::fmt::Display) -> Self {
        Self::new("results-unreadable", "The results cannot be read", detail, false)
    }

    /// Something here failed; the cause is logged, not told.
    pub fn of_store(error: &StoreError) -> Self {
        tracing::error!(%error, "a job failed");
        Self::new("internal", "The service failed", "the cause is in the log of the service", true)
    }
}
