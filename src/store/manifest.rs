//! Manifests: what clients say they will send, so that the service can say what is missing, and need not be sent what it holds.

use super::acquisitions::Acquisition;
use super::frames::{Frame, FrameStored};
use super::{Id, Store, StoreError, digest, folder, frames::run_blocking};
use sqlx::SqliteConnection;

/// A frame that a client will send.
#[derive(Debug, Clone, PartialEq, sqlx::FromRow)]
pub struct AnnouncedFrame {
    /// The view.
    pub view: u32,
    /// Number within the view.
    pub frame: u32,
    /// Digest of its bytes, lower-case hex.
    pub sha256: String,
    /// Length of its file.
    pub bytes: i64,
    /// Camera lines.
    pub lines: u32,
}

/// What came of an announcement.
#[derive(Debug, Clone, PartialEq)]
pub enum Announcement {
    /// It is recorded.
    Taken,
    /// A frame that is there has another digest; nothing was changed.
    Contradiction(Frame),
    /// The acquisition takes no frames any more; nothing was changed.
    Complete,
    /// The acquisition is gone.
    Unknown,
}

/// What is there of a view.
#[derive(Debug, Clone, PartialEq, sqlx::FromRow)]
pub struct StoredView {
    /// The view.
    pub view: u32,
    /// Its frames.
    pub frames: i64,
    /// Their bytes.
    pub bytes: i64,
    /// Their camera lines.
    pub lines: i64,
}

/// First line of every frame of a view and of the one after its last, as far as there are frames or announcements without gap.
pub(super) async fn first_lines(
    connection: &mut SqliteConnection,
    acquisition: Id,
    view: u32,
) -> Result<Vec<u64>, StoreError> {
    let known: Vec<(u32, u32)> = sqlx::query_as(
        "select frame, lines from frame where acquisition_id = $1 and view = $2
         union select n.frame, n.lines from announced_frame n where n.acquisition_id = $1 and n.view = $2 and not exists
           (select 1 from frame f where f.acquisition_id = $1 and f.view = $2 and f.frame = n.frame)
         order by 1",
    )
    .bind(acquisition)
    .bind(view)
    .fetch_all(connection)
    .await?;
    let mut first_lines = vec![0];
    for (expected, (frame, lines)) in (0..).zip(known) {
        if frame != expected {
            break;
        }
        let before = first_lines.last().copied().unwrap_or_default();
        first_lines.push(before + u64::from(lines));
    }
    Ok(first_lines)
}

impl Store {
    /// Records what will be sent. A frame that is not there yet may be announced anew with other content: the client knows best
    /// until the bytes arrive.
    pub async fn announce(&self, acquisition: Id, frames: &[AnnouncedFrame]) -> Result<Announcement, StoreError> {
        let mut tx = self.write().await?;
        let state: Option<String> = sqlx::query_scalar("select state from acquisition where id = $1")
            .bind(acquisition)
            .fetch_optional(&mut *tx)
            .await?;
        let Some(state) = state else { return Ok(Announcement::Unknown) };
        for new in frames {
            let there: Option<Frame> =
                sqlx::query_as("select * from frame where acquisition_id = $1 and view = $2 and frame = $3")
                    .bind(acquisition)
                    .bind(new.view)
                    .bind(new.frame)
                    .fetch_optional(&mut *tx)
                    .await?;
            match there {
                Some(frame) if frame.sha256 != new.sha256 => return Ok(Announcement::Contradiction(frame)),
                None if state != "open" => return Ok(Announcement::Complete),
                _ => {}
            }
            sqlx::query(
                "insert into announced_frame (acquisition_id, view, frame, sha256, bytes, lines) values ($1, $2, $3, $4, $5, $6)
                 on conflict do update set sha256 = excluded.sha256, bytes = excluded.bytes, lines = excluded.lines",
            )
            .bind(acquisition)
            .bind(new.view)
            .bind(new.frame)
            .bind(&new.sha256)
            .bind(new.bytes)
            .bind(new.lines)
            .execute(&mut *tx)
            .await?;
        }
        tx.commit().await?;
        Ok(Announcement::Taken)
    }

    /// What was announced for a frame.
    pub async fn announced(
        &self,
        acquisition: Id,
        view: u32,
        frame: u32,
    ) -> Result<Option<AnnouncedFrame>, StoreError> {
        Ok(sqlx::query_as("select * from announced_frame where acquisition_id = $1 and view = $2 and frame = $3")
            .bind(acquisition)
            .bind(view)
            .bind(frame)
            .fetch_optional(self.reader())
            .await?)
    }

    /// What is there of each view.
    pub async fn stored_views(&self, acquisition: Id) -> Result<Vec<StoredView>, StoreError> {
        Ok(sqlx::query_as(
            "select view, count(*) as frames, sum(bytes) as bytes, sum(lines) as lines from frame where acquisition_id = $1
             group by view order by view",
        )
        .bind(acquisition)
        .fetch_all(self.reader())
        .await?)
    }

    /// One digest for all frames: the SHA-256 of a line `view frame sha256 bytes` for each, in order, lower-case hex.
    pub async fn manifest_digest(&self, acquisition: Id) -> Result<String, StoreError> {
        let frames: Vec<(u32, u32, String, i64)> = sqlx::query_as(
            "select view, frame, sha256, bytes from frame where acquisition_id = $1 order by view, frame",
        )
        .bind(acquisition)
        .fetch_all(self.reader())
        .await?;
        Ok(digest::of_manifest(
            frames.iter().map(|(view, frame, sha256, bytes)| (*view, *frame, &**sha256, *bytes as u64)),
        ))
    }

    /// Takes over a frame that another acquisition (or another number of this one) holds with the same digest: it is linked, so
    /// nothing is sent and no second copy is made. True if the frame is there now.
    pub async fn adopt_frame(
        &self,
        acquisition: &Acquisition,
        new: &AnnouncedFrame,
        now_ms: i64,
    ) -> Result<bool, StoreError> {
        let twin: Option<Frame> = sqlx::query_as(
            "select f.* from frame f join acquisition a on a.id = f.acquisition_id
             where f.sha256 = $1 and f.bytes = $2 and f.damaged_at_ms is null and a.frames_removed_at_ms is null and a.sensor_px = $3 limit 1",
        )
        .bind(&new.sha256)
        .bind(new.bytes)
        .bind(acquisition.row.sensor_px)
        .fetch_optional(self.reader())
        .await?;
        let Some(twin) = twin else { return Ok(false) };
        let from = self.folder().frame(twin.acquisition_id, twin.view, twin.frame, &twin.sha256);
        let link = self.folder().uploads().join(uuid::Uuid::new_v4().to_string());
        let (to, sha256) = (link.clone(), twin.sha256.clone());
        let sound = run_blocking(move || {
            // What cannot be linked or is not what it should be is sent again: slower, but never wrong.
            let sound = std::fs::hard_link(&from, &to).is_ok() && digest::of_file(&to).is_ok_and(|d| d == sha256);
            if !sound {
                folder::remove(&to)?;
            }
            Ok(sound)
        })
        .await?;
        if !sound {
            return Ok(false);
        }
        let row = Frame {
            acquisition_id: acquisition.row.id,
            view: new.view,
            frame: new.frame,
            received_at_ms: now_ms,
            damaged_at_ms: None,
            sha256: new.sha256.clone(),
            bytes: twin.bytes,
            lines: twin.lines,
            content_type: twin.content_type,
        };
        let kept = self.keep_frame(&link, row).await?;
        folder::remove(&link)?; // renaming a link onto its own file leaves both names
        Ok(matches!(kept, FrameStored::New(_) | FrameStored::Same(_)))
    }
}
