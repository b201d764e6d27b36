//! What is judged of a place of the unrolled rope beside its gray.
//!
//! Dirt and oil change gray values over long stretches without being defects. Further factors of the appearance model therefore
//! look at changes along a wire and across it, and are judged like the gray itself: by how likely they are on intact rope at that
//! surface point.

use super::appearance::Appearance;
use super::histogram::GRAY_BINS;
use std::ops::RangeInclusive;

/// Lengths of the filters in mm under which the gray value is asked: a long shade is dirt or light more often than damage.
pub const GRAY_LENGTHS_MM: RangeInclusive<f64> = 0.0..=12.0;
/// The same for the further factors: of a single millimetre they tell mostly chance.
pub const FACTOR_LENGTHS_MM: RangeInclusive<f64> = 4.0..=40.0;

/// A further factor of the appearance model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Factor {
    /// Difference of a place from its own wire, some millimetres before and behind.
    Contrast,
    /// Grain along the wire, pixel by pixel, averaged over a place: pits and scratches of a wire that is neither darker nor
    /// brighter for them.
    Texture,
    /// How much of the shading is missing that makes a wire look round: worn, torn and missing wires are not, and dirt on a round
    /// wire darkens its bright and dark sides alike.
    Relief,
}

/// The factors beside the gray value, in the order in which they are stored.
pub const FACTORS: [Factor; 3] = [Factor::Contrast, Factor::Texture, Factor::Relief];

impl Factor {
    /// Anomaly score of a bin of the factor: 0 on average over intact rope, 1 is one standard deviation.
    ///
    /// Long weak damage moves grain and shading of many places a little. Their deviations with sign add up to more than their
    /// surprises, and a wire that is smoother or rounder than usual is not damaged.
    pub fn score(self, appearance: &Appearance, cell: usize, bin: u8) -> f32 {
        match self {
            Self::Contrast => appearance.score(cell, bin),
            Self::Texture | Self::Relief => appearance.above(cell, bin),
        }
    }

    /// Bin of the factor's value: change of gray bins for [`Self::Contrast`], mean squared change for [`Self::Texture`], missing
    /// share of the shading for [`Self::Relief`]. `None` for NaN.
    pub fn bin(self, value: f32) -> Option<u8> {
        let centred = match self {
            Self::Contrast => value * 1.6,
            Self::Texture => (value + 0.02).ln() * 4.0,
            Self::Relief => value * 10.0,
        };
        let bin = (centred + GRAY_BINS as f32 / 2.0).clamp(0.0, GRAY_BINS as f32 - 1.0);
        (!bin.is_nan()).then_some(bin as u8)
    }
}
