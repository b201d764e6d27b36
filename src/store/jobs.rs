//! Jobs as clients see them: look, cancel. How they are queued stands in [`super::enqueue`], what workers do with them in
//! [`super::leases`].

use super::enqueue::FurtherRange;
use super::{Id, Page, PageRequest, Store, StoreError};
use crate::pipeline::TrainOptions;
use serde::de::DeserializeOwned;

/// A job.
#[derive(Debug, Clone, PartialEq, sqlx::FromRow)]
#[expect(
    missing_docs,
    reason = "migrations/0003_jobs_and_tokens.sql, 0006_thresholds.sql, 0020_live.sql, 0030_previews.sql, 0031_levels.sql, \
              0040_several_acquisitions.sql and 0060_bandwidths.sql say what each column means"
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
    pub bandwidths: Option<String>,
}

impl Job {
    /// What was chosen for a training; what was not, as it is chosen now.
    pub fn options(&self) -> Result<TrainOptions, StoreError> {
        Ok(TrainOptions {
            budget: self.read("budget", self.budget.as_deref())?.unwrap_or_default(),
            bandwidths: self.read("bandwidths", self.bandwidths.as_deref())?.unwrap_or_default(),
        })
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

impl Store {
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
