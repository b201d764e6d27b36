//! Measures each strand's own phase by registering the image with the learnt template, and the outline with the model's.
//!
//! Real ropes are not rigid: strands drift by a degree or two (the paper names this as its main inaccuracy). Each knot, a few
//! millimetres of rope, gets one Gauss-Newton step per strand from the linearised difference of image and [`Template`]; the
//! smoother joins the knots, which keeps a defect from being followed.

use super::contour::Contours;
use super::image::GrayImage;
use super::model_contour::ModelContour;
use super::rope::Rope;
use super::surface::rounded;
use super::template::{Template, normalised_line, phase_bin};
use super::wide::wide;
use super::wire_pattern::{WirePattern, mean_phase};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Every how many lines the image is registered: neighbouring lines tell nearly the same.
pub const LINE_STRIDE: usize = 8;
/// Differences from the template beyond this (in units of the line's mean gray) are dirt, highlights or defects, and are cut.
pub(super) const CUT: f32 = 0.35;
/// Strands nearer to the outline than this phase are not registered in this view: they are narrow and badly lit.
const FARTHEST_RAD: f64 = 1.35;

/// Which lines are looked at, and for which knot.
#[derive(Debug, Clone, Copy)]
pub struct Knots {
    /// Lines of a knot.
    pub lines: usize,
    /// One of so many of the usual lines is looked at.
    pub thinned: usize,
}

/// Normal equations of one knot in one view: sums over the knot's pixels.
#[derive(Debug, Clone, Default)]
pub struct KnotSums {
    /// Per strand: sum of (dT/dphase)^2.
    pub phase_phase: [f64; 8],
    /// Per strand: sum of dT/dphase * difference.
    pub phase_difference: [f64; 8],
    /// Per strand: sum of (dP/dw)^2, P the wires' pattern and w their phase.
    pub wire_wire: [f64; 8],
    /// Per strand: sum of dT/dphase * dP/dw.
    pub phase_wire: [f64; 8],
    /// Per strand: sum of dP/dw * difference.
    pub wire_difference: [f64; 8],
    /// Sum of difference^2.
    pub squares: f64,
    /// Number of pixels.
    pub pixels: f64,
    /// Sums of (dE/dy)^2 and of dE/dy * difference, where E is how gray changes over `STEP_PX` columns and y how far the picture
    /// stands sideways of where it was taken to be, in px. Asked only where no line is left out.
    pub sideways: (f64, f64),
    /// Per strand, from the contours: sum of (dc/dphase)^2 in px^2/rad^2.
    pub contour_phase_phase: [f64; 8],
    /// Per strand, from the contours: sum of dc/dphase * difference in px^2/rad.
    pub contour_phase_difference: [f64; 8],
    /// Sum of squared contour differences in px^2, their number, and the sum of products of neighbouring ones.
    pub contour_squares: (f64, f64, f64),
}

impl KnotSums {
    /// How far the picture stands sideways of where it was taken to be, in px; NaN if it does not say.
    pub fn sideways_px(&self) -> f64 {
        if self.sideways.0 > 0.0 { self.sideways.1 / self.sideways.0 } else { f64::NAN }
    }
}

/// Sums the normal equations of every knot of an image. `phases_rad(line, out)` gives the reference phases of all strands in
/// rope axes; `wires_rad(line, out)` those of wire 0 of every strand (NaN where unknown), whose pattern is taken out first;
/// `axis_px[line]` is the reference axis; knots are `knot_lines` long.
#[expect(clippy::too_many_arguments, reason = "one pass over the image with all that is known of it")]
pub fn register(
    rope: &Rope,
    template: &Template,
    pattern: Option<&WirePattern>,
    angle_rad: f64,
    image: &GrayImage,
    axis_px: &[f32],
    knots: Knots,
    phases_rad: impl Fn(usize, &mut [f64]),
    wires_rad: impl Fn(usize, &mut [f64]),
) -> Vec<KnotSums> {
    let width = template.width();
    let n = rope.strands();
    let mut sums = vec![KnotSums::default(); image.lines().div_ceil(knots.lines)];
    let mut line = vec![0.0f32; width];
    let mut phases = vec![0.0f64; n];
    let mut wires = vec![f64::NAN; n];
    let mut per_wire_rad = vec![0.0f32; width];
    let mut there = vec![0.0f32; width];
    let step = rope.strand_step_rad();
    for k in (0..image.lines()).step_by(knots.thinned * LINE_STRIDE) {
        if !normalised_line(image.line(k), axis_px[k], &mut line) {
            continue;
        }
        phases_rad(k, &mut phases);
        // The template is read at the mean phase; each strand's own reference enters as a known offset.
        let mean = mean_phase(rope, &phases);
        let bin = phase_bin(rope, mean - angle_rad);
        wires_rad(k, &mut wires);
        let steps = (mean - angle_rad) / step;
        let in_bin =
            ((steps - rounded(steps) + 0.5) - (bin.row as f64 + 0.5) / super::template::PHASE_BINS as f64) * step;
        let sums = &mut sums[k / knots.lines];
        let (expected, per_rad) = (template.mean(bin.row), template.per_rad(bin.row));
        for span in template.spans(bin.row) {
            if span.phase_in_view_rad.abs() > FARTHEST_RAD {
                continue;
            }
            let j = (bin.nearest + span.strand) % n;
            let own = (phases[j] - j as f64 * step - mean + in_bin) as f32;
            let (from, to) = template.columns(span);
            there[from..to].copy_from_slice(&line[from..to]);
            if let (Some(pattern), false) = (pattern, wires[j].is_nan()) {
                pattern.subtract(rope.wires(), bin.row, wires[j] - angle_rad, &mut line, &mut per_wire_rad, from..to);
            } else {
                per_wire_rad[from..to].fill(0.0);
            }
            let (r, g, p) = (&mut line[from..to], &per_rad[from..to], &per_wire_rad[from..to]);
            let there = &mut there[from..to];
            wide(
                #[inline(always)]
                || {
                    for ((gray, there), (mean, g)) in
                        r.iter_mut().zip(&mut *there).zip(expected[from..to].iter().zip(g))
                    {
                        let off = *gray - mean - own * g;
                        *there -= off;
                        *gray = off.clamp(-CUT, CUT);
                    }
                    if knots.thinned == 1 {
                        add_sideways(there, r, &mut sums.sideways);
                    }
                    sums.phase_phase[j] += f64::from(dot(g, g));
                    sums.phase_difference[j] += f64::from(dot(g, r));
                    sums.squares += f64::from(dot(r, r));
                    sums.wire_wire[j] += f64::from(dot(p, p));
                    sums.phase_wire[j] += f64::from(dot(p, g));
                    sums.wire_difference[j] += f64::from(dot(p, r));
                },
            );
            sums.pixels += (to - from) as f64;
        }
    }
    sums
}

/// Columns over which changes of gray are compared: dirt and light change slowly across the rope, valleys and wires do not.
const STEP_PX: usize = 2;
/// Differences beyond this, as a share of the line's mean gray, do not tell how far.
const STEP_CUT: f32 = 0.08;

/// Adds what a strand in a line says of how far the picture stands sideways; `there` is what is expected of its gray values, `off` what
/// they have beside. Robust as Huber has it.
#[inline(always)]
fn add_sideways(there: &[f32], off: &[f32], sums: &mut (f64, f64)) {
    let steps = off.len().saturating_sub(STEP_PX + 2);
    let (mut squares, mut products) = ([0.0f32; LANES], [0.0f32; LANES]);
    for from in (0..steps).step_by(LANES) {
        let lanes = LANES.min(steps - from);
        let (there, off) = (&there[from..from + lanes + STEP_PX + 2], &off[from + 1..from + 1 + lanes + STEP_PX]);
        // Gray changes per column by half of what lies two columns apart; over a step that is asked at both its ends.
        let change = |c: usize| 0.5 * (there[c] - there[c + 2]);
        for (lane, (square, product)) in squares.iter_mut().zip(&mut products).take(lanes).enumerate() {
            let (slope, off) = (change(lane + STEP_PX) - change(lane), off[lane + STEP_PX] - off[lane]);
            *square += if off.abs() < STEP_CUT { slope * slope } else { 0.0 };
            *product += slope * off.clamp(-STEP_CUT, STEP_CUT);
        }
    }
    sums.0 += f64::from(squares.iter().sum::<f32>());
    sums.1 += f64::from(products.iter().sum::<f32>());
}

/// Sums that run side by side, so that the processor adds them in one go.
const LANES: usize = 8;

#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let ((wide_a, rest_a), (wide_b, rest_b)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    let mut lanes = [0.0f32; LANES];
    for (a, b) in wide_a.iter().zip(wide_b) {
        lanes.iter_mut().zip(a.iter().zip(b)).for_each(|(sum, (a, b))| *sum += a * b);
    }
    lanes.iter().sum::<f32>() + rest_a.iter().zip(rest_b).map(|(a, b)| a * b).sum::<f32>()
}

/// Contours that are off by more than this, in px, are wire ends or dirt, and are cut.
pub(super) const CONTOUR_CUT_PX: f64 = 3.0;
/// Phases in view of the strands that make the upper and the lower outline.
pub(super) const SIDES_RAD: [f64; 2] = [FRAC_PI_2, -FRAC_PI_2];

/// The strand that stands nearest to a side, going by the regular places that the first one gives the others.
pub(super) fn strand_at_side(phases_rad: &[f64], angle_rad: f64, side_rad: f64) -> usize {
    let n = phases_rad.len();
    let steps = (angle_rad + side_rad - phases_rad[0]) / (TAU / n as f64);
    (rounded(steps) as i64).rem_euclid(n as i64) as usize
}

/// Adds what the contours know: each shows the strand that stands at its side. `sums` and phases as in [`register`].
#[expect(clippy::too_many_arguments, reason = "as in `register`")]
pub fn register_contours(
    rope: &Rope,
    model: &ModelContour,
    angle_rad: f64,
    contours: &Contours,
    axis_px: &[f32],
    knots: Knots,
    phases_rad: impl Fn(usize, &mut [f64]),
    sums: &mut [KnotSums],
) {
    let n = rope.strands();
    let mut phases = vec![0.0f64; n];
    let mut before = [0.0; 2];
    for k in (0..contours.len()).step_by(knots.thinned) {
        phases_rad(k, &mut phases);
        let knot = &mut sums[k / knots.lines];
        let columns = [contours.upper_px[k], contours.lower_px[k]];
        for (side, column) in columns.into_iter().enumerate() {
            if !column.is_finite() {
                before[side] = 0.0;
                continue;
            }
            let j = strand_at_side(&phases, angle_rad, SIDES_RAD[side]);
            let phase = phases[j] - angle_rad;
            let (edge, slope) = model.edge_and_slope(side, phase);
            let difference = f64::from(column - axis_px[k]) - edge;
            let cut = difference.clamp(-CONTOUR_CUT_PX, CONTOUR_CUT_PX);
            knot.contour_phase_phase[j] += slope * slope;
            knot.contour_phase_difference[j] += slope * cut;
            knot.contour_squares.0 += cut * cut;
            knot.contour_squares.1 += 1.0;
            knot.contour_squares.2 += cut * before[side];
            before[side] = cut;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_tells_how_far_it_stands_sideways_also_under_dirt_and_uneven_light() {
        let gray = |column: f32| 1.0 + 0.3 * (column * 0.4).sin();
        let there: Vec<f32> = (0..80).map(|c| gray(c as f32)).collect();
        for sideways_px in [-0.4f32, 0.0, 0.3] {
            let off: Vec<f32> = (0..80)
                .map(|c| {
                    let (light, dirt) = (0.004 * c as f32, if (30..36).contains(&c) { -0.5 } else { 0.0 });
                    gray(c as f32 - sideways_px) - there[c] + light + dirt
                })
                .collect();
            let mut sums = KnotSums::default();
            add_sideways(&there, &off, &mut sums.sideways);
            // Both rims of the dirt count, but no more than the cut lets them: without it they are half a pixel.
            let found = sums.sideways_px() as f32;
            assert!((found - sideways_px).abs() < 0.15, "{found} instead of {sideways_px}");
        }
        assert!(KnotSums::default().sideways_px().is_nan());
    }
}
