//! How the gray of the unrolled rope deviates from what is expected, and what that says beside the single gray value.

use super::appearance::{Appearance, GrayScale};
use super::camera::Camera;
use super::estimates::Estimates;
use super::evidence::{self, Evidence};
use super::factor::Factor;
pub use super::gathering::Judged;
use super::gathering::{Changes, Gathering, Line, Sums};
use super::grain::Grain;
use super::histogram::region;
use super::rope::Rope;
use super::stretch::ViewStretch;
use super::surface_map::{PLACES_PER_WIRE, SurfaceMap};
use super::unrolled::{FINE_PER_WIRE, GraySums, Unrolled};
use super::wide::wide;
use std::ops::Range;

/// Cells of the grid that no pixel fell into.
pub(super) const UNSEEN: u32 = u32::MAX;

/// Deviations of a stretch in one view on the unrolled rope, `[(strand * blocks + block) * places + place]` as in [`Evidence`].
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
    /// Mean of that expected value; NaN where no pixel fell.
    expected: Vec<f32>,
    /// Mean changes from pixel to pixel; NaN where none could be compared.
    changes: Vec<Changes>,
    /// Surface cell that the place shows.
    surface_cell: Vec<u32>,
    /// Whether any place of a strand is in view, `[strand * blocks + block]`.
    in_view: Vec<bool>,
    /// The gray itself.
    unrolled: Unrolled,
}

/// One of so many lines of a block is read: neighbours, a tenth of a millimetre apart, show nearly the same. Measured: reading all of
/// them finds no more.
const EVERY_LINES: usize = 2;
/// Fewest places of a wire that tell its shading.
const LEAST_SHADED: f32 = 4.0;
/// Least shading that is expected of a wire, as a sum of squares of gray bins over its places: less is no relief.
const LEAST_RELIEF: f32 = 8.0;
/// Squared change of gray bins that the sensor's noise makes: fainter grain has no direction.
const NOISE: f32 = 0.1;

impl Residuals {
    /// Gathers a stretch: the evidence of the gray values themselves if they are `judged`, and what deviates from their expectation, in
    /// one pass. The grid has so many blocks more at either end, in which nothing is seen yet.
    pub fn gather(
        rope: &Rope,
        camera: &Camera,
        estimates: &Estimates,
        view: &ViewStretch,
        (gray, judged): (&Appearance, Judged),
        (block_lines, margin_blocks): (usize, usize),
        pitch_mm: f64,
    ) -> (Evidence, Self) {
        let (lines, width) = (view.image.lines(), view.image.width());
        let (strands, places) = (rope.strands(), rope.wires() * PLACES_PER_WIRE);
        let blocks = lines.div_ceil(block_lines) + 2 * margin_blocks;
        let mut evidence = Evidence::empty(block_lines, blocks, strands, places);
        let mut residuals = Self::empty(block_lines, blocks, strands, rope.wires());
        let scale = GrayScale::new(&view.image, &view.axis_px, camera.px_per_mm * rope.diameter_mm() / 2.0);
        let mut map = SurfaceMap::new(rope, camera, estimates, width);
        let mut grain = Grain::new(pitch_mm, width, block_lines);
        let mut gathering = Gathering::new(gray, judged, width, grain.lag_lines());
        let mut grays = vec![vec![0.0f32; width]; block_lines];
        // Empty between runs: what has pixels is taken after each, and nothing is summed without one.
        let mut sums = vec![Sums::default(); places];
        let mut fine = vec![GraySums::default(); rope.wires() * FINE_PER_WIRE];
        for (block, (of_block, middle)) in (margin_blocks..).zip(evidence::blocks(lines, block_lines)) {
            let moved_px = |from: usize, to: usize| view.axis_px[to] - view.axis_px[from];
            for (line, grays) in of_block.clone().zip(&mut grays) {
                let fine = scale.fine(line);
                grays.iter_mut().zip(view.image.line(line)).for_each(|(gray, &pixel)| *gray = fine[usize::from(pixel)]);
                grain.take(line, grays);
            }
            if !view.lost.within(evidence::lines_read(&of_block, pitch_mm)).is_empty() {
                evidence.lost[block] = true;
                continue;
            }
            let seen: Vec<Line<'_>> = of_block
                .zip(&grays)
                .step_by(if block_lines > EVERY_LINES { EVERY_LINES } else { 1 })
                .map(|(line, grays)| Line {
                    grays,
                    lines_on: line as f32 - middle as f32,
                    axis_moved_px: moved_px(middle, line),
                    compared: grain.compared(line).map(|pair| (pair, moved_px(line, pair.line_before))),
                })
                .collect();
            let compared = seen.iter().filter(|line| line.compared.is_some()).count() as f32;
            map.for_each_run(middle, view.axis_px[middle], |run| {
                wide(
                    #[inline(always)]
                    || gathering.add(&run, &view.blind, &seen, &mut sums, &mut fine),
                );
                residuals.unrolled.take(block, run.strand, &mut fine);
                residuals.in_view[run.strand * blocks + block] = true;
                let first = evidence.of(block, run.strand).start;
                for (at, sums) in (first..).zip(&mut sums).filter(|(_, sums)| sums.pixels > 0.0) {
                    let sums = std::mem::take(sums);
                    let of_lines = seen.len() as f32;
                    evidence.set(at, sums.score, sums.scored * of_lines, region(sums.cell as usize));
                    residuals.surface_cell[at] = sums.cell;
                    residuals.deviation[at] = sums.deviation / (sums.pixels * of_lines);
                    residuals.expected[at] = sums.expected / sums.pixels;
                    let mean = |sum: f32| sum / (sums.pixels * compared); // NaN without any
                    let Changes { along, across, slanted } = sums.changes;
                    residuals.changes[at] =
                        Changes { along: mean(along), across: mean(across), slanted: mean(slanted) };
                }
            });
        }
        (evidence, residuals)
    }

    fn empty(block_lines: usize, blocks: usize, strands: usize, wires: usize) -> Self {
        let places = wires * PLACES_PER_WIRE;
        let len = blocks * strands * places;
        Self {
            block_lines,
            blocks,
            strands,
            places,
            deviation: vec![f32::NAN; len],
            expected: vec![f32::NAN; len],
            changes: vec![Changes { along: f32::NAN, across: f32::NAN, slanted: f32::NAN }; len],
            surface_cell: vec![UNSEEN; len],
            in_view: vec![false; blocks * strands],
            unrolled: Unrolled::unseen(blocks, strands, wires),
        }
    }

    /// The gray that was seen, as a picture.
    pub fn into_unrolled(self) -> Unrolled {
        self.unrolled
    }

    /// Calls `each` with (index in the grid, surface cell, scaled factor) for every place where the factor can be told.
    pub fn for_each(&self, factor: Factor, mut each: impl FnMut(usize, usize, f32)) {
        self.for_each_strand(factor, |places, cells, values| {
            for ((place, &cell), &value) in places.zip(cells).zip(values) {
                if cell != UNSEEN && !value.is_nan() {
                    each(place, cell as usize, value);
                }
            }
        });
    }

    /// The same for all places of a strand in a block together: indices in the grid, surface cells (`UNSEEN` where no pixel fell),
    /// and scaled factors, NaN where they cannot be told.
    pub fn for_each_strand(&self, factor: Factor, mut each: impl FnMut(Range<usize>, &[u32], &[f32])) {
        let mut values = vec![f32::NAN; self.places];
        for (at, _) in self.in_view.iter().enumerate().filter(|(_, in_view)| **in_view) {
            let places = at * self.places..(at + 1) * self.places;
            let deviation = &self.deviation[places.clone()];
            let mut of_changes = |value: fn(&Changes) -> f32| {
                values.iter_mut().zip(&self.changes[places.clone()]).for_each(|(to, changes)| *to = value(changes));
            };
            match factor {
                Factor::Texture => of_changes(|c| c.along),
                Factor::Evenness => of_changes(|c| (c.along + NOISE) / (c.across + NOISE)),
                Factor::Slant => of_changes(|c| c.slanted / (c.along + c.across + 3.0 * NOISE)),
                Factor::Relief => relief(&self.expected[places.clone()], deviation, &mut values),
                Factor::Across => across(deviation, &mut values),
            }
            factor.scale(&mut values);
            each(places.clone(), &self.surface_cell[places], &values);
        }
    }
}

/// Missing share of the shading across every wire of a strand, the same for all of its places: 0 where it is as expected, 1 where
/// the wire looks flat.
fn relief(expected: &[f32], deviation: &[f32], values: &mut [f32]) {
    let wires = expected.chunks_exact(PLACES_PER_WIRE).zip(deviation.chunks_exact(PLACES_PER_WIRE));
    for ((expected, deviation), values) in wires.zip(values.chunks_exact_mut(PLACES_PER_WIRE)) {
        let (mut n, mut sum, mut squares, mut deviations, mut product) = (0.0f32, 0.0, 0.0, 0.0, 0.0);
        for (&expected, &deviates) in expected.iter().zip(deviation) {
            if !expected.is_nan() {
                n += 1.0;
                sum += expected;
                squares += expected * expected;
                deviations += deviates;
                product += expected * deviates;
            }
        }
        let shading = squares - sum * sum / n;
        let told = n >= LEAST_SHADED && shading > LEAST_RELIEF;
        values.fill(if told { -(product - sum * deviations / n) / shading } else { f32::NAN });
    }
}

/// Change to every place of a strand from those on either side; the first and the last are neighbours.
fn across(deviation: &[f32], values: &mut [f32]) {
    let last = deviation.len() - 1;
    let beside = deviation.iter().zip(&deviation[2..]);
    for (value, (here, (left, right))) in values[1..].iter_mut().zip(deviation[1..].iter().zip(beside)) {
        *value = change(*left, *here, *right);
    }
    values[0] = change(deviation[last], deviation[0], deviation[1]);
    values[last] = change(deviation[last - 1], deviation[last], deviation[0]);
}

/// Mean square of the two changes from a place to those on either side of it, or of the one that is known.
#[inline]
fn change(before: f32, here: f32, after: f32) -> f32 {
    let (before, after) = ((here - before) * (here - before), (after - here) * (after - here));
    let (one, other) = (if before.is_nan() { after } else { before }, if after.is_nan() { before } else { after });
    (one + other) / 2.0
}
