//! Which surface point of the rope every pixel shows: theta = (strand phase, wire phase, distance). [Wacker13, eq. 16-17]
//!
//! The paper measures the distance d' of a pixel to the projected centre line of its wire in the image. Here it is measured on
//! the strand's surface, as a share of the wire step; both are functions of each other. With it, a pixel also has its place on
//! the unrolled strand: `wire_place` = (psi - wire phase)/step, constant along the course of a wire.

use super::camera::Camera;
use super::estimates::Estimates;
use super::histogram::{DISTANCE_BINS, STRAND_BINS, WIRE_BINS, cell};
use super::rope::Rope;
use super::surface::{StrandSpan, visible_spans};

/// Strand phases in view that are parametrised, to either side, in rad.
pub const STRAND_RANGE_RAD: f64 = 1.9;
/// Wire phases in view that are parametrised, to either side, in rad.
pub const WIRE_RANGE_RAD: f64 = 1.8;
/// Pixels next to the border between two strands are left out: registration errors mix both there.
const BORDER_PX: f64 = 1.0;
/// Surface beyond this share of the strand's half width is too foreshortened.
const EDGE: f64 = 0.99;
/// Entries of the arcsine table.
const TABLE: usize = 2048;

/// A pixel's place on the rope.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Column in the image.
    pub column: usize,
    /// The strand.
    pub strand: usize,
    /// Cell of theta in the histogram.
    pub cell: usize,
    /// Place among the wires of the strand, in [0, M): whole numbers are wire centres, constant along a wire.
    pub wire_place: f32,
}

/// Maps the lines of a stretch, as one view sees it, to the surface of the rope.
pub struct SurfaceMap<'a> {
    rope: &'a Rope,
    camera: &'a Camera,
    estimates: &'a Estimates,
    width_px: usize,
    arcsine: Vec<f32>,
    phases: Vec<f64>,
    wires: Vec<f64>,
    spans: Vec<StrandSpan>,
}

impl<'a> SurfaceMap<'a> {
    /// A map for images of `width_px` columns.
    pub fn new(rope: &'a Rope, camera: &'a Camera, estimates: &'a Estimates, width_px: usize) -> Self {
        let arcsine = (0..TABLE).map(|k| (2.0 * (k as f64 + 0.5) / TABLE as f64 - 1.0).asin() as f32).collect();
        let n = rope.strands();
        Self {
            rope,
            camera,
            estimates,
            width_px,
            arcsine,
            phases: vec![0.0; n],
            wires: vec![0.0; n],
            spans: Vec::new(),
        }
    }

    /// Interpolates the courses at a line of the stretch.
    fn courses_at(&mut self, line: usize) {
        let n = self.rope.strands();
        let knot_lines = self.estimates.knot_lines;
        let knots = self.estimates.strand_phases_rad.len() / n;
        let at = (line as f64 - (knot_lines as f64 - 1.0) / 2.0) / knot_lines as f64;
        let a = (at.floor().max(0.0) as usize).min(knots.saturating_sub(2));
        let b = (a + 1).min(knots - 1);
        // Beyond the outer knots the courses go on straight.
        let share = at - a as f64;
        for j in 0..n {
            let mix = |values: &[f64]| values[a * n + j] + share * (values[b * n + j] - values[a * n + j]);
            self.phases[j] = mix(&self.estimates.strand_phases_rad);
            self.wires[j] = mix(&self.estimates.wire_phases_rad);
        }
    }

    /// Calls `each` for every pixel of a line whose surface point is known. `axis_px` is the column of the rope axis.
    pub fn for_each(&mut self, line: usize, axis_px: f32, mut each: impl FnMut(SurfacePoint)) {
        self.courses_at(line);
        visible_spans(self.rope, self.camera, &self.phases, &mut self.spans);
        let step = self.rope.wire_step_rad() as f32;
        let wires = self.rope.wires() as f32;
        for span in &self.spans {
            let wire_phase = self.wires[span.strand];
            if wire_phase.is_nan() || span.phase_in_view_rad.abs() >= STRAND_RANGE_RAD {
                continue;
            }
            let low = (span.from_px + BORDER_PX).max(span.middle_px - EDGE * span.half_px) + f64::from(axis_px);
            let high = (span.to_px - BORDER_PX).min(span.middle_px + EDGE * span.half_px) + f64::from(axis_px);
            let from = (low.ceil().max(0.0) as usize).min(self.width_px);
            let to = (high.floor().max(0.0) as usize).clamp(from, self.width_px);
            let strand_share = (span.phase_in_view_rad / STRAND_RANGE_RAD + 1.0) / 2.0;
            let strand_bin = ((strand_share * STRAND_BINS as f64) as usize).min(STRAND_BINS - 1);
            let scale = (TABLE as f64 / (2.0 * span.half_px)) as f32;
            let offset = TABLE as f32 / 2.0 - (f64::from(axis_px) + span.middle_px) as f32 * scale;
            let sight = span.sight_rad as f32;
            // Wire phase in view, reduced so that f32 keeps its digits.
            let in_view = (wire_phase - self.camera.angle_rad).rem_euclid(std::f64::consts::TAU) as f32;
            let wire_scale = WIRE_BINS as f32 / (2.0 * WIRE_RANGE_RAD as f32);
            for column in from..to {
                let entry = ((column as f32 * scale + offset) as usize).min(TABLE - 1);
                let psi = self.arcsine[entry] - sight;
                let place = (psi - in_view) / step;
                let wire = (place + 1024.5) as i32 - 1024; // nearest wire, without a call to floor
                let distance = place - wire as f32; // in [-0.5, 0.5)
                let centre = psi - distance * step;
                let wire_bin =
                    ((centre + WIRE_RANGE_RAD as f32) * wire_scale).clamp(0.0, WIRE_BINS as f32 - 1.0) as usize;
                let distance_bin = (((distance + 0.5) * DISTANCE_BINS as f32) as usize).min(DISTANCE_BINS - 1);
                let wire_place = if place < 0.0 { place + wires } else { place };
                each(SurfacePoint {
                    column,
                    strand: span.strand,
                    cell: cell(strand_bin, wire_bin, distance_bin),
                    wire_place: if wire_place < 0.0 { wire_place + wires } else { wire_place },
                });
            }
        }
    }
}
