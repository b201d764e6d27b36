//! tus 1.0 (core, creation, checksum, expiration, termination) for recordings that are one large file: tar, zip or camera dump. The protocol is its own
//! contract, so these routes are not in `openapi.yaml`; what became of a file is told by `GET /archives/{id}`, which is.
//!
//! An offset that was told is durable: bytes are synced before their number is recorded, and recorded before the client hears it.
//! What arrived of a request that was cut counts. A newer request ends an older one, so no lock outlives its link.

use super::arrivals::{Arrival, Arrivals};
use super::auth::{Caller, OPERATORS, UPLOADERS, authorise};
use super::raw_dump::RawDump;
use super::{Problem, space, times, tus_chunk};
use crate::app::App;
use crate::store::Id;
use crate::store::archives::Archive;
use axum::extract::{Path, Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::middleware::{Next, from_fn, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::post;
use axum::{Extension, Router};
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use std::time::Duration;
use uuid::Uuid;

/// The only version that is spoken.
const VERSION: &str = "1.0.0";
/// Extensions of the protocol that are offered.
const EXTENSIONS: &str = "creation,checksum,expiration,termination";
/// Most bytes of a file: some ten km of rope.
const MAX_BYTES: u64 = 1 << 40;
/// A file that gets no byte for so long is removed.
pub const EXPIRES_MS: i64 = 7 * 86_400_000;
/// Time between two looks for files whose time is over.
const TIDY_EVERY: Duration = Duration::from_secs(600);

/// The routes of the protocol, below `/api/v1`.
pub fn routes(app: &App) -> Router<App> {
    Router::new()
        .route("/tus", post(create).options(options))
        .route("/tus/{id}", axum::routing::head(offset).patch(tus_chunk::receive).delete(terminate))
        .layer(from_fn(version))
        .layer(from_fn_with_state((app.clone(), UPLOADERS), authorise))
}

/// Removes files that got no byte for too long, as long as the process lives.
pub async fn tidy(app: App) {
    loop {
        if let Err(error) = app.store.remove_expired_archives(app.now_ms()).await {
            tracing::warn!(%error, "uploads whose time is over were not removed");
        }
        tokio::select! {
            () = app.shutdown.cancelled() => return,
            () = tokio::time::sleep(TIDY_EVERY) => {}
        }
    }
}

/// Every answer names the version, and every request has to.
async fn version(request: Request, next: Next) -> Response {
    let told = request.headers().get("tus-resumable").and_then(|v| v.to_str().ok()).map(str::to_owned);
    let mut response = if told.as_deref() == Some(VERSION) || request.method() == "OPTIONS" {
        next.run(request).await
    } else {
        Problem::wrong_tus_version(format!("Tus-Resumable is {told:?}, but must be {VERSION:?}")).into_response()
    };
    let headers = response.headers_mut();
    headers.insert("tus-resumable", HeaderValue::from_static(VERSION));
    headers.insert("cache-control", HeaderValue::from_static("no-store"));
    if response.status() == StatusCode::PRECONDITION_FAILED {
        response.headers_mut().insert("tus-version", HeaderValue::from_static(VERSION));
    }
    response
}

async fn options() -> Response {
    let headers = [
        ("tus-version", VERSION.to_owned()),
        ("tus-extension", EXTENSIONS.to_owned()),
        ("tus-max-size", MAX_BYTES.to_string()),
        ("tus-checksum-algorithm", "sha1,sha256".to_owned()),
    ];
    (StatusCode::NO_CONTENT, headers).into_response()
}

/// A header that is a number of bytes.
pub fn number(headers: &HeaderMap, name: &str) -> Result<u64, Problem> {
    let text = headers.get(name).and_then(|v| v.to_str().ok()).unwrap_or_default();
    text.parse().map_err(|_| Problem::malformed_header(format!("{name} is {text:?}, but must be a number of bytes")))
}

/// A value of `Upload-Metadata`.
fn value_of(text: &str, key: &str) -> Option<String> {
    let value = text.split(',').find_map(|pair| pair.trim().strip_prefix(key)?.strip_prefix(' '))?;
    String::from_utf8(BASE64_STANDARD.decode(value.trim()).ok()?).ok()
}

/// What a file is if its metadata say that it is a camera dump; `None`: it is an archive.
pub fn raw_dump(metadata: &str, length: u64) -> Result<Option<RawDump>, Problem> {
    let Some(rope_json) = value_of(metadata, "rope_json") else { return Ok(None) };
    Ok(Some(RawDump::new(&rope_json, value_of(metadata, "raw_bits").as_deref(), length)?))
}

async fn create(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let now_ms = app.now_ms();
    app.store.remove_expired_archives(now_ms).await?;
    let length = number(&headers, "upload-length")?;
    if !(1..=MAX_BYTES).contains(&length) {
        return Err(Problem::body_too_large(format!("the file has {length} bytes, but may have 1 to {MAX_BYTES}"))
            .limit(length, MAX_BYTES));
    }
    let text = headers.get("upload-metadata").and_then(|v| v.to_str().ok()).unwrap_or_default();
    let rope = value_of(text, "rope_id").unwrap_or_default();
    let known = match rope.parse::<Uuid>() {
        Ok(id) => app.store.rope(Id(id)).await?,
        Err(_) => None,
    };
    let rope = known.ok_or_else(|| {
        Problem::unknown_reference(format!("rope_id in Upload-Metadata is {rope:?}, which is no rope of this service"))
    })?;
    raw_dump(text, length)?; // said now, and not after hours of sending
    if let Some(quota) = app.store.quota_of_rope(rope.id).await? {
        space::within_quota(&quota, length)?;
    }
    space::fits_on_disk(&app, length.saturating_mul(2))?; // the file, and the frames in it
    let archive = Archive {
        id: app.new_id(),
        token_id: caller.token_id,
        rope_id: rope.id,
        metadata: text.to_owned(),
        length: length as i64,
        received: 0,
        state: "receiving".into(),
        problem: None,
        expires_at_ms: now_ms + EXPIRES_MS,
        created_at_ms: now_ms,
    };
    app.store.begin_archive(&archive).await?;
    let location = format!("/api/v1/tus/{}", archive.id);
    Ok((StatusCode::CREATED, [("location", location), expires(&archive)]).into_response())
}

/// The archive of a path, for those who may touch it.
pub async fn load(app: &App, caller: &Caller, id: Uuid) -> Result<Archive, Problem> {
    let archive =
        app.store.archive(Id(id)).await?.filter(|a| a.token_id == caller.token_id || OPERATORS.contains(&caller.role));
    let archive = archive.ok_or_else(|| Problem::no("archive of this token", id))?;
    if archive.state == "receiving" && archive.expires_at_ms <= app.now_ms() {
        return Err(Problem::upload_expired(format!(
            "archive {id} got no byte until {}: begin it anew",
            times::rfc3339(archive.expires_at_ms)
        )));
    }
    Ok(archive)
}

/// The header that tells until when an archive waits for bytes.
pub fn expires(archive: &Archive) -> (&'static str, String) {
    let at = jiff::Timestamp::from_millisecond(archive.expires_at_ms).unwrap_or_default();
    ("upload-expires", jiff::fmt::rfc2822::DateTimePrinter::new().timestamp_to_rfc9110_string(&at).unwrap_or_default())
}

/// Ends the request that is sending this file, if one is, and waits until it has let go.
pub async fn take_over(arrivals: &Arrivals, id: Uuid) -> Arrival {
    arrivals.take_over((id, 0, 0)).await
}

async fn offset(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    Path(id): Path<Uuid>,
) -> Result<Response, Problem> {
    load(&app, &caller, id).await?;
    drop(take_over(&app.arrivals, id).await); // the client asks because its link is dead
    let archive = load(&app, &caller, id).await?;
    let headers = [
        ("upload-offset", archive.received.to_string()),
        ("upload-length", archive.length.to_string()),
        ("upload-metadata", archive.metadata.clone()),
        expires(&archive),
    ];
    Ok((StatusCode::OK, headers).into_response())
}

async fn terminate(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    Path(id): Path<Uuid>,
) -> Result<StatusCode, Problem> {
    let archive = load(&app, &caller, id).await?;
    if archive.state == "unpacking" {
        return Err(Problem::archive_unpacking(format!(
            "archive {id} is being unpacked; delete its acquisition afterwards"
        )));
    }
    let _arrival = take_over(&app.arrivals, id).await;
    app.store.remove_archive(Id(id)).await?;
    Ok(StatusCode::NO_CONTENT)
}
