//! Both edges of the rope in a line that nothing is known of yet: where it differs from the line's own margins.

use super::image::GrayImage;
use super::lost_lines::LostLines;

/// The edge must differ from the background by this many standard deviations of the background.
pub(super) const SIGNIFICANT_SD: f32 = 4.0;
/// The edge must differ from the background by this share of what the rope's body does: stray light beside the rope does not.
pub(super) const BODY_SHARE: f32 = 0.25;
/// Least difference in gray values that is taken for a rope, whatever the noise.
pub(super) const LEAST_CONTRAST: f32 = 5.0;
/// Lines between two searches for a lost edge.
pub(super) const SEARCH_EVERY: usize = 16;

/// How far the body of the rope differs from both margins: the median over the middle half of the columns, all lines averaged but
/// those that were lost.
pub(super) fn body_contrast(image: &GrayImage, lost: &LostLines) -> f32 {
    let width = image.width();
    let mut mean = vec![0.0f32; width];
    let rows: Vec<usize> = (0..image.lines()).step_by(SEARCH_EVERY).filter(|&row| !lost.contains(row)).collect();
    for &row in &rows {
        for (m, &gray) in mean.iter_mut().zip(image.line(row)) {
            *m += f32::from(gray) / rows.len() as f32;
        }
    }
    let margin = (width / 40).max(4);
    let margins = mean[..margin].iter().chain(&mean[width - margin..]).sum::<f32>() / (2 * margin) as f32;
    let mut differences: Vec<f32> = mean[width / 4..3 * width / 4].iter().map(|m| (m - margins).abs()).collect();
    let middle = differences.len() / 2;
    *differences.select_nth_unstable_by(middle, f32::total_cmp).1
}

/// Both edges of the widest thing in a line that differs from the line's own margins.
///
/// Answers lower edge, upper edge and how far the body of the rope differs from the background.
pub(super) fn coarse_edges(
    image: &GrayImage,
    lost: &LostLines,
    line: usize,
    body: f32,
    hint_px: Option<f64>,
) -> Option<(f32, f32, f32)> {
    let width = image.width();
    let from = line.saturating_sub(SEARCH_EVERY / 2);
    let rows = (from..(from + SEARCH_EVERY).min(image.lines())).filter(|&row| !lost.contains(row));
    let n = rows.clone().count() as f32;
    let mut mean = vec![0.0f32; width];
    let mut squares = vec![0.0f32; width];
    for row in rows {
        for ((mean, squares), &gray) in mean.iter_mut().zip(&mut squares).zip(image.line(row)) {
            let gray = f32::from(gray);
            *mean += gray;
            *squares += gray * gray;
        }
    }
    for (m, s) in mean.iter_mut().zip(&mut squares) {
        *m /= n;
        *s = (*s / n - *m * *m).max(0.0);
    }
    let margin = (width / 40).max(4);
    let side = |range: std::ops::Range<usize>| {
        let m = range.clone().map(|c| mean[c]).sum::<f32>() / range.len() as f32;
        let v = range.clone().map(|c| squares[c] + (mean[c] - m).powi(2)).sum::<f32>() / range.len() as f32;
        (m, v)
    };
    let (left, left_variance) = side(0..margin);
    let (right, right_variance) = side(width - margin..width);
    let step = |inward: isize| {
        // Walk inward with a background that follows slow gradients but not an edge.
        let (mut background, mut variance) = if inward > 0 { (left, left_variance) } else { (right, right_variance) };
        let columns: Vec<usize> = if inward > 0 { (0..width).collect() } else { (0..width).rev().collect() };
        let differs = |c: usize, background: f32, variance: f32| {
            let least = (SIGNIFICANT_SD * variance.sqrt() * 0.5).max(LEAST_CONTRAST).max(BODY_SHARE * body);
            (mean[c] - background).abs() > least
        };
        for (k, &column) in columns.iter().enumerate() {
            if differs(column, background, variance) {
                let ahead = &columns[k..(k + 8).min(columns.len())];
                if ahead.len() == 8 && ahead.iter().filter(|&&c| differs(c, background, variance)).count() >= 6 {
                    return Some(column as f32);
                }
            } else {
                background += (mean[column] - background) / 12.0;
                variance += (squares[column] - variance) / 12.0;
            }
        }
        None
    };
    let (lower, upper) = (step(1)?, step(-1)?);
    let least_width = hint_px.map_or(width as f64 / 8.0, |hint| 0.7 * hint);
    let noise = ((left_variance + right_variance) / (2.0 * n)).sqrt();
    let wide = f64::from(upper - lower) >= least_width;
    let around = (lower as usize).saturating_sub(2 * BEND_PX)..(upper as usize + 2 * BEND_PX).min(width);
    (wide && shows_something(&mean[around], noise)).then_some((lower, upper, body))
}

/// Pixels over which gray values bend at an edge or from wire to wire, but not in the slope of a background.
const BEND_PX: usize = 4;
/// Pixels that must lie on bends: one edge has as many.
const BENT_PX: usize = 2 * BEND_PX;

/// True if gray values, of this noise, are other than those of a background that grows brighter to one side.
fn shows_something(gray: &[f32], noise: f32) -> bool {
    // three values, the middle one twice: sqrt(6) of the noise
    let least = (SIGNIFICANT_SD * 6f32.sqrt() * noise).max(LEAST_CONTRAST);
    let bends = gray.windows(2 * BEND_PX + 1).map(|near| (near[0] + near[2 * BEND_PX] - 2.0 * near[BEND_PX]).abs());
    bends.filter(|bend| *bend > least).count() >= BENT_PX
}
