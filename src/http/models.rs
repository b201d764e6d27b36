//! Appearance models: versioned per rope, with what they were trained on.

use super::bandwidths::Bandwidths;
use super::budgets::BudgetFit;
use super::extract::{Path, Query};
use super::frames::{Image, KnownVersion, known, repr_digest};
use super::pages::{PageQuery, page_of};
use super::problem::ReadProblems;
use super::{Problem, times};
use crate::app::App;
use crate::pipeline::{TrainReport, learning_curve, training_range};
use crate::store::{Id, StoreError, models};
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

/// What a model was trained on and what came of it.
#[derive(Debug, Serialize, ToSchema)]
pub struct TrainedOn {
    /// The acquisition; the first, if there were several.
    acquisition_id: Uuid,
    /// What every acquisition gave, in the order in which the job names them.
    acquisitions: Vec<LearntFrom>,
    /// Construction of the rope.
    construction: String,
    /// Rope metre from which on it was learnt; of several acquisitions the least.
    from_m: f64,
    /// Rope metre up to which; of several the greatest.
    to_m: f64,
    /// Metres of rope learnt from, summed over the views.
    learnt_view_m: f64,
    /// Line score above which a line is an alarm.
    threshold: f64,
    /// How the threshold was found.
    threshold_origin: String,
    /// Both thresholds with the budget that they are made for; null in models of earlier versions.
    #[schema(required)]
    budget: Option<BudgetFit>,
    /// How smoothly gray values were learnt; null in models of earlier versions.
    #[schema(required)]
    bandwidths: Option<Bandwidths>,
    /// What the model would have known with less rope; empty in models of earlier versions.
    learning_curve: Vec<LearningPoint>,
    /// Whether more rope would help, as a sentence; null in models of earlier versions.
    #[schema(required)]
    was_it_enough: Option<String>,
    /// Wall-clock seconds of the run.
    seconds: f64,
    /// What else a person should know.
    notes: Vec<String>,
}

/// What an acquisition gave to a model.
#[derive(Debug, Serialize, ToSchema)]
pub struct LearntFrom {
    /// The acquisition.
    acquisition_id: Uuid,
    /// Rope metre from which on it was learnt.
    from_m: f64,
    /// Rope metre up to which.
    to_m: f64,
    /// Metres of rope learnt from, summed over the views.
    learnt_view_m: f64,
}

impl LearntFrom {
    /// In the order of the ranges. The report of a training on one acquisition does not repeat it.
    fn all(row: &models::Model, report: &TrainReport) -> Result<Vec<Self>, StoreError> {
        if report.learnt_from.is_empty() {
            let TrainReport { from_m, to_m, learnt_view_m, .. } = *report;
            return Ok(vec![Self { acquisition_id: row.acquisition_id.0, from_m, to_m, learnt_view_m }]);
        }
        let of_one = |from: &training_range::LearntFrom| {
            let acquisition_id = Uuid::parse_str(&from.acquisition).map_err(|_| StoreError::Inconsistent {
                table: "model",
                column: "report",
                row: row.id.to_string(),
                value: from.acquisition.clone(),
            })?;
            Ok(Self { acquisition_id, from_m: from.from_m, to_m: from.to_m, learnt_view_m: from.learnt_view_m })
        };
        report.learnt_from.iter().map(of_one).collect()
    }
}

/// What a model of so many metres knows of rope that it has not seen.
#[derive(Debug, Serialize, ToSchema)]
pub struct LearningPoint {
    /// Metres learnt from, mean of the views.
    metres: f64,
    /// Mean logarithm of the likelihood of a held-back pixel, over that of knowing nothing, in nats.
    nats_per_pixel: f64,
}

impl From<learning_curve::LearningPoint> for LearningPoint {
    fn from(p: learning_curve::LearningPoint) -> Self {
        Self { metres: p.metres, nats_per_pixel: p.nats_per_pixel }
    }
}

/// An appearance model.
#[derive(Debug, Serialize, ToSchema)]
pub struct Model {
    /// Id.
    id: Uuid,
    /// The rope it knows.
    rope_id: Uuid,
    /// 1, 2, .. per rope.
    version: u32,
    /// The job that trained it.
    job_id: Uuid,
    /// What it was trained on.
    trained_on: TrainedOn,
    /// Digest of its file, lower-case hex.
    sha256: String,
    /// Length of its file.
    bytes: i64,
    /// When it was made.
    #[schema(format = DateTime)]
    created_at: String,
}

/// Which models.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct ModelFilter {
    /// Only those of this rope.
    rope_id: Option<Uuid>,
}

impl TryFrom<models::Model> for Model {
    type Error = StoreError;

    fn try_from(row: models::Model) -> Result<Self, StoreError> {
        let report = row.report()?;
        Ok(Self {
            id: row.id.0,
            rope_id: row.rope_id.0,
            version: row.version,
            job_id: row.job_id.0,
            trained_on: TrainedOn {
                acquisition_id: row.acquisition_id.0,
                acquisitions: LearntFrom::all(&row, &report)?,
                construction: report.construction,
                from_m: report.from_m,
                to_m: report.to_m,
                learnt_view_m: report.learnt_view_m,
                threshold: report.threshold,
                threshold_origin: report.threshold_origin,
                budget: report.budget.map(BudgetFit::from),
                bandwidths: report.bandwidths.map(Bandwidths::from),
                was_it_enough: learning_curve::sentence(&report.learning_curve),
                learning_curve: report.learning_curve.into_iter().map(LearningPoint::from).collect(),
                seconds: report.seconds,
                notes: report.notes,
            },
            sha256: row.sha256,
            bytes: row.bytes,
            created_at: times::rfc3339(row.created_at_ms),
        })
    }
}

page_of!(
    /// A page of models.
    ModelPage, Model, models::Model
);

/// The model of a path.
pub async fn load(app: &App, id: Uuid) -> Result<models::Model, Problem> {
    app.store.model(Id(id)).await?.ok_or_else(|| Problem::no("model", id))
}

/// A model
#[utoipa::path(get, path = "/models/{id}", tag = "models", params(("id" = Uuid, Path, description = "The model")),
    responses((status = 200, description = "The model", body = Model), ReadProblems))]
pub async fn get_model(State(app): State<App>, Path(id): Path<Uuid>) -> Result<axum::Json<Model>, Problem> {
    Ok(axum::Json(load(&app, id).await?.try_into()?))
}

/// Models, newest first
#[utoipa::path(get, path = "/models", tag = "models", params(ModelFilter, PageQuery),
    responses((status = 200, description = "A page of models", body = ModelPage), ReadProblems))]
pub async fn list_models(
    State(app): State<App>,
    Query(filter): Query<ModelFilter>,
    Query(page): Query<PageQuery>,
) -> Result<axum::Json<ModelPage>, Problem> {
    Ok(axum::Json(app.store.models(filter.rope_id.map(Id), page.request()?).await?.try_into()?))
}

/// The file of a model, as `inspect --model` reads it
#[utoipa::path(get, path = "/models/{id}/file", tag = "models", params(
    ("id" = Uuid, Path, description = "The model"), KnownVersion),
    responses(
    (status = 200, description = "The file", body = Image, content_type = "application/octet-stream", headers(
        ("etag" = String, description = "Its digest, quoted"), ("repr-digest" = String, description = "RFC 9530"))),
    (status = 304, description = "The client has it"),
    ReadProblems))]
pub async fn get_model_file(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let row = load(&app, id).await?;
    let etag = format!("\"{}\"", row.sha256);
    let tags = [("etag", etag.clone()), ("repr-digest", repr_digest(&row.sha256))];
    if known(&headers, &etag) {
        return Ok((StatusCode::NOT_MODIFIED, tags).into_response());
    }
    let file = tokio::fs::File::open(app.store.folder().model(row.id)).await.map_err(Problem::failure)?;
    let body = Body::from_stream(tokio_util::io::ReaderStream::with_capacity(file, 1 << 16));
    let content_type = HeaderValue::from_static("application/octet-stream");
    let length = HeaderValue::from(row.bytes);
    Ok((tags, [(header::CONTENT_TYPE, content_type), (header::CONTENT_LENGTH, length)], body).into_response())
}
