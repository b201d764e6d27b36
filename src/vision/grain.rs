//! The grain of the surface, pixel by pixel: how much the gray changes along a wire and across it.
//!
//! Pits and scratches are some tenths of a millimetre large. Comparing pixels on the wire's own course sees them where blocks of
//! the unrolled rope are too coarse. A little averaging comes first: noise of the sensor is not grain.

use super::wide::wide;

/// Distance along the wire over which pixels are compared in mm.
const ALONG_MM: f64 = 0.3;

fn lag_lines(pitch_mm: f64) -> usize {
    ((ALONG_MM / pitch_mm).round() as usize).max(1)
}

/// Follows the lines of a view.
#[derive(Debug, Clone)]
pub struct Grain {
    lag_lines: usize,
    /// The last lines, averaged over three columns and two lines: line k is at k modulo their number.
    averaged: Vec<Vec<f32>>,
    /// Their changes from column to column, over two columns.
    sideways: Vec<Vec<f32>>,
    /// The last line, averaged over three columns.
    last: Vec<f32>,
}

impl Grain {
    /// For images of `width_px` columns; the last `lines` that were taken can be asked about.
    pub fn new(pitch_mm: f64, width_px: usize, lines: usize) -> Self {
        let lag_lines = lag_lines(pitch_mm);
        let kept = vec![vec![0.0; width_px]; lag_lines + lines];
        Self { lag_lines, averaged: kept.clone(), sideways: kept, last: vec![0.0; width_px] }
    }

    /// Takes the gray values of the next line in bins; its first and last columns never show rope.
    pub fn take(&mut self, line: usize, grays: &[f32]) {
        let at = line % self.averaged.len();
        let averaged = &mut self.averaged[at];
        let inner = grays.len().saturating_sub(2);
        let sideways = &mut self.sideways[at];
        wide(
            #[inline(always)]
            || {
                let inside = averaged[1..].iter_mut().zip(&mut self.last[1..]).take(inner);
                for ((averaged, last), gray) in inside.zip(grays.windows(3)) {
                    let here = (gray[0] + gray[1] + gray[2]) / 3.0;
                    *averaged = (here + if line == 0 { here } else { *last }) / 2.0;
                    *last = here;
                }
                let changes = averaged.iter().zip(averaged.iter().skip(2)).map(|(left, right)| right - left);
                sideways.iter_mut().skip(1).zip(changes).for_each(|(to, change)| *to = change);
            },
        );
    }

    /// A line that was taken, beside the one that it is compared with; the first lines have none.
    pub fn compared(&self, line: usize) -> Option<Compared<'_>> {
        let before = line.checked_sub(self.lag_lines)?;
        let averaged = |line: usize| &self.averaged[line % self.averaged.len()][..];
        let sideways = |line: usize| &self.sideways[line % self.sideways.len()][..];
        Some(Compared {
            line_before: before,
            now: averaged(line),
            before: averaged(before),
            sideways: [sideways(before), sideways(line)],
        })
    }

    /// How many lines before a line are read when it is compared: the earlier one is averaged with that before it.
    pub fn reach_lines(pitch_mm: f64) -> usize {
        lag_lines(pitch_mm) + 1
    }

    /// How many lines lie between a line and the one that it is compared with.
    pub fn lag_lines(&self) -> usize {
        self.lag_lines
    }
}

/// Two lines that are compared, a little averaged.
#[derive(Debug, Clone, Copy)]
pub struct Compared<'a> {
    /// Number of the earlier one.
    pub line_before: usize,
    /// The line itself.
    pub now: &'a [f32],
    /// The earlier one.
    pub before: &'a [f32],
    /// How the gray of the earlier one and of the line itself changes about every column, over two columns.
    pub sideways: [&'a [f32]; 2],
}
