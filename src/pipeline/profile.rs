//! Gray values along a line on the rope: what was seen against what is usual on intact rope.

use crate::vision::appearance::Appearance;
use crate::vision::histogram::GRAY_BINS;
use crate::vision::render::gray;

/// Share of intact rope that is darker, and brighter, than the band of expected grays.
const TAIL: f32 = 0.05;

/// Gray values at one place of a profile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProfilePoint {
    /// Where, in mm: along the rope from the peak, or across it from the rope axis.
    pub at_mm: f64,
    /// What the view saw, mean.
    pub observed: f32,
    /// What intact rope shows on average.
    pub expected: f32,
    /// The darkest gray that is usual on intact rope, and the brightest.
    pub usual: (f32, f32),
}

/// Grays that a model expects under a light.
pub(super) struct UsualGrays<'a> {
    pub appearance: &'a Appearance,
    /// Mean gray of the rope.
    pub light: f32,
}

impl UsualGrays<'_> {
    /// Darkest usual, expected and brightest usual gray of a cell; `None` if the model does not know it.
    pub fn of(&self, cell: usize) -> Option<[f32; 3]> {
        let bin = self.appearance.expected(cell);
        if bin.is_nan() {
            return None;
        }
        let likelihood = self.appearance.likelihood(cell);
        let total: f32 = likelihood.iter().sum();
        let quantile = |share: f32| {
            let mut left = share * total;
            let full = likelihood.iter().take_while(|&&p| {
                left -= p;
                left > 0.0
            });
            let bins = full.count().min(GRAY_BINS - 1);
            // `left` is what the last bin has too much.
            bins as f32 + (1.0 + left / likelihood[bins].max(f32::MIN_POSITIVE)).clamp(0.0, 1.0)
        };
        Some([quantile(TAIL), bin, quantile(1.0 - TAIL)].map(|bin| gray(bin, self.light)))
    }
}

/// Mean of grays, observed and expected, where the model knows what to expect.
#[derive(Clone, Default)]
pub(super) struct Mean {
    n: f32,
    observed: f32,
    expected: [f32; 3],
}

impl Mean {
    /// Adds a pixel.
    pub fn add(&mut self, observed: u8, expected: Option<[f32; 3]>) {
        let Some(expected) = expected else { return };
        self.n += 1.0;
        self.observed += f32::from(observed);
        for (sum, gray) in self.expected.iter_mut().zip(expected) {
            *sum += gray;
        }
    }

    /// The point of the profile at that place; `None` if no pixel was added.
    pub fn point(&self, at_mm: f64) -> Option<ProfilePoint> {
        let [low, expected, high] = self.expected.map(|sum| sum / self.n);
        (self.n > 0.0).then_some(ProfilePoint { at_mm, observed: self.observed / self.n, expected, usual: (low, high) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::histogram::CELLS;

    #[test]
    fn nine_of_ten_grays_of_intact_rope_lie_in_the_usual_band() {
        // Grays of one cell are spread evenly over the bins 8 to 16; the others were never seen.
        let mut likelihood = vec![0.0; CELLS * GRAY_BINS];
        likelihood[8..16].fill(4.0);
        let mut expected = vec![f32::NAN; CELLS];
        expected[0] = 12.0;
        let appearance = Appearance::from_tables([likelihood.clone(), likelihood, expected]).unwrap();
        let usual = UsualGrays { appearance: &appearance, light: 80.0 };
        let found = usual.of(0).unwrap();
        for (found, bin) in found.into_iter().zip([8.4, 12.0, 15.6]) {
            assert!((found - gray(bin, 80.0)).abs() < 1e-3, "{found} is not bin {bin}");
        }
        assert_eq!(usual.of(1), None);
    }

    #[test]
    fn a_point_of_a_profile_is_a_mean_of_what_the_model_knows() {
        let mut mean = Mean::default();
        assert_eq!(mean.point(0.0), None);
        mean.add(10, Some([0.0, 20.0, 40.0]));
        mean.add(30, Some([10.0, 40.0, 60.0]));
        mean.add(255, None);
        let expected = ProfilePoint { at_mm: 1.5, observed: 20.0, expected: 30.0, usual: (5.0, 50.0) };
        assert_eq!(mean.point(1.5), Some(expected));
    }
}
