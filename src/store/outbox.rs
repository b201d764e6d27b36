//! The outbox: events about defects, written in the transaction of what caused them, and the deliveries that carry them out.
//!
//! Every function takes a connection, so that the caller decides which transaction it belongs to.

use serde::{Deserialize, Serialize};
use sqlx::{FromRow, SqliteConnection};
use uuid::Uuid;

/// How long a dispatcher may work on a delivery before another may take it, in ms: four times the longest attempt.
pub const LEASE_MS: i64 = 60_000;

/// Why a defect becomes a ticket.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Cause {
    /// A person confirmed it.
    Verdict {
        /// Who.
        by: String,
        /// What they said.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        comment: Option<String>,
    },
    /// Its peak score reached the level set for the rope.
    Level {
        /// The level at that moment.
        ticket_level: f64,
    },
}

/// What is known about a defect when it becomes a ticket.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DefectFacts {
    /// The defect.
    pub defect_id: Uuid,
    /// The inspection that found it.
    pub inspection_id: Uuid,
    /// The rope.
    pub rope_id: Uuid,
    /// Its name.
    pub rope: String,
    /// Name of the ropeway.
    pub ropeway: String,
    /// Rope metre where it begins.
    pub from_m: f64,
    /// Rope metre where it ends.
    pub to_m: f64,
    /// Strand, if it is known.
    pub strand: Option<usize>,
    /// Wire in the strand, if it is known.
    pub wire: Option<usize>,
    /// Highest line score of its alarms.
    pub peak_score: f64,
    /// The view in which the score is highest.
    pub view: usize,
    /// Why it becomes a ticket.
    pub cause: Cause,
}

/// A receiver of events.
#[derive(Debug, Clone, PartialEq, FromRow)]
pub struct Endpoint {
    /// Its id.
    #[sqlx(try_from = "String")]
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
    pub created_ms: i64,
}

/// A UUID stored as text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Id(pub Uuid);

impl TryFrom<String> for Id {
    type Error = uuid::Error;
    fn try_from(text: String) -> Result<Self, Self::Error> {
        text.parse().map(Self)
    }
}

/// A delivery that was claimed, with all that an attempt needs.
#[derive(Debug, Clone, PartialEq, FromRow)]
pub struct Claim {
    /// The delivery.
    #[sqlx(try_from = "String")]
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
    pub occurred_ms: i64,
    /// The receiver.
    #[sqlx(try_from = "String")]
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
    /// Its id.
    #[sqlx(try_from = "String")]
    pub id: Id,
    /// The event.
    pub event_id: String,
    /// The defect that the event is about.
    #[sqlx(try_from = "String")]
    pub defect_id: Id,
    /// The receiver.
    #[sqlx(try_from = "String")]
    pub endpoint_id: Id,
    /// `pending`, `delivered` or `dead`.
    pub state: String,
    /// Attempts in the running schedule.
    pub attempts: i64,
    /// Next attempt, ms since 1970.
    pub next_attempt_ms: i64,
    /// When it was made.
    pub created_ms: i64,
    /// When it was delivered or given up.
    pub settled_ms: Option<i64>,
}

/// One attempt of a delivery.
#[derive(Debug, Clone, PartialEq, FromRow)]
pub struct Attempt {
    /// 1, 2, ...
    pub number: i64,
    /// When it began, ms since 1970.
    pub started_ms: i64,
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

/// The id under which a defect is reported. Derived, so that even a database restored from a backup reports it under the same id.
pub fn event_id(defect_id: Uuid) -> String {
    format!("defect_{}", defect_id.simple())
}

/// Writes the event of a defect and its deliveries, unless the defect has one already. True when it is new.
pub async fn enqueue_defect(conn: &mut SqliteConnection, facts: &DefectFacts, now_ms: i64) -> sqlx::Result<bool> {
    let json = serde_json::to_string(facts).map_err(|e| sqlx::Error::Encode(e.into()))?;
    let event_id = event_id(facts.defect_id);
    let new = sqlx::query(
        "insert into outbox_events (id, defect_id, facts, occurred_ms) values ($1, $2, $3, $4) on conflict do nothing",
    )
    .bind(&event_id)
    .bind(facts.defect_id.to_string())
    .bind(json)
    .bind(now_ms)
    .execute(&mut *conn)
    .await?
    .rows_affected()
        == 1;
    if new {
        let endpoints: Vec<String> =
            sqlx::query_scalar("select id from webhook_endpoints where enabled = 1").fetch_all(&mut *conn).await?;
        for endpoint_id in endpoints {
            insert_delivery(conn, &event_id, &endpoint_id, now_ms).await?;
        }
    }
    Ok(new)
}

/// The id of a delivery: derived from its two ends, so that it needs no randomness.
fn delivery_id(event_id: &str, endpoint_id: &str) -> Uuid {
    use sha2::{Digest, Sha256};
    let digest = Sha256::digest(format!("delivery\n{event_id}\n{endpoint_id}"));
    let mut bytes = [0; 16];
    bytes.copy_from_slice(&digest[..16]);
    uuid::Builder::from_custom_bytes(bytes).into_uuid()
}

async fn insert_delivery(
    conn: &mut SqliteConnection,
    event_id: &str,
    endpoint_id: &str,
    now_ms: i64,
) -> sqlx::Result<()> {
    sqlx::query(
        "insert into webhook_deliveries (id, event_id, endpoint_id, state, next_attempt_ms, created_ms)
         values ($1, $2, $3, 'pending', $4, $4) on conflict do nothing",
    )
    .bind(delivery_id(event_id, endpoint_id).to_string())
    .bind(event_id)
    .bind(endpoint_id)
    .bind(now_ms)
    .execute(&mut *conn)
    .await?;
    Ok(())
}

/// Adds an endpoint. Events that had nobody to go to go to it. False when the id is taken.
pub async fn insert_endpoint(conn: &mut SqliteConnection, endpoint: &Endpoint) -> sqlx::Result<bool> {
    let id = endpoint.id.0.to_string();
    let new = sqlx::query(
        "insert into webhook_endpoints (id, url, secret, allow_private, enabled, disabled_reason, created_ms)
         values ($1, $2, $3, $4, $5, $6, $7) on conflict do nothing",
    )
    .bind(&id)
    .bind(&endpoint.url)
    .bind(&endpoint.secret)
    .bind(endpoint.allow_private)
    .bind(endpoint.enabled)
    .bind(&endpoint.disabled_reason)
    .bind(endpoint.created_ms)
    .execute(&mut *conn)
    .await?
    .rows_affected()
        == 1;
    if new && endpoint.enabled {
        adopt_stranded_events(conn, &id, endpoint.created_ms).await?;
    }
    Ok(new)
}

/// Gives an endpoint the events that have no delivery at all: a defect confirmed before anybody listened is not lost.
async fn adopt_stranded_events(conn: &mut SqliteConnection, endpoint_id: &str, now_ms: i64) -> sqlx::Result<()> {
    let stranded: Vec<String> = sqlx::query_scalar(
        "select id from outbox_events e
         where not exists (select 1 from webhook_deliveries d where d.event_id = e.id) order by occurred_ms",
    )
    .fetch_all(&mut *conn)
    .await?;
    for event_id in stranded {
        insert_delivery(conn, &event_id, endpoint_id, now_ms).await?;
    }
    Ok(())
}

/// Switches an endpoint on or off. Off: its pending deliveries die with it. False when there is none of this id.
pub async fn set_endpoint_enabled(
    conn: &mut SqliteConnection,
    id: Uuid,
    enabled: bool,
    reason: Option<&str>,
    now_ms: i64,
) -> sqlx::Result<bool> {
    let id = id.to_string();
    let found = sqlx::query("update webhook_endpoints set enabled = $2, disabled_reason = $3 where id = $1")
        .bind(&id)
        .bind(enabled)
        .bind(if enabled { None } else { reason })
        .execute(&mut *conn)
        .await?
        .rows_affected()
        == 1;
    if found && enabled {
        adopt_stranded_events(conn, &id, now_ms).await?;
    } else if found {
        sqlx::query(
            "update webhook_deliveries set state = 'dead', settled_ms = $2 where endpoint_id = $1 and state = 'pending'",
        )
        .bind(&id)
        .bind(now_ms)
        .execute(&mut *conn)
        .await?;
    }
    Ok(found)
}

/// Removes an endpoint and its deliveries. False when there is none of this id.
pub async fn delete_endpoint(conn: &mut SqliteConnection, id: Uuid) -> sqlx::Result<bool> {
    let deleted = sqlx::query("delete from webhook_endpoints where id = $1")
        .bind(id.to_string())
        .execute(&mut *conn)
        .await?
        .rows_affected();
    Ok(deleted == 1)
}

/// Endpoints with an id greater than `after`, in order of id.
pub async fn list_endpoints(
    conn: &mut SqliteConnection,
    after: Option<Uuid>,
    limit: i64,
) -> sqlx::Result<Vec<Endpoint>> {
    sqlx::query_as(
        "select id, url, secret, allow_private, enabled, disabled_reason, created_ms from webhook_endpoints
         where id > $1 order by id limit $2",
    )
    .bind(after.map_or_else(String::new, |id| id.to_string()))
    .bind(limit)
    .fetch_all(&mut *conn)
    .await
}

/// One endpoint.
pub async fn endpoint(conn: &mut SqliteConnection, id: Uuid) -> sqlx::Result<Option<Endpoint>> {
    sqlx::query_as(
        "select id, url, secret, allow_private, enabled, disabled_reason, created_ms from webhook_endpoints where id = $1",
    )
    .bind(id.to_string())
    .fetch_optional(&mut *conn)
    .await
}

/// Takes the deliveries that are due: at most `limit`, and at most `per_endpoint` of one endpoint, so that a receiver that
/// stalls holds up nobody else. What a dead process had taken is due again when its lease ends.
pub async fn claim_due(
    conn: &mut SqliteConnection,
    now_ms: i64,
    limit: i64,
    per_endpoint: i64,
) -> sqlx::Result<Vec<Claim>> {
    let ids: Vec<String> = sqlx::query_scalar(
        "select id from (
             select d.id, d.next_attempt_ms,
                    row_number() over (partition by d.endpoint_id order by d.next_attempt_ms, d.id) as place
             from webhook_deliveries d join webhook_endpoints p on p.id = d.endpoint_id
             where d.state = 'pending' and d.next_attempt_ms <= $1 and d.lease_until_ms <= $1 and p.enabled = 1)
         where place <= $3 order by next_attempt_ms, id limit $2",
    )
    .bind(now_ms)
    .bind(limit)
    .bind(per_endpoint)
    .fetch_all(&mut *conn)
    .await?;
    let mut claims = Vec::with_capacity(ids.len());
    for id in ids {
        let taken = sqlx::query(
            "update webhook_deliveries set lease_until_ms = $2, lease_token = lease_token + 1
             where id = $1 and state = 'pending' and lease_until_ms <= $3",
        )
        .bind(&id)
        .bind(now_ms + LEASE_MS)
        .bind(now_ms)
        .execute(&mut *conn)
        .await?
        .rows_affected();
        if taken == 1 {
            claims.push(
                sqlx::query_as(
                    "select d.id, d.lease_token, d.attempts, d.event_id, e.facts, e.occurred_ms,
                            d.endpoint_id, p.url, p.secret, p.allow_private
                     from webhook_deliveries d join outbox_events e on e.id = d.event_id
                     join webhook_endpoints p on p.id = d.endpoint_id where d.id = $1",
                )
                .bind(&id)
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
    let id = claim.id.0.to_string();
    // Nothing to log when the endpoint, and with it the delivery, was deleted while the attempt ran.
    sqlx::query(
        "insert into webhook_attempts (delivery_id, number, started_ms, duration_ms, status, error)
         select id, 1 + (select coalesce(max(number), 0) from webhook_attempts where delivery_id = $1), $2, $3, $4, $5
         from webhook_deliveries where id = $1",
    )
    .bind(&id)
    .bind(attempt.started_ms)
    .bind(attempt.duration_ms)
    .bind(attempt.status)
    .bind(&attempt.error)
    .execute(&mut *conn)
    .await?;
    let (state, next_attempt_ms, settled_ms) = match settlement {
        Settlement::Delivered => ("delivered", now_ms, Some(now_ms)),
        Settlement::Retry { at_ms } => ("pending", *at_ms, None),
        Settlement::Dead | Settlement::Disable { .. } => ("dead", now_ms, Some(now_ms)),
    };
    let held = sqlx::query(
        "update webhook_deliveries
         set state = $3, next_attempt_ms = $4, settled_ms = $5, attempts = attempts + 1, lease_until_ms = 0
         where id = $1 and lease_token = $2 and state = 'pending'",
    )
    .bind(&id)
    .bind(claim.lease_token)
    .bind(state)
    .bind(next_attempt_ms)
    .bind(settled_ms)
    .execute(&mut *conn)
    .await?
    .rows_affected()
        == 1;
    if let Settlement::Disable { reason } = settlement {
        set_endpoint_enabled(conn, claim.endpoint_id.0, false, Some(reason), now_ms).await?;
    }
    Ok(held)
}

/// Deliveries with an id greater than `after`, in order of id, of one state if given.
pub async fn list_deliveries(
    conn: &mut SqliteConnection,
    state: Option<&str>,
    after: Option<Uuid>,
    limit: i64,
) -> sqlx::Result<Vec<Delivery>> {
    sqlx::query_as(
        "select d.id, d.event_id, e.defect_id, d.endpoint_id, d.state, d.attempts, d.next_attempt_ms, d.created_ms, d.settled_ms
         from webhook_deliveries d join outbox_events e on e.id = d.event_id
         where d.id > $1 and ($2 is null or d.state = $2) order by d.id limit $3",
    )
    .bind(after.map_or_else(String::new, |id| id.to_string()))
    .bind(state)
    .bind(limit)
    .fetch_all(&mut *conn)
    .await
}

/// One delivery.
pub async fn delivery(conn: &mut SqliteConnection, id: Uuid) -> sqlx::Result<Option<Delivery>> {
    sqlx::query_as(
        "select d.id, d.event_id, e.defect_id, d.endpoint_id, d.state, d.attempts, d.next_attempt_ms, d.created_ms, d.settled_ms
         from webhook_deliveries d join outbox_events e on e.id = d.event_id where d.id = $1",
    )
    .bind(id.to_string())
    .fetch_optional(&mut *conn)
    .await
}

/// The attempts of a delivery, oldest first.
pub async fn attempts(conn: &mut SqliteConnection, delivery_id: Uuid) -> sqlx::Result<Vec<Attempt>> {
    sqlx::query_as(
        "select number, started_ms, duration_ms, status, error from webhook_attempts where delivery_id = $1 order by number",
    )
    .bind(delivery_id.to_string())
    .fetch_all(&mut *conn)
    .await
}

/// Starts the schedule of a delivery again, whatever its state: same event, same `webhook-id`.
pub async fn redeliver(conn: &mut SqliteConnection, id: Uuid, now_ms: i64) -> sqlx::Result<Redelivery> {
    let enabled: Option<bool> = sqlx::query_scalar(
        "select p.enabled from webhook_deliveries d join webhook_endpoints p on p.id = d.endpoint_id where d.id = $1",
    )
    .bind(id.to_string())
    .fetch_optional(&mut *conn)
    .await?;
    match enabled {
        None => Ok(Redelivery::Absent),
        Some(false) => Ok(Redelivery::EndpointDisabled),
        Some(true) => {
            sqlx::query(
                "update webhook_deliveries set state = 'pending', attempts = 0, next_attempt_ms = $2, settled_ms = null
                 where id = $1",
            )
            .bind(id.to_string())
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
        "select min(max(d.next_attempt_ms, d.lease_until_ms)) from webhook_deliveries d
         join webhook_endpoints p on p.id = d.endpoint_id where d.state = 'pending' and p.enabled = 1",
    )
    .fetch_one(&mut *conn)
    .await
}
