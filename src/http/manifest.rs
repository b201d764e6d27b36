//! Manifests: a client says what it will send, and hears what need not be sent and whether there is room.

use super::acquisitions;
use super::extract::{Json, Path};
use super::problem::WriteProblems;
use super::{Problem, frames, space};
use crate::app::App;
use crate::pipeline::source::MAX_FRAME_LINES;
use crate::store::Id;
use crate::store::manifest::{AnnouncedFrame, Announcement};
use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

/// Most frames of one announcement; a longer manifest comes in several.
pub const MAX_ENTRIES: usize = 1000;

/// A frame that will be sent.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ManifestEntry {
    /// The view, from 0.
    #[schema(minimum = 0, maximum = 7)]
    view: u32,
    /// Number within the view, from 0.
    #[schema(minimum = 0, maximum = 999999)]
    frame: u32,
    /// SHA-256 of its bytes, lower-case hex.
    #[schema(pattern = "^[0-9a-f]{64}$")]
    sha256: String,
    /// How many bytes it has.
    #[schema(minimum = 1, maximum = 67108864)]
    bytes: u64,
    /// Camera lines (image rows): tells the rope metres of what is missing.
    #[schema(minimum = 1, maximum = 65536)]
    lines: u32,
}

/// Frames that will be sent, in any order. May be sent again, and grow, while the acquisition is open.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// The frames.
    #[schema(min_items = 1, max_items = 1000)]
    frames: Vec<ManifestEntry>,
}

/// A frame by its numbers.
#[derive(Debug, Serialize, ToSchema)]
pub struct FrameNumber {
    /// The view.
    view: u32,
    /// Number within the view.
    frame: u32,
}

/// What is to be sent.
#[derive(Debug, Serialize, ToSchema)]
pub struct ManifestAnswer {
    /// Frames of this announcement that have to be sent; the service holds the others.
    to_send: Vec<FrameNumber>,
    /// Bytes of all announced frames of the acquisition that are not there.
    missing_bytes: i64,
}

/// Announce frames before they are sent
///
/// Refused with 507 and figures when disk or quota have no room for all of them. A frame that the service already holds, of
/// whatever acquisition, is taken from there.
#[utoipa::path(post, path = "/acquisitions/{id}/manifest", tag = "acquisitions",
    params(("id" = Uuid, Path, description = "The acquisition")), request_body = Manifest,
    responses((status = 200, description = "What is to be sent", body = ManifestAnswer), WriteProblems))]
pub async fn post_manifest(
    State(app): State<App>,
    Path(id): Path<Uuid>,
    Json(body): Json<Manifest>,
) -> Result<axum::Json<ManifestAnswer>, Problem> {
    if !(1..=MAX_ENTRIES).contains(&body.frames.len()) {
        return Err(Problem::outside("frames", body.frames.len() as f64, 1.0, MAX_ENTRIES as f64));
    }
    let acquisition = acquisitions::load_with_frames(&app, id).await?;
    let limit = app.settings.limits.frame_bytes;
    let announced = body.frames.into_iter().map(|entry| {
        frames::place(&acquisition, entry.view, entry.frame)?;
        check(entry, limit)
    });
    let announced = announced.collect::<Result<Vec<_>, _>>()?;
    match app.store.announce(Id(id), &announced).await? {
        Announcement::Taken => {}
        Announcement::Contradiction(old) => {
            return Err(Problem::frame_differs(format!(
                "frame {} of view {} is there with digest {}, but the manifest announces another; nothing was changed",
                old.frame, old.view, old.sha256
            ))
            .with("view", old.view)
            .with("frame", old.frame));
        }
        Announcement::Complete => return Err(frames::complete(id)),
        Announcement::Unknown => return Err(Problem::no("acquisition", id)),
    }
    let mut to_send = Vec::new();
    for frame in &announced {
        let held = app.store.frame(Id(id), frame.view, frame.frame).await?.is_some_and(|f| f.damaged_at_ms.is_none());
        if !held && !app.store.adopt_frame(&acquisition, frame, app.now_ms()).await? {
            to_send.push(FrameNumber { view: frame.view, frame: frame.frame });
        }
    }
    let missing_bytes = app.store.missing_bytes(Id(id)).await?;
    space::fits_in_quota(&app, Id(id), missing_bytes.unsigned_abs()).await?;
    space::fits_on_disk(&app, missing_bytes.unsigned_abs())?;
    Ok(axum::Json(ManifestAnswer { to_send, missing_bytes }))
}

fn check(entry: ManifestEntry, limit_bytes: u64) -> Result<AnnouncedFrame, Problem> {
    let outside = |name, value: u64, max: u64| Problem::outside(name, value as f64, 1.0, max as f64);
    if !(1..=limit_bytes).contains(&entry.bytes) {
        return Err(outside("bytes", entry.bytes, limit_bytes));
    }
    if !(1..=MAX_FRAME_LINES).contains(&entry.lines) {
        return Err(outside("lines", entry.lines.into(), MAX_FRAME_LINES.into()));
    }
    let hex = |c: u8| c.is_ascii_digit() || (b'a'..=b'f').contains(&c);
    if entry.sha256.len() != 64 || !entry.sha256.bytes().all(hex) {
        return Err(Problem::out_of_range(format!(
            "sha256 is {:?}, but must be 64 lower-case hex digits",
            entry.sha256
        ))
        .with("field", "sha256"));
    }
    Ok(AnnouncedFrame {
        view: entry.view,
        frame: entry.frame,
        sha256: entry.sha256,
        bytes: entry.bytes as i64,
        lines: entry.lines,
    })
}
