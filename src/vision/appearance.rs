//! How intact rope looks at every point of its geometry, in one view. [Wacker13, sec. 4.2 and 5, eq. 18, 20-22]

use super::bandwidths::Bandwidths;
use super::histogram::{
    CELLS, DISTANCE_BINS, GRAY_BINS, Histogram, REGIONS, STRAND_BINS, Theta, WIRE_BINS, cell, region,
};
use super::image::GrayImage;
use super::surface_map::{whole, within};
use super::wide::wide;
use std::ops::Range;

/// Observations that a cell needs (after smoothing) before it is judged.
pub(super) const LEAST_OBSERVATIONS: f32 = 30.0;
/// epsilon of eq. 22, in units of a uniform density over gray.
const EPSILON: f32 = 0.05;
/// Observations that the mean of the cells around counts as when a cell's own mean is taken.
pub(super) const OBSERVATIONS_AROUND: f32 = 100.0;
/// Anomaly scores of single pixels and places are cut here: one of them proves little.
pub(super) const CUT: f32 = 5.0;

/// Lines over which the light is averaged before it is divided out: longer than any defect that must not be divided out with it.
pub const LIGHT_LINES: usize = 800;

/// Gray values normalised by the light of their neighbourhood, in bins: gray g at mean light m falls at g/(g + m).
///
/// The companding keeps dark valleys and bright highlights apart; a change of exposure moves nothing.
#[derive(Debug, Clone)]
pub struct GrayScale {
    /// `bins[line * 256 + gray]` would be large; the light is quantised instead, and only levels that occur have a table.
    tables: Vec<[u8; 256]>,
    /// The same, not rounded to bins.
    fine: Vec<[f32; 256]>,
    line_table: Vec<u8>,
}

/// Number of light levels that get their own table.
const LIGHTS: usize = 128;

/// Light of a level: they are spaced by equal ratios from 2 to 256.
fn light_of(level: f64) -> f64 {
    2.0 * 128f64.powf(level / (LIGHTS as f64 - 1.0))
}

impl GrayScale {
    /// Measures the light of every line about the rope axis, smoothed over [`LIGHT_LINES`]; black lines, which show nothing, say nothing
    /// of it.
    pub fn new(image: &GrayImage, axis_px: &[f32], half_width_px: f64) -> Self {
        let lines = image.lines();
        let mut sums = vec![(0.0f64, 0u32); lines + 1];
        for k in 0..lines {
            let line = image.line(k);
            let from = ((f64::from(axis_px[k]) - 0.7 * half_width_px).max(0.0) as usize).min(line.len());
            let to = ((f64::from(axis_px[k]) + 0.7 * half_width_px).max(0.0) as usize).clamp(from, line.len());
            let sum = wide(
                #[inline(always)]
                || line[from..to].iter().map(|&gray| u32::from(gray)).sum::<u32>(),
            );
            let (light, lit) = sums[k];
            sums[k + 1] = (light + f64::from(sum) / (to - from).max(1) as f64, lit + u32::from(sum > 0));
        }
        let half = LIGHT_LINES / 2;
        // From which light on each level but the first is the nearest one.
        let begins: [f64; LIGHTS - 1] = std::array::from_fn(|level| light_of(level as f64 + 0.5));
        let line_table: Vec<u8> = (0..lines)
            .map(|k| {
                let (from, to) = (k.saturating_sub(half), (k + half).min(lines));
                let light = (sums[to].0 - sums[from].0) / f64::from((sums[to].1 - sums[from].1).max(1));
                begins.partition_point(|&begin| begin <= light) as u8
            })
            .collect();
        let darkest = line_table.iter().copied().min().unwrap_or(0);
        let brightest = line_table.iter().copied().max().unwrap_or(0);
        let fine: Vec<[f32; 256]> = (darkest..=brightest)
            .map(|level| {
                let light = light_of(f64::from(level)) as f32;
                std::array::from_fn(|gray| GRAY_BINS as f32 * gray as f32 / (gray as f32 + light))
            })
            .collect();
        let tables = fine.iter().map(|fine| fine.map(|at| (at as u8).min(GRAY_BINS as u8 - 1))).collect();
        Self { tables, fine, line_table: line_table.into_iter().map(|level| level - darkest).collect() }
    }

    /// Table from gray values to places on the scale of bins for one line.
    #[inline]
    pub fn fine(&self, line: usize) -> &[f32; 256] {
        &self.fine[usize::from(self.line_table[line])]
    }

    /// Table from gray values to bins for one line.
    #[inline]
    pub fn line(&self, line: usize) -> &[u8; 256] {
        &self.tables[usize::from(self.line_table[line])]
    }
}

/// What the score of a gray value is. Higher is rarer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GrayScore {
    /// Minus the likelihood, divided by the mean likelihood of its region: eq. 21-22 as they stand.
    Likelihood,
    /// Minus its logarithm, by mean and spread of the region: 0 on average over intact rope, 1 is one standard deviation.
    Surprise,
}

/// What is looked up for every pixel: its normalised likelihood, as an anomaly score.
#[derive(Debug, Clone, PartialEq)]
pub struct Appearance {
    /// p(g|theta) of eq. 20, `likelihood[cell * GRAY_BINS + gray]`, in units of a uniform density; 0 in cells that were not seen.
    likelihood: Vec<f32>,
    /// Anomaly score of every cell and gray value; NaN in cells that were not seen often enough.
    score: Vec<f32>,
    /// Mean gray bin of every cell; NaN in cells that were not seen often enough.
    expected: Vec<f32>,
}

impl Appearance {
    /// Learns from the counts of intact rope.
    pub fn learn(histogram: &Histogram, bandwidths: Bandwidths) -> Self {
        Self::learn_scoring(histogram, bandwidths, GrayScore::Surprise)
    }

    /// The same with the scores that are asked for.
    pub fn learn_scoring(histogram: &Histogram, bandwidths: Bandwidths, gray_score: GrayScore) -> Self {
        let joint = histogram.smoothed(bandwidths);
        let mut likelihood = vec![0.0f32; CELLS * GRAY_BINS];
        for cell in 0..CELLS {
            let counts = joint.of_cell(cell);
            let marginal: f32 = counts.iter().sum(); // p(theta)
            if marginal >= LEAST_OBSERVATIONS {
                for (p, &c) in likelihood[cell * GRAY_BINS..(cell + 1) * GRAY_BINS].iter_mut().zip(counts) {
                    // eq. 20; half an observation in all keeps what was never seen possible.
                    *p = (c + 0.5 / GRAY_BINS as f32) / (marginal + 0.5) * GRAY_BINS as f32;
                }
            }
        }
        Self::from_likelihood(likelihood, histogram, gray_score)
    }

    /// Builds the scores from stored likelihoods and the counts they were learnt from.
    fn from_likelihood(likelihood: Vec<f32>, histogram: &Histogram, gray_score: GrayScore) -> Self {
        let mut score = vec![f32::NAN; CELLS * GRAY_BINS];
        for of_region in 0..REGIONS {
            let cells: Vec<usize> = (0..CELLS).filter(|&cell| usize::from(region(cell)) == of_region).collect();
            // eq. 21 in logarithms: where registration is poor, the density is broad and even intact rope is unlikely. The
            // paper divides by the region's mean likelihood; the region's mean and spread of the log-likelihood do the
            // same for sums of many pixels, which is what the filter along the wire forms.
            let (mut n, mut sum, mut squares, mut likelihoods) = (0.0f64, 0.0f64, 0.0f64, 0.0f64);
            for &cell in &cells {
                for (gray, &count) in histogram.of_cell(cell).iter().enumerate() {
                    let p = likelihood[cell * GRAY_BINS + gray];
                    if p > 0.0 && count > 0.0 {
                        let surprise = f64::from(-(p + EPSILON).ln());
                        n += f64::from(count);
                        sum += f64::from(count) * surprise;
                        squares += f64::from(count) * surprise * surprise;
                        likelihoods += f64::from(count) * f64::from(p);
                    }
                }
            }
            if n < f64::from(LEAST_OBSERVATIONS) {
                continue;
            }
            let mean = sum / n;
            let sd = (squares / n - mean * mean).max(1e-4).sqrt();
            for &cell in &cells {
                for gray in 0..GRAY_BINS {
                    let p = likelihood[cell * GRAY_BINS + gray];
                    if p > 0.0 {
                        score[cell * GRAY_BINS + gray] = match gray_score {
                            GrayScore::Likelihood => -p / (EPSILON + (likelihoods / n) as f32),
                            // eq. 22, as an anomaly: 0 on average over intact rope, 1 is one standard deviation.
                            GrayScore::Surprise => ((-(p + EPSILON).ln() - mean as f32) / sd as f32).min(CUT),
                        };
                    }
                }
            }
        }
        Self { expected: expected(&likelihood, histogram), likelihood, score }
    }

    /// Restores a model from its tables. `None` if their sizes are not those of this version.
    pub fn from_tables([likelihood, score, expected]: [Vec<f32>; 3]) -> Option<Self> {
        ([likelihood.len(), score.len(), expected.len()] == TABLES).then_some(Self { expected, likelihood, score })
    }

    /// The tables that [`Self::from_tables`] restores: likelihood, score and expected gray. Their lengths are [`TABLES`].
    pub fn tables(&self) -> [&[f32]; 3] {
        [&self.likelihood, &self.score, &self.expected]
    }

    /// Anomaly scores of all gray bins at a surface cell.
    #[inline]
    pub fn scores(&self, cell: usize) -> &[f32] {
        &self.score[cell * GRAY_BINS..(cell + 1) * GRAY_BINS]
    }

    /// The same of all cells and bins, `[cell * GRAY_BINS + bin]`.
    pub(super) fn score_table(&self) -> &[f32] {
        &self.score
    }

    /// Expected gray bin (middle of a bin is at + 0.5), mean of a surface cell; NaN where the model cannot tell.
    #[inline]
    pub fn expected(&self, cell: usize) -> f32 {
        self.expected[cell]
    }

    /// The same of cells side by side.
    pub(super) fn expected_cells(&self, cells: Range<usize>) -> &[f32] {
        &self.expected[cells]
    }

    /// Expected gray bin at a surface point of that cell, between the middles of the cells about it: across a wire gray changes by
    /// several bins from cell to cell, and what is expected must not jump where they meet.
    #[inline]
    pub fn expected_at(&self, at: Theta, cell_of_it: usize) -> f32 {
        let mean = self.expected[cell_of_it];
        let (strand, a) = between_middles(at.strand, STRAND_BINS);
        let (wire, b) = between_middles(at.wire, WIRE_BINS);
        let (distance, c) = between_middles(at.distance, DISTANCE_BINS);
        let first = cell(strand, wire, distance);
        // Cells that were not seen do not differ from this one.
        let known = |cell: usize| if self.expected[cell].is_nan() { mean } else { self.expected[cell] };
        let across = |first: usize| known(first) + c * (known(first + 1) - known(first));
        let wires = |first: usize| {
            let (near, far) = (across(first), across(first + cell(0, 1, 0)));
            near + b * (far - near)
        };
        let (near, far) = (wires(first), wires(first + cell(1, 0, 0)));
        near + a * (far - near)
    }

    /// p(g|theta) over the gray bins at a surface cell, in units of a uniform density.
    pub fn likelihood(&self, cell: usize) -> &[f32] {
        &self.likelihood[cell * GRAY_BINS..(cell + 1) * GRAY_BINS]
    }
}

/// Floats of its tables.
pub const TABLES: [usize; 3] = [CELLS * GRAY_BINS, CELLS * GRAY_BINS, CELLS];

/// The two bins between whose middles a place lies, by the first of them, and how far it is on the way to the second.
#[inline(always)]
pub(super) fn between_middles(at: f32, bins: usize) -> (usize, f32) {
    let from_first = within(at - 0.5, bins as f32 - 1.001);
    let first = whole(from_first);
    (first as usize, from_first - first as f32)
}

/// Sum of the densities of bins, and their mean times it.
fn sums(densities: &[f32]) -> (f32, f32) {
    let mean: f32 = densities.iter().enumerate().map(|(bin, p)| (bin as f32 + 0.5) * p).sum();
    (densities.iter().sum(), mean)
}

/// A cell's own mean: the window of the density takes in the cells around, which are brighter or darker.
fn expected(likelihood: &[f32], histogram: &Histogram) -> Vec<f32> {
    let of_cell = |(cell, around): (usize, &[f32])| {
        let (total, mean) = sums(around);
        let (count, sum) = sums(histogram.of_cell(cell));
        (sum + OBSERVATIONS_AROUND * mean / total) / (count + OBSERVATIONS_AROUND) // NaN where total is 0
    };
    likelihood.chunks_exact(GRAY_BINS).enumerate().map(of_cell).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_often_seen_is_likely_and_what_never_was_is_anomalous() {
        let mut histogram = Histogram::default();
        for strand in 10..14 {
            for wire in 10..14 {
                for distance in 0..DISTANCE_BINS {
                    for k in 0..200 {
                        histogram.add(cell(strand, wire, distance), 14 + k % 5);
                    }
                }
            }
        }
        let appearance = Appearance::learn(&histogram, Bandwidths::FIXED);
        let at = cell(12, 12, 4);
        assert!(appearance.scores(at)[16] < 0.5);
        assert!(appearance.scores(at)[30] > 3.0);
        let unseen = cell(30, 20, 0); // no judgement
        assert!(appearance.scores(unseen)[16].is_nan());
        let total: f32 = appearance.likelihood(at).iter().sum::<f32>() / GRAY_BINS as f32;
        assert!((total - 1.0).abs() < 1e-3);
        // eq. 21-22 as they stand: -1 on average over what was learnt from, 0 for what never was seen.
        let literal = Appearance::learn_scoring(&histogram, Bandwidths::FIXED, GrayScore::Likelihood);
        let mean = (0..5).map(|k| literal.scores(at)[14 + k]).sum::<f32>() / 5.0;
        assert!((-1.3..-0.7).contains(&mean) && literal.scores(at)[30] > -0.01, "{mean}");
        assert_eq!(literal.likelihood(at), appearance.likelihood(at));
    }

    #[test]
    fn what_is_expected_goes_straight_from_the_middle_of_a_cell_to_the_next() {
        let mut histogram = Histogram::default();
        for wire in 10..14 {
            for distance in 0..DISTANCE_BINS {
                for _ in 0..4000 {
                    histogram.add(cell(12, wire, distance), 6 + 2 * distance);
                }
            }
        }
        let appearance = Appearance::learn(&histogram, Bandwidths::FIXED);
        let expected = |distance: f32| {
            let at = Theta { strand: 12.5, wire: 12.3, distance };
            appearance.expected_at(at, cell(12, 12, distance as usize))
        };
        for (distance, bin) in [(2.5, 10.5), (3.0, 11.5), (3.25, 12.0), (4.5, 14.5)] {
            assert!((expected(distance) - bin).abs() < 0.05, "{distance}: {} is not {bin}", expected(distance));
        }
        let unseen = Theta { strand: 30.5, wire: 20.5, distance: 0.5 };
        assert!(appearance.expected_at(unseen, cell(30, 20, 0)).is_nan());
    }

    #[test]
    fn exposure_changes_no_gray_bin() {
        let line: Vec<u8> = (0..100).map(|c| 20 + c as u8).collect();
        let brighter: Vec<u8> = line.iter().map(|&g| g * 2).collect();
        let bins = |line: Vec<u8>| {
            let image = GrayImage::new(100, line.clone()).unwrap();
            let scale = GrayScale::new(&image, &[50.0], 50.0);
            line.iter().map(|&g| scale.line(0)[usize::from(g)]).collect::<Vec<_>>()
        };
        for (a, b) in bins(line).into_iter().zip(bins(brighter)) {
            assert!(a.abs_diff(b) <= 1);
        }
    }
}
