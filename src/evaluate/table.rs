//! CSV tables read row by row: only the columns asked for, and never the whole file.

use csv::{ByteRecord, Reader};
use std::fs::File;
use std::path::{Path, PathBuf};

/// Why results or truth could not be read.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// A file could not be read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
    /// A table is no table.
    #[error("{path}, row {row}: {reason}")]
    Row {
        /// The file.
        path: PathBuf,
        /// Row, the header being 1.
        row: u64,
        /// What is wrong.
        reason: String,
    },
    /// A table lacks a column.
    #[error("{path} has no column {column}; it has {present}")]
    NoColumn {
        /// The file.
        path: PathBuf,
        /// The column.
        column: String,
        /// The columns it has.
        present: String,
    },
    /// A file is not the JSON that is expected.
    #[error("{path} is not as expected: {reason}")]
    Json {
        /// The file.
        path: PathBuf,
        /// What the parser said.
        reason: String,
    },
}

/// A table that is being read.
pub struct Table {
    path: PathBuf,
    reader: Reader<File>,
    head: Vec<String>,
    row: ByteRecord,
    number: u64,
}

impl Table {
    /// Opens a table; `None` if the file does not exist.
    pub fn open(path: &Path) -> Result<Option<Self>, EvaluateError> {
        let file = match File::open(path) {
            Ok(file) => file,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(source) => return Err(EvaluateError::Read { path: path.into(), source }),
        };
        let mut reader = csv::ReaderBuilder::new().buffer_capacity(1 << 18).from_reader(file);
        let head =
            reader.headers().map_err(|e| EvaluateError::Row { path: path.into(), row: 1, reason: e.to_string() })?;
        let head = head.iter().map(str::to_owned).collect();
        Ok(Some(Self { path: path.into(), reader, head, row: ByteRecord::new(), number: 1 }))
    }

    /// Opens a table that must exist.
    pub fn open_required(path: &Path) -> Result<Self, EvaluateError> {
        Self::open(path)?
            .ok_or_else(|| EvaluateError::Read { path: path.into(), source: std::io::ErrorKind::NotFound.into() })
    }

    /// Index of a column, if it is there.
    pub fn find(&self, column: &str) -> Option<usize> {
        self.head.iter().position(|h| h == column)
    }

    /// Index of a column. Errors: it is not there.
    pub fn column(&self, column: &str) -> Result<usize, EvaluateError> {
        self.find(column).ok_or_else(|| EvaluateError::NoColumn {
            path: self.path.clone(),
            column: column.into(),
            present: self.head.join(", "),
        })
    }

    /// Goes to the next row. False at the end.
    pub fn next_row(&mut self) -> Result<bool, EvaluateError> {
        self.number += 1;
        let (path, row) = (&self.path, self.number);
        self.reader.read_byte_record(&mut self.row).map_err(|e| EvaluateError::Row {
            path: path.clone(),
            row,
            reason: e.to_string(),
        })
    }

    /// Number in a column of this row; `None` if the cell is empty, NaN or no number.
    pub fn number(&self, column: usize) -> Option<f64> {
        let text = std::str::from_utf8(self.row.get(column)?).ok()?;
        text.trim().parse().ok().filter(|x: &f64| !x.is_nan())
    }

    /// Whole number in a column of this row. Errors: it is none, where one must be.
    pub fn index(&self, column: usize) -> Result<usize, EvaluateError> {
        self.number(column).filter(|x| *x >= 0.0 && x.fract() == 0.0).map(|x| x as usize).ok_or_else(|| {
            let cell = self.row.get(column).map(String::from_utf8_lossy).unwrap_or_default();
            EvaluateError::Row {
                path: self.path.clone(),
                row: self.number,
                reason: format!("{} is {cell:?}, but must be a whole number from 0", self.head[column]),
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_numbers_or_nothing_and_errors_name_row_and_column() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        std::fs::write(&path, "line,score\n0,1.5\n1,\nx,nan\n").unwrap();
        let mut table = Table::open_required(&path).unwrap();
        let (line, score) = (table.column("line").unwrap(), table.column("score").unwrap());
        assert!(table.next_row().unwrap());
        assert_eq!((table.index(line).unwrap(), table.number(score)), (0, Some(1.5)));
        assert!(table.next_row().unwrap());
        assert_eq!(table.number(score), None);
        assert!(table.next_row().unwrap());
        let error = table.index(line).unwrap_err().to_string();
        assert!(error.ends_with("t.csv, row 4: line is \"x\", but must be a whole number from 0"), "{error}");
        assert!(!table.next_row().unwrap());
        assert!(table.column("view").unwrap_err().to_string().contains("it has line, score"));
        assert!(Table::open(&folder.path().join("none.csv")).unwrap().is_none());
    }
}
