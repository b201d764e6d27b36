//! Jobs: ask, watch, cancel.

use super::acquisitions::{self, incomplete};
use super::budgets::Budget;
use super::extract::{Json, Path, Query};
use super::pages::{PageQuery, page_of};
use super::problem::{ReadProblems, WriteProblems};
use super::ropeways::{check_text, choose_id};
use super::{Problem, times};
use crate::app::App;
use crate::store::jobs::{self, Cancellation, Enqueued, NewJob as Row, Task};
use crate::store::{Id, StoreError, leases};
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

/// A job to be queued.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum NewJob {
    /// Learn the appearance of intact rope.
    Train {
        /// Id, if the client chooses it.
        id: Option<Uuid>,
        /// The complete acquisition to learn from.
        acquisition_id: Uuid,
        /// Rope metre from which on the rope is intact, else from the start.
        from_m: Option<f64>,
        /// Rope metre up to which it is, else to the end.
        to_m: Option<f64>,
        /// What false alarms may cost, else 2 false defects per 100 m; the thresholds follow from it.
        budget: Option<Budget>,
        /// A repeated request with the same key is the same job.
        #[schema(min_length = 1, max_length = 200)]
        idempotency_key: Option<String>,
    },
    /// Measure lay lengths and, with a model, find defects.
    Inspect {
        /// Id, if the client chooses it.
        id: Option<Uuid>,
        /// The acquisition to inspect: complete, unless `live` is true.
        acquisition_id: Uuid,
        /// True: the acquisition may still be open. Frames are inspected as they arrive, and gaps awaited.
        #[serde(default)]
        live: bool,
        /// A model of the same rope; without one, only lay lengths are measured.
        model_id: Option<Uuid>,
        /// Line score above which a line is an alarm, else the model's threshold at this moment.
        threshold: Option<f64>,
        /// A repeated request with the same key is the same job.
        #[schema(min_length = 1, max_length = 200)]
        idempotency_key: Option<String>,
    },
}

/// What a job does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum JobKind {
    /// Learns a model.
    Train,
    /// Inspects.
    Inspect,
}

/// State of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum JobState {
    /// It waits for a worker.
    Queued,
    /// A worker runs it.
    Running,
    /// It ended with a result.
    Succeeded,
    /// It ended with an error.
    Failed,
    /// It was cancelled.
    Cancelled,
}

impl JobState {
    fn name(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Running => "running",
            Self::Succeeded => "succeeded",
            Self::Failed => "failed",
            Self::Cancelled => "cancelled",
        }
    }

    fn of_name(name: &str) -> Option<Self> {
        [Self::Queued, Self::Running, Self::Succeeded, Self::Failed, Self::Cancelled]
            .into_iter()
            .find(|state| state.name() == name)
    }
}

/// How far a job is.
#[derive(Debug, PartialEq, Serialize, ToSchema)]
pub struct JobProgress {
    /// What is being done: `align`, `learn`, `inspect`, `write`; null before the first report.
    #[schema(required)]
    stage: Option<String>,
    /// Metres of rope done in this stage.
    done_m: f64,
    /// Metres of rope in this stage; while frames still arrive, of those that are there.
    total_m: f64,
    /// `done_m / total_m` of the stage, 0 to 1.
    fraction: f64,
}

/// The frame that a job on an open acquisition waits for.
#[derive(Debug, PartialEq, Serialize, ToSchema)]
pub struct WaitingFor {
    /// The view.
    view: u32,
    /// Number of the frame.
    frame: u32,
    /// Since when.
    #[schema(format = DateTime)]
    since: String,
}

/// What came of a job.
#[derive(Debug, PartialEq, Serialize, ToSchema)]
pub struct JobResult {
    /// The model, of a training.
    #[serde(skip_serializing_if = "Option::is_none")]
    model_id: Option<Uuid>,
    /// The inspection, of an inspection.
    #[serde(skip_serializing_if = "Option::is_none")]
    inspection_id: Option<Uuid>,
}

/// Why the last attempt of a job failed.
#[derive(Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobError {
    /// Stable name of the kind.
    #[serde(rename = "type")]
    kind: String,
    /// The kind in words.
    title: String,
    /// What went wrong this time.
    detail: String,
}

/// A job.
#[derive(Debug, PartialEq, Serialize, ToSchema)]
pub struct Job {
    /// Id.
    id: Uuid,
    /// What it does.
    kind: JobKind,
    /// The acquisition it works on.
    acquisition_id: Uuid,
    /// The model it judges with.
    #[schema(required)]
    model_id: Option<Uuid>,
    /// True when it may begin before the acquisition is complete.
    live: bool,
    /// State.
    state: JobState,
    /// True when somebody asked to cancel it.
    cancel_requested: bool,
    /// How far it is.
    progress: JobProgress,
    /// The frame that it waits for; null when it does not wait.
    #[schema(required)]
    waiting_for: Option<WaitingFor>,
    /// Speed of the stage so far.
    #[schema(required)]
    metres_per_second: Option<f64>,
    /// Times it was started since it last waited for a frame.
    attempts: u32,
    /// Why the last attempt failed.
    #[schema(required)]
    error: Option<JobError>,
    /// What came of it.
    #[schema(required)]
    result: Option<JobResult>,
    /// When it was queued.
    #[schema(format = DateTime)]
    created_at: String,
    /// When it was first started.
    #[schema(required, format = DateTime)]
    started_at: Option<String>,
    /// When it ended.
    #[schema(required, format = DateTime)]
    finished_at: Option<String>,
}

impl TryFrom<jobs::Job> for Job {
    type Error = StoreError;

    fn try_from(row: jobs::Job) -> Result<Self, StoreError> {
        let wrong =
            |column, value: String| StoreError::Inconsistent { table: "job", column, row: row.id.to_string(), value };
        let kind = if row.kind == "train" { JobKind::Train } else { JobKind::Inspect };
        let result = row.result_id.map(|id| match kind {
            JobKind::Train => JobResult { model_id: Some(id.0), inspection_id: None },
            JobKind::Inspect => JobResult { model_id: None, inspection_id: Some(id.0) },
        });
        let (done_m, total_m) = (row.done_m.unwrap_or(0.0), row.total_m.unwrap_or(0.0));
        let fraction = if row.state == "succeeded" {
            1.0
        } else if total_m > 0.0 {
            (done_m / total_m).clamp(0.0, 1.0)
        } else {
            0.0
        };
        Ok(Self {
            id: row.id.0,
            kind,
            acquisition_id: row.acquisition_id.0,
            model_id: row.model_id.map(|m| m.0),
            live: row.live,
            state: JobState::of_name(&row.state).ok_or_else(|| wrong("state", row.state.clone()))?,
            cancel_requested: row.cancel_requested,
            progress: JobProgress { stage: row.stage.clone(), done_m, total_m, fraction },
            waiting_for: row
                .waiting_for
                .as_deref()
                .filter(|_| row.state == "running")
                .map(|json| serde_json::from_str(json).map_err(|e| wrong("waiting_for", e.to_string())))
                .transpose()?
                .map(|w: leases::WaitingFor| WaitingFor {
                    view: w.view,
                    frame: w.frame,
                    since: times::rfc3339(w.since_ms),
                }),
            metres_per_second: row.metres_per_second,
            attempts: row.attempts,
            error: row
                .error
                .as_deref()
                .map(|json| serde_json::from_str(json).map_err(|e| wrong("error", e.to_string())))
                .transpose()?,
            result,
            created_at: times::rfc3339(row.created_at_ms),
            started_at: row.started_at_ms.map(times::rfc3339),
            finished_at: row.finished_at_ms.map(times::rfc3339),
        })
    }
}

page_of!(
    /// A page of jobs.
    JobPage, Job, jobs::Job
);

/// Which jobs.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct JobFilter {
    /// Only those on this acquisition.
    acquisition_id: Option<Uuid>,
    /// Only those in this state.
    #[param(inline)]
    state: Option<JobState>,
}

fn read(app: &App, body: NewJob) -> Result<Row, Problem> {
    let (id, acquisition_id, task, idempotency_key) = match body {
        NewJob::Train { id, acquisition_id, from_m, to_m, budget, idempotency_key } => {
            super::lay_lengths::range_m(from_m, to_m, None)?;
            let budget = budget.map(Budget::check).transpose()?.unwrap_or_default();
            (id, acquisition_id, Task::Train { from_m, to_m, budget }, idempotency_key)
        }
        NewJob::Inspect { id, acquisition_id, live, model_id, threshold, idempotency_key } => {
            let task = Task::Inspect { model_id: model_id.map(Id), threshold, live };
            (id, acquisition_id, task, idempotency_key)
        }
    };
    if let Some(key) = &idempotency_key {
        check_text("idempotency_key", key, 1, 200)?;
    }
    Ok(Row { id: choose_id(app, None, id)?, acquisition_id: Id(acquisition_id), task, idempotency_key })
}

fn unknown(field: &str, what: &str, id: Id) -> Problem {
    Problem::unknown_reference(format!("there is no {what} {id}")).with("field", field).with("value", id.to_string())
}

/// Queue a job on a complete acquisition, or a live inspection of one that is still arriving
#[utoipa::path(post, path = "/jobs", tag = "jobs", request_body = NewJob, responses(
    (status = 202, description = "It is queued, or was by the same request before", body = Job, headers(("location" = String, description = "Where to ask for it"))),
    WriteProblems))]
pub async fn create_job(State(app): State<App>, Json(body): Json<NewJob>) -> Result<Response, Problem> {
    let new = read(&app, body)?;
    let acquisition = new.acquisition_id;
    if app.store.acquisition(acquisition).await?.is_some() {
        acquisitions::load_with_frames(&app, acquisition.0).await?;
    }
    let job = match app.store.enqueue(&new, app.now_ms()).await? {
        Enqueued::New(job) => {
            app.jobs_wake.notify_one();
            app.live_jobs_wake.notify_one();
            job
        }
        Enqueued::Same(job) => job,
        Enqueued::Different(job) if job.id == new.id => {
            return Err(Problem::id_in_use(format!("job {} is another one; nothing was changed", job.id)));
        }
        Enqueued::Different(job) => {
            return Err(Problem::idempotency_key_reused(format!(
                "the key belongs to job {}, which was asked for otherwise",
                job.id
            ))
            .with("value", new.idempotency_key));
        }
        Enqueued::NoAcquisition => return Err(unknown("acquisition_id", "acquisition", acquisition)),
        Enqueued::Incomplete => {
            return Err(incomplete(acquisition.0, app.store.missing(acquisition).await?.unwrap_or_default()));
        }
        Enqueued::NoModel => {
            let Task::Inspect { model_id: Some(model), .. } = new.task else {
                return Err(Problem::failure("a job without model was refused for its model"));
            };
            return Err(unknown("model_id", "model", model));
        }
        Enqueued::ModelOfAnotherRope { model_rope, rope } => {
            return Err(Problem::model_of_another_rope(format!(
                "the model was trained on rope {model_rope}, but the acquisition shows rope {rope}"
            ))
            .limit(model_rope.to_string(), rope.to_string()));
        }
    };
    Ok(accepted(job)?.into_response())
}

fn accepted(job: jobs::Job) -> Result<impl IntoResponse, Problem> {
    let address = format!("/api/v1/jobs/{}", job.id);
    Ok((StatusCode::ACCEPTED, [(header::LOCATION, address)], axum::Json(Job::try_from(job)?)))
}

/// A job
#[utoipa::path(get, path = "/jobs/{id}", tag = "jobs", params(("id" = Uuid, Path, description = "The job")),
    responses((status = 200, description = "The job", body = Job), ReadProblems))]
pub async fn get_job(State(app): State<App>, Path(id): Path<Uuid>) -> Result<axum::Json<Job>, Problem> {
    let row = app.store.job(Id(id)).await?.ok_or_else(|| Problem::no("job", id))?;
    Ok(axum::Json(row.try_into()?))
}

/// Jobs, newest first
#[utoipa::path(get, path = "/jobs", tag = "jobs", params(JobFilter, PageQuery),
    responses((status = 200, description = "A page of jobs", body = JobPage), ReadProblems))]
pub async fn list_jobs(
    State(app): State<App>,
    Query(filter): Query<JobFilter>,
    Query(page): Query<PageQuery>,
) -> Result<axum::Json<JobPage>, Problem> {
    let rows = app.store.jobs(filter.acquisition_id.map(Id), filter.state.map(JobState::name), page.request()?).await?;
    Ok(axum::Json(rows.try_into()?))
}

/// Cancel a job; a running one stops within a frame or two
#[utoipa::path(post, path = "/jobs/{id}/cancellation", tag = "jobs", params(("id" = Uuid, Path, description = "The job")),
    responses(
    (status = 202, description = "It is cancelled or will be", body = Job, headers(("location" = String, description = "Where to ask for it"))),
    WriteProblems))]
pub async fn cancel_job(State(app): State<App>, Path(id): Path<Uuid>) -> Result<Response, Problem> {
    match app.store.cancel(Id(id), app.now_ms()).await? {
        Cancellation::Accepted(job) => Ok(accepted(job)?.into_response()),
        Cancellation::Ended(job) => {
            Err(Problem::job_ended(format!("job {id} has {} already; nothing was changed", job.state))
                .with("value", Value::String(job.state)))
        }
        Cancellation::Unknown => Err(Problem::no("job", id)),
    }
}
