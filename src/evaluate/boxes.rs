//! Distributions as box plots show them. [Wacker13, sec. 6.3.1, after McGill et al. 1978]

use super::lay_lengths::percentile;

/// A box: median, quartiles, whiskers, and what lies beyond them.
#[derive(Debug, Clone, PartialEq)]
pub struct BoxSummary {
    /// Number of values.
    pub n: usize,
    /// Median.
    pub median: f64,
    /// Lower quartile.
    pub lower: f64,
    /// Upper quartile.
    pub upper: f64,
    /// Lowest value within one and a half box heights below the box.
    pub lower_whisker: f64,
    /// Highest value within one and a half box heights above it.
    pub upper_whisker: f64,
    /// Values beyond the whiskers, ascending.
    pub outliers: Vec<f64>,
}

/// Box heights that whiskers reach at most.
const WHISKER: f64 = 1.5;

impl BoxSummary {
    /// Summary of finite values; `None` without any.
    pub fn of(values: &[f64]) -> Option<Self> {
        let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let (&least, &most) = (sorted.first()?, sorted.last()?);
        let (lower, upper) = (percentile(&sorted, 25.0), percentile(&sorted, 75.0));
        let reach = WHISKER * (upper - lower);
        let inside = |v: &&f64| (lower - reach..=upper + reach).contains(*v);
        Some(Self {
            n: sorted.len(),
            median: percentile(&sorted, 50.0),
            lower,
            upper,
            lower_whisker: sorted.iter().find(inside).copied().unwrap_or(least),
            upper_whisker: sorted.iter().rfind(inside).copied().unwrap_or(most),
            outliers: sorted.iter().filter(|v| !inside(v)).copied().collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whiskers_end_at_values_and_what_is_beyond_is_an_outlier() {
        let summary = BoxSummary::of(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 30.0, f64::NAN]).unwrap();
        assert_eq!((summary.n, summary.median, summary.lower, summary.upper), (9, 5.0, 3.0, 7.0));
        assert_eq!((summary.lower_whisker, summary.upper_whisker), (1.0, 8.0));
        assert_eq!(summary.outliers, [30.0]);
        assert_eq!(BoxSummary::of(&[f64::NAN]), None);
    }
}
