//! An expert's labels turned into lines: which count as defect, which as intact, which neither way.

use super::table::EvaluateError;
use super::truth::read_json;
use serde::Deserialize;
use std::path::Path;

/// Labels without number, of one kind and in different views, that are nearer than this along the rope mark one defect: experts draw
/// boxes to a few mm. In one view only those that overlap do.
const ONE_DEFECT_MM: f64 = 5.0;
/// Lines round a defect that count neither way.
pub const MARGIN_LINES: usize = 20;

/// One label of `labels.json`.
#[derive(Debug, Clone, Deserialize)]
struct LabelFile {
    defect: Option<usize>,
    kind: String,
    severity: Option<f64>,
    view: usize,
    first_line: usize,
    last_line: usize,
    first_column: Option<usize>,
    last_column: Option<usize>,
    clear: Option<bool>,
}

/// Where one label marks a defect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Run {
    /// First and last line.
    pub lines: (usize, usize),
    /// First and last column; `None` if the label does not say.
    pub columns: Option<(usize, usize)>,
}

/// A defect as seen in one view: all of its runs.
#[derive(Debug, Clone, PartialEq)]
pub struct Sighting {
    /// The defect.
    pub defect: usize,
    /// Its kind.
    pub kind: String,
    /// Its severity, 1 if not stated.
    pub severity: f64,
    /// The view.
    pub view: usize,
    /// First line of its first run.
    pub first_line: usize,
    /// Last line of its last run.
    pub last_line: usize,
    /// Whether every inspector would mark it (any of its runs).
    pub clear: bool,
    /// Its runs, in the order of the labels.
    pub runs: Vec<Run>,
    /// Lines of its runs, ascending.
    pub lines: Vec<usize>,
}

/// How a line counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LineClass {
    /// Intact.
    #[default]
    Negative,
    /// A clear label.
    Positive,
    /// Neither: near a defect, between its runs, an unclear label, or training part.
    Ignored,
}

/// Numbers of the defects that labels mark, in their order. Labels without number are told apart by kind and place and get numbers of
/// their own.
fn numbers(labels: &[LabelFile], line_pitch_mm: f64) -> Vec<usize> {
    let first_free = labels.iter().filter_map(|label| label.defect).max().map_or(0, |defect| defect + 1);
    let mut numbers: Vec<usize> =
        labels.iter().enumerate().map(|(n, label)| label.defect.unwrap_or(first_free + n)).collect();
    let near_lines = (ONE_DEFECT_MM / line_pitch_mm) as usize;
    let is_one = |a: &LabelFile, b: &LabelFile| {
        let near = if a.view == b.view { 0 } else { near_lines };
        a.kind == b.kind && a.first_line <= b.last_line + near && b.first_line <= a.last_line + near
    };
    for (n, label) in labels.iter().enumerate().filter(|(_, label)| label.defect.is_none()) {
        for (m, earlier) in labels[..n].iter().enumerate().filter(|(_, earlier)| earlier.defect.is_none()) {
            let (one, other) = (numbers[m].min(numbers[n]), numbers[m].max(numbers[n]));
            if is_one(label, earlier) {
                numbers.iter_mut().filter(|number| **number == other).for_each(|number| *number = one);
            }
        }
    }
    numbers
}

/// Reads `DIR/labels.json` as sightings in order of first mention. Labels without `defect` are joined over views by kind and place.
pub fn read_sightings(
    folder: &Path,
    lines: usize,
    views: usize,
    line_pitch_mm: f64,
) -> Result<Vec<Sighting>, EvaluateError> {
    let path = folder.join("labels.json");
    let labels: Vec<LabelFile> = read_json(&path)?;
    let numbers = numbers(&labels, line_pitch_mm);
    let mut sightings: Vec<Sighting> = Vec::new();
    for (n, label) in labels.into_iter().enumerate() {
        if label.view >= views || label.first_line > label.last_line {
            let reason = format!(
                "label {n} has view {} and lines {} to {}, but there are {views} views and lines must not run backwards",
                label.view, label.first_line, label.last_line
            );
            return Err(EvaluateError::Json { path, reason });
        }
        let defect = numbers[n];
        let last_line = label.last_line.min(lines.saturating_sub(1));
        let at = sightings.iter().position(|s| (s.defect, s.view) == (defect, label.view));
        let sighting = match at {
            Some(at) => &mut sightings[at],
            None => {
                sightings.push(Sighting {
                    defect,
                    kind: label.kind,
                    severity: label.severity.unwrap_or(1.0),
                    view: label.view,
                    first_line: label.first_line,
                    last_line,
                    clear: false,
                    runs: Vec::new(),
                    lines: Vec::new(),
                });
                sightings.last_mut().unwrap_or_else(|| unreachable!("just pushed"))
            }
        };
        sighting.first_line = sighting.first_line.min(label.first_line);
        sighting.last_line = sighting.last_line.max(last_line);
        sighting.clear |= label.clear.unwrap_or(true);
        let columns = label.first_column.zip(label.last_column);
        sighting.runs.push(Run { lines: (label.first_line, last_line), columns });
        sighting.lines.extend(label.first_line..last_line + 1);
    }
    for sighting in &mut sightings {
        sighting.lines.sort_unstable();
        sighting.lines.dedup();
    }
    Ok(sightings)
}

/// Class of every line of every view. Lines before `skip` are ignored.
pub fn classify(sightings: &[Sighting], lines: usize, views: usize, skip: usize) -> Vec<Vec<LineClass>> {
    let mut classes = vec![vec![LineClass::Negative; lines]; views];
    for sighting in sightings {
        let from = sighting.first_line.saturating_sub(MARGIN_LINES).min(lines);
        let to = (sighting.last_line + 1 + MARGIN_LINES).min(lines);
        classes[sighting.view][from..to].fill(LineClass::Ignored);
    }
    for sighting in sightings.iter().filter(|s| s.clear) {
        for &line in &sighting.lines {
            classes[sighting.view][line] = LineClass::Positive;
        }
    }
    for view in &mut classes {
        view[..skip.min(lines)].fill(LineClass::Ignored);
    }
    classes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_of_one_defect_are_one_sighting_and_the_gap_counts_neither_way() {
        let folder = tempfile::tempdir().unwrap();
        let labels = r#"[{"defect":4,"kind":"notch","view":0,"first_line":100,"last_line":109,"clear":false},
                         {"defect":4,"kind":"notch","view":0,"first_line":150,"last_line":999,"clear":true}]"#;
        std::fs::write(folder.path().join("labels.json"), labels).unwrap();
        let sightings = read_sightings(folder.path(), 160, 1, 0.1).unwrap();
        assert_eq!(sightings.len(), 1);
        assert_eq!((sightings[0].lines.len(), sightings[0].last_line, sightings[0].clear), (20, 159, true));
        let classes = classify(&sightings, 160, 1, 105);
        assert_eq!(classes[0][104], LineClass::Ignored); // training part
        assert_eq!(classes[0][106], LineClass::Positive);
        assert_eq!(classes[0][130], LineClass::Ignored); // gap
        assert_eq!(classify(&sightings, 160, 1, 0)[0][79], LineClass::Negative);
    }
    #[test]
    fn labels_without_number_are_one_defect_over_views_where_kind_and_place_agree() {
        let folder = tempfile::tempdir().unwrap();
        let label = |kind: &str, view: usize, first: usize, last: usize| serde_json::json!({ "view": view, "first_line": first, "last_line": last, "kind": kind });
        let labels = [
            label("broken_wire", 0, 1000, 1100),
            label("corrosion", 1, 1050, 1200),   // another kind at the same place
            label("broken_wire", 2, 1180, 1300), // overlaps with neither, but with the next one
            label("broken_wire", 1, 1090, 1150), // joins both, 3 mm short of the second
            label("broken_wire", 0, 1110, 1120), // 1 mm on in a view that has one there already
            label("broken_wire", 1, 5000, 5100),
            serde_json::json!({ "defect": 6, "view": 3, "first_line": 1000, "last_line": 1100, "kind": "broken_wire" }),
        ];
        std::fs::write(folder.path().join("labels.json"), serde_json::to_vec(&labels).unwrap()).unwrap();
        let sightings = read_sightings(folder.path(), 9000, 4, 0.1).unwrap();
        let of: Vec<(usize, usize, usize)> = sightings.iter().map(|s| (s.defect, s.view, s.lines.len())).collect();
        // The one 1 mm on overlaps that of view 1, so it is a run of the same defect.
        assert_eq!(of, [(7, 0, 112), (8, 1, 151), (7, 2, 121), (7, 1, 61), (12, 1, 101), (6, 3, 101)]);
    }
}
