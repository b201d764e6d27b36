//! Previews go when their acquisition is complete, or when nobody completes it.

use super::frames::run_blocking;
use super::{Id, Store, StoreError, folder};
use sqlx::SqliteConnection;

impl Store {
    /// Removes the previews of an acquisition that is not completed although its ropeway does not keep frames for so long. Returns
    /// their number and bytes; with `dry_run` nothing goes.
    pub async fn remove_overdue_previews(&self, now_ms: i64, dry_run: bool) -> Result<(i64, i64), StoreError> {
        let overdue: Vec<(Id, i64, i64)> = sqlx::query_as(
            "select a.id, count(*), sum(p.bytes) from preview p join acquisition a on a.id = p.acquisition_id
             join rope r on r.id = a.rope_id join ropeway w on w.id = r.ropeway_id
             where coalesce(a.acquired_at_ms, a.created_at_ms) < $1 - w.keep_days * 86400000 group by a.id",
        )
        .bind(now_ms)
        .fetch_all(self.reader())
        .await?;
        let (mut count, mut bytes) = (0, 0);
        for (acquisition, previews, their_bytes) in overdue {
            if !dry_run {
                let mut tx = self.write().await?;
                drop_previews(&mut tx, acquisition, now_ms).await?;
                tx.commit().await?;
                self.remove_preview_files(acquisition).await?;
            }
            count += previews;
            bytes += their_bytes;
        }
        Ok((count, bytes))
    }

    /// Removes the files of previews whose rows are gone. What is left of it when the process dies is swept at the next start.
    pub(super) async fn remove_preview_files(&self, acquisition: Id) -> Result<(), StoreError> {
        let folder = self.folder().previews_of(acquisition);
        run_blocking(move || folder::remove(&folder)).await
    }
}

/// Forgets the previews of an acquisition and what was found in them; a job that still looks at them is cancelled, and loses its
/// lease.
pub(super) async fn drop_previews(
    connection: &mut SqliteConnection,
    acquisition: Id,
    now_ms: i64,
) -> Result<(), StoreError> {
    sqlx::query(
        "update job set state = 'cancelled', cancel_requested = 1, finished_at_ms = $2, lease_owner = null, lease_until_ms = null
         where acquisition_id = $1 and preview = 1 and state in ('queued', 'running')",
    )
    .bind(acquisition)
    .bind(now_ms)
    .execute(&mut *connection)
    .await?;
    sqlx::query(
        "delete from provisional_lay_length where job_id in (select id from job where acquisition_id = $1 and preview = 1)",
    )
    .bind(acquisition)
    .execute(&mut *connection)
    .await?;
    sqlx::query("delete from preview where acquisition_id = $1").bind(acquisition).execute(&mut *connection).await?;
    Ok(())
}
