//! The pixels of one view that show one strand, compared with a synthesis of its wires. [Wacker13, sec. 3.3.2, eq. 14]

use super::camera::Camera;
use super::image::GrayImage;
use super::rope::Rope;
use super::surface::{StrandSpan, visible_spans};
use super::synthesis::{StrandWires, columns};
use super::wire::WireHelix;

/// One line of a strand.
#[derive(Debug, Clone)]
struct StrandLine {
    x_mm: f64,
    axis_px: f64,
    span: StrandSpan,
    first_column: usize,
    /// Where its gray values lie among all.
    from: usize,
    to: usize,
}

/// Lines of one view.
#[derive(Debug, Clone, Copy)]
pub struct ViewLines<'a> {
    /// The gray values.
    pub image: &'a GrayImage,
    /// Column of the rope axis at every line; NaN where unknown.
    pub axis_px: &'a [f32],
    /// Position of line 0 in mm.
    pub first_mm: f64,
    /// Rope per line in mm.
    pub pitch_mm: f64,
}

/// The pixels of one view that show one strand.
#[derive(Debug, Clone)]
pub struct StrandPixels<'a> {
    pub(super) rope: &'a Rope,
    camera: &'a Camera,
    lines: Vec<StrandLine>,
    grays: Vec<f32>,
}

impl<'a> StrandPixels<'a> {
    /// Gathers the pixels of strand `j`; `phases_rad(line, out)` gives the phases of all strands, rope axes.
    pub fn gather(
        rope: &'a Rope,
        camera: &'a Camera,
        view: ViewLines<'_>,
        j: usize,
        phases_rad: impl Fn(usize, &mut [f64]),
    ) -> Self {
        let mut phases = vec![0.0; rope.strands()];
        let mut spans = Vec::new();
        let (mut lines, mut grays) = (Vec::new(), Vec::new());
        for line in (0..view.image.lines()).filter(|&line| view.axis_px[line].is_finite()) {
            phases_rad(line, &mut phases);
            visible_spans(rope, camera, &phases, &mut spans);
            let Some(span) = spans.iter().find(|s| s.strand == j) else { continue };
            let axis_px = f64::from(view.axis_px[line]);
            let columns = columns(span, axis_px, view.image.width());
            let from = grays.len();
            grays.extend(view.image.line(line)[columns.clone()].iter().map(|&g| f32::from(g)));
            lines.push(StrandLine {
                x_mm: view.first_mm + line as f64 * view.pitch_mm,
                axis_px,
                span: *span,
                first_column: columns.start,
                from,
                to: grays.len(),
            });
        }
        Self { rope, camera, lines, grays }
    }

    /// NCC^2d of eq. 14 over every `stride`-th line. 0 if image or synthesis are without contrast.
    pub fn correlation(&self, wire: WireHelix, stride: usize) -> f64 {
        let (mut drawn, mut depths) = (Vec::new(), Vec::new());
        let mut sums = [0.0f64; 6];
        for line in self.lines.iter().step_by(stride.max(1)) {
            let grays = &self.grays[line.from..line.to];
            drawn.resize(grays.len(), 0.0);
            let phase_rad = wire.phase_rad(self.rope, 0, line.x_mm);
            StrandWires::new(self.rope, self.camera, &line.span, phase_rad).draw(
                line.axis_px,
                line.first_column,
                &mut drawn,
                &mut depths,
            );
            let mut row = [0.0f32; 5];
            for (&g, &m) in grays.iter().zip(&drawn) {
                row[0] += g;
                row[1] += m;
                row[2] += g * g;
                row[3] += m * m;
                row[4] += g * m;
            }
            for (sum, r) in sums.iter_mut().zip(row) {
                *sum += f64::from(r);
            }
            sums[5] += grays.len() as f64;
        }
        let [g, m, gg, mm, gm, n] = sums;
        let variances = (n * gg - g * g) * (n * mm - m * m);
        if variances > 0.0 { (n * gm - g * m) / variances.sqrt() } else { 0.0 }
    }

    /// Length of rope in mm from the first line that shows the strand to the last.
    pub fn length_mm(&self) -> f64 {
        self.extent_mm().map_or(0.0, |(first_mm, last_mm)| last_mm - first_mm)
    }

    /// First and last position at which the strand is seen.
    pub(super) fn extent_mm(&self) -> Option<(f64, f64)> {
        Some((self.lines.first()?.x_mm, self.lines.last()?.x_mm))
    }
}
