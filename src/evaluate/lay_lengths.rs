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

#[derive(Default)]
struct Gathered {
    rows: usize,
    strand_missing: usize,
    wire_missing: usize,
    strand_mm: Vec<f64>,
    wire_mm: Vec<f64>,
    phase_rad: Vec<f64>,
}

impl Gathered {
    fn finish(self) -> Option<StretchErrors> {
        (self.rows > 0).then(|| StretchErrors {
            rows: self.rows,
            strand_not_estimated: self.strand_missing,
            wire_not_estimated: self.wire_missing,
            strand_mm: ErrorStatistics::of(&self.strand_mm),
            wire_mm: ErrorStatistics::of(&self.wire_mm),
            strand_phase_rad: ErrorStatistics::of(&self.phase_rad),
        })
    }
}

/// Scores `RESULTS/lay_lengths.csv`.
pub fn score(
    truth: Option<&Truth>,
    strands: usize,
    line_pitch_mm: f64,
    results: &Path,
) -> Result<LayLengthErrors, EvaluateError> {
    let table = Table::open(&results.join("lay_lengths.csv"))?;
    let (Some(truth), Some(mut table)) = (truth, table) else {
        return Ok(LayLengthErrors { missing: true, ..LayLengthErrors::default() });
    };
    let view = table.column("view")?;
    let (first, last) = (table.column("first_line")?, table.column("last_line")?);
    let (lay, phase) = (table.column("strand_lay_mm")?, table.column("strand_phase_rad")?);
    let wires: Vec<_> = (0..strands).map(|j| table.find(&format!("wire_lay_{j}_mm"))).collect();
    let (mut fused, mut per_view) = (Gathered::default(), Gathered::default());
    while table.next_row()? {
        let gathered = if table.number(view).is_none() { &mut fused } else { &mut per_view };
        let first_line = table.index(first)?;
        if first_line >= truth.phase_rad.len() {
            continue;
        }
        let last_line = table.index(last)?.min(truth.phase_rad.len() - 1);
        gathered.rows += 1;
        let Some(strand_lay_mm) = table.number(lay) else {
            gathered.strand_missing += 1;
            continue;
        };
        let stretch = first_line..last_line + 1;
        let points = stretch.clone().map(|l| (l as f64 * line_pitch_mm, truth.phase_rad[l]));
        if let Some(true_mm) = regression_lay_mm(points) {
            gathered.strand_mm.push(strand_lay_mm.abs() - true_mm.abs());
        }
        let Some(strand_phase_rad) = table.number(phase) else {
            gathered.wire_missing += wires.iter().flatten().count(); // which strand is which is unknown
            continue;
        };
        let off = (strand_phase_rad - truth.phase_rad[(first_line + last_line) / 2]) * strands as f64 / TAU;
        let turned = off.round_ties_even();
        gathered.phase_rad.push((off - turned) * TAU / strands as f64);
        let Some(true_wires) = &truth.wires else { continue };
        let from = true_wires.lines.partition_point(|&l| l < first_line as f64);
        let to = true_wires.lines.partition_point(|&l| l <= last_line as f64);
        for (j, column) in wires.iter().enumerate() {
            let Some(column) = column else { continue };
            let Some(wire_lay_mm) = table.number(*column) else {
                gathered.wire_missing += 1;
                continue;
            };
            let same = (turned as i64 + j as i64).rem_euclid(strands as i64) as usize;
            let lines = true_wires.lines[from..to].iter().map(|l| l * line_pitch_mm);
            if let Some(true_mm) = regression_lay_mm(lines.zip(true_wires.phase_rad[same][from..to].iter().copied())) {
                gathered.wire_mm.push(wire_lay_mm.abs() - true_mm.abs());
            }
        }
    }
    Ok(LayLengthErrors { missing: false, fused: fused.finish(), per_view: per_view.finish() })
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
