//! Scores of intact rope as an inspection would give them: stretches, each judged by a calibration that has not seen it.
//!
//! Calibrating on a stretch makes its own scores lower than those of unseen rope: the highest of many filters is fitted to just
//! this stretch. A threshold from such scores lets ten times as many false defects pass as it promises.

use super::folds::fold_of;
use crate::vision::calibration::CalibrationSums;
use crate::vision::inspection_model::{AlignedView, Beside, Seen, ViewAppearance};
use crate::vision::judging::Judging;
use crate::vision::kept_evidence::{KeptImage, KeptSeen};
use crate::vision::margins::MARGIN_BLOCKS;
use crate::vision::rope::Rope;
use crate::vision::stretch_scores::StretchScores;
use rayon::prelude::*;

/// Parts of the stretches, each of which is judged by the calibration of the others.
const PARTS: usize = 4;

/// What one view sees of the stretches, while they come.
pub(super) struct Holding<'a> {
    /// What the other folds taught, `[fold]`.
    by_others: &'a [ViewAppearance],
    /// By their numbers.
    kept: Vec<(usize, KeptSeen)>,
    /// The last one, whose end is still to be joined by the beginning of the next.
    waiting: Option<(usize, Seen, KeptImage)>,
}

impl<'a> Holding<'a> {
    pub fn new(by_others: &'a [ViewAppearance]) -> Self {
        Self { by_others, kept: Vec::new(), waiting: None }
    }

    /// Looks at a stretch, by its number: one more than that of the stretch which it follows.
    pub fn take(&mut self, number: usize, aligned: &AlignedView<'_>) {
        let seen = aligned.seen_by(&self.by_others[fold_of(number)], MARGIN_BLOCKS);
        self.put(number, seen, KeptImage::of(aligned));
    }

    fn put(&mut self, number: usize, mut seen: Seen, image: KeptImage) {
        if let Some((before, mut last, image)) = self.waiting.take() {
            if before + 1 == number {
                seen.follows(&mut last);
            }
            self.kept.push((before, KeptSeen::new(last, image)));
        }
        self.waiting = Some((number, seen, image));
    }

    /// All that came, by their numbers.
    pub fn finish(mut self) -> Vec<(usize, KeptSeen)> {
        let last = self.waiting.map(|(number, seen, image)| (number, KeptSeen::new(seen, image)));
        self.kept.extend(last);
        self.kept
    }
}

/// What was seen of intact stretches in one view, and what calibrates by it.
pub(super) struct Held {
    /// By their numbers.
    seen: Vec<(usize, KeptSeen)>,
    /// `[stretch][factor]`.
    sums: Vec<Vec<CalibrationSums>>,
}

impl Held {
    /// Filters every stretch once: every calibration needs the same sums.
    pub fn new(seen: Vec<(usize, KeptSeen)>, pitch_mm: f64) -> Self {
        let of_stretch = |(_, seen): &(usize, KeptSeen)| {
            let seen = seen.unpacked();
            CalibrationSums::of(&seen.evidence, seen.margin_blocks, pitch_mm)
        };
        let sums = seen.par_iter().map(of_stretch).collect();
        Self { seen, sums }
    }

    /// Number of stretches.
    pub fn stretches(&self) -> usize {
        self.seen.len()
    }

    /// The images of a stretch and of those beside it.
    fn images<'a>(&'a self, stretch: usize, rope: &'a Rope) -> Beside<'a> {
        let number = self.seen[stretch].0;
        [stretch.checked_sub(1), Some(stretch), Some(stretch + 1)].map(|at| {
            let (its, kept) = self.seen.get(at?)?;
            (its.abs_diff(number) <= 1).then(|| kept.image(rope))
        })
    }

    /// Calibrates a view on the stretches that are `wanted`. False if they are too few.
    pub fn calibrate(&self, view: &mut ViewAppearance, wanted: impl Fn(usize) -> bool + Clone) -> bool {
        view.calibrate(self.sums.iter().enumerate().filter(|(s, _)| wanted(*s)).map(|(_, sums)| &sums[..]))
    }
}

/// The scores of all stretches that every view has, with their margins, `[stretch][view]`; a single one can only be judged by itself.
/// `None` if there is none, or too little in them to calibrate.
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
                let seen = (&held.seen[s].1.unpacked(), held.images(s, rope));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::camera::Camera;
    use crate::vision::diameter::Diameters;
    use crate::vision::estimates::{Estimates, StretchEstimate};
    use crate::vision::image::GrayImage;
    use crate::vision::margins::tests::{says, seen};
    use crate::vision::rope::RopeDesign;
    use crate::vision::stretch::ViewStretch;

    const BLOCKS: usize = 40;
    const BLOCK_LINES: usize = 5;
    const PITCH_MM: f64 = 0.1;

    /// The image of a stretch, as bright as its number.
    fn image(number: usize) -> KeptImage {
        let estimates = Estimates {
            fused: StretchEstimate::default(),
            views: Vec::new(),
            knot_lines: 1,
            strand_phases_rad: Vec::new(),
            wire_phases_rad: Vec::new(),
            strand_spread_rad: None,
            diameters: Diameters::default(),
        };
        let image = GrayImage::new(1, vec![number as u8; BLOCKS * BLOCK_LINES]).unwrap();
        let view = ViewStretch { image, ..ViewStretch::default() };
        let (rope, camera) = (rope(), Camera { angle_rad: 0.0, distance_mm: 500.0, px_per_mm: 1.0 });
        let (rope, camera, estimates, view) = (&rope, &camera, &estimates, &view);
        let aligned = AlignedView { rope, camera, estimates, view, block_lines: BLOCK_LINES, pitch_mm: PITCH_MM };
        KeptImage::of(&aligned)
    }

    fn rope() -> Rope {
        let (strand_lay_mm, wire_lay_mm) = (Some(200.0), Some(70.0));
        let (strand_diameter_mm, wire_diameter_mm) = (None, None);
        RopeDesign {
            strands: 6,
            wires_per_strand: 9,
            diameter_mm: 32.0,
            strand_lay_mm,
            wire_lay_mm,
            strand_diameter_mm,
            wire_diameter_mm,
        }
        .validate()
        .unwrap()
    }

    #[test]
    fn stretches_are_judged_between_those_beside_them_and_no_others() {
        let mut holding = Holding::new(&[]);
        for number in [4, 5, 7] {
            holding.put(number, seen(100 * number, BLOCKS), image(number));
        }
        let held = Held::new(holding.finish(), PITCH_MM);
        // What the first and the last block of its evidence say, and how bright the images are that it is judged with.
        let about = |stretch: usize| {
            let says = says(&held.seen[stretch].1.unpacked(), 0);
            let bright = held.images(stretch, &rope()).map(|image| image.map(|image| image.view.image.pixels()[0]));
            ([says[0], says[says.len() - 1]], bright)
        };
        assert_eq!(about(0), ([None, Some(499.0 + MARGIN_BLOCKS as f32)], [None, Some(4), Some(5)]));
        assert_eq!(about(1), ([Some(440.0 - MARGIN_BLOCKS as f32), None], [Some(4), Some(5), None]));
        assert_eq!(about(2), ([None, None], [None, Some(7), None]));
    }
}
