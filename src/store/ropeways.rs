//! Ropeways.

use super::{Created, Id, Page, PageRequest, Store, StoreError};

/// An installation.
#[derive(Debug, Clone, PartialEq, sqlx::FromRow)]
pub struct Ropeway {
    /// Order of arrival.
    pub seq: i64,
    /// Id.
    pub id: Id,
    /// What people call it.
    pub name: String,
    /// Where it stands.
    pub location: Option<String>,
    /// When it was created, ms since 1970.
    pub created_at_ms: i64,
    /// Most bytes of frames of all its ropes; `None`: as the disk allows.
    pub quota_bytes: Option<i64>,
    /// Days after which frames may be removed; `None`: never.
    pub keep_days: Option<u32>,
}

impl Store {
    /// Creates a ropeway, or finds the one that the same call created before.
    pub async fn create_ropeway(
        &self,
        id: Id,
        name: &str,
        location: Option<&str>,
        now_ms: i64,
    ) -> Result<Created<Ropeway>, StoreError> {
        let mut tx = self.write().await?;
        let inserted = sqlx::query(
            "insert into ropeway (id, name, location, created_at_ms) values ($1, $2, $3, $4) on conflict (id) do nothing",
        )
        .bind(id)
        .bind(name)
        .bind(location)
        .bind(now_ms)
        .execute(&mut *tx)
        .await?
        .rows_affected();
        let row: Ropeway = sqlx::query_as("select * from ropeway where id = $1").bind(id).fetch_one(&mut *tx).await?;
        tx.commit().await?;
        Ok(match inserted {
            1 => Created::New(row),
            _ if row.name == name && row.location.as_deref() == location => Created::Same(row),
            _ => Created::Different,
        })
    }

    /// A ropeway.
    pub async fn ropeway(&self, id: Id) -> Result<Option<Ropeway>, StoreError> {
        Ok(sqlx::query_as("select * from ropeway where id = $1").bind(id).fetch_optional(self.reader()).await?)
    }

    /// Says how many bytes the frames of a ropeway may take, and how long they are kept. `None` if there is no such ropeway.
    pub async fn set_storage(
        &self,
        id: Id,
        quota_bytes: Option<i64>,
        keep_days: Option<u32>,
    ) -> Result<Option<Ropeway>, StoreError> {
        Ok(sqlx::query_as("update ropeway set quota_bytes = $2, keep_days = $3 where id = $1 returning *")
            .bind(id)
            .bind(quota_bytes)
            .bind(keep_days)
            .fetch_optional(self.writer())
            .await?)
    }

    /// All ropeways, page by page.
    pub async fn ropeways(&self, page: PageRequest) -> Result<Page<Ropeway>, StoreError> {
        let rows = sqlx::query_as("select * from ropeway where seq < $1 order by seq desc limit $2")
            .bind(page.before_seq())
            .bind(page.fetch())
            .fetch_all(self.reader())
            .await?;
        Ok(page.page(rows, |r: &Ropeway| r.seq))
    }
}
