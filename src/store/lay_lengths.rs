//! Lay lengths along the rope.

use super::{Id, Store, StoreError};
use crate::pipeline::results::{LayLengthRow, WireEstimate};
use serde_json::json;
use sqlx::SqliteConnection;

/// Rows per statement: one statement a row is seven times slower.
const CHUNK: usize = 2000;
/// `view` of the estimate fused over all views.
pub(super) const FUSED: i64 = -1;

/// A stretch of rope with its lay lengths.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// Rope metre where it begins.
    pub from_m: f64,
    /// Rope metre where it ends.
    pub to_m: f64,
    /// The estimates.
    pub row: LayLengthRow,
}

#[derive(sqlx::FromRow)]
pub(super) struct Raw {
    view: i64,
    first_line: i64,
    last_line: i64,
    from_m: f64,
    to_m: f64,
    position_m: f64,
    strand_lay_mm: Option<f64>,
    strand_lay_sd_mm: Option<f64>,
    strand_phase_rad: Option<f64>,
    strand_score: Option<f64>,
    diameter_mm: Option<f64>,
    wires: String,
    reason: Option<String>,
}

impl Raw {
    /// `of`: the inspection or job whose row it is.
    pub fn stretch(self, of: Id) -> Result<Stretch, StoreError> {
        let wires: Vec<WireEstimate> = serde_json::from_str(&self.wires).map_err(|e| StoreError::Inconsistent {
            table: "lay_length",
            column: "wires",
            row: format!("{of}, view {}, line {}", self.view, self.first_line),
            value: e.to_string(),
        })?;
        Ok(Stretch {
            from_m: self.from_m,
            to_m: self.to_m,
            row: LayLengthRow {
                view: usize::try_from(self.view).ok(), // -1: fused
                first_line: self.first_line as usize,
                last_line: self.last_line as usize,
                position_m: self.position_m,
                strand_lay_mm: self.strand_lay_mm,
                strand_lay_sd_mm: self.strand_lay_sd_mm,
                strand_phase_rad: self.strand_phase_rad,
                strand_score: self.strand_score,
                diameter_mm: self.diameter_mm,
                wires,
                reason: self.reason,
            },
        })
    }
}

/// Finite numbers only: JSON has no others, and a number that is none is an estimate that was not made.
fn finite(value: Option<f64>) -> Option<f64> {
    value.filter(|v| v.is_finite())
}

/// Rows as a JSON array, in the order of the columns from `view` on: what `json_each` of an insert takes apart.
pub(super) fn as_json(rows: &[LayLengthRow], line_pitch_mm: f64) -> String {
    let values = rows.iter().map(|row| {
        let half_m = (row.last_line - row.first_line + 1) as f64 / 2.0 * line_pitch_mm / 1000.0;
        let wires: Vec<_> = row
            .wires
            .iter()
            .map(|w| WireEstimate {
                lay_mm: finite(w.lay_mm),
                lay_sd_mm: finite(w.lay_sd_mm),
                phase_rad: finite(w.phase_rad),
                score: finite(w.score),
            })
            .collect();
        json!([
            row.view.map_or(FUSED, |v| v as i64),
            row.first_line,
            row.last_line,
            row.position_m - half_m,
            row.position_m + half_m,
            row.position_m,
            finite(row.strand_lay_mm),
            finite(row.strand_lay_sd_mm),
            finite(row.strand_phase_rad),
            finite(row.strand_score),
            finite(row.diameter_mm),
            wires,
            row.reason,
        ])
    });
    serde_json::Value::Array(values.collect()).to_string()
}

pub(super) async fn insert(
    connection: &mut SqliteConnection,
    inspection: Id,
    rows: &[LayLengthRow],
    line_pitch_mm: f64,
) -> Result<(), StoreError> {
    for chunk in rows.chunks(CHUNK) {
        sqlx::query(
            "insert into lay_length (inspection_id, view, first_line, last_line, from_m, to_m, position_m, strand_lay_mm,
               strand_lay_sd_mm, strand_phase_rad, strand_score, diameter_mm, wires, reason)
             select $1, value->>0, value->>1, value->>2, value->>3, value->>4, value->>5, value->>6, value->>7, value->>8, value->>9,
               value->>10, value->11, value->>12 from json_each($2)",
        )
        .bind(inspection)
        .bind(as_json(chunk, line_pitch_mm))
        .execute(&mut *connection)
        .await?;
    }
    Ok(())
}

impl Store {
    /// Stretches of an inspection that touch `[from_m, to_m]`, along the rope. `view` `None`: the fused estimate.
    pub async fn lay_lengths(
        &self,
        inspection: Id,
        view: Option<u32>,
        from_m: f64,
        to_m: f64,
    ) -> Result<Vec<Stretch>, StoreError> {
        let rows: Vec<Raw> = sqlx::query_as(
            "select * from lay_length where inspection_id = $1 and view = $2 and to_m >= $3 and from_m <= $4 order by first_line",
        )
        .bind(inspection)
        .bind(view.map_or(FUSED, i64::from))
        .bind(from_m)
        .bind(to_m)
        .fetch_all(self.reader())
        .await?;
        rows.into_iter().map(|raw| raw.stretch(inspection)).collect()
    }

    /// Rope metres that the lay lengths of an inspection span. `None` if there are none.
    pub async fn lay_length_span(&self, inspection: Id) -> Result<Option<(f64, f64)>, StoreError> {
        let span: (Option<f64>, Option<f64>) =
            sqlx::query_as("select min(from_m), max(to_m) from lay_length where inspection_id = $1")
                .bind(inspection)
                .fetch_one(self.reader())
                .await?;
        Ok(span.0.zip(span.1))
    }
}
