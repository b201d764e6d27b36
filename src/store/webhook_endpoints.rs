//! Who is told about defects.

use super::{Id, Page, PageRequest, Store, StoreError, outbox};
use sqlx::{FromRow, SqliteConnection};

/// A receiver of events.
#[derive(Debug, Clone, PartialEq, FromRow)]
#[expect(missing_docs, reason = "migrations/0005_ticketing.sql says what each column means")]
pub struct Endpoint {
    pub seq: i64,
    pub id: Id,
    pub url: String,
    pub secret: String,
    pub allow_private: bool,
    pub enabled: bool,
    pub disabled_reason: Option<String>,
    pub created_at_ms: i64,
}

/// An endpoint to be made.
#[derive(Debug, Clone, PartialEq)]
pub struct NewEndpoint {
    /// Its id.
    pub id: Id,
    /// Where events are posted to; checked by the caller.
    pub url: String,
    /// Signing secret, `whsec_...`.
    pub secret: String,
    /// May its address be private?
    pub allow_private: bool,
    /// Shall events be sent to it?
    pub enabled: bool,
}

impl Store {
    /// Adds an endpoint. Events that had nobody to go to go to it. `None` when the id is taken.
    pub async fn add_endpoint(&self, new: &NewEndpoint, now_ms: i64) -> Result<Option<Endpoint>, StoreError> {
        let mut tx = self.write().await?;
        let endpoint: Option<Endpoint> = sqlx::query_as(
            "insert into webhook_endpoint (id, url, secret, allow_private, enabled, created_at_ms)
             values ($1, $2, $3, $4, $5, $6) on conflict do nothing returning *",
        )
        .bind(new.id)
        .bind(&new.url)
        .bind(&new.secret)
        .bind(new.allow_private)
        .bind(new.enabled)
        .bind(now_ms)
        .fetch_optional(&mut *tx)
        .await?;
        if endpoint.is_some() && new.enabled {
            outbox::adopt_stranded_events(&mut tx, new.id, now_ms).await?;
        }
        tx.commit().await?;
        Ok(endpoint)
    }

    /// An endpoint.
    pub async fn endpoint(&self, id: Id) -> Result<Option<Endpoint>, StoreError> {
        Ok(sqlx::query_as("select * from webhook_endpoint where id = $1")
            .bind(id)
            .fetch_optional(self.reader())
            .await?)
    }

    /// Endpoints, page by page.
    pub async fn endpoints(&self, page: PageRequest) -> Result<Page<Endpoint>, StoreError> {
        let rows = sqlx::query_as("select * from webhook_endpoint where seq < $1 order by seq desc limit $2")
            .bind(page.before_seq())
            .bind(page.fetch())
            .fetch_all(self.reader())
            .await?;
        Ok(page.page(rows, |e: &Endpoint| e.seq))
    }

    /// Switches an endpoint on or off. Off: its pending deliveries die with it. `None` when there is none of this id.
    pub async fn enable_endpoint(&self, id: Id, enabled: bool, now_ms: i64) -> Result<Option<Endpoint>, StoreError> {
        let mut tx = self.write().await?;
        if enabled {
            sqlx::query("update webhook_endpoint set enabled = 1, disabled_reason = null where id = $1")
                .bind(id)
                .execute(&mut *tx)
                .await?;
        } else {
            disable(&mut tx, id, "switched off by an admin", now_ms).await?;
        }
        let endpoint: Option<Endpoint> =
            sqlx::query_as("select * from webhook_endpoint where id = $1").bind(id).fetch_optional(&mut *tx).await?;
        if enabled && endpoint.is_some() {
            outbox::adopt_stranded_events(&mut tx, id, now_ms).await?;
        }
        tx.commit().await?;
        Ok(endpoint)
    }

    /// Removes an endpoint and its deliveries. False when there is none of this id.
    pub async fn delete_endpoint(&self, id: Id) -> Result<bool, StoreError> {
        let mut tx = self.write().await?;
        let deleted = sqlx::query("delete from webhook_endpoint where id = $1").bind(id).execute(&mut *tx).await?;
        tx.commit().await?;
        Ok(deleted.rows_affected() == 1)
    }
}

/// Switches an endpoint off, and lets its pending deliveries die; part of the caller's transaction.
pub(super) async fn disable(conn: &mut SqliteConnection, id: Id, reason: &str, now_ms: i64) -> sqlx::Result<()> {
    sqlx::query("update webhook_endpoint set enabled = 0, disabled_reason = $2 where id = $1 and enabled = 1")
        .bind(id)
        .bind(reason)
        .execute(&mut *conn)
        .await?;
    sqlx::query(
        "update webhook_delivery set state = 'dead', settled_at_ms = $2 where endpoint_id = $1 and state = 'pending'",
    )
    .bind(id)
    .bind(now_ms)
    .execute(&mut *conn)
    .await?;
    Ok(())
}
