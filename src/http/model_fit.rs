//! Whether the model of an inspection still fits its rope, as the API tells it.

use crate::pipeline::fit;
use serde::Serialize;
use utoipa::ToSchema;

/// Line scores of one view where the rope is intact.
#[derive(Debug, Serialize, ToSchema)]
pub struct IntactScores {
    /// Half of the lines score less.
    median: f64,
    /// 9 of 10 do.
    nine_of_10: f64,
    /// 99 of 100 do.
    of_100_99: f64,
}

/// One view of an inspection beside the training.
#[derive(Debug, Serialize, ToSchema)]
pub struct ViewFit {
    /// The view.
    view: usize,
    /// Scores of held-back rope.
    trained: IntactScores,
    /// Scores of this inspection, alarms left out.
    here: IntactScores,
}

/// Whether a model fits the rope of an inspection.
#[derive(Debug, Serialize, ToSchema)]
pub struct ModelFit {
    /// False: retrain. True also where it cannot be told.
    fits: bool,
    /// True: nothing speaks against the model, but this rope is too short to tell, or promises more false defects than a fitting model may
    /// have where chance may be the reason.
    cannot_tell: bool,
    /// Why not, as a sentence with figures; null while it fits.
    #[schema(required)]
    warning: Option<String>,
    /// False defects per 100 m that the trained threshold was made for.
    budget_per_100m: f64,
    /// How many this rope gives at that threshold, by the tail of its own scores; null if it is too short to tell.
    #[schema(required)]
    false_defects_per_100m: Option<f64>,
    /// The least that these may be in truth: 95 % lie between this and the next.
    #[schema(required)]
    at_least_per_100m: Option<f64>,
    /// The most that these may be in truth.
    #[schema(required)]
    at_most_per_100m: Option<f64>,
    /// Metres of rope without alarms that this rests on.
    metres: f64,
    /// The views that were seen.
    views: Vec<ViewFit>,
}

impl From<fit::IntactScores> for IntactScores {
    fn from(s: fit::IntactScores) -> Self {
        Self { median: s.median, nine_of_10: s.nine_of_10, of_100_99: s.of_100_99 }
    }
}

impl From<fit::ModelFit> for ModelFit {
    fn from(f: fit::ModelFit) -> Self {
        let view = |v: fit::ViewFit| ViewFit { view: v.view, trained: v.trained.into(), here: v.here.into() };
        Self {
            fits: f.fits,
            cannot_tell: f.cannot_tell(),
            warning: f.warning(),
            budget_per_100m: f.budget_per_100m,
            false_defects_per_100m: f.false_defects_per_100m,
            at_least_per_100m: f.at_least_per_100m,
            at_most_per_100m: f.at_most_per_100m,
            metres: f.metres,
            views: f.views.into_iter().map(view).collect(),
        }
    }
}
