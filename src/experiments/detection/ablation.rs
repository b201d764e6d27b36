//! From the paper's configuration towards ours, as far as models can be cut down: every step on the same rope, aligned anew.

use super::super::ExperimentError;
use super::super::page::{Page, number, percent};
use super::super::work::Work;
use super::figures;
use super::judged::Judged;
use super::rope::Trained;
use crate::pipeline::model_file::Model;

/// A simpler configuration: its name, factors that are kept (the gray value is the first), filters that are kept.
pub(super) struct Variant {
    pub name: &'static str,
    factors: usize,
    /// Index of the only filter; `None` for all.
    only_filter: Option<usize>,
}

/// From the paper's to ours. The third filter is 12 mm along one wire: the paper filters along the wire and states no length.
pub(super) const VARIANTS: [Variant; 2] = [
    Variant { name: "gray value, one filter", factors: 1, only_filter: Some(2) },
    Variant { name: "gray value, all filters", factors: 1, only_filter: None },
];
/// What ours is called beside them.
const OURS: &str = "further factors, all filters";

impl Variant {
    fn of(&self, model: &Model) -> Model {
        let mut model = model.clone();
        for view in &mut model.views {
            view.calibration.truncate(self.factors);
            for (n, filter) in view.calibration.iter_mut().flat_map(|filters| filters.iter_mut().enumerate()) {
                if self.only_filter.is_some_and(|only| only != n) {
                    *filter = None; // as if it were never asked
                }
            }
        }
        model
    }
}

/// Runs every variant and writes the section.
pub(super) fn report(rope: &Trained, ours: &Judged, work: &Work<'_>, page: &mut Page) -> Result<(), ExperimentError> {
    let mut runs: Vec<(&str, Judged)> = Vec::new();
    for variant in &VARIANTS {
        runs.push((variant.name, rope.inspect(&variant.of(&rope.model), work)?));
    }
    let all: Vec<(&str, &Judged)> =
        runs.iter().map(|(name, judged)| (*name, judged)).chain(std::iter::once((OURS, ours))).collect();
    page.heading("From the paper's configuration to ours");
    page.paragraph(
        "The same rope and model with parts taken away. *Gray value, one filter* is the nearest to the paper that switches allow: its \
         4-D density, region normalisation and one mean filter along the wire (12 mm; the paper names no length), but with our \
         alignment, our gray scale, and views that share what they see. So the gain over the paper itself is not shown by this \
         table. *Further factors* are changes across the wires, their grain and its slant, and missing shading; the gray value \
         itself is not judged beside them.",
    );
    page.figure("ablation", "Averaged ROC curves of the configurations", &[figures::averages(&all)], 1);
    page.table(
        [
            "configuration",
            "mean AUC of the views",
            "false lines for half of 75 % of the defects",
            "90 %",
            "95 %",
            "every one",
        ],
        all.iter().map(|(name, judged)| {
            let rate = |share| percent(judged.rate_for(share), 2);
            [(*name).into(), number(Some(judged.mean_auc()), 4), rate(0.75), rate(0.9), rate(0.95), rate(1.0)]
        }),
    );
    Ok(())
}
