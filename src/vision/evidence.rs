//! Anomaly scores on the unrolled rope.
//!
//! Pixels fall into a grid of (block of lines, strand, place among its wires). A place keeps its number along a wire, so the
//! paper's filter along the wire course is a plain sum over blocks (`filtering`). Defects are 0.5 mm gaps and 150 mm missing wires:
//! several filter lengths stand side by side.

use super::appearance::GrayScale;
use super::camera::Camera;
use super::estimates::Estimates;
use super::factor::Factor;
use super::grain::Grain;
use super::histogram::Histogram;
use super::lost_lines::LostLines;
use super::residuals::{self, Residuals};
use super::rope::Rope;
use super::stretch::ViewStretch;
use super::surface_map::SurfaceMap;
use super::usual::Usual;
use std::ops::Range;

/// Length of a block along the rope in mm: finer than the smallest gap of interest.
pub const BLOCK_MM: f64 = 0.5;

/// A filter along the wire course, one wire wide. [Wacker13, sec. 5]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Filter {
    /// Length along the rope in mm.
    pub length_mm: f64,
    /// Mean score that a place counts with at most.
    pub cut: f32,
}

/// No mean score comes near this.
const UNCUT: f32 = 1e3;

/// The filters. What is longer than the longest is seen block after block (`lasting`). A single place may say less in the longest:
/// a broken end must not raise a centimetre of sound rope on either side of it.
pub const FILTERS: [Filter; 3] = [
    Filter { length_mm: 1.5, cut: UNCUT },
    Filter { length_mm: 4.0, cut: UNCUT },
    Filter { length_mm: 12.0, cut: 2.0 },
];
/// Region of places that no pixel fell into.
pub const UNSEEN: u8 = u8::MAX;
/// Number of the gray value among the factors.
pub const GRAY: usize = 0;

/// Sums of the scores of every factor of a stretch in one view, `[(strand * blocks + block) * places + place]`: filters run strand by strand.
/// Factors are numbered: the gray value is [`GRAY`], further ones follow it.
#[derive(Debug, Clone)]
pub struct Evidence {
    /// Lines per block.
    pub block_lines: usize,
    /// Blocks of the stretch.
    pub blocks: usize,
    /// Strands.
    pub strands: usize,
    /// Places per strand.
    pub places: usize,
    pub(super) factors: Vec<FactorSums>,
    /// Pixels whose gray value has a score. Of further factors every place that is seen has one.
    pub(super) counts: Vec<f32>,
    /// Region of the surface that the place shows in this view; [`UNSEEN`] where no pixel fell.
    pub(super) regions: Vec<u8>,
    /// Blocks that were not judged because lines were lost. What another view says of them is not this view's.
    pub(super) lost: Vec<bool>,
}

/// What one factor says of a stretch in one view.
#[derive(Debug, Clone, Default)]
pub(super) struct FactorSums {
    /// Whether sums far below zero are as unusual as sums far above.
    pub both_ways: bool,
    /// Sums of scores; 0 where nothing is told.
    pub sums: Vec<f32>,
}

/// Lines per block for a line pitch.
pub fn block_lines(pitch_mm: f64) -> usize {
    (BLOCK_MM / pitch_mm).round().max(1.0) as usize
}

/// The blocks of so many lines, each with the line in its middle: there the surface is mapped, and the other lines of the block see
/// the same places a little to the side.
pub fn blocks(lines: usize, block_lines: usize) -> impl Iterator<Item = (Range<usize>, usize)> {
    (0..lines).step_by(block_lines).map(move |first| {
        let end = (first + block_lines).min(lines);
        (first..end, (first + end) / 2)
    })
}

/// The lines that a block is judged by, those before it among them with which its grain is compared. If one of them was lost, the block is
/// not judged.
pub fn lines_read(block: &Range<usize>, pitch_mm: f64) -> Range<usize> {
    block.start.saturating_sub(Grain::reach_lines(pitch_mm))..block.end
}

/// The lines of a stretch that are not judged because they or lines that they are judged with were lost, along the rope.
pub fn not_judged(lost: &LostLines, lines: usize, pitch_mm: f64) -> Vec<Range<usize>> {
    let mut ranges: Vec<Range<usize>> = Vec::new();
    if lost.is_empty() {
        return ranges;
    }
    for (block, _) in blocks(lines, block_lines(pitch_mm)) {
        if lost.within(lines_read(&block, pitch_mm)).is_empty() {
            continue;
        }
        match ranges.last_mut() {
            Some(last) if last.end == block.start => last.end = block.end,
            _ => ranges.push(block),
        }
    }
    ranges
}

/// Adds the pixels of a stretch to a histogram of intact rope: gray bin by surface cell (eq. 18).
pub fn learn(
    rope: &Rope,
    camera: &Camera,
    estimates: &Estimates,
    view: &ViewStretch,
    block_lines: usize,
    histogram: &mut Histogram,
) {
    let half_width_px = camera.px_per_mm * rope.diameter_mm() / 2.0;
    let scale = GrayScale::new(&view.image, &view.axis_px, half_width_px);
    let mut map = SurfaceMap::new(rope, camera, estimates, view.image.width());
    for (block, middle) in blocks(view.image.lines(), block_lines) {
        if !view.lost.within(block.clone()).is_empty() {
            continue;
        }
        map.for_each(middle, view.axis_px[middle], |point| {
            if view.blind.iter().any(|blind| blind.contains(&point.column)) {
                return;
            }
            for line in block.clone() {
                let axis_moved_px = view.axis_px[line] - view.axis_px[middle];
                let column = point.column_on(line as f32 - middle as f32, axis_moved_px);
                if let Some(&pixel) = view.image.line(line).get(column) {
                    histogram.add(point.cell, usize::from(scale.line(line)[usize::from(pixel)]));
                }
            }
        });
    }
}

impl Evidence {
    /// Scores a further factor of the appearance at every place of the unrolled rope, and adds it to the factors.
    pub(super) fn add_factor(&mut self, residuals: &Residuals, factor: Factor, usual: &Usual) {
        let mut sums = vec![0.0; self.regions.len()];
        residuals.for_each_strand(factor, |at, cells, values| {
            for (sum, (&cell, &value)) in sums[at].iter_mut().zip(cells.iter().zip(values)) {
                if cell == residuals::UNSEEN {
                    continue;
                }
                // What cannot be told says nothing, neither for nor against the place.
                let score = usual.above(cell as usize, value);
                *sum = if score.is_finite() { score } else { 0.0 };
            }
        });
        self.factors.push(FactorSums { both_ways: factor.both_ways(), sums });
    }

    /// Evidence of so many blocks in which nothing is seen, of the gray value alone.
    pub(super) fn empty(block_lines: usize, blocks: usize, strands: usize, places: usize) -> Self {
        let len = blocks * strands * places;
        Self {
            block_lines,
            blocks,
            strands,
            places,
            factors: vec![FactorSums { both_ways: false, sums: vec![0.0; len] }],
            counts: vec![0.0; len],
            regions: vec![UNSEEN; len],
            lost: vec![false; blocks],
        }
    }

    /// Sets the sum of gray scores of a place, the number of its pixels, and the region that it shows.
    pub(super) fn set(&mut self, at: usize, sum: f32, pixels: f32, region: u8) {
        self.factors[GRAY].sums[at] = sum;
        self.counts[at] = pixels;
        self.regions[at] = region;
    }
}
