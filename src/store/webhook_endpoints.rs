//! Who is told about defects.

use super::{Id, outbox};
use sqlx::{FromRow, SqliteConnection};

/// A receiver of events.
#[derive(Debug, Clone, PartialEq, FromRow)]
pub struct Endpoint {
    /// Order of arrival, for cursors; the database gives it.
    pub seq: i64,
    /// Its id.
    pub id: Id,
    /// Where events are posted to.
    pub url: String,
    /// Signing secret, `whsec_...`.
    pub secret: String,
    /// May its address be private?
    pub allow_private: bool,
    /// Are events sent to it?
    pub enabled: bool,
    /// Why it was switched off.
    pub disabled_reason: Option<String>,
    /// When it was made, ms since 1970.
    pub created_at_ms: i64,
}

/// Adds an endpoint. Events that had nobody to go to go to it. False when the id is taken.
pub async fn insert(conn: &mut SqliteConnection, endpoint: &Endpoint) -> sqlx::Result<bool> {
    let new = sqlx::query(
        "insert into webhook_endpoint (id, url, secret, allow_private, enabled, disabled_reason, created_at_ms)
         values ($1, $2, $3, $4, $5, $6, $7) on conflict do nothing",
    )
    .bind(endpoint.id)
    .bind(&endpoint.url)
    .bind(&endpoint.secret)
    .bind(endpoint.allow_private)
    .bind(endpoint.enabled)
    .bind(&endpoint.disabled_reason)
    .bind(endpoint.created_at_ms)
    .execute(&mut *conn)
    .await?
    .rows_affected()
        == 1;
    if new && endpoint.enabled {
        outbox::adopt_stranded_events(conn, endpoint.id, endpoint.created_at_ms).await?;
    }
    Ok(new)
}

/// Switches an endpoint on or off. Off: its pending deliveries die with it. False when there is none of this id.
pub async fn set_enabled(
    conn: &mut SqliteConnection,
    id: Id,
    enabled: bool,
    reason: Option<&str>,
    now_ms: i64,
) -> sqlx::Result<bool> {
    let found = sqlx::query("update webhook_endpoint set enabled = $2, disabled_reason = $3 where id = $1")
        .bind(id)
        .bind(enabled)
        .bind(if enabled { None } else { reason })
        .execute(&mut *conn)
        .await?
        .rows_affected()
        == 1;
    if found && enabled {
        outbox::adopt_stranded_events(conn, id, now_ms).await?;
    } else if found {
        sqlx::query(
            "update webhook_delivery set state = 'dead', settled_at_ms = $2 where endpoint_id = $1 and state = 'pending'",
        )
        .bind(id)
        .bind(now_ms)
        .execute(&mut *conn)
        .await?;
    }
    Ok(found)
}

/// Removes an endpoint and its deliveries. False when there is none of this id.
pub async fn delete(conn: &mut SqliteConnection, id: Id) -> sqlx::Result<bool> {
    let deleted =
        sqlx::query("delete from webhook_endpoint where id = $1").bind(id).execute(&mut *conn).await?.rows_affected();
    Ok(deleted == 1)
}

/// Endpoints that came before `before` (a `seq`), newest first.
pub async fn list(conn: &mut SqliteConnection, before: i64, limit: i64) -> sqlx::Result<Vec<Endpoint>> {
    sqlx::query_as(
        "select seq, id, url, secret, allow_private, enabled, disabled_reason, created_at_ms from webhook_endpoint
         where seq < $1 order by seq desc limit $2",
    )
    .bind(before)
    .bind(limit)
    .fetch_all(&mut *conn)
    .await
}

/// One endpoint.
pub async fn get(conn: &mut SqliteConnection, id: Id) -> sqlx::Result<Option<Endpoint>> {
    sqlx::query_as(
        "select seq, id, url, secret, allow_private, enabled, disabled_reason, created_at_ms from webhook_endpoint where id = $1",
    )
    .bind(id)
    .fetch_optional(&mut *conn)
    .await
}
