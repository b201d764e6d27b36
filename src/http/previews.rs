//! Previews: reduced forms of frames, sent before them over thin links. What they show appears within minutes as the findings of a job
//! that has no result, and decides which frames are wanted first.

use super::extract::Path;
use super::frames::{self, Image};
use super::problem::{ReadProblems, WriteProblems};
use super::upload::{Arrived, Promise, receive};
use super::{Problem, acquisitions, auth, times};
use crate::app::App;
use crate::pipeline::preview::{self, LEAST_SENSOR_PX, REDUCTION};
use crate::pipeline::source;
use crate::store::Id;
use crate::store::previewed::PreviewedStretch;
use crate::store::previews::{Preview as Row, PreviewStored};
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use serde_json::json;
use utoipa::ToSchema;
use uuid::Uuid;

/// Previews are received at views of their own, so that they and frames do not end each other's requests.
const PLACE: u32 = 1 << 16;

/// A preview that is there.
#[derive(Debug, Serialize, ToSchema)]
pub struct Preview {
    /// The acquisition.
    acquisition_id: Uuid,
    /// The view.
    view: u32,
    /// Number of the frame of which it is the reduced form.
    frame: u32,
    /// Digest of its bytes, lower-case hex.
    sha256: String,
    /// Length of its file.
    bytes: i64,
    /// Its lines.
    lines: u32,
    /// When it was acknowledged.
    #[schema(format = DateTime)]
    received_at: String,
}

impl From<Row> for Preview {
    fn from(row: Row) -> Self {
        Self {
            acquisition_id: row.acquisition_id.0,
            view: row.view,
            frame: row.frame,
            sha256: row.sha256,
            bytes: row.bytes,
            lines: row.lines,
            received_at: times::rfc3339(row.received_at_ms),
        }
    }
}

/// What previews show of a view that is not usable.
#[derive(Debug, PartialEq, Serialize, ToSchema)]
pub struct NotUsable {
    /// Rope metre where it begins.
    from_m: f64,
    /// Rope metre where it ends.
    to_m: f64,
    /// Why.
    reason: String,
}

/// The previews of a view, and what they show.
#[derive(Debug, Serialize, ToSchema)]
pub struct PreviewedView {
    /// The view.
    view: u32,
    /// Previews that the view shall have; null if nobody said how many frames it has.
    #[schema(required)]
    expected: Option<u32>,
    /// Previews that are there.
    present: u32,
    /// First and last number of each gap, at most 1000 gaps.
    missing: Vec<[u32; 2]>,
    /// Metres that were aligned so far.
    seen_m: f64,
    /// Metres of these that are usable.
    usable_m: f64,
    /// Where the view is not usable, and why.
    not_usable: Vec<NotUsable>,
}

/// The previews of an acquisition. What they show is provisional and no result.
#[derive(Debug, Serialize, ToSchema)]
pub struct Previews {
    /// Camera lines that become one line of a preview, and columns that become one column.
    reduction: u32,
    /// Bytes of the previews that are there.
    bytes: i64,
    /// The job that looks at them: its provisional lay lengths stay until the acquisition is complete. Null before the first preview.
    #[schema(required)]
    job_id: Option<Uuid>,
    /// One entry a view.
    views: Vec<PreviewedView>,
}

/// Send the reduced form of an announced frame, before the frame itself
///
/// Line g of the previews of a view is the mean of its camera lines 4 g to 4 g + 3, however these were cut into frames; it belongs to
/// the preview of the frame in which the four begin. Columns are reduced alike. The first preview queues a job that looks at them.
/// Previews are never taken for frames, and go when the acquisition is complete.
#[utoipa::path(put, path = "/acquisitions/{id}/views/{view}/previews/{frame}", tag = "acquisitions", params(
    ("id" = Uuid, Path, description = "The acquisition"),
    ("view" = u32, Path, description = "The view, from 0"),
    ("frame" = u32, Path, description = "Number of the frame, from 0"),
    ("repr-digest" = Option<String>, Header, description = "RFC 9530; `sha-256=:<base64>:` of the body, verified if sent", pattern = "^sha-256=:[A-Za-z0-9+/]{42}[AEIMQUYcgkosw048]=:$")),
    request_body(description = "8 or 16 bit gray, a quarter of the columns of the sensor", content(
        (Image = "image/png"), (Image = "image/tiff"), (Image = "application/octet-stream"))),
    responses(
    (status = 201, description = "It is durable", body = Preview),
    (status = 200, description = "The same bytes were there already", body = Preview),
    WriteProblems))]
pub async fn put_preview(
    State(app): State<App>,
    Path((id, view, frame)): Path<(Uuid, u32, u32)>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let arrived = receive(&app, &headers, body, (id, PLACE.saturating_add(view), frame), async || {
        let acquisition = acquisitions::load_with_frames(&app, id).await?;
        frames::place(&acquisition, view, frame)?;
        if acquisition.complete() {
            return Err(frames::complete(id));
        }
        let sensor_px = acquisition.row.sensor_px;
        if sensor_px < LEAST_SENSOR_PX {
            return Err(Problem::preview_wrong_size(format!(
                "frames of {sensor_px} columns have no previews, only those of {LEAST_SENSOR_PX} or more: send the frames themselves"
            ))
            .limit(sensor_px, LEAST_SENSOR_PX));
        }
        let camera_lines = app.store.lines_of_frame(Id(id), view, frame).await?.ok_or_else(|| {
            Problem::frame_not_announced(format!(
                "frame {frame} of view {view} or one before it is in no manifest, so nobody knows where its preview begins: announce them first"
            ))
        })?;
        let size = (preview::columns_of(sensor_px), preview::lines_of(camera_lines.clone()));
        Ok(((camera_lines.start, size), Promise { bytes: Some(app.settings.limits.frame_bytes / 8), sha256: None }))
    })
    .await?;
    auth::authenticate(&app, &headers).await?.one_of(auth::UPLOADERS)?;
    keep(&app, arrived, (id, view, frame)).await
}

/// First camera line of the frame, and columns and lines of its preview.
type Expected = (u64, (u32, u32));

async fn keep(app: &App, arrived: Arrived<Expected>, (id, view, frame): (Uuid, u32, u32)) -> Result<Response, Problem> {
    let (first_line, size) = arrived.context;
    let permit = app.cpu.clone().acquire_owned().await.map_err(Problem::failure)?;
    let path = arrived.file.path().to_owned();
    let checked = tokio::task::spawn_blocking(move || {
        let _permit = permit;
        let there = source::dimensions(&path)?;
        if there == size {
            source::decode(&path)?;
        }
        Ok(there)
    });
    let there = checked.await.map_err(Problem::failure)?.map_err(|e| frames::refused(e, size.0))?;
    if there != size {
        return Err(Problem::preview_wrong_size(format!(
            "the image has {}x{} pixels, but the preview of frame {frame} of view {view} has {}x{}",
            there.0, there.1, size.0, size.1
        ))
        .limit(json!({ "columns": there.0, "lines": there.1 }), json!({ "columns": size.0, "lines": size.1 })));
    }
    let row = Row {
        acquisition_id: Id(id),
        view,
        frame,
        sha256: arrived.sha256.clone(),
        bytes: arrived.bytes as i64,
        first_line: first_line as i64,
        lines: size.1,
        suspicion: None,
        reason: None,
        received_at_ms: app.now_ms(),
    };
    match app.store.keep_preview(arrived.file.path(), row, app.new_id()).await? {
        PreviewStored::New(row) => {
            app.live_jobs_wake.notify_one();
            Ok((StatusCode::CREATED, axum::Json(Preview::from(row))).into_response())
        }
        PreviewStored::Same(row) => Ok((StatusCode::OK, axum::Json(Preview::from(row))).into_response()),
        PreviewStored::Different(old) => Err(Problem::frame_differs(format!(
            "another preview of frame {frame} of view {view} is there, with digest {}; nothing was changed",
            old.sha256
        ))
        .limit(arrived.sha256, old.sha256)),
        PreviewStored::Closed => Err(frames::complete(id)),
    }
}

/// Which previews are there and which are missing, and what they show of every view
#[utoipa::path(get, path = "/acquisitions/{id}/previews", tag = "acquisitions",
    params(("id" = Uuid, Path, description = "The acquisition")),
    responses((status = 200, description = "What is there; it is no result", body = Previews), ReadProblems))]
pub async fn get_previews(State(app): State<App>, Path(id): Path<Uuid>) -> Result<axum::Json<Previews>, Problem> {
    acquisitions::load(&app, id).await?;
    let there = app.store.previews_there(Id(id)).await?;
    let seen = match there.job_id {
        Some(job) => app.store.previewed(job).await?,
        None => Vec::new(),
    };
    let views = there.views.into_iter().map(|v| {
        let seen: Vec<_> = seen.iter().filter(|s| s.view == v.view).collect();
        let metres = |s: &&&PreviewedStretch| s.to_m - s.from_m;
        PreviewedView {
            view: v.view,
            expected: v.expected,
            present: v.present,
            missing: v.ranges.into_iter().map(|(first, last)| [first, last]).collect(),
            seen_m: seen.iter().map(|s| metres(&s)).sum(),
            usable_m: seen.iter().filter(|s| s.reason.is_none()).map(|s| metres(&s)).sum(),
            not_usable: not_usable(&seen),
        }
    });
    Ok(axum::Json(Previews {
        reduction: REDUCTION,
        bytes: there.bytes,
        job_id: there.job_id.map(|job| job.0),
        views: views.collect(),
    }))
}

/// Neighbouring stretches with one reason are joined.
fn not_usable(seen: &[&PreviewedStretch]) -> Vec<NotUsable> {
    let mut all: Vec<NotUsable> = Vec::new();
    for stretch in seen {
        let Some(reason) = &stretch.reason else { continue };
        match all.last_mut() {
            Some(last) if last.reason == *reason && (last.to_m - stretch.from_m).abs() < 1e-6 => {
                last.to_m = stretch.to_m
            }
            _ => all.push(NotUsable { from_m: stretch.from_m, to_m: stretch.to_m, reason: reason.clone() }),
        }
    }
    all
}
