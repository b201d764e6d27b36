//! HTTP to a service, over links that come and go: what can be repeated is repeated until it works or patience ends.

pub use super::client_error::ClientError;
use super::client_error::{Failure, innermost};
use super::pace::{Motion, Pace};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use reqwest::{Method, header};
use serde_json::Value;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Waits between tries double from the first to the second of these.
const FIRST_WAIT: Duration = Duration::from_millis(300);
const LONGEST_WAIT: Duration = Duration::from_secs(30);
/// A request that neither takes nor gives a byte for this long is given up: the link is dead, and only the client knows.
pub const SILENCE: Duration = Duration::from_secs(20);
/// After a silence the same request is given twice the time, up to so many times the first: perhaps the link is only thin.
const LONGEST_SILENCE: u32 = 8;
const CONNECT: Duration = Duration::from_secs(10);

/// Hears why a request did not succeed, and how long the client waits before the next try.
type OnWait = Arc<dyn Fn(&str, Duration) + Send + Sync>;

/// A service and the right to use it. Cheap to clone.
#[derive(Clone)]
pub struct Client {
    pace: Pace,
    silence: Duration,
    on_wait: OnWait,
    http: reqwest::Client,
    base: String,
    patience: Duration,
    rng: Arc<Mutex<ChaCha8Rng>>,
}

/// A good answer.
#[derive(Debug, Clone)]
pub struct Reply {
    /// The status.
    pub status: u16,
    /// The body.
    pub body: bytes::Bytes,
}

impl Client {
    /// `server` such as `http://127.0.0.1:8080`; a request is repeated for `patience`; `seed` is for the jitter of the waits.
    pub fn new(server: &str, token: &str, patience: Duration, seed: u64) -> Result<Self, ClientError> {
        let bad = |reason: &str| ClientError::Server { url: server.into(), reason: reason.into() };
        let url = reqwest::Url::parse(server).map_err(|e| bad(&e.to_string()))?;
        if !matches!(url.scheme(), "http" | "https") {
            return Err(bad("the scheme must be http or https"));
        }
        let mut bearer =
            header::HeaderValue::try_from(format!("Bearer {}", token.trim())).map_err(|_| ClientError::Token)?;
        bearer.set_sensitive(true);
        let mut builder = reqwest::Client::builder()
            .default_headers(header::HeaderMap::from_iter([(header::AUTHORIZATION, bearer)]))
            .redirect(reqwest::redirect::Policy::none()) // the token must not travel on
            .connect_timeout(CONNECT)
            .user_agent(concat!("ropescope/", env!("CARGO_PKG_VERSION")));
        let host = url.host_str().unwrap_or_default();
        if host == "localhost" || host.parse::<std::net::IpAddr>().is_ok_and(|ip| ip.is_loopback()) {
            builder = builder.no_proxy(); // a proxy's loopback is not ours
        }
        crate::tls::install();
        Ok(Self {
            pace: Pace::new(None),
            silence: SILENCE,
            on_wait: Arc::new(|_, _| {}),
            http: builder.build().map_err(ClientError::Setup)?,
            base: format!("{}/api/v1", server.trim_end_matches('/')),
            patience,
            rng: Arc::new(Mutex::new(ChaCha8Rng::seed_from_u64(seed))),
        })
    }

    /// Bodies go out at this speed at most, in bytes a second over all connections.
    pub fn limited_to(self, bytes_per_second: f64) -> Self {
        Self { pace: Pace::new(Some(bytes_per_second)), ..self }
    }

    /// Gives up a request that has not moved for so long, instead of [`SILENCE`].
    pub fn patient_for(self, silence: Duration) -> Self {
        Self { silence, ..self }
    }

    /// Tells `on_wait`, too, of failures that will be tried again.
    pub fn telling(self, on_wait: impl Fn(&str, Duration) + Send + Sync + 'static) -> Self {
        let others = Arc::clone(&self.on_wait);
        let on_wait = move |last: &str, wait| {
            others(last, wait);
            on_wait(last, wait);
        };
        Self { on_wait: Arc::new(on_wait), ..self }
    }

    /// Fetches JSON from `path` (below `/api/v1`).
    pub async fn get(&self, path: &str) -> Result<Value, ClientError> {
        self.json(Method::GET, path, None).await
    }

    /// Fetches bytes.
    pub async fn get_bytes(&self, path: &str) -> Result<bytes::Bytes, ClientError> {
        Ok(self.send(Method::GET, path, &[], bytes::Bytes::new()).await?.body)
    }

    /// Puts JSON. Repeated on failure, as every PUT may be.
    pub async fn put(&self, path: &str, body: &Value) -> Result<Value, ClientError> {
        self.json(Method::PUT, path, Some(body)).await
    }

    /// Posts JSON. Repeated on failure: only for requests that the service recognises when they come twice.
    pub async fn post(&self, path: &str, body: &Value) -> Result<Value, ClientError> {
        self.json(Method::POST, path, Some(body)).await
    }

    async fn json(&self, method: Method, path: &str, body: Option<&Value>) -> Result<Value, ClientError> {
        let what = format!("{method} {path}");
        let bytes = body.map_or_else(bytes::Bytes::new, |b| bytes::Bytes::from(b.to_string()));
        let headers: &[(&str, String)] =
            if body.is_some() { &[("content-type", "application/json".to_owned())] } else { &[] };
        let reply = self.send(method, path, headers, bytes).await?;
        serde_json::from_slice(&reply.body).map_err(|e| ClientError::Answer { what, reason: e.to_string() })
    }

    /// Sends a request until it succeeds, is refused for good, or patience ends. The body must be repeatable, so it is in memory.
    pub async fn send(
        &self,
        method: Method,
        path: &str,
        headers: &[(&str, String)],
        body: bytes::Bytes,
    ) -> Result<Reply, ClientError> {
        let what = format!("{method} {path}");
        let reply = self.send_unless(method, path, headers, body, async || false).await?;
        reply.ok_or_else(|| ClientError::Answer { what, reason: "there is none".into() })
    }

    /// Like [`Self::send`], but asks `settled` before every further try: a request whose answer was lost need not be repeated.
    /// `None`: it was settled so.
    pub async fn send_unless(
        &self,
        method: Method,
        path: &str,
        headers: &[(&str, String)],
        body: bytes::Bytes,
        settled: impl AsyncFn() -> bool,
    ) -> Result<Option<Reply>, ClientError> {
        let what = format!("{method} {path}");
        let begun = Instant::now();
        let (mut tries, mut silence) = (0, self.silence);
        loop {
            let motion = Motion::begin();
            let answer = tokio::select! {
                answer = self.once(method.clone(), path, headers, body.clone(), &motion) => Some(answer),
                () = motion.rests(silence) => None,
            };
            let (last, asked, status) = match answer {
                Some(Ok(Ok(reply))) => return Ok(Some(reply)),
                Some(Ok(Err(failure))) if !failure.temporary() => return Err(failure.refused(what)),
                Some(Ok(Err(failure))) => (
                    format!("{}: {}", failure.status, failure.said()),
                    failure.retry_after,
                    Some(failure.status.as_u16()),
                ),
                Some(Err(error)) => (innermost(&error), None, None),
                None => {
                    let last = format!("the link was silent for {} s", silence.as_secs());
                    silence = (silence * 2).min(self.silence * LONGEST_SILENCE);
                    (last, None, None)
                }
            };
            tries += 1;
            let wait = self.wait(tries, asked);
            if begun.elapsed() + wait > self.patience {
                let tried_s = begun.elapsed().as_secs_f64();
                return Err(ClientError::Unreachable { what, tried_s, tries, last, status });
            }
            (self.on_wait)(&last, wait);
            tracing::debug!(what, last, wait_s = wait.as_secs_f64(), "trying again");
            tokio::time::sleep(wait).await;
            if settled().await {
                return Ok(None);
            }
        }
    }

    /// Posts JSON, once: `None` if that failed in whatever way.
    pub async fn try_post(&self, path: &str, body: &Value) -> Option<Value> {
        let headers = [("content-type", "application/json".to_owned())];
        let motion = Motion::begin();
        let body = bytes::Bytes::from(body.to_string());
        let answer = tokio::select! {
            answer = self.once(Method::POST, path, &headers, body, &motion) => answer.ok()?.ok()?,
            () = motion.rests(self.silence) => return None,
        };
        serde_json::from_slice(&answer.body).ok()
    }

    async fn once(
        &self,
        method: Method,
        path: &str,
        headers: &[(&str, String)],
        body: bytes::Bytes,
        motion: &Motion,
    ) -> reqwest::Result<Result<Reply, Failure>> {
        let mut request = self.http.request(method, format!("{}{path}", self.base));
        if !body.is_empty() {
            let length = body.len();
            let body = reqwest::Body::wrap_stream(self.pace.body(body, motion.clone()));
            request = request.header(header::CONTENT_LENGTH, length).body(body);
        }
        for (name, value) in headers {
            request = request.header(*name, value);
        }
        let mut response = request.send().await?;
        let status = response.status();
        let retry_after = response.headers().get("retry-after").and_then(|v| v.to_str().ok()?.parse().ok());
        let mut body = bytes::BytesMut::new();
        while let Some(piece) = response.chunk().await? {
            motion.moved();
            body.extend_from_slice(&piece);
        }
        let body = body.freeze();
        Ok(if status.is_success() {
            Ok(Reply { status: status.as_u16(), body })
        } else {
            Err(Failure { status, retry_after: retry_after.map(Duration::from_secs), body })
        })
    }

    /// Wait after `tries` failures: doubling, between half and all of it, not less than the service asked for.
    fn wait(&self, tries: u32, asked: Option<Duration>) -> Duration {
        let longest = FIRST_WAIT.saturating_mul(1 << tries.min(10)).min(LONGEST_WAIT);
        let share = match self.rng.lock() {
            Ok(mut rng) => rng.random_range(0.5..=1.0),
            Err(_) => 1.0, // another thread panicked: any wait will do
        };
        longest.mul_f64(share).max(asked.unwrap_or_default())
    }
}
