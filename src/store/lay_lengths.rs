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
    strand_phase_sd_rad: Option<f64>,
    strand_score: Option<f64>,
    strand_spread_rad: Option<f64>,
    strand_spread_sd_rad: Option<f64>,
    diameter_mm: Option<f64>,
    diameter_sd_mm: Option<f64>,
    ovality_percent: Option<f64>,
    ovality_sd_percent: Option<f64>,
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
                strand_phase_sd_rad: self.strand_phase_sd_rad,
                strand_score: self.strand_score,
                strand_spread_rad: self.strand_spread_rad,
                strand_spread_sd_rad: self.strand_spread_sd_rad,
                diameter_mm: self.diameter_mm,
                diameter_sd_mm: self.diameter_sd_mm,
                ovality_percent: self.ovality_percent,
                ovality_sd_percent: self.ovality_sd_percent,
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

/// The columns of [`as_json`], and the expressions that take its rows apart.
macro_rules! columns_of_json {
    () => {
        "view, first_line, last_line, from_m, to_m, position_m, strand_lay_mm, strand_lay_sd_mm, strand_phase_rad, strand_score, diameter_mm,
         wires, reason, strand_phase_sd_rad, strand_spread_rad, strand_spread_sd_rad, diameter_sd_mm, ovality_percent, ovality_sd_percent)
         select $1, value->>0, value->>1, value->>2, value->>3, value->>4, value->>5, value->>6, value->>7, value->>8, value->>9,
           value->>10, value->11, value->>12, value->>13, value->>14, value->>15, value->>16, value->>17, value->>18
         from json_each($2)"
    };
}
pub(super) use columns_of_json;

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
                phase_sd_rad: finite(w.phase_sd_rad),
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
            finite(row.strand_phase_sd_rad),
            finite(row.strand_spread_rad),
            finite(row.strand_spread_sd_rad),
            finite(row.diameter_sd_mm),
            finite(row.ovality_percent),
            finite(row.ovality_sd_percent),
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
        sqlx::query(concat!("insert into lay_length (inspection_id, ", columns_of_json!()))
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::MIGRATIONS;
    use sqlx::Connection;

    /// The schema before diameters had deviations.
    const BEFORE: i64 = 50;

    #[tokio::test]
    async fn lay_lengths_of_an_older_database_stay_and_what_was_not_estimated_is_absent() {
        let mut connection = SqliteConnection::connect("sqlite::memory:").await.unwrap();
        let older = MIGRATIONS.iter().filter(|migration| migration.version < BEFORE);
        for migration in older {
            sqlx::raw_sql(migration.sql.clone()).execute(&mut connection).await.unwrap();
        }
        sqlx::raw_sql(
            r#"pragma foreign_keys = off;
               insert into lay_length (inspection_id, view, first_line, last_line, from_m, to_m, position_m, strand_lay_mm, diameter_mm, wires)
               values ('i', -1, 0, 1999, 0.0, 0.2, 0.1, 220.5, 31.9,
                 '[{"lay_mm": -95.1, "lay_sd_mm": 0.2, "phase_rad": 1.0, "score": 0.9}]')"#,
        )
        .execute(&mut connection)
        .await
        .unwrap();
        for migration in MIGRATIONS.iter().filter(|migration| migration.version >= BEFORE) {
            sqlx::raw_sql(migration.sql.clone()).execute(&mut connection).await.unwrap();
        }
        let raw: Raw = sqlx::query_as("select * from lay_length").fetch_one(&mut connection).await.unwrap();
        let row = raw.stretch(Id(uuid::Uuid::nil())).unwrap().row;
        assert_eq!((row.view, row.strand_lay_mm, row.diameter_mm), (None, Some(220.5), Some(31.9)));
        assert_eq!((row.diameter_sd_mm, row.ovality_percent, row.strand_spread_rad), (None, None, None));
        assert_eq!((row.wires[0].lay_mm, row.wires[0].phase_sd_rad), (Some(-95.1), None));
        assert_eq!(row.diameter_quality(), Some(crate::pipeline::quality::Quality::Uncertain));
    }
}
