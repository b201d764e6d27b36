//! Writes the tables of the results folder while the rope goes by.

use super::results::{LayLengthRow, WireEstimate};
use super::{Acquisition, PipelineError};
use crate::vision::aligner::AlignedStretch;
use crate::vision::estimates::{LayEstimate, StretchEstimate};
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

/// A `Write` error with its file.
pub fn write_error(path: &Path) -> impl FnOnce(std::io::Error) -> PipelineError + use<'_> {
    move |source| PipelineError::Write { path: path.into(), source }
}

/// Rows of a stretch: the fused one first, then one a view.
pub fn lay_length_rows(acquisition: &Acquisition, stretch: &AlignedStretch) -> Vec<LayLengthRow> {
    let views = acquisition.view_angles_rad.len();
    let middle = stretch.first_line as f64 + (stretch.lines as f64 - 1.0) / 2.0;
    let row = |view, estimate: Option<&StretchEstimate>, diameter_mm, reason: Option<String>| {
        let strand = estimate.and_then(|e| e.strand);
        let wires = (0..acquisition.rope.strands())
            .map(|j| {
                let wire = estimate.and_then(|e| e.wires.get(j).copied().flatten());
                WireEstimate {
                    lay_mm: wire.map(|w| w.lay_mm),
                    lay_sd_mm: wire.map(|w| w.lay_sd_mm),
                    phase_rad: wire.map(|w| w.phase_rad),
                    score: wire.map(|w| w.score),
                }
            })
            .collect::<Vec<_>>();
        let missing_wires = wires.iter().filter(|w| w.lay_mm.is_none()).count();
        let reason = reason.or_else(|| match (strand, missing_wires) {
            (None, _) => Some("the strands were not seen well enough here".to_owned()),
            (Some(_), 0) => None,
            (Some(_), n) => Some(format!("the wires of {n} strands were not seen well enough here")),
        });
        LayLengthRow {
            view,
            first_line: stretch.first_line,
            last_line: stretch.first_line + stretch.lines - 1,
            position_m: acquisition.start_m + middle * acquisition.line_pitch_mm / 1000.0,
            strand_lay_mm: strand.map(|s: LayEstimate| s.lay_mm),
            strand_lay_sd_mm: strand.map(|s| s.lay_sd_mm),
            strand_phase_rad: strand.map(|s| s.phase_rad),
            strand_score: strand.map(|s| s.score),
            diameter_mm,
            wires,
            reason,
        }
    };
    match &stretch.estimates {
        Ok(estimates) => std::iter::once(row(None, Some(&estimates.fused), estimates.diameter_mm, None))
            .chain(estimates.views.iter().enumerate().map(|(v, e)| row(Some(v), Some(e), None, None)))
            .collect(),
        Err(reason) => std::iter::once(None)
            .chain((0..views).map(Some))
            .map(|view| row(view, None, None, Some(reason.to_string())))
            .collect(),
    }
}

/// `lay_lengths.csv`.
pub struct LayLengthTable {
    path: PathBuf,
    writer: csv::Writer<File>,
}

impl LayLengthTable {
    /// Creates the file with its header.
    pub fn create(path: PathBuf, strands: usize) -> Result<Self, PipelineError> {
        let file = File::create(&path).map_err(write_error(&path))?;
        let mut writer = csv::Writer::from_writer(file);
        let fixed = [
            "view",
            "first_line",
            "last_line",
            "position_m",
            "strand_lay_mm",
            "strand_lay_sd_mm",
            "strand_phase_rad",
            "strand_score",
        ];
        let wires = (0..strands).flat_map(|j| {
            [
                format!("wire_lay_{j}_mm"),
                format!("wire_lay_{j}_sd_mm"),
                format!("wire_phase_{j}_rad"),
                format!("wire_score_{j}"),
            ]
        });
        let header: Vec<String> =
            fixed.into_iter().map(str::to_owned).chain(wires).chain(["diameter_mm".into(), "reason".into()]).collect();
        writer.write_record(header).map_err(|e| write_error(&path)(e.into()))?;
        Ok(Self { path, writer })
    }

    /// Writes a row.
    pub fn write(&mut self, row: &LayLengthRow) -> Result<(), PipelineError> {
        let number = |value: Option<f64>, digits: usize| value.map_or(String::new(), |v| format!("{v:.digits$}"));
        let mut record = vec![
            row.view.map_or(String::new(), |v| v.to_string()),
            row.first_line.to_string(),
            row.last_line.to_string(),
            format!("{:.5}", row.position_m),
            number(row.strand_lay_mm, 4),
            number(row.strand_lay_sd_mm, 4),
            number(row.strand_phase_rad, 5),
            number(row.strand_score, 4),
        ];
        for wire in &row.wires {
            record.extend([
                number(wire.lay_mm, 4),
                number(wire.lay_sd_mm, 4),
                number(wire.phase_rad, 5),
                number(wire.score, 4),
            ]);
        }
        record.push(number(row.diameter_mm, 3));
        record.push(row.reason.clone().unwrap_or_default());
        self.writer.write_record(record).map_err(|e| write_error(&self.path)(e.into()))
    }

    /// Flushes; every row is in the file afterwards.
    pub fn finish(mut self) -> Result<(), PipelineError> {
        self.writer.flush().map_err(write_error(&self.path))
    }
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
