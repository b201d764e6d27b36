//! The charts of a report about detection.

use super::judged::Judged;
use crate::drawing::chart::{COLOURS, Chart, Mark, Scale};
use crate::evaluate::curves::LEAST_RATE;

/// The paper's false rate at its 50 % recovery.
const PAPER_RATE: f64 = 0.015;
/// Where defects stand that need fewer false lines than the chart shows.
const LEAST_NEEDED: f64 = 1e-5;

fn roc_chart(title: &str, marks: Vec<Mark>) -> Chart {
    let limit = Mark::Curve {
        points: vec![(PAPER_RATE, 0.0), (PAPER_RATE, 1.0)],
        colour: COLOURS[5],
        dashed: true,
        label: "1.5 %, the paper's".into(),
    };
    Chart {
        title: title.into(),
        x_label: "share of intact lines that alarm".into(),
        y_label: "share of defect lines that alarm".into(),
        horizontal: Scale::logarithmic(LEAST_RATE, 1.0),
        vertical: Scale::linear(0.0, 1.0),
        marks: std::iter::once(limit).chain(marks).collect(),
    }
}

/// ROC per view with the 50 % recovery, and averaged.
pub(super) fn roc(judged: &Judged) -> [Chart; 2] {
    let colour = |n: usize| COLOURS[n % COLOURS.len()];
    let curves = judged.curves.iter().enumerate().map(|(n, curve)| Mark::Curve {
        points: curve.points.clone(),
        colour: colour(n),
        dashed: false,
        label: format!("view {}, AUC {:.4}", curve.view, curve.auc),
    });
    let squares = judged.curves.iter().enumerate().map(|(n, curve)| Mark::Squares {
        points: curve.half_recovered.into_iter().collect(),
        colour: colour(n),
        label: String::new(),
    });
    let average = Mark::Curve {
        points: judged.average.clone(),
        colour: COLOURS[0],
        dashed: false,
        label: format!("mean of the views, AUC {:.4}", judged.mean_auc()),
    };
    [roc_chart("a  every view", curves.chain(squares).collect()), roc_chart("b  averaged", vec![average])]
}

/// Averaged curves of several configurations.
pub(super) fn averages(runs: &[(&str, &Judged)]) -> Chart {
    // The last is ours; the last colour is the limit's.
    let colours = COLOURS.len() - 1;
    let curves = runs.iter().rev().enumerate().rev().map(|(n, (name, judged))| Mark::Curve {
        points: judged.average.clone(),
        colour: COLOURS[n % colours],
        dashed: n >= colours,
        label: format!("{name}, AUC {:.4}", judged.mean_auc()),
    });
    roc_chart("averaged over the views", curves.collect())
}

/// False lines that every defect needs, over its kind and over its severity.
pub(super) fn defects(judged: &Judged) -> [Chart; 2] {
    let kinds = kinds(judged);
    let needed = |rate: f64| rate.max(LEAST_NEEDED);
    let by_kind: Vec<(f64, f64)> = judged
        .defects
        .iter()
        .filter_map(|d| Some((kinds.iter().position(|k| *k == d.kind)? as f64, needed(d.rate_needed))))
        .collect();
    let by_severity = judged.defects.iter().map(|d| (d.severity, needed(d.rate_needed))).collect();
    let limit = |from, to| Mark::Curve {
        points: vec![(from, PAPER_RATE), (to, PAPER_RATE)],
        colour: COLOURS[5],
        dashed: true,
        label: "1.5 %".into(),
    };
    let chart = |title: &str, x_label: &str, horizontal, ends: (f64, f64), points| Chart {
        title: title.into(),
        x_label: x_label.into(),
        y_label: "false lines needed".into(),
        horizontal,
        vertical: Scale::logarithmic(LEAST_NEEDED, 1.0),
        marks: vec![
            limit(ends.0, ends.1),
            Mark::Dots { points, colour: COLOURS[0], label: "a defect (lowest line: so many or fewer)".into() },
        ],
    };
    let names: Vec<String> = kinds.iter().map(|k| k.split('_').next().unwrap_or(k).to_owned()).collect();
    let last = kinds.len() as f64 - 0.5;
    [
        chart("by kind", "kind", Scale::names(names), (-0.5, last), by_kind),
        chart("by severity", "severity", Scale::linear(0.0, 1.0), (0.0, 1.0), by_severity),
    ]
}

/// The kinds that occur, in alphabetical order.
pub(super) fn kinds(judged: &Judged) -> Vec<&str> {
    let mut kinds: Vec<&str> = judged.defects.iter().map(|d| d.kind.as_str()).collect();
    kinds.sort_unstable();
    kinds.dedup();
    kinds
}
