//! Inspections: what a job concluded about one acquisition with one model and one threshold.

use super::inspection_thresholds::origin;
use super::leases::{Lease, settle};
use super::{Id, Page, PageRequest, Store, StoreError, defects, lay_lengths};
use crate::pipeline::results::{DefectRow, LayLengthRow, Summary, Threshold};

/// An inspection.
#[derive(Debug, Clone, PartialEq, sqlx::FromRow)]
pub struct Inspection {
    /// Order of arrival.
    pub seq: i64,
    /// Id; names its results folder.
    pub id: Id,
    /// The rope.
    pub rope_id: Id,
    /// What was inspected.
    pub acquisition_id: Id,
    /// With which model; `None`: alignment only.
    pub model_id: Option<Id>,
    /// The job that did it.
    pub job_id: Id,
    /// JSON of [`Summary`], as the job left it.
    pub summary: String,
    /// When it ended, ms since 1970.
    pub created_at_ms: i64,
    /// The threshold that was applied last, and the following with it; `None`: the job's own holds.
    pub applied_line_score: Option<f64>,
    /// Its second level.
    pub applied_look_again_line_score: Option<f64>,
    /// Who applied it.
    pub applied_by: Option<String>,
    /// Why.
    pub applied_because: Option<String>,
    /// Defects since then.
    pub applied_defects: Option<u32>,
    /// Places to look at again since then.
    pub applied_look_again: Option<u32>,
}

/// An inspection to be recorded; its results folder is in place.
#[derive(Debug, Clone, PartialEq)]
pub struct NewInspection {
    /// Id; names its results folder.
    pub id: Id,
    /// JSON of the summary.
    pub summary: String,
    /// Lay lengths of all views and fused.
    pub lay_lengths: Vec<LayLengthRow>,
    /// Defects, with the ids they shall have.
    pub defects: Vec<(Id, DefectRow)>,
    /// Rope per camera line in mm, to turn lines into rope metres.
    pub line_pitch_mm: f64,
}

impl Inspection {
    /// What the run says of itself, with the threshold in force and what it makes of the places found.
    pub fn summary(&self) -> Result<Summary, StoreError> {
        let of_job = self.summary_of_job()?;
        let Some(line_score) = self.applied_line_score else { return Ok(of_job) };
        let text = |text: &Option<String>| text.clone().unwrap_or_default();
        let look_again_line_score = self.applied_look_again_line_score;
        Ok(Summary {
            threshold: Some(Threshold {
                line_score,
                look_again_line_score,
                origin: origin(&text(&self.applied_by), &text(&self.applied_because)),
            }),
            defects: self.applied_defects.map(|n| n as usize),
            look_again: self.applied_look_again.filter(|_| look_again_line_score.is_some()).map(|n| n as usize),
            ..of_job
        })
    }

    /// What the run said of itself when it ended.
    pub fn summary_of_job(&self) -> Result<Summary, StoreError> {
        serde_json::from_str(&self.summary).map_err(|e| StoreError::Inconsistent {
            table: "inspection",
            column: "summary",
            row: self.id.to_string(),
            value: e.to_string(),
        })
    }
}

impl Store {
    /// Ends an inspection job with all that it found, and queues the tickets of defects that reach the rope's level, in one
    /// transaction. On [`Lease::Lost`] nothing was recorded.
    pub async fn settle_inspected(
        &self,
        job: Id,
        token: i64,
        new: &NewInspection,
        now_ms: i64,
    ) -> Result<Lease, StoreError> {
        let mut tx = self.write().await?;
        if settle(&mut tx, job, token, "succeeded", Some(new.id), None, now_ms).await? == 0 {
            return Ok(Lease::Lost);
        }
        sqlx::query(
            "insert into inspection (id, rope_id, acquisition_id, model_id, job_id, summary, created_at_ms)
             select $1, j.rope_id, j.acquisition_id, j.model_id, j.id, $3, $4 from job j where j.id = $2",
        )
        .bind(new.id)
        .bind(job)
        .bind(&new.summary)
        .bind(now_ms)
        .execute(&mut *tx)
        .await?;
        lay_lengths::insert(&mut tx, new.id, &new.lay_lengths, new.line_pitch_mm).await?;
        defects::insert(&mut tx, new.id, &new.defects, now_ms).await?;
        tx.commit().await?;
        Ok(Lease::Held)
    }

    /// An inspection.
    pub async fn inspection(&self, id: Id) -> Result<Option<Inspection>, StoreError> {
        Ok(sqlx::query_as("select * from judged_inspection where id = $1")
            .bind(id)
            .fetch_optional(self.reader())
            .await?)
    }

    /// Inspections, of one rope or acquisition or of all, page by page.
    pub async fn inspections(
        &self,
        rope: Option<Id>,
        acquisition: Option<Id>,
        page: PageRequest,
    ) -> Result<Page<Inspection>, StoreError> {
        let rows = sqlx::query_as(
            "select * from judged_inspection where ($1 is null or rope_id = $1) and ($2 is null or acquisition_id = $2) and seq < $3
             order by seq desc limit $4",
        )
        .bind(rope)
        .bind(acquisition)
        .bind(page.before_seq())
        .bind(page.fetch())
        .fetch_all(self.reader())
        .await?;
        Ok(page.page(rows, |i: &Inspection| i.seq))
    }

    /// Ropes whose newest inspection with a model says that the model no longer fits.
    pub async fn ropes_with_unfit_model(&self) -> Result<i64, StoreError> {
        Ok(sqlx::query_scalar(
            "select count(*) from inspection i where json_extract(i.summary, '$.fit.fits') = 0
               and i.seq = (select max(seq) from inspection where rope_id = i.rope_id and model_id is not null)",
        )
        .fetch_one(self.reader())
        .await?)
    }

    /// The newest inspections with a model, newest first.
    pub async fn inspections_with(&self, model: Id, limit: u32) -> Result<Vec<Inspection>, StoreError> {
        Ok(sqlx::query_as("select * from judged_inspection where model_id = $1 order by seq desc limit $2")
            .bind(model)
            .bind(limit)
            .fetch_all(self.reader())
            .await?)
    }

    /// The last inspection of each acquisition of a rope that was acquired in `[from_ms, to_ms)`, oldest acquisition first:
    /// the columns of a history. At most `limit`, the newest ones.
    pub async fn inspections_by_date(
        &self,
        rope: Id,
        from_ms: i64,
        to_ms: i64,
        limit: u32,
    ) -> Result<Vec<(Id, Id, i64)>, StoreError> {
        Ok(sqlx::query_as(
            "select id, acquisition_id, at_ms from (
               select i.id, i.acquisition_id, coalesce(a.acquired_at_ms, a.created_at_ms) as at_ms
               from inspection i join acquisition a on a.id = i.acquisition_id
               where i.rope_id = $1 and i.seq = (select max(seq) from inspection where acquisition_id = i.acquisition_id)
                 and at_ms >= $2 and at_ms < $3
               order by at_ms desc limit $4)
             order by at_ms",
        )
        .bind(rope)
        .bind(from_ms)
        .bind(to_ms)
        .bind(limit)
        .fetch_all(self.reader())
        .await?)
    }
}
