//! Anomaly scores on the unrolled rope, summed along the course of the wires. [Wacker13, sec. 5: mean filter along the wire]
//!
//! Pixels fall into a grid of (block of lines, strand, place among its wires). A place keeps its number along a wire, so the
//! paper's filter along the wire course is a plain sum over blocks. Defects are 0.5 mm gaps and 150 mm missing wires: several
//! filter lengths stand side by side.

use super::appearance::GrayScale;
use super::camera::Camera;
use super::estimates::Estimates;
use super::factor::{FACTOR_LENGTHS_MM, Factor};
use super::histogram::{Histogram, region};
use super::residuals::Residuals;
use super::rope::Rope;
use super::stretch::ViewStretch;
use super::surface_map::{PLACES_PER_WIRE, SurfaceMap};
use super::usual::Usual;
use std::ops::{Range, RangeInclusive};

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

/// The filters. The longer a filter, the less a single place may say: a broken end must not raise a centimetre of sound rope on
/// either side of it.
pub const FILTERS: [Filter; 4] = [
    Filter { length_mm: 1.5, cut: UNCUT },
    Filter { length_mm: 4.0, cut: UNCUT },
    Filter { length_mm: 12.0, cut: 2.0 },
    Filter { length_mm: 40.0, cut: 1.0 },
];
/// Width of all filters in wires.
const FILTER_WIRES: f64 = 1.0;
/// Region of places that no pixel fell into.
pub const UNSEEN: u8 = u8::MAX;
/// Reach about a place within which a pixel makes it seen: mm along the rope, wires across.
const SEEN_WITHIN: (f64, f64) = (4.0, 1.4);

/// What falls under a filter about every cell of a block.
#[derive(Debug, Clone, Copy)]
pub struct Filtered<'a> {
    /// Sums of scores.
    pub sums: &'a [f32],
    /// Numbers of pixels.
    pub pixels: &'a [f32],
    /// Region of the surface that the cell itself shows, or [`UNSEEN`].
    pub regions: &'a [u8],
}

impl Filtered<'_> {
    /// (sum, pixels, region) of every cell that is seen itself.
    pub fn seen(&self) -> impl Iterator<Item = (usize, f32, f32, usize)> {
        let cells = self.sums.iter().zip(self.pixels).zip(self.regions).enumerate();
        cells
            .filter(|(_, (_, region))| **region != UNSEEN)
            .map(|(k, ((&sum, &n), &region))| (k, sum, n, usize::from(region)))
    }
}

/// Sums of scores of a stretch in one view, `[(block * strands + strand) * places + place]`.
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
    /// Lengths of the filters that are asked in mm.
    lengths_mm: RangeInclusive<f64>,
    sums: Vec<f32>,
    counts: Vec<f32>,
    /// Region of the surface that the place shows in this view; [`UNSEEN`] where no pixel fell.
    regions: Vec<u8>,
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
        map.for_each(middle, view.axis_px[middle], |point| {
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
    /// Scores a further factor of the appearance at every place of the unrolled rope.
    pub fn of_factor(residuals: &Residuals, factor: Factor, usual: &Usual, pitch_mm: f64) -> Self {
        let (blocks, strands, places) = (residuals.blocks, residuals.strands, residuals.places);
        let mut evidence = Self::empty(residuals.block_lines, blocks, strands, places, FACTOR_LENGTHS_MM);
        residuals.for_each(factor, pitch_mm, |at, cell, value| {
            let score = usual.above(cell, value);
            if score.is_finite() {
                evidence.set(at, score, 1.0, region(cell)); // once a place
            }
        });
        evidence
    }

    /// Empty evidence of so many blocks.
    pub(super) fn empty(
        block_lines: usize,
        blocks: usize,
        strands: usize,
        places: usize,
        lengths_mm: RangeInclusive<f64>,
    ) -> Self {
        let len = blocks * strands * places;
        Self {
            block_lines,
            blocks,
            strands,
            places,
            lengths_mm,
            sums: vec![0.0; len],
            counts: vec![0.0; len],
            regions: vec![UNSEEN; len],
        }
    }

    /// Sets the sum of scores of a place, the number of its pixels, and the region that it shows.
    pub(super) fn set(&mut self, at: usize, sum: f32, pixels: f32, region: u8) {
        self.sums[at] = sum;
        self.counts[at] = pixels;
        self.regions[at] = region;
    }

    /// Calls `each` for every filter that is asked and every block with the number of the filter in [`FILTERS`], the index of the block's first cell, and what
    /// falls under the filter about each of the block's cells.
    pub fn filtered(&self, pitch_mm: f64, mut each: impl FnMut(usize, usize, Filtered<'_>)) {
        let pixels = self.across(&self.counts, FILTER_WIRES);
        let mut sums = Vec::new();
        let mut cut_at: Option<f32> = None;
        let asked = FILTERS.into_iter().enumerate().filter(|(_, filter)| self.lengths_mm.contains(&filter.length_mm));
        for (number, filter) in asked {
            // Filters of one cut stand side by side and share what they sum across the wires.
            if cut_at != Some(filter.cut) {
                let counted = self.sums.iter().zip(&self.counts).map(|(sum, n)| sum.min(filter.cut * n));
                sums = self.across(&counted.collect::<Vec<f32>>(), FILTER_WIRES);
            }
            cut_at = Some(filter.cut);
            self.along(&sums, &pixels, filter.length_mm, pitch_mm, |first, sums, pixels| {
                let regions = &self.regions[first..first + sums.len()];
                each(number, first, Filtered { sums, pixels, regions });
            });
        }
    }

    /// Whether any pixel fell so near to a place that the place counts as seen.
    pub fn seen(&self, pitch_mm: f64) -> Vec<bool> {
        let mut seen = vec![false; self.counts.len()];
        let across = self.across(&self.counts, SEEN_WITHIN.1);
        self.along(&across, &across, SEEN_WITHIN.0, pitch_mm, |first, pixels, _| {
            seen[first..first + pixels.len()].iter_mut().zip(pixels).for_each(|(seen, &n)| *seen = n > 0.0);
        });
        seen
    }

    /// Sums across so many wires about every place.
    fn across(&self, values: &[f32], wires: f64) -> Vec<f32> {
        let half_places = ((wires * PLACES_PER_WIRE as f64 - 1.0) / 2.0).round().max(0.0) as usize;
        let mut summed = vec![0.0f32; values.len()];
        let mut row = vec![0.0f32; self.places + 2 * half_places];
        for (from, to) in values.chunks_exact(self.places).zip(summed.chunks_exact_mut(self.places)) {
            if from.iter().fold(0, |bits, value| bits | value.to_bits()) == 0 {
                continue; // half of the strands are on the other side
            }
            // Places are cyclic.
            let (before, rest) = row.split_at_mut(half_places);
            let (middle, after) = rest.split_at_mut(self.places);
            before.copy_from_slice(&from[self.places - half_places..]);
            middle.copy_from_slice(from);
            after.copy_from_slice(&from[..half_places]);
            for shift in 0..=2 * half_places {
                to.iter_mut().zip(&row[shift..]).for_each(|(sum, value)| *sum += value);
            }
        }
        summed
    }

    /// Sums two tables along the rope and calls `each` with them block by block.
    fn along(
        &self,
        of_sums: &[f32],
        of_pixels: &[f32],
        length_mm: f64,
        pitch_mm: f64,
        mut each: impl FnMut(usize, &[f32], &[f32]),
    ) {
        let half_blocks = ((length_mm / (self.block_lines as f64 * pitch_mm) - 1.0) / 2.0).round().max(0.0) as usize;
        let row = self.strands * self.places;
        let mut sums = vec![0.0f32; row];
        let mut pixels = vec![0.0f32; row];
        for block in 0..self.blocks + half_blocks {
            let cells = |block: usize| block * row..(block + 1) * row;
            if block < self.blocks {
                sums.iter_mut().zip(&of_sums[cells(block)]).for_each(|(sum, new)| *sum += new);
                pixels.iter_mut().zip(&of_pixels[cells(block)]).for_each(|(sum, new)| *sum += new);
            }
            if let Some(gone) = block.checked_sub(2 * half_blocks + 1) {
                sums.iter_mut().zip(&of_sums[cells(gone)]).for_each(|(sum, old)| *sum -= old);
                pixels.iter_mut().zip(&of_pixels[cells(gone)]).for_each(|(sum, old)| *sum -= old);
            }
            if let Some(middle) = block.checked_sub(half_blocks) {
                each(middle * row, &sums, &pixels);
            }
        }
    }
}
