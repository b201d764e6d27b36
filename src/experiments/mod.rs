//! The paper's experiments, run whole: simulate, inspect as everybody does, judge, and write a report. [Wacker13, sec. 6]

pub mod alignment; // lay lengths: figures 6 and 7, deformation, lost locks
pub mod detection; // defects: figure 9
mod frames; // simulated frames without a disk in between
mod page; // a report page with its figures and tables
mod trial; // one simulated rope through the pipeline
mod work; // how much of it all is done

pub use page::check_folder;

use crate::evaluate::EvaluateError;
use crate::pipeline::{AcquisitionError, PipelineError};
use crate::simulate::{RecipeError, SimulateError};
use std::path::PathBuf;

/// Why an experiment ended without a report.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// The pipeline failed or was stopped.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// A rope cannot be simulated.
    #[error(transparent)]
    Recipe(#[from] RecipeError),
    /// A simulated rope is no acquisition, or cannot be written.
    #[error(transparent)]
    Acquisition(#[from] AcquisitionError),
    /// A simulated rope cannot be written.
    #[error(transparent)]
    Simulate(#[from] SimulateError),
    /// Results could not be judged.
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
    /// The report could not be written.
    #[error("cannot write {path}: {source}")]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
    /// The report's folder holds something else.
    #[error("--out {folder} holds {entry} but no earlier report: choose another folder")]
    NotAReport {
        /// The folder.
        folder: PathBuf,
        /// What is in it.
        entry: String,
    },
}

/// What a report says of how it was made.
#[derive(Debug, Clone, PartialEq)]
pub struct Provenance {
    /// The command line.
    pub command: String,
    /// The day, as in 2026-11-22.
    pub date: String,
}
