//! Thresholds of a model: the trained one, and those that people set since.

use super::auth::Caller;
use super::extract::{Json, Path};
use super::models;
use super::problem::{ReadProblems, WriteProblems};
use super::ropeways::{MAX_NAME, check_text};
use super::verdicts::MAX_COMMENT;
use super::{Problem, times};
use crate::app::App;
use crate::pipeline::TrainReport;
use crate::store::Id;
use crate::store::model_thresholds::{ModelThreshold, Moved};
use axum::Extension;
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

/// Line scores are weighed sums of decades of rarity; none is beyond this.
pub const MAX_LINE_SCORE: f64 = 1000.0;

/// A threshold of a model.
#[derive(Debug, Serialize, ToSchema)]
pub struct ThresholdVersion {
    /// 0: found by the training. 1, 2, ..: set since then.
    version: u32,
    /// Lines with a score above it are alarms.
    line_score: f64,
    /// Lines with a score above it, but not above `line_score`, are worth looking at again; null in models without a second level.
    #[schema(required)]
    look_again_line_score: Option<f64>,
    /// How it was found, or who set it and why.
    origin: String,
    /// When.
    #[schema(format = DateTime)]
    set_at: String,
}

/// All thresholds of a model.
#[derive(Debug, Serialize, ToSchema)]
pub struct ThresholdList {
    /// Newest first: the first one holds for jobs that do not bring their own.
    items: Vec<ThresholdVersion>,
    /// Always null: there is one page.
    #[schema(required)]
    next_cursor: Option<String>,
}

/// A threshold to be set.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewThreshold {
    /// Lines with a score above it are alarms.
    #[schema(minimum = 0, maximum = 1000)]
    line_score: f64,
    /// Lines with a score above it, but not above `line_score`, are worth looking at again; else it lies as far under it as the
    /// trained one.
    #[schema(minimum = 0, maximum = 1000)]
    look_again_line_score: Option<f64>,
    /// Who sets it; else the name of the token.
    #[schema(min_length = 1, max_length = 200)]
    by: Option<String>,
    /// Why.
    #[schema(min_length = 1, max_length = 4000)]
    reason: String,
}

impl ThresholdVersion {
    /// A threshold as inspections with the model judge by it.
    fn new(row: ModelThreshold, report: &TrainReport) -> Self {
        let decides = report.decides_by(Some(&row.decides()));
        Self {
            version: row.version,
            line_score: decides.line_score,
            look_again_line_score: decides.look_again_line_score,
            origin: decides.origin,
            set_at: times::rfc3339(row.created_at_ms),
        }
    }
}

/// Refuses line scores that no line can have.
pub fn check_line_score(line_score: f64) -> Result<f64, Problem> {
    if (0.0..=MAX_LINE_SCORE).contains(&line_score) {
        Ok(line_score)
    } else {
        Err(Problem::outside("line_score", line_score, 0.0, MAX_LINE_SCORE))
    }
}

/// Thresholds of a model, newest first; the first one holds for jobs that do not bring their own
#[utoipa::path(get, path = "/models/{id}/thresholds", tag = "models", params(("id" = Uuid, Path, description = "The model")),
    responses((status = 200, description = "Its thresholds", body = ThresholdList), ReadProblems))]
pub async fn list_thresholds(
    State(app): State<App>,
    Path(id): Path<Uuid>,
) -> Result<axum::Json<ThresholdList>, Problem> {
    let model = models::load(&app, id).await?;
    let report = model.report()?;
    let decides = report.decides_by(None);
    let trained = ThresholdVersion {
        version: 0,
        line_score: decides.line_score,
        look_again_line_score: decides.look_again_line_score,
        origin: decides.origin,
        set_at: times::rfc3339(model.created_at_ms),
    };
    let set = app.store.model_thresholds(Id(id)).await?;
    let items = set.into_iter().map(|row| ThresholdVersion::new(row, &report)).chain([trained]).collect();
    Ok(axum::Json(ThresholdList { items, next_cursor: None }))
}

/// Set the next threshold of a model, for inspections that are queued from now on. Versions have no gaps: who sets one without
/// having seen the last one is refused
#[utoipa::path(put, path = "/models/{id}/thresholds/{version}", tag = "models", params(
    ("id" = Uuid, Path, description = "The model"), ("version" = u32, Path, description = "Last version + 1", minimum = 1)),
    request_body = NewThreshold, responses(
    (status = 201, description = "It holds", body = ThresholdVersion),
    (status = 200, description = "The same call set it before", body = ThresholdVersion),
    WriteProblems))]
pub async fn put_threshold(
    State(app): State<App>,
    Path((id, version)): Path<(Uuid, u32)>,
    Extension(caller): Extension<Caller>,
    Json(body): Json<NewThreshold>,
) -> Result<Response, Problem> {
    let set_by = body.by.unwrap_or(caller.name);
    check_text("by", &set_by, 1, MAX_NAME)?;
    check_text("reason", &body.reason, 1, MAX_COMMENT)?;
    let line_score = check_line_score(body.line_score)?;
    if let Some(look_again) = body.look_again_line_score
        && !(0.0..=line_score).contains(&look_again)
    {
        return Err(Problem::outside("look_again_line_score", look_again, 0.0, line_score));
    }
    let report = models::load(&app, id).await?.report()?;
    let new = ModelThreshold {
        model_id: Id(id),
        version,
        line_score,
        look_again_line_score: body.look_again_line_score,
        set_by,
        reason: body.reason,
        created_at_ms: app.now_ms(),
    };
    let (status, row) = match app.store.move_threshold(&new).await? {
        Moved::New(row) => (StatusCode::CREATED, row),
        Moved::Same(row) => (StatusCode::OK, row),
        Moved::OutOfTurn { next } => {
            return Err(Problem::threshold_moved(format!(
                "version {version} is taken or leaves a gap, the next one is {next}: look at the thresholds that hold, then set that"
            ))
            .limit(version, next));
        }
        Moved::NoModel => return Err(Problem::no("model", id)),
    };
    Ok((status, axum::Json(ThresholdVersion::new(row, &report))).into_response())
}
