//! The outbox: events about defects, written in the transaction of what caused them.
//!
//! Every function takes a connection, so that the caller decides which transaction it belongs to.

use super::Id;
use serde::{Deserialize, Serialize};
use sqlx::SqliteConnection;
use uuid::Uuid;

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

/// The id under which a defect is reported. Derived, so that even a database restored from a backup reports it under the same id.
pub fn event_id(defect_id: Uuid) -> String {
    format!("defect_{}", defect_id.simple())
}

/// Writes the event of a defect and its deliveries, unless the defect has one already. True when it is new.
pub async fn enqueue_defect(conn: &mut SqliteConnection, facts: &DefectFacts, now_ms: i64) -> sqlx::Result<bool> {
    let json = serde_json::to_string(facts).map_err(|e| sqlx::Error::Encode(e.into()))?;
    let event_id = event_id(facts.defect_id);
    let new = sqlx::query(
        "insert into outbox_event (id, defect_id, facts, occurred_at_ms) values ($1, $2, $3, $4) on conflict do nothing",
    )
    .bind(&event_id)
    .bind(Id(facts.defect_id))
    .bind(json)
    .bind(now_ms)
    .execute(&mut *conn)
    .await?
    .rows_affected()
        == 1;
    if new {
        let endpoints: Vec<Id> =
            sqlx::query_scalar("select id from webhook_endpoint where enabled = 1").fetch_all(&mut *conn).await?;
        for endpoint_id in endpoints {
            insert_delivery(conn, &event_id, endpoint_id, now_ms).await?;
        }
    }
    Ok(new)
}

/// The id of a delivery: derived from its two ends, so that it needs no randomness.
fn delivery_id(event_id: &str, endpoint_id: Id) -> Id {
    use sha2::{Digest, Sha256};
    let digest = Sha256::digest(format!("delivery\n{event_id}\n{endpoint_id}"));
    let mut bytes = [0; 16];
    bytes.copy_from_slice(&digest[..16]);
    Id(uuid::Builder::from_custom_bytes(bytes).into_uuid())
}

async fn insert_delivery(
    conn: &mut SqliteConnection,
    event_id: &str,
    endpoint_id: Id,
    now_ms: i64,
) -> sqlx::Result<()> {
    sqlx::query(
        "insert into webhook_delivery (id, event_id, endpoint_id, state, next_attempt_at_ms, created_at_ms)
         values ($1, $2, $3, 'pending', $4, $4) on conflict do nothing",
    )
    .bind(delivery_id(event_id, endpoint_id))
    .bind(event_id)
    .bind(endpoint_id)
    .bind(now_ms)
    .execute(&mut *conn)
    .await?;
    Ok(())
}

/// Gives an endpoint the events that have no delivery at all: a defect confirmed before anybody listened is not lost.
pub(super) async fn adopt_stranded_events(
    conn: &mut SqliteConnection,
    endpoint_id: Id,
    now_ms: i64,
) -> sqlx::Result<()> {
    let stranded: Vec<String> = sqlx::query_scalar(
        "select id from outbox_event e
         where not exists (select 1 from webhook_delivery d where d.event_id = e.id) order by occurred_at_ms",
    )
    .fetch_all(&mut *conn)
    .await?;
    for event_id in stranded {
        insert_delivery(conn, &event_id, endpoint_id, now_ms).await?;
    }
    Ok(())
}
