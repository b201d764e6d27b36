//! What a running inspection has found so far: never results, and gone when the job ends.

use super::Problem;
use super::defect::Alarm;
use super::extract::{Path, Query};
use super::inspections::check_view;
use super::lay_lengths::LayLength;
use super::lines::LineNumber;
use super::problem::ReadProblems;
use crate::app::App;
use crate::pipeline::results::DefectRow;
use crate::store::{Id, jobs};
use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

/// Most stretches of one answer.
pub const MAX_ROWS: u32 = 1000;

/// Lay lengths that a running job has found so far. They are no result.
#[derive(Debug, Serialize, ToSchema)]
pub struct ProvisionalLayLengths {
    /// The job.
    pub job_id: Uuid,
    /// Always true: nothing holds before the job has ended.
    pub provisional: bool,
    /// Grows when the job is started again: what an earlier run found holds no more.
    pub run: i64,
    /// The view; null for the estimate fused over all views.
    #[schema(required)]
    pub view: Option<u32>,
    /// Stretch by stretch along the rope.
    pub rows: Vec<LayLength>,
}

/// Defects that a running job has found so far. They are no result: nobody can judge them, and no ticket comes of them.
#[derive(Debug, Serialize, ToSchema)]
pub struct ProvisionalDefects {
    /// The job.
    pub job_id: Uuid,
    /// Always true: nothing holds before the job has ended.
    pub provisional: bool,
    /// Grows when the job is started again: what an earlier run found holds no more.
    pub run: i64,
    /// Along the rope. The last ones may still grow or become one.
    pub defects: Vec<ProvisionalDefect>,
}

/// A place that will become a defect unless what follows changes it.
#[derive(Debug, Serialize, ToSchema)]
pub struct ProvisionalDefect {
    /// Number along the rope, from 0. In a stream of events, a list replaces all from its first number on.
    number: usize,
    /// Rope metre where it begins.
    from_m: f64,
    /// Rope metre where it ends, as far as it was seen.
    to_m: f64,
    /// Strand, if it is known.
    #[schema(required)]
    strand: Option<usize>,
    /// Wire in the strand, if it is known.
    #[schema(required)]
    wire: Option<usize>,
    /// Highest line score of its alarms.
    peak_score: f64,
    /// Its alarms.
    alarms: Vec<Alarm>,
}

impl From<DefectRow> for ProvisionalDefect {
    fn from(row: DefectRow) -> Self {
        Self {
            number: row.id,
            from_m: row.from_m,
            to_m: row.to_m,
            strand: row.strand,
            wire: row.wire,
            peak_score: row.peak_score,
            alarms: row.alarms.into_iter().map(Alarm::from).collect(),
        }
    }
}

/// Which provisional lay lengths.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct ProvisionalQuery {
    /// `fused` (default), or a view.
    #[param(pattern = "^(fused|[0-7])$")]
    view: Option<String>,
    /// Only stretches that begin after this camera line, such as `first_line` of the last row that is known.
    #[param(inline)]
    after_line: Option<LineNumber>,
}

/// True while what a job has found so far is kept: until it ends, or, where it looked at previews, until frames take their place.
pub fn last(job: &jobs::Job) -> bool {
    !job.ended() || job.preview && job.state == "succeeded"
}

/// The job of a path, unless what it has found so far is gone.
async fn running(app: &App, id: Uuid) -> Result<jobs::Job, Problem> {
    let job = app.store.job(Id(id)).await?.ok_or_else(|| Problem::no("job", id))?;
    if last(&job) {
        let acquisition = app.store.acquisition(job.acquisition_id).await?;
        if !job.preview || acquisition.is_some_and(|a| !a.complete()) {
            return Ok(job);
        }
        let detail =
            format!("acquisition {} is complete: what was found in its previews went with them", job.acquisition_id);
        return Err(Problem::provisional_gone(detail).with("value", job.state));
    }
    let detail = match job.result_id {
        Some(result) if job.kind == "inspect" => format!("job {id} has succeeded: its results are inspection {result}"),
        _ => format!("job {id} has {}: what it had found by then holds no more", job.state),
    };
    Err(Problem::provisional_gone(detail).with("value", job.state))
}

/// Lay lengths that a running inspection has found so far, at most 1,000 stretches
#[utoipa::path(get, path = "/jobs/{id}/provisional-lay-lengths", tag = "jobs",
    params(("id" = Uuid, Path, description = "The job"), ProvisionalQuery),
    responses((status = 200, description = "What was found so far; it is no result", body = ProvisionalLayLengths), ReadProblems))]
pub async fn get_provisional_lay_lengths(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    Query(query): Query<ProvisionalQuery>,
) -> Result<axum::Json<ProvisionalLayLengths>, Problem> {
    let view = super::lay_lengths::view(query.view.as_deref())?;
    let job = running(&app, id).await?;
    if let Some(view) = view {
        check_view(&app, job.acquisition_id, view).await?;
    }
    Ok(axum::Json(lay_lengths(&app, &job, view, query.after_line.map(LineNumber::get)).await?))
}

/// Defects that a running inspection has found so far
#[utoipa::path(get, path = "/jobs/{id}/provisional-defects", tag = "jobs", params(("id" = Uuid, Path, description = "The job")),
    responses((status = 200, description = "What was found so far; it is no result", body = ProvisionalDefects), ReadProblems))]
pub async fn get_provisional_defects(
    State(app): State<App>,
    Path(id): Path<Uuid>,
) -> Result<axum::Json<ProvisionalDefects>, Problem> {
    let job = running(&app, id).await?;
    Ok(axum::Json(defects(&app, &job, 0).await?.1))
}

/// What a job has found in stretches after a line.
pub async fn lay_lengths(
    app: &App,
    job: &jobs::Job,
    view: Option<u32>,
    after_line: Option<u64>,
) -> Result<ProvisionalLayLengths, Problem> {
    let stretches = app.store.provisional_lay_lengths(job.id, view, after_line, MAX_ROWS).await?;
    let rows = stretches.into_iter().map(LayLength::from).collect();
    Ok(ProvisionalLayLengths { job_id: job.id.0, provisional: true, run: job.lease_token, view, rows })
}

/// The defects of a job from the first that has changed since `after_seq`, and the latest change.
pub async fn defects(app: &App, job: &jobs::Job, after_seq: i64) -> Result<(i64, ProvisionalDefects), Problem> {
    let news = app.store.provisional_defects(job.id, after_seq).await?;
    let defects = news.defects.into_iter().map(ProvisionalDefect::from).collect();
    Ok((news.seq, ProvisionalDefects { job_id: job.id.0, provisional: true, run: job.lease_token, defects }))
}
