//! Jobs as workers see them: claim with a lease, keep it alive, settle once.
//!
//! A claim hands out a fencing token. Every later write names it and only succeeds while the job is running under that very
//! token, so a worker that slept through its lease (a *zombie*) can do no harm: its writes find no row.

use super::jobs::Job;
use super::{Id, Store, StoreError};
use serde::Deserialize;
use serde_json::json;
use sqlx::SqliteConnection;

/// Claims after which a job is given up: a job that kills its process must not do so forever.
pub const MAX_ATTEMPTS: u32 = 4;
/// Wait before the second, third, .. attempt, in ms.
const BACK_OFF_MS: [i64; 3] = [5_000, 30_000, 120_000];

/// What a worker says of its job, and hears back.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Heartbeat {
    /// How far it is; `None` before the first report.
    pub reached: Option<Reached>,
    /// The frame that it waits for, if it does.
    pub waiting_for: Option<WaitingFor>,
}

/// How far a job is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reached {
    /// What is being done.
    pub stage: &'static str,
    /// Metres of rope done in the stage.
    pub done_m: f64,
    /// Metres of rope in the stage.
    pub total_m: f64,
    /// Speed of the stage so far.
    pub metres_per_second: Option<f64>,
}

/// A frame that a job waits for.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub struct WaitingFor {
    /// The view.
    pub view: u32,
    /// Number of the frame.
    pub frame: u32,
    /// Since when, ms since 1970.
    pub since_ms: i64,
}

/// Which jobs a worker takes. Those that wait for frames have workers of their own, so that no other job waits with them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JobsOn {
    /// Those on complete acquisitions.
    CompleteAcquisitions,
    /// Those on acquisitions that are still open.
    OpenAcquisitions,
}

/// The answer to a heartbeat or to an attempt to settle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lease {
    /// Still ours; go on.
    Held,
    /// Still ours, but somebody wants the job to stop.
    CancelRequested,
    /// Not ours any more: the lease ran out and somebody else has the job, or it ended.
    Lost,
}

impl Store {
    /// Claims the next job of this kind that is due, or whose lease ran out. `None`: nothing to do.
    pub async fn claim(
        &self,
        jobs: JobsOn,
        owner: &str,
        now_ms: i64,
        lease_ms: i64,
    ) -> Result<Option<Job>, StoreError> {
        let mut tx = self.write().await?;
        // A job that was claimed too often without an end, and one whose cancellation nobody lived to carry out.
        sqlx::query(
            "update job set state = iif(cancel_requested = 1, 'cancelled', 'failed'), finished_at_ms = $1, lease_owner = null, lease_until_ms = null,
               error = iif(cancel_requested = 1, null, coalesce(error, json_object('type', '/problems/job-gave-up', 'title', 'The job was given up',
                 'detail', 'the process that ran the job ended ' || attempts || ' times before the job did')))
             where (state = 'queued' or (state = 'running' and lease_until_ms < $1)) and (attempts >= $2 or cancel_requested = 1)",
        )
        .bind(now_ms)
        .bind(MAX_ATTEMPTS)
        .execute(&mut *tx)
        .await?;
        let job = sqlx::query_as(
            "update job set state = 'running', lease_owner = $1, lease_token = lease_token + 1, lease_until_ms = $2 + $3,
               attempts = attempts + 1, started_at_ms = coalesce(started_at_ms, $2),
               stage = null, done_m = null, total_m = null, metres_per_second = null, waiting_for = null
             where seq = (select j.seq from job j join acquisition a on a.id = j.acquisition_id
               where ((j.state = 'queued' and j.run_at_ms <= $2) or (j.state = 'running' and j.lease_until_ms < $2)) and a.state = $4
               order by j.run_at_ms, j.seq limit 1)
             returning *",
        )
        .bind(owner)
        .bind(now_ms)
        .bind(lease_ms)
        .bind(match jobs {
            JobsOn::CompleteAcquisitions => "complete",
            JobsOn::OpenAcquisitions => "open",
        })
        .fetch_optional(&mut *tx)
        .await?;
        tx.commit().await?;
        Ok(job)
    }

    /// Queues the running jobs of processes that are dead, without waiting for their leases. Returns how many.
    pub async fn reclaim(&self, own: &str) -> Result<u64, StoreError> {
        let owners: Vec<String> = sqlx::query_scalar(
            "select distinct lease_owner from job where state = 'running' and lease_owner is not null",
        )
        .fetch_all(self.reader())
        .await?;
        let mut reclaimed = 0;
        for owner in owners {
            if owner == own || self.folder().alive(&owner) {
                continue;
            }
            let mut tx = self.write().await?;
            reclaimed += sqlx::query(
                "update job set state = 'queued', lease_owner = null, lease_until_ms = null where state = 'running' and lease_owner = $1",
            )
            .bind(&owner)
            .execute(&mut *tx)
            .await?
            .rows_affected();
            tx.commit().await?;
        }
        Ok(reclaimed)
    }

    /// Renews the lease and records progress. A job that has come to wait for frames has survived all that are there: its earlier
    /// attempts do not count any more, or one that waits for days would be given up with its fourth power cut.
    pub async fn heartbeat(
        &self,
        job: Id,
        token: i64,
        beat: &Heartbeat,
        lease_until_ms: i64,
    ) -> Result<Lease, StoreError> {
        let mut tx = self.write().await?;
        let waiting_for =
            beat.waiting_for.map(|w| json!({ "view": w.view, "frame": w.frame, "since_ms": w.since_ms }).to_string());
        let cancel: Option<bool> = sqlx::query_scalar(
            "update job set lease_until_ms = $3, stage = coalesce($4, stage), done_m = coalesce($5, done_m),
               total_m = coalesce($6, total_m), metres_per_second = coalesce($7, metres_per_second),
               waiting_for = $8, attempts = iif($8 is null, attempts, 1)
             where id = $1 and lease_token = $2 and state = 'running' returning cancel_requested",
        )
        .bind(job)
        .bind(token)
        .bind(lease_until_ms)
        .bind(beat.reached.map(|r| r.stage))
        .bind(beat.reached.map(|r| r.done_m))
        .bind(beat.reached.map(|r| r.total_m))
        .bind(beat.reached.and_then(|r| r.metres_per_second))
        .bind(waiting_for)
        .fetch_optional(&mut *tx)
        .await?;
        tx.commit().await?;
        Ok(match cancel {
            None => Lease::Lost,
            Some(true) => Lease::CancelRequested,
            Some(false) => Lease::Held,
        })
    }

    /// Gives a job back unfinished, because the process shuts down. It does not count as an attempt.
    pub async fn hand_back(&self, job: Id, token: i64) -> Result<Lease, StoreError> {
        let mut tx = self.write().await?;
        let rows = sqlx::query(
            "update job set state = 'queued', attempts = attempts - 1, lease_owner = null, lease_until_ms = null
             where id = $1 and lease_token = $2 and state = 'running'",
        )
        .bind(job)
        .bind(token)
        .execute(&mut *tx)
        .await?
        .rows_affected();
        tx.commit().await?;
        Ok(held(rows))
    }

    /// Ends a job as cancelled.
    pub async fn settle_cancelled(&self, job: Id, token: i64, now_ms: i64) -> Result<Lease, StoreError> {
        let mut tx = self.write().await?;
        let rows = settle(&mut tx, job, token, "cancelled", None, None, now_ms).await?;
        tx.commit().await?;
        Ok(held(rows))
    }

    /// Records a failed attempt. `error` is a problem as JSON. With `retry`, the job waits for its next attempt while it has one.
    pub async fn settle_failed(
        &self,
        job: Id,
        token: i64,
        error: &str,
        retry: bool,
        now_ms: i64,
    ) -> Result<Lease, StoreError> {
        let mut tx = self.write().await?;
        let attempts: u32 =
            sqlx::query_scalar("select attempts from job where id = $1").bind(job).fetch_one(&mut *tx).await?;
        let rows = if retry && attempts < MAX_ATTEMPTS {
            let wait_ms = BACK_OFF_MS[(attempts.max(1) as usize - 1).min(BACK_OFF_MS.len() - 1)];
            sqlx::query(
                "update job set state = 'queued', run_at_ms = $4, error = $3, lease_owner = null, lease_until_ms = null
                 where id = $1 and lease_token = $2 and state = 'running'",
            )
            .bind(job)
            .bind(token)
            .bind(error)
            .bind(now_ms + wait_ms)
            .execute(&mut *tx)
            .await?
            .rows_affected()
        } else {
            settle(&mut tx, job, token, "failed", None, Some(error), now_ms).await?
        };
        tx.commit().await?;
        Ok(held(rows))
    }
}

/// Ends a job if the token still holds it; returns 1 if so, else 0. First statement of every settling transaction.
pub(super) async fn settle(
    connection: &mut SqliteConnection,
    job: Id,
    token: i64,
    state: &str,
    result: Option<Id>,
    error: Option<&str>,
    now_ms: i64,
) -> Result<u64, StoreError> {
    Ok(sqlx::query(
        "update job set state = $3, result_id = $4, error = $5, finished_at_ms = $6, lease_owner = null, lease_until_ms = null,
           done_m = iif($3 = 'succeeded', total_m, done_m)
         where id = $1 and lease_token = $2 and state = 'running'",
    )
    .bind(job)
    .bind(token)
    .bind(state)
    .bind(result)
    .bind(error)
    .bind(now_ms)
    .execute(connection)
    .await?
    .rows_affected())
}

fn held(rows: u64) -> Lease {
    if rows == 1 { Lease::Held } else { Lease::Lost }
}
