//! How the gray of the unrolled rope deviates from what is expected, and what that says beside the single gray value.

use super::appearance::{Appearance, GrayScale};
use super::camera::Camera;
use super::estimates::Estimates;
use super::evidence::{self, Evidence};
use super::factor::{Factor, GRAY_LENGTHS_MM};
use super::grain::{Compared, Grain};
use super::histogram::{GRAY_BINS, region};
use super::rope::Rope;
use super::stretch::ViewStretch;
use super::surface_map::{PLACES_PER_WIRE, SurfaceMap};

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
    /// Mean of that expected value; NaN where no pixel fell.
    expected: Vec<f32>,
    /// Mean squared change of the pixels along the wire; NaN where none could be compared.
    along: Vec<f32>,
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
    pixels: f32,
    along: f32,
    alongs: f32,
    cell: u32,
}

impl Sums {
    #[inline]
    fn add(&mut self, other: &Self) {
        self.score += other.score;
        self.scored += other.scored;
        self.deviation += other.deviation;
        self.expected += other.expected;
        self.pixels += other.pixels;
        self.along += other.along;
        self.alongs += other.alongs;
        self.cell = other.cell;
    }
}

/// A line of the block that is gathered.
struct Line<'a> {
    row: &'a [u8],
    fine: &'a [f32; 256],
    /// How far on it is from the line that was mapped, and how far the axis has moved since.
    lines_on: f32,
    axis_moved_px: f32,
    /// It and the line that it is compared with, if it is, and how far the axis moves from it to that one.
    compared: Option<(Compared<'a>, f32)>,
}

/// Fewest places of a wire that tell its shading.
const LEAST_SHADED: f32 = 4.0;
/// Least shading that is expected of a wire, as a sum of squares of gray bins over its places: less is no relief.
const LEAST_RELIEF: f32 = 8.0;

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
        let mut evidence = Evidence::empty(block_lines, blocks, strands, places, GRAY_LENGTHS_MM);
        let scale = GrayScale::new(&view.image, &view.axis_px, camera.px_per_mm * rope.diameter_mm() / 2.0);
        let mut map = SurfaceMap::new(rope, camera, estimates, view.image.width());
        let mut grain = Grain::new(pitch_mm, view.image.width(), block_lines);
        let lag_lines = grain.lag_lines() as f32;
        for (block, (of_block, middle)) in evidence::blocks(lines, block_lines).enumerate() {
            let moved_px = |from: usize, to: usize| view.axis_px[to] - view.axis_px[from];
            of_block.clone().for_each(|line| grain.take(line, view.image.line(line), scale.fine(line)));
            let seen: Vec<Line<'_>> = of_block
                .map(|line| Line {
                    row: view.image.line(line),
                    fine: scale.fine(line),
                    lines_on: line as f32 - middle as f32,
                    axis_moved_px: moved_px(middle, line),
                    compared: grain.compared(line).map(|pair| (pair, moved_px(line, pair.line_before))),
                })
                .collect();
            map.for_each(middle, view.axis_px[middle], |point| {
                let (mean, scores) = (gray.expected(point.cell), gray.scores(point.cell));
                if mean.is_nan() {
                    return;
                }
                let expected = gray.expected_at(point.theta, point.cell);
                // Scores are those of the cell; the pixel is judged as if it lay in its middle.
                let to_middle = mean - expected;
                let mut of_point = Sums { cell: point.cell as u32, ..Sums::default() };
                for line in &seen {
                    let column = point.column_on(line.lines_on, line.axis_moved_px);
                    let Some(&pixel) = line.row.get(column) else { continue };
                    let gray = line.fine[usize::from(pixel)];
                    of_point.score += scores[((gray + to_middle) as usize).min(GRAY_BINS - 1)];
                    of_point.deviation += gray - expected;
                    of_point.pixels += 1.0;
                    if let Some((pair, axis_moved_px)) = &line.compared
                        && let Some(change) = pair.along(column, axis_moved_px - lag_lines * point.slope_px)
                    {
                        of_point.along += change;
                        of_point.alongs += 1.0;
                    }
                }
                if of_point.score.is_nan() {
                    of_point.score = 0.0; // a region that was hardly ever seen
                } else {
                    of_point.scored = of_point.pixels;
                }
                of_point.expected = expected * of_point.pixels;
                sums[(block * strands + point.strand) * places + point.place].add(&of_point);
            });
        }
        let row = strands * places;
        let mut residuals = Self {
            block_lines,
            blocks,
            strands,
            places,
            deviation: vec![f32::NAN; sums.len()],
            expected: vec![f32::NAN; sums.len()],
            along: vec![f32::NAN; sums.len()],
            surface_cell: vec![UNSEEN; sums.len()],
        };
        for (at, sums) in sums.into_iter().enumerate() {
            let seen = sums.pixels > 0.0;
            evidence.set(at, sums.score, sums.scored, if seen { region(sums.cell as usize) } else { evidence::UNSEEN });
            if seen {
                let along_wire = at % row * blocks + at / row;
                residuals.surface_cell[along_wire] = sums.cell;
                residuals.deviation[along_wire] = sums.deviation / sums.pixels;
                residuals.expected[along_wire] = sums.expected / sums.pixels;
                residuals.along[along_wire] = sums.along / sums.alongs; // NaN without any
            }
        }
        (evidence, residuals)
    }

    /// Calls `each` with (index in the grid, surface cell, scaled factor) for every place where the factor can be told.
    pub fn for_each(&self, factor: Factor, pitch_mm: f64, mut each: impl FnMut(usize, usize, f32)) {
        let row = self.strands * self.places;
        let block_mm = self.block_lines as f64 * pitch_mm;
        let mut values = Vec::with_capacity(self.blocks);
        for column in 0..row {
            let along = column * self.blocks..(column + 1) * self.blocks;
            let first_of_wire = column % PLACES_PER_WIRE == 0;
            match factor {
                Factor::Texture => self.along[along.clone()].clone_into(&mut values),
                Factor::Relief if first_of_wire => self.relief(column, &mut values),
                Factor::Relief => {} // all places of a wire have one
                Factor::Across => self.across(column, &mut values),
                Factor::Step => step(&self.deviation[along.clone()], blocks_of(STEP_MM, block_mm), &mut values),
            }
            for (block, (&value, &cell)) in values.iter().zip(&self.surface_cell[along]).enumerate() {
                if cell != UNSEEN && !value.is_nan() {
                    each(block * row + column, cell as usize, factor.scaled(value));
                }
            }
        }
    }

    /// Change from the places on either side to those at `column`, block by block; the first and the last place of a strand are
    /// neighbours.
    fn across(&self, column: usize, values: &mut Vec<f32>) {
        values.clear();
        let (strand, place) = (column / self.places, column % self.places);
        let of_place = |place: usize| {
            let from = (strand * self.places + place % self.places) * self.blocks;
            &self.deviation[from..from + self.blocks]
        };
        let beside = of_place(place + self.places - 1).iter().zip(of_place(place + 1));
        values.extend(of_place(place).iter().zip(beside).map(|(&here, (&left, &right))| change(left, here, right)));
    }

    /// Missing share of the shading across a wire, block by block: 0 where it is as expected, 1 where the wire looks flat. Its places
    /// begin at `column`.
    fn relief(&self, column: usize, values: &mut Vec<f32>) {
        values.clear();
        values.extend((0..self.blocks).map(|block| {
            let places = (column..column + PLACES_PER_WIRE).map(|place| place * self.blocks + block);
            let (mut n, mut sum, mut squares, mut deviation, mut product) = (0.0, 0.0, 0.0, 0.0, 0.0);
            for (expected, deviates) in places.map(|at| (self.expected[at], self.deviation[at])) {
                if !expected.is_nan() {
                    n += 1.0;
                    sum += expected;
                    squares += expected * expected;
                    deviation += deviates;
                    product += expected * deviates;
                }
            }
            let shading = squares - sum * sum / n;
            let told = n >= LEAST_SHADED && shading > LEAST_RELIEF;
            if told { -(product - sum * deviation / n) / shading } else { f32::NAN }
        }));
    }
}

/// Distance along the wire in mm over which a step is looked for: longer than a speck of dirt, shorter than a worn place.
const STEP_MM: f64 = 1.5;

/// Blocks that make so many mm.
fn blocks_of(mm: f64, block_mm: f64) -> usize {
    (mm / block_mm).round().max(1.0) as usize
}

/// Mean square of the two changes from a place to those on either side of it, or of the one that is known.
fn change(before: f32, here: f32, after: f32) -> f32 {
    let (before, after) = ((here - before).powi(2), (after - here).powi(2));
    match (before.is_nan(), after.is_nan()) {
        (false, false) => (before + after) / 2.0,
        (true, _) => after,
        (_, true) => before,
    }
}

/// Change of every block of a wire from those `lag` blocks before and behind it.
fn step(deviation: &[f32], lag: usize, values: &mut Vec<f32>) {
    values.clear();
    let at = |block: Option<usize>| block.and_then(|block| deviation.get(block)).copied().unwrap_or(f32::NAN);
    values.extend(
        deviation
            .iter()
            .enumerate()
            .map(|(block, &here)| change(at(block.checked_sub(lag)), here, at(Some(block + lag)))),
    );
}
