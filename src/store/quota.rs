//! How many bytes of frames a ropeway has and may have, and how many are still to come.

use super::{Id, Store, StoreError};

/// What the ropeway of an upload has and may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, sqlx::FromRow)]
pub struct Quota {
    /// Bytes of frames of the ropeway.
    pub used_bytes: i64,
    /// Most bytes of frames of the ropeway; `None`: as many as the disk takes.
    pub quota_bytes: Option<i64>,
}

impl Store {
    /// The quota that holds for a rope. `None` if there is no such rope.
    pub async fn quota_of_rope(&self, rope: Id) -> Result<Option<Quota>, StoreError> {
        Ok(sqlx::query_as(
            "select w.quota_bytes, (select coalesce(sum(b.frame_bytes), 0) from acquisition b join rope s on s.id = b.rope_id
               where s.ropeway_id = w.id) as used_bytes
             from rope r join ropeway w on w.id = r.ropeway_id where r.id = $1",
        )
        .bind(rope)
        .fetch_optional(self.reader())
        .await?)
    }

    /// The quota that holds for an acquisition. `None` if there is no such acquisition.
    pub async fn quota_of(&self, acquisition: Id) -> Result<Option<Quota>, StoreError> {
        let rope: Option<Id> = sqlx::query_scalar("select rope_id from acquisition where id = $1")
            .bind(acquisition)
            .fetch_optional(self.reader())
            .await?;
        match rope {
            Some(rope) => self.quota_of_rope(rope).await,
            None => Ok(None),
        }
    }

    /// Announced bytes of an acquisition that are not there.
    pub async fn missing_bytes(&self, acquisition: Id) -> Result<i64, StoreError> {
        Ok(sqlx::query_scalar(
            "select coalesce(sum(n.bytes), 0) from announced_frame n where n.acquisition_id = $1 and not exists
               (select 1 from frame f where f.acquisition_id = $1 and f.view = n.view and f.frame = n.frame)",
        )
        .bind(acquisition)
        .fetch_one(self.reader())
        .await?)
    }
}
