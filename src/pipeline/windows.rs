//! Counting over windows of rope: how many spans touch each, and where a window is worst.

/// A part of the rope, in rope metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span {
    /// Where it begins.
    pub from_m: f64,
    /// Where it ends.
    pub to_m: f64,
}

impl Span {
    /// Its length in m.
    pub fn length_m(&self) -> f64 {
        self.to_m - self.from_m
    }

    /// Metres that both have in common.
    pub fn overlap_m(&self, other: &Span) -> f64 {
        (self.to_m.min(other.to_m) - self.from_m.max(other.from_m)).max(0.0)
    }
}

/// Spans to be counted: their beginnings and their ends, each in order, so that a window is counted without looking at all.
#[derive(Debug, Clone, PartialEq)]
pub struct Tally {
    from_m: Vec<f64>,
    to_m: Vec<f64>,
}

impl Tally {
    /// Over these spans.
    pub fn new(spans: &[Span]) -> Self {
        let sorted = |mut metres: Vec<f64>| {
            metres.sort_by(f64::total_cmp);
            metres
        };
        Self {
            from_m: sorted(spans.iter().map(|s| s.from_m).collect()),
            to_m: sorted(spans.iter().map(|s| s.to_m).collect()),
        }
    }

    /// How many spans have a point in common with a window: one at the edge of two windows counts in both.
    pub fn count(&self, window: &Span) -> usize {
        let begun = self.from_m.partition_point(|&m| m <= window.to_m);
        begun - self.to_m.partition_point(|&m| m < window.from_m)
    }

    /// The window of this length, anywhere on the rope, with most spans; the first one of several, around what it counts.
    /// Limits of rules hold for any window, so side by side is not enough.
    pub fn worst(&self, rope: Span, length_m: f64) -> Span {
        let last_start_m = (rope.to_m - length_m).max(rope.from_m);
        let window = |from_m: f64| Span { from_m, to_m: (from_m + length_m).min(rope.to_m) };
        // The count grows only where a window begins to reach the beginning of a span, and falls only behind the end of one.
        let mut best = (0, rope.from_m);
        for m in &self.from_m {
            let start_m = (m - length_m).clamp(rope.from_m, last_start_m);
            let reached = self.count(&Span { from_m: start_m, to_m: m.max(start_m + length_m) });
            if reached > best.0 {
                best = (reached, start_m);
            }
        }
        let next_end_m = self.to_m.get(self.to_m.partition_point(|&m| m < best.1)).copied().unwrap_or(best.1);
        window((best.1 + next_end_m.clamp(best.1, last_start_m.max(best.1))) / 2.0)
    }
}

/// Windows of this length side by side along the rope; the last one is cut at its end.
pub fn series(rope: Span, length_m: f64) -> impl Iterator<Item = Span> {
    let n = windows_of(rope, length_m);
    (0..n).map(move |k| {
        let from_m = rope.from_m + k as f64 * length_m;
        Span { from_m, to_m: (from_m + length_m).min(rope.to_m) }
    })
}

/// How many windows of this length [`series`] has.
pub fn windows_of(rope: Span, length_m: f64) -> usize {
    // A rest of rounding is no window.
    ((rope.length_m() / length_m - 1e-9).ceil() as usize).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn span(from_m: f64, to_m: f64) -> Span {
        Span { from_m, to_m }
    }

    const ROPE: Span = Span { from_m: 100.0, to_m: 110.0 };

    #[test]
    fn windows_side_by_side_cover_the_rope_and_end_with_it() {
        let windows: Vec<Span> = series(ROPE, 4.0).collect();
        assert_eq!(windows, [span(100.0, 104.0), span(104.0, 108.0), span(108.0, 110.0)]);
        assert_eq!(series(ROPE, 50.0).collect::<Vec<_>>(), [ROPE]);
        assert_eq!(windows_of(ROPE, 0.1), 100, "0.1 is no binary fraction");
    }

    #[test]
    fn the_worst_window_may_lie_across_two_windows_side_by_side() {
        let spans = [span(103.9, 103.95), span(104.05, 104.1), span(101.0, 101.1), span(109.0, 109.1)];
        let tally = Tally::new(&spans);
        assert!(series(ROPE, 1.0).all(|w| tally.count(&w) < 2));
        let worst = tally.worst(ROPE, 1.0);
        assert_eq!(tally.count(&worst), 2);
        assert!((worst.length_m() - 1.0).abs() < 1e-12);
        // As much before the first as after the second.
        assert!((worst.from_m + worst.to_m - 2.0 * 104.0).abs() < 1e-9, "{worst:?}");
    }

    #[test]
    fn the_worst_window_counts_what_any_search_by_small_steps_finds() {
        let spans: Vec<Span> = (0..40)
            .map(|k: u32| {
                let from_m = 100.0 + f64::from(k.wrapping_mul(2_654_435_761) >> 8) / f64::from(1 << 24) * 9.9;
                span(from_m, from_m + 0.01 * f64::from(k % 7))
            })
            .collect();
        let tally = Tally::new(&spans);
        for length_m in [0.05, 0.3, 1.7, 20.0] {
            let starts = (0..20_000).map(|k| 100.0 + f64::from(k) * 5e-4).filter(|s| s + length_m <= 110.0);
            let by_steps = starts.map(|s| tally.count(&span(s, s + length_m))).max().unwrap_or(40);
            assert_eq!(tally.count(&tally.worst(ROPE, length_m)), by_steps, "{length_m} m");
        }
    }

    #[test]
    fn without_anything_to_count_the_worst_window_is_the_first() {
        assert_eq!(Tally::new(&[]).worst(ROPE, 2.0), span(100.0, 102.0));
        assert_eq!(Tally::new(&[]).worst(ROPE, 20.0), ROPE);
    }
}
