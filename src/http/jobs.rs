//! Jobs: ask, watch, cancel.

use super::Problem;
use super::acquisitions;
use super::bandwidths::BandwidthsBy;
use super::budgets::Budget;
use super::completion::incomplete;
use super::extract::{Json, Path, Query};
use super::further_acquisitions::{self, FurtherAcquisition};
use super::job::{Job, JobState};
use super::pages::{PageQuery, page_of};
use super::problem::{ReadProblems, WriteProblems};
use super::ropeways::{check_text, choose_id};
use crate::app::App;
use crate::pipeline::TrainOptions;
use crate::store::Id;
use crate::store::enqueue::{Enqueued, FurtherRange, NewJob as Row, Task};
use crate::store::jobs::{self, Cancellation};
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
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
        /// How smoothly gray values are learnt, else `held-out`.
        bandwidths: Option<BandwidthsBy>,
        /// More intact rope to learn from, of other days or other places. All acquisitions must show the same rope, seen by the same
        /// camera head; what they show is learnt as one.
        #[serde(default)]
        #[schema(max_items = 15)]
        further_acquisitions: Vec<FurtherAcquisition>,
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
        NewJob::Train {
            id,
            acquisition_id,
            from_m,
            to_m,
            budget,
            bandwidths,
            further_acquisitions,
            idempotency_key,
        } => {
            super::lay_lengths::range_m(from_m, to_m, None)?;
            let options = TrainOptions {
                budget: budget.map(Budget::check).transpose()?.unwrap_or_default(),
                bandwidths: bandwidths.map(Into::into).unwrap_or_default(),
            };
            let first = FurtherRange { acquisition_id: Id(acquisition_id), from_m, to_m };
            let further = further_acquisitions::read(first, &further_acquisitions)?;
            (id, acquisition_id, Task::Train { from_m, to_m, options, further }, idempotency_key)
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
    further_acquisitions::check(&app, &new).await?;
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
        Enqueued::NoAcquisition(id) => {
            return Err(unknown(&further_acquisitions::field_of(&new, id), "acquisition", id));
        }
        Enqueued::Incomplete(id) => {
            return Err(incomplete(id.0, app.store.missing(id).await?.unwrap_or_default()));
        }
        Enqueued::AcquisitionOfAnotherRope { acquisition, other, rope } => {
            return Err(Problem::acquisition_of_another_rope(format!(
                "acquisition {acquisition} shows rope {other}, but the first one shows rope {rope}: a model is learnt from one rope"
            ))
            .with("field", further_acquisitions::field_of(&new, acquisition))
            .limit(other.to_string(), rope.to_string()));
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
