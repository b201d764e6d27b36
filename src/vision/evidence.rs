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
    /// Scores every pixel of a stretch in one view and gathers the scores on the unrolled rope.
    pub fn gather(
        rope: &Rope,
        camera: &Camera,
        estimates: &Estimates,
        view: &ViewStretch,
        appearance: &Appearance,
        block_lines: usize,
    ) -> Self {
        let lines = view.image.lines();
        let (strands, places) = (rope.strands(), rope.wires() * PLACES_PER_WIRE);
        let blocks = lines.div_ceil(block_lines);
        let mut sums = vec![0.0f32; blocks * strands * places];
        let mut counts = vec![0.0f32; blocks * strands * places];
        let half_width_px = camera.px_per_mm * rope.diameter_mm() / 2.0;
        let scale = GrayScale::new(&view.image, &view.axis_px, half_width_px);
        let mut map = SurfaceMap::new(rope, camera, estimates, view.image.width());
        for line in 0..lines {
            let (row, bins) = (view.image.line(line), scale.line(line));
            let block = line / block_lines * strands;
            map.for_each(line, view.axis_px[line], |point| {
                let score = appearance.score(point.cell, bins[usize::from(row[point.column])]);
                if score.is_finite() {
                    let at = (block + point.strand) * places + place_of(point.wire_place, places);
                    sums[at] += score;
                    counts[at] += 1.0;
                }
            });
        }
        Self { block_lines, blocks, strands, places, sums, counts }
    }

    /// Scores a further factor of the appearance at every place of the unrolled rope.
    pub fn of_factor(residuals: &Residuals, factor: Factor, appearance: &Appearance, pitch_mm: f64) -> Self {
        let len = residuals.blocks * residuals.strands * residuals.places;
        let (mut sums, mut counts) = (vec![0.0f32; len], vec![0.0f32; len]);
        residuals.for_each(factor, pitch_mm, |at, cell, bin| {
            let score = appearance.score(cell, bin);
            if score.is_finite() {
                sums[at] = score;
                counts[at] = 1.0;
            }
        });
        Self {
            block_lines: residuals.block_lines,
            blocks: residuals.blocks,
            strands: residuals.strands,
            places: residuals.places,
            sums,
            counts,
        }
    }

    /// Sums over a filter about every cell: (sum of scores, number of pixels).
    pub fn filtered(&self, filter: Filter, pitch_mm: f64) -> Vec<(f32, f32)> {
        let half_blocks =
            ((filter.length_mm / (self.block_lines as f64 * pitch_mm) - 1.0) / 2.0).round().max(0.0) as usize;
        let half_places = ((filter.wires * PLACES_PER_WIRE as f64 - 1.0) / 2.0).round().max(0.0) as usize;
        let row = self.strands * self.places;
        // Across the wires first: places are cyclic.
        let mut across = vec![(0.0f32, 0.0f32); self.sums.len()];
        for strand in 0..self.blocks * self.strands {
            let at = strand * self.places;
            let (sums, counts) = (&self.sums[at..at + self.places], &self.counts[at..at + self.places]);
            let (mut s, mut n) = (0.0, 0.0);
            for k in 0..=2 * half_places {
                let place = (k + self.places - half_places) % self.places;
                s += sums[place];
                n += counts[place];
            }
            for place in 0..self.places {
                across[at + place] = (s, n);
                let leave = (place + self.places - half_places) % self.places;
                let enter = (place + half_places + 1) % self.places;
                s += sums[enter] - sums[leave];
                n += counts[enter] - counts[leave];
            }
        }
        // Then along the rope: a running sum per place.
        let mut out = vec![(0.0f32, 0.0f32); self.sums.len()];
        let mut running = vec![(0.0f64, 0.0f64); row];
        for block in 0..self.blocks + half_blocks {
            if block < self.blocks {
                for (r, a) in running.iter_mut().zip(&across[block * row..(block + 1) * row]) {
                    r.0 += f64::from(a.0);
                    r.1 += f64::from(a.1);
                }
            }
            if block > 2 * half_blocks {
                let gone = block - 2 * half_blocks - 1;
                for (r, a) in running.iter_mut().zip(&across[gone * row..(gone + 1) * row]) {
                    r.0 -= f64::from(a.0);
                    r.1 -= f64::from(a.1);
                }
            }
            if block >= half_blocks {
                let middle = block - half_blocks;
                for (o, r) in out[middle * row..(middle + 1) * row].iter_mut().zip(&running) {
                    *o = (r.0 as f32, r.1 as f32);
                }
            }
        }
        out
    }
}

/// Place of a pixel among the places of a strand.
#[inline]
pub fn place_of(wire_place: f32, places: usize) -> usize {
    ((wire_place + 0.5) * PLACES_PER_WIRE as f32) as usize % places
}
