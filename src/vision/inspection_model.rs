//! The appearance model of one view with all its factors, learnt and calibrated in three passes over intact rope.

use super::aligner::AlignedStretch;
use super::appearance::Appearance;
use super::calibration::{CalibrationSums, FilterCalibration};
use super::camera::Camera;
use super::estimates::Estimates;
use super::evidence::{self, Evidence, block_lines};
use super::factor::{FACTORS, Factor};
use super::histogram::Histogram;
use super::residuals::{Judged, Residuals};
use super::rope::Rope;
use super::scoring::{Weighed, score};
use super::stretch::ViewStretch;
use super::stretch_scores::StretchScores;
use super::surface_map::SurfaceMap;
use super::unrolled::Unrolled;
use super::usual::{Moments, Usual};

/// What one view learnt.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewAppearance {
    /// The gray value.
    pub gray: Appearance,
    /// The further factors, in the order of [`FACTORS`].
    pub further: Vec<Usual>,
    /// Calibration of the filters of the gray value and of every further factor, `[factor][filter]`: `None` for filters that
    /// too little rope was seen for, empty for factors that are not asked.
    pub calibration: Vec<Vec<Option<FilterCalibration>>>,
}

/// What a model sees of a stretch in one view.
#[derive(Debug, Clone)]
pub struct Seen {
    /// Evidence of the gray value and of every further factor.
    pub evidence: Evidence,
    /// The gray that was seen, as a picture.
    pub unrolled: Unrolled,
    /// Blocks at either end that belong to the stretches before and after it.
    pub margin_blocks: usize,
}

/// One view of an aligned stretch.
#[derive(Debug, Clone, Copy)]
pub struct AlignedView<'a> {
    /// The rope.
    pub rope: &'a Rope,
    /// The camera of the view.
    pub camera: &'a Camera,
    /// What was estimated of the stretch.
    pub estimates: &'a Estimates,
    /// The image with its axis.
    pub view: &'a ViewStretch,
    /// Lines per block of the unrolled rope.
    pub block_lines: usize,
    /// Rope per line in mm.
    pub pitch_mm: f64,
}

/// A stretch in one view, between those before and after it; `None` for what is not known.
pub type Beside<'a> = [Option<AlignedView<'a>>; 3];

impl<'a> AlignedView<'a> {
    /// View `v` of a stretch, `cameras[v]` its camera; `None` where it cannot be judged.
    pub fn of(
        rope: &'a Rope,
        stretch: &'a AlignedStretch,
        cameras: &'a [Camera],
        v: usize,
        pitch_mm: f64,
    ) -> Option<Self> {
        let view = &stretch.views[v];
        let estimates = stretch.estimates.as_ref().ok().filter(|_| view.usable())?;
        Some(Self { rope, camera: &cameras[v], estimates, view, block_lines: block_lines(pitch_mm), pitch_mm })
    }

    /// First pass: adds the gray values to the histogram of eq. 18.
    pub fn learn_gray(&self, histogram: &mut Histogram) {
        evidence::learn(self.rope, self.camera, self.estimates, self.view, self.block_lines, histogram);
    }

    /// Maps its lines to the surface of the rope.
    pub fn surface_map(&self) -> SurfaceMap<'a> {
        SurfaceMap::new(self.rope, self.camera, self.estimates, self.view.image.width())
    }

    fn gather(&self, gray: (&Appearance, Judged), margin_blocks: usize) -> (Evidence, Residuals) {
        let blocks = (self.block_lines, margin_blocks);
        Residuals::gather(self.rope, self.camera, self.estimates, self.view, gray, blocks, self.pitch_mm)
    }

    /// Second pass: adds the further factors, relative to the learnt gray.
    pub fn learn_factors(&self, gray: &Appearance, moments: &mut [Moments; FACTORS.len()]) {
        let (_, residuals) = self.gather((gray, Judged::Nothing), 0);
        for (factor, moments) in FACTORS.into_iter().zip(moments) {
            residuals.for_each(factor, |_, cell, value| moments.add(cell, value));
        }
    }

    /// Evidence of the gray value and of every further factor, with the gray itself. Where gray counts nothing, its evidence tells no
    /// more than what is seen. There is room for so many blocks of the stretches before and after it, see [`fill_between`](super::margins::fill_between).
    pub fn seen_by(&self, model: &ViewAppearance, margin_blocks: usize) -> Seen {
        let (mut evidence, residuals) = self.gather((&model.gray, model.judged()), margin_blocks);
        for (factor, usual) in FACTORS.into_iter().zip(&model.further) {
            evidence.add_factor(&residuals, factor, usual);
        }
        Seen { evidence, unrolled: residuals.into_unrolled(), margin_blocks }
    }
}

impl ViewAppearance {
    /// Joins what was learnt; it is not calibrated yet.
    pub fn new(gray: Appearance, further: &[Moments]) -> Self {
        let further = further.iter().map(Usual::learn).collect();
        Self { gray, further, calibration: Vec::new() }
    }

    /// Third pass: calibrates every filter of every factor on stretches of intact rope (`[stretch][factor]`).
    /// False if there were too few for the gray values.
    pub fn calibrate<'a>(&mut self, stretches: impl Iterator<Item = &'a [CalibrationSums]> + Clone) -> bool {
        let of_factor = |factor: usize| {
            let mut sums = CalibrationSums::default();
            stretches.clone().filter_map(|s| s.get(factor)).for_each(|stretch| sums.join(stretch));
            // Little rope may not tell what is usual of a further factor: then it is not asked.
            sums.calibrate().unwrap_or_default()
        };
        self.calibration = (0..=self.further.len()).map(of_factor).collect();
        self.calibration.first().is_some_and(|gray| !gray.is_empty())
    }

    /// Beside further factors the gray value does not count, see [`Factor::weight`]. It does before anything is calibrated, where there
    /// was too little rope to calibrate another, and in a model that is cut down to it, which is the paper's.
    pub(super) fn judged(&self) -> Judged {
        let further = self.calibration.iter().skip(1).any(|filters| !filters.is_empty());
        if further { Judged::Nothing } else { Judged::Gray }
    }

    /// Scores the evidence of a stretch: what its factors find.
    pub fn score(&self, evidence: &Evidence, pitch_mm: f64) -> StretchScores {
        let of_gray = if self.judged() == Judged::Gray { 1.0 } else { 0.0 };
        let weights = std::iter::once(of_gray).chain(FACTORS.into_iter().map(Factor::weight));
        let weighed = self.calibration.iter().zip(weights).map(|(calibration, weight)| Weighed { calibration, weight });
        score(evidence, &weighed.collect::<Vec<_>>(), pitch_mm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::bandwidths::Bandwidths;

    #[test]
    fn the_gray_value_counts_only_where_no_further_factor_is_calibrated() {
        let judged = |calibration: Vec<Vec<Option<FilterCalibration>>>| {
            let gray = Appearance::learn(&Histogram::default(), Bandwidths::FIXED);
            ViewAppearance { gray, further: Vec::new(), calibration }.judged()
        };
        assert_eq!(judged(Vec::new()), Judged::Gray);
        assert_eq!(judged(vec![vec![None]]), Judged::Gray);
        assert_eq!(judged(vec![vec![None], Vec::new()]), Judged::Gray);
        assert_eq!(judged(vec![vec![None], Vec::new(), vec![None]]), Judged::Nothing);
    }
}
