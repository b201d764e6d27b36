//! How the gray of the unrolled rope deviates from what is expected, and what that says beside the single gray value.
//!
//! Dirt and oil change gray values over long stretches without being defects; broken ends, pits and burns change them over a
//! millimetre. Further factors of the appearance model therefore look along the wire: the contrast of a place against its own
//! wire before and behind it, the roughness of the gray there, and its texture pixel by pixel. All are judged like the gray
//! itself: by how likely they are on intact rope at that surface point.

use super::appearance::{Appearance, GrayScale};
use super::camera::Camera;
use super::estimates::Estimates;
use super::evidence::Evidence;
use super::histogram::GRAY_BINS;
use super::rope::Rope;
use super::stretch::ViewStretch;
use super::surface_map::{PLACES_PER_WIRE, SurfaceMap, whole};

/// Cells of the grid that no pixel fell into.
const UNSEEN: u32 = u32::MAX;

/// Deviations of a stretch in one view on the unrolled rope, `[(strand * places + place) * blocks + block]`: everything that is
/// judged runs along a wire, so neighbours along it lie side by side in memory.
#[derive(Debug, Clone)]
pub struct Residuals {
    /// Lines per block.
    pub block_lines: usize,
    /// Blocks of the stretch.
    pub blocks: usize,
    /// Strands.
    pub strands: usize,
    /// Places per strand.
    pub places: usize,
    /// Mean deviation of the gray bin from its expected value; NaN where no pixel fell.
    deviation: Vec<f32>,
    /// Mean squared change of the pixels along the wire; NaN where none could be compared.
    texture: Vec<f32>,
    /// Surface cell that the place shows.
    surface_cell: Vec<u32>,
}

/// Sums over the pixels of one place in one block, side by side in memory: every pixel adds to all of them.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    score: f32,
    scored: f32,
    deviation: f32,
    expected: f32,
    change: f32,
    changes: f32,
    cell: u32,
}

/// What is judged of a place, beside its gray.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Factor {
    /// Difference of a place from its own wire, some millimetres before and behind.
    Contrast,
    /// Change of the deviation from block to block, averaged over a few millimetres.
    Roughness,
    /// Grain along the wire, pixel by pixel, averaged over a place: pits and scratches of a wire that is neither darker nor
    /// brighter for them.
    Texture,
}

/// Distance along the wire over which grain is compared in mm: pits and scratches are about as large.
const GRAIN_MM: f64 = 0.3;
/// One of so many lines is compared: neighbours show the same grain.
const GRAIN_EVERY: usize = 2;

impl Factor {
    /// Anomaly score of a bin of the factor: 0 on average over intact rope, 1 is one standard deviation.
    ///
    /// Long weak damage moves the grain of many places a little. Their deviations with sign add up to more than their
    /// surprises, and a wire that is smoother than usual is not damaged.
    pub fn score(self, appearance: &Appearance, cell: usize, bin: u8) -> f32 {
        match self {
            Self::Contrast | Self::Roughness => appearance.score(cell, bin),
            Self::Texture => appearance.above(cell, bin),
        }
    }
}

impl Residuals {
    /// Gathers a stretch: the evidence of the gray values themselves, and what deviates from their expectation, in one pass.
    pub fn gather(
        rope: &Rope,
        camera: &Camera,
        estimates: &Estimates,
        view: &ViewStretch,
        gray: &Appearance,
        block_lines: usize,
        pitch_mm: f64,
    ) -> (Evidence, Self) {
        let lines = view.image.lines();
        let (strands, places) = (rope.strands(), rope.wires() * PLACES_PER_WIRE);
        let blocks = lines.div_ceil(block_lines);
        let mut sums = vec![Sums::default(); blocks * strands * places];
        let mut evidence = Evidence::empty(block_lines, blocks, strands, places);
        let scale = GrayScale::new(&view.image, &view.axis_px, camera.px_per_mm * rope.diameter_mm() / 2.0);
        let mut map = SurfaceMap::new(rope, camera, estimates, view.image.width());
        let grain_lines = ((GRAIN_MM / pitch_mm).round() as usize).max(1);
        let width = view.image.width();
        for line in 0..lines {
            let (row, bins, fine) = (view.image.line(line), scale.line(line), scale.fine(line));
            let compared = line.checked_sub(grain_lines).filter(|_| line % GRAIN_EVERY == 0);
            let past = compared.map(|past| (past, view.image.line(past), scale.fine(past)));
            let block = line / block_lines * strands;
            map.for_each(line, view.axis_px[line], |point| {
                let bin = bins[usize::from(row[point.column])];
                let sums = &mut sums[(block + point.strand) * places + point.place];
                let score = gray.score(point.cell, bin);
                if score.is_finite() {
                    sums.score += score;
                    sums.scored += 1.0;
                }
                let expected = gray.expected(point.cell);
                if expected.is_finite() {
                    sums.deviation += f32::from(bin) + 0.5 - expected;
                    sums.expected += 1.0;
                    sums.cell = point.cell as u32;
                    if let Some((past, past_row, past_fine)) = past {
                        let moved = view.axis_px[past] - view.axis_px[line] - grain_lines as f32 * point.slope_px;
                        let at = point.column as f32 + moved;
                        if at >= 0.0 && at < (width - 1) as f32 {
                            let gray = |column: usize| past_fine[usize::from(past_row[column])];
                            let column = whole(at) as usize;
                            let share = at - column as f32;
                            let before = gray(column) + share * (gray(column + 1) - gray(column));
                            let change = fine[usize::from(row[point.column])] - before;
                            sums.change += change * change;
                            sums.changes += 1.0;
                        }
                    }
                }
            });
        }
        let row = strands * places;
        let mut deviation = vec![f32::NAN; sums.len()];
        let mut surface_cell = vec![UNSEEN; sums.len()];
        let mut texture = vec![f32::NAN; sums.len()];
        for (at, sums) in sums.into_iter().enumerate() {
            evidence.set(at, sums.score, sums.scored);
            if sums.expected > 0.0 {
                let along = at % row * blocks + at / row;
                deviation[along] = sums.deviation / sums.expected;
                surface_cell[along] = sums.cell;
                if sums.changes > 0.0 {
                    texture[along] = sums.change / sums.changes;
                }
            }
        }
        (evidence, Self { block_lines, blocks, strands, places, deviation, texture, surface_cell })
    }

    /// Calls `each` with (index in the grid, surface cell, bin of the factor) for every place where the factor can be told.
    pub fn for_each(&self, factor: Factor, pitch_mm: f64, mut each: impl FnMut(usize, usize, u8)) {
        let row = self.strands * self.places;
        let block_mm = self.block_lines as f64 * pitch_mm;
        let blocks_of = |mm: f64| (mm / block_mm).round().max(1.0) as usize;
        for column in 0..row {
            let at = |block: usize| column * self.blocks + block;
            let deviation = &self.deviation[at(0)..at(self.blocks)];
            let running = match factor {
                Factor::Contrast => running_sums(deviation.iter().copied()),
                Factor::Roughness => {
                    let before = std::iter::once(&f32::NAN).chain(deviation);
                    running_sums(deviation.iter().zip(before).map(|(d, before)| (d - before) * (d - before)))
                }
                Factor::Texture => Vec::new(),
            };
            let mean = |from: usize, to: usize| {
                let (a, b) = (running[from.min(self.blocks)], running[to.min(self.blocks)]);
                if b.1 - a.1 >= 1.0 { (b.0 - a.0) / (b.1 - a.1) } else { f32::NAN }
            };
            for block in 0..self.blocks {
                if self.surface_cell[at(block)] == UNSEEN {
                    continue;
                }
                let bin = match factor {
                    Factor::Contrast => {
                        let (inner, gap, outer) = (blocks_of(0.5) / 2, blocks_of(2.0), blocks_of(7.0));
                        let here = mean(block.saturating_sub(inner), block + inner + 1);
                        let behind = mean(block.saturating_sub(outer), block.saturating_sub(gap));
                        let ahead = mean(block + gap + 1, block + outer + 1);
                        let around = match (behind.is_nan(), ahead.is_nan()) {
                            (false, false) => (behind + ahead) / 2.0,
                            (true, _) => ahead,
                            (_, true) => behind,
                        };
                        if (here - around).is_nan() {
                            continue;
                        }
                        ((here - around) * 1.6 + GRAY_BINS as f32 / 2.0).clamp(0.0, GRAY_BINS as f32 - 1.0)
                    }
                    Factor::Texture => {
                        let power = self.texture[at(block)];
                        if power.is_nan() {
                            continue;
                        }
                        ((power + 0.02).ln() * 4.0 + GRAY_BINS as f32 / 2.0).clamp(0.0, GRAY_BINS as f32 - 1.0)
                    }
                    Factor::Roughness => {
                        let reach = blocks_of(1.5);
                        let power = mean(block.saturating_sub(reach), block + reach + 1);
                        if power.is_nan() {
                            continue;
                        }
                        ((power + 0.01).ln() * 3.0 + GRAY_BINS as f32 / 2.0).clamp(0.0, GRAY_BINS as f32 - 1.0)
                    }
                };
                each(block * row + column, self.surface_cell[at(block)] as usize, bin as u8);
            }
        }
    }
}

/// Sum and number of the values before each, NaN counting as absent.
fn running_sums(values: impl Iterator<Item = f32>) -> Vec<(f32, f32)> {
    let add = |total: &mut (f32, f32), value: f32| {
        if !value.is_nan() {
            *total = (total.0 + value, total.1 + 1.0);
        }
        Some(*total)
    };
    std::iter::once((0.0, 0.0)).chain(values.scan((0.0, 0.0), add)).collect()
}
