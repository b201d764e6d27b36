//! The grain of the surface, pixel by pixel: how much the gray changes along a wire.
//!
//! Pits and scratches are some tenths of a millimetre large. Comparing pixels on the wire's own course sees them where blocks of
//! the unrolled rope are too coarse. A little averaging comes first: noise of the sensor is not grain.

use super::surface_map::whole;

/// Distance along the wire over which pixels are compared in mm.
const ALONG_MM: f64 = 0.3;
/// One of so many lines is compared: neighbours show the same grain.
const EVERY_LINES: usize = 2;

/// Follows the lines of a view.
#[derive(Debug, Clone)]
pub struct Grain {
    lag_lines: usize,
    /// The last lines, averaged over three columns and two lines: line k is at k modulo their number.
    averaged: Vec<Vec<f32>>,
    /// The last line, averaged over three columns.
    last: Vec<f32>,
    /// Its gray values.
    gray: Vec<f32>,
}

impl Grain {
    /// For images of `width_px` columns; the last `lines` that were taken can be asked about.
    pub fn new(pitch_mm: f64, width_px: usize, lines: usize) -> Self {
        let lag_lines = ((ALONG_MM / pitch_mm).round() as usize).max(1);
        Self {
            lag_lines,
            averaged: vec![vec![0.0; width_px]; lag_lines + lines],
            last: vec![0.0; width_px],
            gray: vec![0.0; width_px],
        }
    }

    /// Takes the next line; its first and last columns never show rope.
    pub fn take(&mut self, line: usize, row: &[u8], fine: &[f32; 256]) {
        self.gray.iter_mut().zip(row).for_each(|(gray, &pixel)| *gray = fine[usize::from(pixel)]);
        let at = line % self.averaged.len();
        let averaged = &mut self.averaged[at];
        let inner = self.gray.len().saturating_sub(2);
        let inside = averaged[1..].iter_mut().zip(&mut self.last[1..]).take(inner);
        for ((averaged, last), gray) in inside.zip(self.gray.windows(3)) {
            let here = (gray[0] + gray[1] + gray[2]) / 3.0;
            *averaged = (here + if line == 0 { here } else { *last }) / 2.0;
            *last = here;
        }
    }

    /// A line that was taken, beside the one that it is compared with, if it is one of those that are compared.
    pub fn compared(&self, line: usize) -> Option<Compared<'_>> {
        let before = line.checked_sub(self.lag_lines).filter(|_| line.is_multiple_of(EVERY_LINES))?;
        let averaged = |line: usize| &self.averaged[line % self.averaged.len()][..];
        Some(Compared { line_before: before, now: averaged(line), before: averaged(before) })
    }

    /// How many lines lie between a line and the one that it is compared with.
    pub fn lag_lines(&self) -> usize {
        self.lag_lines
    }
}

/// Two lines that are compared.
#[derive(Debug, Clone, Copy)]
pub struct Compared<'a> {
    /// Number of the earlier one.
    pub line_before: usize,
    now: &'a [f32],
    before: &'a [f32],
}

impl Compared<'_> {
    /// Squared change along the wire up to a pixel: `moved_px` is where its place was on the line before, relative to it now.
    #[inline]
    pub fn along(&self, column: usize, moved_px: f32) -> Option<f32> {
        let from = column as f32 + moved_px;
        let left = whole(from) as usize;
        let (now, before) = (self.now.get(column)?, self.before.get(left..left + 2)?);
        let share = from - left as f32;
        let change = now - (before[0] + share * (before[1] - before[0]));
        Some(change * change)
    }
}
