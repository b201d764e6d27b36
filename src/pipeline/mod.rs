//! Drives `vision` over an acquisition, wherever its frames come from.

pub mod acquisition;
pub mod bandwidths;
mod behind;
pub mod budget;
pub mod closeup;
mod coverage;
mod detection;
pub mod diameters;
mod drive;
pub mod fit;
mod folds;
pub mod found;
mod held_back;
pub mod inspect;
pub mod lay_length_table;
pub mod learning_curve;
mod learning_view;
mod likelihood_map;
mod maps;
pub mod model_file;
mod passes;
pub mod preview;
pub mod profile;
pub mod progress;
pub mod quality;
mod reinspection;
pub mod rejudge;
pub mod results;
pub mod side_by_side;
mod signs;
pub mod source;
pub mod stretches;
pub mod surface_alarms;
pub mod tables;
pub mod taught;
mod third_answer;
pub mod train;
pub mod training_range;
pub mod windows;

pub use acquisition::{Acquisition, AcquisitionError, RopeFile};
pub use bandwidths::BandwidthsBy;
pub use budget::Budget;
pub use found::Found;
pub use inspect::{InspectOptions, inspect};
pub use progress::{Progress, ProgressReport};
pub use source::{FrameFiles, FrameSource, SourceError};
pub use train::{TrainOptions, TrainReport, train};
pub use training_range::TrainingRange;

use std::path::PathBuf;

/// Why a run of the pipeline ended without a result.
#[derive(Debug, thiserror::Error)]
pub enum PipelineError {
    /// A frame could not be had.
    #[error(transparent)]
    Source(SourceError),
    /// The acquisition itself is not usable.
    #[error(transparent)]
    Acquisition(#[from] AcquisitionError),
    /// The model was learnt from another construction than the rope of this acquisition.
    #[error("the model was trained on {model}, but this acquisition shows {acquisition}: use a model of this rope")]
    ModelOfAnotherRope {
        /// The construction that the model knows, such as `6x9, 32 mm, 4 views`.
        model: String,
        /// The construction of the acquisition.
        acquisition: String,
    },
    /// A file is not a model, or a damaged one.
    #[error("{path} is not a usable appearance model: {reason}")]
    Model {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// There is too little aligned rope to learn from.
    #[error(
        "only {aligned_m:.2} m of the range could be aligned, but training needs at least {needed_m} m: widen --from-m/--to-m"
    )]
    TooLittleRope {
        /// Metres that were aligned.
        aligned_m: f64,
        /// Metres that are needed.
        needed_m: f64,
    },
    /// A range that shows no rope.
    #[error(
        "there is nothing to learn from in the range of {acquisition}, which shows rope metres {start_m:.2} to {end_m:.2}: choose a range in them"
    )]
    NothingInRange {
        /// The acquisition, by its folder or its id.
        acquisition: String,
        /// Rope metre at which it begins.
        start_m: f64,
        /// And ends.
        end_m: f64,
    },
    /// Acquisitions of different ropes, or of different camera heads.
    #[error(
        "{acquisition} has {difference}: one model is learnt from one rope, seen by one camera head, so leave it out or train it alone"
    )]
    AcquisitionsDiffer {
        /// The one that differs from the first, by its folder or its id.
        acquisition: String,
        /// In what.
        difference: training_range::Difference,
    },
    /// The same rope would teach twice.
    #[error(
        "{acquisition} is named twice, with ranges that overlap: rope that teaches twice would be judged by itself, so give ranges apart"
    )]
    RangesOverlap {
        /// The acquisition, by its folder or its id.
        acquisition: String,
    },
    /// What false alarms may cost was asked for in a number that makes no sense.
    #[error("{0}")]
    Budget(String),
    /// The results could not be written.
    #[error("cannot write {path}: {source}")]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
    /// The caller asked to stop.
    #[error("cancelled")]
    Cancelled,
}

impl From<SourceError> for PipelineError {
    fn from(error: SourceError) -> Self {
        match error {
            SourceError::Stopped => Self::Cancelled,
            error => Self::Source(error),
        }
    }
}
