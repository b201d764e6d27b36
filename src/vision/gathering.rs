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
use super::unrolled::{FINE_PER_WIRE, GraySums};
use std::ops::{AddAssign, Range};

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
    /// Changes of gray from pixel to pixel.
    pub changes: Changes,
    /// Pixels of the middle line.
    pub pixels: f32,
    /// Surface cell of one of them.
    pub cell: u32,
}

/// Sums over changes of gray along the wire and across it.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Changes {
    /// Squares of those along it.
    pub along: f32,
    /// Squares of those across it.
    pub across: f32,
    /// Products of both.
    pub slanted: f32,
}

impl AddAssign for Changes {
    fn add_assign(&mut self, other: Self) {
        self.along += other.along;
        self.across += other.across;
        self.slanted += other.slanted;
    }
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

/// Whether gray values themselves are judged, or only compared with what is expected of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Judged {
    /// Every gray value gets its anomaly score.
    Gray,
    /// None does: scores are 0, and tell what is seen.
    Nothing,
}

/// Gathers runs of pixels; what it holds are values of the pixels of one run.
pub(super) struct Gathering<'a> {
    gray: &'a Appearance,
    judged: Judged,
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
    changes: Vec<Changes>,
}

impl<'a> Gathering<'a> {
    /// For images of `width_px` columns, whose lines are compared with those so many lines before.
    pub fn new(gray: &'a Appearance, judged: Judged, width_px: usize, lag_lines: usize) -> Self {
        Self {
            gray,
            judged,
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
            changes: vec![Changes::default(); width_px],
        }
    }

    /// Adds the pixels of a run, in all lines of the block, to the places of its strand, and their gray to its fine places; those of
    /// `blind` columns count as not seen.
    #[inline(always)]
    pub fn add(
        &mut self,
        run: &Run<'_>,
        blind: &[Range<usize>],
        lines: &[Line<'_>],
        places: &mut [Sums],
        fine: &mut [GraySums],
    ) {
        let n = run.cells.len();
        self.row.look_up(self.gray, run);
        if self.judged == Judged::Gray {
            self.row.look_up_middles(self.gray, run);
        }
        for columns in blind {
            let of_run = |column: usize| column.saturating_sub(run.from).min(n);
            self.row.expected[of_run(columns.start)..of_run(columns.end)].fill(f32::NAN);
        }
        self.gray_sums[..n].fill(0.0);
        self.scores[..n].fill(0.0);
        self.changes[..n].fill(Changes::default());
        for line in lines {
            self.see(run, line);
            if let Some((pair, axis_moved_px)) = &line.compared {
                self.compare(run, pair, *axis_moved_px);
            }
        }
        let of_lines = lines.len() as f32;
        let sums = self.gray_sums.iter().zip(&self.scores).zip(&self.changes);
        let all_fine = fine.len() as f32;
        let seen = run.places.iter().zip(run.cells).zip(run.wire_places).zip(&self.row.expected);
        for ((((&place, &cell), wire_place), &expected), ((&gray_sum, &score), &changes)) in seen.zip(sums) {
            if expected.is_nan() {
                continue; // nobody has seen such a place, or nobody sees it here
            }
            let at = (wire_place + 0.5) * FINE_PER_WIRE as f32;
            let at = whole(within(if at >= all_fine { at - all_fine } else { at }, all_fine - 0.5));
            let to = &mut fine[at as usize];
            to.deviation += gray_sum / of_lines - expected;
            to.expected += expected;
            to.pixels += 1.0;
            let to = &mut places[place as usize];
            if !score.is_nan() {
                to.score += score; // else it lies in a region that was hardly ever seen
                to.scored += 1.0;
            }
            to.deviation += gray_sum - of_lines * expected;
            to.expected += expected;
            to.changes += changes;
            to.pixels += 1.0;
            to.cell = cell;
        }
    }

    /// Sums gray values and their scores in one line. Beyond the image's edge its last pixel goes on.
    #[inline(always)]
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
        self.gray_sums.iter_mut().zip(&*grays).for_each(|(sum, gray)| *sum += gray);
        if self.judged == Judged::Nothing {
            return;
        }
        // Scores are those of the cell; the pixel is judged as if it lay in its middle.
        let pixels = grays.iter().zip(&self.row.to_middle).zip(run.cells);
        for (entry, ((gray, to_middle), cell)) in entries.iter_mut().zip(pixels) {
            *entry = cell * GRAY_BINS as u32 + whole(within(gray + to_middle, GRAY_BINS as f32 - 0.5));
        }
        let table = self.gray.score_table();
        for (score, &entry) in self.scores.iter_mut().zip(&*entries) {
            *score += table[entry as usize];
        }
    }

    /// Sums changes along the wire, from the line before that is compared to this one, and across it.
    #[inline(always)]
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
        for (changes, ((&column, &before), share)) in self.changes.iter_mut().zip(places) {
            let past = &pair.before[before as usize..before as usize + 2];
            let along = pair.now[column as usize] - (past[0] + share * (past[1] - past[0]));
            let [past, now] = pair.sideways;
            let across = (past[before as usize] + now[column as usize]) / 2.0;
            *changes += Changes { along: along * along, across: across * across, slanted: along * across };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::bandwidths::Bandwidths;
    use crate::vision::grain::Grain;
    use crate::vision::histogram::{Histogram, cell};

    /// Changes of a run of wire that runs along the lines, whose gray at (line, column) is told.
    fn changes(gray: impl Fn(f32, f32) -> f32) -> Changes {
        const WIDTH: usize = 60;
        let mut histogram = Histogram::default();
        (0..400).for_each(|k| histogram.add(cell(12, 12, 4), 10 + k % 12));
        let appearance = Appearance::learn(&histogram, Bandwidths::FIXED);
        let mut grain = Grain::new(0.1, WIDTH, 5);
        let mut gathering = Gathering::new(&appearance, Judged::Nothing, WIDTH, grain.lag_lines());
        let (cells, places) = ([cell(12, 12, 4) as u32; 40], [0; 40]);
        let (wires_at, distances_at, zeros) = ([12.5; 40], [4.5; 40], [0.0; 40]);
        let run = Run {
            strand: 0,
            strand_at: 12.5,
            from: 10,
            wires_at: &wires_at,
            distances_at: &distances_at,
            cells: &cells,
            wire_places: &zeros,
            places: &places,
            slopes_px: &zeros,
        };
        let mut sums = [Sums::default()];
        for line in 0..40 {
            let grays: Vec<f32> = (0..WIDTH).map(|column| gray(line as f32, column as f32)).collect();
            grain.take(line, &grays);
            let compared = grain.compared(line).map(|pair| (pair, 0.0));
            let lines = [Line { grays: &grays, lines_on: 0.0, axis_moved_px: 0.0, compared }];
            gathering.add(&run, &[], &lines, &mut sums, &mut [GraySums::default(); FINE_PER_WIRE]);
        }
        sums[0].changes
    }

    #[test]
    fn scratches_lean_one_way_streaks_and_specks_none() {
        let slant = |c: Changes| c.slanted / (c.along + c.across);
        let one = changes(|line, column| 16.0 + 3.0 * (0.5 * column + 0.3 * line).sin());
        let other = changes(|line, column| 16.0 + 3.0 * (0.5 * column - 0.3 * line).sin());
        assert!(slant(one) > 0.3 && slant(other) < -0.3, "{one:?} {other:?}");
        let streaks = changes(|_, column| 16.0 + 3.0 * (0.5 * column).sin());
        assert!(streaks.along < 1e-3 * streaks.across && slant(streaks).abs() < 0.02, "{streaks:?}");
        // Specks 6 columns and 8 lines apart, the same in all directions.
        let specks = changes(|line, column| {
            let from = |at: f32, apart: f32| (at + apart / 2.0).rem_euclid(apart) - apart / 2.0;
            16.0 - 6.0 * (-(from(line, 8.0).powi(2) + from(column, 6.0).powi(2)) / 2.0).exp()
        });
        assert!(specks.along > 0.1 * specks.across && slant(specks).abs() < 0.05, "{specks:?}");
    }
}
