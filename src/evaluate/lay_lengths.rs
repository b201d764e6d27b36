//! Errors of the estimated lay lengths and phases, of the fused estimate and of the single views. [Wacker13, sec. 6.3.1]

use super::table::{EvaluateError, Table};
use super::truth::{Truth, regression_lay_mm};
use serde::Serialize;
use std::f64::consts::TAU;
use std::path::Path;

/// How large errors are.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ErrorStatistics {
    /// Number of estimates.
    pub n: usize,
    /// Mean of |error|.
    pub mean_abs: f64,
    /// Median of |error|.
    pub median_abs: f64,
    /// 95th percentile of |error|.
    pub p95_abs: f64,
    /// Mean of the error with its sign.
    pub bias: f64,
}

impl ErrorStatistics {
    /// Statistics of signed errors; `None` without any.
    pub fn of(errors: &[f64]) -> Option<Self> {
        if errors.is_empty() {
            return None;
        }
        let n = errors.len();
        let mut sizes: Vec<f64> = errors.iter().map(|e| e.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        Some(Self {
            n,
            mean_abs: sizes.iter().sum::<f64>() / n as f64,
            median_abs: percentile(&sizes, 50.0),
            p95_abs: percentile(&sizes, 95.0),
            bias: errors.iter().sum::<f64>() / n as f64,
        })
    }
}

/// Percentile of sorted values, linear between neighbours.
pub fn percentile(sorted: &[f64], percent: f64) -> f64 {
    let at = percent / 100.0 * (sorted.len() - 1) as f64;
    let below = at.floor() as usize;
    let above = (below + 1).min(sorted.len() - 1);
    if sorted[below] == sorted[above] {
        // also keeps infinities what they are
        return sorted[below];
    }
    sorted[below] + (sorted[above] - sorted[below]) * (at - below as f64)
}

/// Errors of one kind of estimate.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StretchErrors {
    /// Rows of the table.
    pub rows: usize,
    /// Rows without a strand lay length.
    pub strand_not_estimated: usize,
    /// Wire lay lengths that are absent in rows that have a strand lay length.
    pub wire_not_estimated: usize,
    /// |estimate| - |truth| of the strand lay length in mm.
    pub strand_mm: Option<ErrorStatistics>,
    /// The same of the wire lay lengths of all strands.
    pub wire_mm: Option<ErrorStatistics>,
    /// Error of the strand phase at the middle line in rad, strands being interchangeable.
    pub strand_phase_rad: Option<ErrorStatistics>,
}

/// Errors of `lay_lengths.csv`.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct LayLengthErrors {
    /// True if there is nothing to score: no table or no truth.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub missing: bool,
    /// The estimate over all views.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fused: Option<StretchErrors>,
    /// The estimates of single views.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub per_view: Option<StretchErrors>,
}

/// A lay length beside the true one, both as they are signed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredLay {
    /// The estimate in mm.
    pub estimate_mm: f64,
    /// The truth in mm: 2 pi over the regression slope of the true phase over the stretch.
    pub true_mm: f64,
}

impl MeasuredLay {
    /// |estimate| - |truth| in mm.
    pub fn error_mm(&self) -> f64 {
        self.estimate_mm.abs() - self.true_mm.abs()
    }
}

/// A row of `lay_lengths.csv` beside the truth.
#[derive(Debug, Clone, PartialEq)]
pub struct ScoredStretch {
    /// The view; `None` for all together.
    pub view: Option<usize>,
    /// First line.
    pub first_line: usize,
    /// Last line.
    pub last_line: usize,
    /// Strand lay, if there is an estimate and a truth.
    pub strand: Option<MeasuredLay>,
    /// Whether the row has a strand lay at all.
    pub strand_estimated: bool,
    /// Error of the strand phase at the middle line in rad, strands being interchangeable.
    pub phase_rad: Option<f64>,
    /// Wire lays, by the number of the strand in the truth.
    pub wires: Vec<Option<MeasuredLay>>,
    /// Wire lays that are absent although there is a strand lay.
    pub wires_absent: usize,
}

/// Every row of `RESULTS/lay_lengths.csv` within the truth; `None` without the file.
pub fn each_stretch(
    truth: &Truth,
    strands: usize,
    line_pitch_mm: f64,
    results: &Path,
) -> Result<Option<Vec<ScoredStretch>>, EvaluateError> {
    let Some(mut table) = Table::open(&results.join("lay_lengths.csv"))? else { return Ok(None) };
    let view = table.column("view")?;
    let (first, last) = (table.column("first_line")?, table.column("last_line")?);
    let (lay, phase) = (table.column("strand_lay_mm")?, table.column("strand_phase_rad")?);
    let wires: Vec<_> = (0..strands).map(|j| table.find(&format!("wire_lay_{j}_mm"))).collect();
    let mut rows = Vec::new();
    while table.next_row()? {
        let first_line = table.index(first)?;
        if first_line >= truth.phase_rad.len() {
            continue;
        }
        let last_line = table.index(last)?.min(truth.phase_rad.len() - 1);
        let mut row = ScoredStretch {
            view: table.number(view).map(|v| v as usize),
            first_line,
            last_line,
            strand: None,
            strand_estimated: false,
            phase_rad: None,
            wires: vec![None; strands],
            wires_absent: 0,
        };
        if let Some(estimate_mm) = table.number(lay) {
            row.strand_estimated = true;
            let points = (first_line..last_line + 1).map(|l| (l as f64 * line_pitch_mm, truth.phase_rad[l]));
            row.strand = regression_lay_mm(points).map(|true_mm| MeasuredLay { estimate_mm, true_mm });
            match table.number(phase) {
                Some(phase_rad) => {
                    let off = (phase_rad - truth.phase_rad[(first_line + last_line) / 2]) * strands as f64 / TAU;
                    let turned = off.round_ties_even();
                    row.phase_rad = Some((off - turned) * TAU / strands as f64);
                    let cells: Vec<_> = wires.iter().map(|column| column.map(|c| table.number(c))).collect();
                    compare_wires(&mut row, truth, &cells, turned as i64, line_pitch_mm);
                }
                None => row.wires_absent = wires.iter().flatten().count(), // which strand is which is unknown
            }
        }
        rows.push(row);
    }
    Ok(Some(rows))
}

/// Wire lays of a row (`None`: no such column) beside the truth of the strand that each belongs to.
fn compare_wires(row: &mut ScoredStretch, truth: &Truth, cells: &[Option<Option<f64>>], turned: i64, pitch_mm: f64) {
    let Some(true_wires) = &truth.wires else { return };
    let from = true_wires.lines.partition_point(|&l| l < row.first_line as f64);
    let to = true_wires.lines.partition_point(|&l| l <= row.last_line as f64);
    for (j, cell) in cells.iter().enumerate() {
        let Some(cell) = cell else { continue };
        let Some(estimate_mm) = *cell else {
            row.wires_absent += 1;
            continue;
        };
        let same = (turned + j as i64).rem_euclid(cells.len() as i64) as usize;
        let lines = true_wires.lines[from..to].iter().map(|l| l * pitch_mm);
        row.wires[same] = regression_lay_mm(lines.zip(true_wires.phase_rad[same][from..to].iter().copied()))
            .map(|true_mm| MeasuredLay { estimate_mm, true_mm });
    }
}

/// Errors of some rows together; `None` without rows.
pub fn summarise<'a>(rows: impl Iterator<Item = &'a ScoredStretch>) -> Option<StretchErrors> {
    let rows: Vec<_> = rows.collect();
    let errors = |of: &dyn Fn(&ScoredStretch) -> Vec<f64>| {
        ErrorStatistics::of(&rows.iter().flat_map(|row| of(row)).collect::<Vec<_>>())
    };
    (!rows.is_empty()).then(|| StretchErrors {
        rows: rows.len(),
        strand_not_estimated: rows.iter().filter(|r| !r.strand_estimated).count(),
        wire_not_estimated: rows.iter().map(|r| r.wires_absent).sum(),
        strand_mm: errors(&|r| r.strand.iter().map(MeasuredLay::error_mm).collect()),
        wire_mm: errors(&|r| r.wires.iter().flatten().map(MeasuredLay::error_mm).collect()),
        strand_phase_rad: errors(&|r| r.phase_rad.into_iter().collect()),
    })
}

/// Scores `RESULTS/lay_lengths.csv`.
pub fn score(
    truth: Option<&Truth>,
    strands: usize,
    line_pitch_mm: f64,
    results: &Path,
) -> Result<LayLengthErrors, EvaluateError> {
    let rows = match truth {
        Some(truth) => each_stretch(truth, strands, line_pitch_mm, results)?,
        None => None,
    };
    let Some(rows) = rows else { return Ok(LayLengthErrors { missing: true, ..LayLengthErrors::default() }) };
    Ok(LayLengthErrors {
        missing: false,
        fused: summarise(rows.iter().filter(|r| r.view.is_none())),
        per_view: summarise(rows.iter().filter(|r| r.view.is_some())),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_lie_between_neighbours() {
        assert_eq!(percentile(&[1.0, 2.0, 4.0], 50.0), 2.0);
        assert!((percentile(&[1.0, 2.0, 4.0], 95.0) - 3.8).abs() < 1e-12);
        let statistics = ErrorStatistics::of(&[-1.0, 3.0]).unwrap();
        assert_eq!((statistics.mean_abs, statistics.bias), (2.0, 1.0));
        assert_eq!(ErrorStatistics::of(&[]), None);
    }
}
