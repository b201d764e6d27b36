//! Reads the tables of a results folder (design: results folder), to store them as rows.

use crate::pipeline::results::{DefectRow, LayLengthRow, WireEstimate};
use std::path::{Path, PathBuf};

/// Why a table could not be read.
#[derive(Debug, thiserror::Error)]
pub enum ResultsError {
    /// The file cannot be read as CSV.
    #[error("{path}: {source}")]
    Csv {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: csv::Error,
    },
    /// A value is not what its column promises.
    #[error("{path}, row {row}: column {column} holds {value:?}")]
    Value {
        /// The file.
        path: PathBuf,
        /// Row, the first after the head is 1.
        row: usize,
        /// The column.
        column: String,
        /// What stands there.
        value: String,
    },
    /// The file cannot be read as JSON.
    #[error("{path}: {reason}")]
    Json {
        /// The file.
        path: PathBuf,
        /// The cause.
        reason: String,
    },
}

/// Reads `lay_lengths.csv`. Columns are found by name, so that later versions may add some.
pub fn lay_lengths(folder: &Path) -> Result<Vec<LayLengthRow>, ResultsError> {
    let path = folder.join("lay_lengths.csv");
    let failed = |source| ResultsError::Csv { path: path.clone(), source };
    let mut reader = csv::Reader::from_path(&path).map_err(failed)?;
    let head = reader.headers().map_err(failed)?.clone();
    let strands = (0..).take_while(|j| head.iter().any(|name| name == format!("wire_lay_{j}_mm"))).count();
    let mut rows = Vec::new();
    for (n, record) in reader.records().enumerate() {
        let record = record.map_err(failed)?;
        let row = Row { path: &path, head: &head, record: &record, number: n + 1 };
        rows.push(LayLengthRow {
            view: row.optional("view")?,
            first_line: row.needed("first_line")?,
            last_line: row.needed("last_line")?,
            position_m: row.needed("position_m")?,
            strand_lay_mm: row.optional("strand_lay_mm")?,
            strand_lay_sd_mm: row.optional("strand_lay_sd_mm")?,
            strand_phase_rad: row.optional("strand_phase_rad")?,
            strand_phase_sd_rad: row.optional("strand_phase_sd_rad")?,
            strand_score: row.optional("strand_score")?,
            strand_spread_rad: row.optional("strand_spread_rad")?,
            strand_spread_sd_rad: row.optional("strand_spread_sd_rad")?,
            diameter_mm: row.optional("diameter_mm")?,
            diameter_sd_mm: row.optional("diameter_sd_mm")?,
            ovality_percent: row.optional("ovality_percent")?,
            ovality_sd_percent: row.optional("ovality_sd_percent")?,
            wires: (0..strands)
                .map(|j| {
                    Ok(WireEstimate {
                        lay_mm: row.optional(&format!("wire_lay_{j}_mm"))?,
                        lay_sd_mm: row.optional(&format!("wire_lay_{j}_sd_mm"))?,
                        phase_rad: row.optional(&format!("wire_phase_{j}_rad"))?,
                        phase_sd_rad: row.optional(&format!("wire_phase_{j}_sd_rad"))?,
                        score: row.optional(&format!("wire_score_{j}"))?,
                    })
                })
                .collect::<Result<_, ResultsError>>()?,
            reason: row.text("reason").map(str::to_owned),
        });
        let last = rows.last().map_or((0, 0), |r: &LayLengthRow| (r.first_line, r.last_line));
        if last.1 < last.0 {
            return Err(row.wrong("last_line", &last.1.to_string()));
        }
    }
    Ok(rows)
}

struct Row<'a> {
    path: &'a Path,
    head: &'a csv::StringRecord,
    record: &'a csv::StringRecord,
    number: usize,
}

impl<'a> Row<'a> {
    /// The cell of a column; `None` if it is empty or the column is not there.
    fn text(&self, column: &str) -> Option<&'a str> {
        let index = self.head.iter().position(|name| name == column)?;
        self.record.get(index).map(str::trim).filter(|cell| !cell.is_empty())
    }

    fn optional<T: std::str::FromStr>(&self, column: &str) -> Result<Option<T>, ResultsError> {
        self.text(column).map(|cell| cell.parse().map_err(|_| self.wrong(column, cell))).transpose()
    }

    fn needed<T: std::str::FromStr>(&self, column: &str) -> Result<T, ResultsError> {
        self.optional(column)?.ok_or_else(|| self.wrong(column, ""))
    }

    fn wrong(&self, column: &str, value: &str) -> ResultsError {
        ResultsError::Value { path: self.path.into(), row: self.number, column: column.into(), value: value.into() }
    }
}

/// Reads `defects.json`; an inspection without a model has none.
pub fn defects(folder: &Path) -> Result<Vec<DefectRow>, ResultsError> {
    places(folder.join("defects.json"))
}

/// Reads `look_again.json`; an inspection without a second level has none.
pub fn look_again(folder: &Path) -> Result<Vec<DefectRow>, ResultsError> {
    places(folder.join("look_again.json"))
}

fn places(path: PathBuf) -> Result<Vec<DefectRow>, ResultsError> {
    match std::fs::read(&path) {
        Ok(bytes) => serde_json::from_slice(&bytes).map_err(|e| ResultsError::Json { path, reason: e.to_string() }),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Vec::new()),
        Err(error) => Err(ResultsError::Json { path, reason: error.to_string() }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_cell_is_no_estimate_and_an_empty_view_is_the_fused_one() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(
            folder.path().join("lay_lengths.csv"),
            "view,first_line,last_line,position_m,strand_lay_mm,wire_lay_0_mm,wire_lay_1_mm,reason\n\
             ,0,1999,0.1,137.5,-70.25,,\n0,0,1999,0.1,,,,too dark\n",
        )
        .unwrap();
        let rows = lay_lengths(folder.path()).unwrap();
        assert_eq!((rows[0].view, rows[0].strand_lay_mm), (None, Some(137.5)));
        assert_eq!(rows[0].wires.iter().map(|w| w.lay_mm).collect::<Vec<_>>(), [Some(-70.25), None]);
        assert_eq!((rows[1].view, rows[1].reason.as_deref()), (Some(0), Some("too dark")));
    }

    #[test]
    fn a_cell_that_is_no_number_is_named() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("lay_lengths.csv"), "first_line,last_line,position_m\n0,x,0.1\n").unwrap();
        let error = lay_lengths(folder.path()).unwrap_err().to_string();
        assert!(error.ends_with("row 1: column last_line holds \"x\""), "{error}");
    }
}
