//! Scales of a chart: from values to dots, and where the numbers stand.

/// An axis of a chart.
#[derive(Debug, Clone, PartialEq)]
pub struct Scale {
    from: f64,
    to: f64,
    logarithmic: bool,
    /// Named places instead of numbers.
    names: Vec<(f64, String)>,
}

/// Most numbers at an axis.
const MOST_TICKS: f64 = 6.0;

impl Scale {
    /// Evenly from one value to another.
    pub fn linear(from: f64, to: f64) -> Self {
        let to = if to > from { to } else { from + 1.0 };
        Self { from, to, logarithmic: false, names: Vec::new() }
    }

    /// By decades, from a positive value on.
    pub fn logarithmic(from: f64, to: f64) -> Self {
        let from = from.max(f64::MIN_POSITIVE);
        Self { from, to: to.max(from * 10.0), logarithmic: true, names: Vec::new() }
    }

    /// Names at 0, 1, 2, ..., half a place free at both ends.
    pub fn names(names: impl IntoIterator<Item = String>) -> Self {
        let names: Vec<_> = names.into_iter().enumerate().map(|(n, name)| (n as f64, name)).collect();
        Self { from: -0.5, to: names.len() as f64 - 0.5, logarithmic: false, names }
    }

    /// Evenly from the least to the greatest finite value, with a little room; 0 to 1 without any.
    pub fn around(values: impl Iterator<Item = f64>) -> Self {
        let ends = values
            .filter(|v| v.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        if ends.0 > ends.1 {
            return Self::linear(0.0, 1.0);
        }
        let room = (0.06 * (ends.1 - ends.0)).max(1e-9 * ends.1.abs()).max(1e-12);
        Self::linear(ends.0 - room, ends.1 + room)
    }

    /// Where a value lies: 0 at the beginning, 1 at the end; beyond them it is cut.
    pub(super) fn share(&self, value: f64) -> f64 {
        let share = if self.logarithmic {
            (value.max(self.from) / self.from).ln() / (self.to / self.from).ln()
        } else {
            (value - self.from) / (self.to - self.from)
        };
        share.clamp(0.0, 1.0)
    }

    /// Values with what is written there.
    pub(super) fn ticks(&self) -> Vec<(f64, String)> {
        if !self.names.is_empty() {
            return self.names.clone();
        }
        if self.logarithmic {
            let (first, last) = (self.from.log10().ceil() as i32, (self.to.log10() + 1e-9).floor() as i32);
            return (first..=last).map(|e| 10f64.powi(e)).map(|v| (v, format!("{v}"))).collect();
        }
        let step = round_step((self.to - self.from) / MOST_TICKS);
        let digits = (-step.log10().floor()).max(0.0) as usize;
        let first = (self.from / step).ceil() as i64;
        let last = (self.to / step + 1e-9).floor() as i64;
        (first..=last).map(|n| (n as f64 * step, format!("{:.digits$}", n as f64 * step))).collect()
    }
}

/// The next larger of 1, 2, 5 times a power of ten.
fn round_step(least: f64) -> f64 {
    let decade = 10f64.powf(least.log10().floor());
    [1.0, 2.0, 5.0].into_iter().map(|n| n * decade).find(|step| *step >= least * (1.0 - 1e-9)).unwrap_or(10.0 * decade)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_round_and_lie_within_the_axis() {
        let ticks = Scale::linear(0.0, 0.07).ticks();
        let written: Vec<&str> = ticks.iter().map(|t| t.1.as_str()).collect();
        assert_eq!(written, ["0.00", "0.02", "0.04", "0.06"]);
        let decades: Vec<String> = Scale::logarithmic(1e-3, 1.0).ticks().into_iter().map(|t| t.1).collect();
        assert_eq!(decades, ["0.001", "0.01", "0.1", "1"]);
    }

    #[test]
    fn values_beyond_the_axis_are_cut() {
        let scale = Scale::logarithmic(0.01, 1.0);
        assert!((scale.share(0.1) - 0.5).abs() < 1e-12);
        assert_eq!((scale.share(0.0), scale.share(7.0)), (0.0, 1.0));
        assert_eq!(Scale::around(std::iter::empty()), Scale::linear(0.0, 1.0));
    }
}
