//! Every single defect: how much of it is recovered, whether it was reported, and how many false lines it costs. It is crucial to
//! detect every one. [Wacker13, sec. 6.2]

use super::labels::{LineClass, Sighting};
use super::roc::{recovery_threshold, share_from, sorted};
use std::collections::{BTreeMap, BTreeSet};

/// A defect with a clear label.
#[derive(Debug, Clone, PartialEq)]
pub struct DefectRecall {
    /// Its number.
    pub defect: usize,
    /// Its kind.
    pub kind: String,
    /// Its severity.
    pub severity: f64,
    /// First line of its first label.
    pub first_line: usize,
    /// Share of intact lines of all views that alarm at a threshold at which half of it does in its best view.
    pub rate_needed: f64,
    /// Highest line score up to which half of it alarms in its best view.
    pub half_threshold: f64,
    /// Share of its lines at or above the threshold of the run in its best view; `None` without a threshold.
    pub recovered: Option<f64>,
    /// Whether a reported defect touches it; `None` without `defects.json`.
    pub reported: Option<bool>,
}

/// Recall of every clear defect from `skip` on, by number.
pub fn recall(
    scores: &[Vec<f64>],
    sightings: &[Sighting],
    classes: &[Vec<LineClass>],
    skip: usize,
    threshold: Option<f64>,
    reported: Option<&BTreeSet<usize>>,
) -> Vec<DefectRecall> {
    let mut negative: Vec<f64> =
        scores.iter().zip(classes).flat_map(|(s, c)| sorted(s, c, LineClass::Negative)).collect();
    negative.sort_unstable_by(f64::total_cmp);
    let mut defects: BTreeMap<usize, DefectRecall> = BTreeMap::new();
    for sighting in sightings.iter().filter(|s| s.clear && s.first_line >= skip) {
        let own = &scores[sighting.view];
        let half_threshold = recovery_threshold(sighting, own);
        let alarmed = |t: f64| sighting.lines.iter().filter(|&&l| own[l] >= t).count();
        let recovered = threshold.map(|t| alarmed(t) as f64 / sighting.lines.len().max(1) as f64);
        let defect = defects.entry(sighting.defect).or_insert_with(|| DefectRecall {
            defect: sighting.defect,
            kind: sighting.kind.clone(),
            severity: sighting.severity,
            first_line: sighting.first_line,
            rate_needed: 1.0,
            half_threshold: f64::NEG_INFINITY,
            recovered,
            reported: reported.map(|r| r.contains(&sighting.defect)),
        });
        defect.first_line = defect.first_line.min(sighting.first_line);
        defect.half_threshold = defect.half_threshold.max(half_threshold);
        defect.recovered = defect.recovered.zip(recovered).map(|(a, b)| a.max(b));
    }
    for defect in defects.values_mut() {
        defect.rate_needed = if negative.is_empty() { f64::NAN } else { share_from(&negative, defect.half_threshold) };
    }
    defects.into_values().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_defect_is_as_easy_as_in_its_best_view() {
        let sighting = |view| Sighting {
            defect: 3,
            kind: "notch".into(),
            severity: 0.5,
            view,
            first_line: 10,
            last_line: 13,
            clear: true,
            runs: Vec::new(),
            lines: vec![10, 11, 12, 13],
        };
        let mut first = vec![0.0; 100];
        let mut second = first.clone();
        first[10..14].copy_from_slice(&[1.0, 1.0, 1.0, f64::NAN]);
        second[10..14].copy_from_slice(&[5.0, 6.0, 7.0, 1.0]);
        let mut classes = vec![LineClass::Negative; 100];
        classes[10..14].fill(LineClass::Positive);
        second[50] = 5.5; // one intact line of 192 that alarms at the threshold needed
        let both = [classes.clone(), classes];
        let reported = BTreeSet::from([3]);
        let of = recall(&[first, second], &[sighting(0), sighting(1)], &both, 0, Some(5.5), Some(&reported));
        assert_eq!((of.len(), of[0].half_threshold, of[0].recovered, of[0].reported), (1, 5.5, Some(0.5), Some(true)));
        assert!((of[0].rate_needed - 1.0 / 192.0).abs() < 1e-12);
    }
}
