//! Whether a patch of rope looks like damage or like what lies on intact rope: a small network.
//!
//! A finding says how rare something is on intact rope, and a lump of grease is as rare as a broken wire. Their shapes differ: damage
//! keeps to its wire, foreign matter lies across wires and valleys alike. Which shapes are which is the same on every rope once gray is
//! told against what that rope's own model expects, so it was learnt beforehand, on simulated ropes (`training/`), and not from
//! the rope in question, on which nobody knows a defect.

use super::kind::Likely;
use super::patch::{BLOCKS, LAYERS, PLACES, Patch};
use std::array::from_fn;

/// What the network tells of a patch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Told {
    /// Logarithm of the odds that it shows damage, among such patches of the ropes that it learnt from.
    pub log_odds: f32,
    /// If it does, which; the sum is 1.
    pub likely: Likely,
}

/// Size of the kernels along and across.
const KERNEL: usize = 3;
/// What negative values count after every layer.
const LEAK: f32 = 0.1;
/// Channels after every layer.
const FIRST: usize = 10;
const SECOND: usize = 20;
const THIRD: usize = 32;
const LAST: usize = 24;
/// Results: the logarithm of the odds, and one for each way of damage.
const RESULTS: usize = 4;
/// Rows and columns of every layer's result: the strides are (2, 1), (2, 2), (2, 2).
const SIZES: [(usize, usize); 4] = [(BLOCKS, PLACES), (14, 15), (7, 8), (4, 4)];
/// Rows and columns of the last one that are about the middle.
const MIDDLE: std::ops::Range<usize> = 1..3;
/// Score that counts 1 as an input.
const SCORE: f32 = 10.0;
/// Weights and offsets as `training/fit.py` writes them: little-endian f32, layer by layer.
const TRAINED: &[u8] = include_bytes!("damage.weights");

/// A convolution to `K` channels.
#[derive(Debug, Clone)]
struct Convolution<const K: usize> {
    /// `[((row * KERNEL) + column) * channels + channel]`.
    kernel: Vec<[f32; K]>,
    offset: [f32; K],
}

/// A layer that sees all values at once.
#[derive(Debug, Clone)]
struct Dense<const K: usize> {
    weights: Vec<[f32; K]>,
    offset: [f32; K],
}

/// The network.
#[derive(Debug, Clone)]
pub struct Network {
    first: Convolution<FIRST>,
    second: Convolution<SECOND>,
    third: Convolution<THIRD>,
    last: Dense<LAST>,
    result: Dense<RESULTS>,
}

impl Network {
    /// The network as it was learnt.
    pub fn trained() -> Self {
        let mut numbers = TRAINED.as_chunks::<4>().0.iter().map(|&bytes| f32::from_le_bytes(bytes));
        let numbers = &mut numbers;
        Self {
            first: Convolution::read(numbers, LAYERS),
            second: Convolution::read(numbers, FIRST),
            third: Convolution::read(numbers, SECOND),
            last: Dense::read(numbers, 2 * THIRD + 1),
            result: Dense::read(numbers, LAST),
        }
    }

    /// Looks at a patch whose middle has this score.
    pub fn look(&self, patch: &Patch, score: f32) -> Told {
        let first = self.first.over(patch.values(), LAYERS, SIZES[0], SIZES[1]);
        let second = self.second.over(first.as_flattened(), FIRST, SIZES[1], SIZES[2]);
        let third = self.third.over(second.as_flattened(), SECOND, SIZES[2], SIZES[3]);
        let (mut middle, mut all) = ([0.0; THIRD], [0.0; THIRD]);
        for (at, values) in third.iter().enumerate() {
            let in_middle = MIDDLE.contains(&(at / SIZES[3].1)) && MIDDLE.contains(&(at % SIZES[3].1));
            for ((middle, all), value) in middle.iter_mut().zip(&mut all).zip(values) {
                *all += value / third.len() as f32;
                *middle += if in_middle { value / (MIDDLE.len() * MIDDLE.len()) as f32 } else { 0.0 };
            }
        }
        let seen = middle.into_iter().chain(all).chain([score / SCORE]);
        let last = self.last.of(seen).map(leak);
        let [log_odds, ways @ ..] = self.result.of(last.into_iter());
        let [interrupted, protruding, surface] = shares(ways);
        Told { log_odds, likely: Likely { interrupted, protruding, surface } }
    }
}

/// Shares whose logarithms these are, up to a sum.
fn shares<const K: usize>(logarithms: [f32; K]) -> [f64; K] {
    let most = logarithms.into_iter().fold(f32::NEG_INFINITY, f32::max);
    let odds = logarithms.map(|logarithm| f64::from(logarithm - most).exp());
    let all: f64 = odds.iter().sum();
    odds.map(|odds| odds / all)
}

#[inline]
fn leak(value: f32) -> f32 {
    if value > 0.0 { value } else { LEAK * value }
}

/// The next `K` numbers; what is missing is 0.
fn next<const K: usize>(numbers: &mut impl Iterator<Item = f32>) -> [f32; K] {
    from_fn(|_| numbers.next().unwrap_or(0.0))
}

impl<const K: usize> Convolution<K> {
    fn read(numbers: &mut impl Iterator<Item = f32>, channels: usize) -> Self {
        let kernel = (0..KERNEL * KERNEL * channels).map(|_| next(numbers)).collect();
        Self { kernel, offset: next(numbers) }
    }

    /// Its result over values of so many channels, as many rows and columns as asked for; beyond the edges there is 0.
    fn over(&self, values: &[f32], channels: usize, from: (usize, usize), to: (usize, usize)) -> Vec<[f32; K]> {
        // As many rows and columns beyond either edge, one more beyond the far one where their number is odd.
        let (row_stride, column_stride) = (from.0.div_ceil(to.0), from.1.div_ceil(to.1));
        let before = |from: usize, to: usize, stride: usize| ((to - 1) * stride + KERNEL - from) / 2;
        let (rows_before, columns_before) = (before(from.0, to.0, row_stride), before(from.1, to.1, column_stride));
        let mut result = vec![self.offset; to.0 * to.1];
        for (at, sums) in result.iter_mut().enumerate() {
            let (row, column) = (at / to.1 * row_stride, at % to.1 * column_stride);
            for tap in 0..KERNEL * KERNEL {
                let (row, column) = (row + tap / KERNEL, column + tap % KERNEL);
                let inside = (rows_before..rows_before + from.0).contains(&row)
                    && (columns_before..columns_before + from.1).contains(&column);
                if !inside {
                    continue;
                }
                let first = ((row - rows_before) * from.1 + column - columns_before) * channels;
                let taps = values[first..first + channels].iter().zip(&self.kernel[tap * channels..]);
                for (value, weights) in taps {
                    sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += value * weight);
                }
            }
            *sums = sums.map(leak);
        }
        result
    }
}

impl<const K: usize> Dense<K> {
    fn read(numbers: &mut impl Iterator<Item = f32>, inputs: usize) -> Self {
        let weights = (0..inputs).map(|_| next(numbers)).collect();
        Self { weights, offset: next(numbers) }
    }

    fn of(&self, values: impl Iterator<Item = f32>) -> [f32; K] {
        let mut sums = self.offset;
        for (value, weights) in values.zip(&self.weights) {
            sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += value * weight);
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_weights_that_are_shipped_are_as_many_as_the_network_has() {
        let convolution = |channels: usize, k: usize| KERNEL * KERNEL * channels * k + k;
        let dense = |inputs: usize, k: usize| inputs * k + k;
        let numbers = convolution(LAYERS, FIRST) + convolution(FIRST, SECOND) + convolution(SECOND, THIRD);
        assert_eq!(TRAINED.len() / 4, numbers + dense(2 * THIRD + 1, LAST) + dense(LAST, RESULTS));
        assert!(TRAINED.as_chunks::<4>().0.iter().all(|&bytes| f32::from_le_bytes(bytes).is_finite()));
    }

    #[test]
    fn shares_add_up_to_1_however_large_their_logarithms_are() {
        let [a, b] = shares([500.0, 500.0 - 3.0f32.ln()]);
        assert!((a - 0.75).abs() < 1e-4 && (a + b - 1.0).abs() < 1e-12, "{a} {b}");
    }

    #[test]
    fn a_convolution_sums_what_lies_about_a_place_and_nothing_beyond_the_edge() {
        // Ones everywhere: the result counts the values under the kernel.
        let ones = Convolution { kernel: vec![[1.0]; KERNEL * KERNEL], offset: [0.5] };
        let counted = ones.over(&[1.0; 28 * 15], 1, (28, 15), (14, 15));
        // Two rows a step, so the kernel of the last row reaches one beyond, as the first and the last column do.
        assert_eq!((counted[0][0], counted[1][0], counted[15 * 13 + 7][0]), (6.5, 9.5, 6.5));
        let halved = ones.over(&[1.0; 14 * 15], 1, (14, 15), (7, 8));
        assert_eq!((halved[0][0], halved[1][0], halved[7][0]), (6.5, 9.5, 6.5));
        let negative = Convolution { kernel: vec![[-1.0]; KERNEL * KERNEL], offset: [0.0] };
        assert!((negative.over(&[1.0; 28 * 15], 1, (28, 15), (14, 15))[1][0] + 0.9).abs() < 1e-6);
    }
}
