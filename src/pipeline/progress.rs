//! What a long run says of itself, and how it is told to stop.

use super::Found;

/// State of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProgressReport {
    /// What is being done: `align`, `learn`, `inspect`, `write`.
    pub stage: &'static str,
    /// Metres of rope done in this stage.
    pub done_m: f64,
    /// Metres of rope in this stage; of frames that still arrive, those that are there.
    pub total_m: f64,
}

/// Receives reports, and is asked once per frame whether to go on.
pub trait Progress: Send + Sync {
    /// Takes a report. Called from worker threads, at most a few times per frame.
    fn report(&self, report: ProgressReport);
    /// Takes what an inspection has just found, stretch after stretch.
    fn found(&self, _found: Found) {}
    /// True when the run shall end with [`super::PipelineError::Cancelled`].
    fn cancelled(&self) -> bool {
        false
    }
}

/// Says nothing and never stops.
#[derive(Debug, Clone, Copy, Default)]
pub struct Quiet;

impl Progress for Quiet {
    fn report(&self, _report: ProgressReport) {}
}
