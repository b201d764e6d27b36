//! Thresholds applied to inspections that have ended: from stored peak scores, without looking at the rope again.
//!
//! A defect moves between the two levels; its id, verdict and ticket stay. What a person has decided on, or what has a ticket, is
//! never hidden.

use super::defects::{ALARM, Defect, LOOK_AGAIN};
use super::tickets::{ticket_by_level, ticket_level};
use super::{Id, Store, StoreError};
use crate::pipeline::results::Threshold;
use sqlx::SqliteConnection;

/// A threshold that somebody applied to an inspection.
#[derive(Debug, Clone, PartialEq, sqlx::FromRow)]
pub struct InspectionThreshold {
    /// The inspection.
    pub inspection_id: Id,
    /// 1, 2, .. per inspection; the last one holds.
    pub number: u32,
    /// Places with a peak score above it are defects.
    pub line_score: f64,
    /// Places above it are worth looking at again, under it nothing is stored; `None`: there is no such level.
    pub look_again_line_score: Option<f64>,
    /// The threshold of the model that it is; `None`: a line score for this inspection.
    pub model_version: Option<u32>,
    /// Who applied it.
    pub set_by: String,
    /// Why.
    pub reason: String,
    /// Defects since then.
    pub defects: u32,
    /// Places to look at again since then.
    pub look_again: u32,
    /// When, ms since 1970.
    pub created_at_ms: i64,
}

/// A threshold to be applied.
#[derive(Debug, Clone, PartialEq)]
pub struct NewInspectionThreshold {
    /// The inspection, which has ended.
    pub inspection_id: Id,
    /// Places with a peak score above it are defects.
    pub line_score: f64,
    /// The level of the inspection under which nothing is stored; `None`: there is no such level.
    pub look_again_line_score: Option<f64>,
    /// The threshold of the model that it is; `None`: a line score for this inspection.
    pub model_version: Option<u32>,
    /// Who applies it.
    pub set_by: String,
    /// Why.
    pub reason: String,
}

/// What came of a threshold. Lists run along the rope.
#[derive(Debug, Clone, PartialEq)]
pub struct Applied {
    /// It holds now.
    pub threshold: InspectionThreshold,
    /// False: the same call applied it before, nothing was changed.
    pub new: bool,
    /// Places that have become defects.
    pub opened: Vec<Defect>,
    /// Defects that have become places to look at again.
    pub closed: Vec<Defect>,
    /// Defects that are not over it but stay, because they were decided on or have a ticket.
    pub kept: Vec<Defect>,
    /// Tickets queued, because of the rope's level.
    pub tickets: usize,
}

/// Where an applied threshold comes from, as a sentence for summaries.
pub(super) fn origin(set_by: &str, reason: &str) -> String {
    format!("applied afterwards by {set_by}: {reason}")
}

impl InspectionThreshold {
    /// The threshold as summaries tell it.
    pub fn decides(&self) -> Threshold {
        Threshold {
            line_score: self.line_score,
            look_again_line_score: self.look_again_line_score,
            origin: origin(&self.set_by, &self.reason),
        }
    }

    fn is(&self, new: &NewInspectionThreshold) -> bool {
        (self.line_score, self.model_version, &self.set_by, &self.reason)
            == (new.line_score, new.model_version, &new.set_by, &new.reason)
    }
}

impl Store {
    /// Applies a threshold, and queues the tickets of places that have become defects and reach the rope's level, in one transaction.
    pub async fn apply_threshold(&self, new: &NewInspectionThreshold, now_ms: i64) -> Result<Applied, StoreError> {
        let mut tx = self.write().await?;
        let inspection = new.inspection_id;
        let last: Option<InspectionThreshold> =
            sqlx::query_as("select * from inspection_threshold where inspection_id = $1 order by number desc limit 1")
                .bind(inspection)
                .fetch_optional(&mut *tx)
                .await?;
        let number = last.as_ref().map_or(1, |last| last.number + 1);
        if let Some(threshold) = last.filter(|last| last.is(new)) {
            let kept = kept(&mut tx, inspection, new.line_score).await?;
            let (opened, closed) = (Vec::new(), Vec::new());
            return Ok(Applied { threshold, new: false, opened, closed, kept, tickets: 0 });
        }
        let opened = along_the_rope(
            sqlx::query_as(
                "update defect set level = $3 where inspection_id = $1 and level <> $3 and peak_score > $2 returning *",
            )
            .bind(inspection)
            .bind(new.line_score)
            .bind(ALARM)
            .fetch_all(&mut *tx)
            .await?,
        );
        let closed = along_the_rope(
            sqlx::query_as(
                "update defect set level = $3 where inspection_id = $1 and level <> $3 and peak_score <= $2 and state = 'open'
                   and ticket_number is null and not exists (select 1 from outbox_event where defect_id = defect.id) returning *",
            )
            .bind(inspection)
            .bind(new.line_score)
            .bind(LOOK_AGAIN)
            .fetch_all(&mut *tx)
            .await?,
        );
        let tickets = ticket(&mut tx, inspection, &opened, now_ms).await?;
        rank(&mut tx, inspection).await?;
        let threshold = sqlx::query_as(
            "insert into inspection_threshold (inspection_id, number, line_score, look_again_line_score, model_version, set_by, reason,
               created_at_ms, defects, look_again)
             select $1, $2, $3, $4, $5, $6, $7, $8, count(*) filter (where level = $9), count(*) filter (where level <> $9)
             from defect where inspection_id = $1 returning *",
        )
        .bind(inspection)
        .bind(number)
        .bind(new.line_score)
        .bind(new.look_again_line_score)
        .bind(new.model_version)
        .bind(&new.set_by)
        .bind(&new.reason)
        .bind(now_ms)
        .bind(ALARM)
        .fetch_one(&mut *tx)
        .await?;
        let kept = kept(&mut tx, inspection, new.line_score).await?;
        tx.commit().await?;
        Ok(Applied { threshold, new: true, opened, closed, kept, tickets })
    }

    /// Thresholds that were applied to an inspection, newest first.
    pub async fn inspection_thresholds(&self, inspection: Id) -> Result<Vec<InspectionThreshold>, StoreError> {
        Ok(sqlx::query_as("select * from inspection_threshold where inspection_id = $1 order by number desc")
            .bind(inspection)
            .fetch_all(self.reader())
            .await?)
    }
}

fn along_the_rope(mut defects: Vec<Defect>) -> Vec<Defect> {
    defects.sort_by(|a, b| a.from_m.total_cmp(&b.from_m).then(a.number.cmp(&b.number)));
    defects
}

/// Defects that are not over a threshold.
async fn kept(connection: &mut SqliteConnection, inspection: Id, line_score: f64) -> Result<Vec<Defect>, StoreError> {
    let kept = sqlx::query_as("select * from defect where inspection_id = $1 and level = $3 and peak_score <= $2")
        .bind(inspection)
        .bind(line_score)
        .bind(ALARM)
        .fetch_all(connection)
        .await?;
    Ok(along_the_rope(kept))
}

/// Queues the tickets of new defects as the job would have; what was dismissed, or has a ticket, gets none.
async fn ticket(
    connection: &mut SqliteConnection,
    inspection: Id,
    opened: &[Defect],
    now_ms: i64,
) -> Result<usize, StoreError> {
    let Some(level) = ticket_level(connection, inspection).await? else { return Ok(0) };
    let mut tickets = 0;
    for defect in opened.iter().filter(|d| d.state == "open" && d.ticket_number.is_none()) {
        tickets += usize::from(ticket_by_level(connection, defect.id, defect.peak_score, level, now_ms).await?);
    }
    Ok(tickets)
}

/// Ranks the places of each level anew. Inspections of earlier versions have no ranks.
async fn rank(connection: &mut SqliteConnection, inspection: Id) -> Result<(), StoreError> {
    sqlx::query(
        "update defect set rank = ranked.rank
         from (select id, row_number() over (partition by level order by peak_score desc, number) as rank
               from defect where inspection_id = $1) as ranked
         where defect.id = ranked.id and defect.rank is not null",
    )
    .bind(inspection)
    .execute(connection)
    .await?;
    Ok(())
}
