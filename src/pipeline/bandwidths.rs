//! Bandwidths of the gray density, chosen so that rope which did not teach is predicted best.

use super::folds::{FOLDS, without};
use super::learning_curve::{GrowingGray, nats_per_pixel};
use crate::vision::appearance::Appearance;
use crate::vision::bandwidths::Bandwidths;
use crate::vision::histogram::Histogram;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Folds that judge at the least, counted over the views: one of a single view would be a few stretches.
const JUDGES: usize = FOLDS;
/// Fewest of them a view.
const LEAST_JUDGES: usize = 2;
/// Nats per pixel that a step must bring: less is chance, and would be lost on the next rope.
const LEAST_GAIN_NATS: f64 = 0.0005;
/// Rounds over all coordinates after which the search ends.
const MOST_ROUNDS: usize = 3;

/// Who chooses the bandwidths of a training.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BandwidthsBy {
    /// The rope itself: what predicts the held-out eighths of it best, all views pooled.
    #[default]
    HeldOut,
    /// Nobody: the same for all ropes.
    Fixed,
}

/// The bandwidths of a model, and what they brought.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BandwidthsFit {
    /// Who chose them.
    pub by: BandwidthsBy,
    /// Standard deviations along gray, strand phase, wire phase and distance in bins: the diagonal of eq. 19.
    pub sigma_bins: [f32; 4],
    /// Gray values that are told apart.
    pub gray_bins: usize,
    /// Nats per held-out pixel over the fixed bandwidths; 0 with those.
    pub gained_nats_per_pixel: f64,
}

impl BandwidthsFit {
    /// Chooses for the gray values of all views.
    pub(super) fn of(by: BandwidthsBy, views: &[GrowingGray]) -> Self {
        let (chosen, gained_nats_per_pixel) = match by {
            BandwidthsBy::Fixed => (Bandwidths::FIXED, 0.0),
            BandwidthsBy::HeldOut => {
                let judges = Judges::of(views);
                best(|bandwidths| judges.nats(bandwidths))
            }
        };
        let Bandwidths { sigma_bins, gray_bins } = chosen;
        Self { by, sigma_bins, gray_bins, gained_nats_per_pixel }
    }

    /// The bandwidths themselves.
    pub fn bandwidths(&self) -> Bandwidths {
        Bandwidths { sigma_bins: self.sigma_bins, gray_bins: self.gray_bins }
    }

    /// What a person should know of it, as words behind "bandwidths".
    pub fn sentence(&self) -> String {
        let [gray, strand, wire, distance] = self.sigma_bins;
        let of = format!(
            "gray {gray:.2}, strand phase {strand:.2}, wire phase {wire:.2}, distance {distance:.2} bins, {} gray values",
            self.gray_bins
        );
        match self.by {
            BandwidthsBy::Fixed => format!("{of}: fixed"),
            BandwidthsBy::HeldOut => format!(
                "{of}: by held-out likelihood, {:.3} nats per pixel better than the fixed ones",
                self.gained_nats_per_pixel
            ),
        }
    }
}

/// Held-out folds, and what the others of their view saw.
struct Judges<'a>(Vec<(&'a Histogram, Histogram)>);

impl<'a> Judges<'a> {
    /// Views are judged by different folds, so that all of the rope has its say.
    fn of(views: &'a [GrowingGray]) -> Self {
        let each = JUDGES.div_ceil(views.len().max(1)).max(LEAST_JUDGES);
        let of_view = |(view, gray): (usize, &'a GrowingGray)| {
            (0..each)
                .map(move |k| (view * each + k) % FOLDS)
                .map(|fold| (&gray.folds[fold], without(&gray.folds, fold)))
        };
        Self(views.iter().enumerate().flat_map(of_view).collect())
    }

    /// Mean logarithm of the likelihood of a held-out pixel.
    fn nats(&self, bandwidths: Bandwidths) -> f64 {
        let judged: Vec<(f64, f64)> = self
            .0
            .par_iter()
            .map(|(held_out, others)| {
                let pixels = held_out.total();
                (pixels, pixels * nats_per_pixel(&Appearance::learn(others, bandwidths), held_out))
            })
            .collect();
        let (pixels, nats) = judged.iter().fold((0.0, 0.0), |(n, sum), (pixels, nats)| (n + pixels, sum + nats));
        nats / pixels.max(1.0)
    }
}

/// From the fixed bandwidths uphill, coordinate by coordinate, as long as a step brings more than chance; answers the gain, too.
fn best(nats: impl Fn(Bandwidths) -> f64) -> (Bandwidths, f64) {
    let fixed = nats(Bandwidths::FIXED);
    let (mut at, mut best) = (Bandwidths::FIXED, fixed);
    for _ in 0..MOST_ROUNDS {
        let before = at;
        for coordinate in 0..Bandwidths::COORDINATES {
            for wider in [false, true] {
                let from = at;
                while let Some(next) = at.stepped(coordinate, wider) {
                    let found = nats(next);
                    if found < best + LEAST_GAIN_NATS {
                        break;
                    }
                    (at, best) = (next, found);
                }
                if at != from {
                    break; // the other way leads back
                }
            }
        }
        if at == before {
            break;
        }
    }
    (at, best - fixed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::histogram::{GRAY_BINS, cell};

    /// Rope whose gray is spread over `spread` bins about one that changes from cell to cell; few or many pixels a cell.
    fn gray(spread: usize, pixels: usize) -> GrowingGray {
        let mut gray = GrowingGray::new(8);
        let mut state = 1u32;
        for (fold, histogram) in gray.folds.iter_mut().enumerate() {
            for (strand, wire) in (8..24).flat_map(|strand| (0..24).map(move |wire| (strand, wire))) {
                for _ in 0..pixels {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223 + fold as u32);
                    let chance = (state >> 16) as usize;
                    histogram
                        .add(cell(strand, wire, chance % 8), (4 + wire / 2 + chance / 8 % spread).min(GRAY_BINS - 1));
                }
            }
        }
        gray
    }

    #[test]
    fn sharp_rope_that_was_seen_often_wants_narrow_bandwidths_and_rope_seen_seldom_wide_ones() {
        let often = BandwidthsFit::of(BandwidthsBy::HeldOut, &[gray(2, 400)]);
        let seldom = BandwidthsFit::of(BandwidthsBy::HeldOut, &[gray(16, 60)]);
        assert!(often.gained_nats_per_pixel > 0.05 && often.sigma_bins[0] < 0.7, "{often:?}");
        assert!(seldom.sigma_bins[1] > Bandwidths::FIXED.sigma_bins[1], "{seldom:?}");
        assert!(seldom.gained_nats_per_pixel > LEAST_GAIN_NATS, "{seldom:?}");
    }

    #[test]
    fn fixed_bandwidths_are_those_of_all_ropes() {
        let fixed = BandwidthsFit::of(BandwidthsBy::Fixed, &[gray(2, 10)]);
        assert_eq!((fixed.bandwidths(), fixed.gained_nats_per_pixel), (Bandwidths::FIXED, 0.0));
        assert!(fixed.sentence().ends_with("32 gray values: fixed"), "{}", fixed.sentence());
    }

    #[test]
    fn a_choice_is_written_and_read() {
        let fit = BandwidthsFit {
            by: BandwidthsBy::HeldOut,
            sigma_bins: [0.6, 1.0, 0.8, 0.5],
            gray_bins: 32,
            gained_nats_per_pixel: 0.04,
        };
        let written = serde_json::to_value(fit).unwrap();
        assert_eq!(written["by"], "held-out");
        assert_eq!(serde_json::from_value::<BandwidthsFit>(written).unwrap(), fit);
    }
}
