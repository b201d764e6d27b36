//! Events that must go out exactly once, queued in the transaction that causes them.

use super::{Id, StoreError};
use sqlx::SqliteConnection;

/// Why a defect is ticketed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reason {
    /// A person confirmed it.
    Confirmed,
    /// Its peak score reached the rope's ticket level.
    Level,
}

/// Queues the ticket of a defect; a defect that was queued before is left alone. Part of the caller's transaction.
pub async fn enqueue_defect(
    _connection: &mut SqliteConnection,
    _defect: Id,
    _reason: Reason,
    _now_ms: i64,
) -> Result<(), StoreError> {
    Ok(()) // ticketing fills this in, with its table
}
