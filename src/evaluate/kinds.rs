//! Kinds that were suggested beside kinds that the labels state.

use super::defects::touched;
use super::labels::Sighting;
use super::table::EvaluateError;
use super::truth::read_json;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Kinds that can be suggested, in the order of tables.
pub const SUGGESTED: [&str; 5] = ["gap", "missing_wire", "protruding_wire", "surface_change", "unclear"];

/// `RESULTS/defects.json`, as far as it is read here.
#[derive(Deserialize)]
struct Reported {
    peak_score: f64,
    suggestion: Option<Suggestion>,
    #[serde(flatten)]
    place: super::defects::ReportedDefect,
}

#[derive(Deserialize)]
struct Suggestion {
    kind: String,
}

/// Of every labelled kind: how often each of [`SUGGESTED`] was suggested, among its defects that were reported.
pub type Confusion = BTreeMap<String, [usize; SUGGESTED.len()]>;

/// Compares; a defect that several reported ones touch counts by the one with the highest score. `None` if nothing was suggested.
pub fn confusion(results: &Path, sightings: &[Sighting], skip: usize) -> Result<Option<Confusion>, EvaluateError> {
    let path = results.join("defects.json");
    if !path.exists() {
        return Ok(None);
    }
    let mut reported: Vec<Reported> = read_json(&path)?;
    reported.sort_by(|a, b| a.peak_score.total_cmp(&b.peak_score));
    let mut suggested: BTreeMap<usize, usize> = BTreeMap::new();
    for defect in &reported {
        let Some(suggestion) = &defect.suggestion else { continue };
        let Some(kind) = SUGGESTED.iter().position(|name| *name == suggestion.kind) else { continue };
        touched(std::slice::from_ref(&defect.place), sightings).into_iter().flatten().for_each(|of| {
            suggested.insert(of, kind); // the highest comes last
        });
    }
    if suggested.is_empty() {
        return Ok(None);
    }
    let mut confusion = Confusion::new();
    for (defect, kind) in suggested {
        let label = sightings.iter().find(|s| s.defect == defect && s.clear && s.first_line >= skip);
        if let Some(label) = label {
            confusion.entry(label.kind.clone()).or_default()[kind] += 1;
        }
    }
    Ok(Some(confusion))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sighting(defect: usize, kind: &str, first_line: usize) -> Sighting {
        let lines = (first_line..first_line + 50).collect();
        let last_line = first_line + 49;
        Sighting {
            defect,
            kind: kind.into(),
            severity: 1.0,
            view: 0,
            first_line,
            last_line,
            clear: true,
            runs: Vec::new(),
            lines,
        }
    }

    #[test]
    fn the_highest_of_several_reports_says_what_a_defect_was_taken_for() {
        let folder = tempfile::tempdir().unwrap();
        let place = |line: usize, peak: f64, kind: &str| {
            serde_json::json!({
                "peak_score": peak,
                "suggestion": { "kind": kind },
                "alarms": [{ "view": 0, "first_line": line, "last_line": line + 20 }],
            })
        };
        let rows = [
            place(1000, 9.0, "gap"),
            place(1040, 7.0, "unclear"),
            place(3000, 8.0, "unclear"),
            place(9000, 8.0, "gap"), // false
        ];
        std::fs::write(folder.path().join("defects.json"), serde_json::to_vec(&rows).unwrap()).unwrap();
        let sightings = [sighting(0, "broken_wire", 1000), sighting(1, "corrosion", 3000), sighting(2, "notch", 6000)];
        let confusion = confusion(folder.path(), &sightings, 0).unwrap().unwrap();
        assert_eq!(confusion["broken_wire"], [1, 0, 0, 0, 0]);
        assert_eq!(confusion["corrosion"], [0, 0, 0, 0, 1]);
        assert_eq!(confusion.len(), 2, "a defect that was not reported was taken for nothing");
        assert!(super::confusion(&folder.path().join("none"), &sightings, 0).unwrap().is_none());
    }
}
