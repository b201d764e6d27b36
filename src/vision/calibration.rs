//! How sums under the filters lie on intact rope, filter by filter: what scores are read off. [extends Wacker13, sec. 5]
//!
//! Sums over many pixels vary by chance (variance n) and by what pixels share, dirt and registration (variance shared * n^2).

use super::evidence::{Evidence, FILTERS, FactorSums, UNSEEN};
use super::filtering::Steps;
use super::histogram::REGIONS;

/// Fewest pixels under a filter, as a share of the most that fall under it: less is not judged.
pub(super) const LEAST_SHARE: f32 = 0.25;

/// Calibration of one filter.
#[derive(Debug, Clone, PartialEq)]
pub struct FilterCalibration {
    /// Share of the variance that pixels have in common.
    pub shared: f64,
    /// Most pixels that fall under the filter (95th percentile).
    pub pixels: f64,
    /// Whether sums far below the middle are as unusual as sums far above.
    pub both_ways: bool,
    /// Rise above the middle of its region, in units of it, that 1 in 100 places of intact rope exceeds.
    pub one_in_100: f64,
    /// The same for 1 in 1000 places.
    pub one_in_1000: f64,
    /// How sums of each region of the surface lie on intact rope.
    pub regions: Vec<RegionLevel>,
}

/// Where the normalised sums of one region of the surface lie on intact rope.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RegionLevel {
    /// Median.
    pub middle: f32,
    /// From there to what 1 in 10 exceeds; where both ways count, how far 1 in 10 is away from it.
    pub upward: f32,
}

/// Sum of scores over so many pixels, divided by its standard deviation.
#[inline(always)]
pub(super) fn normalised(sum: f32, pixels: f32, shared: f32) -> f32 {
    sum / (pixels + shared * pixels * pixels).sqrt()
}

impl FilterCalibration {
    /// How far a sum over so many pixels is above the middle of its region, or away from it, in units of that region.
    fn rise(&self, sample: &Sample) -> f32 {
        let level = self.regions[usize::from(sample.region)];
        let above = (normalised(sample.sum, sample.pixels(), self.shared as f32) - level.middle) / level.upward;
        if self.both_ways { above.abs() } else { above }
    }
}

/// Filtered sums of held-back intact rope, of one factor.
#[derive(Debug, Clone)]
pub struct CalibrationSums {
    /// `[filter]`.
    samples: Vec<Vec<Sample>>,
    both_ways: bool,
}

/// What fell under a filter about one place.
#[derive(Debug, Clone, Copy)]
struct Sample {
    sum: f32,
    /// Whole, and few enough: there are millions of samples.
    pixels: u16,
    region: u8,
}

impl Sample {
    fn pixels(&self) -> f32 {
        self.pixels.into()
    }
}

/// Fewest samples that calibrate a filter: two at the rarest level that is read off.
const LEAST_SAMPLES: usize = 2000;
/// Every how many places one is kept: neighbours tell nearly the same, and memory must stay small.
const SAMPLE_STRIDE: usize = 7;
/// Samples of the whole surface that a region's own are mixed with: few of its own would mislead.
const COMMON_SAMPLES: f32 = 100.0;

impl Default for CalibrationSums {
    fn default() -> Self {
        Self { samples: vec![Vec::new(); FILTERS.len()], both_ways: false }
    }
}

impl CalibrationSums {
    /// What every factor says of a stretch of intact rope, between so many blocks of the stretches before and after it.
    pub fn of(evidence: &Evidence, margin_blocks: usize, pitch_mm: f64) -> Vec<Self> {
        let itself = margin_blocks..evidence.blocks - margin_blocks;
        let of_factor = |factor: &FactorSums| Self { both_ways: factor.both_ways, ..Self::default() };
        let mut all: Vec<Self> = evidence.factors.iter().map(of_factor).collect();
        evidence.filtered(
            pitch_mm,
            Steps::Every,
            |_| true,
            |filtered| {
                if !itself.contains(&filtered.block) {
                    return;
                }
                let of_block = evidence.of(filtered.block, filtered.strand);
                let first = of_block.start.next_multiple_of(SAMPLE_STRIDE);
                let places = (first..of_block.end).step_by(SAMPLE_STRIDE).map(|at| at - of_block.start);
                let kept = |k: &usize| filtered.regions[*k] != UNSEEN && filtered.pixels[*k] > 0.0;
                for k in places.filter(kept) {
                    for (factor, sums) in filtered.sums() {
                        let (sum, pixels, region) = (sums[k], filtered.pixels[k] as u16, filtered.regions[k]);
                        all[factor].samples[filtered.filter].push(Sample { sum, pixels, region });
                    }
                }
            },
        );
        all
    }

    /// Adds what another stretch gathered.
    pub fn join(&mut self, other: &Self) {
        self.both_ways = other.both_ways;
        self.samples.iter_mut().zip(&other.samples).for_each(|(all, samples)| all.extend_from_slice(samples));
    }

    /// Calibrates every filter that has enough samples. `None` if there is none.
    pub fn calibrate(mut self) -> Option<Vec<Option<FilterCalibration>>> {
        let both_ways = self.both_ways;
        let enough =
            |samples: &mut Vec<Sample>| (samples.len() >= LEAST_SAMPLES).then(|| calibrate(samples, both_ways));
        let calibrations: Vec<_> = self.samples.iter_mut().map(enough).collect();
        calibrations.iter().any(Option::is_some).then_some(calibrations)
    }
}

/// The value that this share of the values does not exceed. Changes their order; there must be one.
pub(super) fn quantile(values: &mut [f32], share: f64) -> f32 {
    let at = ((values.len() - 1) as f64 * share) as usize;
    *values.select_nth_unstable_by(at, f32::total_cmp).1
}

fn calibrate(samples: &mut Vec<Sample>, both_ways: bool) -> FilterCalibration {
    let pixels = quantile(&mut samples.iter().map(Sample::pixels).collect::<Vec<_>>(), 0.95);
    samples.retain(|s| s.pixels() >= LEAST_SHARE * pixels);
    // Variance of the sums = n + shared n^2, by the quartiles, which defects do not reach.
    let mut means: Vec<f32> = samples.iter().map(|s| s.sum / s.pixels()).collect();
    let spread = (quantile(&mut means, 0.75) - quantile(&mut means, 0.25)) / 1.349;
    let typical = quantile(&mut samples.iter().map(Sample::pixels).collect::<Vec<_>>(), 0.5);
    let shared = (spread * spread - 1.0 / typical).max(0.0);
    let regions = region_levels(samples, both_ways, |s| normalised(s.sum, s.pixels(), shared));
    let mut calibration = FilterCalibration {
        shared: shared.into(),
        pixels: pixels.into(),
        both_ways,
        one_in_100: f64::NAN,
        one_in_1000: f64::NAN,
        regions,
    };
    let mut rises: Vec<f32> = samples.iter().map(|s| calibration.rise(s)).collect();
    calibration.one_in_100 = quantile(&mut rises, 0.99).into();
    calibration.one_in_1000 = quantile(&mut rises, 0.999).into();
    calibration
}

/// Region normalisation (eq. 21-22) of what filters find: where the rope is seen obliquely or registered poorly, intact rope
/// varies more, and by more than single pixels tell, because their errors go together.
fn region_levels(samples: &[Sample], both_ways: bool, z: impl Fn(&Sample) -> f32) -> Vec<RegionLevel> {
    let level = |z: &mut [f32]| {
        let middle = quantile(z, 0.5);
        if both_ways {
            let mut away: Vec<f32> = z.iter().map(|z| (z - middle).abs()).collect();
            return RegionLevel { middle, upward: quantile(&mut away, 0.9).max(0.05) };
        }
        RegionLevel { middle, upward: (quantile(z, 0.9) - middle).max(0.05) }
    };
    let mut of_region: Vec<Vec<f32>> = vec![Vec::new(); REGIONS];
    samples.iter().for_each(|s| of_region[usize::from(s.region)].push(z(s)));
    let common = level(&mut samples.iter().map(&z).collect::<Vec<_>>());
    let mixed = |z: &mut Vec<f32>| {
        if z.is_empty() {
            return common;
        }
        let own = level(z);
        let share = z.len() as f32 / (z.len() as f32 + COMMON_SAMPLES);
        let mix = |own: f32, common: f32| common + share * (own - common);
        RegionLevel { middle: mix(own.middle, common.middle), upward: mix(own.upward, common.upward) }
    };
    of_region.iter_mut().map(mixed).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::evidence::GRAY;

    #[test]
    fn stretches_beside_one_are_filtered_with_it_and_calibrate_nothing() {
        const BLOCKS: usize = 100;
        const MARGIN: usize = 20;
        const PLACES: usize = 2 * SAMPLE_STRIDE; // every row has as many samples
        let mut evidence = Evidence::empty(5, BLOCKS, 1, PLACES);
        for at in 0..BLOCKS * PLACES {
            let beside = !(MARGIN..BLOCKS - MARGIN).contains(&(at / PLACES));
            evidence.set(at, if beside { 9.0 } else { 0.0 }, 1.0, 0);
        }
        let samples = |margin| CalibrationSums::of(&evidence, margin, 0.1).remove(GRAY).samples;
        for (all, own) in samples(0).iter().zip(&samples(MARGIN)) {
            assert_eq!((all.len(), own.len()), (2 * BLOCKS, 2 * (BLOCKS - 2 * MARGIN)));
            let above = |samples: &[Sample]| samples.iter().filter(|sample| sample.sum > 0.0).count();
            assert!(above(all) >= 4 * MARGIN && above(own) < 4 * MARGIN, "{} {}", above(all), above(own));
        }
        let longest = samples(MARGIN).pop().unwrap();
        assert!(longest.iter().any(|sample| sample.sum > 0.0), "filters reach beyond the ends");
    }
}
