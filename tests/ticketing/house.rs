//! A store with defects in it, a receiver that misbehaves on order, and a dispatcher whose clock only moves when told to.

use axum::body::Bytes;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use rand::SeedableRng;
use ropescope::clock::{Clock, ManualClock};
use ropescope::store::defects::{Judged, Verdict};
use ropescope::store::webhook_endpoints::NewEndpoint;
use ropescope::store::{Id, PageRequest, Store};
use ropescope::ticketing::{Dispatcher, Settings, send};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use uuid::Uuid;

/// Signing accepts timestamps near the real time only, so the tests start there and move their own clock on from it.
fn start_ms() -> i64 {
    std::time::UNIX_EPOCH.elapsed().unwrap().as_millis() as i64
}

/// What the receiver does with a request.
#[derive(Debug, Clone)]
pub enum Mood {
    Accept,
    Fail(u16),
    FailFor(u16, &'static str),
    Redirect(String),
    Stall,
}

/// A request as it came in.
pub struct Received {
    pub headers: HeaderMap,
    pub body: Bytes,
}

impl Received {
    pub fn header(&self, name: &str) -> String {
        self.headers[name].to_str().unwrap().to_owned()
    }

    pub fn json(&self) -> serde_json::Value {
        serde_json::from_slice(&self.body).unwrap()
    }
}

#[derive(Default)]
struct Inner {
    moods: Mutex<VecDeque<Mood>>,
    received: Mutex<Vec<Received>>,
}

/// A real HTTP receiver on a free port. Moods are used up in order; afterwards it accepts.
pub struct Receiver {
    pub url: String,
    inner: Arc<Inner>,
}

impl Receiver {
    pub async fn start(moods: impl IntoIterator<Item = Mood>) -> Self {
        let inner = Arc::new(Inner { moods: Mutex::new(moods.into_iter().collect()), ..Inner::default() });
        let router = axum::Router::new().fallback(answer).with_state(Arc::clone(&inner));
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let url = format!("http://{}/hook", listener.local_addr().unwrap());
        tokio::spawn(async move { axum::serve(listener, router).await.unwrap() });
        Self { url, inner }
    }

    pub fn take(&self) -> Vec<Received> {
        std::mem::take(&mut *self.inner.received.lock().unwrap())
    }
}

async fn answer(State(inner): State<Arc<Inner>>, headers: HeaderMap, body: Bytes) -> Response {
    inner.received.lock().unwrap().push(Received { headers, body });
    let mood = inner.moods.lock().unwrap().pop_front().unwrap_or(Mood::Accept);
    match mood {
        Mood::Accept => StatusCode::NO_CONTENT.into_response(),
        Mood::Fail(status) => (StatusCode::from_u16(status).unwrap(), "out of order").into_response(),
        Mood::FailFor(status, retry_after) => {
            (StatusCode::from_u16(status).unwrap(), [("retry-after", retry_after)]).into_response()
        }
        Mood::Redirect(to) => (StatusCode::TEMPORARY_REDIRECT, [("location", to)]).into_response(),
        Mood::Stall => {
            tokio::time::sleep(Duration::from_secs(60)).await;
            StatusCode::OK.into_response()
        }
    }
}

/// A store with one inspected rope.
pub struct House {
    pub store: Store,
    pub clock: Arc<ManualClock>,
    pub inspection: Id,
    folder: tempfile::TempDir,
}

impl House {
    pub async fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).await.unwrap();
        let inspection = Id(Uuid::from_u128(5));
        let id = |n: u128| Id(Uuid::from_u128(n)).to_string();
        let rows = format!(
            "insert into ropeway (id, name, created_at_ms) values ('{0}', 'North', 0);
             insert into rope (id, ropeway_id, name, strands, wires_per_strand, rope_diameter_mm, created_at_ms)
                 values ('{1}', '{0}', 'track rope 1', 6, 9, 32, 0);
             insert into acquisition (id, rope_id, line_pitch_mm, sensor_px, start_m, state, created_at_ms)
                 values ('{2}', '{1}', 0.1, 480, 0, 'complete', 0);
             insert into job (id, kind, rope_id, acquisition_id, state, run_at_ms, created_at_ms)
                 values ('{3}', 'inspect', '{1}', '{2}', 'succeeded', 0, 0);
             insert into inspection (id, rope_id, acquisition_id, job_id, summary, created_at_ms)
                 values ('{inspection}', '{1}', '{2}', '{3}', '{{}}', 0);",
            id(1),
            id(2),
            id(3),
            id(4),
        );
        let mut tx = store.write().await.unwrap();
        sqlx::raw_sql(sqlx::AssertSqlSafe(rows)).execute(&mut *tx).await.unwrap();
        tx.commit().await.unwrap();
        Self { store, clock: Arc::new(ManualClock::at(start_ms())), inspection, folder }
    }

    /// The same data after the process has died: everything in memory is gone.
    pub async fn reopened(self) -> Self {
        self.store.close().await;
        Self { store: Store::open(self.folder.path()).await.unwrap(), ..self }
    }

    /// Adds an open defect.
    pub async fn defect(&self, number: u128) -> Id {
        let id = Id(Uuid::from_u128(1000 + number));
        let mut tx = self.store.write().await.unwrap();
        sqlx::query(
            "insert into defect (id, inspection_id, rope_id, number, from_m, to_m, strand, wire, peak_score, alarms, state, created_at_ms)
             select $1, id, rope_id, $3, 1.0, 1.1, 2, 4, 8.5,
                    '[{\"view\":1,\"first_line\":10000,\"last_line\":11000,\"first_column\":5,\"last_column\":9,\"peak_score\":8.5}]', 'open', 0
             from inspection where id = $2",
        )
        .bind(id)
        .bind(self.inspection)
        .bind(number as i64)
        .execute(&mut *tx)
        .await
        .unwrap();
        tx.commit().await.unwrap();
        id
    }

    pub async fn confirm(&self, defect: Id) -> Judged {
        let verdict = Verdict { confirmed: true, by: "A. Inspector".into(), comment: None };
        self.store.judge(defect, &verdict, self.clock.now_ms()).await.unwrap()
    }

    pub async fn endpoint(&self, url: &str) -> NewEndpoint {
        self.endpoint_with(url, true).await
    }

    pub async fn endpoint_with(&self, url: &str, allow_private: bool) -> NewEndpoint {
        let n = self.store.endpoints(all()).await.unwrap().items.len() as u128;
        let new = NewEndpoint {
            id: Id(Uuid::from_u128(500 + n)),
            url: url.into(),
            secret: send::secret([7; 32]),
            allow_private,
            enabled: true,
        };
        self.store.add_endpoint(&new, self.clock.now_ms()).await.unwrap().expect("the id is free");
        new
    }

    pub fn dispatcher(&self) -> Dispatcher {
        self.dispatcher_with(|_| {})
    }

    pub fn dispatcher_with(&self, change: impl Fn(&mut Settings)) -> Dispatcher {
        let mut settings = Settings::new("https://ropes.example/");
        settings.timeout = Duration::from_millis(800);
        change(&mut settings);
        Dispatcher::new(
            self.store.clone(),
            Arc::clone(&self.clock) as _,
            settings,
            rand_chacha::ChaCha8Rng::seed_from_u64(1),
        )
    }

    /// States of all deliveries, newest first.
    pub async fn states(&self) -> Vec<String> {
        self.store.deliveries(None, all()).await.unwrap().items.into_iter().map(|d| d.state).collect()
    }
}

pub fn all() -> PageRequest {
    PageRequest { before: None, limit: 200 }
}
