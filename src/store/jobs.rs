//! Jobs as clients see them: ask, look, cancel. What workers do with them stands in [`super::leases`].

use super::{Id, Page, PageRequest, Store, StoreError, model_thresholds};
use crate::pipeline::Budget;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use sqlx::SqliteConnection;

/// A job.
#[derive(Debug, Clone, PartialEq, sqlx::FromRow)]
#[expect(
    missing_docs,
    reason = "migrations/0003_jobs_and_tokens.sql, 0006_thresholds.sql, 0020_live.sql, 0030_previews.sql, 0031_levels.sql and \
              0040_several_acquisitions.sql say what each column means"
)]
pub struct Job {
    pub seq: i64,
    pub id: Id,
    pub kind: String,
    pub rope_id: Id,
    pub acquisition_id: Id,
    pub model_id: Option<Id>,
    pub threshold: Option<f64>,
    pub threshold_version: Option<u32>,
    pub from_m: Option<f64>,
    pub to_m: Option<f64>,
    pub budget: Option<String>,
    pub idempotency_key: Option<String>,
    pub state: String,
    pub run_at_ms: i64,
    pub attempts: u32,
    pub lease_owner: Option<String>,
    pub lease_token: i64,
    pub lease_until_ms: Option<i64>,
    pub cancel_requested: bool,
    pub stage: Option<String>,
    pub done_m: Option<f64>,
    pub total_m: Option<f64>,
    pub metres_per_second: Option<f64>,
    pub error: Option<String>,
    pub result_id: Option<Id>,
    pub created_at_ms: i64,
    pub started_at_ms: Option<i64>,
    pub finished_at_ms: Option<i64>,
    pub live: bool,
    pub waiting_for: Option<String>,
    pub preview: bool,
    pub further: Option<String>,
}

impl Job {
    /// What false alarms may cost, of a training.
    pub fn budget(&self) -> Result<Option<Budget>, StoreError> {
        self.read("budget", self.budget.as_deref())
    }

    /// What a training learns from besides its acquisition.
    pub fn further(&self) -> Result<Vec<FurtherRange>, StoreError> {
        Ok(self.read("further", self.further.as_deref())?.unwrap_or_default())
    }

    fn read<T: DeserializeOwned>(&self, column: &'static str, json: Option<&str>) -> Result<Option<T>, StoreError> {
        json.map(|json| {
            serde_json::from_str(json).map_err(|_| StoreError::Inconsistent {
                table: "job",
                column,
                row: self.id.to_string(),
                value: json.to_owned(),
            })
        })
        .transpose()
    }

    /// True when nothing more will happen to it.
    pub fn ended(&self) -> bool {
        matches!(self.state.as_str(), "succeeded" | "failed" | "cancelled")
    }
}

/// Intact rope of an acquisition.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FurtherRange {
    /// The acquisition.
    pub acquisition_id: Id,
    /// Rope metre from which on the rope is intact; `None`: from the start.
    pub from_m: Option<f64>,
    /// Rope metre up to which it is; `None`: to the end.
    pub to_m: Option<f64>,
}

/// What shall be done.
#[derive(Debug, Clone, PartialEq)]
pub enum Task {
    /// Learn the appearance of intact rope, from and to a rope metre.
    Train {
        /// `None`: from the start.
        from_m: Option<f64>,
        /// `None`: to the end.
        to_m: Option<f64>,
        /// What false alarms may cost.
        budget: Budget,
        /// Rope of further acquisitions to learn from.
        further: Vec<FurtherRange>,
    },
    /// Measure lay lengths and, with a model, find defects.
    Inspect {
        /// `None`: alignment only.
        model_id: Option<Id>,
        /// `None`: the one that holds for the model when the job is queued.
        threshold: Option<f64>,
        /// It may begin while the acquisition is still open.
        live: bool,
    },
}

/// A job to be queued.
#[derive(Debug, Clone, PartialEq)]
pub struct NewJob {
    /// Id.
    pub id: Id,
    /// The acquisition to work on: complete, or else the job is live.
    pub acquisition_id: Id,
    /// What to do with it.
    pub task: Task,
    /// The client's key; a repeated request with it is the same job.
    pub idempotency_key: Option<String>,
}

/// What came of the wish for a job.
#[derive(Debug, Clone, PartialEq)]
pub enum Enqueued {
    /// It is queued.
    New(Job),
    /// The same request was made before.
    Same(Job),
    /// The key or the id belongs to another request; nothing was changed.
    Different(Job),
    /// There is no such acquisition.
    NoAcquisition(Id),
    /// The acquisition is not complete, and the job is not live.
    Incomplete(Id),
    /// A further acquisition shows another rope than the first.
    AcquisitionOfAnotherRope {
        /// The further acquisition.
        acquisition: Id,
        /// Its rope.
        other: Id,
        /// Rope of the first.
        rope: Id,
    },
    /// There is no such model.
    NoModel,
    /// The model is of another rope.
    ModelOfAnotherRope {
        /// Rope of the model.
        model_rope: Id,
        /// Rope of the acquisition.
        rope: Id,
    },
}

/// What came of the wish to cancel.
#[derive(Debug, Clone, PartialEq)]
pub enum Cancellation {
    /// It is cancelled, or its worker will see the wish at the next heartbeat.
    Accepted(Job),
    /// It had already ended otherwise.
    Ended(Job),
    /// There is no such job.
    Unknown,
}

async fn rope_and_state(
    connection: &mut SqliteConnection,
    acquisition: Id,
) -> Result<Option<(Id, String)>, StoreError> {
    Ok(sqlx::query_as("select rope_id, state from acquisition where id = $1")
        .bind(acquisition)
        .fetch_optional(connection)
        .await?)
}

impl Store {
    /// Queues a job.
    pub async fn enqueue(&self, new: &NewJob, now_ms: i64) -> Result<Enqueued, StoreError> {
        let (kind, from_m, to_m, budget, model_id, threshold, live) = match new.task {
            Task::Train { from_m, to_m, budget, .. } => ("train", from_m, to_m, Some(budget), None, None, false),
            Task::Inspect { model_id, threshold, live } => ("inspect", None, None, None, model_id, threshold, live),
        };
        let further: &[FurtherRange] = match &new.task {
            Task::Train { further, .. } => further,
            Task::Inspect { .. } => &[],
        };
        let mut tx = self.write().await?;
        let old: Option<Job> =
            sqlx::query_as("select * from job where id = $1 or (kind = $2 and idempotency_key = $3)")
                .bind(new.id)
                .bind(kind)
                .bind(&new.idempotency_key)
                .fetch_optional(&mut *tx)
                .await?;
        if let Some(old) = old {
            let same = old.kind == kind
                && old.acquisition_id == new.acquisition_id
                && old.model_id == model_id
                && old.threshold == threshold
                && old.live == live
                && old.from_m == from_m
                && old.to_m == to_m
                && old.further()? == further
                && (kind != "train" || Some(old.budget()?.unwrap_or_default()) == budget);
            return Ok(if same { Enqueued::Same(old) } else { Enqueued::Different(old) });
        }
        let Some((rope, state)) = rope_and_state(&mut tx, new.acquisition_id).await? else {
            return Ok(Enqueued::NoAcquisition(new.acquisition_id));
        };
        if state != "complete" && !live {
            return Ok(Enqueued::Incomplete(new.acquisition_id));
        }
        for &FurtherRange { acquisition_id: acquisition, .. } in further {
            match rope_and_state(&mut tx, acquisition).await? {
                None => return Ok(Enqueued::NoAcquisition(acquisition)),
                Some((other, _)) if other != rope => {
                    return Ok(Enqueued::AcquisitionOfAnotherRope { acquisition, other, rope });
                }
                Some((_, state)) if state != "complete" => return Ok(Enqueued::Incomplete(acquisition)),
                Some(_) => {}
            }
        }
        if let Some(model) = model_id {
            let model_rope: Option<Id> = sqlx::query_scalar("select rope_id from model where id = $1")
                .bind(model)
                .fetch_optional(&mut *tx)
                .await?;
            match model_rope {
                None => return Ok(Enqueued::NoModel),
                Some(model_rope) if model_rope != rope => {
                    return Ok(Enqueued::ModelOfAnotherRope { model_rope, rope });
                }
                Some(_) => {}
            }
        }
        let threshold_version = match (model_id, threshold) {
            (Some(model), None) => model_thresholds::current_version(&mut tx, model).await?,
            _ => None,
        };
        let job = sqlx::query_as(
            "insert into job (id, kind, rope_id, acquisition_id, model_id, threshold, threshold_version, from_m, to_m, idempotency_key,
               live, state, run_at_ms, created_at_ms, budget, further)
             values ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, 'queued', $12, $12, $13, $14) returning *",
        )
        .bind(new.id)
        .bind(kind)
        .bind(rope)
        .bind(new.acquisition_id)
        .bind(model_id)
        .bind(threshold)
        .bind(threshold_version)
        .bind(from_m)
        .bind(to_m)
        .bind(&new.idempotency_key)
        .bind(live)
        .bind(now_ms)
        .bind(budget.map(|b| serde_json::json!(b).to_string()))
        .bind((!further.is_empty()).then(|| serde_json::json!(further).to_string()))
        .fetch_one(&mut *tx)
        .await?;
        tx.commit().await?;
        Ok(Enqueued::New(job))
    }

    /// A job.
    pub async fn job(&self, id: Id) -> Result<Option<Job>, StoreError> {
        Ok(sqlx::query_as("select * from job where id = $1").bind(id).fetch_optional(self.reader()).await?)
    }

    /// Jobs, page by page; of one acquisition and in one state if asked.
    pub async fn jobs(
        &self,
        acquisition: Option<Id>,
        state: Option<&str>,
        page: PageRequest,
    ) -> Result<Page<Job>, StoreError> {
        let rows = sqlx::query_as(
            "select * from job where ($1 is null or id in (select job_id from job_acquisition where acquisition_id = $1)) and ($2 is null or state = $2) and seq < $3 order by seq desc limit $4",
        )
        .bind(acquisition)
        .bind(state)
        .bind(page.before_seq())
        .bind(page.fetch())
        .fetch_all(self.reader())
        .await?;
        Ok(page.page(rows, |j: &Job| j.seq))
    }

    /// Number of jobs that wait and that run.
    pub async fn job_counts(&self) -> Result<(i64, i64), StoreError> {
        Ok(sqlx::query_as(
            "select count(*) filter (where state = 'queued'), count(*) filter (where state = 'running') from job",
        )
        .fetch_one(self.reader())
        .await?)
    }

    /// Cancels a queued job at once, and asks the worker of a running one to stop.
    pub async fn cancel(&self, id: Id, now_ms: i64) -> Result<Cancellation, StoreError> {
        let mut tx = self.write().await?;
        sqlx::query(
            "update job set cancel_requested = 1,
               state = iif(state = 'queued', 'cancelled', state), finished_at_ms = iif(state = 'queued', $2, finished_at_ms)
             where id = $1 and state in ('queued', 'running')",
        )
        .bind(id)
        .bind(now_ms)
        .execute(&mut *tx)
        .await?;
        let job: Option<Job> =
            sqlx::query_as("select * from job where id = $1").bind(id).fetch_optional(&mut *tx).await?;
        tx.commit().await?;
        Ok(match job {
            None => Cancellation::Unknown,
            Some(job) if job.cancel_requested && job.state != "succeeded" && job.state != "failed" => {
                Cancellation::Accepted(job)
            }
            Some(job) => Cancellation::Ended(job),
        })
    }
}
