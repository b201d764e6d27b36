//! Progress of a job as server-sent events, and what it finds on the way. Read from the database, so that it works whichever process
//! runs the job.

use super::extract::Path;
use super::job::Job;
use super::problem::ReadProblems;
use super::{Problem, provisional};
use crate::app::App;
use crate::store::{Id, jobs};
use axum::extract::State;
use axum::response::IntoResponse;
use axum::response::sse::{Event, KeepAlive, Sse};
use futures::Stream;
use std::collections::VecDeque;
use std::convert::Infallible;
use std::time::Duration;
use tokio::sync::watch::Receiver;
use utoipa::ToSchema;
use uuid::Uuid;

/// Longest time between two looks at the job: what another process finds is not heard here.
const LOOK: Duration = Duration::from_millis(400);
/// Shortest time between two looks, however much is found.
const REST: Duration = Duration::from_millis(20);

/// An event of the stream, for the contract.
#[derive(ToSchema)]
pub struct JobEvent {
    /// `progress`, `provisional-lay-lengths`, `provisional-defects`, or `end` as the last one.
    #[expect(dead_code, reason = "only its schema is used")]
    event: String,
    /// The job, or what was found since the last event of the kind, as JSON.
    #[expect(dead_code, reason = "only its schema is used")]
    data: String,
}

/// What a client was told.
struct Watching {
    app: App,
    id: Id,
    /// Jobs of this process have found something.
    news: Receiver<()>,
    told: String,
    /// The run whose findings were told.
    run: i64,
    after_line: Option<u64>,
    after_seq: i64,
    queue: VecDeque<Event>,
    ended: bool,
}

/// Progress of a job: an event `progress` with the job whenever it changes, then one event `end`
///
/// What a running inspection has found so far comes between: `provisional-lay-lengths` with the stretches that are new (fused over all
/// views), `provisional-defects` with those that are new or have changed; they replace all from their first number on.
/// When `run` has grown, the job was started again and everything that was told before holds no more.
#[utoipa::path(get, path = "/jobs/{id}/events", tag = "jobs", params(("id" = Uuid, Path, description = "The job")),
    responses((status = 200, description = "Server-sent events; the data of `progress` and `end` is the job", body = JobEvent, content_type = "text/event-stream"), ReadProblems))]
pub async fn get_job_events(State(app): State<App>, Path(id): Path<Uuid>) -> Result<impl IntoResponse, Problem> {
    let job = app.store.job(Id(id)).await?.ok_or_else(|| Problem::no("job", id))?;
    let watching = Watching {
        news: app.store.findings(),
        app,
        id: job.id,
        told: String::new(),
        run: job.lease_token,
        after_line: None,
        after_seq: 0,
        queue: VecDeque::new(),
        ended: false,
    };
    Ok(Sse::new(events(watching)).keep_alive(KeepAlive::default()))
}

fn events(watching: Watching) -> impl Stream<Item = Result<Event, Infallible>> {
    futures::stream::unfold(watching, |mut watching| async move {
        loop {
            if let Some(event) = watching.queue.pop_front() {
                return Some((Ok(event), watching));
            }
            if watching.ended {
                return None;
            }
            // A job that cannot be read any more ends the stream; the client asks again and gets the problem.
            watching.look().await?;
            if watching.queue.is_empty() {
                tokio::time::sleep(REST).await;
                tokio::select! {
                    () = tokio::time::sleep(LOOK) => {}
                    _ = watching.news.changed() => {}
                    () = watching.app.shutdown.cancelled() => return None, // the client comes back to the next process
                }
            }
        }
    })
}

impl Watching {
    /// Queues what is new. `None` if that cannot be known.
    async fn look(&mut self) -> Option<()> {
        let row = self.app.store.job(self.id).await.ok()??;
        if row.lease_token != self.run {
            (self.run, self.after_line, self.after_seq) = (row.lease_token, None, 0);
        }
        if provisional::last(&row) {
            self.look_for_findings(&row).await?;
        }
        self.ended = row.ended();
        let json = serde_json::to_string(&Job::try_from(row).ok()?).ok()?;
        if json != self.told {
            self.queue.push_back(Event::default().event("progress").data(&json));
            self.told = json;
        }
        if self.ended {
            self.queue.push_back(Event::default().event("end").data(&self.told));
        }
        Some(())
    }

    async fn look_for_findings(&mut self, job: &jobs::Job) -> Option<()> {
        let found = provisional::lay_lengths(&self.app, job, None, self.after_line).await.ok()?;
        if let Some(line) = found.rows.last().map(|row| row.first_line as u64) {
            self.after_line = Some(line);
            let data = serde_json::to_string(&found).ok()?;
            self.queue.push_back(Event::default().event("provisional-lay-lengths").data(data));
        }
        let (seq, found) = provisional::defects(&self.app, job, self.after_seq).await.ok()?;
        if !found.defects.is_empty() {
            self.after_seq = seq;
            let data = serde_json::to_string(&found).ok()?;
            self.queue.push_back(Event::default().event("provisional-defects").data(data));
        }
        Some(())
    }
}
