//! Unpacks archives that arrived whole: every frame passes the checks that a frame sent alone passes. An archive is taken as a whole
//! or not at all.

use super::archive_entries::{ArchiveError, Contents, contents, each_frame};
use super::auth::Caller;
use super::extract::Path;
use super::problem::ReadProblems;
use super::raw_dump::RawDump;
use super::space::Room;
use super::{Problem, acquisitions, frames, times, tus};
use crate::app::App;
use crate::pipeline::acquisition::RopeFile;
use crate::store::acquisitions::{NewAcquisition, NewView};
use crate::store::archives::Archive;
use crate::store::completion::Completion;
use crate::store::digest::hex;
use crate::store::frames::{Frame, FrameStored};
use crate::store::{Created, StoreError};
use axum::Extension;
use axum::extract::State;
use serde::Serialize;
use serde_json::Value;
use sha2::{Digest, Sha256};
use std::io::{Read, Write};
use std::time::Duration;
use tempfile::NamedTempFile;
use tokio::runtime::Handle;
use utoipa::ToSchema;
use uuid::Uuid;

/// Wait before an archive is unpacked anew when the service was at fault: no room, most likely.
const AGAIN: Duration = Duration::from_secs(30);

/// A recording that comes as one file.
#[derive(Debug, Serialize, ToSchema)]
pub struct ArchiveState {
    /// Id.
    id: Uuid,
    /// Where it stands.
    #[schema(pattern = "^(receiving|unpacking|unpacked|refused)$")]
    state: String,
    /// Bytes of the whole file.
    length: i64,
    /// Bytes that are durable.
    received: i64,
    /// The acquisition that came of it.
    #[schema(required)]
    acquisition_id: Option<Uuid>,
    /// Why it was refused, as a problem document.
    #[schema(required, value_type = Option<Object>)]
    problem: Option<Value>,
    /// When it is removed if no byte comes.
    #[schema(format = DateTime)]
    expires_at: String,
}

/// What became of a recording that was sent as one file (tar, zip or camera dump) over tus 1.0
///
/// The file itself is sent with a tus client: creation is POST /api/v1/tus, with `rope_id` in Upload-Metadata, and `rope_json` for a dump.
#[utoipa::path(get, path = "/archives/{id}", tag = "acquisitions", params(("id" = Uuid, Path, description = "The archive")),
    responses((status = 200, description = "Where it stands", body = ArchiveState), ReadProblems))]
pub async fn get_archive(
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    Path(id): Path<Uuid>,
) -> Result<axum::Json<ArchiveState>, Problem> {
    let archive = tus::load(&app, &caller, id).await?;
    Ok(axum::Json(ArchiveState {
        id,
        length: archive.length,
        received: archive.received,
        acquisition_id: (archive.state == "unpacked").then_some(id),
        problem: archive.problem.as_deref().and_then(|json| serde_json::from_str(json).ok()),
        expires_at: times::rfc3339(archive.expires_at_ms),
        state: archive.state,
    }))
}

/// Goes on with archives that an earlier process did not finish.
pub async fn resume(app: App) {
    match app.store.archives_to_unpack().await {
        Ok(archives) => {
            for archive in archives {
                unpack(app.clone(), archive).await;
            }
        }
        Err(error) => tracing::error!(%error, "archives cannot be looked up"),
    }
}

/// Unpacks an archive and settles it. What is the service's own fault is tried again until it works.
pub async fn unpack(app: App, archive: Archive) {
    let problem = loop {
        match try_unpack(&app, &archive).await {
            Ok(()) => break None,
            Err(problem) if !problem.is_of_the_service() => break Some(problem),
            Err(problem) => tracing::warn!(archive = %archive.id, ?problem, "not unpacked yet"),
        }
        tokio::select! {
            () = app.shutdown.cancelled() => return,
            () = tokio::time::sleep(AGAIN) => {}
        }
    };
    let settled = async {
        let text = problem.map(|problem| serde_json::to_string(&problem).unwrap_or_default());
        if text.is_some() {
            app.store.delete_acquisition(archive.id).await?; // as a whole or not at all
        }
        app.store.settle_archive(archive.id, text.as_deref()).await
    };
    if let Err(error) = settled.await {
        tracing::error!(archive = %archive.id, %error, "an archive could not be settled; it is at the next start");
    }
}

async fn try_unpack(app: &App, archive: &Archive) -> Result<(), Problem> {
    let path = app.store.archive_path(archive.id);
    let recording = match tus::raw_dump(&archive.metadata, archive.length.unsigned_abs())? {
        Some(dump) => Recording::Dump(dump),
        None => {
            let (reading, limit) = (path.clone(), app.settings.limits.frame_bytes);
            let read = tokio::task::spawn_blocking(move || contents(&reading, limit));
            Recording::Folder(read.await.map_err(Problem::failure)??)
        }
    };
    let rope = app.store.rope(archive.rope_id).await?.ok_or_else(|| Problem::no("rope", archive.rope_id))?;
    let file = recording.rope_file();
    let (ours, theirs) = ((rope.design.strands, rope.design.wires_per_strand), (file.strands, file.wires_per_strand));
    if (ours.0 as usize, ours.1 as usize) != theirs {
        return Err(Problem::archive_refused(format!(
            "its rope.json is of a {}x{} rope, but the rope is {}x{}",
            theirs.0, theirs.1, ours.0, ours.1
        )));
    }
    let acquired_at_ms = file.acquired_at.as_deref().map(|text| times::parse("acquired_at", text)).transpose()?;
    let new = NewAcquisition {
        id: archive.id,
        rope_id: rope.id,
        line_pitch_mm: file.line_pitch_mm,
        sensor_px: file.sensor_px,
        rope_width_px: file.rope_width_px,
        start_m: file.start_m.unwrap_or(0.0),
        acquired_at_ms,
        views: file
            .views
            .iter()
            .zip(recording.frames())
            .map(|(view, frames)| NewView {
                angle_deg: view.angle_deg,
                px_per_mm: view.px_per_mm,
                frames: Some(frames),
            })
            .collect(),
    };
    acquisitions::check(&rope, &new)?;
    if app.store.create_acquisition(&new, app.now_ms()).await? == Created::Different {
        return Err(Problem::id_in_use(format!("acquisition {} exists with other content", archive.id)));
    }
    let room = Room::take(app, archive.id, recording.bytes(archive)).await?;
    let sensor_px = file.sensor_px;
    let unpacking = Unpacking { app: app.clone(), archive: archive.clone(), sensor_px, room };
    tokio::task::spawn_blocking(move || unpacking.run(&path, &recording)).await.map_err(Problem::failure)??;
    match app.store.complete_acquisition(archive.id, None, app.now_ms()).await? {
        Completion::Complete => Ok(()),
        other => Err(Problem::failure(format!("an unpacked archive is not complete: {other:?}"))),
    }
}

/// What came as one file.
enum Recording {
    /// A tar or zip file of a folder.
    Folder(Contents),
    /// Gray values of cameras.
    Dump(RawDump),
}

impl Recording {
    fn rope_file(&self) -> &RopeFile {
        match self {
            Self::Folder(contents) => &contents.rope_file,
            Self::Dump(dump) => &dump.rope_file,
        }
    }

    fn frames(&self) -> Vec<u32> {
        match self {
            Self::Folder(contents) => contents.frames.clone(),
            Self::Dump(dump) => dump.frames(),
        }
    }

    /// Bytes that its frames will have, at most.
    fn bytes(&self, archive: &Archive) -> u64 {
        match self {
            Self::Folder(contents) => contents.bytes,
            Self::Dump(_) => archive.length.unsigned_abs(),
        }
    }
}

/// One reading of an archive, frame by frame.
struct Unpacking {
    app: App,
    archive: Archive,
    sensor_px: u32,
    room: Room,
}

impl Unpacking {
    fn run(mut self, path: &std::path::Path, recording: &Recording) -> Result<(), Problem> {
        let runtime = Handle::current();
        let limit = self.app.settings.limits.frame_bytes;
        let keep = |view, number, content: &mut dyn Read| self.keep(&runtime, view, number, content);
        match recording {
            Recording::Folder(contents) => each_frame(path, contents, limit, keep),
            Recording::Dump(dump) => dump.each_frame(path, keep),
        }
    }

    fn keep(&mut self, runtime: &Handle, view: u32, frame: u32, content: &mut dyn Read) -> Result<(), Problem> {
        let mut bytes = Vec::new();
        content.read_to_end(&mut bytes).map_err(ArchiveError::from)?;
        let folder = self.app.store.folder().uploads();
        let written = NamedTempFile::new_in(&folder).and_then(|mut file| file.write_all(&bytes).map(|()| file));
        let file = written.map_err(|source| StoreError::File { path: folder, source })?;
        self.room.arrived(bytes.len() as u64);
        let named = |problem: Problem| problem.with("view", view).with("frame", frame);
        let (lines, content_type) = frames::check(file.path(), self.sensor_px)
            .map_err(|error| named(frames::refused(error, self.sensor_px)))?;
        let row = Frame {
            acquisition_id: self.archive.id,
            view,
            frame,
            sha256: hex(&Sha256::digest(&bytes)),
            bytes: bytes.len() as i64,
            lines,
            content_type: content_type.to_owned(),
            received_at_ms: self.app.now_ms(),
            damaged_at_ms: None,
        };
        match runtime.block_on(self.app.store.keep_frame(file.path(), row))? {
            FrameStored::New(_) | FrameStored::Same(_) => Ok(()),
            other => Err(named(Problem::archive_refused(format!(
                "frame {frame} of view {view} cannot be stored: {other:?}"
            )))),
        }
    }
}

impl From<ArchiveError> for Problem {
    fn from(error: ArchiveError) -> Self {
        Self::archive_refused(error.to_string())
    }
}
