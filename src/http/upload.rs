//! Receives a body into a file: bounded, timed, hashed on the way.

use super::Problem;
use super::arrivals::{Arrival, FramePlace};
use super::space::{self, Room};
use crate::app::App;
use crate::store::digest::hex;
use crate::store::{Id, StoreError};
use axum::body::{Body, BodyDataStream};
use axum::http::{HeaderMap, header};
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use futures::StreamExt;
use sha2::{Digest, Sha256};
use std::time::Duration;
use tempfile::NamedTempFile;
use tokio::io::AsyncWriteExt;

/// Types of frames that are taken. What counts is the content; the header may only not contradict.
const TYPES: [&str; 3] = ["image/png", "image/tiff", "application/octet-stream"];
/// Bytes that are collected before they go to the disk.
const BUFFER: usize = 256 << 10;
/// Bytes after which the room on the disk is looked at again.
const LOOK_EVERY: u64 = 1 << 20;
/// How long an upload waits for its turn.
const TURN: Duration = Duration::from_secs(20);

/// What a client said of a frame before it sent it.
#[derive(Debug, Clone, Default)]
pub struct Promise {
    /// Its length.
    pub bytes: Option<u64>,
    /// Its digest, lower-case hex.
    pub sha256: Option<String>,
}

/// A body that arrived whole.
pub struct Arrived<T> {
    /// Where it is; removed when this is dropped.
    pub file: NamedTempFile,
    /// Digest, lower-case hex.
    pub sha256: String,
    /// Length.
    pub bytes: u64,
    /// What the check before the body found.
    pub context: T,
}

/// Receives the body of a frame. `check` runs before the first byte is taken. A refused body is read to its end (within bounds)
/// and thrown away, for a client that still sends often cannot hear the answer; what had arrived of it, its room and its turn are
/// given up before.
pub async fn receive<T>(
    app: &App,
    headers: &HeaderMap,
    body: Body,
    place: FramePlace,
    check: impl AsyncFnOnce() -> Result<(T, Promise), Problem>,
) -> Result<Arrived<T>, Problem> {
    let arrival = app.arrivals.begin(place);
    let mut stream = body.into_data_stream();
    let problem = match take(app, headers, &mut stream, place, &arrival, check).await {
        Ok(arrived) => return Ok(arrived),
        Err(problem) => problem,
    };
    tokio::select! {
        () = drain(&mut stream, app.settings.limits.frame_bytes) => {}
        () = arrival.ended() => {} // the client has begun anew: it does not listen here any more
    }
    Err(problem)
}

async fn take<T>(
    app: &App,
    headers: &HeaderMap,
    stream: &mut BodyDataStream,
    place: FramePlace,
    arrival: &Arrival,
    check: impl AsyncFnOnce() -> Result<(T, Promise), Problem>,
) -> Result<Arrived<T>, Problem> {
    let limits = app.settings.limits;
    let (context, promise) = check().await?;
    let digest = expected_digest(headers)?.map(|digest| hex(&digest));
    check_type(headers)?;
    if let (Some(sent), Some(announced)) = (&digest, &promise.sha256)
        && sent != announced
    {
        return Err(not_as_announced(sent, announced));
    }
    let limit = promise.bytes.unwrap_or(limits.frame_bytes).min(limits.frame_bytes);
    let length = headers.get(header::CONTENT_LENGTH).and_then(|v| v.to_str().ok()).and_then(|v| v.parse().ok());
    if let Some(length) = length.filter(|&length: &u64| length > limit) {
        return Err(too_large(length, limit));
    }
    let foreseen = length.or(promise.bytes);
    let room = Room::take(app, Id(place.0), foreseen.unwrap_or(0)).await?;
    let permit = tokio::time::timeout(TURN, app.uploads.clone().acquire_owned()).await;
    let _permit = permit
        .map_err(|_| Problem::busy(format!("{} frames are being received already", limits.uploads)))?
        .map_err(Problem::failure)?;
    let folder = app.store.folder().uploads();
    let file = tokio::task::spawn_blocking(move || NamedTempFile::new_in(folder));
    let file = file.await.map_err(Problem::failure)?.map_err(|e| not_written(app, e))?;
    let writer = tokio::fs::File::from_std(file.as_file().try_clone().map_err(Problem::failure)?);
    let pour = pour(app, stream, writer, limit, room, arrival);
    let received = tokio::select! {
        received = tokio::time::timeout(limits.upload_timeout, pour) => received,
        () = arrival.ended() => return Err(Problem::superseded("a newer request sends the same frame, and this one was silent")),
    };
    let too_slow = |_| Problem::too_slow(format!("the body took longer than {} s", limits.upload_timeout.as_secs()));
    let (sha256, bytes) = received.map_err(too_slow)??;
    if let Some(expected) = digest.or(promise.sha256)
        && expected != sha256
    {
        return Err(Problem::digest_mismatch(format!(
            "sha-256 {expected} was promised, but the {bytes} bytes that arrived have {sha256}"
        ))
        .limit(sha256, expected));
    }
    if foreseen.is_none() {
        space::fits_in_quota(app, Id(place.0), bytes).await?; // nobody had said how long it is
    }
    Ok(Arrived { file, sha256, bytes, context })
}

async fn pour(
    app: &App,
    stream: &mut BodyDataStream,
    file: tokio::fs::File,
    limit: u64,
    mut room: Room,
    arrival: &Arrival,
) -> Result<(String, u64), Problem> {
    let gap = app.settings.limits.body_gap;
    let mut writer = tokio::io::BufWriter::with_capacity(BUFFER, file);
    let mut hash = Sha256::new();
    let mut bytes = 0_u64;
    loop {
        let chunk = tokio::time::timeout(gap, stream.next())
            .await
            .map_err(|_| Problem::too_slow(format!("no byte arrived for {} s", gap.as_secs())))?;
        let Some(chunk) = chunk else { break };
        let chunk = chunk.map_err(|e| Problem::body_cut_short(format!("after {bytes} bytes: {e}")))?;
        bytes += chunk.len() as u64;
        if bytes > limit {
            return Err(too_large(bytes, limit));
        }
        hash.update(&chunk);
        writer.write_all(&chunk).await.map_err(|e| not_written(app, e))?;
        room.arrived(chunk.len() as u64);
        arrival.lives();
        if bytes / LOOK_EVERY != (bytes - chunk.len() as u64) / LOOK_EVERY {
            space::fits_on_disk(app, 0)?;
        }
    }
    writer.flush().await.map_err(|e| not_written(app, e))?;
    Ok((hex(&hash.finalize()), bytes))
}

/// Lets a refused client finish sending, so that it reads the answer; but no more than another body's worth.
pub async fn drain(stream: &mut BodyDataStream, limit: u64) {
    let drain = async {
        let mut left = limit * 2;
        while let Some(Ok(chunk)) = stream.next().await {
            left = left.saturating_sub(chunk.len() as u64);
            if left == 0 {
                break;
            }
        }
    };
    let _ = tokio::time::timeout(Duration::from_secs(30), drain).await;
}

fn not_written(app: &App, source: std::io::Error) -> Problem {
    StoreError::File { path: app.store.folder().uploads(), source }.into()
}

fn not_as_announced(sent: &str, announced: &str) -> Problem {
    Problem::digest_mismatch(format!("sha-256 {announced} was announced for this frame, but {sent} is sent"))
        .limit(sent, announced)
}

fn too_large(bytes: u64, limit: u64) -> Problem {
    Problem::body_too_large(format!("the body has {bytes} bytes or more, but this frame may have at most {limit}"))
        .limit(bytes, limit)
}

fn check_type(headers: &HeaderMap) -> Result<(), Problem> {
    let Some(value) = headers.get(header::CONTENT_TYPE) else { return Ok(()) };
    let text = value.to_str().unwrap_or_default();
    let essence = text.split(';').next().unwrap_or_default().trim();
    if TYPES.iter().any(|known| known.eq_ignore_ascii_case(essence)) {
        return Ok(());
    }
    Err(Problem::unsupported_media_type(format!("the body is {text:?}, but frames are {}", TYPES.join(", ")))
        .limit(text, TYPES))
}

/// The SHA-256 that `Repr-Digest` or `Content-Digest` promises. Other algorithms are ignored, as RFC 9530 allows.
fn expected_digest(headers: &HeaderMap) -> Result<Option<Vec<u8>>, Problem> {
    for name in ["repr-digest", "content-digest"] {
        for value in headers.get_all(name) {
            let text = value.to_str().map_err(|_| malformed(name, "it is not ASCII"))?;
            for member in text.split(',') {
                let (key, value) = member.split_once('=').ok_or_else(|| malformed(name, text))?;
                if key.trim() == "sha-256" {
                    return parse_digest(value.trim()).map(Some).ok_or_else(|| malformed(name, text));
                }
            }
        }
    }
    Ok(None)
}

fn parse_digest(value: &str) -> Option<Vec<u8>> {
    let base64 = value.strip_prefix(':')?.strip_suffix(':')?;
    BASE64_STANDARD.decode(base64).ok().filter(|bytes| bytes.len() == 32)
}

fn malformed(name: &str, text: &str) -> Problem {
    Problem::malformed_header(format!("{name} is {text:?}, but must read sha-256=:<base64 of 32 bytes>:"))
        .with("header", name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;

    fn digest_of(text: &'static str) -> Result<Option<Vec<u8>>, Problem> {
        expected_digest(&HeaderMap::from_iter([("repr-digest".parse().unwrap(), HeaderValue::from_static(text))]))
    }

    #[test]
    fn a_digest_is_found_among_others() {
        let found = digest_of("md5=:AAAA:, sha-256=:RBNvo1WzZ4oRRq0W9+hknpT7T8If536DEMBg9hyq/4o=:").unwrap().unwrap();
        assert_eq!(hex(&found), "44136fa355b3678a1146ad16f7e8649e94fb4fc21fe77e8310c060f61caaff8a");
    }

    #[test]
    fn a_digest_that_is_none_is_refused_and_others_are_ignored() {
        assert!(digest_of("sha-256=:AAAA:").is_err());
        assert!(digest_of("sha-256=abc").is_err());
        assert!(digest_of("nonsense").is_err());
        assert_eq!(digest_of("sha-512=:AAAA:").unwrap(), None);
    }
}
