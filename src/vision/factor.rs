//! What is judged of a place of the unrolled rope beside its gray.
//!
//! Dirt and oil change gray values over long stretches without being defects; broken ends, pits and burns change them over a
//! millimetre. Further factors of the appearance model therefore look along the wire, and all are judged like the gray itself:
//! by how likely they are on intact rope at that surface point.

use super::appearance::Appearance;
use super::histogram::GRAY_BINS;

/// A further factor of the appearance model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Factor {
    /// Difference of a place from its own wire, some millimetres before and behind.
    Contrast,
    /// Change of the deviation from block to block, averaged over a few millimetres.
    Roughness,
    /// Grain along the wire, pixel by pixel, averaged over a place: pits and scratches of a wire that is neither darker nor
    /// brighter for them.
    Texture,
    /// The same grain against that across the wire. Drawn wires are streaked along their course, and clouds of dirt have edges in
    /// all directions; rust and scratches have more grain along the wire than either.
    Isotropy,
}

/// The factors beside the gray value, in the order in which they are stored.
pub const FACTORS: [Factor; 4] = [Factor::Contrast, Factor::Roughness, Factor::Texture, Factor::Isotropy];

impl Factor {
    /// Anomaly score of a bin of the factor: 0 on average over intact rope, 1 is one standard deviation.
    ///
    /// Long weak damage moves the grain of many places a little. Their deviations with sign add up to more than their
    /// surprises, and a wire that is smoother than usual is not damaged.
    pub fn score(self, appearance: &Appearance, cell: usize, bin: u8) -> f32 {
        match self {
            Self::Contrast | Self::Roughness => appearance.score(cell, bin),
            Self::Texture | Self::Isotropy => appearance.above(cell, bin),
        }
    }

    /// Shortest filter along the wire that says anything in mm: grain of a single place is mostly chance, and the fewer filters
    /// are asked, the less often one of them is wrong.
    pub fn shortest_mm(self) -> f64 {
        match self {
            Self::Contrast => 0.0,
            Self::Roughness | Self::Texture => 3.0,
            Self::Isotropy => 10.0,
        }
    }

    /// Bin of the factor's value: change of gray bins for [`Self::Contrast`], mean squared changes for [`Self::Roughness`] and
    /// [`Self::Texture`], ratio of those for [`Self::Isotropy`]. `None` for NaN.
    pub fn bin(self, value: f32) -> Option<u8> {
        let centred = match self {
            Self::Contrast => value * 1.6,
            Self::Roughness => (value + 0.01).ln() * 3.0,
            Self::Texture => (value + 0.02).ln() * 4.0,
            Self::Isotropy => value.ln() * 4.0,
        };
        let bin = (centred + GRAY_BINS as f32 / 2.0).clamp(0.0, GRAY_BINS as f32 - 1.0);
        (!bin.is_nan()).then_some(bin as u8)
    }
}
