//! Turns filtered evidence into one comparable score: how rare such evidence is on intact rope. [extends Wacker13, sec. 5]
//!
//! Every filter has its own noise, so each is calibrated on intact rope that was held back from learning: sums over many pixels
//! vary by chance (variance n) and by what pixels share, dirt and registration (variance shared * n^2). The upper tail of the
//! normalised sums is close to exponential; a score of 3 means "one in 10^3 such places on intact rope", and so on.

use super::calibration::{FilterCalibration, LEAST_SHARE, normalised};
use super::evidence::{Evidence, UNSEEN};
use super::filtering::{Filtered, Steps, TOGETHER};
use super::stretch_scores::StretchScores;
use super::together::Together;

/// A calibration made ready to judge block after block.
struct Judge {
    least: f32,
    shared: f32,
    both_ways: bool,
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
            both_ways: calibration.both_ways,
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
                let above = (normal - middle) * rise;
                let score = self.from + if self.both_ways { above.abs() } else { above };
                let judged = if n >= self.least { score } else { UNJUDGED };
                *highest = if judged > *highest { judged } else { *highest };
            }
        }
    }
}

/// Scores the evidence of a stretch, one entry a factor, under all filters: the rarest finding counts,
/// supported by what other factors find at the same place.
pub fn score(
    factors: &[(Evidence, &[Option<FilterCalibration>])],
    together: &Together,
    pitch_mm: f64,
) -> StretchScores {
    let Some((first, _)) = factors.first() else {
        return StretchScores::new(Vec::new(), Vec::new(), 1, 1, 1);
    };
    let row = first.strands * first.places;
    let cells = first.blocks * row;
    let mut of_block = vec![UNJUDGED; first.places];
    let mut of_factors = vec![vec![UNJUDGED; cells]; factors.len()];
    for ((evidence, calibration), of_factor) in factors.iter().zip(&mut of_factors) {
        let judges: Vec<Option<Judge>> = calibration.iter().map(|c| c.as_ref().map(Judge::new)).collect();
        evidence.filtered(pitch_mm, Steps::Thinned, |filtered| {
            let Some(Some(judge)) = judges.get(filtered.filter) else { return };
            if filtered.stands_for.len() == 1 {
                judge.raise(&mut of_factor[evidence.of(filtered.block, filtered.strand)], &filtered);
                return;
            }
            of_block.fill(UNJUDGED);
            judge.raise(&mut of_block, &filtered);
            for block in filtered.stands_for {
                for (highest, &score) in of_factor[evidence.of(block, filtered.strand)].iter_mut().zip(&of_block) {
                    *highest = if score > *highest { score } else { *highest };
                }
            }
        });
    }
    let mut scored = vec![f32::NAN; cells];
    let mut of_place = vec![UNJUDGED; factors.len()];
    for (strand, block) in (0..first.strands).flat_map(|strand| (0..first.blocks).map(move |block| (strand, block))) {
        for (to, at) in scored[first.of_scores(block, strand)].iter_mut().zip(first.of(block, strand)) {
            if first.regions[at] == UNSEEN {
                continue; // what stands for its neighbours may stand for places that are not seen
            }
            of_place.iter_mut().zip(&of_factors).for_each(|(score, of_factor)| *score = of_factor[at]);
            let score = together.score(&of_place);
            *to = if score == UNJUDGED { f32::NAN } else { score };
        }
    }
    StretchScores::new(scored, first.seen(pitch_mm), row, first.places, first.block_lines)
}

/// Score of cells that no filter judged, while scores are gathered.
const UNJUDGED: f32 = f32::NEG_INFINITY;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::calibration::CalibrationSums;
    use crate::vision::evidence::block_lines;

    const PITCH_MM: f64 = 0.1;
    const PLACES: usize = 35;

    /// A strand of chance values, with a run of `raised` along one wire.
    fn strand(seed: u32, both_ways: bool, raised: f32) -> Evidence {
        let mut state = seed;
        let mut evidence = Evidence::empty(block_lines(PITCH_MM), 900, 1, PLACES, 4.0..=12.0);
        evidence.both_ways = both_ways;
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
        let calibration = CalibrationSums::of(&strand(7, both_ways, 0.0), PITCH_MM).calibrate().unwrap();
        let together = Together::from_correlations(vec![vec![1.0]], 1).unwrap();
        let blocks = score(&[(strand(8, both_ways, raised), &calibration)], &together, PITCH_MM).highest();
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
