//! Turns filtered evidence into one comparable score: how rare such evidence is on intact rope. [extends Wacker13, sec. 5]
//!
//! Every filter has its own noise, so each is calibrated on intact rope that was held back from learning: sums over many pixels
//! vary by chance (variance n) and by what pixels share, dirt and registration (variance shared * n^2). The upper tail of the
//! normalised sums is close to exponential; a score of 3 means "one in 10^3 such places on intact rope", and so on.

use super::evidence::{Evidence, FILTERS, UNSEEN};
use super::filtering::{Filtered, Steps, TOGETHER};
use super::histogram::REGIONS;
use super::stretch_scores::StretchScores;

/// Fewest pixels under a filter, as a share of the most that fall under it: less is not judged.
const LEAST_SHARE: f32 = 0.25;

/// Calibration of one filter.
#[derive(Debug, Clone, PartialEq)]
pub struct FilterCalibration {
    /// Share of the variance that pixels have in common.
    pub shared: f64,
    /// Most pixels that fall under the filter (95th percentile).
    pub pixels: f64,
    /// Sum, in units of its region, that 1 in 100 places of intact rope exceeds.
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
    /// From there to what 1 in 10 exceeds.
    pub upward: f32,
}

/// Sum of scores over so many pixels, divided by its standard deviation.
#[inline]
fn normalised(sum: f32, pixels: f32, shared: f32) -> f32 {
    sum / (pixels + shared * pixels * pixels).sqrt()
}

/// A calibration made ready to judge block after block.
struct Judge {
    least: f32,
    shared: f32,
    from: f32,
    /// `[region]`: where scores rise from and how fast; what was not seen lies in none, and NaN raises nothing.
    levels: [(f32, f32); UNSEEN as usize + 1],
}

impl Judge {
    fn new(calibration: &FilterCalibration) -> Self {
        let per_decade = 1.0 / (calibration.one_in_1000 - calibration.one_in_100).max(0.05) as f32;
        let of_region = |region: usize| {
            let level = calibration.regions.get(region);
            level.map_or((0.0, f32::NAN), |level| (level.middle, per_decade / level.upward))
        };
        Self {
            least: LEAST_SHARE * calibration.pixels as f32,
            shared: calibration.shared as f32,
            from: 2.0 - calibration.one_in_100 as f32 * per_decade,
            levels: std::array::from_fn(of_region),
        }
    }

    /// Raises `highest` to the scores of what was filtered: minus the decimal logarithm of how often intact rope exceeds it.
    /// Where too few pixels fell in, nothing is said.
    fn raise(&self, highest: &mut [f32], filtered: &Filtered<'_>) {
        let places = filtered.sums.as_chunks::<TOGETHER>().0.iter().zip(filtered.pixels.as_chunks::<TOGETHER>().0);
        let places = places.zip(filtered.regions.chunks(TOGETHER)).zip(highest.chunks_mut(TOGETHER));
        for (((sums, pixels), regions), highest) in places {
            if regions.iter().all(|&region| region == UNSEEN) {
                continue; // on the other side
            }
            // Roots and quotients side by side first: the look-up after them can only be made one by one.
            let mut normal = [0.0f32; TOGETHER];
            for (normal, (&sum, &n)) in normal.iter_mut().zip(sums.iter().zip(pixels)) {
                *normal = normalised(sum, n, self.shared);
            }
            for (highest, ((&normal, &n), &region)) in highest.iter_mut().zip(normal.iter().zip(pixels).zip(regions)) {
                let (middle, rise) = self.levels[usize::from(region)];
                let score = self.from + (normal - middle) * rise;
                let judged = if n >= self.least { score } else { UNJUDGED };
                *highest = if judged > *highest { judged } else { *highest };
            }
        }
    }
}

/// Gathers filtered sums of held-back intact rope.
#[derive(Debug, Clone)]
pub struct CalibrationSums {
    samples: Vec<Vec<Sample>>,
}

/// What fell under a filter about one place.
#[derive(Debug, Clone, Copy)]
struct Sample {
    sum: f32,
    pixels: f32,
    region: u8,
}

/// Fewest samples that calibrate a filter: two at the rarest level that is read off.
const LEAST_SAMPLES: usize = 2000;
/// Every how many places one is kept: neighbours tell nearly the same, and memory must stay small.
const SAMPLE_STRIDE: usize = 7;
/// Samples of the whole surface that a region's own are mixed with: few of its own would mislead.
const COMMON_SAMPLES: f32 = 100.0;

impl Default for CalibrationSums {
    fn default() -> Self {
        Self { samples: vec![Vec::new(); FILTERS.len()] }
    }
}

impl CalibrationSums {
    /// Adds a stretch of intact rope.
    pub fn add(&mut self, evidence: &Evidence, pitch_mm: f64) {
        evidence.filtered(pitch_mm, Steps::Every, |filtered| {
            let first = evidence.of_scores(filtered.block, filtered.strand).start;
            let sampled = filtered.seen().filter(|(k, _, n, _)| (first + k).is_multiple_of(SAMPLE_STRIDE) && *n > 0.0);
            self.samples[filtered.filter].extend(sampled.map(|(_, sum, pixels, region)| Sample {
                sum,
                pixels,
                region: region as u8,
            }));
        });
    }

    /// Adds what another stretch gathered.
    pub fn join(&mut self, other: &Self) {
        self.samples.iter_mut().zip(&other.samples).for_each(|(all, samples)| all.extend_from_slice(samples));
    }

    /// Calibrates every filter that was asked and has enough samples. `None` if there is none.
    pub fn calibrate(mut self) -> Option<Vec<Option<FilterCalibration>>> {
        let enough = |samples: &mut Vec<Sample>| (samples.len() >= LEAST_SAMPLES).then(|| calibrate(samples));
        let calibrations: Vec<_> = self.samples.iter_mut().map(enough).collect();
        calibrations.iter().any(Option::is_some).then_some(calibrations)
    }
}

/// The value that this share of the values does not exceed. Changes their order; there must be one.
pub(super) fn quantile(values: &mut [f32], share: f64) -> f32 {
    let at = ((values.len() - 1) as f64 * share) as usize;
    *values.select_nth_unstable_by(at, f32::total_cmp).1
}

fn calibrate(samples: &mut Vec<Sample>) -> FilterCalibration {
    let pixels = quantile(&mut samples.iter().map(|s| s.pixels).collect::<Vec<_>>(), 0.95);
    samples.retain(|s| s.pixels >= LEAST_SHARE * pixels);
    // Variance of the sums = n + shared n^2, by the quartiles, which defects do not reach.
    let mut means: Vec<f32> = samples.iter().map(|s| s.sum / s.pixels).collect();
    let spread = (quantile(&mut means, 0.75) - quantile(&mut means, 0.25)) / 1.349;
    let typical = quantile(&mut samples.iter().map(|s| s.pixels).collect::<Vec<_>>(), 0.5);
    let shared = (spread * spread - 1.0 / typical).max(0.0);
    let z = |s: &Sample| normalised(s.sum, s.pixels, shared);
    let regions = region_levels(samples, z);
    let of_region = |s: &Sample| {
        let level = regions[usize::from(s.region)];
        (z(s) - level.middle) / level.upward
    };
    let mut rises: Vec<f32> = samples.iter().map(of_region).collect();
    let (one_in_100, one_in_1000) = (quantile(&mut rises, 0.99), quantile(&mut rises, 0.999));
    FilterCalibration {
        shared: shared.into(),
        pixels: pixels.into(),
        one_in_100: one_in_100.into(),
        one_in_1000: one_in_1000.into(),
        regions,
    }
}

/// Region normalisation (eq. 21-22) of what filters find: where the rope is seen obliquely or registered poorly, intact rope
/// varies more, and by more than single pixels tell, because their errors go together.
fn region_levels(samples: &[Sample], z: impl Fn(&Sample) -> f32) -> Vec<RegionLevel> {
    let level = |z: &mut [f32]| {
        let middle = quantile(z, 0.5);
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

/// Scores the evidence of a stretch, one entry a factor, under all filters: the rarest finding counts,
/// supported by what other factors find at the same place.
pub fn score(factors: &[(Evidence, &[Option<FilterCalibration>])], pitch_mm: f64) -> StretchScores {
    let Some((first, _)) = factors.first() else {
        return StretchScores::new(Vec::new(), Vec::new(), 1, 1, 1);
    };
    let row = first.strands * first.places;
    let mut cells = vec![UNJUDGED; first.blocks * row];
    let mut support = vec![0.0f32; cells.len()];
    let mut factor = vec![UNJUDGED; cells.len()];
    let mut of_block = vec![UNJUDGED; first.places];
    for (evidence, calibration) in factors {
        factor.fill(UNJUDGED);
        let judges: Vec<Option<Judge>> = calibration.iter().map(|c| c.as_ref().map(Judge::new)).collect();
        evidence.filtered(pitch_mm, Steps::Thinned, |filtered| {
            let Some(Some(judge)) = judges.get(filtered.filter) else { return };
            if filtered.stands_for.len() == 1 {
                judge.raise(&mut factor[evidence.of(filtered.block, filtered.strand)], &filtered);
                return;
            }
            of_block.fill(UNJUDGED);
            judge.raise(&mut of_block, &filtered);
            for block in filtered.stands_for {
                for (highest, &score) in factor[evidence.of(block, filtered.strand)].iter_mut().zip(&of_block) {
                    *highest = if score > *highest { score } else { *highest };
                }
            }
        });
        for ((cell, support), &score) in cells.iter_mut().zip(&mut support).zip(&factor) {
            // The lesser of the two supports the greater, as far as it is unusual itself.
            let (lesser, greater) = if score < *cell { (score, *cell) } else { (*cell, score) };
            let unusual = lesser - USUAL;
            *support += SUPPORT * if unusual > 0.0 { unusual } else { 0.0 };
            *cell = greater;
        }
    }
    let mut scored = vec![f32::NAN; cells.len()];
    for (strand, block) in (0..first.strands).flat_map(|strand| (0..first.blocks).map(move |block| (strand, block))) {
        let places = first.of(block, strand);
        let from = cells[places.clone()].iter().zip(&support[places.clone()]).zip(&first.regions[places]);
        for (to, ((&cell, support), &region)) in scored[first.of_scores(block, strand)].iter_mut().zip(from) {
            // What stands for its neighbours may stand for places that are not seen.
            let judged = cell != UNJUDGED && region != UNSEEN;
            *to = if judged { cell + support } else { f32::NAN };
        }
    }
    StretchScores::new(scored, first.seen(pitch_mm), row, first.places, first.block_lines)
}

/// Score of cells that no filter judged, while scores are gathered.
const UNJUDGED: f32 = f32::NEG_INFINITY;
/// What an unusual finding of one factor adds to a greater one of another: factors share pixels, so they are not independent.
const SUPPORT: f32 = 0.7;
/// Score up to which a finding is usual: one place in ten has it.
const USUAL: f32 = 1.0;
