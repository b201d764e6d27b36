//! Thresholds of an inspection: the job's own, and those that people applied after it had ended. Nothing is computed anew.

use super::auth::Caller;
use super::extract::{Json, Path};
use super::problem::{ReadProblems, WriteProblems};
use super::ropeways::{MAX_NAME, check_text};
use super::thresholds::{MAX_LINE_SCORE, check_line_score};
use super::verdicts::MAX_COMMENT;
use super::{Problem, inspections, models, times};
use crate::app::App;
use crate::pipeline::results::Threshold;
use crate::store::inspection_thresholds::{self, Applied, NewInspectionThreshold};
use crate::store::{Id, defects};
use axum::Extension;
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use serde_json::json;
use utoipa::ToSchema;
use uuid::Uuid;

/// A threshold to be applied to an inspection: a line score, or a threshold of its model.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(untagged)]
pub enum ThresholdToApply {
    /// A line score for this inspection.
    LineScore(LineScoreToApply),
    /// A threshold of the model.
    Version(VersionToApply),
}

/// A line score to be applied to one inspection.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LineScoreToApply {
    /// Places with a peak score above it are defects. Nothing under the look-again level of the inspection was stored, so it must not
    /// be lower.
    #[schema(minimum = 0, maximum = 1000)]
    line_score: f64,
    /// Who applies it; else the name of the token.
    #[schema(min_length = 1, max_length = 200)]
    by: Option<String>,
    /// Why.
    #[schema(min_length = 1, max_length = 4000)]
    reason: String,
}

/// A threshold of the model to be applied to one inspection. Of its two levels the first is applied: places to look at again are
/// those that the job stored.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct VersionToApply {
    /// Its number among the thresholds of the model; 0: the trained one.
    version: u32,
    /// Who applies it; else the name of the token. Why is what the model says of it.
    #[schema(min_length = 1, max_length = 200)]
    by: Option<String>,
}

/// A threshold of an inspection.
#[derive(Debug, Serialize, ToSchema)]
pub struct InspectionThreshold {
    /// 0: the job judged by it. 1, 2, ..: applied since then.
    number: u32,
    /// Places with a peak score above it are defects.
    line_score: f64,
    /// Places above it, but not above `line_score`, are worth looking at again; under it nothing is stored. Null: there is no second level.
    #[schema(required)]
    look_again_line_score: Option<f64>,
    /// The threshold of the model that was applied; null: a line score for this inspection, or the job's.
    #[schema(required)]
    model_version: Option<u32>,
    /// How it was found, or who applied it and why.
    origin: String,
    /// Who applied it; null: the job judged by it.
    #[schema(required)]
    by: Option<String>,
    /// Why; null: the job judged by it.
    #[schema(required)]
    reason: Option<String>,
    /// Defects under it, those included that were kept because of a verdict or a ticket.
    defects: u32,
    /// Places to look at again under it.
    look_again: u32,
    /// Since when.
    #[schema(format = DateTime)]
    applied_at: String,
}

/// All thresholds of an inspection.
#[derive(Debug, Serialize, ToSchema)]
pub struct InspectionThresholdList {
    /// Newest first: the first one holds.
    items: Vec<InspectionThreshold>,
    /// Always null: there is one page.
    #[schema(required)]
    next_cursor: Option<String>,
}

/// A defect that is not over the threshold but stays one.
#[derive(Debug, Serialize, ToSchema)]
pub struct KeptDefect {
    /// The defect.
    defect_id: Uuid,
    /// Highest line score of its alarms.
    peak_score: f64,
    /// Why it stays, as a sentence.
    why: String,
}

/// What a threshold did to the places of an inspection. Ids, verdicts and tickets are what they were.
#[derive(Debug, Serialize, ToSchema)]
pub struct AppliedThreshold {
    /// The inspection.
    inspection_id: Uuid,
    /// The threshold, which holds now.
    threshold: InspectionThreshold,
    /// Places that have become defects, along the rope; empty if the same call applied it before.
    opened: Vec<Uuid>,
    /// Defects that have become places to look at again, along the rope; empty if the same call applied it before.
    closed: Vec<Uuid>,
    /// Defects that are not over it but stay, because people decided on them or they have a ticket.
    kept: Vec<KeptDefect>,
    /// Tickets queued now, for opened defects that reach the level of the rope.
    tickets: usize,
}

impl From<inspection_thresholds::InspectionThreshold> for InspectionThreshold {
    fn from(row: inspection_thresholds::InspectionThreshold) -> Self {
        Self {
            number: row.number,
            line_score: row.line_score,
            look_again_line_score: row.look_again_line_score,
            model_version: row.model_version,
            origin: row.decides().origin,
            by: Some(row.set_by),
            reason: Some(row.reason),
            defects: row.defects,
            look_again: row.look_again,
            applied_at: times::rfc3339(row.created_at_ms),
        }
    }
}

impl From<defects::Defect> for KeptDefect {
    fn from(row: defects::Defect) -> Self {
        let why = match (row.state.as_str(), &row.verdict_by, &row.ticket_number) {
            ("open", _, Some(number)) => format!("it has the ticket {number}"),
            ("open", _, None) => "its ticket was sent or is on its way".to_owned(),
            (state, Some(by), _) => format!("{by} has {state} it"),
            (state, None, _) => format!("it was {state}"),
        };
        Self { defect_id: row.id.0, peak_score: row.peak_score, why }
    }
}

impl From<Applied> for AppliedThreshold {
    fn from(applied: Applied) -> Self {
        let ids = |defects: Vec<defects::Defect>| defects.into_iter().map(|d| d.id.0).collect();
        Self {
            inspection_id: applied.threshold.inspection_id.0,
            threshold: applied.threshold.into(),
            opened: ids(applied.opened),
            closed: ids(applied.closed),
            kept: applied.kept.into_iter().map(KeptDefect::from).collect(),
            tickets: applied.tickets,
        }
    }
}

/// The threshold by which the job judged. Errors: 404 without a model, because then nothing was judged.
fn of_job(row: &crate::store::inspections::Inspection) -> Result<(Threshold, InspectionThreshold), Problem> {
    let summary = row.summary_of_job()?;
    let judged_by = summary
        .threshold
        .ok_or_else(|| Problem::no_likelihood("the inspection was made without a model, so it has no threshold"))?;
    let count = |n: Option<usize>| n.unwrap_or(0) as u32;
    let told = InspectionThreshold {
        number: 0,
        line_score: judged_by.line_score,
        look_again_line_score: judged_by.look_again_line_score,
        model_version: None,
        origin: judged_by.origin.clone(),
        by: None,
        reason: None,
        defects: count(summary.defects),
        look_again: count(summary.look_again),
        applied_at: times::rfc3339(row.created_at_ms),
    };
    Ok((judged_by, told))
}

/// Thresholds of an inspection, newest first; the first one holds, the last one is the job's own
#[utoipa::path(get, path = "/inspections/{id}/thresholds", tag = "inspections",
    params(("id" = Uuid, Path, description = "The inspection")),
    responses((status = 200, description = "Its thresholds", body = InspectionThresholdList), ReadProblems))]
pub async fn list_inspection_thresholds(
    State(app): State<App>,
    Path(id): Path<Uuid>,
) -> Result<axum::Json<InspectionThresholdList>, Problem> {
    let (_, of_job) = of_job(&inspections::load(&app, id).await?)?;
    let applied = app.store.inspection_thresholds(Id(id)).await?;
    let items = applied.into_iter().map(InspectionThreshold::from).chain([of_job]).collect();
    Ok(axum::Json(InspectionThresholdList { items, next_cursor: None }))
}

/// Apply another threshold to an inspection that has ended. Nothing is computed anew: defects and places to look at again change their
/// level by their peak scores, new defects are ticketed as if the job had found them, and what was decided on or has a ticket stays
#[utoipa::path(post, path = "/inspections/{id}/thresholds", tag = "inspections",
    params(("id" = Uuid, Path, description = "The inspection")), request_body = ThresholdToApply, responses(
    (status = 201, description = "It holds", body = AppliedThreshold),
    (status = 200, description = "The same call applied it before", body = AppliedThreshold),
    WriteProblems))]
pub async fn apply_threshold(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    Extension(caller): Extension<Caller>,
    Json(body): Json<ThresholdToApply>,
) -> Result<Response, Problem> {
    let inspection = ended(&app, id).await?;
    let (judged_by, _) = of_job(&inspection)?;
    let (line_score, by, reason, model_version) = match body {
        ThresholdToApply::LineScore(wish) => {
            check_text("reason", &wish.reason, 1, MAX_COMMENT)?;
            (check_line_score(wish.line_score)?, wish.by, wish.reason, None)
        }
        ThresholdToApply::Version(wish) => {
            let model = inspection.model_id.ok_or_else(|| Problem::failure("a threshold without a model"))?;
            let threshold = of_model(&app, model, wish.version).await?;
            (threshold.line_score, wish.by, threshold.origin, Some(wish.version))
        }
    };
    let set_by = by.unwrap_or(caller.name);
    check_text("by", &set_by, 1, MAX_NAME)?;
    check_stored(&judged_by, line_score)?;
    // Places between a job's only level and a higher threshold are worth looking at again.
    let only_level = Some(judged_by.line_score).filter(|&level| level < line_score);
    let new = NewInspectionThreshold {
        inspection_id: Id(id),
        line_score,
        look_again_line_score: judged_by.look_again_line_score.or(only_level),
        model_version,
        set_by,
        reason,
    };
    let applied = app.store.apply_threshold(&new, app.now_ms()).await?;
    app.outbox_wake.notify_one();
    let status = if applied.new { StatusCode::CREATED } else { StatusCode::OK };
    Ok((status, axum::Json(AppliedThreshold::from(applied))).into_response())
}

/// The inspection of a path, which may be asked for by its job while that runs. Errors: 409 then.
async fn ended(app: &App, id: Uuid) -> Result<crate::store::inspections::Inspection, Problem> {
    if let Some(inspection) = app.store.inspection(Id(id)).await? {
        return Ok(inspection);
    }
    match app.store.job(Id(id)).await? {
        Some(job) if job.kind == "inspect" && !job.ended() => Err(Problem::inspection_running(format!(
            "the inspection of job {id} is {}, and what it has found is provisional: wait for its end, then apply the threshold to the \
             inspection that it leaves",
            job.state
        ))
        .with("value", &job.state)),
        _ => Err(Problem::no("inspection", id)),
    }
}

async fn of_model(app: &App, model: Id, version: u32) -> Result<Threshold, Problem> {
    let report = models::load(app, model.0).await?.report()?;
    if version == 0 {
        return Ok(report.decides_by(None));
    }
    let row = app.store.model_threshold(model, version).await?.ok_or_else(|| {
        Problem::unknown_reference(format!(
            "model {model} has no threshold {version}: look at the thresholds of the model, then apply one of those"
        ))
        .with("field", "version")
        .with("value", version)
    })?;
    Ok(report.decides_by(Some(&row.decides())))
}

/// Refuses thresholds under what was stored.
fn check_stored(judged_by: &Threshold, line_score: f64) -> Result<(), Problem> {
    let (name, least) = match judged_by.look_again_line_score {
        Some(level) => ("look-again level", level),
        None => ("threshold", judged_by.line_score), // there is no second level
    };
    if line_score >= least {
        return Ok(());
    }
    Err(Problem::below_look_again(format!(
        "line_score is {line_score}, but of places under the {name} of this inspection, {least}, nothing was stored: apply at least that, or \
         inspect again with a job that has this threshold"
    ))
    .with("field", "line_score")
    .limit(line_score, json!({ "min": least, "max": MAX_LINE_SCORE })))
}
