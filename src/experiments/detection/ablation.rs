//! From the paper's configuration to ours: what every part adds, all on the same pass over the same rope.

use super::super::page::{Page, number, percent};
use super::figures;
use super::judged::Judged;
use super::ladder::LADDER;

/// Writes the section: one run a rung of the ladder.
pub(super) fn report(runs: &[Judged], page: &mut Page) {
    let all: Vec<(&str, &Judged)> = LADDER.iter().map(|rung| rung.name).zip(runs).collect();
    page.heading("From the paper's configuration to ours");
    page.paragraph(
        "Every row has one part more than the row above it. All are trained on the same rope and judge the same pass over it; each has a \
         threshold of its own, for the same budget, from the same held-back rope. *The paper's* is the gray value alone: its \
         likelihood at the surface point (eq. 18-20), divided by the mean likelihood of its region (eq. 21-22), averaged along one wire \
         (over 4 mm, the middle one of our filters; the paper states no length), in every view for itself, with one choice of bandwidths \
         for all ropes. Ours in all rows: the alignment, gray values divided by the light about them, and what makes defects of lines \
         over the threshold. *Further factors* are changes across the wires, their grain and its slant, and missing shading; the gray value \
         itself is not judged beside them.",
    );
    page.figure("ablation", "Averaged ROC curves of the configurations", &[figures::averages(&all)], 1);
    page.table(
        [
            "configuration",
            "mean AUC of the views",
            "false lines for half of 95 % of the defects",
            "for half of every one",
            "clear defects reported",
            "reported without cause",
            "rope to look at again",
        ],
        all.iter().map(|(name, judged)| {
            let rate = |share| percent(judged.rate_for(share), 2);
            let decided = judged.decisions.as_ref();
            [
                (*name).into(),
                number(Some(judged.mean_auc()), 4),
                rate(0.95),
                rate(1.0),
                decided.map_or("-".into(), |d| format!("{} of {}", d.found, d.clear_defects)),
                decided.map_or("-".into(), |d| d.false_defects.to_string()),
                decided.map_or("-".into(), |d| format!("{:.2} of {:.1} m", d.metres_to_reinspect, d.metres)),
            ]
        }),
    );
    page.paragraph(
        "Reported are defects over the threshold of the row: runs of lines, merged over views. Rope to look at again is that of these alarms \
         with 5 cm of context each, true ones included. The rates of false lines do not depend on the threshold.",
    );
}
