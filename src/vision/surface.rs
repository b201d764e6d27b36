//! Which strand a column shows, and where on that strand's surface. [Wacker13, sec. 4.2, eq. 16-17]

use super::camera::Camera;
use super::rope::Rope;
use super::strand::on_circle;
use std::f64::consts::{PI, TAU};

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

/// Adding and taking away this rounds a number to the nearest whole one, without a call.
const ROUNDS: f64 = 1.5 * (1u64 << 52) as f64;

/// The nearest whole number.
pub(super) fn rounded(value: f64) -> f64 {
    (value + ROUNDS) - ROUNDS
}

/// The next whole number above.
pub(super) fn raised(value: f64) -> f64 {
    let near = rounded(value);
    if near < value { near + 1.0 } else { near }
}

/// What is beyond the next whole number below, in [0, 1].
pub(super) fn fraction(value: f64) -> f64 {
    let off = value - rounded(value);
    if off < 0.0 { off + 1.0 } else { off }
}

/// An angle in (-pi, pi].
pub fn wrap_rad(angle_rad: f64) -> f64 {
    let turns = rounded(angle_rad * (1.0 / TAU));
    let wrapped = angle_rad - turns * TAU;
    if wrapped <= -PI { wrapped + TAU } else { wrapped.min(PI) }
}

/// Outline of a strand in a view: where it begins and ends, and the angle at which it is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Outline {
    from_px: f64,
    to_px: f64,
    sight_rad: f64,
}

impl Outline {
    fn new(rope: &Rope, camera: &Camera, phase_in_view_rad: f64) -> Self {
        let (y, z) = on_circle(rope.strand_curve_radius_mm(), phase_in_view_rad);
        let (from_px, to_px) = camera.outline_px(y, z, rope.strand_radius_mm());
        Self { from_px, to_px, sight_rad: (y / (camera.distance_mm + z)).atan() }
    }
}

/// The outlines that strands have in one view, by their phase: read from a table, for every line of a recording asks.
#[derive(Debug, Clone)]
pub struct Outlines {
    angle_rad: f64,
    table: Vec<Outline>,
}

/// Entries over a turn: between them outlines are straight to 1e-3 px.
const OUTLINES: usize = 1024;

impl Outlines {
    /// The outlines of a rope's strands as a camera sees them.
    pub fn new(rope: &Rope, camera: &Camera) -> Self {
        let phase = |k: usize| TAU * k as f64 / OUTLINES as f64 - PI;
        let table = (0..=OUTLINES).map(|k| Outline::new(rope, camera, phase(k))).collect();
        Self { angle_rad: camera.angle_rad, table }
    }

    /// Angle of the view in rad.
    pub fn angle_rad(&self) -> f64 {
        self.angle_rad
    }

    /// How the middle of a strand's outline moves with its phase, in px per rad.
    pub fn middle_per_rad(&self, phase_in_view_rad: f64) -> f64 {
        let k = (((phase_in_view_rad + PI) * (OUTLINES as f64 / TAU)) as usize).min(OUTLINES - 1);
        let middle = |k: usize| (self.table[k].from_px + self.table[k].to_px) / 2.0;
        (middle(k + 1) - middle(k)) * (OUTLINES as f64 / TAU)
    }

    /// The visible spans of all strands, from small to large columns; `phases_rad[j]` in rope axes.
    pub fn visible_spans(&self, phases_rad: &[f64], spans: &mut Vec<StrandSpan>) {
        find_visible(self.angle_rad, phases_rad, spans, |phase_in_view_rad| {
            let at = (phase_in_view_rad + PI) * (OUTLINES as f64 / TAU);
            let k = (at as usize).min(OUTLINES - 1);
            let (a, b, share) = (self.table[k], self.table[k + 1], at - k as f64);
            let mix = |a: f64, b: f64| a + share * (b - a);
            Outline {
                from_px: mix(a.from_px, b.from_px),
                to_px: mix(a.to_px, b.to_px),
                sight_rad: mix(a.sight_rad, b.sight_rad),
            }
        });
    }
}

/// The visible spans of all strands, from small to large columns; `phases_rad[j]` in rope axes.
pub fn visible_spans(rope: &Rope, camera: &Camera, phases_rad: &[f64], spans: &mut Vec<StrandSpan>) {
    find_visible(camera.angle_rad, phases_rad, spans, |phase_in_view_rad| {
        Outline::new(rope, camera, phase_in_view_rad)
    });
}

fn find_visible(angle_rad: f64, phases_rad: &[f64], spans: &mut Vec<StrandSpan>, outline: impl Fn(f64) -> Outline) {
    spans.clear();
    let mut order: [(f64, usize); 8] = [(0.0, 0); 8];
    let n = phases_rad.len().min(order.len());
    for (j, &phase_rad) in phases_rad.iter().take(n).enumerate() {
        order[j] = (wrap_rad(phase_rad - angle_rad), j);
    }
    order[..n].sort_by(|a, b| a.0.abs().total_cmp(&b.0.abs())); // nearest first
    // Nearer strands hide: what is covered so far is always one interval, as neighbours overlap or touch.
    let mut covered: Option<(f64, f64)> = None;
    for &(phase_in_view_rad, strand) in &order[..n] {
        let Outline { from_px: outline_from, to_px: outline_to, sight_rad } = outline(phase_in_view_rad);
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
                sight_rad,
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
