//! From the width that a view sees to millimetres, where somebody measured the scale of its camera.

use super::diameter::WithSd;
use super::rope::Rope;
use super::stretch::{ViewModel, ViewStretch};
use super::width::STRIDE;
use std::f64::consts::PI;

/// How far the distance of both edges may be off what a calibration says, in px: blur, pixels, medians.
pub(super) const EDGES_PX: f64 = 0.35;
/// Where light comes from the camera, a wire before a darker background reaches half of its brightness this far inside its limb, in wire
/// radii: 0.4 of the full light where it soon has 0.8, and light falls off with the root of twice the depth. Light from the side
/// shows the limb itself.
const LIMB: f64 = 0.08;
/// Columns beside an edge that are compared, and every how many lines.
const BESIDE_PX: std::ops::Range<i64> = 3..7;
const LOOKED_AT: usize = 64;

/// A diameter relative to the nominal one as one of this scale, and what the edges may be off by in mm. It is that of the widest places,
/// wire to wire: between them the outline is lower by what round wires leave, `r_w (1 - cos)` over half a wire's step on either side.
pub(super) fn calibrated(
    rope: &Rope,
    model: &ViewModel,
    view: &ViewStretch,
    px_per_mm: f64,
    seen: WithSd,
) -> (WithSd, f64) {
    let fitted_px = model.contour.mean_width_px();
    let half_step = PI / rope.wires() as f64;
    let hollow_mm = 2.0 * rope.wire_curve_radius_mm() * (1.0 - half_step.sin() / half_step);
    let nominal_px = fitted_px * px_per_mm / model.camera.px_per_mm - hollow_mm * px_per_mm;
    // Lamps beside the camera shine from between the two, rather than from either (a triangular distribution over the limb).
    let limbs_px = lighter_edges(view) * LIMB * rope.wire_radius_mm() * px_per_mm;
    let wide_px = seen.value / rope.diameter_mm() * fitted_px + detail_px(view) + limbs_px / 2.0;
    let mm_per_px = rope.diameter_mm() / nominal_px;
    let sd = seen.sd / rope.diameter_mm() * fitted_px * mm_per_px;
    (WithSd { value: wide_px * mm_per_px, sd }, EDGES_PX.hypot(limbs_px / 24f64.sqrt()) * mm_per_px)
}

/// At how many of its edges, 0 to 2, the rope is lighter than what is behind it.
fn lighter_edges(view: &ViewStretch) -> f64 {
    let lighter = |edges: &[f32], inward: i64| {
        let (mut sum, mut lines) = (0.0, 0.0);
        for (line, edge) in edges.iter().enumerate().take(view.image.lines()).step_by(LOOKED_AT) {
            let row = view.image.line(line);
            let gray = |way: i64| {
                let columns = BESIDE_PX.map(|off| f64::from(*edge) as i64 + way * off);
                columns
                    .map(|column| usize::try_from(column).ok().and_then(|c| row.get(c)).map(|&g| f64::from(g)))
                    .sum::<Option<f64>>()
            };
            if let (true, Some(inside), Some(outside)) = (edge.is_finite(), gray(inward), gray(-inward)) {
                sum += (inside - outside).signum();
                lines += 1.0;
            }
        }
        if sum > 0.5 * lines { 1.0 } else { 0.0 }
    };
    lighter(&view.contours.lower_px, 1) + lighter(&view.contours.upper_px, -1)
}

/// Mean width that was taken out of the contours with what wires add to them, in px.
fn detail_px(view: &ViewStretch) -> f64 {
    let (seen, kept) = (&view.contours, &view.outline);
    let lines = (0..seen.len().min(kept.len())).step_by(STRIDE);
    let taken = lines.map(|k| (seen.upper_px[k] - seen.lower_px[k]) - (kept.upper_px[k] - kept.lower_px[k]));
    let (sum, n) = taken.filter(|px| px.is_finite()).fold((0.0, 0.0), |(sum, n), px| (sum + f64::from(px), n + 1.0));
    sum / f64::max(n, 1.0)
}
