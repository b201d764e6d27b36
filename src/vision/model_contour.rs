//! The outline of the model rope, as functions of its phase. [Wacker13, sec. 3.3.1 (1), eq. 6-8]

use super::camera::Camera;
use super::rope::Rope;
use super::strand::on_circle;
use super::surface::fraction;

/// Bins of one strand step in the tables; the outline is smooth, so linear interpolation between them is exact to 1e-4 px.
const BINS: usize = 512;

/// Upper and lower outline of a rope in one view, tabulated over one strand step: the outline repeats when the next strand
/// takes the place of the last.
#[derive(Debug, Clone)]
pub struct ModelContour {
    step_rad: f64,
    /// Lower and upper edge.
    edges_px: Vec<(f64, f64)>,
}

impl ModelContour {
    /// Tabulates eq. 7-8: extremes over the outlines (eq. 6) of all strands.
    pub fn new(rope: &Rope, camera: &Camera) -> Self {
        let step_rad = rope.strand_step_rad();
        let outline = |bin: usize| {
            let phase_rad = step_rad * bin as f64 / BINS as f64;
            (0..rope.strands())
                .map(|j| {
                    let (y, z) = on_circle(rope.strand_curve_radius_mm(), phase_rad + j as f64 * step_rad);
                    camera.outline_px(y, z, rope.strand_radius_mm())
                })
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (from, to)| (low.min(from), high.max(to)))
        };
        Self { step_rad, edges_px: (0..=BINS).map(outline).collect() }
    }

    /// Entries before and after a phase, and what share of the way between them it is.
    #[inline]
    fn about(&self, phase_in_view_rad: f64) -> ((f64, f64), (f64, f64), f64) {
        let at = fraction(phase_in_view_rad / self.step_rad) * BINS as f64;
        let bin = (at as usize).min(BINS - 1);
        (self.edges_px[bin], self.edges_px[bin + 1], at - bin as f64)
    }

    /// Columns of the lower and the upper outline (mc^l, mc^u), counted from the rope axis, for the phase of any strand in this view.
    #[inline]
    pub fn edges_px(&self, phase_in_view_rad: f64) -> (f64, f64) {
        let ((lower, upper), (next_lower, next_upper), share) = self.about(phase_in_view_rad);
        (lower + (next_lower - lower) * share, upper + (next_upper - upper) * share)
    }

    /// One of them, by the number of its side: 0 is the upper, 1 the lower.
    pub fn edge_px(&self, side: usize, phase_in_view_rad: f64) -> f64 {
        self.edge_and_slope(side, phase_in_view_rad).0
    }

    /// One of them, and how it moves with the phase, in px per rad.
    pub fn edge_and_slope(&self, side: usize, phase_in_view_rad: f64) -> (f64, f64) {
        let (here, next, share) = self.about(phase_in_view_rad);
        let (here, next) = if side == 0 { (here.1, next.1) } else { (here.0, next.0) };
        (here + (next - here) * share, (next - here) * (BINS as f64 / self.step_rad))
    }

    /// Width of the outline.
    pub fn width_px(&self, phase_in_view_rad: f64) -> f64 {
        let (lower, upper) = self.edges_px(phase_in_view_rad);
        upper - lower
    }

    /// Mean width over all phases in px.
    pub fn mean_width_px(&self) -> f64 {
        self.edges_px[..BINS].iter().map(|(lower, upper)| upper - lower).sum::<f64>() / BINS as f64
    }

    /// Phase between neighbouring strands in rad: the period of the outline.
    pub fn step_rad(&self) -> f64 {
        self.step_rad
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::rope::RopeDesign;
    use std::f64::consts::FRAC_PI_2;

    #[test]
    fn the_outline_is_widest_where_two_strands_stand_at_the_sides() {
        let rope = RopeDesign {
            strands: 6,
            wires_per_strand: 9,
            diameter_mm: 32.0,
            strand_lay_mm: None,
            wire_lay_mm: None,
            strand_diameter_mm: None,
            wire_diameter_mm: None,
        }
        .validate()
        .unwrap();
        let contour = ModelContour::new(&rope, &Camera { angle_rad: 0.0, distance_mm: 1e7, px_per_mm: 10.0 });
        assert!((contour.width_px(FRAC_PI_2) - 320.0).abs() < 0.01); // the full diameter
        let notch = contour.width_px(FRAC_PI_2 + rope.strand_step_rad() / 2.0);
        let expected =
            20.0 * (rope.strand_curve_radius_mm() * (rope.strand_step_rad() / 2.0).cos() + rope.strand_radius_mm());
        assert!((notch - expected).abs() < 0.05);
        let (lower, upper) = contour.edges_px(0.4);
        assert!((upper + lower).abs() < 1e-3); // even strands: symmetric
    }
}
