//! Retention: frames that may go after the time that their ropeway keeps them, and those that may not. Never evidence of a defect
//! that is open or confirmed, never what no inspection has searched for defects yet: one without a model measures lay lengths only.

use super::{Id, Store, StoreError, folder, frames::run_blocking};

/// One day, in ms.
const DAY_MS: i64 = 86_400_000;

/// Acquisitions that are older than their ropeway keeps frames, and why frames stay nevertheless (null: they may go).
const OVERDUE: &str = "select a.id, w.name as ropeway, r.name as rope, a.frame_bytes,
       (select count(*) from frame f where f.acquisition_id = a.id) as frames,
       ($1 - coalesce(a.acquired_at_ms, a.created_at_ms)) / 86400000 as age_days, w.keep_days,
       case
         when exists (select 1 from defect d join inspection i on i.id = d.inspection_id
                      where i.acquisition_id = a.id and (d.state = 'confirmed' or (d.level = 'alarm' and d.state = 'open'))) then 'it is evidence of defects that are open or confirmed'
         when exists (select 1 from job_acquisition n join job j on j.id = n.job_id
                      where n.acquisition_id = a.id and j.state in ('queued', 'running')) then 'a job works on it'
         when not exists (select 1 from inspection i
                          where i.acquisition_id = a.id and i.model_id is not null) then 'it was never inspected with a model'
       end as kept_because
     from acquisition a join rope r on r.id = a.rope_id join ropeway w on w.id = r.ropeway_id
     where w.keep_days is not null and a.frames_removed_at_ms is null and a.state = 'complete'
       and coalesce(a.acquired_at_ms, a.created_at_ms) < $1 - w.keep_days * $2";

/// An acquisition whose frames are older than they need to be kept.
#[derive(Debug, Clone, PartialEq, sqlx::FromRow)]
pub struct Overdue {
    /// The acquisition.
    pub id: Id,
    /// Name of the ropeway.
    pub ropeway: String,
    /// Name of the rope.
    pub rope: String,
    /// Bytes of its frames.
    pub frame_bytes: i64,
    /// Number of its frames.
    pub frames: i64,
    /// Days since it was acquired.
    pub age_days: i64,
    /// Days that its ropeway keeps frames.
    pub keep_days: i64,
    /// Why its frames stay; `None`: they may go.
    pub kept_because: Option<String>,
}

impl Store {
    /// All acquisitions that are overdue, oldest first.
    pub async fn overdue(&self, now_ms: i64) -> Result<Vec<Overdue>, StoreError> {
        Ok(sqlx::query_as(sqlx::AssertSqlSafe(format!("{OVERDUE} order by a.seq")))
            .bind(now_ms)
            .bind(DAY_MS)
            .fetch_all(self.reader())
            .await?)
    }

    /// Removes the frames of an acquisition if it is still overdue and nothing keeps it. False if something does by now.
    pub async fn remove_frames(&self, acquisition: Id, now_ms: i64) -> Result<bool, StoreError> {
        let mut tx = self.write().await?; // nobody can open a defect or queue a job from here on
        let overdue: Option<Overdue> = sqlx::query_as(sqlx::AssertSqlSafe(format!("{OVERDUE} and a.id = $3")))
            .bind(now_ms)
            .bind(DAY_MS)
            .bind(acquisition)
            .fetch_optional(&mut *tx)
            .await?;
        if overdue.is_none_or(|o| o.kept_because.is_some()) {
            return Ok(false);
        }
        sqlx::query("update acquisition set frames_removed_at_ms = $2, frame_bytes = 0 where id = $1")
            .bind(acquisition)
            .bind(now_ms)
            .execute(&mut *tx)
            .await?;
        tx.commit().await?;
        // The fact first: files that are left are swept at the next start, a fact without files would be a lie.
        let folder = self.folder().acquisition(acquisition);
        run_blocking(move || folder::remove(&folder)).await?;
        Ok(true)
    }
}
