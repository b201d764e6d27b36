//! The appearance model of one view with all its factors, learnt and calibrated in three passes over intact rope.

use super::appearance::Appearance;
use super::camera::Camera;
use super::estimates::Estimates;
use super::evidence::{self, Evidence};
use super::factor::FACTORS;
use super::histogram::{FACTOR_SIGMA_BINS, Histogram};
use super::residuals::Residuals;
use super::rope::Rope;
use super::scoring::{CalibrationSums, FilterCalibration, StretchScores, score};
use super::stretch::ViewStretch;
use super::surface_map::SurfaceMap;

/// One factor: its density given the surface point, and the calibration of its filters.
#[derive(Debug, Clone, PartialEq)]
pub struct LearntFactor {
    /// Density and scores.
    pub appearance: Appearance,
    /// Calibration of every filter, `None` for those that are not asked; empty until calibrated.
    pub calibration: Vec<Option<FilterCalibration>>,
}

/// What one view learnt: the gray value first, then [`FACTORS`].
#[derive(Debug, Clone, PartialEq)]
pub struct ViewAppearance {
    /// The factors.
    pub factors: Vec<LearntFactor>,
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

impl<'a> AlignedView<'a> {
    /// First pass: adds the gray values to the histogram of eq. 18.
    pub fn learn_gray(&self, histogram: &mut Histogram) {
        evidence::learn(self.rope, self.camera, self.estimates, self.view, self.block_lines, histogram);
    }

    /// Maps its lines to the surface of the rope.
    pub fn surface_map(&self) -> SurfaceMap<'a> {
        SurfaceMap::new(self.rope, self.camera, self.estimates, self.view.image.width())
    }

    fn gather(&self, gray: &Appearance) -> (Evidence, Residuals) {
        Residuals::gather(self.rope, self.camera, self.estimates, self.view, gray, self.block_lines, self.pitch_mm)
    }

    /// Second pass: adds the further factors, relative to the learnt gray, to their histograms.
    pub fn learn_factors(&self, gray: &Appearance, histograms: &mut [Histogram; FACTORS.len()]) {
        let (_, residuals) = self.gather(gray);
        for (factor, histogram) in FACTORS.into_iter().zip(histograms) {
            residuals.for_each(factor, self.pitch_mm, |_, cell, bin| histogram.add(cell, usize::from(bin)));
        }
    }

    /// Evidence of every factor.
    pub fn evidence(&self, model: &ViewAppearance) -> Vec<Evidence> {
        let Some((gray, factors)) = model.factors.split_first() else { return Vec::new() };
        let (evidence, residuals) = self.gather(&gray.appearance);
        let mut all = vec![evidence];
        let further = FACTORS.into_iter().zip(factors);
        all.extend(further.map(|(f, learnt)| Evidence::of_factor(&residuals, f, &learnt.appearance, self.pitch_mm)));
        all
    }
}

impl ViewAppearance {
    /// Joins the learnt factors; they are not calibrated yet.
    pub fn new(gray: Appearance, histograms: &[Histogram]) -> Self {
        let uncalibrated = |appearance| LearntFactor { appearance, calibration: Vec::new() };
        let further = histograms.iter().map(|histogram| Appearance::learn(histogram, FACTOR_SIGMA_BINS));
        Self { factors: std::iter::once(gray).chain(further).map(uncalibrated).collect() }
    }

    /// Third pass: calibrates every filter of every factor on stretches of intact rope (`[stretch][factor]`).
    /// False if there were too few for the gray values.
    pub fn calibrate<'a>(&mut self, stretches: impl Iterator<Item = &'a [CalibrationSums]> + Clone) -> bool {
        for (f, factor) in self.factors.iter_mut().enumerate() {
            let mut sums = CalibrationSums::default();
            stretches.clone().filter_map(|s| s.get(f)).for_each(|stretch| sums.join(stretch));
            // Little rope may not tell what is usual of a further factor: then it is not asked.
            factor.calibration = sums.calibrate().unwrap_or_default();
        }
        self.factors.first().is_some_and(|gray| !gray.calibration.is_empty())
    }

    /// Scores the evidence of a stretch.
    pub fn score(&self, evidence: Vec<Evidence>, pitch_mm: f64) -> StretchScores {
        let factors: Vec<_> = evidence.into_iter().zip(self.factors.iter().map(|f| &f.calibration[..])).collect();
        score(&factors, pitch_mm)
    }
}
