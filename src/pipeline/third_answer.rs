//! Whether a model fits, as `summary.json` tells it: yes, no, or that it cannot tell.

use super::fit::ModelFit;
use serde::{Serialize, Serializer};

/// Writes whether a model fits with its third answer, which follows from the figures: readers of `summary.json` shall not have to know how.
pub(super) fn write<S: Serializer>(fit: &Option<ModelFit>, to: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Told<'a> {
        cannot_tell: bool,
        #[serde(flatten)]
        fit: &'a ModelFit,
    }
    fit.as_ref().map(|fit| Told { cannot_tell: fit.cannot_tell(), fit }).serialize(to)
}

#[cfg(test)]
mod tests {
    use crate::pipeline::results::Summary;
    use serde_json::{Value, json};

    #[test]
    fn a_summary_says_in_so_many_words_that_it_cannot_tell_and_summaries_without_the_words_are_read() {
        let fit = |rate: Value| {
            json!({ "fits": true, "budget_per_100m": 2.0, "false_defects_per_100m": rate, "at_least_per_100m": 1.1,
                "at_most_per_100m": 40.0, "metres": 4.0, "alarmed_share": 0.0, "views": [] })
        };
        for (rate, cannot_tell) in [(json!(9.0), true), (json!(3.0), false), (json!(null), true)] {
            let earlier = json!({ "ropescope_version": "0.1.0", "model": "m", "construction": "6x9", "lines": 1, "metres": 4.0,
                "covered_view_m": 4.0, "not_covered": [], "threshold": null, "defects": 0, "fit": fit(rate), "seconds": 1.0,
                "metres_per_second": 4.0, "notes": [] });
            let read: Summary = serde_json::from_value(earlier).unwrap();
            let written = serde_json::to_value(&read).unwrap();
            assert_eq!(written["fit"]["cannot_tell"], cannot_tell);
            assert_eq!(written["fit"]["fits"], true);
            assert_eq!(serde_json::from_value::<Summary>(written).unwrap(), read);
        }
    }
}
