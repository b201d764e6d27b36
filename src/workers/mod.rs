//! Workers: claim a job, run it off the async threads, settle it.
//!
//! Jobs on open acquisitions have workers of their own: they wait for frames, perhaps for days, and keep what they have learnt of the
//! rope in memory meanwhile. So they hold up nobody else, and never begin anew because somebody else is waiting.

mod arriving;
pub mod engine;
mod failure;
mod preview;
pub mod results_folder;
mod run;
mod watch;

pub use engine::{Engine, Pipeline};
pub use run::Ended;

use crate::app::App;
use crate::store::StoreError;
use crate::store::leases::JobsOn;
use std::sync::Arc;
use tokio::sync::Notify;
use tokio_util::task::TaskTracker;

/// The workers of a process. Cheap to clone.
#[derive(Clone)]
pub struct Workers {
    app: App,
    owner: Arc<str>,
    engine: Arc<dyn Engine>,
}

impl Workers {
    /// Workers that sign their leases with `owner`, the instance of this process.
    pub fn new(app: App, owner: &str, engine: Arc<dyn Engine>) -> Self {
        Self { app, owner: owner.into(), engine }
    }

    /// Starts as many as the settings say.
    pub fn spawn(self, tasks: &TaskTracker) {
        let settings = &self.app.settings;
        for _ in 0..settings.workers {
            tasks.spawn(self.clone().work(JobsOn::CompleteAcquisitions, self.app.jobs_wake.clone()));
        }
        let live_jobs = if settings.workers == 0 { 0 } else { settings.live.jobs };
        for _ in 0..live_jobs {
            tasks.spawn(self.clone().work(JobsOn::OpenAcquisitions, self.app.live_jobs_wake.clone()));
        }
    }

    /// Runs the next job, if there is one that is due. `None`: nothing to do.
    async fn step(&self, jobs: JobsOn) -> Result<Option<Ended>, StoreError> {
        let reclaimed = self.app.store.reclaim(&self.owner).await?;
        if reclaimed > 0 {
            tracing::info!(jobs = reclaimed, "took over the jobs of a process that died");
        }
        let lease_ms = self.app.settings.lease.duration.as_millis() as i64;
        let claimed = self.app.store.claim(jobs, &self.owner, self.app.now_ms(), lease_ms).await?;
        let Some(job) = claimed else { return Ok(None) };
        tracing::info!(job = %job.id, kind = job.kind, attempt = job.attempts, "job started");
        let ended = run::run(&self.app, &self.engine, &job).await?;
        tracing::info!(job = %job.id, kind = job.kind, ?ended, "job ended");
        metrics::counter!("ropescope_job_attempts_total", "kind" => job.kind, "outcome" => outcome(&ended))
            .increment(1);
        Ok(Some(ended))
    }

    async fn work(self, jobs: JobsOn, wake: Arc<Notify>) {
        while !self.app.shutdown.is_cancelled() {
            match self.step(jobs).await {
                Ok(Some(_)) => continue,
                Ok(None) => {}
                Err(error) => tracing::error!(%error, "the queue could not be worked on"), // a full disk passes
            }
            tokio::select! {
                () = wake.notified() => {}
                () = tokio::time::sleep(self.app.settings.lease.poll) => {}
                () = self.app.shutdown.cancelled() => {}
            }
        }
    }
}

fn outcome(ended: &Ended) -> &'static str {
    match ended {
        Ended::Succeeded => "succeeded",
        Ended::Cancelled => "cancelled",
        Ended::HandedBack => "handed_back",
        Ended::Failed => "failed",
        Ended::LeaseLost => "lease_lost",
    }
}
