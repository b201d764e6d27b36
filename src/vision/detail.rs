//! A detail of the image about a suspect, as a person would look at it: some millimetres square, a tenth of a millimetre a value.
//!
//! Patches of the unrolled rope (`patch`) hold means over half a millimetre, in which the thin bright rim of a burn, the bright dot in
//! a drop and the torn edge of a wire are gone. Details are cut out of the image itself, turned so that the wire runs straight down.

use super::appearance::{Appearance, GrayScale};
use super::evidence::blocks;
use super::expected_row::ExpectedRow;
use super::inspection_model::{AlignedView, Beside};
use super::surface::StrandSpan;
use super::surface_map::{SurfaceMap, whole};
use super::wide::wide;

/// Rope between two rows, and between two columns, in mm.
const STEP_MM: f64 = 0.1;
/// Values of every place: gray, and its deviation from what is expected.
pub const LAYERS: usize = 2;
/// Gray bins that count 1.
const GRAY_BINS: f32 = 16.0;
/// Gray bins of deviation that count 1.
const DEVIATION_BINS: f32 = 4.0;

/// Cuts details out of the image of a stretch in one view, and of what is beside it.
pub struct Details<'a> {
    gray: &'a Appearance,
    /// Rows along the wire, and columns across it.
    side: usize,
    /// What comes before, the stretch itself, and what comes after.
    stretches: Beside<'a>,
    /// The same, as soon as one is looked at.
    parts: [Option<Part<'a>>; 3],
    row: ExpectedRow,
    /// What is expected of the columns of a line; NaN where nothing is.
    expected: Vec<f32>,
    /// `[(row * side + column) * LAYERS + layer]`; 0 where there is no image, the line was lost or nothing is expected.
    values: Vec<f32>,
}

/// A stretch, ready to be looked at.
struct Part<'a> {
    aligned: AlignedView<'a>,
    scale: GrayScale,
    map: SurfaceMap<'a>,
    /// Middle line of every block.
    middles: Vec<usize>,
}

/// The stretch itself among the parts.
const ITSELF: usize = 1;

/// Where a place is in the image.
#[derive(Debug, Clone, Copy)]
struct Spot {
    line: usize,
    column: f32,
    /// Columns from the axis that it is farther on in the next line.
    slope_px: f32,
    axis_px: f32,
}

impl<'a> Part<'a> {
    fn new(aligned: AlignedView<'a>) -> Self {
        let AlignedView { rope, camera, view, block_lines, .. } = aligned;
        Self {
            aligned,
            scale: GrayScale::new(&view.image, &view.axis_px, camera.px_per_mm * rope.diameter_mm() / 2.0),
            map: aligned.surface_map(),
            middles: blocks(view.image.lines(), block_lines).map(|(_, middle)| middle).collect(),
        }
    }

    fn spot(&mut self, block: usize, strand: usize, place: usize) -> Option<Spot> {
        let line = *self.middles.get(block)?;
        let axis_px = self.aligned.view.axis_px[line];
        let (mut columns, mut slopes, mut pixels) = (0.0, 0.0, 0.0);
        self.map.for_each_run_of(
            line,
            axis_px,
            |span| span.strand == strand,
            |run| {
                for ((column, &at), &slope_px) in (run.from..).zip(run.places).zip(run.slopes_px) {
                    if at as usize == place {
                        columns += column as f32;
                        slopes += slope_px;
                        pixels += 1.0;
                    }
                }
            },
        );
        (pixels > 0.0).then(|| Spot { line, column: columns / pixels, slope_px: slopes / pixels, axis_px })
    }
}

impl<'a> Details<'a> {
    /// For a stretch as one view sees it, between what comes before and after it if that is known, and what is expected of its gray; details
    /// have so many rows and columns.
    pub fn new(stretches: Beside<'a>, gray: &'a Appearance, side: usize) -> Self {
        let width_px = stretches[ITSELF].map_or(0, |aligned| aligned.view.image.width());
        Self {
            gray,
            side,
            stretches,
            parts: [None, None, None],
            row: ExpectedRow::new(width_px),
            expected: vec![f32::NAN; width_px],
            values: vec![0.0; side * side * LAYERS],
        }
    }

    /// The detail about a place of a strand in a block of the stretch; `None` where the image does not show it.
    pub fn about(&mut self, block: usize, strand: usize, place: usize) -> Option<&[f32]> {
        self.make_ready(ITSELF);
        let itself = self.parts[ITSELF].as_mut()?;
        let (spot, per_row) = (itself.spot(block, strand, place)?, STEP_MM / itself.aligned.pitch_mm);
        self.values.fill(0.0);
        let mut expects = None;
        for row in 0..self.side {
            let lines_on = ((row as f64 - self.side as f64 / 2.0) * per_row).round() as isize;
            let Some((part, line)) = self.part_of(spot.line as isize + lines_on) else { continue };
            self.make_ready(part);
            let Some(Part { aligned, map, middles, .. }) = &mut self.parts[part] else { continue };
            if !aligned.view.lost.within(line..line + 1).is_empty() {
                continue;
            }
            let block = (part, line / aligned.block_lines);
            let middle = middles[block.1];
            if expects != Some(block) {
                self.expected.fill(f32::NAN);
                let (row, expected) = (&mut self.row, &mut self.expected);
                // Strands that no row of the detail reaches are left out.
                let axis_px = aligned.view.axis_px[middle];
                let reach_px = self.side as f64 * STEP_MM * aligned.camera.px_per_mm;
                let at_px = f64::from(spot.column + lines_on as f32 * spot.slope_px - spot.axis_px);
                let shown = |span: &StrandSpan| span.from_px < at_px + reach_px && span.to_px > at_px - reach_px;
                map.for_each_run_of(middle, axis_px, shown, |run| {
                    row.look_up(self.gray, &run);
                    let n = run.cells.len();
                    expected[run.from..run.from + n].copy_from_slice(&row.expected[..n]);
                });
                expects = Some(block);
            }
            self.cut_row(row, (part, line, middle), lines_on as f32, spot);
        }
        Some(&self.values)
    }

    fn make_ready(&mut self, part: usize) {
        if self.parts[part].is_none() {
            self.parts[part] = self.stretches[part].map(Part::new);
        }
    }

    /// The part in which a line lies that is counted from the first of the stretch itself, and its number there.
    fn part_of(&self, line: isize) -> Option<(usize, usize)> {
        let lines = |part: usize| self.stretches[part].map_or(0, |aligned| aligned.view.image.lines()) as isize;
        if line < 0 {
            let line = line + lines(0);
            return (line >= 0).then_some((0, line as usize));
        }
        let after = line - lines(ITSELF);
        if after < 0 {
            return Some((ITSELF, line as usize));
        }
        (after < lines(2)).then_some((2, after as usize))
    }

    /// Cuts a row out of a line, so many lines on from the spot, where what is expected was looked up in the line `looked_up`.
    fn cut_row(&mut self, row: usize, (part, line, looked_up): (usize, usize, usize), lines_on: f32, spot: Spot) {
        let Some(Part { aligned, scale, .. }) = &self.parts[part] else { return };
        let view = aligned.view;
        let step_px = (STEP_MM * aligned.camera.px_per_mm) as f32;
        let moved_px = lines_on * spot.slope_px + view.axis_px[line] - spot.axis_px;
        let first = spot.column + moved_px - step_px * self.side as f32 / 2.0;
        let back_px = (line as f32 - looked_up as f32) * spot.slope_px + view.axis_px[line] - view.axis_px[looked_up];
        let row = &mut self.values[row * self.side * LAYERS..(row + 1) * self.side * LAYERS];
        let (pixels, scale, expected) = (view.image.line(line), scale.fine(line), &self.expected);
        wide(
            #[inline(always)]
            || cut(row, (first, step_px), back_px, (pixels, scale), expected),
        );
    }
}

/// Fills a row of a detail with the gray at columns `first`, `first + step_px`, ..., and with how far it is above what is expected `back_px`
/// columns before. Gray between two pixels lies between theirs.
#[inline(always)]
fn cut(
    row: &mut [f32],
    (first, step_px): (f32, f32),
    back_px: f32,
    (pixels, scale): (&[u8], &[f32; 256]),
    expected: &[f32],
) {
    let last = pixels.len() as f32 - 1.0;
    let between = |at: f32| (at >= 0.0 && at < last).then(|| (whole(at) as usize, at - whole(at) as i32 as f32));
    for (k, values) in row.as_chunks_mut::<LAYERS>().0.iter_mut().enumerate() {
        let at = first + k as f32 * step_px;
        let Some((left, share)) = between(at) else { continue };
        let [a, b] = [left, left + 1].map(|column| scale[usize::from(pixels[column])]);
        let gray = a + share * (b - a);
        values[0] = gray / GRAY_BINS - 1.0;
        if let Some((left, share)) = between(at - back_px) {
            let expected = expected[left] + share * (expected[left + 1] - expected[left]);
            values[1] = if expected.is_nan() { 0.0 } else { (gray - expected) / DEVIATION_BINS };
        }
    }
}
