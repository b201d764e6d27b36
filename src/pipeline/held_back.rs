//! Scores of intact rope as an inspection would give them: stretches, each judged by a calibration that has not seen it.
//!
//! Calibrating on a stretch makes its own scores lower than those of unseen rope: the highest of many filters is fitted to just
//! this stretch. A threshold from such scores lets ten times as many false defects pass as it promises.

use crate::vision::calibration::CalibrationSums;
use crate::vision::inspection_model::ViewAppearance;
use crate::vision::judging::Judging;
use crate::vision::kept_evidence::{KeptEvidence, KeptSeen};
use crate::vision::rope::Rope;
use crate::vision::stretch_scores::StretchScores;
use rayon::prelude::*;

/// Parts of the stretches, each of which is judged by the calibration of the others.
const PARTS: usize = 4;

/// What was seen of intact stretches in one view, and what calibrates by it.
pub(super) struct Held {
    /// `[stretch]`.
    seen: Vec<KeptSeen>,
    /// `[stretch][factor]`.
    sums: Vec<Vec<CalibrationSums>>,
}

impl Held {
    /// Filters every stretch once: every calibration needs the same sums.
    pub fn new(seen: Vec<KeptSeen>, pitch_mm: f64) -> Self {
        let of_factor = |evidence: &KeptEvidence| CalibrationSums::of(&evidence.unpacked(), pitch_mm);
        let of_stretch = |seen: &KeptSeen| seen.evidence().iter().map(of_factor).collect();
        let sums = seen.par_iter().map(of_stretch).collect();
        Self { seen, sums }
    }

    /// Calibrates a view on the stretches that are `wanted`. False if they are too few.
    pub fn calibrate(&self, view: &mut ViewAppearance, wanted: impl Fn(usize) -> bool + Clone) -> bool {
        view.calibrate(self.sums.iter().enumerate().filter(|(s, _)| wanted(*s)).map(|(_, sums)| &sums[..]))
    }
}

/// The scores of all stretches that every view has, `[stretch][view]`; a single one can only be judged by itself. `None` if there is
/// none, or too little in them to calibrate.
pub(super) fn cross_scored(
    views: &[ViewAppearance],
    held: &[Held],
    rope: &Rope,
    pitch_mm: f64,
    judging: &Judging,
) -> Option<Vec<Vec<Option<StretchScores>>>> {
    // A view that missed a stretch is out of step: then only as many as all have count.
    let stretches = held.iter().map(|held| held.seen.len()).min().filter(|&n| n > 0)?;
    let parts = PARTS.min(stretches);
    let of_view = |(view, held): (&ViewAppearance, &Held)| {
        let mut view = view.clone();
        let mut scores: Vec<Option<StretchScores>> = vec![None; stretches];
        for part in 0..parts {
            let others = |s: usize| s < stretches && (stretches == 1 || s % parts != part);
            if !held.calibrate(&mut view, others) {
                return None;
            }
            for s in (part..stretches).step_by(parts) {
                let kept = &held.seen[s];
                let seen = (&kept.unpacked(), [None, Some(kept.image(rope)), None]);
                scores[s] = Some(judging.score(&view, seen, rope.strands(), pitch_mm));
            }
        }
        Some(scores)
    };
    let mut of_views: Vec<_> = views.par_iter().zip(held).map(of_view).collect::<Option<_>>()?;
    let of_stretch = |s: usize| of_views.iter_mut().map(|scores: &mut Vec<_>| scores[s].take()).collect();
    let mut scored: Vec<Vec<Option<StretchScores>>> = (0..stretches).map(of_stretch).collect();
    scored.iter_mut().for_each(|views| judging.join(views, rope.strands()));
    Some(scored)
}
