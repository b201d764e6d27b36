//! Layers of the small networks that look closer: convolutions, and layers that see all values at once.

use super::wide::wide;
use std::array::from_fn;

/// Size of the kernels along and across.
const KERNEL: usize = 3;
/// What negative values count after every layer.
const LEAK: f32 = 0.1;

/// Channels of a result that are summed up together: two wide registers of them.
const LANES: usize = 16;
/// Columns of a result that are: weights that were fetched serve all of them. With two registers each there are enough sums under way for
/// a processor to begin one with every unit in every cycle.
const COLUMNS: usize = 4;

/// A convolution to `K` channels.
#[derive(Debug, Clone)]
pub(super) struct Convolution<const K: usize> {
    /// Channels of the result, [`LANES`] by [`LANES`], the last ones filled up with 0.
    channels: Vec<Lanes>,
}

/// Some channels of the result of a convolution.
#[derive(Debug, Clone)]
struct Lanes {
    /// `[((row * KERNEL) + column) * channels + channel]` of what is looked at.
    kernel: Vec<[f32; LANES]>,
    offset: [f32; LANES],
}

/// Values with zeros about them, and how a kernel goes over them.
struct Edged<'a> {
    values: &'a [f32],
    channels: usize,
    width: usize,
    row_stride: usize,
    column_stride: usize,
}

/// A layer that sees all values at once.
#[derive(Debug, Clone)]
pub(super) struct Dense<const K: usize> {
    weights: Vec<[f32; K]>,
    offset: [f32; K],
}

/// What a value counts after a layer.
#[inline(always)]
pub(super) fn leak(value: f32) -> f32 {
    if value > 0.0 { value } else { LEAK * value }
}

/// The next `K` numbers; what is missing is 0.
fn next<const K: usize>(numbers: &mut impl Iterator<Item = f32>) -> [f32; K] {
    from_fn(|_| numbers.next().unwrap_or(0.0))
}

impl<const K: usize> Convolution<K> {
    /// The layer as it was written: weights, then offsets.
    pub fn read(numbers: &mut impl Iterator<Item = f32>, channels: usize) -> Self {
        let kernel: Vec<[f32; K]> = (0..KERNEL * KERNEL * channels).map(|_| next(numbers)).collect();
        Self::new(&kernel, next(numbers))
    }

    fn new(kernel: &[[f32; K]], offset: [f32; K]) -> Self {
        let lanes = |all: &[f32; K], first: usize| from_fn(|lane| all.get(first + lane).copied().unwrap_or(0.0));
        let channels = (0..K).step_by(LANES).map(|first| Lanes {
            kernel: kernel.iter().map(|weights| lanes(weights, first)).collect(),
            offset: lanes(&offset, first),
        });
        Self { channels: channels.collect() }
    }

    /// Its result over values of so many channels, as many rows and columns as asked for; beyond the edges there is 0.
    pub fn over(&self, values: &[f32], channels: usize, from: (usize, usize), to: (usize, usize)) -> Vec<[f32; K]> {
        // As many rows and columns beyond either edge, one more beyond the far one where their number is odd.
        let (row_stride, column_stride) = (from.0.div_ceil(to.0), from.1.div_ceil(to.1));
        let before = |from: usize, to: usize, stride: usize| ((to - 1) * stride + KERNEL - from) / 2;
        let (rows_before, columns_before) = (before(from.0, to.0, row_stride), before(from.1, to.1, column_stride));
        let width = from.1 + KERNEL - 1;
        let mut edged = vec![0.0; (from.0 + KERNEL - 1) * width * channels];
        for (row, values) in (rows_before..).zip(values.chunks_exact(from.1 * channels)) {
            let first = (row * width + columns_before) * channels;
            edged[first..first + values.len()].copy_from_slice(values);
        }
        let mut result = vec![[0.0; K]; to.0 * to.1];
        let edged = Edged { values: &edged, channels, width, row_stride, column_stride };
        wide(
            #[inline(always)]
            || self.sum_up(&edged, &mut result, to.1),
        );
        result
    }

    /// Its result, so many columns a row. It is inlined to be compiled for registers of each width; sums are added up in the same order in all.
    #[inline(always)]
    fn sum_up(&self, edged: &Edged<'_>, result: &mut [[f32; K]], columns: usize) {
        for (row, result) in result.chunks_exact_mut(columns).enumerate() {
            for first in (0..columns).step_by(COLUMNS) {
                // Beyond the last column that one is summed up once more.
                let at: [usize; COLUMNS] = from_fn(|column| (first + column).min(columns - 1));
                for (lanes, first) in self.channels.iter().zip((0..K).step_by(LANES)) {
                    let mut sums = [lanes.offset; COLUMNS];
                    for (kernel_row, kernel) in lanes.kernel.chunks_exact(KERNEL * edged.channels).enumerate() {
                        let row = (row * edged.row_stride + kernel_row) * edged.width;
                        let about = at.map(|column| {
                            let first = (row + column * edged.column_stride) * edged.channels;
                            &edged.values[first..first + kernel.len()]
                        });
                        add(&mut sums, kernel, about);
                    }
                    for (column, sums) in at.into_iter().zip(sums) {
                        result[column][first..].iter_mut().zip(sums).for_each(|(to, sum)| *to = leak(sum));
                    }
                }
            }
        }
    }
}

/// Adds values times weights to the sums of all columns, multiplied and added in one step: twice as fast, and rounded in the same way on every
/// processor.
#[inline(always)]
fn add(sums: &mut [[f32; LANES]; COLUMNS], weights: &[[f32; LANES]], [a, b, c, d]: [&[f32]; COLUMNS]) {
    for ((((weights, a), b), c), d) in weights.iter().zip(a).zip(b).zip(c).zip(d) {
        for (sums, value) in sums.iter_mut().zip([a, b, c, d]) {
            sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum = value.mul_add(*weight, *sum));
        }
    }
}

impl<const K: usize> Dense<K> {
    /// The layer as it was written: weights, then offsets.
    pub fn read(numbers: &mut impl Iterator<Item = f32>, inputs: usize) -> Self {
        let weights = (0..inputs).map(|_| next(numbers)).collect();
        Self { weights, offset: next(numbers) }
    }

    /// What it makes of values.
    pub fn of(&self, values: impl Iterator<Item = f32>) -> [f32; K] {
        let mut sums = self.offset;
        for (value, weights) in values.zip(&self.weights) {
            sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += value * weight);
        }
        sums
    }
}

/// Numbers of a file of weights: little-endian f32.
pub(super) fn numbers(bytes: &[u8]) -> impl Iterator<Item = f32> {
    bytes.as_chunks::<4>().0.iter().map(|&bytes| f32::from_le_bytes(bytes))
}

/// How many numbers a convolution has, and a dense layer, of so many channels or inputs to so many.
#[cfg(test)]
pub(super) mod counts {
    pub fn convolution(channels: usize, to: usize) -> usize {
        super::KERNEL * super::KERNEL * channels * to + to
    }

    pub fn dense(inputs: usize, to: usize) -> usize {
        inputs * to + to
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_convolution_sums_what_lies_about_a_place_and_nothing_beyond_the_edge() {
        // Ones everywhere: the result counts the values under the kernel.
        let ones = Convolution::new(&[[1.0]; KERNEL * KERNEL], [0.5]);
        let counted = ones.over(&[1.0; 28 * 15], 1, (28, 15), (14, 15));
        // Two rows a step, so the kernel of the last row reaches one beyond, as the first and the last column do.
        assert_eq!((counted[0][0], counted[1][0], counted[15 * 13 + 7][0]), (6.5, 9.5, 6.5));
        let halved = ones.over(&[1.0; 14 * 15], 1, (14, 15), (7, 8));
        assert_eq!((halved[0][0], halved[1][0], halved[7][0]), (6.5, 9.5, 6.5));
        let negative = Convolution::new(&[[-1.0]; KERNEL * KERNEL], [0.0]);
        assert!((negative.over(&[1.0; 28 * 15], 1, (28, 15), (14, 15))[1][0] + 0.9).abs() < 1e-6);
    }

    #[test]
    fn every_channel_is_summed_up_by_its_own_weights() {
        // Two channels to ten: the sums of single values, times 1 to 10, and of those of the other channel.
        let weights = |channel: usize| from_fn(|k| if channel == 0 { k as f32 + 1.0 } else { 100.0 });
        let kernel: Vec<[f32; 10]> = (0..KERNEL * KERNEL).flat_map(|_| [weights(0), weights(1)]).collect();
        let mut values = [0.0; 6 * 5 * 2];
        (values[2 * (2 * 5 + 2)], values[2 * (2 * 5 + 4) + 1]) = (1.0, 1.0);
        let result = Convolution::new(&kernel, [0.0; 10]).over(&values, 2, (6, 5), (6, 5));
        for (at, sums) in result.iter().enumerate() {
            let near = |row: usize, column: usize| (at / 5).abs_diff(row) <= 1 && (at % 5).abs_diff(column) <= 1;
            let (one, other) = (near(2, 2), near(2, 4));
            let expected: [f32; 10] =
                from_fn(|k| if one { k as f32 + 1.0 } else { 0.0 } + if other { 100.0 } else { 0.0 });
            assert_eq!(sums, &expected, "row {}, column {}", at / 5, at % 5);
        }
    }
}
