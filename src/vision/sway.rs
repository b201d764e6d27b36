//! How a rope sways before a camera: a smooth course of its axis, from contours and image together. [Wacker13, sec. 3.3.1, extended]
//!
//! The paper corrects every line by its own contours; a strand that stands out then moves every line in which it stands at the
//! side. Ropes do not jump, so the axis is a smoothing spline: it follows as closely as the noise of its readings allows, whose
//! density the rope's width tells, for it errs as the axis does and does not sway. Contours say where the rope is in the long run;
//! over a few strands the image says it better, but strands that move and dirt lead it astray slowly, which is a course
//! of its own.

use super::course::Course;
use super::displacement::AxisReadings;
use super::smoothing::{Chain, CoursePrior, Measurement, Observation, smooth};

/// How ropes sway: spectral density of the change of the axis's slope, times the cube of the rope's diameter, as a share of its
/// squared width. A choice: waves of three diameters and more are followed where contours err as usual.
const SWAY: f64 = 3.5e-5;
/// The same by contours alone. Strands are registered about that course and take part in its errors, so it is calmer.
const CALM: f64 = 1e-5;
/// The same for what leads the image astray: strands that stand a little elsewhere, dirt and light.
const ASTRAY: f64 = 1e-5;
/// Greatest slope of an axis, as a share of the rope's width in a diameter.
const STEEPEST: f64 = 0.1;
/// Part of the way from strand to strand over which readings err together.
const ERR_TOGETHER: f64 = 0.5;
/// Farthest that the known lines of a knot may lie from its middle on average, as a share of its length.
const MOST_LOPSIDED: f64 = 0.06;
/// Knots beyond the outermost that was measured over which the axis goes straight on; beyond, it stays.
const STRAIGHT_ON: f64 = 1.5;
/// Least standard deviation of a knot, as a share of the rope's width.
const LEAST_SD: f64 = 1e-5;

/// What the contours of one view say of the axis, knot by knot, over a stretch and what is known of the rope beyond its ends. Values
/// of measurements are px here.
#[derive(Debug, Clone, Default)]
pub struct AxisKnots {
    contours: Vec<Measurement>,
    /// Line in the middle of the first knot, counted from the first of the stretch.
    first_middle: f64,
    /// Of them, before the stretch.
    before: usize,
    knot_lines: usize,
    pitch_mm: f64,
    /// Knots from strand to strand.
    period: f64,
    width_px: f64,
    diameter_mm: f64,
}

/// What does not depend on the readings.
#[derive(Debug, Clone, Copy)]
pub struct AxisGrid {
    /// Lines of a knot.
    pub knot_lines: usize,
    /// Rope per line.
    pub pitch_mm: f64,
    /// Lines from strand to strand.
    pub period_lines: usize,
    /// Of the rope.
    pub diameter_mm: f64,
}

impl AxisKnots {
    /// Gathers readings of which the first `beyond` lie before the stretch.
    pub fn new(readings: &AxisReadings, beyond: usize, grid: AxisGrid) -> Self {
        let AxisGrid { knot_lines, pitch_mm, period_lines, diameter_mm } = grid;
        let skipped = beyond % knot_lines;
        let knots = |values: &[f32]| -> Vec<(f64, f64)> {
            values[skipped.min(values.len())..].chunks_exact(knot_lines).map(mean_of_known).collect()
        };
        let (axis, wider) = (knots(&readings.axis_px), knots(&readings.half_wider_px));
        let period = period_lines as f64 / knot_lines as f64;
        let least = (LEAST_SD * readings.width_px).powi(2);
        let known: Vec<f64> = wider.iter().map(|&(px, share)| if share > 0.0 { px } else { f64::NAN }).collect();
        let variance = noise(&known, (ERR_TOGETHER * period).round() as usize).unwrap_or(1.0).max(least);
        Self {
            contours: axis
                .iter()
                .map(|&(px, share)| Measurement { value_rad: px, information: share / variance })
                .collect(),
            first_middle: skipped as f64 - beyond as f64 + (knot_lines as f64 - 1.0) / 2.0,
            before: beyond / knot_lines,
            knot_lines,
            pitch_mm,
            period,
            width_px: readings.width_px,
            diameter_mm,
        }
    }

    fn prior(&self, bends: f64) -> CoursePrior {
        CoursePrior {
            spacing_mm: self.knot_lines as f64 * self.pitch_mm,
            wander: bends * self.width_px.powi(2) / self.diameter_mm.powi(3),
            rate_rad_per_mm: 0.0,
            rate_sd: STEEPEST * self.width_px / self.diameter_mm,
        }
    }

    /// Column of the axis at every one of `lines` lines of the stretch, by the contours alone. NaN if they say nothing.
    pub fn by_contours(&self, lines: usize) -> Vec<f32> {
        self.drawn(smooth(&self.contours, self.prior(CALM)), lines)
    }

    /// The same with what the image says: `image_px[knot]`, the first one of the stretch first, NaN where it says nothing. `None` if it
    /// says hardly anything.
    pub fn with_image(&self, image_px: &[f64], axis_px: &[f32]) -> Option<Vec<f32>> {
        let least = (LEAST_SD * self.width_px).powi(2);
        let variance = noise(image_px, (ERR_TOGETHER * self.period).round() as usize)?.max(least);
        let mut observations = vec![Observation::<4>::default(); self.contours.len()];
        for (observation, &contours) in observations.iter_mut().zip(&self.contours) {
            observation.add(&[1.0, 0.0], contours);
        }
        let knots = image_px.iter().zip(axis_px.chunks_exact(self.knot_lines));
        for (observation, (&off_px, axis)) in observations.iter_mut().skip(self.before).zip(knots) {
            if off_px.is_finite() {
                let value_rad = off_px + mean_of_known(axis).0;
                observation.add(&[1.0, 1.0], Measurement { value_rad, information: 1.0 / variance });
            }
        }
        let courses = Chain::new(observations, &[self.prior(SWAY), self.prior(ASTRAY)])?.courses(None);
        Some(self.drawn(courses.into_iter().next(), axis_px.len()))
    }

    /// A course line by line: cubic between knots, a little way straight on beyond the outermost that were measured.
    fn drawn(&self, course: Option<Course>, lines: usize) -> Vec<f32> {
        let measured = |k: &usize| self.contours[*k].information > 0.0;
        let (Some(course), Some(first), Some(last)) =
            (course, (0..self.contours.len()).find(measured), (0..self.contours.len()).rfind(measured))
        else {
            return vec![f32::NAN; lines];
        };
        let spacing_mm = self.knot_lines as f64 * self.pitch_mm;
        let at = |line: usize| {
            let at = (line as f64 - self.first_middle) / self.knot_lines as f64;
            let at = at.clamp(first as f64 - STRAIGHT_ON, last as f64 + STRAIGHT_ON);
            let k = (at.max(0.0) as usize).clamp(first, last.max(first + 1) - 1);
            let (t, next) = (at - k as f64, (k + 1).min(last));
            let (a, b) = (course.phase_rad(k), course.phase_rad(next));
            let slopes = [course.rate_rad_per_mm(k), course.rate_rad_per_mm(next)].map(|rate| rate * spacing_mm);
            if t <= 0.0 {
                return a + t * slopes[0];
            }
            if t >= 1.0 {
                return b + (t - 1.0) * slopes[1];
            }
            let (left, right) = (slopes[0] - (b - a), (b - a) - slopes[1]);
            a + t * (b - a) + t * (1.0 - t) * ((1.0 - t) * left + t * right)
        };
        (0..lines).map(|line| at(line) as f32).collect()
    }
}

/// Mean of the values that are known, and their share: none if they do not lie about the middle, for the mean is to be that there.
fn mean_of_known(values: &[f32]) -> (f64, f64) {
    let known = values.iter().enumerate().filter(|(_, value)| value.is_finite());
    let (places, sum, count) = known.fold((0.0, 0.0, 0.0), |(places, sum, count), (k, &value)| {
        (places + k as f64 + 0.5, sum + f64::from(value), count + 1.0)
    });
    let (n, count) = (values.len() as f64, f64::max(count, 1.0));
    let lopsided = (places / count - n / 2.0).abs() > MOST_LOPSIDED * n;
    (sum / count, if lopsided { 0.0 } else { count / n })
}

/// Variance of one of `values` of which `together` neighbours share an error, as if they were independent; NaN where unknown. It
/// is told from means of so many and those next to them, so that slow changes do not count. `None` if too few are known.
fn noise(values: &[f64], together: usize) -> Option<f64> {
    let together = together.max(1);
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let pairs = values.windows(2 * together).step_by(together.div_ceil(2));
    let squares: Vec<f64> = pairs
        .map(|pair| (mean(&pair[together..]) - mean(&pair[..together])).powi(2))
        .filter(|squared| squared.is_finite())
        .collect();
    (squares.len() >= FEWEST_PAIRS).then(|| together as f64 * mean(&squares) / 2.0)
}

/// Fewest pairs of neighbours that tell a variance.
const FEWEST_PAIRS: usize = 4;

#[cfg(test)]
mod tests {
    use super::super::contour::Contours;
    use super::super::displacement::axis_readings;
    use super::*;

    const LINES: usize = 2000;
    const PERIOD: usize = 200;
    const GRID: AxisGrid = AxisGrid { knot_lines: 40, pitch_mm: 0.1, period_lines: PERIOD, diameter_mm: 20.0 };

    fn knots(contours: &Contours) -> AxisKnots {
        AxisKnots::new(&axis_readings(contours, |_| (-180.0, 180.0), PERIOD), 0, GRID)
    }

    /// Contours of a rope whose axis is `axis_px(line)`; `off_px(line)` is what the upper edge errs by.
    fn contours(axis_px: impl Fn(usize) -> f64, off_px: impl Fn(usize) -> f64) -> Contours {
        let edges = |side: f64, share: f64| (0..LINES).map(move |k| (k, side, share));
        let edge = |(k, side, share): (usize, f64, f64)| (240.0 + side + axis_px(k) + share * off_px(k)) as f32;
        Contours { lower_px: edges(-180.0, 0.0).map(edge).collect(), upper_px: edges(180.0, 1.0).map(edge).collect() }
    }

    /// The same error over half of the way from strand to strand, another one in the next.
    fn uneven(line: usize) -> f64 {
        ((line / (PERIOD / 2)) * 7919 % 101) as f64 / 50.0 - 1.0
    }

    fn rms(values: impl Iterator<Item = f64>) -> f64 {
        let (sum, count) = values.fold((0.0, 0.0), |(sum, count), v| (sum + v * v, count + 1.0));
        f64::sqrt(sum / count)
    }

    #[test]
    fn a_wave_of_three_strands_is_followed_where_the_contours_are_good() {
        // A parabola over four strands, as it was, leaves a fifth of such a wave.
        let wave = |k: usize| (k as f64 / (3 * PERIOD) as f64 * std::f64::consts::TAU).sin();
        let course = knots(&contours(wave, |k| 0.1 * uneven(k))).by_contours(LINES);
        let off = rms(course.iter().enumerate().map(|(k, axis)| f64::from(*axis) - 240.0 - wave(k)));
        assert!(off < 0.1, "{off} px of the 0.7");
    }

    #[test]
    fn the_worse_the_contours_the_calmer_the_course() {
        let passed = |noise_px: f64| {
            let course = knots(&contours(|_| 0.0, |k| noise_px * uneven(k))).by_contours(LINES);
            rms(course.iter().map(|axis| f64::from(*axis) - 240.0)) / noise_px
        };
        let (good, bad) = (passed(0.05), passed(5.0));
        assert!(bad < 0.6 * good, "{bad} of the noise, and {good} where there is little");
    }

    #[test]
    fn the_image_adds_waves_that_contours_cannot_tell_and_its_own_drift_leads_nobody_astray() {
        let wave = |k: usize| 0.5 * (k as f64 / (2 * PERIOD) as f64 * std::f64::consts::TAU).sin();
        let knots = knots(&contours(wave, uneven));
        let calm = knots.by_contours(LINES);
        let off = |course: &[f32]| rms(course.iter().enumerate().map(|(k, axis)| f64::from(*axis) - 240.0 - wave(k)));
        for drift_px in [0.0, 2.0] {
            let image = |knot: usize| {
                let lines = knot * GRID.knot_lines..(knot + 1) * GRID.knot_lines;
                let true_px = lines.clone().map(wave).sum::<f64>() / lines.len() as f64 + 240.0;
                true_px - mean_of_known(&calm[lines]).0 + 3.0 + drift_px * knot as f64 / 50.0
            };
            let mended = knots.with_image(&(0..50).map(image).collect::<Vec<_>>(), &calm).unwrap();
            assert!(off(&mended) < 0.7 * off(&calm), "{} of {}", off(&mended), off(&calm));
        }
        assert!(knots.with_image(&[f64::NAN; 50], &calm).is_none());
    }

    #[test]
    fn knots_count_from_the_stretch_and_not_from_the_rope_before_it() {
        let slope = |k: usize| 0.01 * k as f64;
        let readings = axis_readings(&contours(slope, |_| 0.0), |_| (-180.0, 180.0), PERIOD);
        let course = AxisKnots::new(&readings, 530, GRID).by_contours(LINES - 530);
        let worst = course.iter().enumerate().map(|(k, axis)| (f64::from(*axis) - 240.0 - slope(k + 530)).abs());
        assert!(worst.fold(0.0, f64::max) < 0.01);
    }

    #[test]
    fn a_wire_end_sticking_out_and_lost_lines_do_not_move_the_axis() {
        let mut contours = contours(|k| 0.01 * k as f64, |_| 0.0);
        contours.upper_px[600..620].fill(490.0);
        contours.lower_px[200..260].fill(f32::NAN);
        contours.lower_px[1900..].fill(f32::NAN);
        let course = knots(&contours).by_contours(LINES);
        for (k, axis) in course.iter().enumerate().take(1900) {
            assert!((axis - (240.0 + 0.01 * k as f32)).abs() < 0.1, "line {k}: {axis}");
        }
        assert!(course.iter().all(|axis| axis.is_finite()));
        contours.upper_px.fill(f32::NAN);
        assert!(knots(&contours).by_contours(LINES).iter().all(|axis| axis.is_nan()));
    }

    #[test]
    fn an_edge_that_oil_hides_over_several_strands_does_not_move_the_axis() {
        // What was followed instead lies up to a fifth of the width inside, over four pitches and without a jump.
        let oil = |k: usize| {
            if (700..1500).contains(&k) { ((k - 700) as f64 / 800.0 * std::f64::consts::PI).sin() } else { 0.0 }
        };
        let course = knots(&contours(|_| 0.0, |k| -70.0 * oil(k))).by_contours(LINES);
        let worst = course.iter().map(|axis| (axis - 240.0).abs()).fold(0.0, f32::max);
        // Lines that are nearly as wide as usual again show both edges, as far as anybody knows.
        assert!(worst < 2.0, "{worst} px of the 35 that the edge strays by half");
    }
}
