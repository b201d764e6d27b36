//! What was decided: which defects were found, what was reported without cause, and how much rope a person must look at again.

use super::labels::{MARGIN_LINES, Sighting};
use super::table::EvaluateError;
use super::told_apart::told_apart;
use super::truth::read_json;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::Path;

/// Rope that a person looks at round each alarm, in mm. [Wacker13, sec. 6.4]
pub const CONTEXT_MM: f64 = 50.0;

/// The figures of `defects.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Decisions {
    /// Defects reported.
    pub reported: usize,
    /// Defects with a clear label.
    pub clear_defects: usize,
    /// Those of them that some alarm touches.
    pub found: usize,
    /// Those of them that have a reported defect of their own, see `told_apart`.
    pub told_apart: usize,
    /// Reported defects that touch no label.
    pub false_defects: usize,
    /// Metres of rope.
    pub metres: f64,
    /// False defects per 100 m.
    pub false_per_100m: f64,
    /// Metres of rope within the context of an alarm.
    pub metres_to_reinspect: f64,
}

#[derive(Deserialize)]
pub(super) struct ReportedDefect {
    pub alarms: Vec<ReportedAlarm>,
}

#[derive(Deserialize)]
pub(super) struct ReportedAlarm {
    pub view: usize,
    pub first_line: usize,
    pub last_line: usize,
    pub first_column: Option<usize>,
    pub last_column: Option<usize>,
}

/// Scores `RESULTS/defects.json`; `None` without the file.
pub fn score(
    results: &Path,
    sightings: &[Sighting],
    lines: usize,
    line_pitch_mm: f64,
    skip: usize,
) -> Result<Option<Decisions>, EvaluateError> {
    let path = results.join("defects.json");
    if !path.exists() {
        return Ok(None);
    }
    let reported: Vec<ReportedDefect> = read_json(&path)?;
    let touched = touched(&reported, sightings);
    let clear: BTreeSet<usize> =
        sightings.iter().filter(|s| s.clear && s.first_line >= skip).map(|s| s.defect).collect();
    let mut covered = Vec::new();
    let context = context_lines(line_pitch_mm);
    for alarm in reported.iter().flat_map(|defect| &defect.alarms) {
        let from = alarm.first_line.saturating_sub(context);
        covered.push((from.min(lines), (alarm.last_line + context).min(lines)));
    }
    let false_defects = touched.iter().filter(|defects| defects.is_empty()).count();
    let touched: BTreeSet<usize> = touched.into_iter().flatten().collect();
    Ok(Some(Decisions {
        reported: reported.len(),
        clear_defects: clear.len(),
        found: touched.intersection(&clear).count(),
        told_apart: told_apart(&reported, sightings, &clear),
        false_defects,
        metres: lines as f64 * line_pitch_mm / 1000.0,
        false_per_100m: false_defects as f64 / (lines as f64 * line_pitch_mm / 1e5),
        metres_to_reinspect: union_length(covered) as f64 * line_pitch_mm / 1000.0,
    }))
}

/// Lines on each side of an alarm that a person looks at.
pub(super) fn context_lines(line_pitch_mm: f64) -> usize {
    (CONTEXT_MM / 2.0 / line_pitch_mm) as usize
}

/// The defects with labels that each reported defect touches.
pub(super) fn touched(reported: &[ReportedDefect], sightings: &[Sighting]) -> Vec<BTreeSet<usize>> {
    let reaches = |alarm: &ReportedAlarm, sighting: &Sighting| {
        sighting.view == alarm.view
            && alarm.first_line <= sighting.last_line + MARGIN_LINES
            && alarm.last_line + MARGIN_LINES >= sighting.first_line
    };
    let of = |defect: &ReportedDefect| {
        let near = |s: &&Sighting| defect.alarms.iter().any(|alarm| reaches(alarm, s));
        sightings.iter().filter(near).map(|s| s.defect).collect()
    };
    reported.iter().map(of).collect()
}

/// The defects with labels that `RESULTS/defects.json` reports; `None` without the file.
pub fn reported(results: &Path, sightings: &[Sighting]) -> Result<Option<BTreeSet<usize>>, EvaluateError> {
    let path = results.join("defects.json");
    if !path.exists() {
        return Ok(None);
    }
    let reported: Vec<ReportedDefect> = read_json(&path)?;
    Ok(Some(touched(&reported, sightings).into_iter().flatten().collect()))
}

/// Lines in the union of half-open intervals.
pub(super) fn union_length(mut intervals: Vec<(usize, usize)>) -> usize {
    intervals.sort_unstable();
    let (mut length, mut end) = (0, 0);
    for (from, to) in intervals {
        length += to.saturating_sub(from.max(end));
        end = end.max(to);
    }
    length
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overlapping_contexts_count_once() {
        assert_eq!(union_length(vec![(10, 20), (0, 5), (15, 30), (16, 18)]), 25);
        assert_eq!(union_length(Vec::new()), 0);
    }
}
