//! What is known of the tails of intact rope before any of it was seen, from other ropes.
//!
//! A threshold is asked for events of which there are two in a hundred metres, and a training shows four. What lies on ropes (tar, grease,
//! oil, water) comes from rope to rope alike, and logarithms of odds mean the same on all of them: far out, other ropes tell more than
//! the few peaks of one's own. What is usual on a rope, where its tail begins, its own peaks tell. The more rope of its own a tail rests on, the less
//! the others count.

/// Factor within which the rates of single ropes lie about the known one, with 95 %. A choice: twice what the ten ropes below show.
const ROPES_WITHIN: f64 = 4.0;

/// A tail that is known beforehand, over a base that a rope's own peaks tell well.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownTail {
    /// How far over the base.
    excess: f64,
    /// Events a metre that go farther.
    per_m: f64,
    /// Scores over which their number falls to 1/e.
    scale: f64,
    /// Metres of one's own rope that tell as much.
    metres: f64,
}

impl KnownTail {
    /// That of scores to which a closer look has added its share: 120 m of ten simulated ropes (seeds 101 to 110, see the README) that no
    /// training had seen. 29, 11, 6, 1 and 0 events in 100 m go farther than 4, 5, 6, 7 and 8 over bases of 4.1 to 4.5. The metres are
    /// those with which the trained thresholds of these ropes kept a budget of 2 in 100 m best when the closer look was new (3 false defects;
    /// with 4 m 6, without it 8).
    pub const CLOSER_LOOK: Self = Self { excess: 7.2, per_m: 0.02, scale: 1.2, metres: 12.0 };

    /// Events to be expected beyond an excess on a metre of rope.
    fn rate(&self, excess: f64) -> f64 {
        self.per_m * ((self.excess - excess) / self.scale).exp()
    }

    /// What counts of the logarithm of a rate that so many metres tell.
    fn own_share(&self, metres: f64) -> f64 {
        metres / (metres + self.metres)
    }

    /// The rate beyond an excess, where so many metres of rope tell `own`: the weighed mean of both logarithms.
    pub fn pooled(&self, excess: f64, own: f64, metres: f64) -> f64 {
        let share = self.own_share(metres);
        own.max(f64::MIN_POSITIVE).powf(share) * self.rate(excess).powf(1.0 - share)
    }

    /// Between which rates the true one lies, 95 %, where so many metres tell that it lies `within` of `own`.
    pub fn pooled_between(&self, excess: f64, own: f64, within: (f64, f64), metres: f64) -> (f64, f64) {
        let share = self.own_share(metres);
        let known = (1.0 - share) * ROPES_WITHIN.ln();
        let away = |end: f64| (share * (end / own).ln()).hypot(known);
        let pooled = self.pooled(excess, own, metres);
        (pooled * (-away(within.0)).exp(), pooled * away(within.1).exp())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn little_rope_leans_on_what_is_known_of_others_and_much_rope_on_its_own() {
        let known = KnownTail::CLOSER_LOOK;
        assert!((known.pooled(known.excess, 0.02, 4.0) - 0.02).abs() < 1e-9, "both say the same");
        let pooled = |metres: f64| known.pooled(known.excess, 2.0, metres);
        assert!(pooled(4.0) > 0.02 && pooled(4.0) < 0.1, "{}", pooled(4.0));
        assert!(pooled(400.0) > 1.5, "{}", pooled(400.0));
        let (low, high) = known.pooled_between(known.excess, 2.0, (0.1, 9.0), 4.0);
        assert!(low < pooled(4.0) / 2.5 && high > pooled(4.0) * 2.5, "{low} {high}");
    }
}
