//! From what lines know about a phase to what a frame knows about a lay length.

use super::seen::SeenRope;
use std::f64::consts::{PI, TAU};

/// Phases of the first line over which a bound is averaged: a frame begins anywhere.
const BEGINNINGS: usize = 24;

/// Mean of |error| of a Gaussian error with this standard deviation.
pub fn mean_abs(sd: f64) -> f64 {
    sd * (2.0 / PI).sqrt()
}

/// Standard deviation of a lay length in mm, that of the turn per mm being `rate_sd`.
pub fn lay_sd_mm(lay_mm: f64, rate_sd: f64) -> f64 {
    lay_mm * lay_mm / TAU * rate_sd
}

/// Information of one line about the strands' phase, per rad^2, from both contours with white noise.
///
/// The displacement of the line is unknown and moves both contours alike [Wacker13, eq. 10]. What is left is their difference,
/// whose variance is twice that of one contour: (d(width)/d(phase))^2 / (2 sd^2).
pub fn contour_information(rope: &SeenRope, phase_rad: f64, contour_noise_px: f64) -> f64 {
    rope.width_slope_px(phase_rad).powi(2) / (2.0 * contour_noise_px * contour_noise_px)
}

/// Lines that one line stands for when information is summed: a phase hardly turns over so few.
const STRIDE: usize = 4;

/// Least standard deviation in mm of the strand lay of a frame whose strands have `middle_rad` at its middle line, from the
/// contours of one view alone: phase and lay unknown, the displacement of every line unknown, white noise.
pub fn contour_bound_mm(
    rope: &SeenRope,
    lay_mm: f64,
    middle_rad: f64,
    (lines, pitch_mm): (usize, f64),
    contour_noise_px: f64,
) -> f64 {
    let (mut n, mut x, mut xx) = (0.0, 0.0, 0.0);
    for line in (0..lines).step_by(STRIDE) {
        let at_mm = (line as f64 - lines as f64 / 2.0) * pitch_mm;
        let known = STRIDE as f64 * contour_information(rope, middle_rad + at_mm * TAU / lay_mm, contour_noise_px);
        n += known;
        x += known * at_mm;
        xx += known * at_mm * at_mm;
    }
    lay_sd_mm(lay_mm, (n / (n * xx - x * x)).sqrt()) // of the turn per mm, the phase being unknown
}

/// [`contour_bound_mm`], root mean square over where the frame begins.
pub fn usual_contour_bound_mm(rope: &SeenRope, lay_mm: f64, frame: (usize, f64), contour_noise_px: f64) -> f64 {
    let step = TAU / rope.strands as f64;
    let beginnings = (0..BEGINNINGS).map(|n| step * n as f64 / BEGINNINGS as f64);
    let squares = beginnings.map(|phase| contour_bound_mm(rope, lay_mm, phase, frame, contour_noise_px).powi(2));
    (squares.sum::<f64>() / BEGINNINGS as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bound_is_that_of_the_design_study() {
        // 20.46 mm, 6x9, lay 137.5 mm, 380 px wide, 2,000 lines. An independent study found a mean |error| of 0.009, 0.018, 0.036
        // and 0.073 mm, rounded to its last digit, as a far camera gives it: 3 % for what else it may have had differently.
        let rope = SeenRope::new(6, 9, 20.46, 380.0, 1e5);
        for (noise_px, mean_mm) in [(0.5, 0.009), (1.0, 0.018), (2.0, 0.036), (4.0, 0.073)] {
            let bound = mean_abs(usual_contour_bound_mm(&rope, 137.5, (2000, 0.1), noise_px));
            assert!((bound - mean_mm).abs() < 0.0006 + 0.03 * mean_mm, "{noise_px} px: {bound} for {mean_mm}");
        }
        // At the 7 diameters of the simulator perspective takes a fifth: each edge belongs to a strand before or behind the side.
        let near = SeenRope::new(6, 9, 20.46, 380.0, 7.0 * 20.46);
        let ratio = usual_contour_bound_mm(&near, 137.5, (2000, 0.1), 1.0)
            / usual_contour_bound_mm(&rope, 137.5, (2000, 0.1), 1.0);
        assert!((ratio - 1.22).abs() < 0.02, "{ratio}");
    }

    #[test]
    fn four_times_the_lines_know_eight_times_as_much() {
        let rope = SeenRope::new(6, 9, 20.46, 380.0, 143.0);
        let bound = |lines| usual_contour_bound_mm(&rope, 137.5, (lines, 0.1), 1.0);
        assert!((bound(4000) / bound(16_000) - 8.0).abs() < 0.3); // lever and number: 4^1.5
    }
}
