//! tus 1.0 (core, creation, checksum, expiration, termination) for recordings that are one large file: tar, zip or camera dump. The protocol is its own
//! contract, so these routes are not in `openapi.yaml`; what became of a file is told by `GET /archives/{id}`, which is.
//!
//! An offset that was told is durable: bytes are synced before their number is recorded, and recorded before the client hears it.
//! What arrived of a request that was cut counts. A newer request ends an older one, so no lock outlives its link.

use super::arrivals::{Arrival, Arrivals};
use super::auth::{Caller, OPERATORS, UPLOADERS, authenticate, authorise};
use super::raw_dump::RawDump;
use super::{Problem, space, times, unpack};
use crate::app::App;
use crate::store::archives::Archive;
use crate::store::{Id, StoreError};
use axum::body::Body;
use axum::extract::{Path, Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::middleware::{Next, from_fn, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::post;
use axum::{Extension, Router};
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use futures::StreamExt;
use std::io::SeekFrom;
use tokio::io::{AsyncSeekExt, AsyncWriteExt};
use uuid::Uuid;

/// The only version that is spoken.
const VERSION: &str = "1.0.0";
/// Extensions of the protocol that are offered.
const EXTENSIONS: &str = "creation,checksum,expiration,termination";
/// Most bytes of a file: some ten km of rope.
const MAX_BYTES: u64 = 1 << 40;
/// A file that gets no byte for so long is removed.
const EXPIRES_MS: i64 = 7 * 86_400_000;
/// Bytes after which what arrived is made durable, also in the middle of a request.
const SYNC_EVERY: u64 = 32 << 20;

/// The routes of the protocol, below `/api/v1`.
pub fn routes(app: &App) -> Router<App> {
    Router::new()
        .route("/tus", post(create).options(options))
        .route("/tus/{id}", axum::routing::head(offset).patch(receive).delete(terminate))
        .layer(from_fn(version))
        .layer(from_fn_with_state((app.clone(), UPLOADERS), authorise))
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

fn number(headers: &HeaderMap, name: &str) -> Result<u64, Problem> {
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

fn expires(archive: &Archive) -> (&'static str, String) {
    let at = jiff::Timestamp::from_millisecond(archive.expires_at_ms).unwrap_or_default();
    ("upload-expires", jiff::fmt::rfc2822::DateTimePrinter::new().timestamp_to_rfc9110_string(&at).unwrap_or_default())
}

/// Ends the request that is sending this file, if one is, and waits until it has let go.
async fn take_over(arrivals: &Arrivals, id: Uuid) -> Arrival {
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

/// What a chunk must be.
struct Checksum {
    algorithm: &'static ring::digest::Algorithm,
    expected: Vec<u8>,
}

fn checksum(headers: &HeaderMap) -> Result<Option<Checksum>, Problem> {
    let Some(value) = headers.get("upload-checksum") else { return Ok(None) };
    let text = value.to_str().unwrap_or_default();
    let malformed =
        || Problem::malformed_header(format!("Upload-Checksum is {text:?}, but must be sha1 or sha256 and base64"));
    let (name, digest) = text.split_once(' ').ok_or_else(malformed)?;
    let algorithm = match name {
        "sha1" => &ring::digest::SHA1_FOR_LEGACY_USE_ONLY, // the protocol demands it; it finds accidents, not attacks
        "sha256" => &ring::digest::SHA256,
        _ => return Err(malformed()),
    };
    Ok(Some(Checksum { algorithm, expected: BASE64_STANDARD.decode(digest).map_err(|_| malformed())? }))
}

async fn receive(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    Path(id): Path<Uuid>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let mut stream = body.into_data_stream();
    let checked = async {
        load(&app, &caller, id).await?;
        if headers.get("content-type").is_none_or(|t| t != "application/offset+octet-stream") {
            return Err(Problem::unsupported_media_type("a chunk must be application/offset+octet-stream"));
        }
        let checksum = checksum(&headers)?;
        let offset = number(&headers, "upload-offset")?;
        let arrival = take_over(&app.arrivals, id).await;
        let archive = load(&app, &caller, id).await?;
        let received = archive.received.unsigned_abs();
        if offset != received {
            return Err(Problem::wrong_offset(format!(
                "the chunk begins at {offset}, but {received} bytes are there: ask with HEAD, then go on from there"
            ))
            .limit(offset, received));
        }
        let left = archive.length.unsigned_abs() - received;
        let length = headers.get("content-length").and_then(|v| v.to_str().ok()?.parse::<u64>().ok());
        if let Some(length) = length.filter(|&length| length > left) {
            return Err(longer(length, left));
        }
        space::fits_on_disk(&app, length.unwrap_or(0))?;
        Ok((archive, arrival, checksum))
    };
    let (archive, arrival, checksum) = match checked.await {
        Ok(checked) => checked,
        Err(problem) => return Err(super::upload::refuse(problem, &mut stream, app.settings.limits.frame_bytes).await),
    };
    let mut chunk = Chunk { app: &app, archive: &archive, received: archive.received.unsigned_abs() };
    let poured = chunk.pour(&mut stream, &arrival, checksum).await;
    // A slow link takes hours: the token may have been revoked meanwhile.
    authenticate(&app, &headers).await?.one_of(UPLOADERS)?;
    // Without a checksum that was promised and cannot be judged any more, whatever arrived counts.
    let whole = chunk.keep().await?;
    poured?;
    if whole {
        drop(arrival);
        tokio::spawn(unpack::unpack(app.clone(), archive.clone()));
    }
    let headers = [("upload-offset", chunk.received.to_string()), expires(&archive)];
    Ok((StatusCode::NO_CONTENT, headers).into_response())
}

fn longer(bytes: u64, left: u64) -> Problem {
    Problem::body_too_large(format!("the chunk has {bytes} bytes or more, but {left} are left of the file"))
        .limit(bytes, left)
}

/// A chunk on its way into the file.
struct Chunk<'a> {
    app: &'a App,
    archive: &'a Archive,
    /// Bytes that are durable in the file.
    received: u64,
}

impl Chunk<'_> {
    fn failed(&self, source: std::io::Error) -> Problem {
        StoreError::File { path: self.app.store.archive_path(self.archive.id), source }.into()
    }

    /// Writes the body behind what is there. Ends early when the link does, or another request takes over.
    async fn pour(
        &mut self,
        stream: &mut axum::body::BodyDataStream,
        arrival: &Arrival,
        checksum: Option<Checksum>,
    ) -> Result<(), Problem> {
        let path = self.app.store.archive_path(self.archive.id);
        let file = tokio::fs::OpenOptions::new().write(true).open(path).await.map_err(|e| self.failed(e))?;
        file.set_len(self.received).await.map_err(|e| self.failed(e))?; // what was never durable counts for nothing
        let mut file = tokio::io::BufWriter::with_capacity(256 << 10, file);
        file.seek(SeekFrom::Start(self.received)).await.map_err(|e| self.failed(e))?;
        let mut hash = checksum.as_ref().map(|c| ring::digest::Context::new(c.algorithm));
        let (mut written, left) = (0_u64, self.archive.length.unsigned_abs() - self.received);
        let gap = self.app.settings.limits.body_gap;
        let ended = loop {
            let next = tokio::select! {
                next = tokio::time::timeout(gap, stream.next()) => next,
                () = arrival.ended() => break Err(Problem::superseded("a newer request asks for the same file")),
            };
            let bytes = match next {
                Err(_) => break Err(Problem::too_slow(format!("no byte arrived for {} s", gap.as_secs()))),
                Ok(None) => break Ok(()),
                Ok(Some(Err(e))) => break Err(Problem::body_cut_short(format!("after {written} bytes: {e}"))),
                Ok(Some(Ok(bytes))) => bytes,
            };
            if written + bytes.len() as u64 > left {
                return Err(longer(written + bytes.len() as u64, left)); // the client's arithmetic is wrong: nothing of it counts
            }
            if let Some(hash) = &mut hash {
                hash.update(&bytes);
            }
            file.write_all(&bytes).await.map_err(|e| self.failed(e))?;
            written += bytes.len() as u64;
            arrival.lives();
            if hash.is_none() && written / SYNC_EVERY != (written - bytes.len() as u64) / SYNC_EVERY {
                space::fits_on_disk(self.app, 0)?;
                file.flush().await.map_err(|e| self.failed(e))?;
                file.get_ref().sync_data().await.map_err(|e| self.failed(e))?;
                self.received = self.archive.received.unsigned_abs() + written;
                if written < left {
                    self.keep().await?;
                }
            }
        };
        if let (Some(hash), Some(checksum)) = (hash, checksum) {
            ended?; // half a chunk cannot be judged, so it does not count
            if hash.finish().as_ref() != checksum.expected {
                return Err(Problem::checksum_mismatch(format!(
                    "the chunk of {written} bytes is not what its checksum promised; nothing of it was kept"
                )));
            }
            file.flush().await.map_err(|e| self.failed(e))?;
            file.get_ref().sync_data().await.map_err(|e| self.failed(e))?;
            self.received += written;
            return Ok(());
        }
        file.flush().await.map_err(|e| self.failed(e))?;
        file.get_ref().sync_data().await.map_err(|e| self.failed(e))?;
        self.received = self.archive.received.unsigned_abs() + written;
        ended
    }

    /// Records what is durable. True when that is all.
    async fn keep(&self) -> Result<bool, Problem> {
        let expires_at_ms = self.app.now_ms() + EXPIRES_MS;
        Ok(self.app.store.archive_received(self.archive.id, self.received as i64, expires_at_ms).await?)
    }
}
