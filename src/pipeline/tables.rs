//! Values of single lines, written to tables of the results folder when the rope has gone by.

use super::PipelineError;
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

/// A `Write` error with its file.
pub fn write_error(path: &Path) -> impl FnOnce(std::io::Error) -> PipelineError + use<'_> {
    move |source| PipelineError::Write { path: path.into(), source }
}

/// Appends a whole number with at least so many digits.
fn push_whole(row: &mut Vec<u8>, number: u64, least_digits: usize) {
    let first = row.len();
    let mut rest = number;
    while rest > 0 || row.len() < first + least_digits {
        row.push(b'0' + (rest % 10) as u8);
        rest /= 10;
    }
    row[first..].reverse();
}

/// Appends a number with so many digits behind the point; halves are rounded away from 0. Every line has two of them: by formatting,
/// an inspection takes a twelfth more processor time, all of it at its end on one core.
fn push_decimal(row: &mut Vec<u8>, value: f32, digits: usize) {
    let one = 10u64.pow(digits as u32);
    let parts = (f64::from(value.abs()) * one as f64).round() as u64;
    if value < 0.0 {
        row.push(b'-');
    }
    push_whole(row, parts / one, 1);
    row.push(b'.');
    push_whole(row, parts % one, digits);
}

/// One value per line of every view, gathered on disk while the rope goes by: tables that need the whole, such as a mean, are
/// written at the end without holding it in memory. NaN means no value.
pub struct LineValues {
    path: PathBuf,
    folder: PathBuf,
    writers: Vec<BufWriter<File>>,
    sums: Vec<(f64, u64)>,
}

impl LineValues {
    /// Temporary files beside the results.
    pub fn create(folder: &Path, views: usize) -> Result<Self, PipelineError> {
        let writers = (0..views)
            .map(|_| {
                tempfile::tempfile_in(folder).map(|f| BufWriter::with_capacity(1 << 16, f)).map_err(write_error(folder))
            })
            .collect::<Result<_, _>>()?;
        Ok(Self { path: folder.into(), folder: folder.into(), writers, sums: vec![(0.0, 0); views] })
    }

    /// Appends the values of consecutive lines of a view.
    pub fn append(&mut self, view: usize, values: impl Iterator<Item = f32>) -> Result<(), PipelineError> {
        for value in values {
            if value.is_finite() {
                self.sums[view].0 += f64::from(value);
                self.sums[view].1 += 1;
            }
            self.writers[view].write_all(&value.to_le_bytes()).map_err(write_error(&self.path))?;
        }
        Ok(())
    }

    /// Writes `header` and `view,line,value` for every value there is, less the view's mean where asked.
    pub fn write_csv(mut self, name: &str, header: &str, less_mean: bool, digits: usize) -> Result<(), PipelineError> {
        let path = self.folder.join(name);
        let mut out = BufWriter::with_capacity(1 << 18, File::create(&path).map_err(write_error(&path))?);
        writeln!(out, "{header}").map_err(write_error(&path))?;
        let mut row = Vec::with_capacity(64);
        for view in 0..self.writers.len() {
            let (sum, count) = self.sums[view];
            let mean = if less_mean && count > 0 { (sum / count as f64) as f32 } else { 0.0 };
            self.read_back(view, |line, value| {
                if !value.is_finite() {
                    return Ok(());
                }
                row.clear();
                push_whole(&mut row, view as u64, 1);
                row.push(b',');
                push_whole(&mut row, line as u64, 1);
                row.push(b',');
                push_decimal(&mut row, value - mean, digits);
                row.push(b'\n');
                out.write_all(&row)
            })?;
        }
        out.flush().map_err(write_error(&path))
    }

    /// Writes one little-endian f32 file a view, named `{stem}_view{v}.f32`.
    pub fn write_binary(mut self, stem: &str) -> Result<(), PipelineError> {
        for view in 0..self.writers.len() {
            let path = self.folder.join(format!("{stem}_view{view}.f32"));
            let mut out = BufWriter::with_capacity(1 << 18, File::create(&path).map_err(write_error(&path))?);
            self.read_back(view, |_, value| out.write_all(&value.to_le_bytes()))?;
            out.flush().map_err(write_error(&path))?;
        }
        Ok(())
    }

    fn read_back(
        &mut self,
        view: usize,
        mut each: impl FnMut(usize, f32) -> std::io::Result<()>,
    ) -> Result<(), PipelineError> {
        use std::io::{Seek, SeekFrom};
        let failed = |source| PipelineError::Write { path: self.path.clone(), source };
        self.writers[view].flush().map_err(failed)?;
        let file = self.writers[view].get_mut();
        file.seek(SeekFrom::Start(0)).map_err(failed)?;
        let mut reader = BufReader::with_capacity(1 << 18, file);
        let mut bytes = [0u8; 4];
        let mut line = 0;
        loop {
            match reader.read_exact(&mut bytes) {
                Ok(()) => each(line, f32::from_le_bytes(bytes)).map_err(failed)?,
                Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => return Ok(()),
                Err(e) => return Err(failed(e)),
            }
            line += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimals_are_those_that_formatting_gives() {
        for value in [0.0f32, 0.0004, -0.0126, 1.9996, -12.3456, 1234.5, 70.0] {
            let mut row = Vec::new();
            push_decimal(&mut row, value, 3);
            assert_eq!(String::from_utf8(row).unwrap(), format!("{value:.3}"));
        }
    }
}
