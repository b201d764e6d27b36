//! Which strand a column shows, and where on that strand's surface. [Wacker13, sec. 4.2, eq. 16-17]

use super::camera::Camera;
use super::rope::Rope;
use super::strand::on_circle;

/// Outlines narrower than this are not worth their registration error, in px.
const NARROWEST_PX: f64 = 3.0;

/// The part of one strand that a camera line shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StrandSpan {
    /// The strand.
    pub strand: usize,
    /// Its phase in this view in rad, in (-pi, pi]: 0 is nearest to the camera.
    pub phase_in_view_rad: f64,
    /// First visible column, counted from the rope axis.
    pub from_px: f64,
    /// End of the visible columns.
    pub to_px: f64,
    /// Middle of the strand's whole outline.
    pub middle_px: f64,
    /// Half the width of its whole outline.
    pub half_px: f64,
    /// Angle between the line of sight through the strand's middle and the view axis, in rad.
    pub sight_rad: f64,
}

impl StrandSpan {
    /// Angle on the strand's surface that `column_px` shows, in rad against this view's axes: 0 faces along -z, towards the camera.
    ///
    /// A line of sight that makes the angle b with the view axis meets the circle of radius r about the strand's centre at the
    /// angle asin(e/r) - b, e being its distance from the centre; within one strand e is linear in the column to 1e-3.
    pub fn surface_rad(&self, column_px: f64) -> f64 {
        ((column_px - self.middle_px) / self.half_px).clamp(-1.0, 1.0).asin() - self.sight_rad
    }

    /// Column that shows the surface angle `surface_rad` at the relative radius `share` (1 = the strand's outside).
    pub fn column_px(&self, surface_rad: f64, share: f64) -> f64 {
        self.middle_px + self.half_px * share * (surface_rad + self.sight_rad).sin()
    }
}

/// An angle in (-pi, pi].
pub fn wrap_rad(angle_rad: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    let wrapped = (angle_rad + PI).rem_euclid(TAU) - PI;
    if wrapped == -PI { PI } else { wrapped }
}

/// The visible spans of all strands, from small to large columns; `phases_rad[j]` in rope axes.
pub fn visible_spans(rope: &Rope, camera: &Camera, phases_rad: &[f64], spans: &mut Vec<StrandSpan>) {
    spans.clear();
    let mut order: [(f64, usize); 8] = [(0.0, 0); 8];
    let n = phases_rad.len().min(order.len());
    for (j, &phase_rad) in phases_rad.iter().take(n).enumerate() {
        order[j] = (wrap_rad(camera.phase_in_view(phase_rad)), j);
    }
    order[..n].sort_by(|a, b| a.0.abs().total_cmp(&b.0.abs())); // nearest first
    // Nearer strands hide: what is covered so far is always one interval, as neighbours overlap or touch.
    let mut covered: Option<(f64, f64)> = None;
    for &(phase_in_view_rad, strand) in &order[..n] {
        let (y, z) = on_circle(rope.strand_curve_radius_mm(), phase_in_view_rad);
        let (outline_from, outline_to) = camera.outline_px(y, z, rope.strand_radius_mm());
        let (from_px, to_px) = match covered {
            None => (outline_from, outline_to),
            Some((low, high)) if phase_in_view_rad > 0.0 => (outline_from.max(high), outline_to.max(low)),
            Some((low, _)) => (outline_from, outline_to.min(low)),
        };
        if to_px - from_px >= NARROWEST_PX {
            spans.push(StrandSpan {
                strand,
                phase_in_view_rad,
                from_px,
                to_px,
                middle_px: (outline_from + outline_to) / 2.0,
                half_px: (outline_to - outline_from) / 2.0,
                sight_rad: (y / (camera.distance_mm + z)).atan(),
            });
        }
        covered = Some(
            covered.map_or((outline_from, outline_to), |(low, high)| (low.min(outline_from), high.max(outline_to))),
        );
    }
    spans.sort_by(|a, b| a.from_px.total_cmp(&b.from_px));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::rope::RopeDesign;

    #[test]
    fn spans_tile_the_rope_and_the_nearest_strand_is_whole() {
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
        let camera = Camera { angle_rad: 0.0, distance_mm: 400.0, px_per_mm: 12.0 };
        let mut spans = Vec::new();
        for turn in 0..60 {
            let phases: Vec<f64> =
                (0..6).map(|j| j as f64 * rope.strand_step_rad() + f64::from(turn).to_radians()).collect();
            visible_spans(&rope, &camera, &phases, &mut spans);
            for pair in spans.windows(2) {
                let gap = pair[1].from_px - pair[0].to_px;
                assert!(gap > -1e-9 && gap < 3.5, "gap {gap} at {turn}");
            }
            let width = spans.last().unwrap().to_px - spans[0].from_px;
            assert!(width > 350.0 && width < 390.0, "{width}");
        }
    }

    #[test]
    fn surface_angle_and_column_are_inverse() {
        let span = StrandSpan {
            strand: 0,
            phase_in_view_rad: 0.3,
            from_px: 0.0,
            to_px: 100.0,
            middle_px: 50.0,
            half_px: 50.0,
            sight_rad: 0.01,
        };
        for column in [5.0, 37.0, 93.0] {
            assert!((span.column_px(span.surface_rad(column), 1.0) - column).abs() < 1e-9);
        }
    }
}
