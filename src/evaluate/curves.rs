//! ROC curves of line scores: view by view, averaged over the views, and where half of every defect is recovered.
//! [Wacker13, fig. 9]

use super::labels::{LineClass, Sighting};
use super::roc::{auc, recovery_threshold, share_from, sorted};

/// A curve as points (share of intact lines that alarm, share of defect lines that do).
pub type Points = Vec<(f64, f64)>;

/// The curve of one view.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewCurve {
    /// The view.
    pub view: usize,
    /// Points at [`rates`].
    pub points: Points,
    /// Area under the whole curve.
    pub auc: f64,
    /// The point at which at least half of every defect in this view is recovered.
    pub half_recovered: Option<(f64, f64)>,
}

/// Least share of intact lines at which curves are drawn.
pub const LEAST_RATE: f64 = 1e-4;
/// Points a curve.
const POINTS: usize = 160;

/// Shares of intact lines at which curves are known: evenly on a logarithmic scale up to 1.
pub fn rates() -> impl Iterator<Item = f64> {
    (0..=POINTS).map(|n| LEAST_RATE.powf(1.0 - n as f64 / POINTS as f64))
}

/// The curve of every view that has labels and intact lines. Defects that begin before `skip` do not count.
pub fn curves(scores: &[Vec<f64>], sightings: &[Sighting], classes: &[Vec<LineClass>], skip: usize) -> Vec<ViewCurve> {
    let views = scores.iter().zip(classes).enumerate();
    let curve = |(view, (scores, classes)): (usize, (&Vec<f64>, &Vec<LineClass>))| {
        let positive = sorted(scores, classes, LineClass::Positive);
        let negative = sorted(scores, classes, LineClass::Negative);
        if positive.is_empty() || negative.is_empty() {
            return None;
        }
        let at_rate = |rate: f64| {
            // the highest threshold that so many intact lines reach
            let alarmed = ((rate * negative.len() as f64) as usize).min(negative.len());
            match alarmed {
                0 => (rate, above(&positive, negative[negative.len() - 1])),
                n => (rate, share_from(&positive, negative[negative.len() - n])),
            }
        };
        let hardest = sightings
            .iter()
            .filter(|s| s.view == view && s.clear && s.first_line >= skip)
            .map(|s| recovery_threshold(s, scores))
            .min_by(f64::total_cmp);
        Some(ViewCurve {
            view,
            points: rates().map(at_rate).collect(),
            auc: auc(&positive, &negative),
            half_recovered: hardest.map(|t| (share_from(&negative, t), share_from(&positive, t))),
        })
    };
    views.filter_map(curve).collect()
}

/// Share of ascending values above a threshold.
fn above(sorted: &[f64], threshold: f64) -> f64 {
    1.0 - sorted.partition_point(|&s| s <= threshold) as f64 / sorted.len() as f64
}

/// Mean of the curves at every rate.
pub fn average(curves: &[ViewCurve]) -> Points {
    rates()
        .enumerate()
        .map(|(n, rate)| (rate, curves.iter().map(|c| c.points[n].1).sum::<f64>() / curves.len().max(1) as f64))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_rises_from_what_no_intact_line_reaches_to_everything() {
        // 900 intact lines with scores 0..899, 100 defect lines with scores 800..1000 in steps of 2
        let mut scores: Vec<f64> = (0..900).map(f64::from).collect();
        scores.extend((0..100).map(|k| 800.0 + 2.0 * f64::from(k)));
        let mut classes = vec![LineClass::Negative; 900];
        classes.extend(vec![LineClass::Positive; 100]);
        let sighting = Sighting {
            defect: 0,
            kind: "notch".into(),
            severity: 1.0,
            view: 0,
            first_line: 900,
            last_line: 999,
            clear: true,
            runs: Vec::new(),
            lines: (900..1000).collect(),
        };
        let found = curves(&[scores], &[sighting], &[classes], 0);
        let curve = &found[0];
        assert!((curve.points[0].1 - 0.5).abs() < 1e-9); // above 899 are 900, 902, ...
        assert_eq!(curve.points.last().unwrap(), &(1.0, 1.0));
        assert!(curve.points.windows(2).all(|w| w[1].1 >= w[0].1));
        // half of the defect lines reach 899, and so does one intact line
        let (false_rate, true_rate) = curve.half_recovered.unwrap();
        assert!((false_rate - 1.0 / 900.0).abs() < 1e-9 && (true_rate - 0.5).abs() < 1e-9, "{false_rate} {true_rate}");
        assert!((average(&[curve.clone(), curve.clone()])[80].1 - curve.points[80].1).abs() < 1e-12);
    }
}
