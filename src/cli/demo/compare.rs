//! What the service found against what is true, as tables for people.

use anyhow::Context;
use ropescope::evaluate::truth::{self, regression_lay_mm};
use ropescope::simulate::Label;
use serde_json::Value;
use std::f64::consts::TAU;
use std::fmt::Write;
use std::path::Path;

/// Length of a row of the table of lay lengths in m.
const ROW_M: f64 = 0.5;
/// How far a found defect may lie from a planted one in m.
const NEAR_M: f64 = 0.02;

/// What is true of a simulated acquisition.
pub(super) struct Truth {
    /// Rope per line in m.
    pub(super) pitch_m: f64,
    /// Number of lines.
    pub(super) lines: usize,
    /// Number of views.
    pub(super) views: usize,
    /// What an expert would mark.
    pub(super) labels: Vec<Label>,
    /// Phases of strands and wires.
    phases: truth::Truth,
}

/// A planted defect over all views.
pub(super) struct Planted {
    /// Its number.
    pub(super) id: usize,
    /// Its kind.
    kind: String,
    /// How bad it is, 0.15 to 1.
    severity: f64,
    /// Rope metres.
    pub(super) from_m: f64,
    /// Rope metres.
    pub(super) to_m: f64,
    /// Would every inspector mark it in at least one view?
    clear: bool,
}

impl Truth {
    /// Reads the tables beside the frames.
    pub(super) fn read(folder: &Path) -> anyhow::Result<Self> {
        let rope: Value = serde_json::from_slice(&std::fs::read(folder.join("rope.json"))?)?;
        let labels = serde_json::from_slice(&std::fs::read(folder.join("labels.json"))?).context("labels.json")?;
        let strands = rope["strands"].as_u64().context("rope.json says no strands")? as usize;
        let phases = truth::Truth::read(folder, strands)?.context("there is no truth_lines.csv")?;
        Ok(Self {
            pitch_m: rope["line_pitch_mm"].as_f64().unwrap_or(0.1) / 1000.0,
            lines: phases.phase_rad.len(),
            views: rope["views"].as_array().map_or(1, Vec::len),
            labels,
            phases,
        })
    }

    /// The planted defects along the rope.
    pub(super) fn planted(&self) -> Vec<Planted> {
        let mut planted: Vec<Planted> = Vec::new();
        for label in &self.labels {
            let (from_m, to_m) = (label.first_line as f64 * self.pitch_m, (label.last_line + 1) as f64 * self.pitch_m);
            match planted.iter_mut().find(|p| p.id == label.defect) {
                Some(p) => {
                    (p.from_m, p.to_m) = (p.from_m.min(from_m), p.to_m.max(to_m));
                    p.clear |= label.clear;
                }
                None => planted.push(Planted {
                    id: label.defect,
                    kind: label.kind.replace('_', " "),
                    severity: label.severity,
                    from_m,
                    to_m,
                    clear: label.clear,
                }),
            }
        }
        planted.sort_by(|a, b| a.from_m.total_cmp(&b.from_m));
        planted
    }

    /// True strand lay over some lines, as `evaluate` defines it.
    fn strand_mm(&self, first: usize, last: usize) -> Option<f64> {
        let phases = self.phases.phase_rad.get(first..=last)?.iter();
        regression_lay_mm(phases.enumerate().map(|(k, &phase)| (k as f64 * self.pitch_m * 1000.0, phase)))
    }

    /// True wire lay of a strand over some lines.
    fn wire_mm(&self, strand: usize, first: usize, last: usize) -> Option<f64> {
        let wires = self.phases.wires.as_ref()?;
        let known = wires.lines.iter().zip(wires.phase_rad.get(strand)?);
        let here = known.filter(|(line, _)| (first as f64..=last as f64).contains(*line));
        regression_lay_mm(here.map(|(&line, &phase)| (line * self.pitch_m * 1000.0, phase)))
    }
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, n) = values.fold((0.0, 0), |(sum, n), v| (sum + v, n + 1));
    (n > 0).then(|| sum / f64::from(n))
}

/// Sums of a row of the table.
#[derive(Default, Clone)]
struct Sums {
    strand_mm: Vec<f64>,
    strand_true_mm: Vec<f64>,
    strand_error_mm: Vec<f64>,
    wire_mm: Vec<f64>,
    wire_true_mm: Vec<f64>,
    wire_error_mm: Vec<f64>,
    gaps: usize,
}

impl Sums {
    fn line(&self, name: &str) -> String {
        let of = |values: &[f64], digits: usize| {
            mean(values.iter().copied()).map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"))
        };
        format!(
            "  {name:<12} {:>9} {:>9} {:>8}  {:>9} {:>9} {:>8}  {:>6}\n",
            of(&self.strand_mm, 2),
            of(&self.strand_true_mm, 2),
            of(&self.strand_error_mm, 3),
            of(&self.wire_mm, 2),
            of(&self.wire_true_mm, 2),
            of(&self.wire_error_mm, 3),
            self.gaps
        )
    }

    fn add(&mut self, other: &Self) {
        self.strand_mm.extend(&other.strand_mm);
        self.strand_true_mm.extend(&other.strand_true_mm);
        self.strand_error_mm.extend(&other.strand_error_mm);
        self.wire_mm.extend(&other.wire_mm);
        self.wire_true_mm.extend(&other.wire_true_mm);
        self.wire_error_mm.extend(&other.wire_error_mm);
        self.gaps += other.gaps;
    }
}

/// Half a metre a row: means over the estimates in it, and the mean absolute error of single estimates.
pub(super) fn lay_lengths(truth: &Truth, answer: &Value) -> String {
    let metres = truth.lines as f64 * truth.pitch_m;
    let mut rows = vec![Sums::default(); (metres / ROW_M).ceil().max(1.0) as usize];
    for row in answer["rows"].as_array().map(Vec::as_slice).unwrap_or_default() {
        let place = (row["position_m"].as_f64().unwrap_or(0.0) / ROW_M) as usize;
        let last = rows.len() - 1;
        add_row(truth, row, &mut rows[place.min(last)]);
    }
    let mut table = format!(
        "  {:<12} {:>9} {:>9} {:>8}  {:>9} {:>9} {:>8}  {:>6}\n",
        "metres", "strand", "true", "|error|", "wires", "true", "|error|", "gaps"
    );
    let mut all = Sums::default();
    for (n, row) in rows.iter().enumerate() {
        table += &row.line(&format!("{:.1} .. {:.1}", n as f64 * ROW_M, ((n + 1) as f64 * ROW_M).min(metres)));
        all.add(row);
    }
    table + &all.line("all")
}

fn add_row(truth: &Truth, row: &Value, sums: &mut Sums) {
    let line = |key: &str| row[key].as_u64().unwrap_or(0) as usize;
    let (first, last) = (line("first_line"), line("last_line").min(truth.lines.saturating_sub(1)));
    match (row["strand_lay_mm"].as_f64(), truth.strand_mm(first, last)) {
        (Some(lay_mm), Some(true_mm)) => {
            sums.strand_mm.push(lay_mm);
            sums.strand_true_mm.push(true_mm);
            sums.strand_error_mm.push((lay_mm - true_mm).abs());
        }
        _ => sums.gaps += 1,
    }
    let wires = row["wires"].as_array().map(Vec::as_slice).unwrap_or_default();
    let Some(phase_rad) = row["strand_phase_rad"].as_f64() else { return };
    // Which true strand is the service's strand 0: nobody painted numbers on the rope.
    let step_rad = TAU / wires.len().max(1) as f64;
    let true_rad = truth.phases.phase_rad.get((first + last) / 2).copied().unwrap_or(0.0);
    let turn = ((phase_rad - true_rad) / step_rad).round() as i64;
    for (j, wire) in wires.iter().enumerate() {
        let strand = (j as i64 + turn).rem_euclid(wires.len() as i64) as usize;
        match (wire["lay_mm"].as_f64(), truth.wire_mm(strand, first, last)) {
            (Some(lay_mm), Some(true_mm)) => {
                sums.wire_mm.push(lay_mm);
                sums.wire_true_mm.push(true_mm);
                sums.wire_error_mm.push((lay_mm - true_mm).abs());
            }
            _ => sums.gaps += 1,
        }
    }
}

/// Every planted defect with what was found there, then what was found where nothing was planted.
pub(super) fn defects(truth: &Truth, found: &Value) -> String {
    let found = found["items"].as_array().map(Vec::as_slice).unwrap_or_default();
    let range = |d: &Value| (d["from_m"].as_f64().unwrap_or(0.0), d["to_m"].as_f64().unwrap_or(0.0));
    let planted = truth.planted();
    let mut table = format!(
        "  {:<20} {:<13} {:>8}  {:<20} {:>6} {:>10}\n",
        "planted at m", "kind", "severity", "found at m", "peak", "strand/wire"
    );
    let mut hits = 0;
    let near = |p: &Planted, d: &Value| range(d).0 <= p.to_m + NEAR_M && range(d).1 >= p.from_m - NEAR_M;
    for p in &planted {
        let best = found.iter().filter(|d| near(p, d)).max_by(|a, b| peak(a).total_cmp(&peak(b)));
        let planted_at = format!("{:.3} .. {:.3}", p.from_m, p.to_m);
        let faint = if p.clear { "" } else { " (faint)" };
        let (at, score, wire) = match best {
            Some(d) => {
                hits += 1;
                let (from_m, to_m) = range(d);
                (
                    format!("{from_m:.3} .. {to_m:.3}"),
                    format!("{:.1}", peak(d)),
                    format!("{}/{}", d["strand"], d["wire"]),
                )
            }
            None => (format!("not found{faint}"), "-".into(), "-".into()),
        };
        let _ =
            writeln!(table, "  {planted_at:<20} {:<13} {:>8.2}  {at:<20} {score:>6} {wire:>10}", p.kind, p.severity);
    }
    let others: Vec<&Value> = found.iter().filter(|d| !planted.iter().any(|p| near(p, d))).collect();
    for d in &others {
        let (from_m, to_m) = range(d);
        let _ = writeln!(
            table,
            "  {:<20} {:<13} {:>8}  {from_m:.3} .. {to_m:.3}     {:>6.1}",
            "-",
            "nothing",
            "-",
            peak(d)
        );
    }
    let _ = writeln!(
        table,
        "\n  {hits} of {} planted defects found, {} where nothing was planted",
        planted.len(),
        others.len()
    );
    table
}

fn peak(defect: &Value) -> f64 {
    defect["peak_score"].as_f64().unwrap_or(0.0)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use ropescope::simulate::{Recipe, Scene, write_acquisition};
    use serde_json::json;

    /// A short simulated rope with two defects.
    pub(in crate::cli::demo) fn truth() -> (tempfile::TempDir, Truth) {
        let folder = tempfile::tempdir().unwrap();
        let recipe = Recipe { metres: 0.4, defects: 2, view_angles_deg: vec![0.0, 180.0], ..Recipe::photographic() };
        write_acquisition(&Scene::new(&recipe, 5).unwrap(), folder.path(), |_| {}).unwrap();
        let truth = Truth::read(folder.path()).unwrap();
        (folder, truth)
    }

    /// What a service would say that finds the first planted defect, and one that is none.
    pub(in crate::cli::demo) fn found(truth: &Truth) -> Value {
        let label = &truth.labels[0];
        let p = truth.planted().into_iter().find(|p| p.id == label.defect).unwrap();
        let alarm = json!({"view": label.view, "first_line": label.first_line, "last_line": label.last_line,
            "first_column": label.first_column, "last_column": label.last_column, "peak_score": 9.5});
        json!({"items": [
            {"from_m": p.from_m, "to_m": p.to_m, "strand": label.strand, "wire": label.wire, "peak_score": 9.5, "alarms": [alarm]},
            {"from_m": 9.0, "to_m": 9.1, "strand": null, "wire": null, "peak_score": 4.0, "alarms": []},
        ]})
    }

    #[test]
    fn found_defects_are_held_against_planted_ones() {
        let (_folder, truth) = truth();
        let table = defects(&truth, &found(&truth));
        assert!(table.contains("1 of 2 planted defects found, 1 where nothing was planted"), "{table}");
        assert!(table.contains("9.000 .. 9.100"), "{table}");
    }

    #[test]
    fn estimates_that_are_true_have_no_error_whatever_strand_comes_first() {
        let (_folder, truth) = truth();
        let (first, last) = (0, 1999);
        let wires: Vec<Value> =
            (0..6).map(|j| json!({"lay_mm": truth.wire_mm((j + 2) % 6, first, last).unwrap()})).collect();
        let phase_rad = truth.phases.phase_rad[(first + last) / 2] + 2.0 * TAU / 6.0;
        let answer = json!({"rows": [{"first_line": first, "last_line": last, "position_m": 0.1, "wires": wires,
            "strand_lay_mm": truth.strand_mm(first, last).unwrap(), "strand_phase_rad": phase_rad}]});
        let table = lay_lengths(&truth, &answer);
        let all: Vec<&str> = table.lines().last().unwrap().split_whitespace().collect();
        assert_eq!((all[3], all[6], all[7]), ("0.000", "0.000", "0"), "{table}");
    }
}
