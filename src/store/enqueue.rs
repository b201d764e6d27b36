//! Jobs to be queued: what shall be done, and what may stand against it.

use super::jobs::Job;
use super::{Id, Store, StoreError, model_thresholds};
use crate::pipeline::TrainOptions;
use serde::{Deserialize, Serialize};
use sqlx::SqliteConnection;

/// Intact rope of an acquisition.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FurtherRange {
    /// The acquisition.
    pub acquisition_id: Id,
    /// Rope metre from which on the rope is intact; `None`: from the start.
    pub from_m: Option<f64>,
    /// Rope metre up to which it is; `None`: to the end.
    pub to_m: Option<f64>,
}

/// What shall be done.
#[derive(Debug, Clone, PartialEq)]
pub enum Task {
    /// Learn the appearance of intact rope, from and to a rope metre.
    Train {
        /// `None`: from the start.
        from_m: Option<f64>,
        /// `None`: to the end.
        to_m: Option<f64>,
        /// What else was chosen for it.
        options: TrainOptions,
        /// Rope of further acquisitions to learn from.
        further: Vec<FurtherRange>,
    },
    /// Measure lay lengths and, with a model, find defects.
    Inspect {
        /// `None`: alignment only.
        model_id: Option<Id>,
        /// `None`: the one that holds for the model when the job is queued.
        threshold: Option<f64>,
        /// It may begin while the acquisition is still open.
        live: bool,
    },
}

/// A job to be queued.
#[derive(Debug, Clone, PartialEq)]
pub struct NewJob {
    /// Id.
    pub id: Id,
    /// The acquisition to work on: complete, or else the job is live.
    pub acquisition_id: Id,
    /// What to do with it.
    pub task: Task,
    /// The client's key; a repeated request with it is the same job.
    pub idempotency_key: Option<String>,
}

/// What came of the wish for a job.
#[derive(Debug, Clone, PartialEq)]
pub enum Enqueued {
    /// It is queued.
    New(Job),
    /// The same request was made before.
    Same(Job),
    /// The key or the id belongs to another request; nothing was changed.
    Different(Job),
    /// There is no such acquisition.
    NoAcquisition(Id),
    /// The acquisition is not complete, and the job is not live.
    Incomplete(Id),
    /// A further acquisition shows another rope than the first.
    AcquisitionOfAnotherRope {
        /// The further acquisition.
        acquisition: Id,
        /// Its rope.
        other: Id,
        /// Rope of the first.
        rope: Id,
    },
    /// There is no such model.
    NoModel,
    /// The model is of another rope.
    ModelOfAnotherRope {
        /// Rope of the model.
        model_rope: Id,
        /// Rope of the acquisition.
        rope: Id,
    },
}

async fn rope_and_state(
    connection: &mut SqliteConnection,
    acquisition: Id,
) -> Result<Option<(Id, String)>, StoreError> {
    Ok(sqlx::query_as("select rope_id, state from acquisition where id = $1")
        .bind(acquisition)
        .fetch_optional(connection)
        .await?)
}

impl Store {
    /// Queues a job.
    pub async fn enqueue(&self, new: &NewJob, now_ms: i64) -> Result<Enqueued, StoreError> {
        let (kind, from_m, to_m, options, model_id, threshold, live) = match new.task {
            Task::Train { from_m, to_m, options, .. } => ("train", from_m, to_m, Some(options), None, None, false),
            Task::Inspect { model_id, threshold, live } => ("inspect", None, None, None, model_id, threshold, live),
        };
        let further: &[FurtherRange] = match &new.task {
            Task::Train { further, .. } => further,
            Task::Inspect { .. } => &[],
        };
        let mut tx = self.write().await?;
        let old: Option<Job> =
            sqlx::query_as("select * from job where id = $1 or (kind = $2 and idempotency_key = $3)")
                .bind(new.id)
                .bind(kind)
                .bind(&new.idempotency_key)
                .fetch_optional(&mut *tx)
                .await?;
        if let Some(old) = old {
            let same = old.kind == kind
                && old.acquisition_id == new.acquisition_id
                && old.model_id == model_id
                && old.threshold == threshold
                && old.live == live
                && old.from_m == from_m
                && old.to_m == to_m
                && old.further()? == further
                && (kind != "train" || Some(old.options()?) == options);
            return Ok(if same { Enqueued::Same(old) } else { Enqueued::Different(old) });
        }
        let Some((rope, state)) = rope_and_state(&mut tx, new.acquisition_id).await? else {
            return Ok(Enqueued::NoAcquisition(new.acquisition_id));
        };
        if state != "complete" && !live {
            return Ok(Enqueued::Incomplete(new.acquisition_id));
        }
        for &FurtherRange { acquisition_id: acquisition, .. } in further {
            match rope_and_state(&mut tx, acquisition).await? {
                None => return Ok(Enqueued::NoAcquisition(acquisition)),
                Some((other, _)) if other != rope => {
                    return Ok(Enqueued::AcquisitionOfAnotherRope { acquisition, other, rope });
                }
                Some((_, state)) if state != "complete" => return Ok(Enqueued::Incomplete(acquisition)),
                Some(_) => {}
            }
        }
        if let Some(model) = model_id {
            let model_rope: Option<Id> = sqlx::query_scalar("select rope_id from model where id = $1")
                .bind(model)
                .fetch_optional(&mut *tx)
                .await?;
            match model_rope {
                None => return Ok(Enqueued::NoModel),
                Some(model_rope) if model_rope != rope => {
                    return Ok(Enqueued::ModelOfAnotherRope { model_rope, rope });
                }
                Some(_) => {}
            }
        }
        let threshold_version = match (model_id, threshold) {
            (Some(model), None) => model_thresholds::current_version(&mut tx, model).await?,
            _ => None,
        };
        let job = sqlx::query_as(
            "insert into job (id, kind, rope_id, acquisition_id, model_id, threshold, threshold_version, from_m, to_m, idempotency_key,
               live, state, run_at_ms, created_at_ms, budget, further, bandwidths)
             values ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, 'queued', $12, $12, $13, $14, $15) returning *",
        )
        .bind(new.id)
        .bind(kind)
        .bind(rope)
        .bind(new.acquisition_id)
        .bind(model_id)
        .bind(threshold)
        .bind(threshold_version)
        .bind(from_m)
        .bind(to_m)
        .bind(&new.idempotency_key)
        .bind(live)
        .bind(now_ms)
        .bind(options.map(|o| serde_json::json!(o.budget).to_string()))
        .bind((!further.is_empty()).then(|| serde_json::json!(further).to_string()))
        .bind(options.map(|o| serde_json::json!(o.bandwidths).to_string()))
        .fetch_one(&mut *tx)
        .await?;
        tx.commit().await?;
        Ok(Enqueued::New(job))
    }
}
