//! Whether standard deviations keep their word: how often the truth lies within one and within 1.96 of them, quantity by quantity.
//!
//! Phases are compared less what they have in common over the acquisition (the median of a view): where on the circle a rope begins
//! is a convention. Strands are interchangeable, and so are the wires of a strand. Diameters without a calibrated scale are compared less their
//! common factor, and ovality not at all.

use super::lay_lengths::percentile;
use super::shape::Shape;
use super::table::{EvaluateError, Table};
use super::truth::{RecordingFile, Truth, regression_lay_mm};
use serde::Serialize;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::Path;

/// Standard deviations within which 95 % of a normal distribution lie.
const SDS_OF_95_PERCENT: f64 = 1.96;

/// How one quantity keeps to its intervals.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Interval {
    /// Such as `fused, strand lay`.
    pub quantity: String,
    /// Unit of the two values below.
    pub unit: &'static str,
    /// Number of estimates with a standard deviation and a truth.
    pub n: usize,
    /// Mean of |error|.
    pub mean_abs: f64,
    /// Median of the stated standard deviations.
    pub median_sd: f64,
    /// Share of the truth within one standard deviation; 0.68 is right.
    pub within_68: f64,
    /// Share of the truth within 1.96 of them; 0.95 is right.
    pub within_95: f64,
}

/// An error and the deviation that was stated for it.
#[derive(Debug, Clone, Copy)]
struct Stated {
    error: f64,
    sd: f64,
}

/// What is gathered of a quantity: (estimate, truth, sd) of every row.
#[derive(Default)]
struct Gathered {
    points: Vec<(f64, f64, f64)>,
}

impl Gathered {
    fn add(&mut self, estimate: Option<f64>, truth: Option<f64>, sd: Option<f64>) {
        if let (Some(estimate), Some(truth), Some(sd)) = (estimate, truth, sd)
            && truth.is_finite()
        {
            self.points.push((estimate, truth, sd));
        }
    }

    fn as_they_are(&self) -> Vec<Stated> {
        self.points.iter().map(|&(estimate, truth, sd)| Stated { error: estimate - truth, sd }).collect()
    }

    /// Less the circular mean and the median that all have in common, modulo `step`.
    fn less_common_angle(&self, step: f64) -> Vec<Stated> {
        let turn = |(estimate, truth, _): &(f64, f64, f64)| (estimate - truth) / step * TAU;
        let (sin, cos) = self.points.iter().map(turn).fold((0.0, 0.0), |(s, c), a| (s + a.sin(), c + a.cos()));
        let common = f64::atan2(sin, cos) / TAU * step;
        let off = |(estimate, truth, _): &(f64, f64, f64)| {
            (estimate - truth - common + step / 2.0).rem_euclid(step) - step / 2.0
        };
        let mut sorted: Vec<f64> = self.points.iter().map(off).collect();
        sorted.sort_by(f64::total_cmp);
        let median = if sorted.is_empty() { 0.0 } else { percentile(&sorted, 50.0) };
        self.points.iter().map(|point| Stated { error: off(point) - median, sd: point.2 }).collect()
    }

    /// Less the factor that all have in common.
    fn less_common_factor(&self) -> Vec<Stated> {
        let (estimates, truths) = self.points.iter().fold((0.0, 0.0), |(e, t), point| (e + point.0, t + point.1));
        let factor = truths / estimates;
        self.points.iter().map(|&(e, t, sd)| Stated { error: e * factor - t, sd: sd * factor }).collect()
    }
}

/// The quantities in the order in which they are told.
const QUANTITIES: [(&str, &str); 7] = [
    ("strand lay", "mm"),
    ("wire lay", "mm"),
    ("strand phase", "rad"),
    ("wire phase", "rad"),
    ("diameter", "mm"),
    ("ovality", "%"),
    ("looseness", "rad"),
];

/// Scores every quantity of `RESULTS/lay_lengths.csv` that has a standard deviation and a truth.
pub fn score(
    truth: &Truth,
    rope: &RecordingFile,
    recording: &Path,
    results: &Path,
) -> Result<Vec<Interval>, EvaluateError> {
    let Some(mut table) = Table::open(&results.join("lay_lengths.csv"))? else { return Ok(Vec::new()) };
    let shape = Shape::read(recording, rope)?;
    // By quantity and view (-1: fused): what is in common is that of a view.
    let mut gathered: BTreeMap<(usize, i64), Gathered> = BTreeMap::new();
    let columns = Columns::of(&table, rope.strands)?;
    while table.next_row()? {
        let Some(row) = columns.read(&table, truth)? else { continue };
        let view = row.view.map_or(-1, |v| v as i64);
        let mut add = |quantity: usize, estimate, truth, sd| {
            gathered.entry((quantity, view)).or_default().add(estimate, truth, sd);
        };
        let lines = row.first_line..row.last_line + 1;
        let points = lines.clone().map(|l| (l as f64 * rope.line_pitch_mm, truth.phase_rad[l]));
        let abs = |x: Option<f64>| x.map(f64::abs);
        add(0, abs(row.strand_lay.0), abs(regression_lay_mm(points)), row.strand_lay.1);
        add(4, row.diameter.0, shape.diameter_mm(lines.clone(), row.view), row.diameter.1);
        add(6, row.spread.0, shape.spread_rad(&lines), row.spread.1);
        if rope.is_calibrated() {
            add(5, row.ovality.0, shape.ovality_percent(), row.ovality.1);
        }
        let (Some(phase), Some(true_wires)) = (row.phase.0, &truth.wires) else { continue };
        let step = TAU / rope.strands as f64;
        let true_phase = truth.phase_rad[(row.first_line + row.last_line) / 2];
        let turned = ((phase - true_phase) / step).round_ties_even();
        add(2, Some(phase - turned * step), Some(true_phase), row.phase.1);
        let from = true_wires.lines.partition_point(|&l| l < row.first_line as f64);
        let to = true_wires.lines.partition_point(|&l| l <= row.last_line as f64);
        let middle = true_wires.lines.partition_point(|&l| l < (row.first_line + row.last_line) as f64 / 2.0);
        for (j, wire) in row.wires.iter().enumerate() {
            let same = (turned as i64 + j as i64).rem_euclid(rope.strands as i64) as usize;
            let phases = &true_wires.phase_rad[same];
            let lines = true_wires.lines[from..to].iter().map(|l| l * rope.line_pitch_mm);
            let lay = regression_lay_mm(lines.zip(phases[from..to].iter().copied()));
            add(1, abs(wire.lay.0), abs(lay), wire.lay.1);
            add(3, wire.phase.0, at_middle(true_wires, phases, middle, &row), wire.phase.1);
        }
    }
    Ok(told(&gathered, rope))
}

/// True phase at the middle line, between the rows of the truth.
fn at_middle(wires: &super::truth::TrueWires, phases: &[f64], after: usize, row: &Row) -> Option<f64> {
    let before = after.checked_sub(1)?;
    let (a, b) = (*wires.lines.get(before)?, *wires.lines.get(after)?);
    let share = ((row.first_line + row.last_line) as f64 / 2.0 - a) / (b - a);
    Some(phases[before] + share * (phases[after] - phases[before]))
}

fn told(gathered: &BTreeMap<(usize, i64), Gathered>, rope: &RecordingFile) -> Vec<Interval> {
    let mut intervals = Vec::new();
    for (which, views) in [("fused", -1..=-1), ("views", 0..=i64::MAX)] {
        for (quantity, (name, unit)) in QUANTITIES.into_iter().enumerate() {
            let stated: Vec<Stated> = gathered
                .range((quantity, *views.start())..=(quantity, *views.end()))
                .flat_map(|(_, gathered)| match name {
                    "strand phase" => gathered.less_common_angle(TAU / rope.strands as f64),
                    "wire phase" => gathered.less_common_angle(TAU / rope.wires_per_strand.unwrap_or(1) as f64),
                    "diameter" if !rope.is_calibrated() => gathered.less_common_factor(),
                    _ => gathered.as_they_are(),
                })
                .collect();
            if stated.is_empty() {
                continue;
            }
            let n = stated.len() as f64;
            let within = |sds: f64| stated.iter().filter(|s| s.error.abs() <= sds * s.sd).count() as f64 / n;
            let mut sds: Vec<f64> = stated.iter().map(|s| s.sd).collect();
            sds.sort_by(f64::total_cmp);
            intervals.push(Interval {
                quantity: format!("{which}, {name}"),
                unit,
                n: stated.len(),
                mean_abs: stated.iter().map(|s| s.error.abs()).sum::<f64>() / n,
                median_sd: percentile(&sds, 50.0),
                within_68: within(1.0),
                within_95: within(SDS_OF_95_PERCENT),
            });
        }
    }
    intervals
}

/// An estimate and its standard deviation.
type Pair = (Option<f64>, Option<f64>);

struct WireRow {
    lay: Pair,
    phase: Pair,
}

struct Row {
    view: Option<usize>,
    first_line: usize,
    last_line: usize,
    strand_lay: Pair,
    phase: Pair,
    diameter: Pair,
    ovality: Pair,
    spread: Pair,
    wires: Vec<WireRow>,
}

/// Where the columns are, by estimate and standard deviation; absent ones give nothing.
struct Columns {
    view: usize,
    lines: (usize, usize),
    pairs: [(Option<usize>, Option<usize>); 5],
    wires: Vec<[(Option<usize>, Option<usize>); 2]>,
}

impl Columns {
    fn of(table: &Table, strands: usize) -> Result<Self, EvaluateError> {
        let pair = |estimate: &str, sd: &str| (table.find(estimate), table.find(sd));
        let wire = |j: usize| {
            [
                pair(&format!("wire_lay_{j}_mm"), &format!("wire_lay_{j}_sd_mm")),
                pair(&format!("wire_phase_{j}_rad"), &format!("wire_phase_{j}_sd_rad")),
            ]
        };
        Ok(Self {
            view: table.column("view")?,
            lines: (table.column("first_line")?, table.column("last_line")?),
            pairs: [
                pair("strand_lay_mm", "strand_lay_sd_mm"),
                pair("strand_phase_rad", "strand_phase_sd_rad"),
                pair("diameter_mm", "diameter_sd_mm"),
                pair("ovality_percent", "ovality_sd_percent"),
                pair("strand_spread_rad", "strand_spread_sd_rad"),
            ],
            wires: (0..strands).map(wire).collect(),
        })
    }

    /// The row that the table stands at; `None` beyond the truth.
    fn read(&self, table: &Table, truth: &Truth) -> Result<Option<Row>, EvaluateError> {
        let first_line = table.index(self.lines.0)?;
        if first_line >= truth.phase_rad.len() {
            return Ok(None);
        }
        let number = |column: Option<usize>| column.and_then(|column| table.number(column));
        let pair = |(estimate, sd): (Option<usize>, Option<usize>)| (number(estimate), number(sd));
        let [strand_lay, phase, diameter, ovality, spread] = self.pairs.map(pair);
        Ok(Some(Row {
            view: table.number(self.view).map(|v| v as usize),
            first_line,
            last_line: table.index(self.lines.1)?.min(truth.phase_rad.len() - 1),
            strand_lay,
            phase,
            diameter,
            ovality,
            spread,
            wires: self.wires.iter().map(|&[lay, phase]| WireRow { lay: pair(lay), phase: pair(phase) }).collect(),
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_phases_have_in_common_does_not_count_and_wires_are_interchangeable() {
        let mut gathered = Gathered::default();
        for (k, error) in [0.01, -0.02, 0.0, 0.03, -0.01].into_iter().enumerate() {
            let step = TAU / 9.0;
            gathered.add(Some(5.0 + 0.6 + error + k as f64 * step), Some(5.0), Some(0.02));
        }
        let stated = gathered.less_common_angle(TAU / 9.0);
        for (stated, error) in stated.iter().zip([0.01, -0.02, 0.0, 0.03, -0.01]) {
            assert!((stated.error - error).abs() < 1e-9, "{} {error}", stated.error);
        }
    }

    #[test]
    fn a_common_scale_does_not_count() {
        let mut gathered = Gathered::default();
        gathered.add(Some(31.0), Some(32.0), Some(0.1));
        gathered.add(Some(15.5), Some(16.0), Some(0.1));
        assert!(gathered.less_common_factor().iter().all(|stated| stated.error.abs() < 1e-9));
        assert!(gathered.as_they_are()[0].error < -0.9);
    }
}
