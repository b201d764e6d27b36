//! Why requests fail: what passes and what does not, in words of the service where it has said any.

use reqwest::StatusCode;
use serde_json::Value;
use std::time::Duration;

/// Why a request has no good answer.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// The URL of the service is not usable.
    #[error("{url:?} is not the URL of a service (http://host:port or https://host): {reason}")]
    Server {
        /// What was given.
        url: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The token cannot be sent.
    #[error("the token has characters that no token has: copy it again, or make one with `ropescope token create`")]
    Token,
    /// TLS or the like could not be set up.
    #[error("cannot set up HTTP: {0}")]
    Setup(reqwest::Error),
    /// No answer, or only temporary failures, for longer than patience allows.
    #[error("{what}: no success for {tried_s:.0} s and {tries} tries; the last one: {last}")]
    Unreachable {
        /// Method and path.
        what: String,
        /// Seconds since the first try.
        tried_s: f64,
        /// Number of tries.
        tries: u32,
        /// What the last try said.
        last: String,
        /// Its status, if there was an answer.
        status: Option<u16>,
    },
    /// The service said no, and would again.
    #[error("{what}: the service answered {status}: {said}")]
    Refused {
        /// Method and path.
        what: String,
        /// The status.
        status: u16,
        /// Title and detail of its problem answer.
        said: String,
        /// The problem answer itself.
        problem: Value,
    },
    /// The answer is not what the API promises.
    #[error("{what}: the answer is not what was expected: {reason}")]
    Answer {
        /// Method and path.
        what: String,
        /// What is wrong with it.
        reason: String,
    },
}

impl ClientError {
    /// Status of a refusal, or of the last of many temporary failures.
    pub fn status(&self) -> Option<u16> {
        match self {
            Self::Refused { status, .. } => Some(*status),
            Self::Unreachable { status, .. } => *status,
            _ => None,
        }
    }

    /// True when patience ended without a good answer.
    pub fn is_unreachable(&self) -> bool {
        matches!(self, Self::Unreachable { .. })
    }

    /// True for a problem of this kind, such as `superseded`.
    pub fn is_problem(&self, slug: &str) -> bool {
        matches!(self, Self::Refused { problem, .. } if problem["type"] == format!("/problems/{slug}"))
    }
}

/// An answer that is no success.
pub(super) struct Failure {
    pub status: StatusCode,
    pub retry_after: Option<Duration>,
    pub body: bytes::Bytes,
}

impl Failure {
    /// May the same request succeed later?
    pub fn temporary(&self) -> bool {
        self.status.is_server_error() && self.status != StatusCode::NOT_IMPLEMENTED
            || matches!(self.status.as_u16(), 408 | 425 | 429)
    }

    fn problem(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or(Value::Null)
    }

    /// Title and detail, or what else stands there.
    pub fn said(&self) -> String {
        let problem = self.problem();
        match (problem["title"].as_str(), problem["detail"].as_str()) {
            (Some(title), Some(detail)) => format!("{title}: {detail}"),
            (Some(text), None) | (None, Some(text)) => text.to_owned(),
            (None, None) => String::from_utf8_lossy(&self.body).chars().take(200).collect(),
        }
    }

    /// The error of a request that would fail again.
    pub fn refused(self, what: String) -> ClientError {
        ClientError::Refused { what, status: self.status.as_u16(), said: self.said(), problem: self.problem() }
    }
}

/// reqwest wraps causes several times; the innermost says what happened.
pub(super) fn innermost(error: &reqwest::Error) -> String {
    let mut cause: &dyn std::error::Error = error;
    while let Some(source) = cause.source() {
        cause = source;
    }
    cause.to_string()
}
