//! Anomaly scores on the unrolled rope, summed along the course of the wires. [Wacker13, sec. 5: mean filter along the wire]
//!
//! Pixels fall into a grid of (block of lines, strand, place among its wires). A place keeps its number along a wire, so the
//! paper's filter along the wire course is a plain sum over blocks. Defects are 0.5 mm gaps and 150 mm missing wires: several
//! filter lengths and widths stand side by side.

use super::appearance::{Appearance, GrayScale};
use super::camera::Camera;
use super::estimates::Estimates;
use super::histogram::Histogram;
use super::residuals::{Factor, Residuals};
use super::rope::Rope;
use super::stretch::ViewStretch;
use super::surface_map::SurfaceMap;

/// Places per wire.
pub const PLACES_PER_WIRE: usize = 5;
/// Length of a block along the rope in mm: finer than the smallest gap of interest.
pub const BLOCK_MM: f64 = 0.5;

/// A filter: how far it reaches along the wire (mm) and across the wires (in wires).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Filter {
    /// Length along the rope in mm.
    pub length_mm: f64,
    /// Width in wires.
    pub wires: f64,
}

/// The filters. One wire wide for what happens to single wires, wider for what happens to the surface.
pub const FILTERS: [Filter; 6] = [
    Filter { length_mm: 1.5, wires: 1.0 },
    Filter { length_mm: 4.0, wires: 1.0 },
    Filter { length_mm: 12.0, wires: 1.0 },
    Filter { length_mm: 40.0, wires: 1.0 },
    Filter { length_mm: 8.0, wires: 3.0 },
    Filter { length_mm: 25.0, wires: 3.0 },
];

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
    sums: Vec<f32>,
    counts: Vec<f32>,
}

/// Lines per block for a line pitch.
pub fn block_lines(pitch_mm: f64) -> usize {
    (BLOCK_MM / pitch_mm).round().max(1.0) as usize
}

/// Adds the pixels of a stretch to a histogram of intact rope: gray bin by surface cell (eq. 18).
pub fn learn(rope: &Rope, camera: &Camera, estimates: &Estimates, view: &ViewStretch, histogram: &mut Histogram) {
    let half_width_px = camera.px_per_mm * rope.diameter_mm() / 2.0;
    let scale = GrayScale::new(&view.image, &view.axis_px, half_width_px);
    let mut map = SurfaceMap::new(rope, camera, estimates, view.image.width());
    for line in 0..view.image.lines() {
        let (row, bins) = (view.image.line(line), scale.line(line));
        map.for_each(line, view.axis_px[line], |point| {
            histogram.add(point.cell, usize::from(bins[usize::from(row[point.column])]));
        });
    }
}

impl Evidence {
    /// Scores a further factor of the appearance at every place of the unrolled rope.
    pub fn of_factor(residuals: &Residuals, factor: Factor, appearance: &Appearance, pitch_mm: f64) -> Self {
        let mut evidence = Self::empty(residuals.block_lines, residuals.blocks, residuals.strands, residuals.places);
        residuals.for_each(factor, pitch_mm, |at, cell, bin| {
            let score = appearance.score(cell, bin);
            if score.is_finite() {
                evidence.add(at, score); // once a place
            }
        });
        evidence
    }

    /// Empty evidence of so many blocks.
    pub(super) fn empty(block_lines: usize, blocks: usize, strands: usize, places: usize) -> Self {
        let len = blocks * strands * places;
        Self { block_lines, blocks, strands, places, sums: vec![0.0; len], counts: vec![0.0; len] }
    }

    /// Sets the sum of scores of a place, and the number of its pixels.
    pub(super) fn set(&mut self, at: usize, sum: f32, pixels: f32) {
        self.sums[at] = sum;
        self.counts[at] = pixels;
    }

    /// Adds the score of one pixel.
    #[inline]
    pub(super) fn add(&mut self, at: usize, score: f32) {
        self.sums[at] += score;
        self.counts[at] += 1.0;
    }

    /// Sums across so many wires about every place: the half of a filter that filters of one width share.
    pub fn across(&self, wires: f64) -> Across<'_> {
        let half_places = ((wires * PLACES_PER_WIRE as f64 - 1.0) / 2.0).round().max(0.0) as usize;
        let mut cells = vec![(0.0f32, 0.0f32); self.sums.len()];
        for strand in 0..self.blocks * self.strands {
            let at = strand * self.places;
            let (sums, counts) = (&self.sums[at..at + self.places], &self.counts[at..at + self.places]);
            // Places are cyclic.
            let (mut s, mut n) = (0.0, 0.0);
            for k in 0..=2 * half_places {
                let place = (k + self.places - half_places) % self.places;
                s += sums[place];
                n += counts[place];
            }
            for place in 0..self.places {
                cells[at + place] = (s, n);
                let leave = (place + self.places - half_places) % self.places;
                let enter = (place + half_places + 1) % self.places;
                s += sums[enter] - sums[leave];
                n += counts[enter] - counts[leave];
            }
        }
        Across { evidence: self, cells }
    }
}

/// Evidence summed across the wires, still to be summed along them.
#[derive(Debug)]
pub struct Across<'a> {
    evidence: &'a Evidence,
    cells: Vec<(f32, f32)>,
}

impl Across<'_> {
    /// Calls `each` with (index of the cell, sum of scores, number of pixels) for every cell, summed over `length_mm` about it.
    pub fn along(&self, length_mm: f64, pitch_mm: f64, mut each: impl FnMut(usize, f32, f32)) {
        let Evidence { block_lines, blocks, strands, places, .. } = *self.evidence;
        let half_blocks = ((length_mm / (block_lines as f64 * pitch_mm) - 1.0) / 2.0).round().max(0.0) as usize;
        let row = strands * places;
        let mut running = vec![(0.0f64, 0.0f64); row];
        for block in 0..blocks + half_blocks {
            if block < blocks {
                for (r, a) in running.iter_mut().zip(&self.cells[block * row..(block + 1) * row]) {
                    r.0 += f64::from(a.0);
                    r.1 += f64::from(a.1);
                }
            }
            if block > 2 * half_blocks {
                let gone = block - 2 * half_blocks - 1;
                for (r, a) in running.iter_mut().zip(&self.cells[gone * row..(gone + 1) * row]) {
                    r.0 -= f64::from(a.0);
                    r.1 -= f64::from(a.1);
                }
            }
            if block >= half_blocks {
                let middle = (block - half_blocks) * row;
                for (k, r) in running.iter().enumerate() {
                    each(middle + k, r.0 as f32, r.1 as f32);
                }
            }
        }
    }
}

/// Place of a pixel among the places of a strand.
#[inline]
pub fn place_of(wire_place: f32, places: usize) -> usize {
    ((wire_place + 0.5) * PLACES_PER_WIRE as f32) as usize % places
}
