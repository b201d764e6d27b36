//! What an acquisition lacks, and its completion.

use super::Problem;
use super::acquisition_body::Acquisition;
use super::acquisitions::{check_frames, load};
use super::extract::{Json, Path};
use super::problem::{ReadProblems, WriteProblems};
use crate::app::App;
use crate::pipeline::acquisition::MAX_VIEWS;
use crate::store::Id;
use crate::store::completion::Completion;
use crate::store::missing::MissingFrames;
use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

/// What is missing in a view.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct MissingView {
    /// The view.
    view: u32,
    /// Frames that the view shall have; null if nobody said how many.
    #[schema(required)]
    expected: Option<u32>,
    /// Frames that are there.
    present: u32,
    /// First and last number of each gap, at most 1000 gaps.
    missing: Vec<[u32; 2]>,
    /// Rope metres of each gap; null where the manifest does not tell them.
    missing_m: Vec<Option<[f64; 2]>>,
    /// Frames whose files were found gone or changed since, at most 1000: send them again.
    damaged: Vec<u32>,
}

/// What is missing in an acquisition.
#[derive(Debug, Serialize, ToSchema)]
pub struct Missing {
    /// True when nothing is.
    complete: bool,
    /// One entry a view.
    views: Vec<MissingView>,
}

/// How many frames a view has.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CompletedView {
    /// Number of frames.
    #[schema(minimum = 1, maximum = 1000000)]
    frames: u32,
}

/// Says that all frames were sent.
#[derive(Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewCompletion {
    /// How many frames each view has, where that was not announced.
    #[schema(min_items = 1, max_items = 8)]
    views: Option<Vec<CompletedView>>,
}

impl From<MissingFrames> for MissingView {
    fn from(m: MissingFrames) -> Self {
        Self {
            view: m.view,
            expected: m.expected,
            present: m.present,
            missing: m.ranges.into_iter().map(|(first, last)| [first, last]).collect(),
            missing_m: m.ranges_m.into_iter().map(|range| range.map(|(from_m, to_m)| [from_m, to_m])).collect(),
            damaged: m.damaged,
        }
    }
}

/// Which frames are missing
#[utoipa::path(get, path = "/acquisitions/{id}/missing", tag = "acquisitions",
    params(("id" = Uuid, Path, description = "The acquisition")),
    responses((status = 200, description = "What is missing in each view", body = Missing), ReadProblems))]
pub async fn get_missing(State(app): State<App>, Path(id): Path<Uuid>) -> Result<axum::Json<Missing>, Problem> {
    let missing = app.store.missing(Id(id)).await?.ok_or_else(|| Problem::no("acquisition", id))?;
    let complete = missing.iter().all(MissingFrames::whole);
    Ok(axum::Json(Missing { complete, views: missing.into_iter().map(MissingView::from).collect() }))
}

/// The problem of an acquisition that is not complete.
pub fn incomplete(id: Uuid, missing: Vec<MissingFrames>) -> Problem {
    let views: Vec<MissingView> = missing.into_iter().map(MissingView::from).collect();
    let present: u64 = views.iter().map(|v| u64::from(v.present)).sum();
    let expected: Option<u64> = views.iter().map(|v| v.expected.map(u64::from)).sum();
    let detail = match expected {
        Some(expected) => format!("{present} of {expected} frames of acquisition {id} are there; nothing was changed"),
        None => format!("nobody has said how many frames acquisition {id} has; nothing was changed"),
    };
    Problem::acquisition_incomplete(detail).limit(present, expected).with("missing", views)
}

/// Say that all frames were sent; from then on jobs can run and no frame is taken
#[utoipa::path(post, path = "/acquisitions/{id}/completion", tag = "acquisitions",
    params(("id" = Uuid, Path, description = "The acquisition")), request_body = NewCompletion,
    responses((status = 200, description = "It is complete, now or since before", body = Acquisition), WriteProblems))]
pub async fn complete_acquisition(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    Json(body): Json<NewCompletion>,
) -> Result<axum::Json<Acquisition>, Problem> {
    let frames: Option<Vec<u32>> = body.views.map(|views| views.iter().map(|v| v.frames).collect());
    if let Some(frames) = &frames {
        frames.iter().try_for_each(|&f| check_frames(Some(f)))?;
    }
    match app.store.complete_acquisition(Id(id), frames.as_deref(), app.now_ms()).await? {
        Completion::Complete => {
            app.jobs_wake.notify_one(); // a live job that has not begun is one like others now
            Ok(axum::Json(load(&app, id).await?.into()))
        }
        Completion::Unknown => Err(Problem::no("acquisition", id)),
        Completion::Missing(missing) => Err(incomplete(id, missing)),
        Completion::Views { views } => {
            let value = frames.map_or(0, |f| f.len());
            Err(Problem::out_of_range(format!(
                "the body names {value} views, but the acquisition has {views} (of at most {MAX_VIEWS})"
            ))
            .limit(value, views))
        }
        Completion::Contradiction { view, frames, known } => Err(Problem::frames_contradict(format!(
            "view {view} shall have {frames} frames, but {known} were announced or are there; nothing was changed"
        ))
        .limit(frames, known)
        .with("view", view)),
    }
}
