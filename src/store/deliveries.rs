//! Deliveries: one event on its way to one endpoint, its attempts, and what became of it.

use super::{Id, Page, PageRequest, Store, StoreError, webhook_endpoints};
use sqlx::FromRow;

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
    /// JSON of [`super::outbox::DefectFacts`].
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
#[expect(missing_docs, reason = "migrations/0005_ticketing.sql says what each column means")]
pub struct Delivery {
    pub seq: i64,
    pub id: Id,
    pub event_id: String,
    pub defect_id: Id,
    pub endpoint_id: Id,
    pub state: String,
    pub attempts: i64,
    pub next_attempt_at_ms: i64,
    pub created_at_ms: i64,
    pub settled_at_ms: Option<i64>,
}

/// One attempt of a delivery.
#[derive(Debug, Clone, PartialEq, FromRow)]
#[expect(missing_docs, reason = "migrations/0005_ticketing.sql says what each column means")]
pub struct Attempt {
    pub number: i64,
    pub started_at_ms: i64,
    pub duration_ms: i64,
    pub status: Option<i64>,
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

/// What came of asking for a redelivery.
#[derive(Debug, Clone, PartialEq)]
pub enum Redelivery {
    /// It will be sent again.
    Queued(Delivery),
    /// No such delivery.
    Absent,
    /// Its endpoint is switched off; nothing was changed.
    EndpointDisabled,
}

impl Store {
    /// Takes the deliveries that are due: at most `limit`, and at most `per_endpoint` of one endpoint, so that a receiver that
    /// stalls holds up nobody else. What a dead process had taken is due again when its lease ends.
    pub async fn claim_deliveries(&self, now_ms: i64, limit: u32, per_endpoint: u32) -> Result<Vec<Claim>, StoreError> {
        let mut tx = self.write().await?;
        let ids: Vec<Id> = sqlx::query_scalar(
            "select id from (
                 select d.id, d.next_attempt_at_ms,
                        row_number() over (partition by d.endpoint_id order by d.next_attempt_at_ms, d.seq) as place
                 from webhook_delivery d join webhook_endpoint p on p.id = d.endpoint_id
                 where d.state = 'pending' and d.next_attempt_at_ms <= $1 and d.lease_until_ms <= $1 and p.enabled = 1)
             where place <= $3 order by next_attempt_at_ms, id limit $2",
        )
        .bind(now_ms)
        .bind(limit)
        .bind(per_endpoint)
        .fetch_all(&mut *tx)
        .await?;
        let mut claims = Vec::with_capacity(ids.len());
        for id in ids {
            sqlx::query("update webhook_delivery set lease_until_ms = $2, lease_token = lease_token + 1 where id = $1")
                .bind(id)
                .bind(now_ms + LEASE_MS)
                .execute(&mut *tx)
                .await?;
            let claim = sqlx::query_as(
                "select d.id, d.lease_token, d.attempts, d.event_id, e.facts, e.occurred_at_ms,
                        d.endpoint_id, p.url, p.secret, p.allow_private
                 from webhook_delivery d join outbox_event e on e.id = d.event_id
                 join webhook_endpoint p on p.id = d.endpoint_id where d.id = $1",
            )
            .bind(id)
            .fetch_one(&mut *tx)
            .await?;
            claims.push(claim);
        }
        tx.commit().await?;
        Ok(claims)
    }

    /// Logs an attempt (its number is given here) and settles its delivery. False when the lease was lost meanwhile: then the
    /// attempt is still logged, but whoever holds the lease decides.
    pub async fn settle_delivery(
        &self,
        claim: &Claim,
        attempt: &Attempt,
        settlement: &Settlement,
        now_ms: i64,
    ) -> Result<bool, StoreError> {
        let mut tx = self.write().await?;
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
        .execute(&mut *tx)
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
        .execute(&mut *tx)
        .await?
        .rows_affected()
            == 1;
        if let Settlement::Disable { reason } = settlement {
            webhook_endpoints::disable(&mut tx, claim.endpoint_id, reason, now_ms).await?;
        }
        tx.commit().await?;
        Ok(held)
    }

    /// Deliveries, page by page; in one state if asked.
    pub async fn deliveries(&self, state: Option<&str>, page: PageRequest) -> Result<Page<Delivery>, StoreError> {
        let rows = sqlx::query_as(
            "select d.*, e.defect_id from webhook_delivery d join outbox_event e on e.id = d.event_id
             where d.seq < $1 and ($2 is null or d.state = $2) order by d.seq desc limit $3",
        )
        .bind(page.before_seq())
        .bind(state)
        .bind(page.fetch())
        .fetch_all(self.reader())
        .await?;
        Ok(page.page(rows, |d: &Delivery| d.seq))
    }

    /// A delivery.
    pub async fn delivery(&self, id: Id) -> Result<Option<Delivery>, StoreError> {
        Ok(sqlx::query_as(
            "select d.*, e.defect_id from webhook_delivery d join outbox_event e on e.id = d.event_id where d.id = $1",
        )
        .bind(id)
        .fetch_optional(self.reader())
        .await?)
    }

    /// The attempts of a delivery, oldest first.
    pub async fn attempts(&self, delivery: Id) -> Result<Vec<Attempt>, StoreError> {
        Ok(sqlx::query_as(
            "select number, started_at_ms, duration_ms, status, error from webhook_attempt
             where delivery_id = $1 order by number",
        )
        .bind(delivery)
        .fetch_all(self.reader())
        .await?)
    }

    /// Starts the schedule of a delivery again, whatever its state: same event, same `webhook-id`.
    pub async fn redeliver(&self, id: Id, now_ms: i64) -> Result<Redelivery, StoreError> {
        let mut tx = self.write().await?;
        let enabled: Option<bool> = sqlx::query_scalar(
            "select p.enabled from webhook_delivery d join webhook_endpoint p on p.id = d.endpoint_id where d.id = $1",
        )
        .bind(id)
        .fetch_optional(&mut *tx)
        .await?;
        match enabled {
            None => return Ok(Redelivery::Absent),
            Some(false) => return Ok(Redelivery::EndpointDisabled),
            Some(true) => {}
        }
        sqlx::query(
            "update webhook_delivery set state = 'pending', attempts = 0, next_attempt_at_ms = $2, settled_at_ms = null
             where id = $1",
        )
        .bind(id)
        .bind(now_ms)
        .execute(&mut *tx)
        .await?;
        let delivery = sqlx::query_as(
            "select d.*, e.defect_id from webhook_delivery d join outbox_event e on e.id = d.event_id where d.id = $1",
        )
        .bind(id)
        .fetch_one(&mut *tx)
        .await?;
        tx.commit().await?;
        Ok(Redelivery::Queued(delivery))
    }
}
