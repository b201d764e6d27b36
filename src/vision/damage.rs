//! Whether a patch of rope looks like damage or like what lies on intact rope: a small network.
//!
//! A finding says how rare something is on intact rope, and a lump of grease is as rare as a broken wire. Their shapes differ: damage
//! keeps to its wire, foreign matter lies across wires and valleys alike. Which shapes are which is the same on every rope once gray is
//! told against what that rope's own model expects, so it was learnt beforehand, on simulated ropes (`training/`), and not from
//! the rope in question, on which nobody knows a defect.

use super::kind::Likely;
use super::layers::{Convolution, Dense, leak, numbers};
use super::patch::{BLOCKS, LAYERS, PLACES, Patch};

/// What the network tells of a patch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Told {
    /// Logarithm of the odds that it shows damage, among such patches of the ropes that it learnt from.
    pub log_odds: f32,
    /// If it does, which; the sum is 1.
    pub likely: Likely,
    /// Whether that is a burn, which was seen in the image.
    pub burn: bool,
}

/// Channels after every layer.
const FIRST: usize = 16;
const SECOND: usize = 32;
const THIRD: usize = 48;
const LAST: usize = 32;
/// Results: the logarithm of the odds, and one for each way of damage.
const RESULTS: usize = 4;
/// Rows and columns of every layer's result: the strides are (2, 1), (2, 2), (2, 2).
const SIZES: [(usize, usize); 4] = [(BLOCKS, PLACES), (14, 15), (7, 8), (4, 4)];
/// Rows and columns of the last one that are about the middle.
const MIDDLE: std::ops::Range<usize> = 1..3;
/// Score that counts 1 as an input.
const SCORE: f32 = 10.0;
/// Weights and offsets as `training/fit_patches.py` writes them: little-endian f32, layer by layer.
const TRAINED: &[u8] = include_bytes!("damage.weights");

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
        let numbers = &mut numbers(TRAINED);
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
        Told { log_odds, likely: Likely { interrupted, protruding, surface }, burn: false }
    }
}

/// Shares whose logarithms these are, up to a sum.
fn shares<const K: usize>(logarithms: [f32; K]) -> [f64; K] {
    let most = logarithms.into_iter().fold(f32::NEG_INFINITY, f32::max);
    let odds = logarithms.map(|logarithm| f64::from(logarithm - most).exp());
    let all: f64 = odds.iter().sum();
    odds.map(|odds| odds / all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::layers::counts::{convolution, dense};

    #[test]
    fn the_weights_that_are_shipped_are_as_many_as_the_network_has() {
        let all = convolution(LAYERS, FIRST) + convolution(FIRST, SECOND) + convolution(SECOND, THIRD);
        assert_eq!(TRAINED.len() / 4, all + dense(2 * THIRD + 1, LAST) + dense(LAST, RESULTS));
        assert!(numbers(TRAINED).all(f32::is_finite));
    }

    #[test]
    fn it_tells_what_it_told_where_it_was_learnt() {
        // What `training/fit_patches.py` makes of the same numbers by the same weights.
        let wave = |k: usize| 0.3 * ((k as f64 * 0.013).sin() * 0.6 + (k as f64 * 0.37).sin() * 0.3);
        let patch = Patch::of((0..BLOCKS * PLACES * LAYERS).map(|k| wave(k) as f32).collect());
        for (score, log_odds, surface) in [(4.0, -3.233_72, 0.830_46), (7.0, -1.886_50, 0.846_31)] {
            let told = Network::trained().look(&patch, score);
            assert!(
                (told.log_odds - log_odds).abs() < 2e-3 && (told.likely.surface - surface).abs() < 1e-3,
                "{told:?}"
            );
        }
    }

    #[test]
    fn shares_add_up_to_1_however_large_their_logarithms_are() {
        let [a, b] = shares([500.0, 500.0 - 3.0f32.ln()]);
        assert!((a - 0.75).abs() < 1e-4 && (a + b - 1.0).abs() < 1e-12, "{a} {b}");
    }
}
