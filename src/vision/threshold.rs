//! A threshold for line scores from intact rope, for a budget that an operator understands.
//!
//! The paper sets it by hand and names that as a drawback. Here block scores of held-back intact rope are extrapolated by the
//! exponential tail of their upper decade, to the rate that gives the wanted number of false defects per 100 m.

/// Blocks that one false alarm covers, on average: neighbouring blocks share their evidence.
const BLOCKS_PER_ALARM: f64 = 12.0;

/// A threshold and what it rests on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BudgetThreshold {
    /// Lines with a score above it are alarms.
    pub line_score: f64,
    /// False defects per 100 m of rope that it is made for.
    pub false_defects_per_100m: f64,
    /// Blocks of intact rope, all views, it rests on.
    pub blocks: usize,
}

/// Finds the threshold. `blocks_per_100m` counts the blocks of all views. `None` with fewer than 200 scores.
pub fn for_budget(scores: &[f32], blocks_per_100m: f64, false_defects_per_100m: f64) -> Option<BudgetThreshold> {
    let mut sorted: Vec<f32> = scores.iter().copied().filter(|s| s.is_finite()).collect();
    if sorted.len() < 200 {
        return None;
    }
    sorted.sort_by(f32::total_cmp);
    let quantile = |share: f64| f64::from(sorted[((sorted.len() - 1) as f64 * share).round() as usize]);
    let (q90, q99) = (quantile(0.90), quantile(0.99));
    let wanted = false_defects_per_100m * BLOCKS_PER_ALARM / blocks_per_100m;
    // P(score > s) = 0.1 * 10^(-(s - q90)/(q99 - q90)) in the tail.
    let decades = (0.1 / wanted).log10().max(0.0);
    Some(BudgetThreshold {
        line_score: q90 + decades * (q99 - q90).max(1e-3),
        false_defects_per_100m,
        blocks: sorted.len(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_exponential_tail_is_extrapolated_exactly() {
        // Scores with P(score > s) = 10^-s.
        let scores: Vec<f32> = (0..10_000).map(|k| -((f64::from(k) + 0.5) / 10_000.0).log10() as f32).collect();
        let threshold = for_budget(&scores, 800_000.0, 2.0).unwrap();
        let expected = -(2.0 * BLOCKS_PER_ALARM / 800_000.0).log10();
        assert!((threshold.line_score - expected).abs() < 0.05, "{} {expected}", threshold.line_score);
    }

    #[test]
    fn too_few_scores_give_no_threshold() {
        assert!(for_budget(&[1.0; 100], 1e6, 2.0).is_none());
    }
}
