//! Are stored frames still what they were? Every digest is computed again from the disk; what is gone or changed is marked, so that
//! it can be sent again.

use super::frames::{Frame, run_blocking};
use super::{Id, Store, StoreError, digest};

/// Frames that are looked at between two looks at the clock of the caller.
const BATCH: usize = 64;

/// What a verification found.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Verified {
    /// Frames that were looked at.
    pub frames: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Frames whose files are gone or changed.
    pub damaged: Vec<Frame>,
}

impl Store {
    /// Ids of all acquisitions, oldest first.
    pub async fn acquisition_ids(&self) -> Result<Vec<Id>, StoreError> {
        Ok(sqlx::query_scalar("select id from acquisition order by seq").fetch_all(self.reader()).await?)
    }

    /// Reads every frame of an acquisition back from the disk. `on_progress` is told how many were read, now and then.
    pub async fn verify_frames(&self, acquisition: Id, on_progress: impl Fn(u64)) -> Result<Verified, StoreError> {
        let mut verified = Verified::default();
        let frames: Vec<Frame> = sqlx::query_as(
            "select f.* from frame f join acquisition a on a.id = f.acquisition_id
             where a.id = $1 and a.frames_removed_at_ms is null order by f.view, f.frame",
        )
        .bind(acquisition)
        .fetch_all(self.reader())
        .await?;
        for batch in frames.chunks(BATCH) {
            let (folder, batch) = (self.folder().clone(), batch.to_vec());
            let judged = run_blocking(move || {
                let sound = |f: &Frame| {
                    let path = folder.frame(f.acquisition_id, f.view, f.frame, &f.sha256);
                    digest::of_file_on_disk(&path).is_ok_and(|sha256| sha256 == f.sha256)
                };
                Ok(batch.into_iter().map(|frame| (sound(&frame), frame)).collect::<Vec<_>>())
            });
            for (sound, frame) in judged.await? {
                verified.frames += 1;
                verified.bytes += frame.bytes.unsigned_abs();
                if !sound {
                    verified.damaged.push(frame);
                }
            }
            on_progress(verified.frames);
        }
        Ok(verified)
    }

    /// Ids of models whose files are gone or changed.
    pub async fn damaged_models(&self) -> Result<Vec<Id>, StoreError> {
        let models: Vec<(Id, String)> = sqlx::query_as("select id, sha256 from model").fetch_all(self.reader()).await?;
        let folder = self.folder().clone();
        run_blocking(move || {
            let sound =
                |id, sha256: &str| digest::of_file_on_disk(&folder.model(id)).is_ok_and(|there| there == sha256);
            Ok(models.into_iter().filter(|(id, sha256)| !sound(*id, sha256)).map(|(id, _)| id).collect())
        })
        .await
    }

    /// Marks frames as damaged: they are asked for again, and answered as missing until then.
    pub async fn mark_damaged(&self, frames: &[Frame], now_ms: i64) -> Result<(), StoreError> {
        let mut tx = self.write().await?;
        for frame in frames {
            sqlx::query(
                "update frame set damaged_at_ms = coalesce(damaged_at_ms, $4) where acquisition_id = $1 and view = $2 and frame = $3",
            )
            .bind(frame.acquisition_id)
            .bind(frame.view)
            .bind(frame.frame)
            .bind(now_ms)
            .execute(&mut *tx)
            .await?;
        }
        Ok(tx.commit().await?)
    }
}
