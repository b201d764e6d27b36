//! Defects, and what people decided about them.

use super::outbox::Cause;
use super::tickets::{enqueue_ticket, ticket_by_level, ticket_level};
use super::{Id, Page, PageRequest, Store, StoreError};
use crate::pipeline::results::{AlarmRow, DefectRow, Level, Suggestion};
use sqlx::SqliteConnection;

/// Levels as they are stored: over the threshold, and over the second one only.
pub const ALARM: &str = "alarm";
/// See [`ALARM`].
pub const LOOK_AGAIN: &str = "look_again";

/// A defect.
#[derive(Debug, Clone, PartialEq, sqlx::FromRow)]
#[expect(
    missing_docs,
    reason = "migrations/0004_results.sql, 0031_levels.sql and 0032_kinds.sql say what each column means"
)]
pub struct Defect {
    pub seq: i64,
    pub id: Id,
    pub inspection_id: Id,
    pub rope_id: Id,
    pub number: u32,
    pub level: String,
    pub rank: Option<u32>,
    pub angle_deg: Option<f64>,
    pub suggestion: Option<String>,
    pub from_m: f64,
    pub to_m: f64,
    pub strand: Option<u32>,
    pub wire: Option<u32>,
    pub peak_score: f64,
    pub alarms: String,
    pub state: String,
    pub verdict_by: Option<String>,
    pub verdict_comment: Option<String>,
    pub verdict_at_ms: Option<i64>,
    pub ticket_number: Option<String>,
    pub ticket_url: Option<String>,
    pub ticket_state: Option<String>,
    pub created_at_ms: i64,
}

/// What a person decided.
#[derive(Debug, Clone, PartialEq)]
pub struct Verdict {
    /// True: it is one. False: it is none.
    pub confirmed: bool,
    /// Who decided.
    pub by: String,
    /// What they said.
    pub comment: Option<String>,
}

/// What came of a verdict.
#[derive(Debug, Clone, PartialEq)]
pub enum Judged {
    /// It holds, now or since the same call before.
    Accepted(Defect),
    /// Somebody decided otherwise before; nothing was changed.
    Contradiction(Defect),
    /// There is no such defect.
    Unknown,
}

pub(super) async fn insert(
    connection: &mut SqliteConnection,
    inspection: Id,
    defects: &[(Id, DefectRow)],
    now_ms: i64,
) -> Result<(), StoreError> {
    let ticket_level = ticket_level(connection, inspection).await?;
    for (id, defect) in defects {
        let alarms = serde_json::to_string(&defect.alarms).map_err(|e| StoreError::Inconsistent {
            table: "defect",
            column: "alarms",
            row: id.to_string(),
            value: e.to_string(),
        })?;
        sqlx::query(
            "insert into defect (id, inspection_id, rope_id, number, from_m, to_m, strand, wire, peak_score, alarms, state, created_at_ms, level, rank,
               angle_deg, suggestion)
             select $1, i.id, i.rope_id, $3, $4, $5, $6, $7, $8, $9, 'open', $10, $11, $12, $13, $14 from inspection i where i.id = $2",
        )
        .bind(id)
        .bind(inspection)
        .bind(defect.id as i64)
        .bind(defect.from_m)
        .bind(defect.to_m)
        .bind(defect.strand.map(|s| s as i64))
        .bind(defect.wire.map(|w| w as i64))
        .bind(defect.peak_score)
        .bind(alarms)
        .bind(now_ms)
        .bind(match defect.level {
            Level::Alarm => ALARM,
            Level::LookAgain => LOOK_AGAIN,
        })
        .bind(defect.rank.map(|rank| rank as i64))
        .bind(defect.angle_deg)
        .bind(defect.suggestion.as_ref().map(|s| serde_json::json!(s).to_string()))
        .execute(&mut *connection)
        .await?;
        if let Some(ticket_level) = ticket_level
            && defect.level == Level::Alarm
        {
            ticket_by_level(connection, *id, defect.peak_score, ticket_level, now_ms).await?;
        }
    }
    Ok(())
}

impl Defect {
    /// Its alarms.
    pub fn alarms(&self) -> Result<Vec<AlarmRow>, StoreError> {
        serde_json::from_str(&self.alarms).map_err(|e| StoreError::Inconsistent {
            table: "defect",
            column: "alarms",
            row: self.id.to_string(),
            value: e.to_string(),
        })
    }

    /// What it is likely to be.
    pub fn suggestion(&self) -> Result<Option<Suggestion>, StoreError> {
        self.suggestion
            .as_deref()
            .map(|json| {
                serde_json::from_str(json).map_err(|e| StoreError::Inconsistent {
                    table: "defect",
                    column: "suggestion",
                    row: self.id.to_string(),
                    value: e.to_string(),
                })
            })
            .transpose()
    }

    /// The defect as results tell it.
    pub fn row(&self) -> Result<DefectRow, StoreError> {
        Ok(DefectRow {
            id: self.number as usize,
            level: if self.level == LOOK_AGAIN { Level::LookAgain } else { Level::Alarm },
            from_m: self.from_m,
            to_m: self.to_m,
            strand: self.strand.map(|s| s as usize),
            wire: self.wire.map(|w| w as usize),
            angle_deg: self.angle_deg,
            peak_score: self.peak_score,
            rank: self.rank.map(|rank| rank as usize),
            suggestion: self.suggestion()?,
            alarms: self.alarms()?,
        })
    }
}

impl Store {
    /// A defect.
    pub async fn defect(&self, id: Id) -> Result<Option<Defect>, StoreError> {
        Ok(sqlx::query_as("select * from defect where id = $1").bind(id).fetch_optional(self.reader()).await?)
    }

    /// Defects of an inspection, along the rope.
    pub async fn defects_of(&self, inspection: Id) -> Result<Vec<Defect>, StoreError> {
        self.found_in(inspection, Some(ALARM)).await
    }

    /// What an inspection found over one level, along the rope; over any, defects come first. Numbers are those of the job, and
    /// another threshold moves places between the levels.
    pub async fn found_in(&self, inspection: Id, level: Option<&str>) -> Result<Vec<Defect>, StoreError> {
        Ok(sqlx::query_as(
            "select * from defect where inspection_id = $1 and ($2 is null or level = $2) order by level, from_m, number",
        )
        .bind(inspection)
        .bind(level)
        .fetch_all(self.reader())
        .await?)
    }

    /// Defects, page by page; of one rope, in one state and over one level if asked.
    pub async fn defects(
        &self,
        rope: Option<Id>,
        state: Option<&str>,
        level: Option<&str>,
        page: PageRequest,
    ) -> Result<Page<Defect>, StoreError> {
        let rows = sqlx::query_as(
            "select * from defect where ($1 is null or rope_id = $1) and ($2 is null or state = $2) and ($5 is null or level = $5)
               and seq < $3 order by seq desc limit $4",
        )
        .bind(rope)
        .bind(state)
        .bind(page.before_seq())
        .bind(page.fetch())
        .bind(level)
        .fetch_all(self.reader())
        .await?;
        Ok(page.page(rows, |d: &Defect| d.seq))
    }

    /// Records a verdict; a confirmation queues the ticket in the same transaction.
    pub async fn judge(&self, id: Id, verdict: &Verdict, now_ms: i64) -> Result<Judged, StoreError> {
        let state = if verdict.confirmed { "confirmed" } else { "dismissed" };
        let mut tx = self.write().await?;
        let Some(defect): Option<Defect> =
            sqlx::query_as("select * from defect where id = $1").bind(id).fetch_optional(&mut *tx).await?
        else {
            return Ok(Judged::Unknown);
        };
        if defect.state != "open" {
            return Ok(if defect.state == state { Judged::Accepted(defect) } else { Judged::Contradiction(defect) });
        }
        let defect = sqlx::query_as(
            "update defect set state = $2, verdict_by = $3, verdict_comment = $4, verdict_at_ms = $5 where id = $1 returning *",
        )
        .bind(id)
        .bind(state)
        .bind(&verdict.by)
        .bind(&verdict.comment)
        .bind(now_ms)
        .fetch_one(&mut *tx)
        .await?;
        if verdict.confirmed {
            let cause = Cause::Verdict { by: verdict.by.clone(), comment: verdict.comment.clone() };
            enqueue_ticket(&mut tx, id, cause, now_ms).await?;
        }
        tx.commit().await?;
        Ok(Judged::Accepted(defect))
    }
}
