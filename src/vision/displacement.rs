//! Lateral correction of every line, so that real and model contours agree best. [Wacker13, sec. 3.3.1 (2)-(3), eq. 9-12]

use super::contour::Contours;

/// Column of the rope axis in one line: where the model contours must stand to fit the real ones best.
///
/// Eq. 9 is a least-squares problem for the correction y of the real contour, eq. 10 its solution
/// y = (mc^u - rc^u + mc^l - rc^l)/2; the axis stands at -y, which is what this returns.
pub fn axis_px(lower_px: f64, upper_px: f64, model_lower_px: f64, model_upper_px: f64) -> f64 {
    0.5 * (upper_px - model_upper_px + lower_px - model_lower_px)
}

/// Lines whose two edges are so much farther from each other than usual, or nearer, do not show them both, as a share of the
/// rope's width: oil may hide an edge, and a wire end stand out from it.
const STRAY: f64 = 0.04;
/// Share of that at which lines round such ones do show both again.
const ROUND_STRAYS: f32 = 0.25;
/// Every how many lines are asked for the median: neighbours tell nearly the same.
const MEDIAN_EVERY: usize = 4;

/// What the contours of one view say of the axis; both are NaN at lines that do not show it.
#[derive(Debug, Clone, Default)]
pub struct AxisReadings {
    /// Its column at every line.
    pub axis_px: Vec<f32>,
    /// Half of what the rope is wider than the model there. It errs as the axis does, and does not move with the rope.
    pub half_wider_px: Vec<f32>,
    /// Greatest width of the model.
    pub width_px: f64,
}

/// Reads the axis at every line, without lines that do not show it and without outliers: a single wire end would shift its
/// whole line. `period_lines` is from strand to strand; `model(line)` gives the model contours (lower, upper) at a line, counted
/// from the axis.
pub fn axis_readings(contours: &Contours, model: impl Fn(usize) -> (f64, f64), period_lines: usize) -> AxisReadings {
    let n = contours.len();
    let (mut raw, mut half_wider) = (vec![f32::NAN; n], vec![f32::NAN; n]);
    let mut width_px = 0.0f64;
    for (line, (axis, half_wider)) in raw.iter_mut().zip(&mut half_wider).enumerate() {
        let (lower, upper) = model(line);
        width_px = width_px.max(upper - lower);
        let (lower_px, upper_px) = (f64::from(contours.lower_px[line]), f64::from(contours.upper_px[line]));
        *axis = axis_px(lower_px, upper_px, lower, upper) as f32;
        *half_wider = (0.5 * ((upper_px - lower_px) - (upper - lower))) as f32;
    }
    leave_out_strays(&mut raw, &half_wider, (0.5 * STRAY * width_px) as f32);
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
    half_wider.iter_mut().zip(&kept).filter(|(_, axis)| !axis.is_finite()).for_each(|(wider, _)| *wider = f32::NAN);
    AxisReadings { axis_px: kept, half_wider_px: half_wider, width_px }
}

/// Leaves out values whose line is wider or narrower than the usual one by more than twice `most_px`, and more than lines are
/// of themselves.
fn leave_out_strays(values: &mut [f32], half_wider_px: &[f32], most_px: f32) {
    let mut sorted: Vec<f32> = half_wider_px.iter().copied().filter(|w| w.is_finite()).collect();
    if sorted.is_empty() {
        return;
    }
    let middle = sorted.len() / 2;
    let usual = *sorted.select_nth_unstable_by(middle, f32::total_cmp).1;
    sorted.iter_mut().for_each(|w| *w = (*w - usual).abs());
    let spread = *sorted.select_nth_unstable_by(middle, f32::total_cmp).1;
    let most = most_px.max(4.0 * spread);
    let strays_by = |line: usize, share: f32| (half_wider_px[line] - usual).abs() > share * most;
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
    leave_out(&mut (0..half_wider_px.len()));
    leave_out(&mut (0..half_wider_px.len()).rev());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_axis_stands_where_both_contours_agree_best() {
        assert_eq!(axis_px(60.0, 420.0, -180.0, 180.0), 240.0);
        assert_eq!(axis_px(61.0, 420.0, -180.0, 180.0), 240.5);
    }
}
