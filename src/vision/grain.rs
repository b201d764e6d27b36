//! The grain of the surface, pixel by pixel: how much the gray changes along a wire and across it.
//!
//! Pits and scratches are some tenths of a millimetre large. Comparing pixels on the wire's own course sees them where blocks of
//! the unrolled rope are too coarse. A little averaging comes first: noise of the sensor is not grain.

use super::camera::Camera;
use super::surface_map::whole;

/// Distance along the wire over which pixels are compared in mm.
const ALONG_MM: f64 = 0.3;
/// The same across the wire.
const ACROSS_MM: f64 = 0.25;
/// One of so many lines is compared: neighbours show the same grain.
const EVERY_LINES: usize = 2;

/// Follows the lines of a view.
#[derive(Debug, Clone)]
pub struct Grain {
    lag_lines: usize,
    lag_px: usize,
    /// The last lines, averaged over three columns and two lines: line k is at k modulo their number.
    averaged: Vec<Vec<f32>>,
    /// The last line, averaged over three columns.
    last: Vec<f32>,
    /// Of every column, when it was last looked at (line and strand) and how it deviated.
    looked_at: Vec<(usize, f32)>,
}

impl Grain {
    /// For images of `width_px` columns.
    pub fn new(camera: &Camera, pitch_mm: f64, width_px: usize) -> Self {
        let lag_lines = ((ALONG_MM / pitch_mm).round() as usize).max(1);
        Self {
            lag_lines,
            lag_px: ((ACROSS_MM * camera.px_per_mm).round() as usize).max(1),
            averaged: vec![vec![0.0; width_px]; lag_lines + 1],
            last: vec![0.0; width_px],
            looked_at: vec![(usize::MAX, 0.0); width_px],
        }
    }

    /// Takes the next line. Answers whether it is one of those that are compared.
    pub fn take(&mut self, line: usize, row: &[u8], fine: &[f32; 256]) -> bool {
        let at = line % self.averaged.len();
        let averaged = &mut self.averaged[at];
        let gray = |column: usize| fine[usize::from(row[column])];
        let width = row.len();
        for (column, averaged) in averaged.iter_mut().enumerate() {
            let (left, right) = (column.saturating_sub(1), (column + 1).min(width - 1));
            let here = (gray(left) + gray(column) + gray(right)) / 3.0;
            let last = if line == 0 { here } else { self.last[column] };
            *averaged = (here + last) / 2.0;
            self.last[column] = here;
        }
        line.is_multiple_of(EVERY_LINES)
    }

    /// Line that a line is compared with.
    pub fn before(&self, line: usize) -> Option<usize> {
        line.checked_sub(self.lag_lines)
    }

    /// Squared change along the wire up to a pixel: `moved_px` is where its place was on the line before, relative to it now.
    #[inline]
    pub fn along(&self, line: usize, column: usize, moved_px: f32) -> Option<f32> {
        let (now, before) = (self.row(line), self.row(line - self.lag_lines));
        let from = column as f32 + moved_px;
        if !(from >= 0.0 && from < (now.len() - 1) as f32) {
            return None;
        }
        let left = whole(from) as usize;
        let share = from - left as f32;
        let change = now[column] - (before[left] + share * (before[left + 1] - before[left]));
        Some(change * change)
    }

    /// Squared change of the deviation from what is expected, across the wires of a strand.
    #[inline]
    pub fn across(&mut self, line: usize, strand: usize, column: usize, expected: f32) -> Option<f32> {
        let when = line << 8 | strand;
        let deviation = self.row(line)[column] - expected;
        self.looked_at[column] = (when, deviation);
        let (then, beside) = self.looked_at[column.checked_sub(self.lag_px)?];
        (then == when).then_some((deviation - beside) * (deviation - beside))
    }

    /// How many lines lie between a line and the one that it is compared with.
    pub fn lag_lines(&self) -> usize {
        self.lag_lines
    }

    #[inline]
    fn row(&self, line: usize) -> &[f32] {
        &self.averaged[line % self.averaged.len()]
    }
}
