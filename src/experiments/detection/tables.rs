//! The tables of a report about detection.

use super::super::page::{Page, number, percent};
use super::figures::kinds;
use super::judged::Judged;
use crate::evaluate::lay_lengths::percentile;
use crate::evaluate::recall::DefectRecall;

/// Severities that make a class: from, below.
const SEVERITIES: [(f64, f64); 3] = [(0.0, 0.4), (0.4, 0.7), (0.7, 1.01)];

/// AUC and 50 % recovery of every view.
pub(super) fn views(page: &mut Page, judged: &Judged) {
    let rows = judged.curves.iter().map(|curve| {
        let half = |of: fn((f64, f64)) -> f64| percent(curve.half_recovered.map(of), 2);
        [curve.view.to_string(), number(Some(curve.auc), 4), half(|p| p.0), half(|p| p.1)]
    });
    page.table(["view", "AUC", "false lines at 50 % recovery", "defect lines found there"], rows);
    page.paragraph(&format!(
        "Mean AUC {:.4}. The paper's worst view needs 1.5 % false lines for its 50 % recovery.",
        judged.mean_auc()
    ));
}

/// The curves as numbers.
pub(super) fn roc_numbers(page: &mut Page, judged: &Judged) {
    let rows = judged.curves.iter().flat_map(|curve| {
        curve.points.iter().map(|(x, y)| [curve.view.to_string(), number(Some(*x), 6), number(Some(*y), 5)])
    });
    page.numbers("roc", ["view", "false_rate", "true_rate"], rows);
}

/// What thresholds cost.
pub(super) fn costs(page: &mut Page, judged: &Judged) {
    let rows = judged.costs.iter().map(|cost| {
        [
            cost.name.clone(),
            number(Some(cost.threshold), 2),
            percent(Some(cost.false_rate), 3),
            percent(Some(cost.far_false_rate), 3),
            percent(Some(cost.true_rate), 1),
            format!("{} of {}", cost.half_recovered, judged.defects.len()),
            format!(
                "{:.2} of {:.1} m ({:.0} %)",
                cost.reinspect_m,
                judged.metres,
                100.0 * cost.reinspect_m / judged.metres
            ),
        ]
    });
    page.table(
        [
            "threshold for",
            "line score",
            "false lines",
            "far false lines",
            "defect lines found",
            "defects half recovered",
            "rope to look at again",
        ],
        rows,
    );
}

/// What the program decided by itself.
pub(super) fn decisions(page: &mut Page, judged: &Judged) {
    let Some(d) = &judged.decisions else { return };
    let origin = judged.threshold_origin.as_deref().unwrap_or("not stated");
    page.paragraph(&format!(
        "Decided by the automatic threshold ({origin}), on all of the rope: {} defects reported; {} of {} clear defects among them, \
         {} reported without cause, which is {:.1} per 100 m; {:.2} of {:.1} m to look at again with 5 cm of context.",
        d.reported, d.found, d.clear_defects, d.false_defects, d.false_per_100m, d.metres_to_reinspect, d.metres
    ));
}

fn class_row(name: String, defects: &[&DefectRecall]) -> [String; 6] {
    let mut needed: Vec<f64> = defects.iter().map(|d| d.rate_needed).collect();
    needed.sort_by(f64::total_cmp);
    let median = (!needed.is_empty()).then(|| percentile(&needed, 50.0));
    let reported = defects.iter().filter(|d| d.reported == Some(true)).count();
    let at_paper = needed.iter().filter(|rate| **rate <= 0.015).count();
    let recovered: Vec<f64> = defects.iter().filter_map(|d| d.recovered).collect();
    let mean = (!recovered.is_empty()).then(|| recovered.iter().sum::<f64>() / recovered.len() as f64);
    [
        name,
        defects.len().to_string(),
        if defects.iter().any(|d| d.reported.is_some()) { reported.to_string() } else { "-".into() },
        percent(mean, 0),
        at_paper.to_string(),
        percent(median, 3),
    ]
}

fn class_table(page: &mut Page, head: &'static str, rows: impl IntoIterator<Item = [String; 6]>) {
    page.table(
        [
            head,
            "clear defects",
            "reported",
            "of their lines recovered on average",
            "half recovered at 1.5 % false lines",
            "median false lines needed",
        ],
        rows,
    );
}

/// Table by kind.
pub(super) fn by_kind(page: &mut Page, judged: &Judged) {
    let rows = kinds(judged).into_iter().map(|kind| {
        let defects: Vec<_> = judged.defects.iter().filter(|d| d.kind == kind).collect();
        class_row(kind.replace('_', " "), &defects)
    });
    class_table(page, "kind", rows);
}

/// Table by severity.
pub(super) fn by_severity(page: &mut Page, judged: &Judged) {
    let rows = SEVERITIES.map(|(from, below)| {
        let defects: Vec<_> = judged.defects.iter().filter(|d| d.severity >= from && d.severity < below).collect();
        class_row(format!("{from} to {}", below.min(1.0)), &defects)
    });
    class_table(page, "severity", rows);
}

/// What reported defects were taken for.
pub(super) fn suggestions(page: &mut Page, judged: &Judged) {
    let Some(kinds) = &judged.kinds else { return };
    page.paragraph(
        "What the reported ones of the clear defects were taken for, by fixed rules on gray, texture, size and outline; what shows none of \
         these clearly is called unclear. A broken wire is a gap, a lifted or loose wire protrudes if it stands beyond the outline of \
         the rope in some view, the others are changes of the surface.",
    );
    let rows = kinds.iter().map(|(kind, taken_for)| {
        let [gap, missing, protruding, surface, unclear] = taken_for.map(|n| n.to_string());
        [kind.replace('_', " "), gap, missing, protruding, surface, unclear]
    });
    page.table(["kind", "gap", "missing wire", "protruding wire", "surface change", "unclear"], rows);
}

/// Every defect as numbers.
pub(super) fn defect_numbers(page: &mut Page, judged: &Judged) {
    let rows = judged.defects.iter().map(|d| {
        [
            d.defect.to_string(),
            d.kind.clone(),
            number(Some(d.severity), 3),
            d.first_line.to_string(),
            number(Some(d.rate_needed), 6),
            number(d.recovered, 3),
            d.reported.map_or("-".into(), |r| r.to_string()),
        ]
    });
    page.numbers(
        "defects",
        ["defect", "kind", "severity", "first_line", "false_rate_needed", "recovered_share", "reported"],
        rows,
    );
}
