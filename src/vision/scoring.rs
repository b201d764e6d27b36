//! Turns filtered evidence into one comparable score: how rare such evidence is on intact rope. [extends Wacker13, sec. 5]
//!
//! Every filter has its own noise, so each is calibrated on intact rope that was held back from learning: sums over many pixels
//! vary by chance (variance n) and by what pixels share, dirt and registration (variance shared * n^2). The upper tail of the
//! normalised sums is close to exponential; a score of 3 means "one in 10^3 such places on intact rope", and so on.

use super::evidence::{Evidence, FILTERS};

/// Fewest pixels under a filter, as a share of the most that fall under it: less is not judged.
const LEAST_SHARE: f32 = 0.25;

/// Calibration of one filter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FilterCalibration {
    /// Share of the variance that pixels have in common.
    pub shared: f64,
    /// Most pixels that fall under the filter (95th percentile).
    pub pixels: f64,
    /// Normalised sum that 1 in 100 places of intact rope exceeds.
    pub one_in_100: f64,
    /// Normalised sum that 1 in 1000 places exceeds.
    pub one_in_1000: f64,
}

impl FilterCalibration {
    #[inline]
    fn normalised(&self, sum: f32, pixels: f32) -> f32 {
        sum / (pixels + self.shared as f32 * pixels * pixels).sqrt()
    }

    /// Raises `highest` to the scores of sums: minus the decimal logarithm of how often intact rope exceeds them. Where too few
    /// pixels fell in, nothing is said.
    pub fn raise(&self, highest: &mut [f32], sums: &[f32], pixels: &[f32]) {
        let least = LEAST_SHARE * self.pixels as f32;
        let per_decade = 1.0 / (self.one_in_1000 - self.one_in_100).max(0.05) as f32;
        let from = 2.0 - self.one_in_100 as f32 * per_decade;
        for ((highest, &sum), &n) in highest.iter_mut().zip(sums).zip(pixels) {
            let score = from + self.normalised(sum, n) * per_decade;
            let judged = if n >= least { score } else { UNJUDGED };
            *highest = if judged > *highest { judged } else { *highest };
        }
    }
}

/// Gathers filtered sums of held-back intact rope.
#[derive(Debug, Clone)]
pub struct CalibrationSums {
    samples: Vec<Vec<(f32, f32)>>,
}

/// Fewest samples that calibrate a filter: two at the rarest level that is read off.
const LEAST_SAMPLES: usize = 2000;
/// Every how many places one is kept: neighbours tell nearly the same, and memory must stay small.
const SAMPLE_STRIDE: usize = 7;

impl Default for CalibrationSums {
    fn default() -> Self {
        Self { samples: vec![Vec::new(); FILTERS.len()] }
    }
}

impl CalibrationSums {
    /// Adds a stretch of intact rope.
    pub fn add(&mut self, evidence: &Evidence, pitch_mm: f64) {
        evidence.filtered(pitch_mm, |filter, first, sums, pixels| {
            let sampled = |(at, n): (usize, f32)| at % SAMPLE_STRIDE == 0 && n > 0.0;
            let cells = sums.iter().zip(pixels).enumerate();
            let sampled = cells.filter(|(k, (_, n))| sampled((first + k, **n)));
            self.samples[filter].extend(sampled.map(|(_, (&sum, &n))| (sum, n)));
        });
    }

    /// Calibrates every filter. `None` if there are too few samples.
    pub fn calibrate(mut self) -> Option<Vec<FilterCalibration>> {
        self.samples.iter_mut().map(calibrate).collect()
    }
}

fn calibrate(samples: &mut Vec<(f32, f32)>) -> Option<FilterCalibration> {
    if samples.len() < LEAST_SAMPLES {
        return None;
    }
    let quantile = |values: &mut Vec<f32>, share: f64| {
        let at = ((values.len() - 1) as f64 * share) as usize;
        f64::from(*values.select_nth_unstable_by(at, f32::total_cmp).1)
    };
    let pixels = quantile(&mut samples.iter().map(|s| s.1).collect(), 0.95);
    samples.retain(|s| s.1 >= LEAST_SHARE * pixels as f32);
    // Variance of the sums = n + shared n^2, by the quartiles, which defects do not reach.
    let mut means: Vec<f32> = samples.iter().map(|s| s.0 / s.1).collect();
    let spread = (quantile(&mut means, 0.75) - quantile(&mut means, 0.25)) / 1.349;
    let typical = quantile(&mut samples.iter().map(|s| s.1).collect(), 0.5);
    let shared = (spread * spread - 1.0 / typical).max(0.0);
    let mut calibration = FilterCalibration { shared, pixels, one_in_100: 0.0, one_in_1000: 0.0 };
    let mut z: Vec<f32> = samples.iter().map(|s| calibration.normalised(s.0, s.1)).collect();
    calibration.one_in_100 = quantile(&mut z, 0.99);
    calibration.one_in_1000 = quantile(&mut z, 0.999);
    Some(calibration)
}

/// Scores of a stretch in one view.
#[derive(Debug, Clone)]
pub struct StretchScores {
    /// Highest score under any filter, `[(block * strands + strand) * places + place]`; NaN where nothing was judged.
    pub cells: Vec<f32>,
    /// Whether any pixel of this view fell there, same order.
    pub seen: Vec<bool>,
    /// Highest score of every block; NaN where nothing was judged.
    pub blocks: Vec<f32>,
    /// Strand and place where that highest score stands.
    pub peaks: Vec<(usize, usize)>,
    /// Lines per block.
    pub block_lines: usize,
    /// Places per strand.
    pub places: usize,
}

/// Scores the evidence of a stretch, one entry a factor, under all filters: the rarest finding counts,
/// supported by what other factors find at the same place.
pub fn score(factors: &[(Evidence, &[FilterCalibration])], pitch_mm: f64) -> StretchScores {
    let Some((first, _)) = factors.first() else {
        return StretchScores {
            cells: Vec::new(),
            seen: Vec::new(),
            blocks: Vec::new(),
            peaks: Vec::new(),
            block_lines: 1,
            places: 1,
        };
    };
    let row = first.strands * first.places;
    let mut cells = vec![UNJUDGED; first.blocks * row];
    let mut support = vec![0.0f32; cells.len()];
    for (evidence, calibration) in factors {
        let mut factor = vec![UNJUDGED; cells.len()];
        evidence.filtered(pitch_mm, |filter, first, sums, pixels| {
            if let Some(calibration) = calibration.get(filter) {
                calibration.raise(&mut factor[first..first + row], sums, pixels);
            }
        });
        for ((cell, support), score) in cells.iter_mut().zip(&mut support).zip(factor) {
            // The lesser of the two supports the greater, as far as it is unusual itself.
            let (lesser, greater) = if score < *cell { (score, *cell) } else { (*cell, score) };
            *support += SUPPORT * (lesser - USUAL).max(0.0);
            *cell = greater;
        }
    }
    for (cell, support) in cells.iter_mut().zip(&support) {
        *cell = if *cell == UNJUDGED { f32::NAN } else { *cell + support };
    }
    let mut scores = StretchScores {
        cells,
        seen: first.seen(pitch_mm),
        blocks: Vec::new(),
        peaks: Vec::new(),
        block_lines: first.block_lines,
        places: first.places,
    };
    scores.find_peaks(row);
    scores
}

/// Score of cells that no filter judged, while scores are gathered.
const UNJUDGED: f32 = f32::NEG_INFINITY;
/// What an unusual finding of one factor adds to a greater one of another: factors share pixels, so they are not independent.
const SUPPORT: f32 = 0.5;
/// Score up to which a finding is usual: one place in ten has it.
const USUAL: f32 = 1.0;
/// What another view's score counts where this view sees the place, but too obliquely to judge as well.
const OTHER_VIEW_SHARE: f32 = 0.95;

/// Blocks to either side that a block's score is settled with.
const SETTLING_BLOCKS: usize = 6;

/// Half of every score, half of the mean about it: the highest of many places jumps from block to block by chance, defects last.
fn settled(blocks: &[f32]) -> Vec<f32> {
    let around = |k: usize| {
        let near = &blocks[k.saturating_sub(SETTLING_BLOCKS)..(k + SETTLING_BLOCKS + 1).min(blocks.len())];
        let (sum, n) = near.iter().filter(|s| s.is_finite()).fold((0.0, 0.0), |(s, n), b| (s + b, n + 1.0));
        sum / n
    };
    blocks.iter().enumerate().map(|(k, &score)| (score + around(k)) / 2.0).collect()
}

impl StretchScores {
    fn find_peaks(&mut self, row: usize) {
        self.blocks.clear();
        self.peaks.clear();
        for block in self.cells.chunks_exact(row) {
            let best = block.iter().enumerate().filter(|(_, s)| s.is_finite()).max_by(|a, b| a.1.total_cmp(b.1));
            self.blocks.push(best.map_or(f32::NAN, |(_, &s)| s));
            self.peaks.push(best.map_or((0, 0), |(at, _)| (at / self.places, at % self.places)));
        }
        self.blocks = settled(&self.blocks);
    }
}

/// Joins what several views say of the same places: each view takes over what another one scores higher, where it sees the
/// place itself. A break at the edge of one view is often in the middle of the next.
pub fn join_views(views: &mut [Option<StretchScores>], strands: usize) {
    let Some(len) = views.iter().flatten().map(|v| v.cells.len()).max() else { return };
    let mut best = vec![f32::NAN; len];
    for view in views.iter().flatten() {
        for (best, &score) in best.iter_mut().zip(&view.cells) {
            *best = best.max(score);
        }
    }
    for view in views.iter_mut().flatten() {
        for ((cell, &seen), &best) in view.cells.iter_mut().zip(&view.seen).zip(&best) {
            if seen && best.is_finite() {
                *cell = cell.max(OTHER_VIEW_SHARE * best);
            }
        }
        let row = strands * view.places;
        view.find_peaks(row);
    }
}
