//! `lay_lengths.csv`: what was estimated of every stretch, written while the rope goes by.

use super::quality::Quality;
use super::results::{LayLengthRow, WireEstimate};
use super::tables::write_error;
use super::{Acquisition, PipelineError};
use crate::vision::aligner::AlignedStretch;
use crate::vision::diameter::WithSd;
use crate::vision::estimates::{Estimates, LayEstimate, StretchEstimate};
use std::fs::File;
use std::path::PathBuf;

/// Rows of a stretch: the fused one first, then one a view.
pub fn lay_length_rows(acquisition: &Acquisition, stretch: &AlignedStretch) -> Vec<LayLengthRow> {
    let views = (0..acquisition.view_angles_rad.len()).map(Some);
    let row = |view: Option<usize>| {
        let empty = empty_row(acquisition, stretch, view);
        match &stretch.estimates {
            Ok(estimates) => filled(empty, estimates),
            Err(reason) => LayLengthRow { reason: Some(reason.to_string()), ..empty },
        }
    };
    std::iter::once(None).chain(views).map(row).collect()
}

fn empty_row(acquisition: &Acquisition, stretch: &AlignedStretch, view: Option<usize>) -> LayLengthRow {
    let middle = stretch.first_line as f64 + (stretch.lines as f64 - 1.0) / 2.0;
    LayLengthRow {
        view,
        first_line: stretch.first_line,
        last_line: stretch.first_line + stretch.lines - 1,
        position_m: acquisition.start_m + middle * acquisition.line_pitch_mm / 1000.0,
        wires: vec![WireEstimate::default(); acquisition.rope.strands()],
        ..LayLengthRow::default()
    }
}

fn filled(row: LayLengthRow, estimates: &Estimates) -> LayLengthRow {
    let (estimate, diameter): (Option<&StretchEstimate>, Option<WithSd>) = match row.view {
        None => (Some(&estimates.fused), estimates.diameters.mean),
        Some(v) => (estimates.views.get(v), estimates.diameters.views.get(v).copied().flatten()),
    };
    let (spread, ovality) = match row.view {
        None => (estimates.strand_spread_rad, estimates.diameters.ovality_percent),
        Some(_) => (None, None), // both take more than one view
    };
    let strand = estimate.and_then(|e| e.strand);
    let wire = |j: usize| estimate.and_then(|e| e.wires.get(j).copied().flatten());
    let wires: Vec<WireEstimate> =
        (0..row.wires.len()).map(|j| wire(j).map(wire_estimate).unwrap_or_default()).collect();
    let missing_wires = wires.iter().filter(|w| w.lay_mm.is_none()).count();
    let mut reasons = Vec::new();
    match (strand, missing_wires) {
        (None, _) => reasons.push("the strands were not seen well enough here".to_owned()),
        (Some(_), 0) => {}
        (Some(_), n) => reasons.push(format!("the wires of {n} strands were not seen well enough here")),
    }
    if diameter.is_none() {
        reasons.push("too few lines show both edges of the rope for a diameter".to_owned());
    } else if row.view.is_none() && ovality.is_none() && estimates.diameters.views.iter().any(Option::is_none) {
        reasons.push("the views that show both edges look in one direction only, which gives no ovality".to_owned());
    }
    LayLengthRow {
        strand_lay_mm: strand.map(|s| s.lay_mm),
        strand_lay_sd_mm: strand.map(|s| s.lay_sd_mm),
        strand_phase_rad: strand.map(|s| s.phase_rad),
        strand_phase_sd_rad: strand.map(|s| s.phase_sd_rad),
        strand_score: strand.map(|s| s.score),
        strand_spread_rad: spread.map(|s| s.value),
        strand_spread_sd_rad: spread.map(|s| s.sd),
        diameter_mm: diameter.map(|d| d.value),
        diameter_sd_mm: diameter.map(|d| d.sd),
        ovality_percent: ovality.map(|o| o.value),
        ovality_sd_percent: ovality.map(|o| o.sd),
        wires,
        reason: (!reasons.is_empty()).then(|| reasons.join("; ")),
        ..row
    }
}

fn wire_estimate(wire: LayEstimate) -> WireEstimate {
    WireEstimate {
        lay_mm: Some(wire.lay_mm),
        lay_sd_mm: Some(wire.lay_sd_mm),
        phase_rad: Some(wire.phase_rad),
        phase_sd_rad: Some(wire.phase_sd_rad),
        score: Some(wire.score),
    }
}

/// Names of the columns of a rope of so many strands.
pub fn columns(strands: usize) -> Vec<String> {
    let mut names: Vec<String> = [
        "view",
        "first_line",
        "last_line",
        "position_m",
        "strand_lay_mm",
        "strand_lay_sd_mm",
        "strand_phase_rad",
        "strand_score",
    ]
    .map(str::to_owned)
    .into();
    for j in 0..strands {
        names.extend(["lay_{j}_mm", "lay_{j}_sd_mm", "phase_{j}_rad", "score_{j}"].map(|name| wire_column(name, j)));
    }
    let more = [
        "diameter_mm",
        "diameter_sd_mm",
        "diameter_quality",
        "ovality_percent",
        "ovality_sd_percent",
        "strand_phase_sd_rad",
        "strand_spread_rad",
        "strand_spread_sd_rad",
        "strand_quality",
    ];
    names.extend(more.map(str::to_owned));
    for j in 0..strands {
        names.extend(["phase_{j}_sd_rad", "quality_{j}"].map(|name| wire_column(name, j)));
    }
    names.push("reason".to_owned());
    names
}

fn wire_column(name: &str, j: usize) -> String {
    format!("wire_{}", name.replace("{j}", &j.to_string()))
}

/// The cells of a row, in the order of [`columns`]. `number` writes a number with that many digits, or as it likes.
pub fn cells(row: &LayLengthRow, strands: usize, number: impl Fn(f64, usize) -> String) -> Vec<String> {
    let cell = |value: Option<f64>, digits| value.map_or(String::new(), |v| number(v, digits));
    let quality = |quality: Option<Quality>| quality.map_or(String::new(), |q| q.name().to_owned());
    let wire = |j: usize| row.wires.get(j).copied().unwrap_or_default();
    let mut cells = vec![
        row.view.map_or(String::new(), |v| v.to_string()),
        row.first_line.to_string(),
        row.last_line.to_string(),
        number(row.position_m, 5),
        cell(row.strand_lay_mm, 4),
        cell(row.strand_lay_sd_mm, 4),
        cell(row.strand_phase_rad, 5),
        cell(row.strand_score, 4),
    ];
    for wire in (0..strands).map(wire) {
        cells.extend([wire.lay_mm, wire.lay_sd_mm].map(|mm| cell(mm, 4)));
        cells.extend([cell(wire.phase_rad, 5), cell(wire.score, 4)]);
    }
    cells.extend([cell(row.diameter_mm, 3), cell(row.diameter_sd_mm, 4), quality(row.diameter_quality())]);
    cells.extend([cell(row.ovality_percent, 4), cell(row.ovality_sd_percent, 4)]);
    cells.extend([row.strand_phase_sd_rad, row.strand_spread_rad, row.strand_spread_sd_rad].map(|rad| cell(rad, 6)));
    cells.push(quality(row.strand_quality()));
    for wire in (0..strands).map(wire) {
        cells.extend([cell(wire.phase_sd_rad, 6), quality(wire.quality())]);
    }
    cells.push(row.reason.clone().unwrap_or_default());
    cells
}

/// The file.
pub struct LayLengthTable {
    path: PathBuf,
    strands: usize,
    writer: csv::Writer<File>,
}

impl LayLengthTable {
    /// Creates the file with its header.
    pub fn create(path: PathBuf, strands: usize) -> Result<Self, PipelineError> {
        let file = File::create(&path).map_err(write_error(&path))?;
        let mut writer = csv::Writer::from_writer(file);
        writer.write_record(columns(strands)).map_err(|e| write_error(&path)(e.into()))?;
        Ok(Self { path, strands, writer })
    }

    /// Writes a row.
    pub fn write(&mut self, row: &LayLengthRow) -> Result<(), PipelineError> {
        let record = cells(row, self.strands, |value, digits| format!("{value:.digits$}"));
        self.writer.write_record(record).map_err(|e| write_error(&self.path)(e.into()))
    }

    /// Flushes; every row is in the file afterwards.
    pub fn finish(mut self) -> Result<(), PipelineError> {
        self.writer.flush().map_err(write_error(&self.path))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_column_has_its_cell_and_what_is_absent_is_empty() {
        let wire = WireEstimate { lay_mm: Some(-95.0), lay_sd_mm: Some(0.3), ..WireEstimate::default() };
        let row = LayLengthRow {
            strand_lay_mm: Some(220.0),
            strand_lay_sd_mm: Some(0.2),
            diameter_mm: Some(31.9),
            diameter_sd_mm: Some(0.05),
            wires: vec![wire, WireEstimate::default()],
            reason: Some("too dark".into()),
            ..LayLengthRow::default()
        };
        let (names, cells) = (columns(2), cells(&row, 2, |value, digits| format!("{value:.digits$}")));
        assert_eq!(names.len(), cells.len());
        let cell = |name: &str| &cells[names.iter().position(|n| n == name).unwrap()][..];
        assert_eq!((cell("view"), cell("strand_lay_mm"), cell("strand_quality")), ("", "220.0000", "good"));
        assert_eq!((cell("wire_lay_0_mm"), cell("wire_quality_0")), ("-95.0000", "uncertain"));
        assert_eq!((cell("wire_lay_1_mm"), cell("wire_quality_1")), ("", ""));
        assert_eq!((cell("diameter_mm"), cell("diameter_quality"), cell("reason")), ("31.900", "good", "too dark"));
        assert_eq!(names.last().unwrap(), "reason");
    }
}
