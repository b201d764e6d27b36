//! Where the strands and wires of a stretch are taken to be while it is measured.

use super::rope::Rope;
use super::strand_alignment::StrandAlignment;
use super::stretch::ViewModel;
use super::template::PhaseBin;
use super::wire_pattern::{mean_phase, turn_with_strands};

/// Reference course of the strands over a stretch: a straight mean and each strand's deviation at the knots.
#[derive(Debug, Clone)]
pub struct Reference {
    /// Phase of strand 0 at the middle line, unwrapped, in rad.
    pub phase_rad: f64,
    /// Rate in rad/mm.
    pub rate_rad_per_mm: f64,
    /// Lines of the stretch.
    pub lines: usize,
    /// Rope per line in mm.
    pub pitch_mm: f64,
    /// Lines per knot.
    pub knot_lines: usize,
    /// `deviation_rad[knot * strands + j]`.
    pub deviation_rad: Vec<f64>,
    /// Phase of wire 0 of every strand at the middle line in rad, and its rate in rad/mm; NaN where the wires are not known.
    pub wires: Vec<(f64, f64)>,
}

impl Reference {
    /// The straight course of an alignment, without deviations.
    pub fn straight(alignment: &StrandAlignment, rope: &Rope, lines: usize, pitch_mm: f64, knot_lines: usize) -> Self {
        Self {
            phase_rad: alignment.phase_rad,
            rate_rad_per_mm: alignment.rate_rad_per_mm,
            lines,
            pitch_mm,
            knot_lines,
            deviation_rad: vec![0.0; lines.div_ceil(knot_lines) * rope.strands()],
            wires: vec![(f64::NAN, f64::NAN); rope.strands()],
        }
    }

    /// Mean phase of strand 0 at a line.
    pub fn mean_phase_rad(&self, line: f64) -> f64 {
        self.phase_rad + self.rate_rad_per_mm * (line - (self.lines as f64 - 1.0) / 2.0) * self.pitch_mm
    }

    /// Line in the middle of a knot.
    pub fn knot_middle(&self, knot: usize) -> f64 {
        let from = knot * self.knot_lines;
        (from + (from + self.knot_lines).min(self.lines) - 1) as f64 / 2.0
    }

    /// True if wires are known to be laid against the strands.
    pub(super) fn is_ordinary(&self) -> bool {
        // NaN, an unknown rate, compares false.
        self.wires.iter().any(|wire| wire.1 * self.rate_rad_per_mm < 0.0)
    }

    /// Phase of strand j at a knot.
    pub fn strand_rad(&self, rope: &Rope, knot: usize, j: usize) -> f64 {
        let regular = self.mean_phase_rad(self.knot_middle(knot)) + j as f64 * rope.strand_step_rad();
        regular + self.deviation_rad[knot * rope.strands() + j]
    }

    /// Number of knots.
    pub fn knots(&self) -> usize {
        self.lines.div_ceil(self.knot_lines)
    }

    /// Phase of strand 0 at a line that the strands have on average, their deviations included.
    pub fn average_phase_rad(&self, rope: &Rope, line: usize) -> f64 {
        let mut phases = [0.0; 8];
        let phases = &mut phases[..rope.strands()];
        self.phases_rad(rope, line, phases);
        mean_phase(rope, phases)
    }

    /// Phases of wire 0 of all strands at a line; NaN where the wires are not known.
    pub fn wires_rad(&self, line: usize, out: &mut [f64]) {
        let off_mm = (line as f64 - (self.lines as f64 - 1.0) / 2.0) * self.pitch_mm;
        for (phase, (middle, rate)) in out.iter_mut().zip(&self.wires) {
            *phase = middle + rate * off_mm;
        }
    }

    /// The same as they seem to be in the view at `angle_rad`, if all strands are taken to stand at their regular places, as the
    /// template has them: those of a strand that stands farther seem turned on.
    pub fn apparent_wires_rad(&self, rope: &Rope, angle_rad: f64, line: usize, out: &mut [f64]) {
        let mut strands = [0.0; 8];
        let strands = &mut strands[..rope.strands()];
        self.phases_rad(rope, line, strands);
        self.wires_rad(line, out);
        turn_with_strands(rope, angle_rad, strands, out);
    }

    /// Takes the wires out of a normalised line of a view, where they are known.
    pub fn wires_remover<'a>(
        &'a self,
        rope: &'a Rope,
        model: &'a ViewModel,
    ) -> impl FnMut(usize, PhaseBin, &mut [f32]) + 'a {
        let mut wires = vec![f64::NAN; rope.strands()];
        let mut per_rad = Vec::new();
        move |line, bin, gray| {
            per_rad.resize(gray.len(), 0.0);
            if let (Some(template), Some(pattern)) = (&model.template, &model.pattern) {
                self.apparent_wires_rad(rope, model.camera.angle_rad, line, &mut wires);
                pattern.subtract_all(rope, template, bin, &wires, model.camera.angle_rad, gray, &mut per_rad);
            }
        }
    }

    /// Phases of all strands at a line, deviations interpolated between the knots.
    pub fn phases_rad(&self, rope: &Rope, line: usize, out: &mut [f64]) {
        let n = rope.strands();
        let knots = self.knots();
        let at = (line as f64 - (self.knot_lines as f64 - 1.0) / 2.0) / self.knot_lines as f64;
        let a = (at.max(0.0) as usize).min(knots - 1);
        let b = (a + 1).min(knots - 1);
        let share = (at - a as f64).clamp(0.0, 1.0);
        let mean = self.mean_phase_rad(line as f64);
        for (j, phase) in out.iter_mut().enumerate().take(n) {
            let (da, db) = (self.deviation_rad[a * n + j], self.deviation_rad[b * n + j]);
            *phase = mean + j as f64 * rope.strand_step_rad() + da + share * (db - da);
        }
    }
}
