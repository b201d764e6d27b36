//! Turns filtered evidence into one comparable score: how much intact rope speaks against it. [extends Wacker13, sec. 5]
//!
//! Every filter has its own noise, so each is calibrated on intact rope that was held back from learning: sums over many pixels
//! vary by chance (variance n) and by what pixels share, dirt and registration (variance shared * n^2). The upper tail of the
//! normalised sums is close to exponential: a finding of 3 means "one in 10^3 such places on intact rope", and so on. What all
//! factors find under all filters is weighed and added up.

use super::calibration::{FilterCalibration, LEAST_SHARE, normalised};
use super::evidence::{Evidence, UNSEEN};
use super::filtering::{Filtered, Steps, TOGETHER};
use super::stretch_scores::StretchScores;
use super::wide::wide;

/// Finding that is usual: one place in sixteen of intact rope has it. What is beyond counts.
const USUAL: f32 = 1.2;
/// Farthest beyond that a single finding counts.
const MOST: f32 = 12.0;

/// What it takes to judge a factor.
#[derive(Debug, Clone, Copy)]
pub struct Weighed<'a> {
    /// Calibration of every filter; `None` for those that are not asked.
    pub calibration: &'a [Option<FilterCalibration>],
    /// What a finding counts.
    pub weight: f32,
}

/// A calibration made ready to judge block after block.
struct Judge {
    least: f32,
    shared: f32,
    both_ways: bool,
    from: f32,
    weight: f32,
    /// `[region]`: where findings rise from and how fast; what was not seen lies in none.
    levels: [(f32, f32); UNSEEN as usize + 1],
}

impl Judge {
    fn new(calibration: &FilterCalibration, weight: f32) -> Self {
        let per_decade = 1.0 / (calibration.one_in_1000 - calibration.one_in_100).max(0.05) as f32;
        let of_region = |region: usize| {
            let level = calibration.regions.get(region);
            level.map_or((0.0, f32::NAN), |level| (level.middle, per_decade / level.upward))
        };
        Self {
            least: LEAST_SHARE * calibration.pixels as f32,
            shared: calibration.shared as f32,
            both_ways: calibration.both_ways,
            from: 2.0 - calibration.one_in_100 as f32 * per_decade - USUAL,
            weight,
            levels: std::array::from_fn(of_region),
        }
    }

    /// Adds to `scores` what was found beyond the usual: minus the decimal logarithm of how often intact rope exceeds it, weighed. A
    /// score that is NaN until then becomes known; where too few pixels fell in, it stays as it is.
    #[inline(always)]
    fn add(&self, scores: &mut [f32], sums: &[f32], filtered: &Filtered<'_>) {
        let places = sums.as_chunks::<TOGETHER>().0.iter().zip(filtered.pixels.as_chunks::<TOGETHER>().0);
        let places = places.zip(filtered.regions.chunks(TOGETHER)).zip(scores.chunks_mut(TOGETHER));
        for (((sums, pixels), regions), scores) in places {
            if regions.iter().all(|&region| region == UNSEEN) {
                continue; // on the other side
            }
            // What can only be looked up one by one first, so that the rest is reckoned side by side.
            let (mut middles, mut rises) = ([0.0f32; TOGETHER], [f32::NAN; TOGETHER]);
            for ((middle, rise), &region) in middles.iter_mut().zip(&mut rises).zip(regions) {
                (*middle, *rise) = self.levels[usize::from(region)];
            }
            let places = sums.iter().zip(pixels).zip(middles.iter().zip(&rises));
            for (score, ((&sum, &n), (middle, rise))) in scores.iter_mut().zip(places) {
                let above = (normalised(sum, n, self.shared) - middle) * rise;
                let beyond = self.from + if self.both_ways { above.abs() } else { above };
                // NaN, where nothing is seen, counts as 0: there is no score in the end.
                let counts = if beyond > 0.0 { beyond } else { 0.0 };
                let counts = if counts < MOST { counts } else { MOST };
                *score = if n >= self.least { sum_of_known(*score, self.weight * counts) } else { *score };
            }
        }
    }
}

/// The sum, of which nothing is known yet while it is NaN, and what is added to it.
#[inline(always)]
fn sum_of_known(sum: f32, add: f32) -> f32 {
    if sum.is_nan() { add } else { sum + add }
}

/// Scores the evidence of a stretch: what its factors, one entry each, find under all filters, added up.
pub fn score(evidence: &Evidence, factors: &[Weighed<'_>], pitch_mm: f64) -> StretchScores {
    let row = evidence.strands * evidence.places;
    let judges = |weighed: &Weighed<'_>| -> Vec<Option<Judge>> {
        if weighed.weight <= 0.0 {
            return Vec::new();
        }
        weighed.calibration.iter().map(|filter| Some(Judge::new(filter.as_ref()?, weighed.weight))).collect()
    };
    let judges: Vec<Vec<Option<Judge>>> = factors.iter().map(judges).collect();
    let asked = |factor: usize| judges.get(factor).is_some_and(|filters| filters.iter().any(Option::is_some));
    // In the order of the evidence, in which a strand's blocks lie side by side.
    let mut found = vec![f32::NAN; evidence.blocks * row];
    let mut of_block = vec![f32::NAN; evidence.places];
    evidence.filtered(pitch_mm, Steps::Thinned, asked, |filtered| {
        let alone = filtered.stands_for.len() == 1;
        let scores = if alone { &mut found[evidence.of(filtered.block, filtered.strand)] } else { &mut of_block[..] };
        if !alone {
            scores.fill(f32::NAN);
        }
        wide(
            #[inline(always)]
            || {
                for (factor, sums) in filtered.sums() {
                    if let Some(judge) = judges[factor].get(filtered.filter).and_then(Option::as_ref) {
                        judge.add(scores, sums, &filtered);
                    }
                }
            },
        );
        if alone {
            return;
        }
        for block in filtered.stands_for {
            for (score, &add) in found[evidence.of(block, filtered.strand)].iter_mut().zip(&of_block) {
                *score = if add.is_nan() { *score } else { sum_of_known(*score, add) };
            }
        }
    });
    let mut scored = vec![f32::NAN; evidence.blocks * row];
    let strands_and_blocks = (0..evidence.strands).flat_map(|s| (0..evidence.blocks).map(move |block| (s, block)));
    for (strand, block) in strands_and_blocks {
        for (to, at) in scored[evidence.of_scores(block, strand)].iter_mut().zip(evidence.of(block, strand)) {
            // What stands for its neighbours may stand for places that are not seen.
            *to = if evidence.regions[at] == UNSEEN { f32::NAN } else { found[at] };
        }
    }
    StretchScores::new(scored, evidence.visibility(pitch_mm), row, evidence.places, evidence.block_lines)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::calibration::CalibrationSums;
    use crate::vision::evidence::{GRAY, block_lines};

    const PITCH_MM: f64 = 0.1;
    const PLACES: usize = 35;

    /// A strand of chance values, with a run of `raised` along one wire.
    fn strand(seed: u32, both_ways: bool, raised: f32) -> Evidence {
        let mut state = seed;
        let mut evidence = Evidence::empty(block_lines(PITCH_MM), 900, 1, PLACES);
        evidence.factors[GRAY].both_ways = both_ways;
        for block in 0..evidence.blocks {
            for place in 0..PLACES {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let chance = (state >> 8) as f32 / (1 << 24) as f32 * 3.4 - 1.7;
                let here = (600..620).contains(&block) && (10..15).contains(&place);
                evidence.set(block * PLACES + place, chance + if here { raised } else { 0.0 }, 1.0, 0);
            }
        }
        evidence
    }

    /// Highest score of the run, and of the rest.
    fn scores(both_ways: bool, raised: f32) -> (f32, f32) {
        let sums = CalibrationSums::of(&strand(7, both_ways, 0.0), 0, PITCH_MM).remove(GRAY);
        let weighed = Weighed { calibration: &sums.calibrate().unwrap(), weight: 1.0 };
        let blocks = score(&strand(8, both_ways, raised), &[weighed], PITCH_MM).highest();
        let highest = |blocks: &[f32]| blocks.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        (highest(&blocks[605..615]), highest(&blocks[..580]))
    }

    #[test]
    fn what_deviates_both_ways_is_found_both_ways_and_the_rest_upward_only() {
        let (run, rest) = scores(false, 1.5);
        assert!(run > 8.0 && rest < 5.5, "{run} {rest}");
        assert!(scores(false, -1.5).0 < 4.0);
        for raised in [1.5, -1.5] {
            let (run, rest) = scores(true, raised);
            assert!(run > 8.0 && rest < 5.5, "{raised}: {run} {rest}");
        }
    }
}
