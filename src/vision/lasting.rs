//! Evidence that lasts along the rope: abrasion, arcs and rust show on one wire after the other, each a little unusual.
//!
//! The highest score of a block is that of the most unusual of some hundred places, and varies from block to block. Its mean over a few
//! centimetres varies much less, so what is no rarer than intact rope in any block may be rare in all of them together. Single
//! high scores are cut before, or every break would last for centimetres.

use super::calibration::quantile;
use super::stretch_scores::StretchScores;

/// Millimetres of rope over which scores are averaged.
const LASTING_MM: f64 = 30.0;
/// Share of intact blocks whose highest score is not cut.
const UNCUT: f64 = 0.99;
/// Share of intact blocks below the score at which means are brought to the scale of single blocks.
const RARE: f64 = 0.99;
/// Share of intact blocks above which both are compared: the usual one.
const USUAL: f64 = 0.5;

/// How means of scores over some rope are compared with the scores of single blocks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lasting {
    /// Score that a block counts with at most.
    pub cut: f32,
    /// Score that a mean of 0 stands for.
    pub from: f32,
    /// Rise of the score with the mean.
    pub rise: f32,
}

impl Lasting {
    /// Nothing is raised. `from` is the lowest number, not infinity, which a model file cannot hold.
    pub const NEVER: Self = Self { cut: 0.0, from: f32::MIN, rise: 0.0 };

    /// Compares both on stretches of intact rope in all views. `None` if nothing of them was judged.
    pub fn calibrate<'a>(stretches: impl Iterator<Item = &'a StretchScores> + Clone, block_mm: f64) -> Option<Self> {
        let all = |of: &dyn Fn(&StretchScores) -> Vec<f32>| -> Vec<f32> {
            stretches.clone().flat_map(of).filter(|score| score.is_finite()).collect()
        };
        let mut blocks = all(&|s| s.blocks.clone());
        let mut highest = all(&|s| s.highest());
        if blocks.is_empty() || highest.is_empty() {
            return None;
        }
        let cut = quantile(&mut highest, UNCUT);
        let mut means = all(&|s| means(&s.highest(), cut, block_mm));
        let (usual, usual_mean) = (quantile(&mut blocks, USUAL), quantile(&mut means, USUAL));
        let rare_mean = quantile(&mut means, RARE) - usual_mean;
        let rise = (quantile(&mut blocks, RARE) - usual) / rare_mean.max(f32::EPSILON);
        Some(Self { cut, from: usual - rise * usual_mean, rise })
    }

    /// Raises the scores of blocks to what the rope about them says.
    pub fn raise(&self, stretch: &mut StretchScores, block_mm: f64) {
        let means = means(&stretch.highest(), self.cut, block_mm);
        for (score, mean) in stretch.blocks.iter_mut().zip(means) {
            *score = score.max(self.from + self.rise * mean); // blocks without a score stay without
        }
    }
}

/// Mean over [`LASTING_MM`] about every block of scores up to `cut`; NaN where the block itself has none.
fn means(scores: &[f32], cut: f32, block_mm: f64) -> Vec<f32> {
    let half = (LASTING_MM / block_mm / 2.0).round() as usize;
    let mut sums = vec![(0.0f32, 0.0f32)];
    sums.extend(scores.iter().scan((0.0, 0.0), |(sum, n), score| {
        if score.is_finite() {
            (*sum, *n) = (*sum + score.min(cut), *n + 1.0);
        }
        Some((*sum, *n))
    }));
    let mean = |(k, score): (usize, &f32)| {
        let (before, after) = (sums[k.saturating_sub(half)], sums[(k + half + 1).min(scores.len())]);
        if score.is_finite() { (after.0 - before.0) / (after.1 - before.1) } else { f32::NAN }
    };
    scores.iter().enumerate().map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::stretch_scores::Visibility;

    const BLOCK_MM: f64 = 0.5;

    /// A stretch with one place whose scores are given, settled as they are.
    fn stretch(scores: Vec<f32>) -> StretchScores {
        StretchScores {
            visibility: vec![Visibility::WHOLE; scores.len()],
            peaks: vec![(0, 0); scores.len()],
            added: Vec::new(),
            looks: Vec::new(),
            cells: scores.clone(),
            blocks: scores,
            block_lines: 5,
            places: 1,
        }
    }

    /// Scores of intact rope: 1 on average, up to 3.
    fn usual(block: usize) -> f32 {
        3.0 * ((block * 7919 + 13) % 101) as f32 / 101.0 * ((block * 104_729 + 7) % 97) as f32 / 97.0
    }

    #[test]
    fn scores_that_are_usual_in_every_block_are_rare_where_they_last() {
        let intact: Vec<StretchScores> =
            (0..20).map(|s| stretch((0..400).map(|b| usual(400 * s + b)).collect())).collect();
        let lasting = Lasting::calibrate(intact.iter(), BLOCK_MM).unwrap();
        let worn = |b: usize| if (150..230).contains(&b) { 1.9 } else { usual(b) };
        let mut damaged = stretch((0..400).map(worn).collect());
        lasting.raise(&mut damaged, BLOCK_MM);
        assert!(damaged.blocks[190] > 4.0, "{}", damaged.blocks[190]);
        let highest = damaged.blocks[..100].iter().copied().fold(0.0, f32::max);
        assert!(highest < 3.5, "intact rope beside it: {highest}");
    }

    #[test]
    fn a_single_high_score_does_not_last_and_blocks_without_one_stay_without() {
        let intact: Vec<StretchScores> =
            (0..20).map(|s| stretch((0..400).map(|b| usual(400 * s + b)).collect())).collect();
        let lasting = Lasting::calibrate(intact.iter(), BLOCK_MM).unwrap();
        let scores: Vec<f32> = (0..400)
            .map(|b| {
                if b == 200 {
                    30.0
                } else if b == 300 {
                    f32::NAN
                } else {
                    usual(b)
                }
            })
            .collect();
        let (mut with, mut without) = (stretch(scores.clone()), stretch((0..400).map(usual).collect()));
        lasting.raise(&mut with, BLOCK_MM);
        lasting.raise(&mut without, BLOCK_MM);
        assert_eq!(with.blocks[200], 30.0);
        assert!((with.blocks[210] - without.blocks[210]).abs() < 0.5, "{} {}", with.blocks[210], without.blocks[210]);
        assert!(with.blocks[300].is_nan());
        let mut never = stretch(scores.clone());
        Lasting::NEVER.raise(&mut never, BLOCK_MM);
        assert!(never.blocks.iter().zip(&scores).all(|(a, b)| a == b || b.is_nan()));
        assert!(Lasting::calibrate([stretch(vec![f32::NAN; 4])].iter(), BLOCK_MM).is_none());
    }
}
