//! Whether a detail of the image shows a burn: a small network beside that of `damage`.
//!
//! An arc melts a spot of a wire: a dark crater of one to six millimetres with a thin bright rim. On the unrolled rope, whose places are half
//! a millimetre long, the rim of a small one is gone, and what is left looks like a drop or a speck of dirt. In the image it is plain.

use super::detail::LAYERS;
use super::layers::{Convolution, Dense, leak, numbers};

/// Rows and columns of the details that it looks at.
pub const SIDE: usize = 48;
/// Channels after every layer; each halves rows and columns.
const FIRST: usize = 12;
const SECOND: usize = 24;
const THIRD: usize = 32;
const FOURTH: usize = 48;
const LAST: usize = 32;
/// Rows and columns of the result of the last convolution.
const AT_LAST: usize = SIDE / 16;
/// Weights and offsets as `training/fit_burns.py` writes them.
const TRAINED: &[u8] = include_bytes!("burn.weights");

/// The network.
#[derive(Debug, Clone)]
pub struct BurnNetwork {
    first: Convolution<FIRST>,
    second: Convolution<SECOND>,
    third: Convolution<THIRD>,
    fourth: Convolution<FOURTH>,
    last: Dense<LAST>,
    result: Dense<1>,
}

impl BurnNetwork {
    /// The network as it was learnt.
    pub fn trained() -> Self {
        let numbers = &mut numbers(TRAINED);
        Self {
            first: Convolution::read(numbers, LAYERS),
            second: Convolution::read(numbers, FIRST),
            third: Convolution::read(numbers, SECOND),
            fourth: Convolution::read(numbers, THIRD),
            last: Dense::read(numbers, 2 * FOURTH),
            result: Dense::read(numbers, LAST),
        }
    }

    /// Logarithm of the odds that a detail shows a burn.
    pub fn look(&self, detail: &[f32]) -> f32 {
        let square = |layer: usize| (SIDE >> layer, SIDE >> layer);
        let first = self.first.over(detail, LAYERS, square(0), square(1));
        let second = self.second.over(first.as_flattened(), FIRST, square(1), square(2));
        let third = self.third.over(second.as_flattened(), SECOND, square(2), square(3));
        let fourth = self.fourth.over(third.as_flattened(), THIRD, square(3), square(4));
        let middle = fourth[AT_LAST / 2 * AT_LAST + AT_LAST / 2];
        let most = fourth.iter().fold([f32::NEG_INFINITY; FOURTH], |most, values| {
            std::array::from_fn(|channel| most[channel].max(values[channel]))
        });
        let [log_odds] = self.result.of(self.last.of(middle.into_iter().chain(most)).map(leak).into_iter());
        log_odds
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::layers::counts::{convolution, dense};

    #[test]
    fn the_weights_that_are_shipped_are_as_many_as_the_network_has() {
        let all = convolution(LAYERS, FIRST)
            + convolution(FIRST, SECOND)
            + convolution(SECOND, THIRD)
            + convolution(THIRD, FOURTH);
        assert_eq!(TRAINED.len() / 4, all + dense(2 * FOURTH, LAST) + dense(LAST, 1));
        assert!(numbers(TRAINED).all(f32::is_finite));
    }
}
