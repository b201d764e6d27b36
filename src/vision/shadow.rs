//! Whether an edge that was followed is the rope's or that of a shadow on the background.
//!
//! Lamps are wide, so the outline of a shadow is soft, while the rope ends within the blur of the lens. Where a shadow lies on
//! the background right beside the rope its outline may be hard, but it shows nothing inside, where rope shows its wires.

use super::edge_strip::{EdgeStrip, OUTSIDE};

/// A soft outline has less than this share of its step within a few pixels. Measured: shadows 0.21 to 0.45, straight ones to
/// 0.62; rope 0.74 to 1.0 before simulated backgrounds, dirty, dim and noisy.
const SOFT: f32 = 0.6;
/// Rope's is never this soft, whatever is to be seen inside.
const SOFTEST: f32 = 0.45;
/// Inside other soft outlines blocks differ from each other by less than so many times what noise explains. Measured in shadows
/// 1 to 5; beside rope that is as soft, because it is as bright as the background or the picture is, more than 9.
const CALM: f32 = 7.0;
/// Inside a hard one they differ by less than this: there is nothing to see. Measured in shadows 1.0 to 1.5, beside the edge of
/// rope 2.4 to 17, in photographs more than 30.
const NOTHING: f32 = 1.7;
/// ... if the step is so many times the noise of a pixel: otherwise the noise hides the wires, too.
const CLEAR: f32 = 12.0;
/// Least gray of a shadow, as a share of the background's: what is darker is an unlit edge of rope, for shadows are lit from
/// elsewhere.
const LEAST_SHARE: f32 = 0.15;
/// Noise is at least this, in gray values: that of rounding.
pub(super) const LEAST_NOISE: f32 = 0.5;

/// Distance from the edge, in px, within which the outline of rope of this width is complete.
pub(super) fn reach_px(strip: &EdgeStrip) -> usize {
    // the strip reaches a fifth of the rope's width inside
    ((strip.width - OUTSIDE) / 20).clamp(1, 3)
}

/// True if the edge of the strip is a shadow's.
pub(super) fn is_shadow(strip: &EdgeStrip) -> bool {
    let (median, spread) = EdgeStrip::medians(&strip.gray, strip.width);
    let reach = reach_px(strip);
    let background = median[OUTSIDE - 2 * reach];
    let darkest = median[OUTSIDE..].iter().copied().fold(f32::INFINITY, f32::min);
    let step = background - darkest;
    let inside = OUTSIDE + reach..OUTSIDE + 4 * reach;
    if median[inside.end] < LEAST_SHARE * background || step <= 0.0 {
        return false;
    }
    let n = inside.len() as f32;
    let noise = inside.clone().map(|k| strip.noise[k].max(LEAST_NOISE)).sum::<f32>() / n;
    let spread = inside.map(|k| spread[k]).sum::<f32>() / n;
    let beyond_noise = spread / noise * (strip.block_lines as f32).sqrt();
    let near = (median[OUTSIDE - reach] - median[OUTSIDE + reach]) / step;
    let soft = near < SOFTEST || near < SOFT && beyond_noise < CALM;
    soft || step > CLEAR * noise && beyond_noise < NOTHING
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A strip of 40 blocks whose gray is that of `gray` at a block and a distance inside the edge, with a noise of 2.
    fn strip(gray: impl Fn(usize, f32) -> f32) -> EdgeStrip {
        let width = OUTSIDE + 76;
        let noisy = |block: usize, k: usize| 0.7 * ((block * 7 + k * 13) % 5) as f32 - 1.4;
        let gray = (0..40 * width)
            .map(|p| gray(p / width, (p % width) as f32 - OUTSIDE as f32) + noisy(p / width, p % width) / 2.0)
            .collect();
        EdgeStrip { block_lines: 8, lines: 320, width, gray, noise: vec![2.0; width] }
    }

    /// Wires that pass by: a wave of so many gray values.
    fn wires(block: usize, inside: f32, gray: f32) -> f32 {
        gray * (0.4 * inside + 0.5 * block as f32).sin()
    }

    #[test]
    fn soft_outlines_and_hard_ones_with_nothing_inside_are_shadows() {
        assert!(is_shadow(&strip(|_, inside| 180.0 - 100.0 * (inside / 25.0).clamp(0.0, 1.0))));
        assert!(is_shadow(&strip(|_, inside| if inside < 0.0 { 180.0 } else { 80.0 })));
    }

    #[test]
    fn wires_right_inside_the_outline_are_rope_even_if_it_is_soft() {
        let soft = |block, inside: f32| 180.0 - 100.0 * (inside / 5.0).clamp(0.0, 1.0) + wires(block, inside, 30.0);
        assert!(!is_shadow(&strip(soft)));
        assert!(!is_shadow(&strip(|block, inside| if inside < 0.0 {
            180.0
        } else {
            80.0 + wires(block, inside, 5.0)
        })));
    }

    #[test]
    fn black_is_an_unlit_edge_and_no_shadow() {
        assert!(!is_shadow(&strip(|_, inside| if inside < 0.0 { 180.0 } else { 12.0 })));
    }
}
