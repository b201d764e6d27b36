//! Whether measurements scatter about their smoothed course by as much as they state.

use super::smoothing::Measurement;

/// Knots over which residuals are looked at for what neighbours share.
const SHARED_KNOTS: usize = 12;

/// Factor on the stated variances that the residuals of measurements about their smoothed course ask for: their mean normalised
/// square, times how many neighbouring knots share one error (1 + twice the sum of autocorrelations).
pub(super) fn residual_scale(series: &[Vec<Option<f64>>]) -> Option<f64> {
    let mut products = [(0.0, 0.0); SHARED_KNOTS + 1];
    for residuals in series {
        for (lag, product) in products.iter_mut().enumerate() {
            for (a, b) in residuals.iter().zip(residuals.iter().skip(lag)) {
                if let (Some(a), Some(b)) = (a, b) {
                    product.0 += a * b;
                    product.1 += 1.0;
                }
            }
        }
    }
    if products[0].1 < 50.0 {
        return None;
    }
    let covariance = |lag: usize| products[lag].0 / f64::max(products[lag].1, 1.0);
    let shared = 2.0 * (1..=SHARED_KNOTS).map(covariance).sum::<f64>();
    Some(covariance(0) + shared.max(0.0))
}

/// Residual of a measurement in standard deviations, given what the smoothed course says there and how well. `None` where the
/// course is little but this measurement.
pub(super) fn normalised(measured: Measurement, expected_rad: f64, variance: f64) -> Option<f64> {
    let kept = 1.0 - measured.information * variance;
    // A defect here and there must not count: residuals are cut.
    let residual = measured.information.sqrt() * (measured.value_rad - expected_rad) / kept.max(0.2).sqrt();
    (measured.information > 0.0 && kept > 0.2).then_some(residual.clamp(-4.0, 4.0))
}
