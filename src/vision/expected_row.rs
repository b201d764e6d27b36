//! Expected gray of all pixels that one strand fills in a line.
//!
//! They have one phase of the strand, so what is expected is mixed from the cells on either side of it once, and then only between
//! neighbouring wires and distances: the same as [`Appearance::expected_at`], without looking up eight cells a pixel.

use super::appearance::{Appearance, between_middles};
use super::histogram::{DISTANCE_BINS, STRAND_BINS, Theta, WIRE_BINS, cell};
use super::surface_map::Run;

/// Cells of one phase of the strand.
const ROW: usize = WIRE_BINS * DISTANCE_BINS;

/// Expected gray of a run's pixels, and of the cells that they lie in.
#[derive(Debug, Clone)]
pub(super) struct ExpectedRow {
    /// Expected gray between the cells of two strand phases, `[wire * DISTANCE_BINS + distance]`.
    mixed: [f32; ROW],
    /// Of every pixel: the first of the cells that it lies between, and how far it is on the way to the next wire and distance.
    firsts: Vec<u32>,
    to_wire: Vec<f32>,
    to_distance: Vec<f32>,
    /// What is expected of every pixel; NaN where the model cannot tell.
    pub expected: Vec<f32>,
    /// How far that is below what is expected in the middle of its cell; see [`Self::look_up_middles`].
    pub to_middle: Vec<f32>,
}

impl ExpectedRow {
    /// For runs of at most `width_px` pixels.
    pub fn new(width_px: usize) -> Self {
        Self {
            mixed: [0.0; ROW],
            firsts: vec![0; width_px],
            to_wire: vec![0.0; width_px],
            to_distance: vec![0.0; width_px],
            expected: vec![0.0; width_px],
            to_middle: vec![0.0; width_px],
        }
    }

    /// Looks up a run: its pixels come first in `expected`.
    #[inline(always)]
    pub fn look_up(&mut self, gray: &Appearance, run: &Run<'_>) {
        let (strand, share) = between_middles(run.strand_at, STRAND_BINS);
        let (near, far) = gray.expected_cells(cell(strand, 0, 0)..cell(strand + 2, 0, 0)).split_at(ROW);
        for (mixed, (near, far)) in self.mixed.iter_mut().zip(near.iter().zip(far)) {
            *mixed = near + share * (far - near);
        }
        // Side by side first; what is looked up after that can only be looked up one by one.
        let between = self.firsts.iter_mut().zip(&mut self.to_wire).zip(&mut self.to_distance);
        for (((first, to_wire), to_distance), (&wire, &distance)) in
            between.zip(run.wires_at.iter().zip(run.distances_at))
        {
            let (wire, b) = between_middles(wire, WIRE_BINS);
            let (distance, c) = between_middles(distance, DISTANCE_BINS);
            (*first, *to_wire, *to_distance) = ((wire * DISTANCE_BINS + distance) as u32, b, c);
        }
        let between = self.firsts.iter().zip(&self.to_wire).zip(&self.to_distance);
        for (k, ((&cell, ((&first, &b), &c)), expected)) in
            run.cells.iter().zip(between).zip(&mut self.expected).enumerate()
        {
            let about = &self.mixed[first as usize..first as usize + DISTANCE_BINS + 2];
            let near = about[0] + c * (about[1] - about[0]);
            let far = about[DISTANCE_BINS] + c * (about[DISTANCE_BINS + 1] - about[DISTANCE_BINS]);
            *expected = near + b * (far - near);
            if expected.is_nan() {
                // A cell about it was not seen.
                let theta = Theta { strand: run.strand_at, wire: run.wires_at[k], distance: run.distances_at[k] };
                *expected = gray.expected_at(theta, cell as usize);
            }
        }
    }

    /// Looks up the middles of the cells of the run that was looked up last: its pixels come first in `to_middle`.
    pub fn look_up_middles(&mut self, gray: &Appearance, run: &Run<'_>) {
        for (to_middle, (&cell, expected)) in self.to_middle.iter_mut().zip(run.cells.iter().zip(&self.expected)) {
            *to_middle = gray.expected(cell as usize) - expected;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::bandwidths::Bandwidths;
    use crate::vision::histogram::Histogram;

    #[test]
    fn a_run_is_expected_to_look_as_each_of_its_points_alone() {
        let mut histogram = Histogram::default();
        for strand in 8..14 {
            for wire in 8..16 {
                for distance in 0..DISTANCE_BINS {
                    (0..400).for_each(|_| {
                        histogram.add(cell(strand, wire, distance), 2 * distance + wire % 3 + strand / 2)
                    });
                }
            }
        }
        let gray = Appearance::learn(&histogram, Bandwidths::FIXED);
        // Out to cells that nobody has seen, in both directions.
        for strand_at in [3.2f32, 9.4, 11.5, 13.9, 31.9] {
            let wires_at: Vec<f32> = (0..240).map(|k| k as f32 / 10.2).collect();
            let distances_at: Vec<f32> = (0..240).map(|k| (k * 7 % 80) as f32 / 10.0).collect();
            let index =
                |(wire, distance): (&f32, &f32)| cell(strand_at as usize, *wire as usize, *distance as usize) as u32;
            let cells: Vec<u32> = wires_at.iter().zip(&distances_at).map(index).collect();
            let run = Run {
                strand: 0,
                strand_at,
                from: 0,
                wires_at: &wires_at,
                distances_at: &distances_at,
                cells: &cells,
                wire_places: &wires_at,
                places: &cells,
                slopes_px: &wires_at,
            };
            let mut row = ExpectedRow::new(300);
            row.look_up(&gray, &run);
            row.look_up_middles(&gray, &run);
            for k in 0..cells.len() {
                let theta = Theta { strand: strand_at, wire: wires_at[k], distance: distances_at[k] };
                let alone = gray.expected_at(theta, cells[k] as usize);
                let together = row.expected[k];
                assert!(
                    (alone.is_nan() && together.is_nan()) || (alone - together).abs() < 1e-4,
                    "{alone} is not {together} at {theta:?}"
                );
                assert!(alone.is_nan() || gray.expected(cells[k] as usize) - together == row.to_middle[k]);
            }
        }
    }
}
