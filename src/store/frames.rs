//! Frames: files that are durable before their row is, and rows that are durable before the client hears of it.

use super::acquisitions::Acquisition;
use super::{Id, Store, StoreError, folder};
use crate::pipeline::FrameFiles;
use std::path::Path;

/// A frame that is there.
#[derive(Debug, Clone, PartialEq, sqlx::FromRow)]
pub struct Frame {
    /// The acquisition.
    pub acquisition_id: Id,
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
    /// `image/png` or `image/tiff`.
    pub content_type: String,
    /// When it was acknowledged, ms since 1970.
    pub received_at_ms: i64,
    /// When its file was found gone or changed, ms since 1970; `None` while it is sound.
    pub damaged_at_ms: Option<i64>,
}

/// What came of a frame that was sent.
#[derive(Debug, Clone, PartialEq)]
pub enum FrameStored {
    /// It is new, or sound again after it was damaged, and durable.
    New(Frame),
    /// The same bytes were there already.
    Same(Frame),
    /// Other bytes are there under this number; nothing was changed.
    Different(Frame),
    /// The acquisition takes no frames any more; nothing was changed.
    Complete,
    /// The acquisition, the view or the announced frame number does not exist (any more).
    NoPlace,
}

impl Store {
    /// A frame.
    pub async fn frame(&self, acquisition: Id, view: u32, frame: u32) -> Result<Option<Frame>, StoreError> {
        Ok(sqlx::query_as("select * from frame where acquisition_id = $1 and view = $2 and frame = $3")
            .bind(acquisition)
            .bind(view)
            .bind(frame)
            .fetch_optional(self.reader())
            .await?)
    }

    /// Frames of a view in order.
    pub async fn frames(&self, acquisition: Id, view: u32) -> Result<Vec<Frame>, StoreError> {
        Ok(sqlx::query_as("select * from frame where acquisition_id = $1 and view = $2 order by frame")
            .bind(acquisition)
            .bind(view)
            .fetch_all(self.reader())
            .await?)
    }

    /// Whether an acquisition is complete, and how many frames of all views are there. Errors: there is no such acquisition.
    pub async fn arrived(&self, acquisition: Id) -> Result<(bool, i64), StoreError> {
        Ok(sqlx::query_as(
            "select state = 'complete', (select sum(frames_present) from view where acquisition_id = $1) from acquisition where id = $1",
        )
        .bind(acquisition)
        .fetch_one(self.reader())
        .await?)
    }

    /// Frames of a view from number `from` on without a gap, at most `limit`. A frame that was found damaged is a gap while it may
    /// be sent again: in an acquisition that is not `complete`.
    pub async fn frames_from(
        &self,
        acquisition: Id,
        view: u32,
        from: u32,
        limit: u32,
        complete: bool,
    ) -> Result<Vec<Frame>, StoreError> {
        let frames: Vec<Frame> = sqlx::query_as(
            "select * from frame where acquisition_id = $1 and view = $2 and frame >= $3 and (damaged_at_ms is null or $5)
             order by frame limit $4",
        )
        .bind(acquisition)
        .bind(view)
        .bind(from)
        .bind(limit)
        .bind(complete)
        .fetch_all(self.reader())
        .await?;
        Ok(frames.into_iter().zip(from..).take_while(|(f, number)| f.frame == *number).map(|(f, _)| f).collect())
    }

    /// When the last frame of an acquisition was acknowledged, ms since 1970.
    pub async fn last_arrival_ms(&self, acquisition: Id) -> Result<Option<i64>, StoreError> {
        Ok(sqlx::query_scalar("select max(received_at_ms) from frame where acquisition_id = $1")
            .bind(acquisition)
            .fetch_one(self.reader())
            .await?)
    }

    /// The frames of all views, for the pipeline.
    pub async fn frame_files(&self, acquisition: &Acquisition) -> Result<FrameFiles, StoreError> {
        let mut paths = Vec::with_capacity(acquisition.views.len());
        for view in &acquisition.views {
            let frames = self.frames(acquisition.row.id, view.view).await?;
            paths.push(
                frames.iter().map(|f| self.folder().frame(f.acquisition_id, f.view, f.frame, &f.sha256)).collect(),
            );
        }
        Ok(FrameFiles::new(acquisition.row.sensor_px, paths))
    }

    /// Takes a checked upload into the store: file first, then row. `upload` must be closed and on the same file system; it
    /// is gone afterwards if it was needed.
    pub async fn keep_frame(&self, upload: &Path, frame: Frame) -> Result<FrameStored, StoreError> {
        let place = self.folder().frame(frame.acquisition_id, frame.view, frame.frame, &frame.sha256);
        let (from, to) = (upload.to_owned(), place.clone());
        run_blocking(move || {
            folder::sync_folder(&from)?; // fsync of the file
            folder::move_durably(&from, &to)
        })
        .await?;
        let outcome = self.record_frame(frame).await?;
        if !matches!(outcome, FrameStored::New(_) | FrameStored::Same(_)) {
            // Not ours to keep; the digest in the name makes sure that it is no other upload's.
            run_blocking(move || folder::remove(&place)).await?;
        }
        Ok(outcome)
    }

    async fn record_frame(&self, frame: Frame) -> Result<FrameStored, StoreError> {
        let mut tx = self.write().await?;
        let place: Option<(String, Option<u32>)> = sqlx::query_as(
            "select a.state, v.frames_expected from acquisition a join view v on v.acquisition_id = a.id and v.view = $2 where a.id = $1",
        )
        .bind(frame.acquisition_id)
        .bind(frame.view)
        .fetch_optional(&mut *tx)
        .await?;
        let Some((state, expected)) = place else { return Ok(FrameStored::NoPlace) };
        let old: Option<Frame> =
            sqlx::query_as("select * from frame where acquisition_id = $1 and view = $2 and frame = $3")
                .bind(frame.acquisition_id)
                .bind(frame.view)
                .bind(frame.frame)
                .fetch_optional(&mut *tx)
                .await?;
        if let Some(old) = old {
            if old.sha256 != frame.sha256 {
                return Ok(FrameStored::Different(old));
            }
            if old.damaged_at_ms.is_none() {
                return Ok(FrameStored::Same(old));
            }
            sqlx::query(
                "update frame set damaged_at_ms = null, received_at_ms = $4 where acquisition_id = $1 and view = $2 and frame = $3",
            )
            .bind(frame.acquisition_id)
            .bind(frame.view)
            .bind(frame.frame)
            .bind(frame.received_at_ms)
            .execute(&mut *tx)
            .await?;
            tx.commit().await?;
            self.arrivals.send_replace(());
            return Ok(FrameStored::New(frame));
        }
        if state != "open" {
            return Ok(FrameStored::Complete);
        }
        if expected.is_some_and(|expected| frame.frame >= expected) {
            return Ok(FrameStored::NoPlace);
        }
        sqlx::query(
            "insert into frame (acquisition_id, view, frame, sha256, bytes, lines, content_type, received_at_ms)
             values ($1, $2, $3, $4, $5, $6, $7, $8)",
        )
        .bind(frame.acquisition_id)
        .bind(frame.view)
        .bind(frame.frame)
        .bind(&frame.sha256)
        .bind(frame.bytes)
        .bind(frame.lines)
        .bind(&frame.content_type)
        .bind(frame.received_at_ms)
        .execute(&mut *tx)
        .await?;
        sqlx::query("update view set frames_present = frames_present + 1 where acquisition_id = $1 and view = $2")
            .bind(frame.acquisition_id)
            .bind(frame.view)
            .execute(&mut *tx)
            .await?;
        sqlx::query("update acquisition set frame_bytes = frame_bytes + $2 where id = $1")
            .bind(frame.acquisition_id)
            .bind(frame.bytes)
            .execute(&mut *tx)
            .await?;
        tx.commit().await?;
        self.arrivals.send_replace(());
        Ok(FrameStored::New(frame))
    }

    /// Removes what a killed process left behind: uploads that never ended, frames and previews without a row, and, if no other process
    /// works on the folder, results without a row. Returns how many files and folders went.
    pub async fn sweep(&self, alone: bool) -> Result<usize, StoreError> {
        let mut orphans = folder::entries(&self.folder().uploads())?;
        let archives: Vec<String> =
            sqlx::query_scalar("select id from archive where state in ('receiving', 'unpacking')")
                .fetch_all(self.reader())
                .await?;
        let without_row = |path: &std::path::PathBuf| !archives.iter().any(|id| path.ends_with(id));
        orphans.extend(folder::entries(&self.folder().archives())?.into_iter().filter(without_row));
        for (root, rows) in [
            (
                self.folder().frames(),
                "select f.view, f.frame, f.sha256 from frame f join acquisition a on a.id = f.acquisition_id
                 where a.id = $1 and a.frames_removed_at_ms is null",
            ),
            (self.folder().previews(), "select view, frame, sha256 from preview where acquisition_id = $1"),
        ] {
            for acquisition in folder::entries(&root)? {
                let name = acquisition.file_name().and_then(|n| n.to_str()).unwrap_or_default().to_owned();
                let known: std::collections::HashSet<(u32, u32, String)> =
                    sqlx::query_as(rows).bind(&name).fetch_all(self.reader()).await?.into_iter().collect();
                for view in folder::entries(&acquisition)? {
                    for file in folder::entries(&view)? {
                        if !frame_of(&file).is_some_and(|key| known.contains(&key)) {
                            orphans.push(file);
                        }
                    }
                }
            }
        }
        if alone {
            orphans.extend(folder::entries(&self.folder().work())?);
            let models: Vec<String> = sqlx::query_scalar("select id from model").fetch_all(self.reader()).await?;
            let inspections: Vec<String> =
                sqlx::query_scalar("select id from inspection").fetch_all(self.reader()).await?;
            for (place, known) in [(self.folder().models(), models), (self.folder().inspections(), inspections)] {
                orphans.extend(
                    folder::entries(&place)?.into_iter().filter(|path| {
                        !known.iter().any(|id| path.file_name().is_some_and(|name| name == id.as_str()))
                    }),
                );
            }
        }
        let count = orphans.len();
        run_blocking(move || orphans.iter().try_for_each(|path| folder::remove(path))).await?;
        Ok(count)
    }
}

/// View, frame and digest that a frame's path tells.
fn frame_of(path: &Path) -> Option<(u32, u32, String)> {
    let view = path.parent()?.file_name()?.to_str()?.parse().ok()?;
    let (frame, sha256) = path.file_name()?.to_str()?.split_once('-')?;
    Some((view, frame.parse().ok()?, sha256.to_owned()))
}

/// File work that waits for the disk, off the async threads.
pub(crate) async fn run_blocking<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, StoreError> + Send + 'static,
) -> Result<T, StoreError> {
    match tokio::task::spawn_blocking(work).await {
        Ok(done) => done,
        Err(error) => {
            Err(StoreError::File { path: "a background file operation".into(), source: std::io::Error::other(error) })
        }
    }
}
