//! How often intact rope scores high: the tail of its scores, beyond what was ever seen of it, and how sure that is.
//!
//! A model is trained on metres, and its threshold is asked for events of which there are two in a hundred metres. Declustered
//! peaks over a base level follow a generalised Pareto law, whatever the scores are (Pickands, Balkema, de Haan); its shape, which a
//! few dozen peaks hardly tell, is known beforehand from many ropes. What is not known shows in the profile likelihood.

use super::known_tail::KnownTail;

/// A place this near to a higher one along the rope is the same event: alarms this near would be one defect.
const APART_MM: f64 = 20.0;
/// Share of the peaks that are the tail.
const TAIL_SHARE: f64 = 0.4;
/// Fewest peaks that make a tail.
const LEAST_PEAKS: usize = 4;
/// Shape that tails of intact rope have, and its spread from rope to rope. A choice: with it the trained thresholds of ten simulated
/// ropes (seeds 101 to 110) let 5 false defects pass on 270 m that no training had seen, 1.9 per 100 m at a budget of 2; with a mean
/// of 0.04 4 pass, with -0.02 6, and then places that training cannot explain are left out too soon.
const SHAPE: (f64, f64) = (0.01, 0.08);
/// Shapes and scales that are tried: from, to, number. Scales are shares of the mean excess.
const SHAPES: (f64, f64, usize) = (-0.4, 0.5, 46);
const SCALES: (f64, f64, usize) = (0.4, 2.5, 61);
/// Half the 95 % quantile of chi squared with one degree of freedom: what a profile likelihood falls by at the ends of an interval.
const HALF_CHI_95: f64 = 1.92;
/// Rates that an interval is looked for among: so many decades about the best one, in so many steps each way.
const DECADES: f64 = 4.0;
const STEPS: usize = 160;
/// How far over the base a score is looked for that a rate exceeds, and halvings of that: finer than any score is told.
const FARTHEST: f64 = 500.0;
const HALVINGS: usize = 50;
/// Excesses are counted in bins of this score: finer than any threshold is told.
const BIN: f64 = 0.02;
/// A peak that the rest would bring forth less often than once on so many ropes like this one is no peak of intact rope.
const OUTLIER_ROPES: f64 = 100.0;
/// At most this share of the peaks is taken for defects.
const MOST_OUTLIERS: f64 = 0.1;

/// Peaks of consecutive block scores: the highest first, and whatever is nearer to it than `APART_MM` belongs to it. Answers
/// blocks and scores.
pub fn peaks(blocks: &[f32], block_mm: f64) -> Vec<(usize, f32)> {
    let apart = (APART_MM / block_mm).round().max(1.0) as usize;
    let mut order: Vec<usize> = (0..blocks.len()).filter(|&b| blocks[b].is_finite()).collect();
    order.sort_by(|&a, &b| blocks[b].total_cmp(&blocks[a]).then(a.cmp(&b)));
    let mut taken = vec![false; blocks.len()];
    let mut peaks = Vec::new();
    for block in order {
        if !taken[block] {
            peaks.push((block, blocks[block]));
            taken[block.saturating_sub(apart)..(block + apart + 1).min(blocks.len())].fill(true);
        }
    }
    peaks
}

/// A law that the excess over the base may follow, and how well it does.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Law {
    shape: f64,
    scale: f64,
    /// Share of the law under the cut, which is what was counted.
    counted: f64,
    log_likelihood: f64,
}

impl Law {
    /// Share of excesses beyond `excess`.
    fn beyond(&self, excess: f64) -> f64 {
        if self.shape.abs() < 1e-9 {
            return (-excess / self.scale).exp();
        }
        (1.0 + self.shape * excess / self.scale).max(0.0).powf(-1.0 / self.shape)
    }

    fn log_density(&self, excess: f64) -> f64 {
        if self.shape.abs() < 1e-9 {
            return -self.scale.ln() - excess / self.scale;
        }
        let inside = 1.0 + self.shape * excess / self.scale;
        if inside <= 0.0 { f64::NEG_INFINITY } else { -self.scale.ln() - (1.0 + 1.0 / self.shape) * inside.ln() }
    }
}

/// The tail of the scores of a rope: events, and how far they go beyond a base.
#[derive(Debug, Clone, PartialEq)]
pub struct Tail {
    base: f64,
    metres: f64,
    count: f64,
    laws: Vec<Law>,
    best: Law,
    known: Option<KnownTail>,
}

/// The score over which the upper `TAIL_SHARE` of the peaks lie. `None` without peaks.
pub fn base_of(peaks: &[f32]) -> Option<f64> {
    let mut sorted = peaks.to_vec();
    sorted.sort_by(f32::total_cmp);
    sorted.get(((1.0 - TAIL_SHARE) * sorted.len() as f64) as usize).map(|&base| f64::from(base))
}

fn steps((from, to, n): (f64, f64, usize)) -> impl Iterator<Item = f64> {
    (0..n).map(move |k| from + (to - from) * k as f64 / (n - 1) as f64)
}

impl Tail {
    /// The tail of those of the peaks, seen on so many metres, that are over `base`. What lies over `cut` may be anything, defects
    /// perhaps, and tells nothing. What is `known` of such tails beforehand counts with it. `None` with too few peaks, or if all are alike.
    pub fn over(base: f64, peaks: &[f32], cut: f64, metres: f64, known: Option<KnownTail>) -> Option<Self> {
        let mut bins: Vec<f64> = Vec::new();
        for excess in peaks.iter().map(|&p| f64::from(p)).filter(|&p| p >= base && p < cut).map(|p| p - base) {
            let bin = (excess / BIN) as usize;
            bins.resize(bins.len().max(bin + 1), 0.0);
            bins[bin] += 1.0;
        }
        let middle = |bin: usize| (bin as f64 + 0.5) * BIN;
        let binned: Vec<(f64, f64)> =
            bins.iter().enumerate().filter(|(_, n)| **n > 0.0).map(|(bin, &n)| (middle(bin), n)).collect();
        let count: f64 = binned.iter().map(|(_, n)| n).sum();
        let mean = binned.iter().map(|(excess, n)| excess * n).sum::<f64>() / count;
        if count < LEAST_PEAKS as f64 || mean < BIN || metres <= 0.0 {
            return None;
        }
        let law = |(shape, scale): (f64, f64)| {
            let mut law = Law { shape, scale, counted: 1.0, log_likelihood: 0.0 };
            if cut.is_finite() {
                law.counted = (1.0 - law.beyond(cut - base)).max(f64::MIN_POSITIVE);
            }
            let seen: f64 = binned.iter().map(|&(excess, n)| n * law.log_density(excess)).sum();
            law.log_likelihood = seen - count * law.counted.ln() - 0.5 * ((shape - SHAPE.0) / SHAPE.1).powi(2);
            law
        };
        let scales = (SCALES.0.ln(), SCALES.1.ln(), SCALES.2);
        let laws: Vec<Law> = steps(SHAPES)
            .flat_map(|shape| steps(scales).map(move |log| (shape, mean * log.exp())))
            .map(law)
            .filter(|law| law.log_likelihood.is_finite())
            .collect();
        let best = *laws.iter().max_by(|a, b| a.log_likelihood.total_cmp(&b.log_likelihood))?;
        Some(Self { base, metres, count, laws, best, known })
    }

    /// The tail of the peaks of a rope that should be intact, without those so far out that the others do not explain them: a few
    /// defects that nobody had seen. Answers how many were left out, too.
    pub fn of_intact(peaks: &[f32], metres: f64, known: Option<KnownTail>) -> Option<(Self, usize)> {
        let mut kept = peaks.to_vec();
        kept.sort_by(f32::total_cmp);
        let base = base_of(&kept)?;
        let most = (MOST_OUTLIERS * peaks.len() as f64) as usize;
        // Defects hide each other: the tail is judged without as many as there may be, then they come back as far as they fit.
        let mut inner = kept.len().saturating_sub(most);
        while inner < kept.len() {
            let next = f64::from(kept[inner]);
            let Some(rest) = Self::over(base, &kept[..inner], next.max(base + BIN), metres, known) else {
                inner += 1;
                continue;
            };
            if rest.rate(next) * metres * OUTLIER_ROPES < 1.0 {
                break;
            }
            inner += 1;
        }
        Some((Self::over(base, &kept[..inner], f64::INFINITY, metres, known)?, kept.len() - inner))
    }

    /// Score from which on the law holds.
    pub fn base(&self) -> f64 {
        self.base
    }

    /// What its own peaks say of a score.
    fn own_rate(&self, score: f64) -> f64 {
        let all = self.count / self.metres / self.best.counted;
        all * self.best.beyond((score - self.base).max(0.0))
    }

    /// Peaks to be expected over a score on a metre of such rope.
    pub fn rate(&self, score: f64) -> f64 {
        let own = self.own_rate(score);
        self.known.map_or(own, |known| known.pooled(score - self.base, own, self.metres))
    }

    /// The score that so many peaks a metre exceed; never under the base.
    pub fn score_for(&self, rate: f64) -> f64 {
        let (mut low, mut high) = (self.base, self.base + FARTHEST);
        if self.rate(low) <= rate {
            return low;
        }
        for _ in 0..HALVINGS {
            let middle = (low + high) / 2.0;
            if self.rate(middle) > rate { low = middle } else { high = middle }
        }
        high
    }

    /// Between which rates the true one lies, 95 %.
    pub fn rate_between(&self, score: f64) -> (f64, f64) {
        let own = self.own_rate_between(score);
        self.known.map_or(own, |known| known.pooled_between(score - self.base, self.own_rate(score), own, self.metres))
    }

    /// The same by its own peaks: by profile likelihood over shape, scale and number.
    fn own_rate_between(&self, score: f64) -> (f64, f64) {
        let best = self.own_rate(score).max(f64::MIN_POSITIVE);
        let excess = (score - self.base).max(0.0);
        // Expected count per rate, and what the law itself is worth.
        let laws: Vec<(f64, f64)> = self
            .laws
            .iter()
            .filter(|law| law.log_likelihood > self.best.log_likelihood - 2.0 * HALF_CHI_95)
            .map(|law| (self.metres * law.counted / law.beyond(excess), law.log_likelihood))
            .filter(|(per_rate, _)| per_rate.is_finite())
            .collect();
        let profile = |rate: f64| {
            laws.iter()
                .map(|(per_rate, worth)| {
                    let expected = rate * per_rate;
                    worth + self.count * expected.ln() - expected
                })
                .fold(f64::NEG_INFINITY, f64::max)
        };
        let at = |step: f64| best * 10f64.powf(DECADES * step / STEPS as f64);
        let highest = (0..=2 * STEPS).map(|k| profile(at(k as f64 - STEPS as f64))).fold(f64::NEG_INFINITY, f64::max);
        let inside = |k: &usize| profile(at(*k as f64 - STEPS as f64)) >= highest - HALF_CHI_95;
        let low = (0..=2 * STEPS).find(inside).unwrap_or(0);
        let high = (0..=2 * STEPS).rev().find(inside).unwrap_or(2 * STEPS);
        (at(low as f64 - STEPS as f64), at(high as f64 - STEPS as f64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Peaks of `metres` with 40 a metre: exponential over 4 with mean 0.6, in a mixed order without chance.
    fn exponential(metres: f64) -> Vec<f32> {
        let n = (40.0 * metres) as usize;
        (0..n)
            .map(|k| {
                let share = ((k * 7919) % n) as f64 / n as f64 + 0.5 / n as f64;
                (4.0 - 0.6 * share.ln()) as f32
            })
            .collect()
    }

    #[test]
    fn the_highest_of_an_event_is_its_peak_and_two_events_are_two() {
        let mut blocks = vec![1.0f32; 200];
        (blocks[20], blocks[25], blocks[90], blocks[150]) = (6.0, 5.0, 7.0, f32::NAN);
        let found: Vec<_> = peaks(&blocks, 0.5).into_iter().filter(|p| p.1 > 2.0).collect();
        assert_eq!(found, [(90, 7.0), (20, 6.0)]);
    }

    #[test]
    fn rates_beyond_what_was_seen_follow_the_tail_within_the_interval_and_more_rope_narrows_it() {
        // 40 peaks a metre over 4: exp(-(s - 4)/0.6) of them over s; 2 in 100 m at s = 8.56.
        let truth = 4.0 + 0.6 * (40.0f64 / 0.02).ln();
        let mut widths = Vec::new();
        for metres in [1.6, 5.0, 40.0] {
            let peaks = exponential(metres);
            let (tail, outliers) = Tail::of_intact(&peaks, metres, None).unwrap();
            assert_eq!(outliers, 0);
            let score = tail.score_for(0.02);
            assert!((score - truth).abs() < 0.6, "{metres} m: {score}, true {truth}");
            let (low, high) = tail.rate_between(truth);
            assert!(low < 0.02 && 0.02 < high, "{metres} m: {low} {high}");
            assert!((tail.rate(score) / 0.02 - 1.0).abs() < 1e-6);
            widths.push((high / low).ln());
        }
        assert!(widths[0] > widths[1] && widths[1] > widths[2], "{widths:?}");
    }

    #[test]
    fn a_few_defects_in_the_rope_do_not_move_the_tail() {
        let mut peaks = exponential(5.0);
        let clean = Tail::of_intact(&peaks, 5.0, None).unwrap().0.score_for(0.02);
        peaks.extend([14.0, 16.0, 15.0, 19.0]);
        let (tail, outliers) = Tail::of_intact(&peaks, 5.0, None).unwrap();
        assert_eq!(outliers, 4);
        assert!((tail.score_for(0.02) - clean).abs() < 0.3, "{} {clean}", tail.score_for(0.02));
    }

    #[test]
    fn what_lies_over_the_cut_tells_nothing() {
        let mut peaks = exponential(20.0);
        let whole = Tail::over(4.4, &peaks, f64::INFINITY, 20.0, None).unwrap().rate(8.0);
        peaks.extend([9.0; 60]); // three defects a metre
        let cut = Tail::over(4.4, &peaks, 7.0, 20.0, None).unwrap().rate(8.0);
        assert!((cut / whole).ln().abs() < 0.7, "{cut} {whole}");
    }

    #[test]
    fn what_is_known_of_other_ropes_moves_a_threshold_towards_theirs() {
        let peaks = exponential(4.0);
        let own = Tail::of_intact(&peaks, 4.0, None).unwrap().0.score_for(0.02);
        let tail = Tail::of_intact(&peaks, 4.0, Some(KnownTail::CLOSER_LOOK)).unwrap().0;
        let pooled = tail.score_for(0.02);
        assert!(own < 9.0 && pooled > own + 1.0 && pooled < 12.4, "{own} {pooled}");
        assert!((tail.rate(pooled) / 0.02 - 1.0).abs() < 1e-6);
        let (low, high) = tail.rate_between(pooled);
        assert!(low < 0.01 && high > 0.04, "{low} {high}");
    }

    #[test]
    fn too_few_or_equal_peaks_make_no_tail() {
        assert!(Tail::of_intact(&[5.0; 3], 1.0, None).is_none());
        assert!(Tail::of_intact(&[5.0; 300], 1.0, None).is_none());
        assert!(Tail::of_intact(&[], 1.0, None).is_none());
    }
}
