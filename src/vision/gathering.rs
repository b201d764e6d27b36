//! Gathers the pixels of a block of lines on the unrolled rope.
//!
//! The surface is mapped at the middle line of a block; the others see the same places a little to the side. A recording has
//! 10^9 pixels, so what can be done for many of them side by side is done in plain loops over slices, without calls or branches,
//! and what must be looked up one by one in loops that do nothing else.

use super::appearance::Appearance;
use super::expected_row::ExpectedRow;
use super::grain::Compared;
use super::histogram::GRAY_BINS;
use super::surface_map::{Run, whole, within};

/// Sums over the pixels of one place in one block. A pixel of the middle line stands for those of all lines.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sums {
    /// Anomaly scores.
    pub score: f32,
    /// Pixels of the middle line that have one.
    pub scored: f32,
    /// Deviations from the expected gray, in bins.
    pub deviation: f32,
    /// Expected gray, once for every pixel of the middle line.
    pub expected: f32,
    /// Squared changes along the wire.
    pub along: f32,
    /// Pixels of the middle line.
    pub pixels: f32,
    /// Surface cell of one of them.
    pub cell: u32,
}

/// A line of the block that is gathered.
pub(super) struct Line<'a> {
    /// Its gray values in bins.
    pub grays: &'a [f32],
    /// How far on it is from the line that was mapped.
    pub lines_on: f32,
    /// How far the axis has moved since.
    pub axis_moved_px: f32,
    /// It and the line that it is compared with, if it is, and how far the axis moves from it to that one.
    pub compared: Option<(Compared<'a>, f32)>,
}

/// Gathers runs of pixels; what it holds are values of the pixels of one run.
pub(super) struct Gathering<'a> {
    gray: &'a Appearance,
    lag_lines: f32,
    /// Columns of the image, as numbers to reckon with.
    at_px: Vec<f32>,
    row: ExpectedRow,
    /// Column of every pixel in a line.
    columns: Vec<u32>,
    /// Its gray there.
    grays: Vec<f32>,
    /// Where that gray's score is found.
    entries: Vec<u32>,
    /// The column that is compared, and how far the place is on the way to the next.
    columns_before: Vec<u32>,
    shares: Vec<f32>,
    /// Sums over the lines.
    gray_sums: Vec<f32>,
    scores: Vec<f32>,
    alongs: Vec<f32>,
}

impl<'a> Gathering<'a> {
    /// For images of `width_px` columns, whose lines are compared with those so many lines before.
    pub fn new(gray: &'a Appearance, width_px: usize, lag_lines: usize) -> Self {
        Self {
            gray,
            lag_lines: lag_lines as f32,
            at_px: (0..width_px).map(|column| column as f32).collect(),
            row: ExpectedRow::new(width_px),
            columns: vec![0; width_px],
            grays: vec![0.0; width_px],
            entries: vec![0; width_px],
            columns_before: vec![0; width_px],
            shares: vec![0.0; width_px],
            gray_sums: vec![0.0; width_px],
            scores: vec![0.0; width_px],
            alongs: vec![0.0; width_px],
        }
    }

    /// Adds the pixels of a run, in all lines of the block, to the places of its strand.
    pub fn add(&mut self, run: &Run<'_>, lines: &[Line<'_>], places: &mut [Sums]) {
        let n = run.cells.len();
        self.row.look_up(self.gray, run);
        self.gray_sums[..n].fill(0.0);
        self.scores[..n].fill(0.0);
        self.alongs[..n].fill(0.0);
        for line in lines {
            self.see(run, line);
            if let Some((pair, axis_moved_px)) = &line.compared {
                self.compare(run, pair, *axis_moved_px);
            }
        }
        let of_lines = lines.len() as f32;
        let sums = self.gray_sums.iter().zip(&self.scores).zip(&self.alongs);
        for (((&place, &cell), &expected), ((&gray_sum, &score), &along)) in
            run.places.iter().zip(run.cells).zip(&self.row.expected).zip(sums)
        {
            if expected.is_nan() {
                continue; // nobody has seen such a place
            }
            let to = &mut places[place as usize];
            if !score.is_nan() {
                to.score += score; // else it lies in a region that was hardly ever seen
                to.scored += 1.0;
            }
            to.deviation += gray_sum - of_lines * expected;
            to.expected += expected;
            to.along += along;
            to.pixels += 1.0;
            to.cell = cell;
        }
    }

    /// Sums gray values and their scores in one line. Beyond the image's edge its last pixel goes on.
    fn see(&mut self, run: &Run<'_>, line: &Line<'_>) {
        let n = run.cells.len();
        let last_px = line.grays.len() as f32 - 0.5;
        let (columns, grays, entries) = (&mut self.columns[..n], &mut self.grays[..n], &mut self.entries[..n]);
        let at_px = &self.at_px[run.from..run.from + n];
        for (column, (at, slope)) in columns.iter_mut().zip(at_px.iter().zip(run.slopes_px)) {
            *column = whole(within(at + line.lines_on * slope + line.axis_moved_px + 0.5, last_px));
        }
        for (gray, &column) in grays.iter_mut().zip(&*columns) {
            *gray = line.grays[column as usize];
        }
        // Scores are those of the cell; the pixel is judged as if it lay in its middle.
        let pixels = grays.iter().zip(&self.row.to_middle).zip(run.cells);
        for ((entry, sum), ((gray, to_middle), cell)) in entries.iter_mut().zip(&mut self.gray_sums).zip(pixels) {
            *sum += gray;
            *entry = cell * GRAY_BINS as u32 + whole(within(gray + to_middle, GRAY_BINS as f32 - 0.5));
        }
        let table = self.gray.score_table();
        for (score, &entry) in self.scores.iter_mut().zip(&*entries) {
            *score += table[entry as usize];
        }
    }

    /// Sums squared changes along the wire, from the line before that is compared to this one.
    fn compare(&mut self, run: &Run<'_>, pair: &Compared<'_>, axis_moved_px: f32) {
        let n = run.cells.len();
        let last_px = pair.now.len() as f32 - 1.5;
        let (columns, before, shares) = (&self.columns[..n], &mut self.columns_before[..n], &mut self.shares[..n]);
        for ((before, share), (&column, slope)) in
            before.iter_mut().zip(&mut *shares).zip(columns.iter().zip(run.slopes_px))
        {
            let at = within(column as i32 as f32 + (axis_moved_px - self.lag_lines * slope), last_px);
            let left = whole(at);
            (*before, *share) = (left, at - left as i32 as f32);
        }
        let places = columns.iter().zip(&*before).zip(&*shares);
        for (along, ((&column, &before), share)) in self.alongs.iter_mut().zip(places) {
            let past = &pair.before[before as usize..before as usize + 2];
            let change = pair.now[column as usize] - (past[0] + share * (past[1] - past[0]));
            *along += change * change;
        }
    }
}
