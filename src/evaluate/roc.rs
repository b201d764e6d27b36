//! Line scores against labels: area under the ROC curve and the false alarms that 50 % recovery costs. [Wacker13, sec. 6.2]

use super::labels::{LineClass, Sighting};
use super::lay_lengths::percentile;
use serde::Serialize;
use std::collections::BTreeMap;

/// False-positive rates at which detection is stated; 1.5 % is the paper's.
const RATES: [f64; 4] = [0.001, 0.005, 0.015, 0.05];
/// How many of the hardest defects are named.
const HARDEST: usize = 8;

/// One view.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ViewRoc {
    /// The view.
    pub view: usize,
    /// Lines with a score.
    pub lines_scored: usize,
    /// Lines without.
    pub lines_missing: usize,
    /// Area under the ROC curve of its lines.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub auc: Option<f64>,
    /// Share of intact lines that alarm when half of every clear label does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fpr_at_50pct_recovery_of_every_clear_label: Option<f64>,
    /// The same for nine labels of ten.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fpr_at_50pct_recovery_of_90pct_of_labels: Option<f64>,
}

/// What a false-positive rate buys.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct AtRate {
    /// Share of defect lines that alarm.
    pub tpr_lines: f64,
    /// Share of defects of which half alarms in their best view.
    pub defects_50pct: f64,
}

/// A defect that is hard to find.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HardDefect {
    /// Its number.
    pub defect: usize,
    /// Its kind.
    pub kind: String,
    /// Its severity.
    pub severity: f64,
    /// False-positive rate at which half of it alarms in its best view.
    pub fpr_needed: f64,
}

/// All views together.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OverallRoc {
    /// Area under the ROC curve of all lines of all views.
    pub auc_all_views: f64,
    /// Number of defects with a clear label.
    pub defects_clear: usize,
    /// False-positive rate at which half of every defect alarms in its best view.
    pub fpr_at_50pct_recovery_every_defect_best_view: f64,
    /// The same for 95 % of the defects.
    pub fpr_at_50pct_recovery_95pct_of_defects_best_view: f64,
    /// The same for 90 %.
    pub fpr_at_50pct_recovery_90pct_of_defects_best_view: f64,
    /// The same for 75 %.
    pub fpr_at_50pct_recovery_75pct_of_defects_best_view: f64,
    /// `at_fpr_0.001` and so on.
    #[serde(flatten)]
    pub at_fpr: BTreeMap<String, AtRate>,
    /// The hardest defects, hardest first.
    pub hardest: Vec<HardDefect>,
    /// Median over the defects of a kind.
    pub median_fpr_needed_by_kind: BTreeMap<String, f64>,
}

/// Line scores against labels.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Roc {
    /// View by view.
    pub views: Vec<ViewRoc>,
    /// All views, if there are clear labels and intact lines.
    #[serde(flatten)]
    pub overall: Option<OverallRoc>,
}

/// Scores of one class, ascending.
pub(super) fn sorted(scores: &[f64], classes: &[LineClass], class: LineClass) -> Vec<f64> {
    let mut of: Vec<f64> =
        scores.iter().zip(classes).filter(|(s, c)| **c == class && !s.is_nan()).map(|(s, _)| *s).collect();
    of.sort_unstable_by(f64::total_cmp);
    of
}

/// Area under the ROC curve: how often a positive scores above a negative, ties half. Both ascending, not empty.
pub fn auc(positive: &[f64], negative: &[f64]) -> f64 {
    let (mut below, mut up_to, mut wins) = (0, 0, 0.0);
    for &score in positive {
        while below < negative.len() && negative[below] < score {
            below += 1;
        }
        up_to = up_to.max(below);
        while up_to < negative.len() && negative[up_to] <= score {
            up_to += 1;
        }
        wins += (below + up_to) as f64 / 2.0;
    }
    wins / (positive.len() as f64 * negative.len() as f64)
}

/// Share of ascending values at or above a threshold.
pub(super) fn share_from(sorted: &[f64], threshold: f64) -> f64 {
    1.0 - sorted.partition_point(|&s| s < threshold) as f64 / sorted.len() as f64
}

/// Threshold up to which half of a sighting's lines alarm: their median, lines without a score never alarming.
pub(super) fn recovery_threshold(sighting: &Sighting, scores: &[f64]) -> f64 {
    let mut of: Vec<f64> =
        sighting.lines.iter().map(|&l| scores[l]).map(|s| if s.is_nan() { f64::NEG_INFINITY } else { s }).collect();
    of.sort_unstable_by(f64::total_cmp);
    let middle = of.len() / 2;
    match of.len() {
        0 => f64::NEG_INFINITY,
        n if n % 2 == 1 => of[middle],
        _ => (of[middle - 1] + of[middle]) / 2.0,
    }
}

/// Scores line scores. Defects that begin before `skip` do not count.
pub fn score(scores: &[Vec<f64>], sightings: &[Sighting], classes: &[Vec<LineClass>], skip: usize) -> Roc {
    let counts = |s: &&Sighting| s.clear && s.first_line >= skip;
    let mut views = Vec::new();
    let (mut positive, mut negative) = (Vec::new(), Vec::new());
    for (view, (scores, classes)) in scores.iter().zip(classes).enumerate() {
        let scored = scores.iter().filter(|s| !s.is_nan()).count();
        let own_positive = sorted(scores, classes, LineClass::Positive);
        let own_negative = sorted(scores, classes, LineClass::Negative);
        let mut thresholds: Vec<f64> =
            sightings.iter().filter(|s| s.view == view).filter(counts).map(|s| recovery_threshold(s, scores)).collect();
        thresholds.sort_unstable_by(f64::total_cmp);
        let recovery = !thresholds.is_empty() && !own_negative.is_empty();
        views.push(ViewRoc {
            view,
            lines_scored: scored,
            lines_missing: scores.len() - scored,
            auc: (!own_positive.is_empty() && !own_negative.is_empty()).then(|| auc(&own_positive, &own_negative)),
            fpr_at_50pct_recovery_of_every_clear_label: recovery.then(|| share_from(&own_negative, thresholds[0])),
            fpr_at_50pct_recovery_of_90pct_of_labels: recovery
                .then(|| share_from(&own_negative, percentile(&thresholds, 10.0))),
        });
        positive.extend(own_positive);
        negative.extend(own_negative);
    }
    positive.sort_unstable_by(f64::total_cmp);
    negative.sort_unstable_by(f64::total_cmp);
    // a defect is as easy as in its best view
    let mut best: BTreeMap<usize, (f64, &Sighting)> = BTreeMap::new();
    for sighting in sightings.iter().filter(counts) {
        let threshold = recovery_threshold(sighting, &scores[sighting.view]);
        if best.get(&sighting.defect).is_none_or(|(other, _)| threshold > *other) {
            best.insert(sighting.defect, (threshold, sighting));
        }
    }
    let scorable = !positive.is_empty() && !negative.is_empty() && !best.is_empty();
    Roc { views, overall: scorable.then(|| overall(&positive, &negative, best.into_values().collect())) }
}

fn overall(positive: &[f64], negative: &[f64], mut best: Vec<(f64, &Sighting)>) -> OverallRoc {
    let round2 = |x: f64| format!("{x:.2}").parse().unwrap_or(x);
    best.sort_by(|a, b| {
        (a.0.total_cmp(&b.0))
            .then_with(|| a.1.kind.cmp(&b.1.kind))
            .then_with(|| round2(a.1.severity).total_cmp(&round2(b.1.severity)))
            .then_with(|| a.1.defect.cmp(&b.1.defect))
    });
    let needed = |threshold: f64| share_from(negative, threshold);
    let without = |share: f64| needed(best[(share * best.len() as f64) as usize].0);
    let at_fpr = RATES.iter().map(|&rate| {
        let at = (((1.0 - rate) * negative.len() as f64) as usize).min(negative.len() - 1);
        let threshold = negative[at];
        let alarms = positive.len() - positive.partition_point(|&s| s <= threshold);
        let found = best.iter().filter(|(t, _)| *t > threshold).count();
        let at_rate = AtRate {
            tpr_lines: alarms as f64 / positive.len() as f64,
            defects_50pct: found as f64 / best.len() as f64,
        };
        (format!("at_fpr_{rate}"), at_rate)
    });
    let mut by_kind: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for (threshold, sighting) in &best {
        by_kind.entry(sighting.kind.clone()).or_default().push(needed(*threshold));
    }
    OverallRoc {
        auc_all_views: auc(positive, negative),
        defects_clear: best.len(),
        fpr_at_50pct_recovery_every_defect_best_view: without(0.0),
        fpr_at_50pct_recovery_95pct_of_defects_best_view: without(0.05),
        fpr_at_50pct_recovery_90pct_of_defects_best_view: without(0.10),
        fpr_at_50pct_recovery_75pct_of_defects_best_view: without(0.25),
        at_fpr: at_fpr.collect(),
        hardest: best
            .iter()
            .take(HARDEST)
            .map(|(threshold, sighting)| HardDefect {
                defect: sighting.defect,
                kind: sighting.kind.clone(),
                severity: round2(sighting.severity),
                fpr_needed: needed(*threshold),
            })
            .collect(),
        median_fpr_needed_by_kind: by_kind
            .into_iter()
            .map(|(kind, mut rates)| {
                rates.sort_unstable_by(f64::total_cmp);
                (kind, percentile(&rates, 50.0))
            })
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ties_count_half() {
        assert_eq!(auc(&[1.0, 2.0], &[0.0, 1.0]), 0.875);
        assert_eq!(auc(&[5.0], &[5.0]), 0.5);
        assert_eq!(share_from(&[0.0, 1.0, 1.0, 2.0], 1.0), 0.75);
    }

    #[test]
    fn unscored_lines_never_alarm() {
        let sighting = Sighting {
            defect: 0,
            kind: "notch".into(),
            severity: 1.0,
            view: 0,
            first_line: 0,
            last_line: 2,
            clear: true,
            runs: Vec::new(),
            lines: vec![0, 1, 2],
        };
        assert_eq!(recovery_threshold(&sighting, &[9.0, f64::NAN, f64::NAN]), f64::NEG_INFINITY);
        assert_eq!(recovery_threshold(&sighting, &[9.0, f64::NAN, 3.0]), 3.0);
    }
}
