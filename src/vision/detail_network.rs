//! What a detail of the image shows: a small network beside that of `damage`, which says whether to believe what that one told, and
//! whether there is a burn.
//!
//! On the unrolled rope, whose places are half a millimetre long, a torn edge, the bright dot in a drop and the thin rim of a small burn
//! are gone. In the image they are plain. An arc melts a spot of a wire: a dark crater of one to six millimetres with a bright rim; small ones
//! hardly stand out of a patch, so burns are looked for whatever the patch told.

use super::damage::Told;
use super::detail::LAYERS;
use super::kind::Likely;
use super::layers::{Convolution, Dense, leak, numbers};

/// Rows and columns of the details that it looks at.
pub const SIDE: usize = 48;
/// Channels after every layer; each halves rows and columns.
const FIRST: usize = 16;
const SECOND: usize = 32;
const THIRD: usize = 48;
const FOURTH: usize = 64;
const LAST: usize = 32;
/// Rows and columns of the result of the last convolution.
const AT_LAST: usize = SIDE / 16;
/// Logarithm of the odds, and score, that count 1 as inputs.
const ODDS: f32 = 4.0;
const SCORE: f32 = 10.0;
/// Most that a detail lowers what a patch told: of damage that nobody has shown it, the network knows nothing.
const MOST_AGAINST: f32 = 4.0;
/// How much rarer burns are on ropes than among what the network learnt from, of which a fifth had burns painted on: a logarithm, chosen by
/// ropes held back.
const RARER_BURNS: f32 = 1.0;
/// Weights and offsets as `training/fit_details.py` writes them.
const TRAINED: &[u8] = include_bytes!("detail.weights");

/// Logarithms of odds that a detail tells.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Odds {
    /// Of a burn.
    burn: f32,
    /// Of any damage, of what the patch took to be so likely.
    damage: f32,
}

/// The network.
#[derive(Debug, Clone)]
pub struct DetailNetwork {
    first: Convolution<FIRST>,
    second: Convolution<SECOND>,
    third: Convolution<THIRD>,
    fourth: Convolution<FOURTH>,
    of_burn: (Dense<LAST>, Dense<1>),
    of_damage: (Dense<LAST>, Dense<1>),
}

impl DetailNetwork {
    /// The network as it was learnt.
    pub fn trained() -> Self {
        let numbers = &mut numbers(TRAINED);
        Self {
            first: Convolution::read(numbers, LAYERS),
            second: Convolution::read(numbers, FIRST),
            third: Convolution::read(numbers, SECOND),
            fourth: Convolution::read(numbers, THIRD),
            of_burn: (Dense::read(numbers, 2 * FOURTH), Dense::read(numbers, LAST)),
            of_damage: (Dense::read(numbers, 2 * FOURTH + 2), Dense::read(numbers, LAST)),
        }
    }

    /// Looks at a detail about a suspect with this score, of which its patch told so much.
    pub fn look(&self, detail: &[f32], told: Told, score: f32) -> Told {
        let Odds { burn, damage } = self.odds(detail, told.log_odds, score);
        let damage = damage.max(told.log_odds - MOST_AGAINST);
        if burn > damage {
            return Told { log_odds: burn, likely: Likely::SURFACE, burn: true };
        }
        Told { log_odds: damage, ..told }
    }

    fn odds(&self, detail: &[f32], told: f32, score: f32) -> Odds {
        let square = |layer: usize| (SIDE >> layer, SIDE >> layer);
        let first = self.first.over(detail, LAYERS, square(0), square(1));
        let second = self.second.over(first.as_flattened(), FIRST, square(1), square(2));
        let third = self.third.over(second.as_flattened(), SECOND, square(2), square(3));
        let fourth = self.fourth.over(third.as_flattened(), THIRD, square(3), square(4));
        let middle = fourth[AT_LAST / 2 * AT_LAST + AT_LAST / 2];
        let most = fourth.iter().fold([f32::NEG_INFINITY; FOURTH], |most, values| {
            std::array::from_fn(|channel| most[channel].max(values[channel]))
        });
        let seen = middle.into_iter().chain(most);
        let of = |(last, result): &(Dense<LAST>, Dense<1>), told: &[f32]| {
            let [log_odds] = result.of(last.of(seen.clone().chain(told.iter().copied())).map(leak).into_iter());
            log_odds
        };
        Odds {
            burn: of(&self.of_burn, &[]) - RARER_BURNS,
            damage: told + of(&self.of_damage, &[told / ODDS, score / SCORE]),
        }
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
        let heads = dense(2 * FOURTH, LAST) + dense(2 * FOURTH + 2, LAST) + 2 * dense(LAST, 1);
        assert_eq!(TRAINED.len() / 4, all + heads);
        assert!(numbers(TRAINED).all(f32::is_finite));
    }

    #[test]
    fn it_tells_what_it_told_where_it_was_learnt() {
        // What `training/fit_details.py` makes of the same numbers by the same weights.
        let wave = |k: usize| (k as f64 * 0.013).sin() * 0.6 + (k as f64 * 0.37).sin() * 0.3;
        let detail: Vec<f32> = (0..SIDE * SIDE * LAYERS).map(|k| wave(k) as f32).collect();
        let network = DetailNetwork::trained();
        for (told, score, burn, damage) in [(1.5, 7.0, -5.290_90, -7.806_40), (-2.0, 4.0, -5.290_90, -9.153_15)] {
            let odds = network.odds(&detail, told, score);
            assert!((odds.burn + RARER_BURNS - burn).abs() < 2e-3 && (odds.damage - damage).abs() < 2e-3, "{odds:?}");
        }
    }

    #[test]
    fn what_a_patch_told_is_lowered_so_far_and_no_farther() {
        // Nothing is to be seen, so nothing is damaged.
        let detail = vec![0.0; SIDE * SIDE * LAYERS];
        let likely = Likely { interrupted: 1.0, ..Likely::default() };
        for log_odds in [2.0, 12.0, 40.0] {
            let told = DetailNetwork::trained().look(&detail, Told { log_odds, likely, burn: false }, 8.0);
            assert!(told.log_odds >= log_odds - MOST_AGAINST && told.log_odds < log_odds + 2.0, "{told:?}");
            assert_eq!(told.likely, likely);
        }
    }
}
