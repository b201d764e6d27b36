//! How much the factors of the appearance vary together on intact rope, and what they say of a place together.
//!
//! A cluster of dirt specks raises gray, texture and steps at once: three factors that find it do not say three times that it is rare.
//! On another rope they vary each by itself. So how far they go together is learnt with every model, and a factor supports the one
//! that finds a place the rarest only by what it finds beyond that.

use super::calibration::{COMPARED, CalibrationSums, FilterCalibration};

/// What an unusual finding of one factor adds to a greater one of another: factors share pixels, so they are not independent.
const SUPPORT: f32 = 0.7;
/// Score up to which a finding is usual: one place in ten has it.
const USUAL: f32 = 1.0;
/// Rises that are compared, in units of the region: a defect in training must not tie factors together, and how far below the middle
/// a place lies does not matter.
const COMPARED_RISES: (f32, f32) = (-1.0, 4.0);
/// Variance that is added to every rise: factors that hardly vary are not alike for that.
const LEAST_VARIANCE: f64 = 0.03;

/// Correlations of the factors, `[factor][factor]`: what is negative counts as none.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Together {
    correlations: Vec<Vec<f32>>,
}

impl Together {
    /// Learns from stretches of intact rope, `[stretch][factor]`, and the calibration of the factors. A factor that is not asked goes
    /// together with none.
    pub fn learn<'a>(
        stretches: impl Iterator<Item = &'a [CalibrationSums]>,
        calibration: &[Vec<Option<FilterCalibration>>],
    ) -> Self {
        let factors = calibration.len();
        let asked: Vec<(usize, &FilterCalibration)> =
            calibration.iter().enumerate().filter_map(|(f, of)| Some((f, of.get(COMPARED)?.as_ref()?))).collect();
        let mut sums = Sums::of(asked.len());
        let mut at_place = Vec::with_capacity(asked.len());
        for stretch in stretches {
            let rises =
                asked.iter().filter_map(|(f, calibration)| Some(stretch.get(*f)?.rises(calibration).peekable()));
            let mut rises: Vec<_> = rises.collect();
            if rises.len() < asked.len() {
                continue;
            }
            // Every factor is told at places of its own; those that all have in common are compared.
            while let Some(&(place, _)) = rises.iter_mut().map_while(|r| r.peek()).max_by_key(|(place, _)| *place) {
                at_place.clear();
                for rises in &mut rises {
                    while rises.next_if(|(at, _)| *at < place).is_some() {}
                    let rise = rises.next_if(|(at, _)| *at == place);
                    at_place.extend(rise.map(|(_, rise)| f64::from(rise.clamp(COMPARED_RISES.0, COMPARED_RISES.1))));
                }
                if at_place.len() == asked.len() {
                    sums.add(&at_place);
                }
                if rises.iter_mut().any(|r| r.peek().is_none()) {
                    break;
                }
            }
        }
        let mut together = Self::apart(factors);
        for (a, &(one, _)) in asked.iter().enumerate() {
            for (b, &(other, _)) in asked.iter().enumerate().skip(a + 1) {
                let correlation = sums.covariance(a, b) / (sums.covariance(a, a) * sums.covariance(b, b)).sqrt();
                if correlation > 0.0 {
                    together.correlations[one][other] = correlation as f32;
                    together.correlations[other][one] = correlation as f32;
                }
            }
        }
        together
    }

    /// Every factor varies by itself.
    fn apart(factors: usize) -> Self {
        let row = |one: usize| (0..factors).map(|other| if one == other { 1.0 } else { 0.0 }).collect();
        Self { correlations: (0..factors).map(row).collect() }
    }

    /// Restores it from its correlations. `None` if they are not a table for so many factors.
    pub fn from_correlations(correlations: Vec<Vec<f32>>, factors: usize) -> Option<Self> {
        let is_row = |row: &Vec<f32>| row.len() == factors && row.iter().all(|c| (0.0..=1.0).contains(c));
        (correlations.len() == factors && correlations.iter().all(is_row)).then_some(Self { correlations })
    }

    /// What [`Self::from_correlations`] restores.
    pub fn correlations(&self) -> &[Vec<f32>] {
        &self.correlations
    }

    /// What factors say together of a place, from the score that each gives it; minus infinity where one does not judge.
    #[inline]
    pub fn score(&self, scores: &[f32]) -> f32 {
        let mut greatest = 0;
        for factor in 1..scores.len() {
            if scores[factor] > scores[greatest] {
                greatest = factor;
            }
        }
        let unusual = scores[greatest] - USUAL;
        if unusual <= 0.0 {
            return scores[greatest];
        }
        let mut support = 0.0;
        for (score, correlation) in scores.iter().zip(&self.correlations[greatest]) {
            let beyond = score - USUAL - correlation * unusual; // of the greatest itself nothing
            support += if beyond > 0.0 { beyond } else { 0.0 };
        }
        scores[greatest] + SUPPORT * support
    }
}

/// Sums over places of what is asked there, and of its products.
struct Sums {
    places: f64,
    values: Vec<f64>,
    /// `[one][other]`.
    products: Vec<Vec<f64>>,
}

impl Sums {
    fn of(asked: usize) -> Self {
        Self { places: 0.0, values: vec![0.0; asked], products: vec![vec![0.0; asked]; asked] }
    }

    fn add(&mut self, at_place: &[f64]) {
        self.places += 1.0;
        for ((sum, products), one) in self.values.iter_mut().zip(&mut self.products).zip(at_place) {
            *sum += one;
            products.iter_mut().zip(at_place).for_each(|(product, other)| *product += one * other);
        }
    }

    fn covariance(&self, a: usize, b: usize) -> f64 {
        let mean = |k: usize| self.values[k] / self.places;
        let least = if a == b { LEAST_VARIANCE } else { 0.0 };
        self.products[a][b] / self.places - mean(a) * mean(b) + least
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::evidence::{Evidence, block_lines};

    const PITCH_MM: f64 = 0.1;

    /// Values of a stretch of one strand: the first two factors share most of what they have, the third has its own.
    fn stretch(seed: u32) -> Vec<CalibrationSums> {
        let mut state = seed;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32 * 2.0 - 1.0
        };
        let (blocks, places) = (1200, 35);
        let mut factors = vec![Evidence::empty(block_lines(PITCH_MM), blocks, 1, places, 4.0..=40.0); 3];
        for at in 0..blocks * places {
            let shared = random();
            for (k, evidence) in factors.iter_mut().enumerate() {
                let value = if k < 2 { shared + 0.3 * random() } else { random() };
                evidence.set(at, value, 1.0, 0);
            }
        }
        factors.iter().map(|evidence| CalibrationSums::of(evidence, PITCH_MM)).collect()
    }

    fn learnt() -> Together {
        let stretches = [stretch(1), stretch(2)];
        let calibrated = |factor: usize| {
            let mut sums = CalibrationSums::default();
            stretches.iter().for_each(|stretch| sums.join(&stretch[factor]));
            sums.calibrate().unwrap()
        };
        let calibration: Vec<_> = (0..3).map(calibrated).chain([Vec::new()]).collect();
        Together::learn(stretches.iter().map(|stretch| &stretch[..]), &calibration)
    }

    #[test]
    fn factors_that_share_their_causes_go_together() {
        let together = learnt();
        let c = together.correlations();
        assert!(c[0][1] > 0.8 && c[0][1] == c[1][0], "{c:?}");
        assert!(c[0][2] < 0.1 && c[1][2] < 0.1, "{c:?}");
        // One that is not asked.
        assert_eq!(c[3], [0.0, 0.0, 0.0, 1.0]);
        assert_eq!(Together::from_correlations(c.to_vec(), 4), Some(together.clone()));
        assert_eq!(Together::from_correlations(c.to_vec(), 3), None);
        assert_eq!(Together::from_correlations(vec![vec![f32::NAN]], 1), None);
    }

    #[test]
    fn what_two_factors_find_alike_counts_once_and_what_they_find_each_counts_twice() {
        let together = learnt();
        let (alone, alike, each) = ([6.0, 1.0, 1.0, 0.0], [6.0, 5.0, 1.0, 0.0], [6.0, 1.0, 5.0, 0.0]);
        assert_eq!(together.score(&alone), 6.0);
        assert!(together.score(&alike) < 6.3, "{}", together.score(&alike));
        assert!(together.score(&each) > 8.3, "{}", together.score(&each));
        assert_eq!(together.score(&[0.4, f32::NEG_INFINITY, 0.2, 0.1]), 0.4);
        assert_eq!(together.score(&[f32::NEG_INFINITY; 4]), f32::NEG_INFINITY);
    }
}
