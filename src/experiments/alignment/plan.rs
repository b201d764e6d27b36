//! How much rope the experiments get.

/// The amount of everything.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plan {
    /// Every random choice follows from it.
    pub seed: u64,
    /// Ropes a noise level; five times as many are tried for lost locks and as deformations.
    pub ropes: usize,
    /// Metres of a rope of a noise level.
    pub metres: f64,
    /// Metres of the rope that is tracked.
    pub tracked_m: f64,
    /// Metres of a ShortRope.
    pub short_m: f64,
    /// Recordings of one rope for the repeatability.
    pub recordings: usize,
}

/// Metres of a rope that is deformed or may be lost.
pub(super) const BRIEF_M: f64 = 1.2;

impl Plan {
    /// The paper's experiments: 20 ropes of 30 m a level, 100 deformations and 100 ropes of high noise.
    pub fn full(seed: u64) -> Self {
        Self { seed, ropes: 20, metres: 30.0, tracked_m: 30.0, short_m: 3.4, recordings: 10 }
    }

    /// About a minute: every part once, on as little rope as gives an estimate.
    pub fn quick(seed: u64) -> Self {
        Self { seed, ropes: 1, metres: 1.2, tracked_m: 2.0, short_m: 1.2, recordings: 3 }
    }

    /// Deformations, and random ropes at high noise.
    pub(super) fn many(&self) -> usize {
        5 * self.ropes
    }

    /// Metres of rope of all runs together.
    pub(super) fn total_m(&self) -> f64 {
        let noise_m = super::noise::LEVELS.len() as f64 * self.ropes as f64 * self.metres;
        let short_m = (3 + self.recordings) as f64 * self.short_m;
        noise_m + self.tracked_m + short_m + (2 * self.many() + 1) as f64 * BRIEF_M
    }

    /// Seed of the n-th rope of a part: parts do not share ropes.
    pub(super) fn seed_of(&self, part: &str, n: usize) -> u64 {
        let part = part.bytes().fold(0u64, |h, b| h.wrapping_mul(31).wrapping_add(u64::from(b)));
        self.seed.wrapping_mul(1_000_003).wrapping_add(part.wrapping_mul(1009)).wrapping_add(n as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ropes_of_all_parts_differ() {
        let plan = Plan::full(1);
        let parts = ["noise", "tracking", "short", "repeatability", "deformation", "lost"];
        let mut seeds: Vec<u64> = parts.iter().flat_map(|part| (0..100).map(move |n| plan.seed_of(part, n))).collect();
        seeds.sort_unstable();
        seeds.dedup();
        assert_eq!(seeds.len(), 600);
    }
}
