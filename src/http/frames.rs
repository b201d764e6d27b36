//! Frames in and out. A frame is acknowledged only when it is checked, durable and recorded.

use super::acquisitions::{self, MAX_FRAMES};
use super::extract::Path;
use super::problem::{ReadProblems, WriteProblems};
use super::{Problem, auth, times};
use crate::app::App;
use crate::http::upload::{Arrived, Promise, receive};
use crate::pipeline::source::{self, MAX_FRAME_LINES, MAX_FRAME_PIXELS, MAX_SENSOR_PX, SourceError};
use crate::store::frames::{Frame as Row, FrameStored};
use crate::store::{Id, acquisitions::Acquisition};
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use serde::Serialize;
use serde_json::json;
use std::path::Path as FilePath;
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

/// A frame that is there.
#[derive(Debug, Serialize, ToSchema)]
pub struct Frame {
    /// The acquisition.
    acquisition_id: Uuid,
    /// The view.
    view: u32,
    /// Number within the view, from 0.
    frame: u32,
    /// Digest of its bytes, lower-case hex.
    sha256: String,
    /// Length of its file.
    bytes: i64,
    /// Camera lines (image rows).
    lines: u32,
    /// `image/png` or `image/tiff`.
    content_type: String,
    /// When it was acknowledged.
    #[schema(format = DateTime)]
    received_at: String,
}

impl From<Row> for Frame {
    fn from(row: Row) -> Self {
        Self {
            acquisition_id: row.acquisition_id.0,
            view: row.view,
            frame: row.frame,
            sha256: row.sha256,
            bytes: row.bytes,
            lines: row.lines,
            content_type: row.content_type,
            received_at: times::rfc3339(row.received_at_ms),
        }
    }
}

/// The version that the client has, for the contract; [`known`] reads it.
#[derive(IntoParams)]
#[into_params(parameter_in = Header)]
pub struct KnownVersion {
    /// ETag of the version that the client has.
    #[param(rename = "if-none-match")]
    _if_none_match: Option<String>,
}

/// The bytes of an image, for the contract.
#[derive(ToSchema)]
#[schema(value_type = String, format = Binary)]
pub struct Image(#[expect(dead_code, reason = "only its schema is used")] Vec<u8>);

/// Send a frame. The same bytes again are the same frame; others under its number are refused
#[utoipa::path(put, path = "/acquisitions/{id}/views/{view}/frames/{frame}", tag = "acquisitions", params(
    ("id" = Uuid, Path, description = "The acquisition"),
    ("view" = u32, Path, description = "The view, from 0"),
    ("frame" = u32, Path, description = "Number of the frame, from 0"),
    ("repr-digest" = Option<String>, Header, description = "RFC 9530; `sha-256=:<base64>:` of the body, verified if sent", pattern = "^sha-256=:[A-Za-z0-9+/]{42}[AEIMQUYcgkosw048]=:$")),
    request_body(description = "8 or 16 bit gray, rows are camera lines, at most 64 MiB", content(
        (Image = "image/png"), (Image = "image/tiff"), (Image = "application/octet-stream"))),
    responses(
    (status = 201, description = "It is durable", body = Frame, headers(
        ("location" = String, description = "Its address"), ("etag" = String, description = "Its digest, quoted"),
        ("repr-digest" = String, description = "RFC 9530"))),
    (status = 200, description = "The same bytes were there already", body = Frame, headers(
        ("etag" = String, description = "Its digest, quoted"), ("repr-digest" = String, description = "RFC 9530"))),
    WriteProblems))]
pub async fn put_frame(
    State(app): State<App>,
    Path((id, view, frame)): Path<(Uuid, u32, u32)>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let arrived = receive(&app, &headers, body, (id, view, frame), async || {
        let acquisition = acquisitions::load_with_frames(&app, id).await?;
        place(&acquisition, view, frame)?;
        if acquisition.complete() && app.store.frame(Id(id), view, frame).await?.is_none() {
            return Err(complete(id));
        }
        let announced = app.store.announced(Id(id), view, frame).await?;
        let promise = announced
            .map_or_else(Promise::default, |a| Promise { bytes: Some(a.bytes.unsigned_abs()), sha256: Some(a.sha256) });
        Ok((acquisition, promise))
    })
    .await?;
    // A slow link takes minutes: the token may have been revoked meanwhile.
    auth::authenticate(&app, &headers).await?.one_of(auth::UPLOADERS)?;
    keep(&app, arrived, view, frame).await
}

/// Refuses view and frame numbers that the acquisition does not have.
pub fn place(acquisition: &Acquisition, view: u32, frame: u32) -> Result<(), Problem> {
    let id = acquisition.row.id;
    let Some(known) = acquisition.views.get(view as usize) else {
        let views = acquisition.views.len();
        return Err(Problem::view_out_of_range(format!(
            "there is no view {view}: acquisition {id} has {views} views, the last one is {}",
            views.saturating_sub(1)
        ))
        .limit(view, views.saturating_sub(1)));
    };
    let frames = known.frames_expected.unwrap_or(MAX_FRAMES);
    if frame >= frames {
        return Err(Problem::frame_out_of_range(format!(
            "there is no frame {frame}: view {view} of acquisition {id} has at most {frames} frames, the last one is {}",
            frames.saturating_sub(1)
        ))
        .limit(frame, frames.saturating_sub(1)));
    }
    Ok(())
}

/// The problem of an acquisition that takes no frames any more.
pub fn complete(id: Uuid) -> Problem {
    Problem::acquisition_complete(format!("acquisition {id} is complete; nothing was changed"))
}

async fn keep(app: &App, arrived: Arrived<Acquisition>, view: u32, frame: u32) -> Result<Response, Problem> {
    let acquisition = &arrived.context;
    let id = acquisition.row.id;
    let address = format!("/api/v1/acquisitions/{id}/views/{view}/frames/{frame}");
    // Known bytes need no second check.
    if let Some(old) = app.store.frame(id, view, frame).await?.filter(|old| old.damaged_at_ms.is_none()) {
        return if old.sha256 == arrived.sha256 {
            Ok(answer(StatusCode::OK, old, address))
        } else {
            Err(differs(&old, &arrived.sha256))
        };
    }
    let sensor_px = acquisition.row.sensor_px;
    let permit = app.cpu.clone().acquire_owned().await.map_err(Problem::failure)?;
    let path = arrived.file.path().to_owned();
    let checked = tokio::task::spawn_blocking(move || {
        let _permit = permit;
        check(&path, sensor_px)
    });
    let (lines, content_type) = checked.await.map_err(Problem::failure)?.map_err(|e| refused(e, sensor_px))?;
    let row = Row {
        acquisition_id: id,
        view,
        frame,
        sha256: arrived.sha256.clone(),
        bytes: arrived.bytes as i64,
        lines,
        content_type: content_type.to_owned(),
        received_at_ms: app.now_ms(),
        damaged_at_ms: None,
    };
    match app.store.keep_frame(arrived.file.path(), row).await? {
        FrameStored::New(row) => {
            metrics::counter!("ropescope_frames_stored_total").increment(1);
            metrics::counter!("ropescope_frame_bytes_stored_total").increment(arrived.bytes);
            Ok(answer(StatusCode::CREATED, row, address))
        }
        FrameStored::Same(row) => Ok(answer(StatusCode::OK, row, address)),
        FrameStored::Different(old) => Err(differs(&old, &arrived.sha256)),
        FrameStored::Complete => Err(complete(id.0)),
        FrameStored::NoPlace => Err(Problem::no("acquisition, view or frame number at", address)),
    }
}

/// Header first, then the whole image: a header that lies about its size costs no memory, a truncated file is found now and
/// not by a job tomorrow.
pub fn check(path: &FilePath, sensor_px: u32) -> Result<(u32, &'static str), SourceError> {
    let from_png = png_header(path);
    let (width, lines) = match from_png {
        Some(size) => size,
        None => source::dimensions(path)?,
    };
    if width > MAX_SENSOR_PX || lines > MAX_FRAME_LINES || u64::from(width) * u64::from(lines) > MAX_FRAME_PIXELS {
        return Err(SourceError::TooLarge { path: path.into(), width, height: lines });
    }
    if width != sensor_px {
        return Err(SourceError::WrongWidth { path: path.into(), width, sensor_px });
    }
    source::decode(path)?;
    Ok((lines, if from_png.is_some() { "image/png" } else { "image/tiff" }))
}

/// Width and height that the first 24 bytes of a PNG promise. Read here, because a decoder also wants the chunks up to the
/// first pixels, and a file cut before them shall still hear that it is too large or too wide.
fn png_header(path: &FilePath) -> Option<(u32, u32)> {
    let mut head = [0_u8; 24];
    std::fs::File::open(path).and_then(|mut file| std::io::Read::read_exact(&mut file, &mut head)).ok()?;
    let number = |at: usize| u32::from_be_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
    (head.starts_with(b"\x89PNG\r\n\x1a\n") && &head[12..16] == b"IHDR").then(|| (number(16), number(20)))
}

/// The problem of a frame that is none. Paths of ours stay with us.
pub fn refused(error: SourceError, sensor_px: u32) -> Problem {
    match error {
        SourceError::TooLarge { width, height, .. } => Problem::frame_too_large(format!(
            "the image is {width}x{height}, but a frame may have at most {MAX_SENSOR_PX} columns, {MAX_FRAME_LINES} lines and {MAX_FRAME_PIXELS} pixels"
        ))
        .limit(
            json!({ "columns": width, "lines": height }),
            json!({ "columns": MAX_SENSOR_PX, "lines": MAX_FRAME_LINES, "pixels": MAX_FRAME_PIXELS }),
        ),
        SourceError::WrongWidth { width, .. } => {
            Problem::frame_wrong_width(format!("the image has {width} columns, but the sensor has {sensor_px}"))
                .limit(width, sensor_px)
        }
        SourceError::Unreadable { reason, .. } => {
            Problem::frame_unreadable(format!("the body is not a whole 8 or 16 bit gray PNG or TIFF: {reason}"))
        }
        error @ (SourceError::NoSuchFrame { .. } | SourceError::Abandoned { .. } | SourceError::Stopped) => {
            Problem::failure(error)
        }
    }
}

fn differs(old: &Row, sha256: &str) -> Problem {
    Problem::frame_differs(format!(
        "frame {} of view {} is there with digest {}, but this one has {sha256}; nothing was changed",
        old.frame, old.view, old.sha256
    ))
    .limit(sha256, &old.sha256)
}

/// `Repr-Digest` of a SHA-256.
pub fn repr_digest(sha256_hex: &str) -> String {
    let bytes: Vec<u8> =
        (0..sha256_hex.len() / 2).filter_map(|i| u8::from_str_radix(&sha256_hex[2 * i..2 * i + 2], 16).ok()).collect();
    format!("sha-256=:{}:", BASE64_STANDARD.encode(bytes))
}

fn digest_headers(row: &Row) -> [(&'static str, String); 2] {
    [("etag", format!("\"{}\"", row.sha256)), ("repr-digest", repr_digest(&row.sha256))]
}

fn answer(status: StatusCode, row: Row, address: String) -> Response {
    let headers = digest_headers(&row);
    (status, headers, [(header::LOCATION, address)], axum::Json(Frame::from(row))).into_response()
}

/// True when the client has this version already.
pub fn known(headers: &HeaderMap, etag: &str) -> bool {
    headers
        .get_all(header::IF_NONE_MATCH)
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','))
        .any(|tag| matches!(tag.trim(), "*") || tag.trim().trim_start_matches("W/") == etag)
}

/// A frame, as it was sent
#[utoipa::path(get, path = "/acquisitions/{id}/views/{view}/frames/{frame}", tag = "acquisitions", params(
    ("id" = Uuid, Path, description = "The acquisition"),
    ("view" = u32, Path, description = "The view, from 0"),
    ("frame" = u32, Path, description = "Number of the frame, from 0"), KnownVersion),
    responses(
    (status = 200, description = "The stored bytes", content((Image = "image/png"), (Image = "image/tiff")), headers(
        ("etag" = String, description = "Its digest, quoted"), ("repr-digest" = String, description = "RFC 9530"))),
    (status = 304, description = "The client has it"),
    ReadProblems))]
pub async fn get_frame(
    State(app): State<App>,
    Path((id, view, frame)): Path<(Uuid, u32, u32)>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let acquisition = acquisitions::load_with_frames(&app, id).await?;
    place(&acquisition, view, frame)?;
    let row = app
        .store
        .frame(Id(id), view, frame)
        .await?
        .ok_or_else(|| Problem::not_found(format!("frame {frame} of view {view} has not arrived")))?;
    let tags = digest_headers(&row);
    if known(&headers, &tags[0].1) {
        return Ok((StatusCode::NOT_MODIFIED, tags).into_response());
    }
    let path = app.store.folder().frame(row.acquisition_id, view, frame, &row.sha256);
    let file = tokio::fs::File::open(&path).await.map_err(|e| Problem::failure(format!("{}: {e}", path.display())))?;
    let body = Body::from_stream(tokio_util::io::ReaderStream::with_capacity(file, 1 << 16));
    let content_type = HeaderValue::from_str(&row.content_type).map_err(Problem::failure)?;
    let length = HeaderValue::from(row.bytes);
    Ok((tags, [(header::CONTENT_TYPE, content_type), (header::CONTENT_LENGTH, length)], body).into_response())
}
