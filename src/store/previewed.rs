//! What the one job of an acquisition that looks at its previews has seen in them.

use super::leases::{Lease, settle};
use super::{Id, Store, StoreError};

/// A frame that is wanted before its turn.
#[derive(Debug, Clone, PartialEq)]
pub struct Suspicion {
    /// The view.
    pub view: u32,
    /// The frame.
    pub frame: u32,
    /// Higher is sooner.
    pub value: f64,
    /// Why, as a sentence.
    pub reason: String,
}

/// What the preview job saw of a view, stretch after stretch.
#[derive(Debug, Clone, PartialEq, sqlx::FromRow)]
pub struct PreviewedStretch {
    /// The view.
    pub view: u32,
    /// Rope metre where it begins.
    pub from_m: f64,
    /// Rope metre where it ends.
    pub to_m: f64,
    /// Why the view was not usable here; `None`: it was.
    pub reason: Option<String>,
}

impl Store {
    /// What a preview job has seen of every view so far, along the rope.
    pub async fn previewed(&self, job: Id) -> Result<Vec<PreviewedStretch>, StoreError> {
        Ok(sqlx::query_as(
            "select view, from_m, to_m, iif(strand_lay_mm is null, coalesce(reason, 'not measured'), null) as reason
             from provisional_lay_length where job_id = $1 and view >= 0 order by view, first_line",
        )
        .bind(job)
        .fetch_all(self.reader())
        .await?)
    }

    /// Ends a preview job: it has no result, but says which frames are wanted first.
    pub async fn settle_previewed(
        &self,
        job: Id,
        token: i64,
        suspicions: &[Suspicion],
        now_ms: i64,
    ) -> Result<Lease, StoreError> {
        let mut tx = self.write().await?;
        if settle(&mut tx, job, token, "succeeded", None, None, now_ms).await? == 0 {
            return Ok(Lease::Lost);
        }
        for s in suspicions {
            sqlx::query(
                "update preview set suspicion = $4, reason = $5
                 where acquisition_id = (select acquisition_id from job where id = $1) and view = $2 and frame = $3",
            )
            .bind(job)
            .bind(s.view)
            .bind(s.frame)
            .bind(s.value)
            .bind(&s.reason)
            .execute(&mut *tx)
            .await?;
        }
        tx.commit().await?;
        Ok(Lease::Held)
    }
}
