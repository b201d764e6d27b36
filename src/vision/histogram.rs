//! Joint density of gray value and surface point: a 4-D histogram, smoothed into a Parzen estimate. [Wacker13, eq. 18-19]

use super::bandwidths::Bandwidths;
use std::ops::AddAssign;

/// Bins of the normalised gray value.
pub const GRAY_BINS: usize = 32;
/// Bins of the strand's phase in view.
pub const STRAND_BINS: usize = 32;
/// Bins of the wire's phase in view.
pub const WIRE_BINS: usize = 24;
/// Bins of the distance to the wire's centre line.
pub const DISTANCE_BINS: usize = 8;
/// Number of surface cells theta = (strand phase, wire phase, distance).
pub const CELLS: usize = STRAND_BINS * WIRE_BINS * DISTANCE_BINS;

/// Counts n_i of eq. 18, `counts[cell * GRAY_BINS + gray]`; cells run over strand phase, wire phase, distance (fastest).
#[derive(Debug, Clone, PartialEq)]
pub struct Histogram {
    counts: Vec<f32>,
}

impl Default for Histogram {
    fn default() -> Self {
        Self { counts: vec![0.0; CELLS * GRAY_BINS] }
    }
}

/// A surface point theta in bins of its three axes, not rounded: the middle of the first bin is at 0.5. [Wacker13, eq. 16-17]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Theta {
    /// Along the strand phases in view.
    pub strand: f32,
    /// Along the wire phases in view.
    pub wire: f32,
    /// Along the distances to the wire's centre line.
    pub distance: f32,
}

/// Index of a surface cell.
pub fn cell(strand_bin: usize, wire_bin: usize, distance_bin: usize) -> usize {
    (strand_bin * WIRE_BINS + wire_bin) * DISTANCE_BINS + distance_bin
}

/// Bins of neighbouring strand and wire phases that make a region R_k of eq. 21; distances are kept together.
const REGION_BINS: (usize, usize) = (4, 3);
/// Regions R_k of the surface in view. [eq. 21]
pub const REGIONS: usize = (STRAND_BINS / REGION_BINS.0) * (WIRE_BINS / REGION_BINS.1);

/// Region that a surface cell lies in.
pub fn region(cell: usize) -> u8 {
    let (strand, wire) = (cell / DISTANCE_BINS / WIRE_BINS, cell / DISTANCE_BINS % WIRE_BINS);
    (strand / REGION_BINS.0 * (WIRE_BINS / REGION_BINS.1) + wire / REGION_BINS.1) as u8
}

impl Histogram {
    /// Adds one observation.
    #[inline]
    pub fn add(&mut self, cell: usize, gray_bin: usize) {
        self.counts[cell * GRAY_BINS + gray_bin] += 1.0;
    }

    /// Counts of one cell over gray.
    pub fn of_cell(&self, cell: usize) -> &[f32] {
        &self.counts[cell * GRAY_BINS..(cell + 1) * GRAY_BINS]
    }

    /// Number of observations.
    pub fn total(&self) -> f64 {
        self.counts.iter().map(|&c| f64::from(c)).sum()
    }

    /// The Parzen estimate of eq. 18, times n: a Gaussian window is separable, so each axis is smoothed on its own.
    /// Mass that would leave an axis stays at its end. Gray values that are not told apart share what they have.
    pub fn smoothed(&self, bandwidths: Bandwidths) -> Histogram {
        let [gray, cells @ ..] = bandwidths.sigma_bins;
        let counts = smooth_over_cells(&self.counts, GRAY_BINS, cells);
        let mut counts = smooth_axis(&counts, GRAY_BINS, 1, gray);
        let together = GRAY_BINS / bandwidths.gray_bins;
        if together > 1 {
            for same in counts.chunks_exact_mut(together) {
                same.fill(same.iter().sum::<f32>() / together as f32);
            }
        }
        Histogram { counts }
    }
}

impl AddAssign<&Histogram> for Histogram {
    /// Adds all observations of another histogram.
    fn add_assign(&mut self, other: &Histogram) {
        self.counts.iter_mut().zip(&other.counts).for_each(|(a, b)| *a += b);
    }
}

/// Smooths what every cell has so many values of, `[cell * values + value]`, over (strand phase, wire phase, distance), with a window
/// of these standard deviations in bins.
pub(super) fn smooth_over_cells(cells: &[f32], values: usize, sigma_bins: [f32; 3]) -> Vec<f32> {
    let lens = [STRAND_BINS, WIRE_BINS, DISTANCE_BINS];
    let mut smoothed = cells.to_vec();
    for (axis, sigma) in sigma_bins.into_iter().enumerate() {
        let stride = lens[axis + 1..].iter().product::<usize>() * values;
        smoothed = smooth_axis(&smoothed, lens[axis], stride, sigma);
    }
    smoothed
}

fn smooth_axis(values: &[f32], len: usize, stride: usize, sigma: f32) -> Vec<f32> {
    if sigma <= 0.0 {
        return values.to_vec();
    }
    let reach = (3.0 * sigma).ceil() as isize;
    let kernel: Vec<f32> = (-reach..=reach).map(|k| (-0.5 * (k as f32 / sigma).powi(2)).exp()).collect();
    let norm: f32 = kernel.iter().sum();
    let mut out = vec![0.0f32; values.len()];
    for block in (0..values.len()).step_by(len * stride) {
        for at in 0..len {
            for (k, &w) in (-reach..=reach).zip(&kernel) {
                // Mass that would leave the axis stays at its end bin: nothing observed is lost.
                let to = (at as isize + k).clamp(0, len as isize - 1) as usize;
                let (source, target) = (block + at * stride, block + to * stride);
                for s in 0..stride {
                    out[target + s] += values[source + s] * w / norm;
                }
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smoothing_spreads_but_loses_nothing() {
        let mut histogram = Histogram::default();
        let at = cell(10, 12, 4);
        for _ in 0..100 {
            histogram.add(at, 20);
        }
        histogram.add(cell(0, 0, 0), 0);
        let smoothed = histogram.smoothed(Bandwidths::FIXED);
        assert!((smoothed.total() - 101.0).abs() < 1e-2);
        assert!(smoothed.of_cell(at)[20] > smoothed.of_cell(at)[23]);
        assert!(smoothed.of_cell(cell(11, 12, 4))[20] > 1.0);
        let coarse = histogram.smoothed(Bandwidths { gray_bins: 8, ..Bandwidths::FIXED });
        assert!((coarse.total() - 101.0).abs() < 1e-2);
        let of_cell = coarse.of_cell(at);
        assert!(of_cell[20] == of_cell[23] && of_cell[19] < of_cell[20]);
    }
}
