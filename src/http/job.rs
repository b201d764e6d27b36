//! A job as clients see it.

use super::further_acquisitions::FurtherAcquisition;
use super::times;
use crate::store::{StoreError, jobs, leases};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

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
    /// Its name in the database and in JSON.
    pub fn name(self) -> &'static str {
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
    /// What a training learns from besides.
    further_acquisitions: Vec<FurtherAcquisition>,
    /// The model it judges with.
    #[schema(required)]
    model_id: Option<Uuid>,
    /// True when it may begin before the acquisition is complete.
    live: bool,
    /// True when it looks at previews: it has no result, but says in which order frames are wanted.
    preview: bool,
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
            further_acquisitions: row.further()?.into_iter().map(FurtherAcquisition::from).collect(),
            model_id: row.model_id.map(|m| m.0),
            live: row.live,
            preview: row.preview,
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
