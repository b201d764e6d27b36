//! What a threshold of the line scores finds, and what it costs in rope to look at again. [Wacker13, sec. 6.4]

use super::defects::{context_lines, union_length};
use super::labels::{LineClass, Sighting};
use super::recall::DefectRecall;
use super::roc::{share_from, sorted};

/// One threshold.
#[derive(Debug, Clone, PartialEq)]
pub struct Cost {
    /// Where the threshold comes from.
    pub name: String,
    /// The threshold; infinite below the lowest score.
    pub threshold: f64,
    /// Share of intact lines of all views that alarm.
    pub false_rate: f64,
    /// The same of intact lines that are farther than the context from every label; NaN if there are none.
    pub far_false_rate: f64,
    /// Share of defect lines of all views that do.
    pub true_rate: f64,
    /// Defects of which half alarms in their best view.
    pub half_recovered: usize,
    /// Metres of rope within the context of an alarm of any view, false or not.
    pub reinspect_m: f64,
}

/// Shares of intact lines for which thresholds are stated; 1.5 % is the paper's.
const RATES: [f64; 3] = [0.001, 0.005, 0.015];
/// Shares of the defects that are recovered to one half.
const RECOVERED: [(f64, &str); 3] =
    [(1.0, "half of every defect"), (0.95, "half of 95 % of them"), (0.9, "half of 90 %")];

/// Thresholds and their costs: the run's own, those of stated false rates, those that recover half of the defects.
pub fn costs(
    scores: &[Vec<f64>],
    (sightings, classes): (&[Sighting], &[Vec<LineClass>]),
    defects: &[DefectRecall],
    own: Option<f64>,
    skip: usize,
    line_pitch_mm: f64,
) -> Vec<Cost> {
    let far = far_scores(scores, sightings, classes, 2 * context_lines(line_pitch_mm));
    let of = |class| {
        let mut all: Vec<f64> = scores.iter().zip(classes).flat_map(|(s, c)| sorted(s, c, class)).collect();
        all.sort_unstable_by(f64::total_cmp);
        all
    };
    let (positive, negative) = (of(LineClass::Positive), of(LineClass::Negative));
    if positive.is_empty() || negative.is_empty() || defects.is_empty() {
        return Vec::new();
    }
    let mut thresholds: Vec<(String, f64)> = Vec::new();
    thresholds.extend(own.map(|t| ("the automatic threshold".into(), t)));
    for rate in RATES {
        let at = negative.len() - ((rate * negative.len() as f64) as usize).clamp(1, negative.len());
        thresholds.push((format!("{} % false lines", 100.0 * rate), negative[at]));
    }
    let mut hardest: Vec<f64> = defects.iter().map(|d| d.half_threshold).collect();
    hardest.sort_by(f64::total_cmp);
    for (share, name) in RECOVERED {
        let missed = (((1.0 - share) * hardest.len() as f64 + 1e-9) as usize).min(hardest.len() - 1);
        thresholds.push((name.into(), hardest[missed]));
    }
    let cost = |(name, threshold): (String, f64)| Cost {
        name,
        threshold,
        false_rate: share_from(&negative, threshold),
        far_false_rate: if far.is_empty() { f64::NAN } else { share_from(&far, threshold) },
        true_rate: share_from(&positive, threshold),
        half_recovered: defects.iter().filter(|d| d.half_threshold >= threshold).count(),
        reinspect_m: reinspect_lines(scores, threshold, skip, line_pitch_mm) as f64 * line_pitch_mm / 1000.0,
    };
    thresholds.into_iter().map(cost).collect()
}

/// Scores of intact lines that are more than `reach` lines from every label of any view, ascending.
fn far_scores(scores: &[Vec<f64>], sightings: &[Sighting], classes: &[Vec<LineClass>], reach: usize) -> Vec<f64> {
    let mut near = vec![false; scores.first().map_or(0, Vec::len)];
    for sighting in sightings {
        let from = sighting.first_line.saturating_sub(reach).min(near.len());
        let to = (sighting.last_line + reach + 1).min(near.len());
        near[from..to].fill(true);
    }
    let mut far: Vec<f64> = Vec::new();
    for (scores, classes) in scores.iter().zip(classes) {
        let lines = scores.iter().zip(classes).zip(&near);
        far.extend(
            lines.filter(|((s, c), near)| **c == LineClass::Negative && !**near && !s.is_nan()).map(|((s, _), _)| *s),
        );
    }
    far.sort_unstable_by(f64::total_cmp);
    far
}

/// Lines within the context of any line that alarms, from `skip` on.
fn reinspect_lines(scores: &[Vec<f64>], threshold: f64, skip: usize, line_pitch_mm: f64) -> usize {
    let context = context_lines(line_pitch_mm);
    let mut intervals = Vec::new();
    let alarms = |score: f64| score >= threshold; // not where there is no score
    for scores in scores {
        let mut line = skip;
        while line < scores.len() {
            if !alarms(scores[line]) {
                line += 1;
                continue;
            }
            let first = line;
            while line < scores.len() && alarms(scores[line]) {
                line += 1;
            }
            intervals.push((first.saturating_sub(context).max(skip), (line + context).min(scores.len())));
        }
    }
    union_length(intervals)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alarms_of_all_views_count_once_with_their_context() {
        let mut scores = vec![vec![0.0; 10_000]; 2];
        scores[0][5000..5010].fill(3.0);
        scores[1][5005..5020].fill(2.0);
        scores[1][9999] = f64::NAN;
        // 20 lines and 25 mm (250 lines) on either side
        assert_eq!(reinspect_lines(&scores, 1.5, 0, 0.1), 520);
        assert_eq!(reinspect_lines(&scores, 2.5, 0, 0.1), 510);
        assert_eq!(reinspect_lines(&scores, 1.5, 5015, 0.1), 255);
    }

    #[test]
    fn lines_beside_a_label_of_any_view_are_not_far() {
        let label = Sighting {
            defect: 0,
            kind: "notch".into(),
            severity: 1.0,
            view: 1,
            first_line: 40,
            last_line: 49,
            clear: true,
            runs: Vec::new(),
            lines: (40..50).collect(),
        };
        let scores = vec![(0..100).map(f64::from).collect(), vec![0.0; 100]];
        let classes = vec![vec![LineClass::Negative; 100], vec![LineClass::Ignored; 100]];
        let far = far_scores(&scores, &[label], &classes, 5);
        assert_eq!((far.len(), far[34], far[35]), (80, 34.0, 55.0));
    }

    #[test]
    fn half_of_every_defect_costs_what_its_hardest_needs() {
        let defect = |n: usize, half_threshold| DefectRecall {
            defect: n,
            kind: "notch".into(),
            severity: 1.0,
            first_line: 0,
            rate_needed: 0.0,
            half_threshold,
            recovered: None,
            reported: None,
        };
        let scores = vec![(0..1000).map(f64::from).collect::<Vec<_>>()];
        let mut classes = vec![vec![LineClass::Negative; 1000]];
        classes[0][990..].fill(LineClass::Positive);
        let found = costs(&scores, (&[], &classes), &[defect(0, 980.0), defect(1, 995.0)], Some(999.0), 0, 0.1);
        let every = found.iter().find(|c| c.name == "half of every defect").unwrap();
        assert_eq!((every.threshold, every.half_recovered, every.true_rate), (980.0, 2, 1.0));
        assert!((every.false_rate - 10.0 / 990.0).abs() < 1e-12);
        assert!((every.far_false_rate - every.false_rate).abs() < 1e-12); // without labels all is far
        assert_eq!((found[0].name.as_str(), found[0].half_recovered), ("the automatic threshold", 0));
    }
}
