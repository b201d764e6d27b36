//! What is usual of a further factor at every surface cell: its mean on intact rope, and how much it varies.
//!
//! The gray value needs its whole density, because a wire may be dark or bright. Further factors are judged by how far they are above
//! what is expected, for which two moments are enough. They are smoothed over the cells as the density of eq. 18 is.

use super::appearance::{CUT, LEAST_OBSERVATIONS, OBSERVATIONS_AROUND};
use super::histogram::{CELLS, smooth_over_cells};
use std::ops::AddAssign;

/// Standard deviations of the Gaussian window along (strand phase, wire phase, distance), in bins: wider than for gray values, because
/// there is one value where there are thirty of those.
const SIGMA_BINS: [f32; 3] = [2.0, 1.6, 1.0];
/// Variance that values have at the least: few of them that are alike must not make everything else rare.
const LEAST_VARIANCE: f32 = 1.4;

/// Number, sum and sum of squares of the values that were seen, side by side for every cell.
const MOMENTS: usize = 3;

/// Gathers the values of a factor on intact rope.
#[derive(Debug, Clone, PartialEq)]
pub struct Moments {
    sums: Vec<f32>,
}

impl Default for Moments {
    fn default() -> Self {
        Self { sums: vec![0.0; CELLS * MOMENTS] }
    }
}

impl Moments {
    /// Adds the value of a place that shows this cell.
    #[inline]
    pub fn add(&mut self, cell: usize, value: f32) {
        let sums = &mut self.sums[cell * MOMENTS..(cell + 1) * MOMENTS];
        sums[0] += 1.0;
        sums[1] += value;
        sums[2] += value * value;
    }
}

impl AddAssign<&Moments> for Moments {
    fn add_assign(&mut self, other: &Moments) {
        self.sums.iter_mut().zip(&other.sums).for_each(|(a, b)| *a += b);
    }
}

/// Mean and spread of a factor at every cell; NaN in cells that were not seen often enough.
#[derive(Debug, Clone, PartialEq)]
pub struct Usual {
    mean: Vec<f32>,
    spread: Vec<f32>,
}

impl Usual {
    /// Learns from what was gathered on intact rope.
    pub fn learn(moments: &Moments) -> Self {
        let around = smooth_over_cells(&moments.sums, MOMENTS, SIGMA_BINS);
        let cells = around.as_chunks::<MOMENTS>().0.iter().zip(moments.sums.as_chunks::<MOMENTS>().0);
        let of_cell = |(&[n, sum, squares], &[own_n, own_sum, _]): (&[f32; MOMENTS], &[f32; MOMENTS])| {
            if n < LEAST_OBSERVATIONS {
                return (f32::NAN, f32::NAN);
            }
            let mean_around = sum / n;
            let variance = (squares / n - mean_around * mean_around).max(0.0);
            // A cell's own mean: the window takes in the cells around, where the factor is usually greater or less.
            let mean = (own_sum + OBSERVATIONS_AROUND * mean_around) / (own_n + OBSERVATIONS_AROUND);
            (mean, (variance + LEAST_VARIANCE).sqrt())
        };
        let (mean, spread) = cells.map(of_cell).unzip();
        Self { mean, spread }
    }

    /// Restores it from its tables. `None` if their sizes are not those of this version.
    pub fn from_tables([mean, spread]: [Vec<f32>; 2]) -> Option<Self> {
        (mean.len() == CELLS && spread.len() == CELLS).then_some(Self { mean, spread })
    }

    /// The tables that [`Self::from_tables`] restores: mean and spread, one value a cell.
    pub fn tables(&self) -> [&[f32]; 2] {
        [&self.mean, &self.spread]
    }

    /// How many standard deviations a value is above what is usual of a cell, at most so many; NaN where that is not known.
    #[inline]
    pub fn above(&self, cell: usize, value: f32) -> f32 {
        ((value - self.mean[cell]) / self.spread[cell]).clamp(-CUT, CUT)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::histogram::cell;

    fn moments(of: impl Fn(usize) -> f32) -> Moments {
        let mut moments = Moments::default();
        for strand in 8..20 {
            for wire in 6..18 {
                for distance in 0..8 {
                    (0..400).for_each(|k| moments.add(cell(strand, wire, distance), of(k)));
                }
            }
        }
        moments
    }

    #[test]
    fn a_value_is_judged_by_mean_and_spread_of_its_cell_and_unknown_cells_judge_nothing() {
        // 10 and 16 in turn: mean 13, standard deviation 3.
        let usual = Usual::learn(&moments(|k| if k % 2 == 0 { 10.0 } else { 16.0 }));
        let at = cell(14, 12, 4);
        let spread = (9.0 + LEAST_VARIANCE).sqrt();
        assert!(usual.above(at, 13.0).abs() < 1e-3);
        assert!((usual.above(at, 19.0) - 6.0 / spread).abs() < 1e-3);
        assert_eq!((usual.above(at, 1e4), usual.above(at, -1e4)), (CUT, -CUT));
        assert!(usual.above(cell(30, 22, 0), 13.0).is_nan());
    }

    #[test]
    fn a_cell_of_its_own_kind_is_judged_by_itself_and_equal_values_leave_room() {
        let mut learnt = moments(|_| 8.0);
        let own = cell(14, 12, 4);
        (0..4000).for_each(|_| learnt.add(own, 12.0));
        let usual = Usual::learn(&learnt);
        assert!(usual.above(own, 11.6) < 0.2, "{}", usual.above(own, 11.6));
        let alike = Usual::learn(&moments(|_| 8.0));
        assert!(alike.above(own, 9.0) < 1.0);
    }

    #[test]
    fn two_recordings_teach_as_one_and_tables_restore_what_was_learnt() {
        let (even, odd) = (moments(|k| (k % 7) as f32), moments(|k| (k % 5) as f32));
        let mut both = even.clone();
        both += &odd;
        let usual = Usual::learn(&both);
        assert!(usual.above(cell(14, 12, 4), 2.5).abs() < 0.05);
        let [mean, spread] = usual.tables().map(<[f32]>::to_vec);
        // NaN is not equal to itself.
        let bits = |table: &[f32]| table.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        let restored = Usual::from_tables([mean.clone(), spread]).unwrap();
        assert!(restored.tables().map(bits) == usual.tables().map(bits));
        assert!(Usual::from_tables([mean, vec![1.0]]).is_none());
    }
}
