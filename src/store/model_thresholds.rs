//! Thresholds that people set for a model after its training: numbered, never changed, with who and why.

use super::{Id, Store, StoreError};
use crate::pipeline::results::Threshold;
use sqlx::SqliteConnection;

/// A threshold that somebody set.
#[derive(Debug, Clone, PartialEq, sqlx::FromRow)]
pub struct ModelThreshold {
    /// The model.
    pub model_id: Id,
    /// 1, 2, .. per model; the trained threshold is version 0 and stands in the model's report.
    pub version: u32,
    /// Lines with a score above it are alarms.
    pub line_score: f64,
    /// Lines above it are worth looking at again; `None`: it lies as far under the first as the trained one.
    pub look_again_line_score: Option<f64>,
    /// Who set it.
    pub set_by: String,
    /// Why.
    pub reason: String,
    /// When, ms since 1970.
    pub created_at_ms: i64,
}

impl ModelThreshold {
    /// Where the threshold comes from, as a sentence for summaries.
    pub fn origin(&self) -> String {
        format!("version {} for this model, set by {}: {}", self.version, self.set_by, self.reason)
    }

    /// The threshold as inspections judge by it.
    pub fn decides(&self) -> Threshold {
        Threshold {
            line_score: self.line_score,
            look_again_line_score: self.look_again_line_score,
            origin: self.origin(),
        }
    }
}

/// What came of the wish for another threshold.
#[derive(Debug, Clone, PartialEq)]
pub enum Moved {
    /// It holds from now on.
    New(ModelThreshold),
    /// The same call set it before.
    Same(ModelThreshold),
    /// The version is taken by another threshold, or leaves a gap; nothing was changed.
    OutOfTurn {
        /// The version that is free.
        next: u32,
    },
    /// There is no such model.
    NoModel,
}

/// The version that holds for a model now; `None`: the trained one.
pub(super) async fn current_version(connection: &mut SqliteConnection, model: Id) -> sqlx::Result<Option<u32>> {
    sqlx::query_scalar("select max(version) from model_threshold where model_id = $1")
        .bind(model)
        .fetch_one(connection)
        .await
}

impl Store {
    /// Sets the next threshold of a model; the time of `new` counts only if it is new.
    pub async fn move_threshold(&self, new: &ModelThreshold) -> Result<Moved, StoreError> {
        let mut tx = self.write().await?;
        let models: i64 = sqlx::query_scalar("select count(*) from model where id = $1")
            .bind(new.model_id)
            .fetch_one(&mut *tx)
            .await?;
        if models == 0 {
            return Ok(Moved::NoModel);
        }
        let old: Option<ModelThreshold> =
            sqlx::query_as("select * from model_threshold where model_id = $1 and version = $2")
                .bind(new.model_id)
                .bind(new.version)
                .fetch_optional(&mut *tx)
                .await?;
        if let Some(old) = old
            && *new == (ModelThreshold { created_at_ms: new.created_at_ms, ..old.clone() })
        {
            return Ok(Moved::Same(old));
        }
        let next = current_version(&mut tx, new.model_id).await?.unwrap_or(0) + 1;
        if new.version != next {
            return Ok(Moved::OutOfTurn { next });
        }
        sqlx::query(
            "insert into model_threshold (model_id, version, line_score, look_again_line_score, set_by, reason, created_at_ms)
             values ($1, $2, $3, $4, $5, $6, $7)",
        )
        .bind(new.model_id)
        .bind(new.version)
        .bind(new.line_score)
        .bind(new.look_again_line_score)
        .bind(&new.set_by)
        .bind(&new.reason)
        .bind(new.created_at_ms)
        .execute(&mut *tx)
        .await?;
        tx.commit().await?;
        Ok(Moved::New(new.clone()))
    }

    /// Thresholds that were set for a model, newest first.
    pub async fn model_thresholds(&self, model: Id) -> Result<Vec<ModelThreshold>, StoreError> {
        Ok(sqlx::query_as("select * from model_threshold where model_id = $1 order by version desc")
            .bind(model)
            .fetch_all(self.reader())
            .await?)
    }

    /// One of them.
    pub async fn model_threshold(&self, model: Id, version: u32) -> Result<Option<ModelThreshold>, StoreError> {
        Ok(sqlx::query_as("select * from model_threshold where model_id = $1 and version = $2")
            .bind(model)
            .bind(version)
            .fetch_optional(self.reader())
            .await?)
    }
}
