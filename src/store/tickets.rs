//! Tickets of defects: queued in the transaction of what caused them, and what the maintenance system writes back.

use super::defects::Defect;
use super::outbox::{self, Cause, DefectFacts};
use super::{Id, Store, StoreError};
use sqlx::SqliteConnection;

/// A ticket as the maintenance system knows it.
#[derive(Debug, Clone, PartialEq)]
pub struct Ticket {
    /// Its number there.
    pub number: String,
    /// Where people see it.
    pub url: Option<String>,
    /// Its state, in the words of that system.
    pub state: String,
}

/// The score from which on defects of the rope of an inspection are ticketed without a person; `None`: never.
pub(super) async fn ticket_level(connection: &mut SqliteConnection, inspection: Id) -> Result<Option<f64>, StoreError> {
    Ok(sqlx::query_scalar("select r.ticket_level from inspection i join rope r on r.id = i.rope_id where i.id = $1")
        .bind(inspection)
        .fetch_one(connection)
        .await?)
}

/// Queues the ticket of a new defect if its peak reaches the level; part of the caller's transaction. True when it was queued now.
pub(super) async fn ticket_by_level(
    connection: &mut SqliteConnection,
    id: Id,
    peak_score: f64,
    ticket_level: f64,
    now_ms: i64,
) -> Result<bool, StoreError> {
    if peak_score < ticket_level {
        return Ok(false);
    }
    enqueue_ticket(connection, id, Cause::Level { ticket_level }, now_ms).await
}

/// Queues the ticket of a defect, with what is known of it now; part of the caller's transaction. True when it was queued now.
pub(super) async fn enqueue_ticket(
    connection: &mut SqliteConnection,
    id: Id,
    cause: Cause,
    now_ms: i64,
) -> Result<bool, StoreError> {
    let defect: Defect =
        sqlx::query_as("select * from defect where id = $1").bind(id).fetch_one(&mut *connection).await?;
    let (rope, ropeway): (String, String) =
        sqlx::query_as("select r.name, w.name from rope r join ropeway w on w.id = r.ropeway_id where r.id = $1")
            .bind(defect.rope_id)
            .fetch_one(&mut *connection)
            .await?;
    let row = defect.row()?;
    let facts = DefectFacts {
        defect_id: id.0,
        inspection_id: defect.inspection_id.0,
        rope_id: defect.rope_id.0,
        rope,
        ropeway,
        from_m: defect.from_m,
        to_m: defect.to_m,
        strand: defect.strand.map(|s| s as usize),
        wire: defect.wire.map(|w| w as usize),
        peak_score: defect.peak_score,
        view: row.worst().map_or(0, |alarm| alarm.view),
        cause,
    };
    Ok(outbox::enqueue_defect(connection, &facts, now_ms).await?)
}

impl Store {
    /// Writes back what the maintenance system says of the ticket. `None` if there is no such defect.
    pub async fn set_ticket(&self, id: Id, ticket: &Ticket) -> Result<Option<Defect>, StoreError> {
        let mut tx = self.write().await?;
        let row = sqlx::query_as(
            "update defect set ticket_number = $2, ticket_url = $3, ticket_state = $4 where id = $1 returning *",
        )
        .bind(id)
        .bind(&ticket.number)
        .bind(&ticket.url)
        .bind(&ticket.state)
        .fetch_optional(&mut *tx)
        .await?;
        tx.commit().await?;
        Ok(row)
    }
}
