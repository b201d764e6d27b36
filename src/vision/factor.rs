//! What is judged of a place of the unrolled rope beside its gray.
//!
//! Dirt and oil change gray values over long stretches without being defects. Further factors of the appearance model therefore
//! look at changes along a wire and across it, and are judged like the gray itself: by how likely they are on intact rope at that
//! surface point.

use super::histogram::GRAY_BINS;
use std::ops::RangeInclusive;

/// Lengths of the filters in mm under which the gray value is asked: a long shade is dirt or light more often than damage.
pub const GRAY_LENGTHS_MM: RangeInclusive<f64> = 0.0..=12.0;
/// The same for the further factors: of a single millimetre they tell mostly chance.
pub const FACTOR_LENGTHS_MM: RangeInclusive<f64> = 4.0..=40.0;

/// A further factor of the appearance model, judged by how far it is above what is expected.
///
/// Long weak damage moves grain and shading of many places a little. Their deviations with sign add up to more than their
/// surprises, and a wire that is smoother, rounder or more even than usual is not damaged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Factor {
    /// Grain along the wire, pixel by pixel, averaged over a place: pits and scratches of a wire that is neither darker nor
    /// brighter for them.
    Texture,
    /// How much of the shading is missing that makes a wire look round: worn, torn and missing wires are not, and dirt on a round
    /// wire darkens its bright and dark sides alike.
    Relief,
    /// Difference of a place from those beside it, across the wires: worn places end within a wire, clouds of dirt do not.
    Across,
    /// Difference of a place from its own wire a little before and behind: ends, gaps and rims.
    Step,
}

/// The factors beside the gray value, in the order in which they are stored.
pub const FACTORS: [Factor; 4] = [Factor::Texture, Factor::Relief, Factor::Across, Factor::Step];

impl Factor {
    /// Bin of the factor's value: missing share of the shading for [`Self::Relief`], a mean squared change of gray bins for the
    /// others. `None` for NaN.
    pub fn bin(self, value: f32) -> Option<u8> {
        if value.is_nan() {
            return None;
        }
        let centred = match self {
            Self::Texture => (value + 0.02).ln() * 4.0,
            Self::Relief => value * 10.0,
            Self::Across | Self::Step => (value + 0.02).ln() * 2.5,
        };
        Some((centred + GRAY_BINS as f32 / 2.0).clamp(0.0, GRAY_BINS as f32 - 1.0) as u8)
    }
}
