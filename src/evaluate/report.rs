//! Everything together: one structure that prints as JSON for scripts and as a table for people.

use super::defects::{self, Decisions};
use super::displacement::{self, DisplacementErrors};
use super::intervals::{self, Interval};
use super::labels::{classify, read_sightings};
use super::lay_lengths::{self, ErrorStatistics, LayLengthErrors, StretchErrors};
use super::line_scores::read_scores;
use super::roc::{self, Roc};
use super::table::EvaluateError;
use super::truth::{RecordingFile, Truth};
use serde::Serialize;
use std::fmt;
use std::path::Path;

/// How well defects were found; empty where results or labels are absent.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Detection {
    /// From `line_scores.csv`.
    #[serde(flatten)]
    pub roc: Option<Roc>,
    /// From `defects.json`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub decisions: Option<Decisions>,
}

/// The score of a results folder.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Evaluation {
    /// From `lay_lengths.csv`.
    pub lay_lengths: LayLengthErrors,
    /// How standard deviations keep their word; empty where none are stated.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub intervals: Vec<Interval>,
    /// From `displacement.csv`.
    pub displacement: DisplacementErrors,
    /// From `line_scores.csv` and `defects.json`.
    pub detection: Detection,
}

/// Scores a results folder against the truth beside a recording. Lines before `skip_lines` do not count for detection.
pub fn evaluate(recording: &Path, results: &Path, skip_lines: usize) -> Result<Evaluation, EvaluateError> {
    if !results.is_dir() {
        let source = std::io::Error::new(std::io::ErrorKind::NotFound, "no such results folder");
        return Err(EvaluateError::Read { path: results.into(), source });
    }
    let rope = RecordingFile::read(recording)?;
    let truth = Truth::read(recording, rope.strands)?;
    let lay_lengths = lay_lengths::score(truth.as_ref(), rope.strands, rope.line_pitch_mm, results)?;
    let intervals = match &truth {
        Some(truth) => intervals::score(truth, &rope, recording, results)?,
        None => Vec::new(),
    };
    let displacement = displacement::score(truth.as_ref(), results)?;
    let lines = rope.lines.or_else(|| truth.as_ref().map(|t| t.phase_rad.len()));
    drop(truth);
    let mut detection = Detection::default();
    if let Some(lines) = lines
        && recording.join("labels.json").exists()
    {
        let views = rope.views.len();
        let sightings = read_sightings(recording, lines, views, rope.line_pitch_mm)?;
        if let Some(scores) = read_scores(results, lines, views)? {
            let classes = classify(&sightings, lines, views, skip_lines);
            detection.roc = Some(roc::score(&scores, &sightings, &classes, skip_lines));
        }
        detection.decisions = defects::score(results, &sightings, lines, rope.line_pitch_mm, skip_lines)?;
    }
    Ok(Evaluation { lay_lengths, intervals, displacement, detection })
}

fn row(f: &mut fmt::Formatter<'_>, name: &str, errors: Option<&ErrorStatistics>, unit: &str) -> fmt::Result {
    match errors {
        Some(e) => writeln!(
            f,
            "  {name:<24}{:>9.3}{:>9.3}{:>9.3}{:>+9.3} {unit:<4}{:>7}",
            e.mean_abs, e.median_abs, e.p95_abs, e.bias, e.n
        ),
        None => writeln!(f, "  {name:<24}  no estimate"),
    }
}

fn stretch(f: &mut fmt::Formatter<'_>, which: &str, errors: Option<&StretchErrors>) -> fmt::Result {
    let Some(errors) = errors else { return Ok(()) };
    row(f, &format!("{which}, strand lay"), errors.strand_mm.as_ref(), "mm")?;
    row(f, &format!("{which}, wire lay"), errors.wire_mm.as_ref(), "mm")?;
    row(f, &format!("{which}, strand phase"), errors.strand_phase_rad.as_ref(), "rad")?;
    if errors.strand_not_estimated + errors.wire_not_estimated > 0 {
        writeln!(
            f,
            "  {which}: no strand lay in {} of {} rows, {} wire lays absent",
            errors.strand_not_estimated, errors.rows, errors.wire_not_estimated
        )?;
    }
    Ok(())
}

impl fmt::Display for Evaluation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.lay_lengths.missing {
            writeln!(f, "Lay lengths: nothing to score (no lay_lengths.csv or no truth_lines.csv)")?;
        } else {
            writeln!(
                f,
                "{:<26}{:>9}{:>9}{:>9}{:>9} {:<4}{:>7}",
                "Lay lengths, |error|", "mean", "median", "95 %", "bias", "", "n"
            )?;
            stretch(f, "fused", self.lay_lengths.fused.as_ref())?;
            stretch(f, "views", self.lay_lengths.per_view.as_ref())?;
        }
        write_intervals(f, &self.intervals)?;
        if !self.displacement.missing {
            writeln!(f, "\nDisplacement, rms")?;
            for (name, rms_px) in &self.displacement.rms_px {
                writeln!(f, "  {:<24}{rms_px:>9.3} px", name.trim_end_matches("_rms_px").replace('_', " "))?;
            }
        }
        if let Some(roc) = &self.detection.roc {
            lines(f, roc)?;
        }
        if let Some(d) = &self.detection.decisions {
            writeln!(f, "\nDecisions")?;
            writeln!(f, "  {} of {} clear defects found; {} reported", d.found, d.clear_defects, d.reported)?;
            writeln!(f, "  {} of them by a report of their own", d.told_apart)?;
            writeln!(f, "  {} false, {:.1} per 100 m", d.false_defects, d.false_per_100m)?;
            writeln!(f, "  {:.2} m of {:.2} m to inspect again", d.metres_to_reinspect, d.metres)?;
        }
        Ok(())
    }
}

fn write_intervals(f: &mut fmt::Formatter<'_>, intervals: &[Interval]) -> fmt::Result {
    if intervals.is_empty() {
        return Ok(());
    }
    let (one, two) = ("within 68 %", "within 95 %");
    writeln!(f, "\n{:<26}{:>9}{:>9}     {one:>14}{two:>14}{:>7}", "Stated deviations", "|error|", "sd", "n")?;
    for i in intervals {
        let digits = if i.unit == "rad" { 5 } else { 3 };
        let [error, sd] = [i.mean_abs, i.median_sd].map(|x| format!("{x:.digits$}"));
        let [one, two] = [i.within_68, i.within_95].map(|share| format!("{:.0} %", 100.0 * share));
        writeln!(f, "  {:<24}{error:>9}{sd:>9} {:<4}{one:>14}{two:>14}{:>7}", i.quantity, i.unit, i.n)?;
    }
    Ok(())
}

fn lines(f: &mut fmt::Formatter<'_>, roc: &Roc) -> fmt::Result {
    let percent = |x: Option<f64>| x.map_or("-".into(), |x| format!("{:.2} %", 100.0 * x));
    writeln!(
        f,
        "\n{:<12}{:>8}{:>24}{:>24}{:>12}{:>10}",
        "Lines", "AUC", "FPR, half of each label", "... of 90 % of labels", "scored", "missing"
    )?;
    for view in &roc.views {
        let auc = view.auc.map_or("-".into(), |a| format!("{a:.4}"));
        let every = percent(view.fpr_at_50pct_recovery_of_every_clear_label);
        let most = percent(view.fpr_at_50pct_recovery_of_90pct_of_labels);
        writeln!(
            f,
            "  view {:<5}{auc:>8}{every:>24}{most:>24}{:>12}{:>10}",
            view.view, view.lines_scored, view.lines_missing
        )?;
    }
    let Some(all) = &roc.overall else { return Ok(()) };
    writeln!(f, "  all       {:>8.4}", all.auc_all_views)?;
    writeln!(f, "\nDefects, half of each in its best view: false-positive rate needed")?;
    let shares = [
        ("every defect", all.fpr_at_50pct_recovery_every_defect_best_view),
        ("95 % of them", all.fpr_at_50pct_recovery_95pct_of_defects_best_view),
        ("90 %", all.fpr_at_50pct_recovery_90pct_of_defects_best_view),
        ("75 %", all.fpr_at_50pct_recovery_75pct_of_defects_best_view),
    ];
    for (name, rate) in shares {
        writeln!(f, "  {name:<24}{:>9.3} %", 100.0 * rate)?;
    }
    for (name, at) in &all.at_fpr {
        let rate: f64 = name.trim_start_matches("at_fpr_").parse().unwrap_or(f64::NAN);
        let (found, recovered) = (100.0 * at.defects_50pct, 100.0 * at.tpr_lines);
        writeln!(
            f,
            "  at {:>4.1} % false lines: {found:>5.1} % of {} defects, {recovered:>5.1} % of their lines",
            100.0 * rate,
            all.defects_clear
        )?;
    }
    writeln!(f, "  hardest:")?;
    for hard in &all.hardest {
        writeln!(
            f,
            "    defect {:<4}{:<16} severity {:.2}{:>9.3} %",
            hard.defect,
            hard.kind,
            hard.severity,
            100.0 * hard.fpr_needed
        )?;
    }
    Ok(())
}
