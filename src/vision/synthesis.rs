//! Draws the rope model as a line camera would see it: the synthesis of analysis-by-synthesis. [Wacker13, sec. 3.2, eq. 1, 4-5]
//!
//! Every wire is its projected centre line with a Gaussian across it, cut off at the projected width of the wire; where wires
//! overlap, the nearest to the camera is seen. The paper draws centre lines only, so a farther strand shines through the gaps of
//! a nearer one; here a strand is a body that hides what is behind its outline, as it does in the image.

use super::camera::Camera;
use super::image::GrayImage;
use super::rope::Rope;
use super::strand::{StrandHelix, on_circle};
use super::surface::{StrandSpan, visible_spans};
use super::wire::WireHelix;
use std::ops::Range;

/// Standard deviation of the Gaussian in wire radii: the mask, as wide as the wire, ends at two deviations. The paper states
/// the mask's width only; the optimum of eq. 14 does not depend on it as long as wires stay apart (0.4 to 0.8).
pub const SD_WIRE_RADII: f64 = 0.5;

/// Draws camera lines of one rope in one view.
#[derive(Debug)]
pub struct Synthesis<'a> {
    rope: &'a Rope,
    camera: &'a Camera,
    spans: Vec<StrandSpan>,
    depths_mm: Vec<f32>,
}

impl<'a> Synthesis<'a> {
    /// Draws this rope in this view.
    pub fn new(rope: &'a Rope, camera: &'a Camera) -> Self {
        Self { rope, camera, spans: Vec::new(), depths_mm: Vec::new() }
    }

    /// Draws one line into `out`: brightness of every column in [0, 1], 1 on a wire's centre line, 0 where no wire is.
    ///
    /// Per strand j: `strand_phases_rad[j]` (eq. 2) and the phase `wire_phases_rad[j]` of its wire 0 (eq. 3), rope axes.
    /// `axis_px` is the column of the rope axis.
    pub fn line(&mut self, strand_phases_rad: &[f64], wire_phases_rad: &[f64], axis_px: f64, out: &mut [f32]) {
        out.fill(0.0);
        visible_spans(self.rope, self.camera, strand_phases_rad, &mut self.spans);
        for span in &self.spans {
            let columns = columns(span, axis_px, out.len());
            let wires = StrandWires::new(self.rope, self.camera, span, wire_phases_rad[span.strand]);
            wires.draw(axis_px, columns.start, &mut out[columns], &mut self.depths_mm);
        }
    }
}

/// The columns of an image of `width_px` columns in which a strand is seen.
pub fn columns(span: &StrandSpan, axis_px: f64, width_px: usize) -> Range<usize> {
    let from = ((axis_px + span.from_px).ceil().max(0.0) as usize).min(width_px);
    let to = ((axis_px + span.to_px).floor() + 1.0).max(0.0) as usize;
    from..to.clamp(from, width_px)
}

/// The wires of one strand where a camera line cuts them.
#[derive(Debug, Clone, Copy)]
pub struct StrandWires<'a> {
    rope: &'a Rope,
    camera: &'a Camera,
    centre_mm: (f64, f64),
    wire_phase_in_view_rad: f64,
}

impl<'a> StrandWires<'a> {
    /// The wires of the strand of `span`, wire 0 having the phase `wire_phase_rad` in rope axes.
    pub fn new(rope: &'a Rope, camera: &'a Camera, span: &StrandSpan, wire_phase_rad: f64) -> Self {
        Self {
            rope,
            camera,
            centre_mm: on_circle(rope.strand_curve_radius_mm(), span.phase_in_view_rad),
            wire_phase_in_view_rad: camera.phase_in_view(wire_phase_rad),
        }
    }

    /// Draws the wires into `out`, whose first entry is the column `first_column`. `depths_mm` is scratch space.
    pub fn draw(&self, axis_px: f64, first_column: usize, out: &mut [f32], depths_mm: &mut Vec<f32>) {
        out.fill(0.0);
        depths_mm.clear();
        depths_mm.resize(out.len(), f32::INFINITY);
        for i in 0..self.rope.wires() {
            let phase_rad = self.wire_phase_in_view_rad + i as f64 * self.rope.wire_step_rad();
            let (y, z) = on_circle(self.rope.wire_curve_radius_mm(), phase_rad);
            let (y_mm, z_mm) = (self.centre_mm.0 + y, self.centre_mm.1 + z); // eq. 1
            let middle = axis_px + self.camera.column_px(y_mm, z_mm) - first_column as f64; // eq. 5
            let scale = self.camera.px_per_mm / (1.0 + z_mm / self.camera.distance_mm);
            let radius_px = self.rope.wire_radius_mm() * scale;
            let from = ((middle - radius_px).ceil().max(0.0) as usize).min(out.len());
            let to = (((middle + radius_px).floor() + 1.0).max(0.0) as usize).clamp(from, out.len());
            let per_sd = (1.0 / (SD_WIRE_RADII * radius_px)) as f32;
            let (middle, depth) = (middle as f32, z_mm as f32);
            for (column, (value, nearest)) in (from..to).zip(out[from..to].iter_mut().zip(&mut depths_mm[from..to])) {
                if depth < *nearest {
                    let u = (column as f32 - middle) * per_sd;
                    (*value, *nearest) = ((-0.5 * u * u).exp(), depth);
                }
            }
        }
    }
}

/// Where the lines and columns of a synthetic image lie.
#[derive(Debug, Clone, PartialEq)]
pub struct Raster {
    /// Numbers of the lines; line 0 is at x = 0.
    pub lines: Range<usize>,
    /// Rope per line in mm.
    pub pitch_mm: f64,
    /// Columns.
    pub width_px: usize,
}

/// Brightness of every pixel, row after row, of a rope of perfect helices; `wires[j]` are those of strand j and `axis_px(line)`
/// is the column of the rope axis.
pub fn synthesise(
    rope: &Rope,
    camera: &Camera,
    strand: StrandHelix,
    wires: &[WireHelix],
    raster: &Raster,
    axis_px: impl Fn(usize) -> f64,
) -> Vec<f32> {
    let mut brightness = vec![0.0; raster.lines.len() * raster.width_px];
    let mut synthesis = Synthesis::new(rope, camera);
    let (mut strand_phases, mut wire_phases) = (vec![0.0; rope.strands()], vec![0.0; rope.strands()]);
    for (line, row) in raster.lines.clone().zip(brightness.chunks_exact_mut(raster.width_px)) {
        let x_mm = line as f64 * raster.pitch_mm;
        for (j, (strand_phase, wire_phase)) in strand_phases.iter_mut().zip(&mut wire_phases).enumerate() {
            *strand_phase = strand.phase_rad(rope, j, x_mm);
            *wire_phase = wires[j].phase_rad(rope, 0, x_mm);
        }
        synthesis.line(&strand_phases, &wire_phases, axis_px(line), row);
    }
    brightness
}

/// Turns brightness into gray values: `dark + contrast * brightness` plus what `noise` gives for every pixel, in gray levels.
/// `None` if the pixels are no whole number of lines.
pub fn gray_image(
    brightness: &[f32],
    width_px: usize,
    dark: f32,
    contrast: f32,
    mut noise: impl FnMut() -> f32,
) -> Option<GrayImage> {
    let gray = |&b: &f32| (dark + contrast * b + noise() + 0.5).clamp(0.0, 255.0) as u8;
    GrayImage::new(width_px, brightness.iter().map(gray).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::rope::RopeDesign;
    use crate::vision::wire::wire_centre;

    fn rope() -> Rope {
        RopeDesign {
            strands: 6,
            wires_per_strand: 9,
            diameter_mm: 32.0,
            strand_lay_mm: None,
            wire_lay_mm: None,
            strand_diameter_mm: None,
            wire_diameter_mm: None,
        }
        .validate()
        .unwrap()
    }

    const STRAND: StrandHelix = StrandHelix { lay_length_mm: 220.0, offset_rad: 0.4 };
    const WIRE: WireHelix = WireHelix { lay_length_mm: -95.0, offset_rad: 0.1 };
    const CAMERA: Camera = Camera { angle_rad: 0.3, distance_mm: 224.0, px_per_mm: 12.0 };

    #[test]
    fn the_wire_that_faces_the_camera_is_bright_on_its_centre_line_and_dark_at_its_rim() {
        let rope = rope();
        let raster = Raster { lines: 0..600, pitch_mm: 0.5, width_px: 480 };
        let axis_px = |line: usize| 239.5 + 3.0 * (line as f64 / 90.0).sin();
        let pixels = synthesise(&rope, &CAMERA, STRAND, &[WIRE; 6], &raster, axis_px);
        let mut checked = 0;
        for line in 0..600 {
            for (j, i) in (0..6).flat_map(|j| (0..9).map(move |i| (j, i))) {
                let x_mm = line as f64 * raster.pitch_mm;
                let facing = |phase_rad: f64| (phase_rad - CAMERA.angle_rad).cos() > 0.995; // within 6 degrees
                if !facing(STRAND.phase_rad(&rope, j, x_mm)) || !facing(WIRE.phase_rad(&rope, i, x_mm)) {
                    continue;
                }
                let (_, y, z) = wire_centre(&rope, STRAND, WIRE, j, i, x_mm);
                let (sin, cos) = CAMERA.angle_rad.sin_cos();
                let (y, z) = (y * cos + z * sin, z * cos - y * sin); // into the view's axes
                let centre = axis_px(line) + CAMERA.column_px(y, z);
                let radius = rope.wire_radius_mm() * CAMERA.px_per_mm / (1.0 + z / CAMERA.distance_mm);
                let at = |column: f64| pixels[line * 480 + column.round() as usize];
                assert!(at(centre) > 0.99); // at most half a pixel from the centre, 1/30 of a deviation squared
                // exp(-2) = 0.14 at the rim, where its neighbours reach 0.88 radii under it, half a pixel off.
                assert!(at(centre + radius) < 0.3 && at(centre - radius) < 0.3);
                checked += 1;
            }
        }
        assert!(checked > 10, "{checked}");
    }

    #[test]
    fn there_is_nothing_outside_the_outline_and_little_unlit_inside() {
        let rope = rope();
        let raster = Raster { lines: 0..400, pitch_mm: 0.5, width_px: 480 };
        let pixels = synthesise(&rope, &CAMERA, STRAND, &[WIRE; 6], &raster, |_| 239.5);
        let half_px = 16.0 * 12.0 * 1.01; // perspective widens the outline a little
        let mut dark = 0;
        for row in pixels.chunks_exact(480) {
            for (column, &value) in row.iter().enumerate() {
                let off = (column as f64 - 239.5).abs();
                assert!(off < half_px || value == 0.0);
                dark += usize::from(off < 0.6 * half_px && value == 0.0);
            }
        }
        let inside = 400.0 * 1.2 * half_px;
        assert!((dark as f64) < 0.08 * inside, "{dark} of {inside}"); // corners between wires, valleys between strands
    }

    #[test]
    fn a_nearer_strand_hides_the_farther_one() {
        let rope = rope();
        let mut synthesis = Synthesis::new(&rope, &CAMERA);
        let strands: Vec<f64> =
            (0..6).map(|j| CAMERA.angle_rad + 0.1 + f64::from(j) * rope.strand_step_rad()).collect();
        let (mut one, mut other) = (vec![0.0; 480], vec![0.0; 480]);
        // Strand 0 faces the camera. Turning the wires of its neighbours must not change a pixel inside its outline.
        synthesis.line(&strands, &[0.0; 6], 239.5, &mut one);
        synthesis.line(&strands, &[0.0, 0.3, 0.3, 0.3, 0.3, 0.3], 239.5, &mut other);
        let mut spans = Vec::new();
        visible_spans(&rope, &CAMERA, &strands, &mut spans);
        let nearest = spans.iter().find(|s| s.strand == 0).unwrap();
        let inside = columns(nearest, 239.5, 480);
        assert_eq!(one[inside.clone()], other[inside]);
        assert_ne!(one, other);
    }
}
