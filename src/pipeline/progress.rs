//! What a long run says of itself, and how it is told to stop.

/// State of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProgressReport {
    /// What is being done: `align`, `learn`, `inspect`, `write`.
    pub stage: &'static str,
    /// Metres of rope done in this stage.
    pub done_m: f64,
    /// Metres of rope in this stage.
    pub total_m: f64,
}

/// Receives reports, and is asked once per frame whether to go on.
pub trait Progress: Send + Sync {
    /// Takes a report. Called from worker threads, at most a few times per frame.
    fn report(&self, report: ProgressReport);
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
