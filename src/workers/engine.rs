//! What workers run. A trait, because tests of leases and cancellation must not wait for real vision.

use crate::pipeline::results::Summary;
use crate::pipeline::{
    self, Acquisition, FrameSource, InspectOptions, PipelineError, Progress, TrainOptions, TrainReport, TrainingRange,
};
use std::path::Path;

/// Trains and inspects.
pub trait Engine: Send + Sync {
    /// See [`pipeline::train()`].
    fn train(
        &self,
        ranges: &[TrainingRange<'_>],
        options: TrainOptions,
        model_path: &Path,
        progress: &dyn Progress,
    ) -> Result<TrainReport, PipelineError>;

    /// See [`pipeline::inspect()`].
    fn inspect(
        &self,
        acquisition: &Acquisition,
        source: &dyn FrameSource,
        options: &InspectOptions,
        results_folder: &Path,
        progress: &dyn Progress,
    ) -> Result<Summary, PipelineError>;
}

/// The real thing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Pipeline;

impl Engine for Pipeline {
    fn train(
        &self,
        ranges: &[TrainingRange<'_>],
        options: TrainOptions,
        model_path: &Path,
        progress: &dyn Progress,
    ) -> Result<TrainReport, PipelineError> {
        pipeline::train(ranges, options, model_path, progress)
    }

    fn inspect(
        &self,
        acquisition: &Acquisition,
        source: &dyn FrameSource,
        options: &InspectOptions,
        results_folder: &Path,
        progress: &dyn Progress,
    ) -> Result<Summary, PipelineError> {
        pipeline::inspect(acquisition, source, options, results_folder, progress)
    }
}
