//! Drives `vision` over an acquisition, wherever its frames come from.

pub mod acquisition;
pub mod bandwidths;
mod behind;
mod blind_columns;
pub mod budget;
pub mod closeup;
pub mod construction;
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
    #[error(
        "the model was trained on rope with {} of {}, but this acquisition shows {}: use a model of this rope, or train one",
        .difference.quantity,
        .difference.first,
        .difference.other
    )]
    ModelOfAnotherRope {
        /// In what; the first is what the model knows.
        difference: construction::Difference,
    },
    /// The model was learnt through another camera head than that of this acquisition.
    #[error(
        "the model was trained on recordings with {} of {}, but this acquisition has {}: use a model that was trained on recordings like this one, or train one",
        .difference.quantity,
        .difference.first,
        .difference.other
    )]
    ModelOfAnotherHead {
        /// In what; the first is what the model knows.
        difference: construction::Difference,
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
        /// Metres that were aligned in the view that has most.
        aligned_m: f64,
        /// Metres that are needed.
        needed_m: f64,
    },
    /// There is enough rope, but not in every view.
    #[error(
        "{} of aligned rope, but training needs at least {needed_m} m of every view (the best gave {best_m:.2} m): mend the camera, or leave that view out of this recording and of those that the model shall inspect",
        of_views(.views)
    )]
    ViewsGaveTooLittle {
        /// These views, each with the metres that it gave.
        views: Vec<(usize, f64)>,
        /// Metres that the best view gave.
        best_m: f64,
        /// Metres that are needed of each.
        needed_m: f64,
    },
    /// The views learnt enough, but what is kept to judge by does not suffice.
    #[error(
        "{aligned_m:.2} m of rope were learnt from (mean of the views), but of the stretches that all views show {stretches} were kept to calibrate scores, and these {lacks}: widen --from-m/--to-m; an inspection without a model lists what each view does not cover"
    )]
    NotCalibrated {
        /// Metres that were learnt from, mean of the views.
        aligned_m: f64,
        /// Stretches, of some 0.2 m each, that every view has.
        stretches: usize,
        /// What is wrong with them.
        lacks: &'static str,
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
        difference: construction::Difference,
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

/// What views gave, in words.
fn of_views(views: &[(usize, f64)]) -> String {
    let gave: Vec<String> = views.iter().map(|(view, metres)| format!("view {view} gave only {metres:.2} m")).collect();
    gave.join(", ")
}

impl From<SourceError> for PipelineError {
    fn from(error: SourceError) -> Self {
        match error {
            SourceError::Stopped => Self::Cancelled,
            error => Self::Source(error),
        }
    }
}
