//! What is judged of a place of the unrolled rope beside its gray.
//!
//! Dirt and oil change gray values over long stretches without being defects. Further factors of the appearance model therefore
//! look at changes along a wire and across it, and are judged like the gray itself: by how likely they are on intact rope at that
//! surface point.

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

/// Farthest from the middle of its scale that a factor counts: a single place must not move what is usual.
const MOST: f32 = 16.0;

/// The factors beside the gray value, in the order in which they are stored.
pub const FACTORS: [Factor; 4] = [Factor::Texture, Factor::Relief, Factor::Across, Factor::Step];

impl Factor {
    /// The factor of what was measured on a scale on which intact rope is spread evenly: from the missing share of the shading for
    /// [`Self::Relief`], from a mean squared change of gray bins for the others. NaN stays NaN.
    pub fn scaled(self, measured: f32) -> f32 {
        let scaled = match self {
            Self::Texture => (measured + 0.02).ln() * 4.0,
            Self::Relief => measured * 10.0,
            Self::Across | Self::Step => (measured + 0.02).ln() * 2.5,
        };
        scaled.clamp(-MOST, MOST)
    }
}
