//! Tables as JSON or CSV, as the client likes.

use super::Problem;
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

/// How a table is sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// JSON.
    Json,
    /// CSV with a head, numbers with a point; an empty cell is no value.
    Csv,
}

/// How a table is asked for.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct FormatQuery {
    /// `json` (default) or `csv`; `Accept: text/csv` does too.
    #[param(inline)]
    pub format: Option<Format>,
}

/// True when the client wants CSV: `format=csv`, or an `Accept` that names `text/csv`.
pub fn wants_csv(format: Option<Format>, headers: &HeaderMap) -> bool {
    match format {
        Some(format) => format == Format::Csv,
        None => headers
            .get_all(header::ACCEPT)
            .iter()
            .filter_map(|value| value.to_str().ok())
            .any(|value| value.split(',').any(|kind| kind.trim().starts_with("text/csv"))),
    }
}

/// A table as CSV.
pub struct CsvTable(csv::Writer<Vec<u8>>);

impl CsvTable {
    /// With these columns.
    pub fn new<T: AsRef<str>>(columns: &[T]) -> Result<Self, Problem> {
        let mut table = Self(csv::Writer::from_writer(Vec::new()));
        table.0.write_record(columns.iter().map(AsRef::as_ref)).map_err(Problem::failure)?;
        Ok(table)
    }

    /// Adds a row.
    pub fn row(&mut self, cells: &[String]) -> Result<(), Problem> {
        self.0.write_record(cells).map_err(Problem::failure)
    }

    /// The answer.
    pub fn finish(self) -> Result<Response, Problem> {
        let bytes = self.0.into_inner().map_err(Problem::failure)?;
        Ok(csv_answer(bytes))
    }
}

/// CSV as an answer.
pub fn csv_answer(bytes: Vec<u8>) -> Response {
    ([(header::CONTENT_TYPE, "text/csv; charset=utf-8")], bytes).into_response()
}

/// A cell; empty if there is no value.
pub fn cell<T: ToString>(value: Option<T>) -> String {
    value.map_or_else(String::new, |v| v.to_string())
}
