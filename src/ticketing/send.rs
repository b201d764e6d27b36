//! One attempt: sign, connect to a checked address, post, judge the answer.

use super::guard::{self, GuardError, Resolver};
use super::{event, schedule};
use reqwest::StatusCode;
use std::time::Duration;

/// Longest attempt, connection included.
pub const TIMEOUT: Duration = Duration::from_secs(15);
/// Most bytes of an answer that are read; it only serves the log.
const MAX_REPLY_BYTES: usize = 4096;
/// Most characters of an answer that are logged.
const LOGGED_CHARS: usize = 300;

/// What is sent where.
#[derive(Debug, Clone)]
pub struct Message<'a> {
    /// The receiver.
    pub url: &'a str,
    /// `whsec_...`.
    pub secret: &'a str,
    /// May the address be private?
    pub allow_private: bool,
    /// `webhook-id`.
    pub id: &'a str,
    /// CloudEvents JSON.
    pub body: String,
}

/// What came of an attempt.
#[derive(Debug, Clone, PartialEq)]
pub enum Answer {
    /// 2xx.
    Accepted {
        /// The status.
        status: u16,
    },
    /// 410: nobody wants these any more.
    Gone,
    /// Another status.
    Refused {
        /// The status.
        status: u16,
        /// What the receiver asks us to wait.
        retry_after: Option<Duration>,
        /// Beginning of what it said.
        said: String,
    },
    /// No answer.
    Unreachable {
        /// Why, as a sentence.
        reason: String,
    },
}

/// Why there was not even an attempt at the network.
#[derive(Debug, thiserror::Error)]
enum SendError {
    #[error(transparent)]
    Guard(#[from] GuardError),
    #[error("the signing secret of the endpoint is not usable: {0}")]
    Secret(#[from] standardwebhooks::WebhookError),
    #[error("{}", innermost(.0))]
    Http(#[from] reqwest::Error),
}

/// reqwest wraps causes several times; the innermost says what happened.
fn innermost(error: &reqwest::Error) -> String {
    if error.is_timeout() {
        return format!("no answer within {} s", TIMEOUT.as_secs());
    }
    let mut cause: &dyn std::error::Error = error;
    while let Some(source) = cause.source() {
        cause = source;
    }
    cause.to_string()
}

/// Makes one attempt at `now_ms` (ms since 1970), which also is the signed timestamp.
pub async fn attempt(message: &Message<'_>, now_ms: i64, timeout: Duration, resolver: &Resolver) -> Answer {
    match tokio::time::timeout(timeout, post(message, now_ms, timeout, resolver)).await {
        Ok(Ok(answer)) => answer,
        Ok(Err(error)) => Answer::Unreachable { reason: error.to_string() },
        Err(_) => Answer::Unreachable { reason: format!("no answer within {} s", timeout.as_secs_f64()) },
    }
}

async fn post(message: &Message<'_>, now_ms: i64, timeout: Duration, resolver: &Resolver) -> Result<Answer, SendError> {
    let url = guard::parse(message.url)?;
    let addresses = guard::checked_addresses(&url, message.allow_private, resolver).await?;
    let timestamp = now_ms / 1000;
    let signature =
        standardwebhooks::Webhook::new(message.secret)?.sign(message.id, timestamp, message.body.as_bytes())?;
    let client = client(url.host_str().unwrap_or_default(), &addresses, timeout)?;
    let mut response = client
        .post(url)
        .header("webhook-id", message.id)
        .header("webhook-timestamp", timestamp)
        .header("webhook-signature", signature)
        .header("content-type", event::CONTENT_TYPE)
        .body(message.body.clone())
        .send()
        .await?;
    let status = response.status();
    if status.is_success() {
        return Ok(Answer::Accepted { status: status.as_u16() }); // whatever else it says is not waited for
    }
    if status == StatusCode::GONE {
        return Ok(Answer::Gone);
    }
    let retry_after = response
        .headers()
        .get("retry-after")
        .and_then(|v| v.to_str().ok())
        .and_then(|v| schedule::retry_after(v, now_ms));
    let said = beginning(&mut response).await;
    Ok(Answer::Refused { status: status.as_u16(), retry_after, said })
}

/// A client for one attempt: knows the host under the checked addresses only, follows nothing, uses no proxy (which would
/// resolve the name again).
fn client(host: &str, addresses: &[std::net::SocketAddr], timeout: Duration) -> reqwest::Result<reqwest::Client> {
    crate::tls::install();
    reqwest::Client::builder()
        .resolve_to_addrs(host, addresses)
        .redirect(reqwest::redirect::Policy::none())
        .no_proxy()
        .timeout(timeout)
        .user_agent(concat!("ropescope/", env!("CARGO_PKG_VERSION")))
        .build()
}

/// The beginning of an answer, printable, for the log.
async fn beginning(response: &mut reqwest::Response) -> String {
    let mut bytes = Vec::new();
    while bytes.len() < MAX_REPLY_BYTES {
        match response.chunk().await {
            Ok(Some(chunk)) => bytes.extend_from_slice(&chunk[..chunk.len().min(MAX_REPLY_BYTES - bytes.len())]),
            Ok(None) | Err(_) => break,
        }
    }
    let text = String::from_utf8_lossy(&bytes);
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(LOGGED_CHARS).collect::<String>().trim().to_owned()
}

/// Makes a signing secret from 32 random bytes.
pub fn secret(bytes: [u8; 32]) -> String {
    use base64::Engine;
    format!("whsec_{}", base64::engine::general_purpose::STANDARD.encode(bytes))
}
