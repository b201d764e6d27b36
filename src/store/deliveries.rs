//! Deliveries: one event on its way to one endpoint, its attempts, and what became of it.

use super::{Id, webhook_endpoints};
use sqlx::{FromRow, SqliteConnection};

/// How long a dispatcher may work on a delivery before another may take it, in ms: four times the longest attempt.
pub const LEASE_MS: i64 = 60_000;

/// A delivery that was claimed, with all that an attempt needs.
#[derive(Debug, Clone, PartialEq, FromRow)]
pub struct Claim {
    /// The delivery.
    pub id: Id,
    /// Fences the result.
    pub lease_token: i64,
    /// Attempts made in the running schedule.
    pub attempts: i64,
    /// `webhook-id`, the same in every attempt.
    pub event_id: String,
    /// JSON of [`DefectFacts`].
    pub facts: String,
    /// When it happened, ms since 1970.
    pub occurred_at_ms: i64,
    /// The receiver.
    pub endpoint_id: Id,
    /// Where to.
    pub url: String,
    /// Signing secret.
    pub secret: String,
    /// May the address be private?
    pub allow_private: bool,
}

/// A delivery as people see it.
#[derive(Debug, Clone, PartialEq, FromRow)]
pub struct Delivery {
    /// Order of arrival, for cursors.
    pub seq: i64,
    /// Its id.
    pub id: Id,
    /// The event.
    pub event_id: String,
    /// The defect that the event is about.
    pub defect_id: Id,
    /// The receiver.
    pub endpoint_id: Id,
    /// `pending`, `delivered` or `dead`.
    pub state: String,
    /// Attempts in the running schedule.
    pub attempts: i64,
    /// Next attempt, ms since 1970.
    pub next_attempt_at_ms: i64,
    /// When it was made.
    pub created_at_ms: i64,
    /// When it was delivered or given up.
    pub settled_at_ms: Option<i64>,
}

/// One attempt of a delivery.
#[derive(Debug, Clone, PartialEq, FromRow)]
pub struct Attempt {
    /// 1, 2, ...
    pub number: i64,
    /// When it began, ms since 1970.
    pub started_at_ms: i64,
    /// How long it took in ms.
    pub duration_ms: i64,
    /// HTTP status; `None` when there was no answer.
    pub status: Option<i64>,
    /// What went wrong; `None` when it was accepted.
    pub error: Option<String>,
}

/// What becomes of a delivery after an attempt.
#[derive(Debug, Clone, PartialEq)]
pub enum Settlement {
    /// The receiver has it.
    Delivered,
    /// Again, not before this time (ms since 1970).
    Retry {
        /// Not before.
        at_ms: i64,
    },
    /// Given up; a person may ask for a redelivery.
    Dead,
    /// Given up, and nothing more goes to this endpoint.
    Disable {
        /// Why, as a sentence.
        reason: String,
    },
}

/// Whether a redelivery could be asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Redelivery {
    /// It will be sent again.
    Queued,
    /// No such delivery.
    Absent,
    /// Its endpoint is switched off.
    EndpointDisabled,
}

/// Takes the deliveries that are due: at most `limit`, and at most `per_endpoint` of one endpoint, so that a receiver that
/// stalls holds up nobody else. What a dead process had taken is due again when its lease ends.
pub async fn claim_due(
    conn: &mut SqliteConnection,
    now_ms: i64,
    limit: i64,
    per_endpoint: i64,
) -> sqlx::Result<Vec<Claim>> {
    let ids: Vec<Id> = sqlx::query_scalar(
        "select id from (
             select d.id, d.next_attempt_at_ms,
                    row_number() over (partition by d.endpoint_id order by d.next_attempt_at_ms, d.id) as place
             from webhook_delivery d join webhook_endpoint p on p.id = d.endpoint_id
             where d.state = 'pending' and d.next_attempt_at_ms <= $1 and d.lease_until_ms <= $1 and p.enabled = 1)
         where place <= $3 order by next_attempt_at_ms, id limit $2",
    )
    .bind(now_ms)
    .bind(limit)
    .bind(per_endpoint)
    .fetch_all(&mut *conn)
    .await?;
    let mut claims = Vec::with_capacity(ids.len());
    for id in ids {
        let taken = sqlx::query(
            "update webhook_delivery set lease_until_ms = $2, lease_token = lease_token + 1
             where id = $1 and state = 'pending' and lease_until_ms <= $3",
        )
        .bind(id)
        .bind(now_ms + LEASE_MS)
        .bind(now_ms)
        .execute(&mut *conn)
        .await?
        .rows_affected();
        if taken == 1 {
            claims.push(
                sqlx::query_as(
                    "select d.id, d.lease_token, d.attempts, d.event_id, e.facts, e.occurred_at_ms,
                            d.endpoint_id, p.url, p.secret, p.allow_private
                     from webhook_delivery d join outbox_event e on e.id = d.event_id
                     join webhook_endpoint p on p.id = d.endpoint_id where d.id = $1",
                )
                .bind(id)
                .fetch_one(&mut *conn)
                .await?,
            );
        }
    }
    Ok(claims)
}

/// Logs an attempt and settles its delivery. False when the lease was lost meanwhile: then the attempt is still logged, but
/// whoever holds the lease decides.
pub async fn settle(
    conn: &mut SqliteConnection,
    claim: &Claim,
    attempt: &Attempt,
    settlement: &Settlement,
    now_ms: i64,
) -> sqlx::Result<bool> {
    // Nothing to log when the endpoint, and with it the delivery, was deleted while the attempt ran.
    sqlx::query(
        "insert into webhook_attempt (delivery_id, number, started_at_ms, duration_ms, status, error)
         select id, 1 + (select coalesce(max(number), 0) from webhook_attempt where delivery_id = $1), $2, $3, $4, $5
         from webhook_delivery where id = $1",
    )
    .bind(claim.id)
    .bind(attempt.started_at_ms)
    .bind(attempt.duration_ms)
    .bind(attempt.status)
    .bind(&attempt.error)
    .execute(&mut *conn)
    .await?;
    let (state, next_attempt_at_ms, settled_at_ms) = match settlement {
        Settlement::Delivered => ("delivered", now_ms, Some(now_ms)),
        Settlement::Retry { at_ms } => ("pending", *at_ms, None),
        Settlement::Dead | Settlement::Disable { .. } => ("dead", now_ms, Some(now_ms)),
    };
    let held = sqlx::query(
        "update webhook_delivery
         set state = $3, next_attempt_at_ms = $4, settled_at_ms = $5, attempts = attempts + 1, lease_until_ms = 0
         where id = $1 and lease_token = $2 and state = 'pending'",
    )
    .bind(claim.id)
    .bind(claim.lease_token)
    .bind(state)
    .bind(next_attempt_at_ms)
    .bind(settled_at_ms)
    .execute(&mut *conn)
    .await?
    .rows_affected()
        == 1;
    if let Settlement::Disable { reason } = settlement {
        webhook_endpoints::set_enabled(conn, claim.endpoint_id, false, Some(reason), now_ms).await?;
    }
    Ok(held)
}

/// Deliveries that came before `before` (a `seq`), newest first, of one state if given.
pub async fn list(
    conn: &mut SqliteConnection,
    state: Option<&str>,
    before: i64,
    limit: i64,
) -> sqlx::Result<Vec<Delivery>> {
    sqlx::query_as(
        "select d.seq, d.id, d.event_id, e.defect_id, d.endpoint_id, d.state, d.attempts, d.next_attempt_at_ms,
                d.created_at_ms, d.settled_at_ms
         from webhook_delivery d join outbox_event e on e.id = d.event_id
         where d.seq < $1 and ($2 is null or d.state = $2) order by d.seq desc limit $3",
    )
    .bind(before)
    .bind(state)
    .bind(limit)
    .fetch_all(&mut *conn)
    .await
}

/// One delivery.
pub async fn get(conn: &mut SqliteConnection, id: Id) -> sqlx::Result<Option<Delivery>> {
    sqlx::query_as(
        "select d.seq, d.id, d.event_id, e.defect_id, d.endpoint_id, d.state, d.attempts, d.next_attempt_at_ms,
                d.created_at_ms, d.settled_at_ms
         from webhook_delivery d join outbox_event e on e.id = d.event_id where d.id = $1",
    )
    .bind(id)
    .fetch_optional(&mut *conn)
    .await
}

/// The attempts of a delivery, oldest first.
pub async fn attempts(conn: &mut SqliteConnection, delivery_id: Id) -> sqlx::Result<Vec<Attempt>> {
    sqlx::query_as(
        "select number, started_at_ms, duration_ms, status, error from webhook_attempt where delivery_id = $1 order by number",
    )
    .bind(delivery_id)
    .fetch_all(&mut *conn)
    .await
}

/// Starts the schedule of a delivery again, whatever its state: same event, same `webhook-id`.
pub async fn redeliver(conn: &mut SqliteConnection, id: Id, now_ms: i64) -> sqlx::Result<Redelivery> {
    let enabled: Option<bool> = sqlx::query_scalar(
        "select p.enabled from webhook_delivery d join webhook_endpoint p on p.id = d.endpoint_id where d.id = $1",
    )
    .bind(id)
    .fetch_optional(&mut *conn)
    .await?;
    match enabled {
        None => Ok(Redelivery::Absent),
        Some(false) => Ok(Redelivery::EndpointDisabled),
        Some(true) => {
            sqlx::query(
                "update webhook_delivery set state = 'pending', attempts = 0, next_attempt_at_ms = $2, settled_at_ms = null
                 where id = $1",
            )
            .bind(id)
            .bind(now_ms)
            .execute(&mut *conn)
            .await?;
            Ok(Redelivery::Queued)
        }
    }
}

/// When the next delivery is due, ms since 1970; `None` when nothing is pending.
pub async fn next_due_ms(conn: &mut SqliteConnection) -> sqlx::Result<Option<i64>> {
    sqlx::query_scalar(
        "select min(max(d.next_attempt_at_ms, d.lease_until_ms)) from webhook_delivery d
         join webhook_endpoint p on p.id = d.endpoint_id where d.state = 'pending' and p.enabled = 1",
    )
    .fetch_one(&mut *conn)
    .await
}
