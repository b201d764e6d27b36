//! Progress of a job as server-sent events. Read from the database, so that it works whichever process runs the job.

use super::Problem;
use super::extract::Path;
use super::jobs::Job;
use super::problem::ReadProblems;
use crate::app::App;
use crate::store::Id;
use axum::extract::State;
use axum::response::IntoResponse;
use axum::response::sse::{Event, KeepAlive, Sse};
use futures::Stream;
use std::convert::Infallible;
use std::time::Duration;
use utoipa::ToSchema;
use uuid::Uuid;

/// Time between two looks at the job.
const LOOK: Duration = Duration::from_millis(400);

/// An event of the stream, for the contract.
#[derive(ToSchema)]
pub struct JobEvent {
    /// `progress`, or `end` as the last one.
    #[expect(dead_code, reason = "only its schema is used")]
    event: String,
    /// The job as JSON.
    #[expect(dead_code, reason = "only its schema is used")]
    data: String,
}

struct Watching {
    app: App,
    id: Id,
    sent: String,
    ended: bool,
    closed: bool,
}

/// Progress of a job: an event `progress` with the job whenever it changes, then one event `end`
#[utoipa::path(get, path = "/jobs/{id}/events", tag = "jobs", params(("id" = Uuid, Path, description = "The job")),
    responses((status = 200, description = "Server-sent events; the data of `progress` and `end` is the job", body = JobEvent, content_type = "text/event-stream"), ReadProblems))]
pub async fn get_job_events(State(app): State<App>, Path(id): Path<Uuid>) -> Result<impl IntoResponse, Problem> {
    app.store.job(Id(id)).await?.ok_or_else(|| Problem::no("job", id))?;
    let watching = Watching { app, id: Id(id), sent: String::new(), ended: false, closed: false };
    Ok(Sse::new(events(watching)).keep_alive(KeepAlive::default()))
}

fn events(watching: Watching) -> impl Stream<Item = Result<Event, Infallible>> {
    futures::stream::unfold(watching, |mut watching| async move {
        if watching.closed {
            return None;
        }
        if watching.ended {
            watching.closed = true;
            return Some((Ok(Event::default().event("end").data(&watching.sent)), watching));
        }
        loop {
            // A job that cannot be read any more ends the stream; the client asks again and gets the problem.
            let row = watching.app.store.job(watching.id).await.ok()??;
            let ended = row.ended();
            let json = serde_json::to_string(&Job::try_from(row).ok()?).ok()?;
            if json != watching.sent {
                watching.sent = json;
                watching.ended = ended;
                return Some((Ok(Event::default().event("progress").data(&watching.sent)), watching));
            }
            tokio::select! {
                () = tokio::time::sleep(LOOK) => {}
                () = watching.app.shutdown.cancelled() => return None, // the client comes back to the next process
            }
        }
    })
}
