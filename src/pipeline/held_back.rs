//! Scores of intact rope as an inspection would give them: held-back stretches, each judged by a calibration that has not seen it.
//!
//! Calibrating on a stretch makes its own scores lower than those of unseen rope: the highest of many filters is fitted to just
//! this stretch. A threshold from such scores lets ten times as many false defects pass as it promises.

use crate::vision::evidence::Evidence;
use crate::vision::inspection_model::ViewAppearance;
use crate::vision::scoring::{StretchScores, join_views};
use rayon::prelude::*;

/// Parts of the stretches, each of which is judged by the calibration of the others.
const PARTS: usize = 4;

/// Evidence of held-back stretches: `[view][stretch][factor]`.
pub(super) type Held = Vec<Vec<Vec<Evidence>>>;

/// The scores of all stretches that every view has, `[stretch][view]`; a single one can only be judged by itself. `None` if there is
/// none, or too little in them to calibrate.
pub(super) fn cross_scored(
    views: &[ViewAppearance],
    held: &Held,
    strands: usize,
    pitch_mm: f64,
) -> Option<Vec<Vec<Option<StretchScores>>>> {
    // A view that missed a stretch is out of step: then only as many as all have count.
    let stretches = held.iter().map(Vec::len).min().filter(|&n| n > 0)?;
    let folds = PARTS.min(stretches);
    let mut scored: Vec<Vec<Option<StretchScores>>> = vec![vec![None; views.len()]; stretches];
    for fold in 0..folds {
        let of_fold = |stretch: &usize| stretch % folds == fold;
        let of_view: Vec<Vec<StretchScores>> = views
            .par_iter()
            .zip(held)
            .map(|(view, held)| {
                let mut view = view.clone();
                let others: Vec<&[Evidence]> =
                    (0..stretches).filter(|s| stretches == 1 || !of_fold(s)).map(|s| held[s].as_slice()).collect();
                let calibrated = view.calibrate(&others, pitch_mm);
                let judged = (0..stretches).filter(of_fold);
                calibrated.then(|| judged.map(|s| view.score(held[s].clone(), pitch_mm)).collect())
            })
            .collect::<Option<_>>()?;
        for (v, scores) in of_view.into_iter().enumerate() {
            for (stretch, scores) in (0..stretches).filter(of_fold).zip(scores) {
                scored[stretch][v] = Some(scores);
            }
        }
    }
    scored.iter_mut().for_each(|views| join_views(views, strands));
    Some(scored)
}
