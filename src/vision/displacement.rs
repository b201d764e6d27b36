//! Lateral correction of every line, so that real and model contours agree best. [Wacker13, sec. 3.3.1 (2)-(3), eq. 9-12]

use super::contour::Contours;
use nalgebra::{Matrix3, Vector3};

/// Column of the rope axis in one line: where the model contours must stand to fit the real ones best.
///
/// Eq. 9 is a least-squares problem for the correction y of the real contour, eq. 10 its solution
/// y = (mc^u - rc^u + mc^l - rc^l)/2; the axis stands at -y, which is what this returns.
pub fn axis_px(lower_px: f64, upper_px: f64, model_lower_px: f64, model_upper_px: f64) -> f64 {
    0.5 * (upper_px - model_upper_px + lower_px - model_lower_px)
}

/// Periods of the outline (from strand to strand) over which a calm axis is smoothed, and a swaying one.
const PERIODS: (usize, usize) = (4, 2);
/// Difference between both that strands which lie higher or lower than others make, as a share of the rope's width.
const UNEVEN: f64 = 0.0007;

/// Lines whose two edges are so much farther from each other than usual, or nearer, do not show them both, as a share of the
/// rope's width: oil may hide an edge, and a wire end stand out from it.
const STRAY: f64 = 0.04;
/// Share of that at which lines round such ones do show both again.
const ROUND_STRAYS: f32 = 0.25;
/// Every how many lines are asked for the median: neighbours tell nearly the same.
const MEDIAN_EVERY: usize = 4;

/// Where the axis of a rope runs in one view.
#[derive(Debug, Clone, Default)]
pub struct AxisCourse {
    /// Its column at every line; NaN only if no line shows the rope.
    pub px: Vec<f32>,
    /// Scatter of single lines about it, rms.
    pub roughness_px: f64,
}

/// Column of the axis at every line, robustly smoothed.
///
/// The paper corrects every line by its own contours; a single wire end then shifts its whole line, and a strand that lies higher
/// than the others every line that it stands out in. Ropes do not jump: over a few strands' pitches their sideways movement is
/// smooth, so a parabola is fitted about every line, with outliers left out. `period_lines` is from strand to strand.
/// `model(line)` gives the model contours (lower, upper) at a line, counted from the axis.
pub fn axis_course_px(contours: &Contours, model: impl Fn(usize) -> (f64, f64), period_lines: usize) -> AxisCourse {
    let n = contours.len();
    let (mut raw, mut wider) = (vec![f32::NAN; n], vec![f32::NAN; n]);
    let mut width_px = 0.0f64;
    for (line, (axis, wider)) in raw.iter_mut().zip(&mut wider).enumerate() {
        let (lower, upper) = model(line);
        width_px = width_px.max(upper - lower);
        let (lower_px, upper_px) = (f64::from(contours.lower_px[line]), f64::from(contours.upper_px[line]));
        *axis = axis_px(lower_px, upper_px, lower, upper) as f32;
        *wider = ((upper_px - lower_px) - (upper - lower)) as f32;
    }
    leave_out_strays(&mut raw, &wider, (STRAY * width_px) as f32);
    // Reject what is far from the local median.
    let half = (period_lines / 2).max(1);
    let mut kept = raw.clone();
    let mut window: Vec<f32> = Vec::with_capacity(2 * half + 1);
    let stride = (half / 4).max(1);
    for start in (0..n).step_by(stride) {
        window.clear();
        let near = &raw[start.saturating_sub(half)..(start + half).min(n)];
        window.extend(near.iter().step_by(MEDIAN_EVERY).copied().filter(|a| a.is_finite()));
        if window.is_empty() {
            continue;
        }
        let middle = window.len() / 2;
        let median = *window.select_nth_unstable_by(middle, f32::total_cmp).1;
        for deviation in &mut window {
            *deviation = (*deviation - median).abs();
        }
        let spread = *window.select_nth_unstable_by(middle, f32::total_cmp).1;
        for axis in &mut kept[start..(start + stride).min(n)] {
            if (*axis - median).abs() > 4.0 * spread.max(0.5) {
                *axis = f32::NAN;
            }
        }
    }
    let (calm, closer) = (PERIODS.0 * half, PERIODS.1 * half);
    let sums = power_sums(&kept, calm);
    let mut course = local_parabolas(&sums, calm, calm);
    sway(&mut course, &local_parabolas(&sums, closer, calm), calm, UNEVEN * width_px);
    fill_gaps(&mut course);
    AxisCourse { roughness_px: scatter_px(&kept, &course), px: course }
}

/// Leaves out values whose line is wider or narrower than the usual one by more than `most_px`, and more than lines are of
/// themselves.
fn leave_out_strays(values: &mut [f32], wider_px: &[f32], most_px: f32) {
    let mut sorted: Vec<f32> = wider_px.iter().copied().filter(|w| w.is_finite()).collect();
    if sorted.is_empty() {
        return;
    }
    let middle = sorted.len() / 2;
    let usual = *sorted.select_nth_unstable_by(middle, f32::total_cmp).1;
    sorted.iter_mut().for_each(|w| *w = (*w - usual).abs());
    let spread = *sorted.select_nth_unstable_by(middle, f32::total_cmp).1;
    let most = most_px.max(4.0 * spread);
    let strays_by = |line: usize, share: f32| (wider_px[line] - usual).abs() > share * most;
    // An edge that is lost strays gradually: from a stray line on, everything goes until lines are nearly as usual again.
    let mut leave_out = |lines: &mut dyn Iterator<Item = usize>| {
        let mut stray = false;
        for line in lines {
            stray = strays_by(line, if stray { ROUND_STRAYS } else { 1.0 });
            if stray {
                values[line] = f32::NAN;
            }
        }
    };
    leave_out(&mut (0..wider_px.len()));
    leave_out(&mut (0..wider_px.len()).rev());
}

fn scatter_px(values: &[f32], course: &[f32]) -> f64 {
    let off = values.iter().zip(course).map(|(value, course)| f64::from(value - course)).filter(|off| off.is_finite());
    let (squares, count) = off.fold((0.0, 0.0), |(squares, count), off| (squares + off * off, count + 1.0));
    (squares / f64::max(count, 1.0)).sqrt()
}

/// Every how many places a parabola is fitted, the course being straight between them: a small part of the way from strand to strand.
const FITTED_EVERY: usize = 8;
/// Share of the values under a window that must be known.
const LEAST_KNOWN: f64 = 0.35;

/// Place of one of `n` values, counted from the middle in so many lines: sums of powers of small numbers stay exact.
fn place(k: usize, n: usize, unit: usize) -> f64 {
    (k as f64 - n as f64 / 2.0) / unit as f64
}

/// Sums of 1, x .. x^4, y, xy, x^2 y over the values before each and all of them, skipping NaN; y being the value, x its place.
fn power_sums(values: &[f32], unit: usize) -> Vec<[f64; 8]> {
    let n = values.len();
    let mut sums = vec![[0.0f64; 8]; n + 1];
    for (k, &value) in values.iter().enumerate() {
        let mut next = sums[k];
        if value.is_finite() {
            let (x, y) = (place(k, n, unit), f64::from(value));
            for (sum, term) in next.iter_mut().zip([1.0, x, x * x, x * x * x, x * x * x * x, y, x * y, x * x * y]) {
                *sum += term;
            }
        }
        sums[k + 1] = next;
    }
    sums
}

/// Value at every place of the parabola fitted to `half` values on either side, by their sums: swings stay swings, also at the
/// ends, where the window is one-sided.
fn local_parabolas(sums: &[[f64; 8]], half: usize, unit: usize) -> Vec<f32> {
    let n = sums.len() - 1;
    let fitted = |k: usize| {
        let (from, to) = (k.saturating_sub(half), (k + half + 1).min(n));
        // A window cut at an end is lengthened on the other side, so that it stays as certain.
        let (from, to) = (from.min(n.saturating_sub(2 * half + 1)), to.max((2 * half + 1).min(n)));
        let s: [f64; 8] = std::array::from_fn(|t| sums[to][t] - sums[from][t]);
        // A few values at one side say nothing of the place: the parabola would go anywhere.
        if s[0] < 3.0 || s[0] < LEAST_KNOWN * (to - from) as f64 {
            return f32::NAN;
        }
        let x = place(k, n, unit);
        let parabola = Matrix3::new(s[0], s[1], s[2], s[1], s[2], s[3], s[2], s[3], s[4])
            .try_inverse()
            .map(|inverse| inverse * Vector3::new(s[5], s[6], s[7]));
        parabola.map_or((s[5] / s[0]) as f32, |p| (p[0] + p[1] * x + p[2] * x * x) as f32)
    };
    let Some(last) = n.checked_sub(1) else { return Vec::new() };
    let mut course = Vec::with_capacity(n);
    let mut here = fitted(0);
    for from in (0..n).step_by(FITTED_EVERY) {
        let to = (from + FITTED_EVERY).min(last);
        let next = fitted(to);
        let per_place = (next - here) / (to - from).max(1) as f32;
        course.extend((0..FITTED_EVERY.min(n - from)).map(|k| here + k as f32 * per_place));
        here = next;
    }
    course
}

/// Lets a calm course follow a closer one where they differ by more than `uneven_px` rms within `half` lines (James-Stein): there
/// the rope sways faster than the calm one can follow.
fn sway(calm: &mut [f32], closer: &[f32], half: usize, uneven_px: f64) {
    let n = calm.len();
    let mut sums = vec![(0.0f64, 0.0f64); n + 1];
    for (k, (calm, closer)) in calm.iter().zip(closer).enumerate() {
        let squared = f64::from(closer - calm).powi(2);
        let (squares, count) = sums[k];
        sums[k + 1] = if squared.is_finite() { (squares + squared, count + 1.0) } else { (squares, count) };
    }
    for (k, (calm, closer)) in calm.iter_mut().zip(closer).enumerate() {
        let (from, to) = (sums[k.saturating_sub(half)], sums[(k + half + 1).min(n)]);
        let uneven = uneven_px * uneven_px * (to.1 - from.1);
        let share = (1.0 - uneven / f64::max(to.0 - from.0, 1e-9)).max(0.0);
        *calm += share as f32 * (closer - *calm);
    }
}

fn fill_gaps(values: &mut [f32]) {
    let known: Vec<usize> = (0..values.len()).filter(|&k| values[k].is_finite()).collect();
    let (Some(&first), Some(&last)) = (known.first(), known.last()) else { return };
    let (head, tail) = (values[first], values[last]);
    values[..first].fill(head);
    values[last + 1..].fill(tail);
    for pair in known.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        for k in a + 1..b {
            let share = (k - a) as f32 / (b - a) as f32;
            values[k] = values[a] + share * (values[b] - values[a]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_axis_stands_where_both_contours_agree_best() {
        assert_eq!(axis_px(60.0, 420.0, -180.0, 180.0), 240.0);
        assert_eq!(axis_px(61.0, 420.0, -180.0, 180.0), 240.5);
    }

    #[test]
    fn a_wire_end_sticking_out_and_lost_lines_do_not_move_the_axis() {
        let n = 600;
        let mut contours = Contours {
            lower_px: (0..n).map(|k| 60.0 + 0.01 * k as f32).collect(),
            upper_px: (0..n).map(|k| 420.0 + 0.01 * k as f32).collect(),
        };
        contours.upper_px[300..320].fill(450.0);
        contours.lower_px[100..130].fill(f32::NAN);
        let course = axis_course_px(&contours, |_| (-180.0, 180.0), 120);
        assert!(course.roughness_px < 0.01);
        for (k, axis) in course.px.iter().enumerate() {
            assert!((axis - (240.0 + 0.01 * k as f32)).abs() < 0.1, "line {k}: {axis}");
        }
    }

    #[test]
    fn an_edge_that_oil_hides_over_several_strands_does_not_move_the_axis() {
        let n = 2000;
        let mut contours = Contours { lower_px: vec![60.0; n], upper_px: vec![420.0; n] };
        // What was followed instead lies up to a fifth of the width inside, over four pitches and without a jump.
        for (k, upper) in contours.upper_px[900..1380].iter_mut().enumerate() {
            *upper -= 70.0 * (k as f32 / 480.0 * std::f32::consts::PI).sin();
        }
        let course = axis_course_px(&contours, |_| (-180.0, 180.0), 120);
        let worst = course.px.iter().map(|axis| (axis - 240.0).abs()).fold(0.0, f32::max);
        assert!(worst < 1.0, "{worst} px of the 35 that the edge strays by half");
    }
}
