//! Which parts of the judgement are made: all of them, as inspections do, or as few as the paper has.
//!
//! What a part adds shows when it is left out; then the same code runs with less.

use super::closer_look::{COARSEST_MM, look_closer};
use super::detail::Details;
use super::detail_network::SIDE;
use super::inspection_model::{Beside, Seen, ViewAppearance};
use super::known_tail::KnownTail;
use super::mean_filter::{MeanOf, mean_scores};
use super::residuals::Judged;
use super::scoring::score;
use super::stretch_scores::{StretchScores, join_views};

/// How the filters along the wires are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Filters {
    /// One, by its number in [`FILTERS`](super::evidence::FILTERS): its mean is the score.
    Mean(usize, MeanOf),
    /// All, each calibrated on intact rope.
    Calibrated,
}

/// The parts of a judgement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Judging {
    /// How filters are read.
    pub filters: Filters,
    /// Whether views share what they see of one place.
    pub joined: bool,
    /// Whether further factors are weighed and added up, or the gray value is judged alone.
    pub further: bool,
    /// Whether a block is judged with the blocks about it.
    pub settled: bool,
    /// Whether what lasts along the rope raises its scores.
    pub lasting: bool,
    /// Whether a closer look tells damage from what lies on the rope, where further factors find something.
    pub closer_look: bool,
}

impl Judging {
    /// Everything, as inspections have it.
    pub const WHOLE: Self = Self {
        filters: Filters::Calibrated,
        joined: true,
        further: true,
        settled: true,
        lasting: true,
        closer_look: true,
    };

    /// What is asked of a view: all that it learnt, or its gray values.
    pub fn cut(&self, learnt: &ViewAppearance) -> ViewAppearance {
        let mut view = learnt.clone();
        if !self.further {
            view.further.clear();
            view.calibration.truncate(1);
        }
        view
    }

    /// Scores what was seen of a stretch in one view, of so many strands; the image is that of the stretch and of those beside it.
    pub fn score(
        &self,
        view: &ViewAppearance,
        (seen, image): (&Seen, Beside<'_>),
        strands: usize,
        pitch_mm: f64,
    ) -> StretchScores {
        let Filters::Mean(filter, mean_of) = self.filters else {
            let mut scores = view.score(&seen.evidence, pitch_mm);
            if self.looks_closer(view, pitch_mm) {
                look_closer(&mut scores, seen, Details::new(image, &view.gray, SIDE), strands);
            }
            return scores;
        };
        let calibrated = view.calibration.first().and_then(|filters| filters.get(filter)).and_then(Option::as_ref);
        match calibrated {
            Some(calibration) => mean_scores(&seen.evidence, filter, calibration.pixels, mean_of, pitch_mm),
            None => score(&seen.evidence, &[], pitch_mm), // nothing can be told
        }
    }

    /// Whether it looks closer at what a view found. Little rope may not have taught the further factors.
    fn looks_closer(&self, view: &ViewAppearance, pitch_mm: f64) -> bool {
        let finds = self.closer_look && self.filters == Filters::Calibrated && view.judged() == Judged::Nothing;
        finds && pitch_mm <= COARSEST_MM
    }

    /// What is known beforehand of the tail of its scores.
    pub fn known_tail(&self, views: &[ViewAppearance], pitch_mm: f64) -> Option<KnownTail> {
        views.iter().all(|view| self.looks_closer(view, pitch_mm)).then_some(KnownTail::CLOSER_LOOK)
    }

    /// Makes the scores of all views those of the rope.
    pub fn join(&self, views: &mut [Option<StretchScores>], strands: usize) {
        if self.joined {
            join_views(views, strands);
        }
        if !self.settled {
            views.iter_mut().flatten().for_each(|view| view.blocks = view.highest());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::appearance::Appearance;
    use crate::vision::bandwidths::Bandwidths;
    use crate::vision::histogram::Histogram;
    use crate::vision::stretch_scores::Visibility;
    use crate::vision::usual::Moments;

    fn stretch(scores: &[f32]) -> StretchScores {
        let cells: Vec<f32> = scores.iter().flat_map(|&score| [0.0, score]).collect();
        StretchScores::new(cells.clone(), vec![Visibility::WHOLE; cells.len()], 2, 2, 5)
    }

    /// Scores of the first of two views: a single high one, lowered by the blocks about it unless that is left out.
    fn first(judging: Judging) -> Vec<f32> {
        let alone: Vec<f32> = (0..60).map(|block| if block == 30 { 8.0 } else { 1.0 }).collect();
        let mut views = [Some(stretch(&alone)), Some(stretch(&[4.0; 60]))];
        judging.join(&mut views, 1);
        views[0].take().unwrap().blocks
    }

    #[test]
    fn each_part_is_left_out_by_itself() {
        let bare = Judging { joined: false, settled: false, ..Judging::WHOLE };
        assert_eq!((first(bare)[30], first(bare)[10]), (8.0, 1.0));
        let joined = first(Judging { settled: false, ..Judging::WHOLE });
        assert!(joined[30] == 8.0 && (joined[10] - 3.8).abs() < 1e-6, "{}", joined[10]);
        let settled = first(Judging { joined: false, ..Judging::WHOLE });
        assert!(settled[30] < 5.0 && settled[10] == 1.0, "{}", settled[30]);
        let whole = first(Judging::WHOLE);
        assert!(whole[30] < joined[30] && whole[10] == joined[10]);
    }

    #[test]
    fn without_further_factors_a_view_knows_gray_values_only() {
        let gray = Appearance::learn(&Histogram::default(), Bandwidths::FIXED);
        let mut view = ViewAppearance::new(gray, &[Moments::default(), Moments::default()]);
        view.calibration = vec![vec![None]; 3];
        let cut = Judging { further: false, ..Judging::WHOLE }.cut(&view);
        assert_eq!((cut.further.len(), cut.calibration.len()), (0, 1));
        let whole = Judging::WHOLE.cut(&view);
        assert_eq!((whole.further.len(), whole.calibration.len()), (2, 3));
    }
}
