//! What running inspections have found so far. It is no result: it lies in tables of its own, and the triggers of
//! `migrations/0020_live.sql` remove it in the transaction in which the job ends, however that is, or starts anew.

use super::lay_lengths::{FUSED, Raw, Stretch, as_json, columns_of_json};
use super::leases::Lease;
use super::{Id, Store, StoreError};
use crate::pipeline::Found;
use crate::pipeline::results::DefectRow;
use serde_json::json;

/// Defects that somebody who follows a job does not know yet.
#[derive(Debug, Clone, PartialEq)]
pub struct DefectNews {
    /// The latest change.
    pub seq: i64,
    /// All defects from the first that has changed, along the rope; they replace what was known from its number on.
    pub defects: Vec<DefectRow>,
}

impl Store {
    /// Adds what a job has found, in order. On [`Lease::Lost`] nothing was recorded.
    pub async fn keep_provisional(&self, job: Id, token: i64, found: &[Found]) -> Result<Lease, StoreError> {
        let mut tx = self.write().await?;
        let held: Option<f64> = sqlx::query_scalar(
            "select a.line_pitch_mm from job j join acquisition a on a.id = j.acquisition_id
             where j.id = $1 and j.lease_token = $2 and j.state = 'running'",
        )
        .bind(job)
        .bind(token)
        .fetch_optional(&mut *tx)
        .await?;
        let Some(line_pitch_mm) = held else { return Ok(Lease::Lost) };
        for found in found {
            sqlx::query(concat!("insert into provisional_lay_length (job_id, ", columns_of_json!()))
                .bind(job)
                .bind(as_json(&found.lay_lengths, line_pitch_mm))
                .execute(&mut *tx)
                .await?;
            let Some(defects) = &found.defects else { continue };
            sqlx::query("delete from provisional_defect where job_id = $1 and number >= $2")
                .bind(job)
                .bind(defects.from as i64)
                .execute(&mut *tx)
                .await?;
            sqlx::query(
                "insert into provisional_defect (job_id, number, defect) select $1, value->>'id', value from json_each($2)",
            )
            .bind(job)
            .bind(json!(defects.rows).to_string())
            .execute(&mut *tx)
            .await?;
        }
        tx.commit().await?;
        self.findings.send_replace(());
        Ok(Lease::Held)
    }

    /// Lay lengths that a running job has found in stretches that begin after `after_line`, along the rope, at most `limit`.
    /// `view` `None`: the fused estimate.
    pub async fn provisional_lay_lengths(
        &self,
        job: Id,
        view: Option<u32>,
        after_line: Option<u64>,
        limit: u32,
    ) -> Result<Vec<Stretch>, StoreError> {
        let rows: Vec<Raw> = sqlx::query_as(
            "select * from provisional_lay_length where job_id = $1 and view = $2 and first_line > $3 order by first_line limit $4",
        )
        .bind(job)
        .bind(view.map_or(FUSED, i64::from))
        .bind(after_line.map_or(-1, |line| i64::try_from(line).unwrap_or(i64::MAX)))
        .bind(limit)
        .fetch_all(self.reader())
        .await?;
        rows.into_iter().map(|raw| raw.stretch(job)).collect()
    }

    /// What has changed among the defects of a running job since the change `after_seq`; 0: all of them.
    pub async fn provisional_defects(&self, job: Id, after_seq: i64) -> Result<DefectNews, StoreError> {
        let rows: Vec<(i64, String)> = sqlx::query_as(
            "select seq, defect from provisional_defect where job_id = $1 and number >=
               (select min(number) from provisional_defect where job_id = $1 and seq > $2) order by number",
        )
        .bind(job)
        .bind(after_seq)
        .fetch_all(self.reader())
        .await?;
        let seq = rows.iter().map(|(seq, _)| *seq).max().unwrap_or(after_seq);
        let read = |(_, json): (i64, String)| {
            serde_json::from_str(&json).map_err(|e| StoreError::Inconsistent {
                table: "provisional_defect",
                column: "defect",
                row: job.to_string(),
                value: e.to_string(),
            })
        };
        Ok(DefectNews { seq, defects: rows.into_iter().map(read).collect::<Result<_, _>>()? })
    }
}
