//! What is judged of a place of the unrolled rope instead of its gray.
//!
//! Dirt and oil change gray values over long stretches without being defects. Further factors of the appearance model therefore
//! look at changes along a wire and across it, and are judged as the paper judges gray: by how likely they are on intact rope at
//! that surface point.

use super::wide::wide;

/// A further factor of the appearance model, judged by how far it is above what is expected.
///
/// Long weak damage moves grain and shading of many places a little. Their deviations with sign add up to more than their
/// surprises, and a wire that is smoother, rounder or more even than usual is not damaged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Factor {
    /// Grain along the wire, pixel by pixel, averaged over a place: pits and scratches of a wire that is neither darker nor
    /// brighter for them.
    Texture,
    /// How even that grain is in all directions. Drawn wires have streaks along them; rust, burns and torn ends have none, and dirt on
    /// the streaks darkens both alike.
    Evenness,
    /// How much of the shading is missing that makes a wire look round: worn, torn and missing wires are not, and dirt on a round
    /// wire darkens its bright and dark sides alike.
    Relief,
    /// Difference of a place from those beside it, across the wires: worn places end within a wire, clouds of dirt do not.
    Across,
    /// Slant of the grain against the wire: scratches across it all lean one way, while specks of dirt lean no way, so sums of
    /// them stay small.
    Slant,
}

/// Farthest from the middle of its scale that a factor counts: a single place must not move what is usual.
const MOST: f32 = 16.0;

/// The factors beside the gray value, in the order in which they are stored.
pub const FACTORS: [Factor; 5] = [Factor::Texture, Factor::Evenness, Factor::Relief, Factor::Across, Factor::Slant];

impl Factor {
    /// What a finding of this factor counts when those of all are added up.
    ///
    /// The likelihood ratio of damage and intact rope is a product over factors where these are independent, so findings, which are
    /// logarithms of how rare something is on intact rope, are added up. How much more likely damage makes each of them was learnt
    /// on simulated ropes: a regression (logistic, weights of at least 0, drawn towards each other) of labelled damage against dirt,
    /// oil, water and all other intact rope of seven ropes of different constructions, rounded; weights of their own for filters of
    /// different lengths find no more. On a rope that was left out they do as well as on those that were not. The gray value itself came out at 0, and so
    /// did its change along the wire: on clean rope, the edge of an oil spot changes both more than damage does.
    pub fn weight(self) -> f32 {
        match self {
            Self::Across => 0.7,
            Self::Evenness => 0.6,
            Self::Slant => 0.4,
            Self::Texture => 0.3,
            Self::Relief => 0.2,
        }
    }

    /// Whether it is as unusual to be below what is expected as above.
    pub fn both_ways(self) -> bool {
        self == Self::Slant
    }

    /// Brings measured values of the factor to a scale on which intact rope is spread evenly: for [`Self::Slant`] the mean product of
    /// changes along and across the wire as a share of their squares, for [`Self::Evenness`] the quotient of these squares,
    /// the missing share of the shading for [`Self::Relief`], and mean squared changes of gray bins for the others. NaN stays NaN.
    pub fn scale(self, values: &mut [f32]) {
        match self {
            Self::Texture => scale_each(values, |value| logarithm(value + 0.02) * 4.0),
            Self::Evenness => scale_each(values, |value| logarithm(value) * 4.0),
            Self::Relief => scale_each(values, |value| value * 10.0),
            Self::Across => scale_each(values, |value| logarithm(value + 0.02) * 2.5),
            Self::Slant => scale_each(values, |value| value * 20.0),
        }
    }
}

fn scale_each(values: &mut [f32], scaled: impl Fn(f32) -> f32) {
    wide(
        #[inline(always)]
        || {
            for value in values {
                *value = if value.is_nan() { f32::NAN } else { scaled(*value).clamp(-MOST, MOST) };
            }
        },
    );
}

/// Natural logarithm of a positive number to some 1e-7, without a call.
#[inline(always)]
fn logarithm(value: f32) -> f32 {
    /// Bits of the root of 1/2.
    const LEAST: u32 = 0x3f35_04f3;
    // value = 2^exponent * mantissa, which is between the roots of 1/2 and 2.
    let bits = value.to_bits().wrapping_sub(LEAST);
    let exponent = (bits as i32) >> 23;
    let mantissa = f32::from_bits((bits & 0x007f_ffff).wrapping_add(LEAST));
    // ln m = 2 artanh((m - 1)/(m + 1)), by its series.
    let t = (mantissa - 1.0) / (mantissa + 1.0);
    let square = t * t;
    let series = 1.0 + square * (1.0 / 3.0 + square * (1.0 / 5.0 + square * (1.0 / 7.0)));
    exponent as f32 * std::f32::consts::LN_2 + 2.0 * t * series
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_logarithm_is_one() {
        for k in 0..4000 {
            let value = 0.02 * 1.005f32.powi(k);
            let error = logarithm(value) - value.ln();
            assert!(error.abs() <= 1e-6 * value.ln().abs().max(1.0), "ln {value} is off by {error}");
        }
    }

    #[test]
    fn what_is_not_known_stays_so_and_what_is_far_out_does_not_count_more_than_most() {
        for factor in FACTORS {
            let mut values: Vec<f32> = (0..70).map(|k| if k % 3 == 0 { f32::NAN } else { k as f32 }).collect();
            factor.scale(&mut values);
            assert!(values.iter().enumerate().all(|(k, value)| value.is_nan() == (k % 3 == 0)));
            let known: Vec<f32> = values.into_iter().filter(|value| !value.is_nan()).collect();
            assert!(known.windows(2).all(|v| v[0] <= v[1]) && known.iter().all(|value| value.abs() <= MOST));
        }
        let mut values = [-9.0, 0.5, 9.0];
        Factor::Relief.scale(&mut values);
        assert_eq!(values, [-MOST, 5.0, MOST]);
    }
}
