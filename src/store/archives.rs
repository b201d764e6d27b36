//! Recordings that come as one large file: what has arrived, durably, and what became of it.

use super::frames::run_blocking;
use super::{Id, Store, StoreError, folder};
use std::path::PathBuf;

/// An archive on its way in.
#[derive(Debug, Clone, PartialEq, sqlx::FromRow)]
pub struct Archive {
    /// Id, also of the acquisition that comes of it.
    pub id: Id,
    /// Id of the token that began it.
    pub token_id: String,
    /// The rope it shows.
    pub rope_id: Id,
    /// Metadata as the client sent them.
    pub metadata: String,
    /// Bytes of the whole file.
    pub length: i64,
    /// Bytes that are durable.
    pub received: i64,
    /// `receiving`, `unpacking`, `unpacked` or `refused`.
    pub state: String,
    /// JSON problem, why it was refused.
    pub problem: Option<String>,
    /// When an upload that is not whole is removed, ms since 1970.
    pub expires_at_ms: i64,
    /// When it began, ms since 1970.
    pub created_at_ms: i64,
}

impl Store {
    /// File of an archive.
    pub fn archive_path(&self, id: Id) -> PathBuf {
        self.folder().archives().join(id.to_string())
    }

    /// Begins an archive.
    pub async fn begin_archive(&self, archive: &Archive) -> Result<(), StoreError> {
        let path = self.archive_path(archive.id);
        run_blocking(move || {
            let failed = |source| StoreError::File { path: path.clone(), source };
            std::fs::File::create(&path).and_then(|file| file.sync_all()).map_err(failed)?;
            folder::sync_folder(path.parent().unwrap_or(&path))
        })
        .await?;
        sqlx::query(
            "insert into archive (id, token_id, rope_id, metadata, length, state, expires_at_ms, created_at_ms)
             values ($1, $2, $3, $4, $5, 'receiving', $6, $7)",
        )
        .bind(archive.id)
        .bind(&archive.token_id)
        .bind(archive.rope_id)
        .bind(&archive.metadata)
        .bind(archive.length)
        .bind(archive.expires_at_ms)
        .bind(archive.created_at_ms)
        .execute(self.writer())
        .await?;
        Ok(())
    }

    /// An archive.
    pub async fn archive(&self, id: Id) -> Result<Option<Archive>, StoreError> {
        Ok(sqlx::query_as("select * from archive where id = $1").bind(id).fetch_optional(self.reader()).await?)
    }

    /// Archives that arrived whole and are not unpacked yet.
    pub async fn archives_to_unpack(&self) -> Result<Vec<Archive>, StoreError> {
        Ok(sqlx::query_as("select * from archive where state = 'unpacking'").fetch_all(self.reader()).await?)
    }

    /// Records that `received` bytes are durable, and puts off the expiry. The last byte begins the unpacking; true then.
    pub async fn archive_received(&self, id: Id, received: i64, expires_at_ms: i64) -> Result<bool, StoreError> {
        let state: Option<String> = sqlx::query_scalar(
            "update archive set received = $2, expires_at_ms = $3, state = case when $2 = length then 'unpacking' else state end
             where id = $1 and state = 'receiving' returning state",
        )
        .bind(id)
        .bind(received)
        .bind(expires_at_ms)
        .fetch_optional(self.writer())
        .await?;
        Ok(state.is_some_and(|state| state == "unpacking"))
    }

    /// Records what came of an archive; its file is not needed any more.
    pub async fn settle_archive(&self, id: Id, problem: Option<&str>) -> Result<(), StoreError> {
        sqlx::query("update archive set state = $2, problem = $3 where id = $1")
            .bind(id)
            .bind(if problem.is_some() { "refused" } else { "unpacked" })
            .bind(problem)
            .execute(self.writer())
            .await?;
        let path = self.archive_path(id);
        run_blocking(move || folder::remove(&path)).await
    }

    /// Forgets an archive; an acquisition that came of it stays.
    pub async fn remove_archive(&self, id: Id) -> Result<(), StoreError> {
        sqlx::query("delete from archive where id = $1").bind(id).execute(self.writer()).await?;
        let path = self.archive_path(id);
        run_blocking(move || folder::remove(&path)).await
    }

    /// Removes uploads that are not whole although their time is over.
    pub async fn remove_expired_archives(&self, now_ms: i64) -> Result<(), StoreError> {
        let expired: Vec<Id> =
            sqlx::query_scalar("select id from archive where state = 'receiving' and expires_at_ms <= $1")
                .bind(now_ms)
                .fetch_all(self.reader())
                .await?;
        for id in expired {
            self.remove_archive(id).await?;
        }
        Ok(())
    }
}
