//! A chunk of a file that comes over tus: poured behind what is there, synced, then counted.

use super::arrivals::Arrival;
use super::auth::{Caller, UPLOADERS, authenticate};
use super::tus::{EXPIRES_MS, expires, load, number, take_over};
use super::{Problem, space, unpack};
use crate::app::App;
use crate::store::StoreError;
use crate::store::archives::Archive;
use axum::Extension;
use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use futures::StreamExt;
use std::io::SeekFrom;
use tokio::io::{AsyncSeekExt, AsyncWriteExt};
use uuid::Uuid;

/// Bytes after which what arrived is made durable, also in the middle of a request.
const SYNC_EVERY: u64 = 32 << 20;

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

/// PATCH: takes a chunk.
pub async fn receive(
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
        Err(problem) => {
            super::upload::drain(&mut stream, app.settings.limits.frame_bytes).await;
            return Err(problem);
        }
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
