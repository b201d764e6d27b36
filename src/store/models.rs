//! Appearance models: versioned per rope, with what they were trained on.

use super::leases::{Lease, settle};
use super::{Id, Page, PageRequest, Store, StoreError};
use crate::pipeline::TrainReport;

/// A model.
#[derive(Debug, Clone, PartialEq, sqlx::FromRow)]
pub struct Model {
    /// Order of arrival.
    pub seq: i64,
    /// Id; names its file.
    pub id: Id,
    /// The rope it knows.
    pub rope_id: Id,
    /// 1, 2, .. per rope.
    pub version: u32,
    /// What it was trained on.
    pub acquisition_id: Id,
    /// The job that trained it.
    pub job_id: Id,
    /// JSON of [`TrainReport`].
    pub report: String,
    /// Digest of its file, lower-case hex.
    pub sha256: String,
    /// Length of its file.
    pub bytes: i64,
    /// When it was made, ms since 1970.
    pub created_at_ms: i64,
}

/// A model to be recorded; its file is in place.
#[derive(Debug, Clone, PartialEq)]
pub struct NewModel {
    /// Id; names its file.
    pub id: Id,
    /// JSON of the training report.
    pub report: String,
    /// Digest of its file, lower-case hex.
    pub sha256: String,
    /// Length of its file.
    pub bytes: i64,
}

impl Model {
    /// What its training says of itself.
    pub fn report(&self) -> Result<TrainReport, StoreError> {
        serde_json::from_str(&self.report).map_err(|e| StoreError::Inconsistent {
            table: "model",
            column: "report",
            row: self.id.to_string(),
            value: e.to_string(),
        })
    }
}

impl Store {
    /// Ends a training job with its model, in one transaction. On [`Lease::Lost`] nothing was recorded.
    pub async fn settle_trained(
        &self,
        job: Id,
        token: i64,
        model: &NewModel,
        now_ms: i64,
    ) -> Result<Lease, StoreError> {
        let mut tx = self.write().await?;
        if settle(&mut tx, job, token, "succeeded", Some(model.id), None, now_ms).await? == 0 {
            return Ok(Lease::Lost);
        }
        sqlx::query(
            "insert into model (id, rope_id, version, acquisition_id, job_id, report, sha256, bytes, created_at_ms)
             select $1, j.rope_id, (select coalesce(max(m.version), 0) + 1 from model m where m.rope_id = j.rope_id),
               j.acquisition_id, j.id, $3, $4, $5, $6 from job j where j.id = $2",
        )
        .bind(model.id)
        .bind(job)
        .bind(&model.report)
        .bind(&model.sha256)
        .bind(model.bytes)
        .bind(now_ms)
        .execute(&mut *tx)
        .await?;
        tx.commit().await?;
        Ok(Lease::Held)
    }

    /// A model.
    pub async fn model(&self, id: Id) -> Result<Option<Model>, StoreError> {
        Ok(sqlx::query_as("select * from model where id = $1").bind(id).fetch_optional(self.reader()).await?)
    }

    /// Models, of one rope or of all, page by page.
    pub async fn models(&self, rope: Option<Id>, page: PageRequest) -> Result<Page<Model>, StoreError> {
        let rows = sqlx::query_as(
            "select * from model where ($1 is null or rope_id = $1) and seq < $2 order by seq desc limit $3",
        )
        .bind(rope)
        .bind(page.before_seq())
        .bind(page.fetch())
        .fetch_all(self.reader())
        .await?;
        Ok(page.page(rows, |m: &Model| m.seq))
    }
}
