//! Inspections: what a job concluded about one acquisition with one model and one threshold.

use super::diameter_summary::DiameterSummary;
use super::extract::{Path, Query};
use super::model_fit::ModelFit;
use super::pages::{PageQuery, page_of};
use super::problem::ReadProblems;
use super::{Problem, times};
use crate::app::App;
use crate::pipeline::results;
use crate::store::{Id, StoreError, inspections};
use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

/// A stretch of a view that was not inspected. Not covered is not intact.
#[derive(Debug, Serialize, ToSchema)]
pub struct NotCovered {
    /// The view.
    view: usize,
    /// Rope metre where it begins.
    from_m: f64,
    /// Rope metre where it ends.
    to_m: f64,
    /// Why.
    reason: String,
}

/// The threshold that decides, and where it came from.
#[derive(Debug, Serialize, ToSchema)]
pub struct Threshold {
    /// Lines with a score above it are alarms.
    line_score: f64,
    /// Lines with a score above it, but not above `line_score`, are worth looking at again; null: there is no second level.
    #[schema(required)]
    look_again_line_score: Option<f64>,
    /// How it was found, or who set it.
    origin: String,
}

/// What a run says of itself.
#[derive(Debug, Serialize, ToSchema)]
pub struct Summary {
    /// Program version.
    ropescope_version: String,
    /// Name of the model that was used.
    #[schema(required)]
    model: Option<String>,
    /// Construction of the rope.
    construction: String,
    /// Lines of the longest view.
    lines: usize,
    /// Metres of rope in the acquisition.
    metres: f64,
    /// Metres times views that were inspected (aligned, if there was no model).
    covered_view_m: f64,
    /// What was not, with reasons.
    not_covered: Vec<NotCovered>,
    /// The threshold in force, the job's own or the one that was applied last; null without a model.
    #[schema(required)]
    threshold: Option<Threshold>,
    /// Number of defects under it; null without a model.
    #[schema(required)]
    defects: Option<usize>,
    /// Number of places that are no defects but worth looking at again; null without a second level.
    #[schema(required)]
    look_again: Option<usize>,
    /// Whether the model still fits this rope; null without a model that knows.
    #[schema(required)]
    fit: Option<ModelFit>,
    /// Diameter, ovality and looseness along the rope; null where no diameter was measured.
    #[schema(required)]
    diameter: Option<DiameterSummary>,
    /// Wall-clock seconds of the run.
    seconds: f64,
    /// Metres of rope (all views) per second.
    metres_per_second: f64,
    /// What else a person should know.
    notes: Vec<String>,
}

/// An inspection.
#[derive(Debug, Serialize, ToSchema)]
pub struct Inspection {
    /// Id.
    id: Uuid,
    /// What was inspected.
    acquisition_id: Uuid,
    /// The rope.
    rope_id: Uuid,
    /// With which model; null: alignment only.
    #[schema(required)]
    model_id: Option<Uuid>,
    /// The job that did it.
    job_id: Uuid,
    /// What the run says of itself.
    summary: Summary,
    /// When it ended.
    #[schema(format = DateTime)]
    created_at: String,
}

/// Which inspections.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct InspectionFilter {
    /// Only those of this rope.
    rope_id: Option<Uuid>,
    /// Only those of this acquisition.
    acquisition_id: Option<Uuid>,
}

impl From<results::NotCovered> for NotCovered {
    fn from(n: results::NotCovered) -> Self {
        Self { view: n.view, from_m: n.from_m, to_m: n.to_m, reason: n.reason }
    }
}

impl From<results::Threshold> for Threshold {
    fn from(t: results::Threshold) -> Self {
        Self { line_score: t.line_score, look_again_line_score: t.look_again_line_score, origin: t.origin }
    }
}

impl From<results::Summary> for Summary {
    fn from(s: results::Summary) -> Self {
        Self {
            ropescope_version: s.ropescope_version,
            model: s.model,
            construction: s.construction,
            lines: s.lines,
            metres: s.metres,
            covered_view_m: s.covered_view_m,
            not_covered: s.not_covered.into_iter().map(NotCovered::from).collect(),
            threshold: s.threshold.map(Threshold::from),
            defects: s.defects,
            look_again: s.look_again,
            fit: s.fit.map(ModelFit::from),
            diameter: s.diameter.map(DiameterSummary::from),
            seconds: s.seconds,
            metres_per_second: s.metres_per_second,
            notes: s.notes,
        }
    }
}

impl TryFrom<inspections::Inspection> for Inspection {
    type Error = StoreError;

    fn try_from(row: inspections::Inspection) -> Result<Self, StoreError> {
        Ok(Self {
            id: row.id.0,
            acquisition_id: row.acquisition_id.0,
            rope_id: row.rope_id.0,
            model_id: row.model_id.map(|m| m.0),
            job_id: row.job_id.0,
            summary: row.summary()?.into(),
            created_at: times::rfc3339(row.created_at_ms),
        })
    }
}

page_of!(
    /// A page of inspections.
    InspectionPage, Inspection, inspections::Inspection
);

/// The inspection of a path.
pub async fn load(app: &App, id: Uuid) -> Result<inspections::Inspection, Problem> {
    app.store.inspection(Id(id)).await?.ok_or_else(|| Problem::no("inspection", id))
}

/// Refuses views that the acquisition does not have; else returns it.
pub async fn check_view(
    app: &App,
    acquisition: Id,
    view: u32,
) -> Result<crate::store::acquisitions::Acquisition, Problem> {
    let acquisition = super::acquisitions::load(app, acquisition.0).await?;
    let views = acquisition.views.len();
    if (view as usize) < views {
        return Ok(acquisition);
    }
    let last = views.saturating_sub(1);
    Err(Problem::view_out_of_range(format!(
        "there is no view {view}: the acquisition has {views} views, the last one is {last}"
    ))
    .limit(view, last))
}

/// An inspection
#[utoipa::path(get, path = "/inspections/{id}", tag = "inspections",
    params(("id" = Uuid, Path, description = "The inspection")),
    responses((status = 200, description = "The inspection", body = Inspection), ReadProblems))]
pub async fn get_inspection(State(app): State<App>, Path(id): Path<Uuid>) -> Result<axum::Json<Inspection>, Problem> {
    Ok(axum::Json(load(&app, id).await?.try_into()?))
}

/// Inspections, newest first
#[utoipa::path(get, path = "/inspections", tag = "inspections", params(InspectionFilter, PageQuery),
    responses((status = 200, description = "A page of inspections", body = InspectionPage), ReadProblems))]
pub async fn list_inspections(
    State(app): State<App>,
    Query(filter): Query<InspectionFilter>,
    Query(page): Query<PageQuery>,
) -> Result<axum::Json<InspectionPage>, Problem> {
    let rows = app.store.inspections(filter.rope_id.map(Id), filter.acquisition_id.map(Id), page.request()?).await?;
    Ok(axum::Json(rows.try_into()?))
}
